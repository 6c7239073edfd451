//! Names of types.

use std::fmt;

use super::{Dialect, ParseFault};
use crate::named;

named! {
    /// Kind of interface that a type is, or belongs to.
    #[derive(PartialOrd, Ord)]
    pub enum InterfaceKind {
        /// An action (`.action`) or a part of one.
        Action => "action",
        /// A message (`.msg`).
        Message => "msg",
        /// A service (`.srv`) or a part of one.
        Service => "srv",
    }
    /// Middle part of a name and extension of the file: `action`, `msg` or `srv`.
    pub fn as_str, from_part;
}

impl InterfaceKind {
    /// Endings of the names of the types that come out of one definition, longest first.
    fn suffixes(self) -> &'static [&'static str] {
        match self {
            Self::Action => &[
                "_SendGoal_Request",
                "_SendGoal_Response",
                "_SendGoal_Event",
                "_GetResult_Request",
                "_GetResult_Response",
                "_GetResult_Event",
                "_FeedbackMessage",
                "_SendGoal",
                "_GetResult",
                "_Goal",
                "_Result",
                "_Feedback",
            ],
            Self::Message => &[],
            Self::Service => &["_Request", "_Response", "_Event"],
        }
    }
}

/// Full name of a type, written `sensor_msgs/msg/Image` or `std_srvs/srv/SetBool_Request`.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct TypeName {
    // Boxed, since errors hold several of them.
    package: Box<str>,
    kind: InterfaceKind,
    name: Box<str>,
}

impl TypeName {
    /// Name of a message from its parts, for instance `sensor_msgs` and `Image`.
    ///
    /// # Errors
    /// When a part breaks the ROS rules for names.
    pub fn new(package: &str, name: &str) -> Result<Self, ParseFault> {
        Self::with_kind(Dialect::Ros2, package, InterfaceKind::Message, name)
    }

    /// Name of any interface from its parts, for instance `std_srvs`, service and
    /// `SetBool_Request`. ROS 1 allows more names than ROS 2 (`tf/tfMessage`).
    ///
    /// # Errors
    /// When a part breaks the rules of the dialect.
    pub fn with_kind(
        dialect: Dialect,
        package: &str,
        kind: InterfaceKind,
        name: &str,
    ) -> Result<Self, ParseFault> {
        let package_ok = is_name(dialect, package, char::is_lowercase);
        if !package_ok {
            return Err(ParseFault::PackageName(package.to_owned()));
        }
        let base = base(kind, name);
        let name_ok = match dialect {
            Dialect::Ros1 => is_name(dialect, base, char::is_uppercase),
            Dialect::Ros2 => {
                base.starts_with(|c: char| c.is_ascii_uppercase())
                    && base.chars().all(|c| c.is_ascii_alphanumeric())
            }
        };
        if !name_ok {
            return Err(ParseFault::TypeName(name.to_owned()));
        }
        Ok(Self { package: package.into(), kind, name: name.into() })
    }

    /// Reads `package/Name` (a message) or `package/kind/Name`.
    ///
    /// ```
    /// use wrapyfi_interfaces::parser::{Dialect, TypeName};
    /// let name = TypeName::parse(Dialect::Ros2, "std_srvs/srv/SetBool_Request").unwrap();
    /// assert_eq!(name.file_stem(), "SetBool");
    /// assert_eq!(name.dds(), "std_srvs::srv::dds_::SetBool_Request_");
    /// ```
    ///
    /// # Errors
    /// When it is neither, or a part breaks the rules of the dialect.
    pub fn parse(dialect: Dialect, text: &str) -> Result<Self, ParseFault> {
        let parts: Vec<&str> = text.split('/').collect();
        let (package, kind, name) = match *parts.as_slice() {
            [package, name] => (package, Some(InterfaceKind::Message), name),
            [package, kind, name] => (package, InterfaceKind::from_part(kind), name),
            _ => ("", None, ""),
        };
        let kind = kind.ok_or_else(|| ParseFault::TypeName(text.to_owned()))?;
        Self::with_kind(dialect, package, kind, name)
    }

    /// Package, for instance `sensor_msgs`.
    pub fn package(&self) -> &str {
        &self.package
    }

    /// Message, service or action.
    pub fn kind(&self) -> InterfaceKind {
        self.kind
    }

    /// Name inside the package, for instance `Image`.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Name of the file that defines the type, without extension: `SetBool` for
    /// `SetBool_Request`.
    pub fn file_stem(&self) -> &str {
        base(self.kind, &self.name)
    }

    /// Name of a message that is known to be valid.
    pub(crate) fn well_known(package: &str, name: &str) -> Self {
        Self { package: package.into(), kind: InterfaceKind::Message, name: name.into() }
    }

    /// The same interface's type with `suffix` behind the name.
    pub(crate) fn derived(&self, suffix: &str) -> Self {
        Self { name: format!("{}{suffix}", self.name).into(), ..self.clone() }
    }

    /// The type whose definition file this type comes from.
    pub fn interface(&self) -> Self {
        Self { name: self.file_stem().into(), ..self.clone() }
    }

    /// Name of the type on DDS, for instance `sensor_msgs::msg::dds_::Image_`.
    pub fn dds(&self) -> String {
        format!("{}::{}::dds_::{}_", self.package, self.kind.as_str(), self.name)
    }
}

impl fmt::Display for TypeName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}/{}", self.package, self.kind.as_str(), self.name)
    }
}

fn base(kind: InterfaceKind, name: &str) -> &str {
    kind.suffixes().iter().find_map(|suffix| name.strip_suffix(suffix)).unwrap_or(name)
}

/// True for a name of letters, digits and underscores that begins with a letter. ROS 2 takes letters of
/// one case only, and single underscores between them.
pub(super) fn is_name(dialect: Dialect, name: &str, letter: fn(char) -> bool) -> bool {
    let letter = |c: char| match dialect {
        Dialect::Ros1 => c.is_ascii_alphabetic(),
        Dialect::Ros2 => c.is_ascii() && letter(c),
    };
    name.starts_with(letter)
        && name.chars().all(|c| letter(c) || c.is_ascii_digit() || c == '_')
        && (dialect == Dialect::Ros1 || !name.contains("__") && !name.ends_with('_'))
}
