//! `--ros-args`: the command line every ROS 2 node understands.
//!
//! ```text
//!   argv ─▶ words ─┬─ outside a block ──▶ the program's own arguments, in order
//!                  │                      (name:=value is still a rule, with a warning)
//!                  └─ --ros-args … [--]
//!                       -r ───────────────▶ remap rules ──▶ names of node, topics, services
//!                       -p, --params-file ▶ overrides ────▶ parameters of a node
//!                       --log-level, … ───▶ logging
//!                       -e ───────────────▶ enclave
//!                       anything else ────▶ refused
//! ```
//!
//! The parser touches no file: [`RosArgs::parse`] is given a function that reads one.

mod error;
mod log_levels;
mod parameters;
mod remap;
mod rule;

use std::collections::BTreeMap;
use std::error::Error;
use std::io;

pub use error::{
    LogLevelError, ParamsFileError, ParserError, RosArgsError, RosArgsErrorKind, RuleError,
    YamlError,
};
pub use log_levels::LogLevels;
pub use parameters::MAX_FILE_BYTES;
use parameters::Overrides;
use remap::{RemapRule, Scope};

use super::name::check_enclave;
use super::{NameError, NodeName};
use wrapyfi_data::types::ParameterValue;

/// Most arguments of one command line.
pub const MAX_ARGUMENTS: usize = 16_384;

/// Rules that a command line sets for the nodes of its process: names, parameters, log levels.
///
/// ```
/// # mod wrapyfi_core { pub mod node { pub use wrapyfi_node::{NodeName, args::RosArgs}; } }
/// use wrapyfi_core::node::{NodeName, RosArgs};
/// let argv = ["--fast", "--ros-args", "-r", "__ns:=/robot", "-r", "chatter:=news"];
/// let args = RosArgs::parse(argv, |_path| Err(std::io::ErrorKind::NotFound.into()))?;
///
/// let name = args.node_name("talker");
/// let node = NodeName::new(&name, &args.namespace("/", &name))?;
/// assert_eq!(args.resolve_topic(&node, "chatter")?, "/robot/news");
/// assert_eq!(args.program_args, ["--fast"]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct RosArgs {
    /// Arguments that are not ROS's, in order.
    pub program_args: Vec<String>,
    /// Warnings for the author of the command line, in order.
    pub warnings: Vec<String>,
    /// Security enclave, `/` unless given.
    pub enclave: String,
    /// True when log lines go to `/rosout`.
    pub rosout_logs: bool,
    /// True when log lines go to the console.
    pub stdout_logs: bool,
    rules: Vec<RemapRule>,
    overrides: Overrides,
    log_levels: LogLevels,
}

impl Default for RosArgs {
    /// A command line without arguments.
    fn default() -> Self {
        Self {
            program_args: Vec::new(),
            warnings: Vec::new(),
            enclave: "/".to_owned(),
            rosout_logs: true,
            stdout_logs: true,
            rules: Vec::new(),
            overrides: Overrides::default(),
            log_levels: LogLevels::default(),
        }
    }
}

impl RosArgs {
    /// Reads a command line, given without the program's name. `read_file` returns the bytes of
    /// a parameter file; it need not read more than [`MAX_FILE_BYTES`] and one.
    ///
    /// # Errors
    /// When ROS 2 would refuse the command line; the error has the warnings that came before.
    pub fn parse<I, F>(argv: I, mut read_file: F) -> Result<Self, RosArgsError>
    where
        I: IntoIterator<Item: Into<String>>,
        F: FnMut(&str) -> io::Result<Vec<u8>>,
    {
        let mut args = Self::default();
        match args.read_all(&mut argv.into_iter().map(Into::into), &mut read_file) {
            Ok(()) => Ok(args),
            Err(kind) => Err(RosArgsError { kind, warnings: args.warnings }),
        }
    }

    fn read_all(
        &mut self,
        words: &mut dyn Iterator<Item = String>,
        read_file: &mut dyn FnMut(&str) -> io::Result<Vec<u8>>,
    ) -> Result<(), RosArgsErrorKind> {
        let mut words = Words { words, taken: 0 };
        let mut refused = Refused::default();
        let mut in_block = false;
        while let Some(word) = words.next()? {
            match word.as_str() {
                "--ros-args" => in_block = true,
                "--" if in_block => in_block = false,
                _ if in_block => self.flag(word, &mut words, read_file, &mut refused)?,
                _ => self.program_word(word),
            }
        }
        check_enclave(&self.enclave).map_err(RosArgsErrorKind::Enclave)?;
        if !refused.unknown.is_empty() {
            return Err(RosArgsErrorKind::Unknown(refused.unknown));
        }
        refused.log_config_file.map_or(Ok(()), |path| Err(RosArgsErrorKind::LogConfigFile(path)))
    }

    fn program_word(&mut self, word: String) {
        match RemapRule::parse(&word, &mut self.warnings) {
            Ok(rule) => {
                self.rules.push(rule);
                self.warnings.push(format!(
                    "Found remap rule '{word}'. This syntax is deprecated. Use '--ros-args --remap {word}' instead."
                ));
            }
            Err(_not_a_rule) => self.program_args.push(word),
        }
    }

