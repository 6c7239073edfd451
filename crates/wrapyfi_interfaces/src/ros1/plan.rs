//! The plan of a pair of types: ROS 1 bytes to CDR and back.

use std::fmt;
use std::sync::Arc;

use bytes::Bytes;

use super::compile::{Differences, Pair, Program, compile};
use super::error::{PairError, TranscodeError};
use super::rules::Rules;
use super::run::Work;
use super::wire::{Source, Target};
use crate::cdr::{CdrError, ENCAPSULATION_SIZE};
use crate::dynamic;
use crate::parser::TypeName;
use crate::store::ResolvedType;

/// Plain CDR, little-endian, no options.
const ENCAPSULATION: [u8; ENCAPSULATION_SIZE] = [0, 1, 0, 0];
/// DDS fills whole words of four bytes.
const MOST_PADDING: usize = 3;
/// Bytes that a message usually grows by at most.
const GROWTH: usize = 64;

/// Conversion of messages of a ROS 1 type to messages of a ROS 2 type, and the reverse. Compiled
/// once for each pair of types; cheap to clone and to share between threads.
///
/// ```
/// use wrapyfi_interfaces::parser::{Dialect, TypeName};
/// use wrapyfi_interfaces::ros1::{Options, PairPlan, Rules};
/// use wrapyfi_interfaces::store::ResolvedType;
/// let resolve = |dialect, name, text| {
///     let name = TypeName::parse(dialect, name).unwrap();
///     ResolvedType::from_text(dialect, &name, text).unwrap()
/// };
/// let ros1 = resolve(Dialect::Ros1, "demo/Reading", "string sensor\nfloat64[] celsius\n");
/// let ros2 = resolve(Dialect::Ros2, "demo/msg/Reading", "string sensor\nfloat64[] celsius\n");
/// let plan = PairPlan::compile(&ros1, &ros2, &Rules::built_in()).unwrap();
///
/// let bytes = b"\x01\0\0\0A\x01\0\0\0\0\0\0\0\0\0\xf0\x3f"; // "A", [1.0]
/// let mut cdr = Vec::new();
/// plan.to_cdr(bytes, &Options::default(), &mut cdr).unwrap();
/// assert_eq!(cdr[..12], *b"\0\x01\0\0\x02\0\0\0A\0\0\0");
/// let mut again = Vec::new();
/// plan.to_ros1(&cdr, 0, &Options::default(), &mut again).unwrap();
/// assert_eq!(again, bytes);
/// ```
#[derive(Clone)]
pub struct PairPlan {
    inner: Arc<Inner>,
}

struct Inner {
    ros1: TypeName,
    ros2: TypeName,
    to_ros2: Program,
    to_ros1: Program,
    notes: Vec<Note>,
    /// Reads big-endian messages, which are rare.
    big_endian: dynamic::TypePlan,
}

/// Difference of a pair of types: a part that is not carried, or that is carried under another
/// name. Paths are from the message on: `transforms[].header.seq`.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Note {
    /// A field of ROS 1 alone: dropped on the way to ROS 2, zero or empty on the way back. The `seq` of
    /// a message's own header counts instead.
    OnlyRos1(String),
    /// A field of ROS 2 alone: has its default value there, and is dropped on the way to ROS 1.
    OnlyRos2(String),
    /// A field with two names.
    Renamed {
        /// Path in ROS 1.
        ros1: String,
        /// Path in ROS 2.
        ros2: String,
    },
}

impl Note {
    /// True where the value of a field is lost in one direction. The `seq` of headers is not: ROS 2 has none, and towards
    /// ROS 1 it is counted.
    pub fn is_loss(&self) -> bool {
        match self {
            Self::OnlyRos1(path) => path != "header.seq" && !path.ends_with(".header.seq"),
            Self::OnlyRos2(_) => true,
            Self::Renamed { .. } => false,
        }
    }
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OnlyRos1(path) if path == "header.seq" => f.write_str(
                "header.seq is in ROS 1 only: dropped towards ROS 2, counted towards ROS 1",
            ),
            Self::OnlyRos1(path) => {
                write!(f, "{path} is in ROS 1 only: dropped towards ROS 2, empty towards ROS 1")
            }
            Self::OnlyRos2(path) => {
                write!(
                    f,
                    "{path} is in ROS 2 only: default value towards ROS 2, dropped towards ROS 1"
                )
            }
            Self::Renamed { ros1, ros2 } => write!(f, "{ros1} of ROS 1 is {ros2} in ROS 2"),
        }
    }
}

/// Limits of one message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Options {
    /// Most bytes, of what is read and of what is written.
    pub message_bytes: usize,
    /// Most texts and messages in sequences, counted over the whole message.
    pub elements: usize,
}

impl Default for Options {
    /// 64 MiB, 16 Mi elements.
    fn default() -> Self {
        Self { message_bytes: 64 << 20, elements: 16 << 20 }
    }
}

/// Numbers of the changes that a message needed; all zero as a rule. Add them to the route's
/// counters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Transcoded {
    /// Strings with a NUL inside, which ends them in ROS 2.
    pub cut_texts: u32,
    /// Strings that are not UTF-8, in which U+FFFD stands for the bytes at fault, as ROS 1's Python has it.
    pub bad_texts: u32,
    /// Times whose seconds are 2^31 or more in ROS 1 (from the year 2038 on), or negative in ROS 2: the
    /// same 32 bits stand for another time on the other side.
    pub wrapped_times: u32,
}

