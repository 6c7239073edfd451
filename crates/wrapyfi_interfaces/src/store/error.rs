//! Errors of resolving a type.

use std::{fmt, io};

use super::generated;
use crate::description::DescribeError;
use crate::did_you_mean;
use crate::parser::{InterfaceKind, ParseError, ParseFault, TypeName};
use crate::ros1::standard_text;

/// Largest definition in bytes: a file, or a full definition text.
pub const MAX_DEFINITION_SIZE: usize = 1 << 20;

/// Error of finding and reading the definition of a type.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ResolveError {
    /// The name is no name of a type.
    #[error("{text:?} names no type: {fault}")]
    Name {
        /// Name as given.
        text: String,
        /// Fault of the line.
        #[source]
        fault: ParseFault,
    },
    /// No place has a definition.
    #[error(
        "{name}{} is defined nowhere; {}{looked}; {}",
        needed_by(user),
        hint(name),
        remedy(name)
    )]
    NotFound {
        /// The type.
        name: TypeName,
        /// Type that has a field of it; none for the type that was asked for.
        user: Option<TypeName>,
        /// Places where it was looked for, in order.
        looked: Looked,
    },
    /// The package is installed, but has the type in IDL only.
    #[error(
        "{name} is installed as IDL only ({listed_in} lists no .{} file); give a folder with the \
         same type as {}",
        name.kind().as_str(),
        file(name)
    )]
    OnlyIdl {
        /// The type.
        name: TypeName,
        /// The index file of its package.
        listed_in: String,
    },
    /// A file is there, but cannot be read.
    #[error("{path}: {source}; make it readable, or take it out of the way")]
    File {
        /// The file.
        path: String,
        /// Error of the system.
        source: io::Error,
    },
    /// A definition is larger than any sensible one.
    #[error(
        "the definition of {name} has {actual} bytes, over the limit of {MAX_DEFINITION_SIZE}; {remedy}"
    )]
    TooLarge {
        /// The type.
        name: TypeName,
        /// Size in bytes.
        actual: usize,
        /// Remedy.
        remedy: &'static str,
    },
    /// A definition cannot be parsed.
    #[error("{place}: {source}")]
    Parse {
        /// Origin of the definition.
        place: String,
        /// The line at fault.
        source: Box<ParseError>,
    },
    /// A full definition text is not laid out as one.
    #[error(
        "the definition of {name}, line {line}: {text:?} follows the separator; it must be \
         `MSG: package/Type`"
    )]
    Separator {
        /// The type that was to be read.
        name: TypeName,
        /// Line, counted from 1.
        line: usize,
        /// The line itself.
        text: String,
    },
    /// A type contains itself, is nested too deeply, or refers to too many others.
    #[error(transparent)]
    Describe(#[from] DescribeError),
}

impl ResolveError {
    /// Refuses a definition that is larger than any sensible one.
    pub(super) fn check_size(
        name: &TypeName,
        text: &str,
        remedy: &'static str,
    ) -> Result<(), Self> {
        if text.len() <= MAX_DEFINITION_SIZE {
            return Ok(());
        }
        Err(Self::TooLarge { name: name.clone(), actual: text.len(), remedy })
    }
}

/// Places where a type was looked for. Written out, a long list is cut.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Looked(pub Vec<String>);

impl fmt::Display for Looked {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const SHOWN: usize = 4;
        if self.0.is_empty() {
            return f.write_str("no place is known: AMENT_PREFIX_PATH is empty, no folder given");
        }
        let shown: Vec<_> = self.0.iter().take(SHOWN).map(String::as_str).collect();
        write!(f, "looked for {}", shown.join(", "))?;
        match self.0.len() - shown.len() {
            0 => Ok(()),
            more => write!(f, " and {more} more"),
        }
    }
}

fn needed_by(user: &Option<TypeName>) -> String {
    user.as_ref().map(|user| format!(", which {user} has a field of,")).unwrap_or_default()
}

/// Name of a type or of a package that is perhaps meant, of those that this crate knows.
fn hint(name: &TypeName) -> String {
    let known = || {
        let kind = name.kind().as_str();
        let all = generated::names().chain(standard_text::names());
        all.filter(move |known| known.0 == kind).map(|(_, package, name)| (package, name))
    };
    let of_package = known().filter(|(package, _)| *package == name.package());
    let others: Vec<_> =
        of_package.map(|(_, other)| other).filter(|other| *other != name.name()).collect();
    if !others.is_empty() {
        return did_you_mean(name.name(), &others);
    }
    let packages = known().filter(|(_, other)| *other == name.name());
    did_you_mean(name.package(), &packages.map(|(package, _)| package).collect::<Vec<_>>())
}

fn remedy(name: &TypeName) -> String {
    format!(
        "install its package (ros-jazzy-{}) and source its setup file, or give a folder with {}",
        name.package().replace('_', "-"),
        file(name)
    )
}

/// Path of the definition below a folder of packages.
fn file(name: &TypeName) -> String {
    let kind: InterfaceKind = name.kind();
    format!("{}/{1}/{2}.{1}", name.package(), kind.as_str(), name.file_stem())
}
