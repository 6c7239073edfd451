//! `--log-level debug` for all loggers, `--log-level ns.talker:=debug` for one and those below.

use std::collections::BTreeMap;

use super::error::LogLevelError;
use super::lexer::{Cursor, Lexeme};
use crate::node::LogLevel;

/// The levels that were asked for; of several for one logger the last.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(super) struct LogLevels {
    default: LogLevel,
    loggers: BTreeMap<String, LogLevel>,
}

impl LogLevels {
    /// Takes in one rule.
    pub(super) fn add(&mut self, text: &str) -> Result<(), LogLevelError> {
        let severity = |name| LogLevel::from_name(name).ok_or(LogLevelError::NoSeverity);
        let mut cursor = Cursor::new(text);
        while !matches!(cursor.peek(), Lexeme::Separator | Lexeme::Eof) {
            cursor.accept();
        }
        if cursor.peek() == Lexeme::Eof {
            self.default = severity(text)?;
            return Ok(());
        }
        let logger = cursor.since(text);
        if logger.is_empty() {
            return Err(LogLevelError::NoLogger);
        }
        cursor.expect(Lexeme::Separator)?;
        let name = cursor.expect(Lexeme::Token)?;
        cursor.expect(Lexeme::Eof)?;
        self.loggers.insert(logger.to_owned(), severity(name)?);
        Ok(())
    }

    /// What counts for a logger: its own level, else that of the nearest one above it, else the
    /// one for all, else `INFO`.
    pub(super) fn effective(&self, logger: &str) -> LogLevel {
        let mut name = logger;
        loop {
            match self.loggers.get(name) {
                Some(&level) if level != LogLevel::Unset => return level,
                _ => {}
            }
            match name.rsplit_once('.') {
                Some((above, _)) => name = above,
                None if self.default == LogLevel::Unset => return LogLevel::Info,
                None => return self.default,
            }
        }
    }

    /// The level for all loggers, as far as one was asked for.
    pub(super) fn default_level(&self) -> LogLevel {
        self.default
    }

    /// The levels of single loggers.
    pub(super) fn loggers(&self) -> &BTreeMap<String, LogLevel> {
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
    }

    #[test]
    fn broken_rules_are_refused() {
        let error = |text: &str| LogLevels::default().add(text).unwrap_err().to_string();
        assert_eq!(error(":=debug"), "Argument has an invalid logger item that name is empty");
        assert_eq!(error("a:=loud"), "Argument does not use a valid severity level");
        assert_eq!(error("a:=1"), "Expected lexeme type (18) not found, search ended at index 3");
        assert_eq!(error("a:=info:=x"), "Expected lexeme type 1, got 8 at index 7");
    }
}
