//! The role of a method, chosen at run time.

use std::str::FromStr;

use wrapyfi_data::did_you_mean;
use wrapyfi_interfaces::named;

named! {
    /// Effect of a call of a registered method: Wrapyfi's modes.
    ///
    /// | mode | body runs | sends | returns |
    /// | --- | --- | --- | --- |
    /// | `none` | yes | no | own values |
    /// | `disable` | no | no | nothing |
    /// | `publish` | yes | each value | own values |
    /// | `listen` | no | no | received values |
    /// | `receive` | yes, with the received values | no | own values |
    /// | `reemit` | yes, with the received values | each value | own values |
    /// | `transceive` | yes | each value | received values |
    /// | `request` | no | the arguments | replies |
    /// | `reply` | yes, with the client's arguments | the reply | own values |
    ///
    /// ```
    /// use wrapyfi_core::communicator::Mode;
    /// let mode: Mode = "transceive".parse()?;
    /// assert!(mode == Mode::Transceive && mode.sends() && mode.listens());
    /// assert!(!Mode::Listen.sends());
    /// # Ok::<(), wrapyfi_core::communicator::ParseModeError>(())
    /// ```
    #[derive(Default)]
    pub enum Mode {
        /// The method as if it were not registered; `null` in a configuration.
        #[default]
        None => "none",
        /// Runs the body and sends its values.
        Publish => "publish",
        /// Returns values that another program published; the body does not run.
        Listen => "listen",
        /// Runs the body with values that another program published.
        Receive => "receive",
        /// Runs the body, sends its values, and returns the values that come back.
        Transceive => "transceive",
        /// Runs the body with received values, and sends its own.
        Reemit => "reemit",
        /// Sends the arguments and returns the reply; the body does not run.
        Request => "request",
        /// Runs the body with a client's arguments and sends its values to that client.
        Reply => "reply",
        /// Does nothing and returns nothing.
        Disable => "disable",
    }
    /// Name in scripts and configurations.
    pub fn name;
}

impl Mode {
    /// True when the mode publishes values.
    pub fn sends(self) -> bool {
        matches!(self, Self::Publish | Self::Transceive | Self::Reemit)
    }

    /// True when the mode listens for values.
    pub fn listens(self) -> bool {
        self.listens_first() || self == Self::Transceive
    }

    /// True when the mode listens before the body runs, or instead of it.
    pub fn listens_first(self) -> bool {
        self == Self::Listen || self.feeds_body()
    }

    /// True when the mode gives received values to the body.
    pub fn feeds_body(self) -> bool {
        matches!(self, Self::Receive | Self::Reemit)
    }

    /// True when the mode publishes and listens, and needs a topic for each.
    pub(super) fn has_two_ways(self) -> bool {
        matches!(self, Self::Transceive | Self::Reemit)
    }
}

/// Error of reading a mode; the text lists the modes.
///
/// ```
/// use wrapyfi_core::communicator::Mode;
/// let error = "pulbish".parse::<Mode>().unwrap_err().to_string();
/// assert!(error.starts_with("\"pulbish\" is no mode; did you mean `publish`? modes are none, "));
/// ```
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{word:?} is no mode; {hint}modes are {}", Mode::ALL.map(Mode::name).join(", "))]
pub struct ParseModeError {
    /// Word that is no mode.
    pub word: String,
    hint: String,
}

impl FromStr for Mode {
    type Err = ParseModeError;

    fn from_str(word: &str) -> Result<Self, Self::Err> {
        Self::ALL.into_iter().find(|mode| mode.name() == word).ok_or_else(|| ParseModeError {
            word: word.to_owned(),
            hint: did_you_mean(word, &Self::ALL.map(Self::name)),
        })
    }
}

/// A mode for all instances of a type, or one for each in the order in which they were made.
///
/// ```
/// use std::sync::Arc;
/// use wrapyfi_core::communicator::{CommunicatorContext, Configuration, Mode, Modes, communicator};
/// # use wrapyfi_core::middleware::memory::Memory;
///
/// struct Mirror;
/// #[communicator]
/// impl Mirror {
///     #[register(NativeObject, "memory", "/msg")]
///     fn read(&self) -> String { "hello".to_owned() }
/// }
///
/// let modes = Modes::ByInstance(vec![Mode::Publish, Mode::Listen]);
/// let context = CommunicatorContext::builder()
///     .only(Arc::new(Memory::new("memory")))
///     .configuration(Configuration::default().with("Mirror", "read", modes))
///     .build();
/// let (first, second) = (Mirror.communicator_in(&context), Mirror.communicator_in(&context));
/// assert_eq!(first.mode(MirrorMethod::Read), Mode::Publish);
/// assert_eq!(second.mode(MirrorMethod::Read), Mode::Listen);
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Modes {
    /// The same mode for all instances.
    All(Mode),
    /// A mode for each instance, the first made first.
    ByInstance(Vec<Mode>),
}

