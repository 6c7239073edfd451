//! Severities of log lines.

use std::fmt;

/// Severity of a line, or least severity that a logger lets through; numbered as in ROS 2.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub enum LogLevel {
    /// The level of the logger above holds.
    #[default]
    Unset = 0,
    /// Details for programmers.
    Debug = 10,
    /// Normal events; the level of a logger without one.
    Info = 20,
    /// Events that may become a problem.
    Warn = 30,
    /// Failures.
    Error = 40,
    /// Failures that end the node.
    Fatal = 50,
}

impl LogLevel {
    const ALL: [Self; 6] =
        [Self::Unset, Self::Debug, Self::Info, Self::Warn, Self::Error, Self::Fatal];

    /// The level of this name, in any case.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|level| level.name().eq_ignore_ascii_case(name))
    }

    /// The level that messages write as this number.
    #[must_use]
    pub fn from_number(number: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|level| u32::from(level.number()) == number)
    }

    /// Name in log lines, for instance `WARN`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Unset => "UNSET",
            Self::Debug => "DEBUG",
            Self::Info => "INFO",
            Self::Warn => "WARN",
            Self::Error => "ERROR",
            Self::Fatal => "FATAL",
        }
    }

    /// Number in messages, for instance 30.
    #[must_use]
    pub fn number(self) -> u8 {
        self as u8
    }
}

impl fmt::Display for LogLevel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}
