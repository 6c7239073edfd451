//! Names, kinds and limits of the joints of a control board, in the board's own answers
//! ([`super::device`] asks for them).
//!
//! ```text
//!   /icub/head/state:o, stateExt:o, command:i ─▶ /icub/head/rpc:i
//!      [get] [axes]      ─▶  [is] [axes] 6 …
//!      [get] [name] 0    ─▶  [is] [name] neck_pitch …
//!      [get] [type] 0    ─▶  [is] [type] 1987212385 …     the vocab [atrv] turns, [atpr] slides
//!      [get] [llim] 0    ─▶  [is] [llim] -30.0 22.0 …     of those that are moved
//!   of YARP 4: /icub/head/nws/rpc:i
//!      getAxesRPC        ─▶  ([ok]) 6
//!      getAxisNameRPC 0  ─▶  ([ok]) neck_pitch
//! ```
//!
//! The port that exists, of these two, also tells in which dialect the board reads floats.
//!
//! Option `joints` goes before the names that are told. A board that never tells leaves joints without names.

use std::sync::Arc;
use std::time::Duration;

use wrapyfi_yarp::bottle::Vocab;
use wrapyfi_yarp::port::Port;
use wrapyfi_yarp::{Bottle, Dialect, Value};

use super::joint_limits::{JointLimits, Range};
use super::options::{Axis, YarpOptions};
use super::payload;

/// Endings of the names of a control board's ports that have a port for requests beside them.
const PORTS: [&str; 3] = ["/state:o", "/stateExt:o", payload::COMMAND_PORT];
/// Endings of the port for requests, each with the dialect of the board.
const REQUESTS: [(&str, Dialect); 2] = [("/rpc:i", Dialect::V3), ("/nws/rpc:i", Dialect::V4)];
/// Most joints of a board.
const MOST: i64 = 256;

/// Longest time that a device may take for all its answers.
pub(super) const ANSWERS: Duration = Duration::from_secs(2);

/// The ports for requests that the board of a port may have, and what it speaks there.
pub(super) fn requests(port: &str) -> Option<[(String, Dialect); 2]> {
    let prefix = PORTS.iter().find_map(|end| port.strip_suffix(end))?;
    Some(REQUESTS.map(|(end, dialect)| (format!("{prefix}{end}"), dialect)))
}

/// The joints of a board, in its order.
#[derive(Debug, Default, Clone, PartialEq)]
pub(super) struct Joints {
    /// None where the board has no name for one, or one name for two.
    names: Vec<String>,
    axes: Vec<Axis>,
    limits: Vec<Option<Range>>,
}

impl Joints {
    pub(super) fn applied(self, given: &YarpOptions, dialect: Dialect) -> YarpOptions {
        let joints = if given.joints.is_empty() { self.names } else { given.joints.clone() };
        // Boards of YARP 4 alone are told by their port: those of YARP 3 have what is set.
        let dialect = given.dialect.or(Some(dialect).filter(|dialect| *dialect == Dialect::V4));
        let limits = Arc::new(JointLimits::new(self.limits));
        YarpOptions { joints, axes: self.axes, limits, dialect, ..given.clone() }
    }

    fn add(&mut self, name: Option<String>, axis: Axis) {
        let place = self.axes.len();
        self.axes.push(axis);
        // A name that is missing leaves the list too short for ever.
        if let Some(name) = name
            && self.names.len() == place
            && !name.is_empty()
            && !self.names.contains(&name)
        {
            self.names.push(name);
        }
    }

    fn finished(mut self) -> Self {
        if self.names.len() != self.axes.len() {
            self.names.clear();
        }
        self
    }
}