impl fmt::Debug for PairPlan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Inner { ros1, ros2, to_ros2, to_ros1, notes, .. } = &*self.inner;
        f.debug_struct("PairPlan")
            .field("ros1", ros1)
            .field("ros2", ros2)
            .field("to_ros2", &to_ros2.ops.len())
            .field("to_ros1", &to_ros1.ops.len())
            .field("notes", notes)
            .finish_non_exhaustive()
    }
}

impl PairPlan {
    /// Compiles a pair of types. That the two belong together is taken for granted; messages inside
    /// them must be counterparts by rule or by name.
    ///
    /// # Errors
    /// When a type is too large or too deep, when fields of one name are of different types, when
    /// nothing goes across, or a rule names a field that is not there.
    pub fn compile(
        ros1: &ResolvedType,
        ros2: &ResolvedType,
        rules: &Rules,
    ) -> Result<Self, PairError> {
        // Checks depth and fixed sizes of both.
        let big_endian = ros2.plan()?;
        ros1.plan()?;
        let pair = Pair {
            ros1: (ros1.name(), ros1.definitions()),
            ros2: (ros2.name(), ros2.definitions()),
            rules,
        };
        let (to_ros2, differences) = compile(pair, true)?;
        let (to_ros1, _) = compile(pair, false)?;
        let Differences { only_ros1, only_ros2, renamed } = differences;
        let one = only_ros1.into_iter().map(Note::OnlyRos1);
        let two = only_ros2.into_iter().map(Note::OnlyRos2);
        let names = renamed.into_iter().map(|(ros1, ros2)| Note::Renamed { ros1, ros2 });
        let notes = one.chain(two).chain(names).collect();
        let (ros1, ros2) = (ros1.name().clone(), ros2.name().clone());
        Ok(Self { inner: Arc::new(Inner { ros1, ros2, to_ros2, to_ros1, notes, big_endian }) })
    }

    /// Name of the ROS 1 type, with `msg` or `srv` in it.
    pub fn ros1_type(&self) -> &TypeName {
        &self.inner.ros1
    }

    /// Name of the ROS 2 type.
    pub fn ros2_type(&self) -> &TypeName {
        &self.inner.ros2
    }

    /// Differences of the pair of types: to be logged once, when a route begins.
    pub fn notes(&self) -> &[Note] {
        &self.inner.notes
    }

    /// True where no field of either type is lost.
    pub(super) fn is_whole(&self) -> bool {
        !self.notes().iter().any(Note::is_loss)
    }

    /// Appends the CDR form of a ROS 1 message to `out`, with its encapsulation header. On an error
    /// `out` is as it was.
    ///
    /// # Errors
    /// When `ros1` is no message of the type, is larger than allowed or would become so, or exceeds
    /// a bound of the ROS 2 type.
    pub fn to_cdr(
        &self,
        ros1: &[u8],
        options: &Options,
        out: &mut Vec<u8>,
    ) -> Result<Transcoded, TranscodeError> {
        check_size(ros1.len(), options)?;
        self.inner.to_ros2.carry::<false, true>(ros1, 0, options, out)
    }

    /// Appends the ROS 1 form of a message in CDR to `out`, without a length in front of it. `seq`
    /// becomes `header.seq` where the ROS 1 type has it. On an error `out` is as it was.
    ///
    /// # Errors
    /// When `cdr` is no message of the type in plain CDR, or is larger than allowed or would become
    /// so.
    pub fn to_ros1(
        &self,
        cdr: &[u8],
        seq: u32,
        options: &Options,
        out: &mut Vec<u8>,
    ) -> Result<Transcoded, TranscodeError> {
        check_size(cdr.len(), options)?;
        let body = match cdr {
            [0, 1, _, _, body @ ..] => body,
            [0, 0, _, _, ..] => {
                let cdr = Bytes::copy_from_slice(cdr);
                let message = self.inner.big_endian.decode_exact(&cdr, options.message_bytes)?;
                return self.to_ros1(&message.encode().to_bytes(), seq, options, out);
            }
            _ => {
                let found = cdr.iter().take(ENCAPSULATION_SIZE).copied().collect();
                return Err(CdrError::Encapsulation(found).into());
            }
        };
        self.inner.to_ros1.carry::<true, false>(body, seq, options, out)
    }
}

impl Program {
    /// Appends what becomes of `body`. `F`: it is CDR; `T`: the result is.
    fn carry<const F: bool, const T: bool>(
        &self,
        body: &[u8],
        seq: u32,
        options: &Options,
        out: &mut Vec<u8>,
    ) -> Result<Transcoded, TranscodeError> {
        let before = out.len();
        out.reserve(body.len().saturating_add(GROWTH));
        if T {
            out.extend(ENCAPSULATION);
        }
        let mut work = Work {
            from: Source::<F>::new(body),
            to: Target::<T>::new(out),
            paths: &self.paths,
            options: *options,
            seq,
            marks: vec![0; self.marks],
            elements: 0,
            done: Transcoded::default(),
        };
        let most_padding = if F { MOST_PADDING } else { 0 };
        let carried = work.run(&self.ops).and_then(|()| match work.from.remaining() {
            left if left > most_padding => Err(CdrError::Trailing(left).into()),
            _ => check_size(work.to.len(), options),
        });
        let done = work.done;
        if carried.is_err() {
            out.truncate(before);
        }
        carried.map(|()| done)
    }
}

fn check_size(actual: usize, options: &Options) -> Result<(), TranscodeError> {
    let limit = options.message_bytes;
    if actual <= limit { Ok(()) } else { Err(TranscodeError::TooLarge { actual, limit }) }
}
