//! End of a command: the exit codes, and one clear line on stderr.

use std::process::ExitCode;
use std::time::Duration;

use crate::logging;

/// Longest time that the last log lines may take to be read at the end.
const LAST_WORDS: Duration = Duration::from_millis(500);

/// Failure of a command, which decides its exit code.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// Bad usage or configuration: exit code 2.
    #[error("{0}")]
    Usage(String),
    /// Something that the settings name is not there: exit code 2 of a command. The routes of a bridge
    /// wait for it.
    #[error("{0}")]
    Absent(String),
    /// Something awaited did not come in time: exit code 3.
    #[error("{0}")]
    TimedOut(String),
    /// The program that read the output has seen enough: the command ends, with success and without a word.
    #[error("nobody reads the output any more")]
    Unread,
    /// The command has said on stdout what is wrong: exit code 1.
    #[error("a cause was found")]
    Found,
    /// Everything else: exit code 1.
    #[error("{}", in_words(.0))]
    Failed(#[from] anyhow::Error),
}

/// Result of what a command does.
pub type Result<T, E = Failure> = std::result::Result<T, E>;

impl Failure {
    /// A wrong argument or configuration.
    #[expect(clippy::needless_pass_by_value, reason = "so that it fits into map_err")]
    pub fn usage(fault: impl ToString) -> Self {
        Self::Usage(fault.to_string())
    }

    /// The exit code, as `wrapyfi --help` lists it.
    pub fn code(&self) -> u8 {
        match self {
            Self::Unread => 0,
            Self::Found | Self::Failed(_) => 1,
            Self::Usage(_) | Self::Absent(_) => 2,
            Self::TimedOut(_) => 3,
        }
    }
}

/// The causes of an error one behind the other, without those that the one before has told already.
fn in_words(error: &anyhow::Error) -> String {
    let mut words = String::new();
    let mut before = String::new();
    for cause in error.chain().map(ToString::to_string) {
        if !before.contains(&cause) {
            words += if words.is_empty() { "" } else { ": " };
            words += &cause;
            before = cause;
        }
    }
    words
}

/// Prints the failure, if any, and turns it into the process's exit code.
#[must_use]
pub fn finish(outcome: Result<()>) -> ExitCode {
    let code = outcome.as_ref().err().map_or(0, Failure::code);
    match outcome {
        Ok(()) | Err(Failure::Unread | Failure::Found) => logging::finish(LAST_WORDS),
        Err(failure) => logging::last_word(&format!("wrapyfi: {failure}")),
    }
    ExitCode::from(code)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cause_that_is_told_is_not_told_again() {
        let full = || std::io::Error::other("the disk is full");
        let named = anyhow::Error::new(full()).context("cannot write: the disk is full");
        let error = Failure::Failed(named.context("a.mcap"));
        assert_eq!(error.to_string(), "a.mcap: cannot write: the disk is full");
        let plain = Failure::Failed(anyhow::Error::new(full()).context("a.mcap"));
        assert_eq!(plain.to_string(), "a.mcap: the disk is full");
    }
}
