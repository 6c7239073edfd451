//! Structs of the crates that `rosidl_generator_rs` writes, as messages of endpoints and of registered methods.
//!
//! ```text
//!   wrapyfi_msgs::msg::Tensor ── name, hash ─▶ definition (ament index) ─▶ RosType
//!     │    ▲
//!     │    └─ read ── rmw_deserialize ── RosMessage ◀─ listener, client, server
//!     └── message ─── rmw_serialize ───▶ RosMessage ─▶ publisher, client, server
//! ```
//!
//! A colcon workspace that has the generator gives every interface package a crate of its name, which nodes on `rclrs` use
//! too. Its structs need no others beside them:
//!
//! ```ignore
//! use wrapyfi_core::communicator::communicator;
//! use wrapyfi_core::rosidl::{self, Rosidl};
//! use wrapyfi_msgs::{msg::Tensor, srv::Explain};
//!
//! #[communicator]
//! impl Arm {
//!     #[register(RosMessage, "ros2", "/arm/joints")]
//!     fn joints(&self) -> Rosidl<Tensor> {
//!         Rosidl(Tensor { shape: vec![7], ..Tensor::default() })
//!     }
//! }
//!
//! let spec = ServiceSpec::new("/bridge/explain", ServiceKind::Ros(rosidl::service::<Explain>()?));
//! let request = Request::Message(rosidl::message(&Explain_Request { name: "/arm/joints".into() })?);
//! ```
//!
//! The rmw of the ROS 2 that is sourced turns them into bytes, in bulk where arrays are: the program is built with it.

use std::any::TypeId;
use std::collections::HashMap;
use std::ops::{Deref, DerefMut};
use std::sync::{LazyLock, Mutex, PoisonError};

use wrapyfi_data::returned::{PayloadError, Returned, kind};
use wrapyfi_data::types::{
    Payload, ReadError, RosAction, RosMessage, RosService, RosType, RosTypeError,
};
use wrapyfi_interfaces::GeneratedType;
use wrapyfi_interfaces::store::{ResolveError, ResolvedType, TypeStore};
use wrapyfi_rmw::Fault;
pub use wrapyfi_rmw::rosidl::{Action, Message, RmwMessage, Service};
use wrapyfi_rmw::rosidl::{deserialize, serialize, type_hash};

use crate::rmw_hashes::hash_to_text;

/// A struct of `rosidl_generator_rs` that a registered method returns.
///
/// Its fields are there as if it were the struct itself.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Rosidl<M>(pub M);

/// Error of using a struct of `rosidl_generator_rs`.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RosidlError {
    /// The definition is not installed, or cannot be read.
    #[error(transparent)]
    Definition(#[from] Box<ResolveError>),
    /// The definition cannot be used.
    #[error(transparent)]
    Type(#[from] RosTypeError),
    /// The crate was generated from another definition than the one that is installed.
    #[error(
        "the crate of {name} was generated from a definition of hash {built}, and {installed} is installed: build its \
         package and this program again"
    )]
    Hash {
        /// Name of the type.
        name: &'static str,
        /// Hash in the crate.
        built: String,
        /// Hash of the definition that the ament index has.
        installed: &'static str,
    },
    /// The struct is no part of a service or an action.
    #[error("{name} is not named {suffix}: it is no part of {whole}")]
    Part {
        /// Name of the type.
        name: &'static str,
        /// Ending that its name must have.
        suffix: &'static str,
        /// `a service` or `an action`.
        whole: &'static str,
    },
    /// A message is of another type, or no message of it.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// rmw refuses to write or to read it.
    #[error("{name}: {fault}")]
    Rmw {
        /// Name of the type.
        name: &'static str,
        /// Reason that rmw gave.
        fault: Fault,
    },
}

impl<M> Deref for Rosidl<M> {
    type Target = M;

    fn deref(&self) -> &M {
        &self.0
    }
}

impl<M> DerefMut for Rosidl<M> {
    fn deref_mut(&mut self) -> &mut M {
        &mut self.0
    }
}

impl<M> From<M> for Rosidl<M> {
    fn from(message: M) -> Self {
        Self(message)
    }
}

impl<M: Message> Returned<kind::RosMessage> for Rosidl<M> {
    const ROS_TYPE: Option<GeneratedType> =
        Some(GeneratedType::foreign(M::RmwMsg::TYPE_NAME, definitions));