    /// One flag of a block, with the word behind it where it wants one.
    fn flag(
        &mut self,
        flag: String,
        words: &mut Words<'_>,
        read_file: &mut dyn FnMut(&str) -> io::Result<Vec<u8>>,
        refused: &mut Refused,
    ) -> Result<(), RosArgsErrorKind> {
        match flag.as_str() {
            "-r" | "--remap" => {
                let rule = words.value(&flag, "No remap rule found.")?;
                match RemapRule::parse(&rule, &mut self.warnings) {
                    Ok(parsed) => self.rules.push(parsed),
                    Err(reason) => return Err(unreadable("remap rule", flag, rule, reason)),
                }
            }
            "-p" | "--param" => {
                let rule = words.value(&flag, "No parameter override rule found.")?;
                if let Err(reason) = parameters::parse_rule(&rule, &mut self.overrides) {
                    return Err(unreadable("parameter override rule", flag, rule, reason));
                }
            }
            "--params-file" => {
                let path = words.value(&flag, NO_PATH)?;
                let added = read_file(&path)
                    .map_err(ParamsFileError::Open)
                    .and_then(|content| self.overrides.add_file(&content));
                if let Err(reason) = added {
                    return Err(unreadable("params file", flag, path, reason));
                }
            }
            "--log-level" => {
                let Some(rule) = words.next()? else {
                    return Err(RosArgsErrorKind::TrailingLogLevel(flag));
                };
                if let Err(reason) = self.log_levels.add(&rule) {
                    return Err(unreadable("log level", flag, rule, reason));
                }
            }
            // No log file is written: launch, systemd and the shell keep what a node prints.
            "--log-file-name" => _ = words.value(&flag, "No string prefix provided.")?,
            "--log-config-file" => refused.log_config_file = Some(words.value(&flag, NO_PATH)?),
            "-e" | "--enclave" => {
                self.enclave = words.value(&flag, "No enclave path provided.")?;
            }
            "--enable-rosout-logs" => self.rosout_logs = true,
            "--disable-rosout-logs" => self.rosout_logs = false,
            "--enable-stdout-logs" => self.stdout_logs = true,
            "--disable-stdout-logs" => self.stdout_logs = false,
            "--enable-external-lib-logs" | "--disable-external-lib-logs" => {}
            // Unknown flags are collected, because a list of all is of more use than the first.
            _ => refused.unknown.push(flag),
        }
        Ok(())
    }

    /// Name of a node that is called `default` unless a rule says otherwise.
    pub fn node_name(&self, default: &str) -> String {
        remap::node_name(&self.rules, default).unwrap_or(default).to_owned()
    }

    /// Namespace of the node called `node` after remapping.
    pub fn namespace(&self, default: &str, node: &str) -> String {
        remap::namespace(&self.rules, node).unwrap_or(default).to_owned()
    }

    /// Absolute name of the topic that `name` stands for in `node`.
    ///
    /// # Errors
    /// When `name`, or what it becomes, is no topic name.
    pub fn resolve_topic(&self, node: &NodeName, name: &str) -> Result<String, NameError> {
        self.resolve(Scope::Topics, node, name)
    }

    /// Absolute name of the service that `name` stands for in `node`.
    ///
    /// # Errors
    /// When `name`, or what it becomes, is no service name.
    pub fn resolve_service(&self, node: &NodeName, name: &str) -> Result<String, NameError> {
        self.resolve(Scope::Services, node, name)
    }

    fn resolve(&self, scope: Scope, node: &NodeName, name: &str) -> Result<String, NameError> {
        let expanded = node.expand(name)?;
        Ok(remap::resource(&self.rules, scope, node, &expanded)?.unwrap_or(expanded))
    }

    /// Parameters given for the node with this fully qualified name.
    pub fn parameters_for(&self, fqn: &str) -> BTreeMap<String, ParameterValue> {
        self.overrides.for_node(fqn)
    }

    /// Levels that were given, for all loggers and for single ones.
    #[doc(hidden)]
    pub fn log_levels(&self) -> &LogLevels {
        &self.log_levels
    }
}

const NO_PATH: &str = "No file path provided.";

/// Faults that refuse the command line, but only after all its words have been read.
#[derive(Default)]
struct Refused {
    unknown: Vec<String>,
    log_config_file: Option<String>,
}

fn unreadable(
    what: &'static str,
    flag: String,
    value: String,
    reason: impl Into<Box<dyn Error + Send + Sync>>,
) -> RosArgsErrorKind {
    RosArgsErrorKind::Argument { what, flag, value, reason: reason.into() }
}

/// The words that have not been read, counted.
struct Words<'a> {
    words: &'a mut dyn Iterator<Item = String>,
    taken: usize,
}

impl Words<'_> {
    fn next(&mut self) -> Result<Option<String>, RosArgsErrorKind> {
        let word = self.words.next();
        self.taken += usize::from(word.is_some());
        if self.taken > MAX_ARGUMENTS {
            return Err(RosArgsErrorKind::TooManyArguments(MAX_ARGUMENTS));
        }
        Ok(word)
    }

    /// The word that belongs to `flag`, whatever it looks like.
    fn value(&mut self, flag: &str, missing: &'static str) -> Result<String, RosArgsErrorKind> {
        self.next()?
            .ok_or_else(|| RosArgsErrorKind::TrailingFlag { flag: flag.to_owned(), missing })
    }
}
