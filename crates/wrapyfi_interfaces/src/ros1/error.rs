//! Errors of definitions, pairs of types, and messages.

use std::fmt;

use super::names::ros1_name;
use crate::cdr::{CdrError, path_in_element, path_in_field};
use crate::did_you_mean;
use crate::dynamic::PlanError;
use crate::parser::{InterfaceKind, ParseFault, TypeName};
use crate::store::{Looked, Md5Error, ResolveError};

/// Field that is meant instead of `path`, else some of those that there are, in words.
fn hint(path: &str, fields: &[String]) -> String {
    const NAMED: usize = 10;
    let near = did_you_mean(path, fields);
    let dots = if fields.len() > NAMED { ", …" } else { "" };
    match near.trim_end() {
        "" => format!(
            "it has {}{dots}",
            fields.iter().take(NAMED).cloned().collect::<Vec<_>>().join(", ")
        ),
        near => near.to_owned(),
    }
}

/// Reason why no node tells the definition of a type, and what makes it known.
fn untold(name: &TypeName) -> (&'static str, &'static str) {
    match name.kind() {
        InterfaceKind::Service => (
            "nodes of ROS 1 do not show those of services",
            "have ROS_PACKAGE_PATH lead to its package",
        ),
        _ => ("no ROS 1 node has shown it yet", "start a node that publishes it"),
    }
}

/// Error of finding a ROS 1 definition.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DefinitionError {
    /// The name is no name of a ROS 1 type.
    #[error("{text:?} names no ROS 1 type: {fault}; it must be `package/Type`")]
    Name {
        /// Name as given.
        text: String,
        /// Fault of the line.
        #[source]
        fault: ParseFault,
    },
    /// The definition, or that of a type it refers to, could not be had.
    #[error(transparent)]
    Resolve(#[from] ResolveError),
    /// A publisher's definition is not the one whose checksum it names.
    #[error(
        "the definition of {name} that the publisher shows has the checksum {computed}, but it says \
         {claimed}; rebuild the publisher with one version of the package, or give a folder with that \
         version"
    )]
    Checksum {
        /// The type.
        name: TypeName,
        /// Checksum in the connection header; at most 32 characters of it.
        claimed: String,
        /// Checksum of the text.
        computed: String,
    },
    /// The type has no checksum.
    #[error(transparent)]
    Md5(#[from] Md5Error),
    /// No ROS 1 peer has shown the type, and nothing else has it, in ROS 2 neither.
    #[error(
        "the ROS 1 definition of {} is not known: {}; {looked}; {}, or give a folder with {}/{kind}/{}.{kind}",
        ros1_name(name), untold(name).0, untold(name).1, name.package(), name.file_stem(), kind = name.kind().as_str()
    )]
    Unknown {
        /// The type.
        name: TypeName,
        /// Places where it was looked for, in order.
        looked: Looked,
    },
    /// A type that makes no message of ROS 1, for instance a part of a service on its own.
    #[error("{name} is no {expected}; ask for the type itself")]
    Kind {
        /// The type.
        name: TypeName,
        /// `message` or `service`.
        expected: &'static str,
    },
}

/// A field with its type.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TypedField {
    /// The message.
    pub message: TypeName,
    /// The field, or a path into it.
    pub field: String,
    /// Type of the field, as a definition writes it.
    pub field_type: String,
}

impl fmt::Display for TypedField {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} of {} is {}", self.field, self.message, self.field_type)
    }
}

