//! A ROS 2 type known at run time, as small as a name.
//!
//! ```text
//!   definition (ament index, folder, ROS 1 connection header) ─ TypeStore ─ ResolvedType
//!                                                                              │ RosType::new
//!   type: of a route, MessageType::Ros, RosMessage  ◀── RosType (a copy) ◀─────┘
//! ```
//!
//! Types are kept for the life of the process, each definition once, so that a type can be copied and
//! compared like a word. Their number is bounded: a peer cannot fill the memory by naming types.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use wrapyfi_interfaces::dynamic::TypePlan;
use wrapyfi_interfaces::parser::InterfaceKind;
use wrapyfi_interfaces::store::{ResolvedType, TypeStore};
use wrapyfi_interfaces::{GeneratedType, Message};

/// Largest number of types that a process may know.
pub const MAX_ROS_TYPES: usize = 10_000;

/// A ROS 2 message type with the types that it refers to, its hash, and the layout of its messages.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::RosType;
/// use wrapyfi_interfaces::store::TypeStore;
///
/// let mut store = TypeStore::generated();
/// let header = RosType::new(&store.resolve_name("std_msgs/msg/Header")?)?;
/// assert_eq!(header.name(), "std_msgs/msg/Header");
/// assert!(header.type_hash().starts_with("RIHS01_"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy)]
pub struct RosType(&'static Known);

struct Known {
    name: String,
    hash: String,
    resolved: ResolvedType,
    plan: TypePlan,
    has_header: bool,
    has_stamp: bool,
}

/// Error of using a definition as a message type.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::RosType;
/// use wrapyfi_interfaces::store::TypeStore;
/// let service = TypeStore::generated().resolve_name("std_srvs/srv/SetBool")?;
/// let error = RosType::new(&service).unwrap_err().to_string();
/// assert_eq!(error, "std_srvs/srv/SetBool is no message: write it as package/msg/Type");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{0}")]
pub struct RosTypeError(pub(super) String);

/// Types that the process knows by their hash, which is one of the name too.
pub(super) type Interned<T> = Mutex<BTreeMap<String, &'static T>>;

/// Finds the type of a definition, or enters the one that `make` makes.
pub(super) fn intern<T>(
    types: &Interned<T>,
    resolved: &ResolvedType,
    make: impl FnOnce(&str) -> Result<T, RosTypeError>,
) -> Result<&'static T, RosTypeError> {
    // No code under the lock panics half-way, so a poisoned map is complete.
    let mut types = types.lock().unwrap_or_else(PoisonError::into_inner);
    let (name, hash) = (resolved.name().to_string(), resolved.type_hash());
    if let Some(known) = types.get(&hash) {
        return Ok(known);
    }
    if types.len() >= MAX_ROS_TYPES {
        return Err(RosTypeError(format!(
            "{name} is not taken in: this process knows {MAX_ROS_TYPES} types already; start another \
             one for it"
        )));
    }
    let known: &T = Box::leak(Box::new(make(&name)?));
    types.insert(hash, known);
    Ok(known)
}

/// Definition of a generated type.
pub(super) fn defined(name: &str, mut store: TypeStore) -> Result<ResolvedType, RosTypeError> {
    let found = store.resolve_name(name);
    found.map_err(|fault| RosTypeError(format!("{name} cannot be used: {fault}")))
}

static TYPES: Interned<Known> = Mutex::new(BTreeMap::new());

impl RosType {
    /// The type of this name and hash, where the process knows it already.
    pub fn known(name: &str, hash: &str) -> Option<Self> {
        let types = TYPES.lock().unwrap_or_else(PoisonError::into_inner);
        types.get(hash).filter(|known| known.name == name).map(|known| Self(known))
    }

    /// Enters the type of a definition; the same definition gives the same type.
    ///
    /// # Errors
    /// When the definition is no message or cannot be compiled, or [`MAX_ROS_TYPES`] are known.
    pub fn new(resolved: &ResolvedType) -> Result<Self, RosTypeError> {
        // Parts of services and actions are messages: requests, goals, events.
        let (kind, file) = (resolved.name().kind(), resolved.name().file_stem());
        if kind != InterfaceKind::Message && file == resolved.name().name() {
            let name = resolved.name();
            return Err(RosTypeError(format!(
                "{name} is no message: write it as package/msg/Type"
            )));
        }
        let known = intern(&TYPES, resolved, |name| {
            let plan = resolved.plan();
            let plan =
                plan.map_err(|fault| RosTypeError(format!("{name} cannot be used: {fault}")))?;
            let defaults = plan.default_message();
            let has_header = defaults.get("header.stamp.nanosec").is_some()
                && defaults.get("header.frame_id").is_some();
            let has_stamp = defaults.get("stamp.nanosec").is_some();
            Ok(Known {
                name: name.to_owned(),
                hash: resolved.type_hash(),
                resolved: resolved.clone(),
                plan,
                has_header,
                has_stamp,
            })
        });
        known.map(Self)
    }