/// Asks a board for its joints, and for the limits of those that are moved.
pub(super) async fn joints(
    client: &Port,
    dialect: Dialect,
    is_moved: bool,
) -> Result<Joints, String> {
    let get = async |word, joint| get(client, dialect, word, joint).await;
    let axes = get(Word::Axes, None).await?;
    let count = axes.first().and_then(Value::as_i64).filter(|count| (1..=MOST).contains(count));
    let count =
        count.ok_or_else(|| format!("it said {:?} joints, up to {MOST} are read", axes.first()))?;
    let mut joints = Joints::default();
    for joint in 0..count {
        let name = get(Word::Name, Some(joint)).await?;
        let name = name.first().and_then(Value::as_str).map(str::to_owned);
        let kind = get(Word::Type, Some(joint)).await?;
        joints.add(name, kind.first().map_or(Axis::Revolute, axis));
        if is_moved {
            let limits = get(Word::Limits, Some(joint)).await?;
            let limit = |place: usize| limits.get(place).and_then(Value::as_f64);
            joints.limits.push(limit(0).zip(limit(1)));
        }
    }
    Ok(joints.finished())
}

/// The kind of a joint, a number that is a vocab.
fn axis(kind: &Value) -> Axis {
    let code = match kind {
        Value::Vocab32(code) => Some(*code),
        number => number.as_i64().and_then(|code| i32::try_from(code).ok()).map(Vocab),
    };
    if code == Some(Vocab::new("atpr")) { Axis::Prismatic } else { Axis::Revolute }
}

/// Property of a joint that the board is asked for.
#[derive(Debug, Clone, Copy)]
enum Word {
    Axes,
    Name,
    Type,
    Limits,
}

impl Word {
    /// The words of the question to a board of YARP 3, or the function of one of YARP 4.
    fn asked(self, dialect: Dialect) -> Vec<Value> {
        let (word, function) = match self {
            Self::Axes => ("axes", "getAxesRPC"),
            Self::Name => ("name", "getAxisNameRPC"),
            Self::Type => ("type", "getJointTypeRPC"),
            Self::Limits => ("llim", "getPosLimitsRPC"),
        };
        match dialect {
            Dialect::V3 => vec![Value::vocab("get"), Value::vocab(word)],
            Dialect::V4 => vec![function.into()],
        }
    }
}

/// The values that the board says of `word`, and of a joint; none where it says that it cannot.
async fn get(
    client: &Port,
    dialect: Dialect,
    word: Word,
    joint: Option<i64>,
) -> Result<Vec<Value>, String> {
    let joint = joint.and_then(|joint| i32::try_from(joint).ok()).map(Value::Int32);
    let request = Bottle { values: word.asked(dialect).into_iter().chain(joint).collect() };
    let reply = client.call(&request, ANSWERS).await.map_err(|error| error.to_string())?;
    let reply = reply.unwrap_or_default();
    let head = match (dialect, reply.get(0)) {
        (Dialect::V3, Some(first)) if first.is_word("is") => 2,
        (Dialect::V4, Some(Value::List(done)))
            if done.get(0).is_some_and(|it| it.is_word("ok")) =>
        {
            1
        }
        _ => return Ok(Vec::new()),
    };
    Ok(reply.values.into_iter().skip(head).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_all_or_none_and_kinds_are_kept() {
        let joints = |told: &[(&str, &str)]| {
            let mut joints = Joints::default();
            for (name, kind) in told {
                let code = i64::from(Vocab::new(kind).0);
                joints.add(Some((*name).to_owned()), axis(&code.into()));
            }
            joints.finished()
        };
        let named = joints(&[("neck", "atrv"), ("heave", "atpr")]);
        assert_eq!(named.names, ["neck", "heave"]);
        assert_eq!(named.axes, [Axis::Revolute, Axis::Prismatic]);
        for odd in [&[("neck", "atrv"), ("neck", "atrv")], &[("", "atrv"), ("neck", "unkn")]] {
            let told = joints(odd);
            assert_eq!((told.names.len(), told.axes.len()), (0, 2));
        }
        let given = YarpOptions { joints: vec!["a".into(), "b".into()], ..YarpOptions::default() };
        let applied = named.clone().applied(&given, Dialect::V3);
        assert_eq!((applied.joints, applied.dialect), (given.joints.clone(), None));
        let applied = named.applied(&given, Dialect::V4);
        assert!(applied.has_degrees(0) && !applied.has_degrees(1));
        assert_eq!(applied.dialect, Some(Dialect::V4));
    }
}