/// Error of a pair of types that has no plan.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PairError {
    /// One of the two is too large, too deep or malformed.
    #[error(transparent)]
    Type(#[from] PlanError),
    /// One of the two could not be had.
    #[error(transparent)]
    Resolve(#[from] ResolveError),
    /// The ROS 1 definition could not be had.
    #[error(transparent)]
    Definition(#[from] DefinitionError),
    /// A type is not among the definitions.
    #[error("{0} is not defined; give its definition")]
    Undefined(TypeName),
    /// Fields that belong together have types that do not go into each other.
    #[error(
        "{ros1} in ROS 1, {ros2} in ROS 2: bring the definitions together, or leave the field out \
         with a mapping rule"
    )]
    Mismatch {
        /// Field in ROS 1.
        ros1: Box<TypedField>,
        /// Field in ROS 2.
        ros2: Box<TypedField>,
    },
    /// Two fields of ROS 1 have one name in ROS 2, which has room for one of them.
    #[error(
        "{} and {} of {} of ROS 1 are both {spelled} in ROS 2, which would lose one of them: rename one, or define \
         the ROS 2 type with a field for each and name the counterparts in a mapping rule",
        fields[0], fields[1], ros1_name(name)
    )]
    Alike {
        /// The ROS 1 type.
        name: TypeName,
        /// The two fields.
        fields: [String; 2],
        /// Their name in ROS 2.
        spelled: String,
    },
    /// Both have fields, and none of one has a counterpart in the other.
    #[error(
        "{ros1} of ROS 1 and {ros2} of ROS 2 have no field in common; name the counterparts in a \
         mapping rule"
    )]
    NothingInCommon {
        /// ROS 1 type.
        ros1: TypeName,
        /// ROS 2 type.
        ros2: TypeName,
    },
    /// A mapping rule names a field that is not there.
    #[error(
        "the mapping rule of {name} names the field {path:?}, which it does not have: {}",
        hint(path, fields)
    )]
    RuleField {
        /// The type that lacks the field.
        name: TypeName,
        /// The field.
        path: String,
        /// Fields that it has.
        fields: Vec<String>,
    },
    /// A mapping rule names a field twice, or a field and a part of it.
    #[error("the mapping rule of {name} names {path:?} more than once")]
    RuleTwice {
        /// The type.
        name: TypeName,
        /// The field.
        path: String,
    },
    /// The types unfold into too many fields.
    #[error("{name} has over {limit} {what} with all that is in it; split it into smaller types")]
    TooComplex {
        /// The type.
        name: TypeName,
        /// `fields`, or bytes of their names.
        what: &'static str,
        /// The limit.
        limit: usize,
    },
}

/// Error of carrying a message over. `path` is the field, for instance
/// `transforms[2].header.frame_id`; of the source, or of the target where that is at fault.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum TranscodeError {
    /// The message is larger than the caller allows.
    #[error("message of {actual} bytes is over the limit of {limit} bytes; raise max_message_mib")]
    TooLarge {
        /// Size in bytes.
        actual: usize,
        /// Limit in bytes.
        limit: usize,
    },
    /// The other side's form of the message would be larger than the caller allows.
    #[error(
        "{path} makes the message at least {needed} bytes, over the limit of {limit}; raise max_message_mib"
    )]
    ResultTooLarge {
        /// The field.
        path: String,
        /// Bytes that were needed.
        needed: usize,
        /// Limit in bytes.
        limit: usize,
    },
    /// More elements than the caller allows.
    #[error("{path} brings the message over the limit of {limit} texts and messages in sequences")]
    TooMany {
        /// The field.
        path: String,
        /// The limit.
        limit: usize,
    },
    /// The target has a bound that the source exceeds.
    #[error("{path} has {actual} elements, the ROS 2 type allows {bound}")]
    Bound {
        /// The field.
        path: String,
        /// Elements, or bytes of a string.
        actual: usize,
        /// The bound.
        bound: u32,
    },
    /// The message is truncated, goes on behind its last field, or holds what no message of its type can.
    #[error(transparent)]
    Malformed(#[from] CdrError),
}

impl TranscodeError {
    /// The same error, seen from the message that has the value in its field `name`.
    pub(super) fn in_field(self, name: &str) -> Self {
        self.map_path(|path| path_in_field(path, name))
    }

    /// The same error, seen from the sequence that has the value at `index`.
    pub(super) fn in_element(self, index: usize) -> Self {
        self.map_path(|path| path_in_element(path, index))
    }

    fn map_path(mut self, change: impl FnOnce(&String) -> String) -> Self {
        match &mut self {
            Self::TooLarge { .. } => {}
            Self::ResultTooLarge { path, .. }
            | Self::TooMany { path, .. }
            | Self::Bound { path, .. } => *path = change(path),
            Self::Malformed(error) => error.change_path(change),
        }
        self
    }
}
