//! Errors and warnings of `--ros-args`. The texts are those of ROS 2, which people search for, where these say what is wrong.

use std::error::Error;
use std::{fmt, io};

use crate::NameError;

/// A refused command line, with the warnings that came before it was refused.
///
/// ```
/// # mod wrapyfi_core { pub mod node { pub use wrapyfi_node::{args::RosArgs, read_params_file}; } }
/// use wrapyfi_core::node::{RosArgs, read_params_file};
/// let words = ["--ros-args", "--remap"].map(str::to_owned);
/// let error = RosArgs::parse(words, read_params_file).unwrap_err();
/// # assert!(matches!(error.kind, wrapyfi_node::args::RosArgsErrorKind::TrailingFlag { .. }));
/// assert!(error.to_string().starts_with("Couldn't parse trailing --remap flag. "));
/// ```
#[derive(Debug)]
pub struct RosArgsError {
    /// The reason.
    #[doc(hidden)]
    pub kind: RosArgsErrorKind,
    /// Warnings that came before the error, in order.
    pub warnings: Vec<String>,
}

impl fmt::Display for RosArgsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.kind.fmt(f)
    }
}

impl Error for RosArgsError {
    /// Cause that the text does not have: the error of the system or of the YAML parser.
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        match &self.kind {
            RosArgsErrorKind::Argument { reason, .. } => reason.source(),
            _ => None,
        }
    }
}

/// Error of a command line.
///
/// See [`RosArgsError`].
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RosArgsErrorKind {
    /// More words than any launch file makes.
    #[error("more than {0} arguments")]
    TooManyArguments(usize),
    /// The last word is a flag that wants another word.
    #[error("Couldn't parse trailing {flag} flag. {missing}")]
    TrailingFlag {
        /// The flag as written.
        flag: String,
        /// Value that should follow the flag, in words.
        missing: &'static str,
    },
    /// `--log-level` is the last word.
    #[error("Couldn't parse trailing log level flag: '{0}'. No log level provided.")]
    TrailingLogLevel(String),
    /// A rule, a file or a level cannot be read.
    #[error("Couldn't parse {what}: '{flag} {value}'. Error: {reason}")]
    Argument {
        /// Kind of the argument: `remap rule`, `parameter override rule`, `params file`, `log level`.
        what: &'static str,
        /// The flag as written.
        flag: String,
        /// The rule, path or level as written.
        value: String,
        /// Fault of the argument.
        reason: Box<dyn Error + Send + Sync>,
    },
    /// The enclave is no absolute name.
    #[error("Enclave name is not valid: '{0}'. Invalid index: {index}", index = .0.index)]
    Enclave(NameError),
    /// Words inside a block that mean nothing to ROS.
    #[error("found unknown ROS arguments: [{}]", quoted(.0))]
    Unknown(Vec<String>),
    /// A file to configure logging with was given.
    #[error("spdlog logging backend doesn't currently support external configuration")]
    LogConfigFile(String),
}

fn quoted(words: &[String]) -> String {
    let words: Vec<String> = words.iter().map(|word| format!("'{word}'")).collect();
    words.join(", ")
}

/// Error of reading a remap rule, or the part of a parameter rule before its value.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum RuleError {
    /// The rule has no `:=`.
    #[error("a rule is written FROM:=TO, and this one has no `:=`")]
    NoSeparator,
    /// A name is none.
    #[error(
        "{0:?} is no name: it is words of letters, digits and single underscores, none of which begins with a digit, \
         with slashes between them"
    )]
    NoName(String),
    /// `*` or `**` in a rule.
    #[error("Wildcard '{0}' is not implemented")]
    Wildcard(&'static str),
    /// `\1` to `\9` in a rule.
    #[error("Backreferences are not implemented")]
    BackReference,
    /// Nothing stands before or behind `:=`.
    #[error("a rule is written FROM:=TO, and one of the two is missing")]
    Missing,
}

