//! The start of a middleware from its settings, whichever program gives these.
//!
//! ```text
//!   a program: zeromq() ros1(node) ros2(node) yarp(), changed by with(|settings| …)  ─┐
//!   options of a method: Source ─▶ Planned                                            ├─▶ MiddlewareSettings::start ─▶ Middleware
//!   a configuration: Section ─▶ Planned                                              ─┘
//!     └── each begins with the environment: WRAPYFI_ZEROMQ_*, ROS_MASTER_URI, ROS_DOMAIN_ID, yarp.conf
//! ```

use std::fmt;
use std::sync::Arc;

use crate::Middleware;

/// Settings of a middleware that is not started yet.
///
/// ```
/// use wrapyfi_endpoint::{Middleware, MiddlewareSettings, StartError, memory::Memory};
///
/// struct BusSettings { name: String }
/// impl MiddlewareSettings for BusSettings {
///     type Middleware = Memory;
///     fn start(&self) -> Result<Memory, StartError> {
///         match self.name.as_str() {
///             "" => Err(StartError::refused("the bus needs a name")),
///             name => Ok(Memory::new(name)),
///         }
///     }
/// }
///
/// assert_eq!(BusSettings { name: "bus".into() }.start()?.name(), "bus");
/// # Ok::<(), StartError>(())
/// ```
pub trait MiddlewareSettings {
    /// The middleware that they are for.
    type Middleware: Middleware + 'static;

    /// Starts the middleware. A broker, master or name server elsewhere that is not there yet is no error: it is
    /// waited for.
    ///
    /// # Errors
    /// When the middleware refuses.
    fn start(&self) -> Result<Self::Middleware, StartError>;
}

/// Error of starting a middleware.
///
/// ```
/// use wrapyfi_endpoint::StartError;
/// let error = StartError::refused("pub_port must be a port, not 0");
/// assert!(matches!(&error, StartError::Refused(_)));
/// assert_eq!(error.to_string(), "pub_port must be a port, not 0");
/// ```
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum StartError {
    /// An option has a value that it cannot have.
    #[error("{0}")]
    Option(String),
    /// The settings can never work, in the words of the middleware.
    #[error("{0}")]
    Refused(String),
    /// A machine or server that the settings name is not there.
    #[error("{0}")]
    Absent(String),
    /// The system or a library refuses; a later try may succeed.
    #[error("{0}")]
    Failed(String),
}

impl StartError {
    /// Makes [`StartError::Refused`] of the middleware's own error.
    pub fn refused(reason: impl fmt::Display) -> Self {
        Self::Refused(reason.to_string())
    }

    /// True where no later try can succeed with the same settings.
    pub fn is_hopeless(&self) -> bool {
        matches!(self, Self::Option(_) | Self::Refused(_))
    }

    /// Makes the error of a middleware's own: one that no later try mends, or something that is not there, or else a
    /// failure of the system.
    pub fn of(error: &impl fmt::Display, is_hopeless: bool, is_absent: bool) -> Self {
        match (is_hopeless, is_absent) {
            (true, _) => Self::refused(error),
            (false, true) => Self::Absent(error.to_string()),
            (false, false) => Self::Failed(error.to_string()),
        }
    }
}

/// Settings as the environment has them, changed where a program says otherwise.
///
/// ```
/// use wrapyfi_endpoint::{Builder, Middleware, MiddlewareSettings, StartError, memory::Memory};
/// #[derive(Default)]
/// struct BusSettings { name: &'static str }
/// impl MiddlewareSettings for BusSettings {
///     type Middleware = Memory;
///     fn start(&self) -> Result<Memory, StartError> { Ok(Memory::new(self.name)) }
/// }
/// let bus = Builder::new(Ok(BusSettings::default())).with(|settings| settings.name = "bus").start()?;
/// assert_eq!(bus.name(), "bus");
/// # Ok::<(), StartError>(())
/// ```
#[derive(Debug)]
#[must_use = "nothing runs until it is started"]
pub struct Builder<S>(Result<S, StartError>);

impl<S: MiddlewareSettings> Builder<S> {
    /// Begins with the settings of the environment, or with the fault of one of its variables.
    pub fn new(of_environment: Result<S, StartError>) -> Self {
        Self(of_environment)
    }

    /// Changes settings.
    pub fn with(mut self, change: impl FnOnce(&mut S)) -> Self {
        if let Ok(settings) = &mut self.0 {
            change(settings);
        }
        self
    }

    /// Starts the middleware.
    ///
    /// # Errors
    /// When a variable of the environment has a value that it cannot have, or the middleware refuses.
    pub fn start(self) -> Result<S::Middleware, StartError> {
        self.0?.start()
    }
}

/// A middleware that is not started yet: one of two with equal keys does for both.
#[derive(Clone)]
pub struct Planned {
    /// Settings as text: with other ones it is another middleware.
    pub key: String,
    /// Function that starts it, each time anew.
    pub start: Arc<StartFn>,
}

/// Function that starts a middleware.
pub type StartFn = dyn Fn() -> Result<Arc<dyn Middleware>, StartError> + Send + Sync;

impl Planned {
    /// A middleware that starts with these settings.
    pub fn new(key: String, settings: impl MiddlewareSettings + Send + Sync + 'static) -> Self {
        Self { key, start: Arc::new(move || Ok(Arc::new(settings.start()?) as _)) }
    }
}

impl PartialEq for Planned {
    fn eq(&self, other: &Self) -> bool {
        self.key == other.key
    }
}

impl fmt::Debug for Planned {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Planned").field(&self.key).finish()
    }
}