impl From<Mode> for Modes {
    fn from(mode: Mode) -> Self {
        Self::All(mode)
    }
}

/// Argument of `activate` that names modes: a [`Mode`] or its name, or a list of either by
/// instance.
///
/// ```
/// use wrapyfi_core::communicator::{Mode, Modes, NamesMode};
/// assert_eq!("publish".modes(), Ok(Modes::All(Mode::Publish)));
/// let by_instance = Modes::ByInstance(vec![Mode::Publish, Mode::Listen]);
/// assert_eq!(["publish", "listen"].modes(), Ok(by_instance));
/// ```
pub trait NamesMode {
    /// Reads the modes.
    ///
    /// # Errors
    /// When a name is no mode.
    fn modes(self) -> Result<Modes, ParseModeError>;
}

impl NamesMode for Mode {
    fn modes(self) -> Result<Modes, ParseModeError> {
        Ok(Modes::All(self))
    }
}

impl NamesMode for Modes {
    fn modes(self) -> Result<Modes, ParseModeError> {
        Ok(self)
    }
}

impl NamesMode for &str {
    fn modes(self) -> Result<Modes, ParseModeError> {
        self.parse().map(Modes::All)
    }
}

impl NamesMode for &String {
    fn modes(self) -> Result<Modes, ParseModeError> {
        self.as_str().modes()
    }
}

/// One entry of a list by instance.
///
/// ```
/// use wrapyfi_core::communicator::{Mode, NamesOneMode};
/// assert_eq!(("listen".mode(), Mode::Listen.mode()), (Ok(Mode::Listen), Ok(Mode::Listen)));
/// ```
pub trait NamesOneMode {
    /// Reads the mode.
    ///
    /// # Errors
    /// When the name is no mode.
    fn mode(self) -> Result<Mode, ParseModeError>;
}

impl NamesOneMode for Mode {
    fn mode(self) -> Result<Mode, ParseModeError> {
        Ok(self)
    }
}

impl NamesOneMode for &str {
    fn mode(self) -> Result<Mode, ParseModeError> {
        self.parse()
    }
}

impl<T: NamesOneMode, const N: usize> NamesMode for [T; N] {
    fn modes(self) -> Result<Modes, ParseModeError> {
        self.into_iter().map(T::mode).collect::<Result<_, _>>().map(Modes::ByInstance)
    }
}

impl<T: NamesOneMode> NamesMode for Vec<T> {
    fn modes(self) -> Result<Modes, ParseModeError> {
        self.into_iter().map(T::mode).collect::<Result<_, _>>().map(Modes::ByInstance)
    }
}

impl<T: NamesOneMode + Copy> NamesMode for &[T] {
    fn modes(self) -> Result<Modes, ParseModeError> {
        self.iter().map(|&entry| entry.mode()).collect::<Result<_, _>>().map(Modes::ByInstance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_is_read_and_a_wrong_one_is_told_the_right_one() {
        for mode in Mode::ALL {
            assert_eq!(mode.name().parse(), Ok(mode));
        }
        let error = "pulbish".parse::<Mode>().unwrap_err().to_string();
        assert!(
            error.starts_with("\"pulbish\" is no mode; did you mean `publish`? modes are none, ")
        );
    }

    #[test]
    fn lists_are_by_instance() {
        let wanted = Modes::ByInstance(vec![Mode::Publish, Mode::Listen]);
        assert_eq!(["publish", "listen"].modes(), Ok(wanted.clone()));
        assert_eq!(vec![Mode::Publish, Mode::Listen].modes(), Ok(wanted.clone()));
        assert_eq!([Mode::Publish, Mode::Listen][..].modes(), Ok(wanted));
        assert!(["publish", "x"].modes().is_err());
    }
}