impl RuleError {
    /// Reason that a text is no name.
    pub(super) fn no_name(text: &str) -> Self {
        match text {
            "" => Self::Missing,
            _ if text.contains("**") => Self::Wildcard("**"),
            _ if text.contains('*') => Self::Wildcard("*"),
            _ if text.contains('\\') => Self::BackReference,
            _ => Self::NoName(text.to_owned()),
        }
    }
}

/// Error of a parameter file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ParamsFileError {
    /// The file cannot be read.
    #[error("Error opening YAML file")]
    Open(#[source] io::Error),
    /// The file is larger than a file of parameters should be.
    #[error("the file is larger than {0} bytes")]
    TooLarge(usize),
    /// The file is not text.
    #[error("the file is not UTF-8 from byte {0} on")]
    NotUtf8(usize),
    /// The content of the file is wrong.
    #[error(transparent)]
    Yaml(#[from] YamlError),
}

/// The YAML parser's reason.
pub type ParserError = Box<dyn Error + Send + Sync>;

/// Error in the YAML of a file or of a value on the command line.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum YamlError {
    /// A file is not YAML; the line is that of the last thing understood.
    #[error("Error parsing a event near line {line}")]
    FileSyntax {
        /// Line, from 1.
        line: usize,
        /// The parser's reason.
        #[source]
        reason: ParserError,
    },
    /// A value is not YAML.
    #[error("Error parsing an event")]
    ValueSyntax(#[source] ParserError),
    /// A value on the command line is no scalar and no list of scalars.
    #[error("Unknown YAML event")]
    ValueShape,
    /// A parameter in a file is no scalar, no list of scalars and no group.
    #[error("Unknown YAML event at line {0}")]
    FileShape(usize),
    /// A key without value.
    #[error("No value at line {0}")]
    NoValue(usize),
    /// A value without key.
    #[error("No key at line {0}")]
    NoKey(usize),
    /// Parameters that belong to no node.
    #[error("There are no node names before ros__parameters at line {0}")]
    NoNodeName(usize),
    /// A value where a node or `ros__parameters` should be.
    #[error("Cannot have a value before ros__parameters at line {0}")]
    ValueBeforeParameters(usize),
    /// A list as key, or in a list.
    #[error("Sequences cannot be key at line {0}")]
    SequenceAsKey(usize),
    /// A list where a node or `ros__parameters` should be.
    #[error("Sequences can only be values and not keys in params. Error at line {0}")]
    SequenceBeforeParameters(usize),
    /// `*anchor`
    #[error("Will not support aliasing at line {0}")]
    Alias(usize),
    /// A list of several types.
    #[error(
        "Sequence should be of same type. Value type '{kind}' do not belong at line_num {line}"
    )]
    MixedSequence {
        /// Type of the first value that differs.
        kind: &'static str,
        /// Line of the file, from 1.
        line: usize,
    },
    /// A node that the graph could not have.
    #[error(transparent)]
    NodeName(#[from] NameError),
    /// Two slashes in a row in the name of a node.
    #[error("{0} contains repeated forward slash")]
    RepeatedSlash(String),
    /// Groups in groups.
    #[error("nested deeper than {max} at line {line}")]
    TooDeep {
        /// Deepest that is accepted.
        max: usize,
        /// Line, from 1.
        line: usize,
    },
    /// The name of a parameter or of a node is too long, with all its groups.
    #[error("a name is longer than {0} bytes")]
    NameTooLong(usize),
    /// All files and the command line together have too many parameters.
    #[error("more than {0} parameters")]
    TooManyParameters(usize),
}

/// Error of a log level.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LogLevelError {
    /// The word is no name of a severity.
    #[error("Argument does not use a valid severity level")]
    NoSeverity,
    /// `:=debug`
    #[error("Argument has an invalid logger item that name is empty")]
    NoLogger,
}