    /// Type of a generated message.
    ///
    /// ```
    /// # mod wrapyfi_core { pub use wrapyfi_data::types; }
    /// use wrapyfi_core::types::{MessageType, RosType};
    /// use wrapyfi_interfaces::geometry_msgs::msg::Twist;
    /// let kind = MessageType::Ros(RosType::of::<Twist>()?);
    /// assert_eq!(kind.to_string(), "geometry_msgs/msg/Twist");
    /// # Ok::<(), wrapyfi_data::types::RosTypeError>(())
    /// ```
    ///
    /// # Errors
    /// When the definition cannot be compiled, or [`MAX_ROS_TYPES`] are known.
    pub fn of<M: Message>() -> Result<Self, RosTypeError> {
        Self::generated(GeneratedType::of::<M>())
    }

    /// As [`RosType::of`], of a type that is a value.
    ///
    /// # Errors
    /// As there.
    pub fn generated(of: GeneratedType) -> Result<Self, RosTypeError> {
        match of.hash.and_then(|hash| Self::known(of.name, hash)) {
            Some(known) => Ok(known),
            None => Self::new(&defined(of.name, of.types())?),
        }
    }

    /// ROS name, for instance `sensor_msgs/msg/JointState`.
    pub fn name(self) -> &'static str {
        &self.0.name
    }

    /// REP-2016 hash, `RIHS01_…`.
    pub fn type_hash(self) -> &'static str {
        &self.0.hash
    }

    /// Definition of the type, with the definitions that it refers to.
    pub fn resolved(self) -> &'static ResolvedType {
        &self.0.resolved
    }

    /// True when messages of the type have a field `header` of type `std_msgs/msg/Header`.
    pub fn has_header(self) -> bool {
        self.0.has_header
    }

    /// True when messages of the type have a field `stamp` of type `builtin_interfaces/msg/Time`.
    pub fn has_stamp(self) -> bool {
        self.0.has_stamp
    }

    /// Layout by which messages of the type are read and written.
    pub fn plan(self) -> &'static TypePlan {
        &self.0.plan
    }
}

/// Makes a type that is a place in a table: two are the same where the place is.
macro_rules! interned {
    ($interned:ident) => {
        impl PartialEq for $interned {
            fn eq(&self, other: &Self) -> bool {
                std::ptr::eq(self.0, other.0)
            }
        }

        impl Eq for $interned {}

        impl std::hash::Hash for $interned {
            fn hash<H: std::hash::Hasher>(&self, state: &mut H) {
                self.0.name.hash(state);
            }
        }

        impl std::fmt::Debug for $interned {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.debug_tuple(stringify!($interned)).field(&self.0.name).finish()
            }
        }

        impl std::fmt::Display for $interned {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str(&self.0.name)
            }
        }
    };
}
pub(super) use interned;

interned!(RosType);

#[cfg(test)]
mod tests {
    use wrapyfi_interfaces::parser::{Dialect, TypeName};
    use wrapyfi_interfaces::store::TypeStore;

    use super::*;

    #[test]
    fn one_definition_is_one_type_and_another_is_another() {
        let resolve = |text: &str| {
            let name = TypeName::parse(Dialect::Ros2, "demo/msg/Pair").unwrap();
            RosType::new(&ResolvedType::from_text(Dialect::Ros2, &name, text).unwrap()).unwrap()
        };
        let (a, again, other) =
            (resolve("int32 a\n"), resolve("int32 a # the first\n"), resolve("int64 a\n"));
        assert_eq!(a, again);
        assert_ne!(a, other);
        assert_eq!((a.name(), other.name()), ("demo/msg/Pair", "demo/msg/Pair"));
        assert_ne!(a.type_hash(), other.type_hash());
    }

    #[test]
    fn types_that_are_generated_are_known() {
        let mut store = TypeStore::generated();
        let image = store.resolve_name("sensor_msgs/msg/Image").unwrap();
        let image = RosType::new(&image).unwrap();
        assert_eq!(image.plan().type_name(), image.name());
        assert_eq!(image.to_string(), "sensor_msgs/msg/Image");
        RosType::new(&store.resolve_name("std_srvs/srv/SetBool_Request").unwrap()).unwrap();
        let service = store.resolve_name("std_srvs/srv/SetBool").unwrap();
        let told = RosType::new(&service).unwrap_err().to_string();
        assert_eq!(told, "std_srvs/srv/SetBool is no message: write it as package/msg/Type");
    }
}
