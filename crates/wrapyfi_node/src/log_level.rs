//! Severities of log lines.

use wrapyfi_interfaces::named;

named! {
    /// Severity of a line, or least severity that a logger lets through; numbered as in ROS 2.
    ///
    /// ```
    /// use wrapyfi_node::LogLevel;
    /// assert_eq!(LogLevel::from_name("warn"), Some(LogLevel::Warn));
    /// assert_eq!(LogLevel::from_number(40), Some(LogLevel::Error));
    /// assert!(LogLevel::Warn > LogLevel::Info && LogLevel::Warn.number() == 30);
    /// ```
    #[derive(PartialOrd, Ord, Default)]
    pub enum LogLevel {
        /// The level of the logger above holds.
        #[default]
        Unset = 0 => "UNSET",
        /// Details for programmers.
        Debug = 10 => "DEBUG",
        /// Normal events; the level of a logger without one.
        Info = 20 => "INFO",
        /// Events that may become a problem.
        Warn = 30 => "WARN",
        /// Failures.
        Error = 40 => "ERROR",
        /// Failures that end the node.
        Fatal = 50 => "FATAL",
    }
    /// Name in log lines, for instance `WARN`.
    pub fn name;
}

impl LogLevel {
    /// The level of this name, in any case.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|level| level.name().eq_ignore_ascii_case(name))
    }

    /// The level that messages write as this number.
    pub fn from_number(number: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|level| u32::from(level.number()) == number)
    }

    /// Number in messages, for instance 30.
    pub fn number(self) -> u8 {
        self as u8
    }
}
