//! `--log-level debug` for all loggers, `--log-level ns.talker:=debug` for one and those below.

use std::collections::BTreeMap;

use super::error::LogLevelError;
use crate::LogLevel;

/// Levels of loggers by name; of several for one logger the last.
///
/// ```
/// use wrapyfi_node::{LogLevel, args::LogLevels};
/// let mut levels = LogLevels::default();
/// levels.set("camera", LogLevel::Debug);
/// assert_eq!(levels.effective("camera.driver"), LogLevel::Debug); // that of the logger above it
/// assert_eq!(levels.effective("arm"), LogLevel::Info);
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct LogLevels {
    default: LogLevel,
    loggers: BTreeMap<String, LogLevel>,
}

impl LogLevels {
    /// Takes in one rule.
    pub(super) fn add(&mut self, text: &str) -> Result<(), LogLevelError> {
        let severity = |name| LogLevel::from_name(name).ok_or(LogLevelError::NoSeverity);
        let Some((logger, name)) = text.split_once(":=") else {
            self.default = severity(text)?;
            return Ok(());
        };
        if logger.is_empty() {
            return Err(LogLevelError::NoLogger);
        }
        self.loggers.insert(logger.to_owned(), severity(name)?);
        Ok(())
    }

    /// Level of a logger: its own, else that of the nearest one above it, else the one for all, else
    /// `INFO`.
    pub fn effective(&self, logger: &str) -> LogLevel {
        match (self.nearest(logger), self.default) {
            (Some(level), _) => level,
            (None, LogLevel::Unset) => LogLevel::Info,
            (None, default) => default,
        }
    }

    /// Level of a logger, or of the nearest one above it, where one of them has a level of its own.
    pub fn nearest(&self, logger: &str) -> Option<LogLevel> {
        let above = std::iter::successors(Some(logger), |name| Some(name.rsplit_once('.')?.0));
        above.map(|name| self.of(name)).find(|level| *level != LogLevel::Unset)
    }

    /// Level that a logger has of its own; [`LogLevel::Unset`] where it has none.
    pub fn of(&self, logger: &str) -> LogLevel {
        self.loggers.get(logger).copied().unwrap_or_default()
    }

    /// Gives a logger a level of its own, or takes it away with [`LogLevel::Unset`].
    pub fn set(&mut self, logger: &str, level: LogLevel) {
        match level {
            LogLevel::Unset => drop(self.loggers.remove(logger)),
            level => drop(self.loggers.insert(logger.to_owned(), level)),
        }
    }

    /// Level for all loggers; [`LogLevel::Unset`] when none was given.
    pub fn default_level(&self) -> LogLevel {
        self.default
    }

    /// Levels of single loggers.
    pub fn loggers(&self) -> &BTreeMap<String, LogLevel> {
        &self.loggers
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loggers_inherit_from_above() {
        let mut levels = LogLevels::default();
        for rule in ["warn", "ns:=debug", "ns.quiet:=ERROR", "ns.loud:=unset"] {
            levels.add(rule).unwrap();
        }
        assert_eq!(levels.effective("other"), LogLevel::Warn);
        assert_eq!(levels.effective("ns.talker"), LogLevel::Debug);
        assert_eq!(levels.effective("ns.quiet.child"), LogLevel::Error);
        assert_eq!(levels.effective("ns.loud"), LogLevel::Debug);
        assert_eq!([levels.of("ns.loud"), levels.of("ns")], [LogLevel::Unset, LogLevel::Debug]);
        assert_eq!(
            [levels.nearest("other"), levels.nearest("ns.x.y")],
            [None, Some(LogLevel::Debug)]
        );
        levels.set("ns", LogLevel::Unset);
        assert_eq!(levels.effective("ns.loud"), LogLevel::Warn);
    }

    #[test]
    fn broken_rules_are_refused() {
        let error = |text: &str| LogLevels::default().add(text).unwrap_err().to_string();
        assert_eq!(error(":=debug"), "Argument has an invalid logger item that name is empty");
        for text in ["a:=loud", "a:=1", "a:=info:=x", "a:="] {
            assert_eq!(error(text), "Argument does not use a valid severity level", "{text}");
        }
    }
}