    fn to_payload(&self) -> Result<Option<Payload>, PayloadError> {
        Ok(Some(message(&self.0)?.into()))
    }

    fn from_payload(payload: Payload) -> Result<Self, PayloadError> {
        let found = <RosMessage as Returned<kind::RosMessage>>::from_payload(payload)?;
        Ok(Self(read(&found)?))
    }
}

impl From<RosidlError> for PayloadError {
    fn from(error: RosidlError) -> Self {
        Self::Foreign(error.to_string())
    }
}

/// Definitions that are installed beside the crates.
fn definitions() -> TypeStore {
    TypeStore::from_environment().or_generated()
}

fn definition(name: &str) -> Result<ResolvedType, RosidlError> {
    Ok(definitions().resolve_name(name).map_err(Box::new)?)
}

/// Types of the structs that were used.
static TYPES: LazyLock<Mutex<HashMap<TypeId, RosType>>> = LazyLock::new(Mutex::default);

/// Type of a message.
///
/// # Errors
/// When its definition is not installed, or is not the one that the crate was generated from.
pub fn ros_type<M: Message>() -> Result<RosType, RosidlError> {
    let (id, name) = (TypeId::of::<M::RmwMsg>(), M::RmwMsg::TYPE_NAME);
    // What is in the map is whole, so that a panic elsewhere does no harm.
    if let Some(known) = TYPES.lock().unwrap_or_else(PoisonError::into_inner).get(&id) {
        return Ok(*known);
    }
    let found = RosType::new(&definition(name)?)?;
    let built = type_hash::<M>().map_err(|fault| RosidlError::Rmw { name, fault })?;
    let (built, installed) = (hash_to_text(&built), found.type_hash());
    if built != installed {
        return Err(RosidlError::Hash { name, built, installed });
    }
    TYPES.lock().unwrap_or_else(PoisonError::into_inner).insert(id, found);
    Ok(found)
}

/// Type of a service.
///
/// # Errors
/// As [`ros_type`], of its request and its response.
pub fn service<S: Service>() -> Result<RosService, RosidlError> {
    ros_type::<S::Request>()?;
    ros_type::<S::Response>()?;
    let whole = whole::<S::Request>("_Request", "a service")?;
    Ok(RosService::new(&definition(whole)?)?)
}

/// Type of an action.
///
/// # Errors
/// As [`ros_type`], of its goal, its result and its feedback.
pub fn action<A: Action>() -> Result<RosAction, RosidlError> {
    ros_type::<A::Goal>()?;
    ros_type::<A::Result>()?;
    ros_type::<A::Feedback>()?;
    Ok(RosAction::new(&definition(whole::<A::Goal>("_Goal", "an action")?)?)?)
}

/// Name of the service or the action that a message is a part of.
fn whole<M: Message>(
    suffix: &'static str,
    whole: &'static str,
) -> Result<&'static str, RosidlError> {
    let name = M::RmwMsg::TYPE_NAME;
    name.strip_suffix(suffix).ok_or(RosidlError::Part { name, suffix, whole })
}

/// Message of a struct.
///
/// # Errors
/// As [`ros_type`], and when rmw refuses.
pub fn message<M: Message>(message: &M) -> Result<RosMessage, RosidlError> {
    let ros_type = ros_type::<M>()?;
    let name = M::RmwMsg::TYPE_NAME;
    let cdr = serialize(message).map_err(|fault| RosidlError::Rmw { name, fault })?;
    Ok(RosMessage::new(ros_type, cdr))
}

/// Struct of a message. Middlewares have checked its size.
///
/// # Errors
/// As [`ros_type`], when the message is of another type, or no message of it, and when rmw refuses.
pub fn read<M: Message>(message: &RosMessage) -> Result<M, RosidlError> {
    let (expected, actual) = (ros_type::<M>()?, message.ros_type);
    if expected != actual {
        let told = |of: RosType| format!("{} ({})", of.name(), of.type_hash());
        return Err(ReadError::Type { expected: told(expected), actual: told(actual) }.into());
    }
    // A middleware allocates what lengths in the bytes say; this compares them with what is there.
    message.fields(message.cdr.len()).map_err(ReadError::Cdr)?;
    let name = M::RmwMsg::TYPE_NAME;
    deserialize(&message.cdr).map_err(|fault| RosidlError::Rmw { name, fault })
}
