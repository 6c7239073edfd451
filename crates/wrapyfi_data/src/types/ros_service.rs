//! A ROS 2 service type known at run time, as small as a name.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use wrapyfi_interfaces::store::ResolvedType;
use wrapyfi_interfaces::{Message as _, Service};

use super::ros_type::{Interned, RosType, RosTypeError, defined, intern, interned};

/// A ROS 2 service type with its request and its response, kept as [`RosType`] is.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::RosService;
/// use wrapyfi_interfaces::store::TypeStore;
///
/// let mut store = TypeStore::generated();
/// let light = RosService::new(&store.resolve_name("std_srvs/srv/SetBool")?)?;
/// assert_eq!(light.request().name(), "std_srvs/srv/SetBool_Request");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy)]
pub struct RosService(&'static Known);

struct Known {
    name: String,
    resolved: ResolvedType,
    request: RosType,
    response: RosType,
}

static SERVICES: Interned<Known> = Mutex::new(BTreeMap::new());

impl RosService {
    /// The service of this name, where the process knows it already. The hash is that of the service or of its request:
    /// DDS shows the latter.
    pub fn known(name: &str, hash: &str) -> Option<Self> {
        let services = SERVICES.lock().unwrap_or_else(PoisonError::into_inner);
        let is_meant = |(own, known): &(&String, &&'static Known)| {
            known.name == name && [own.as_str(), known.request.type_hash()].contains(&hash)
        };
        services.iter().find(is_meant).map(|(_, known)| Self(known))
    }

    /// Enters the service of a definition; the same definition gives the same service.
    ///
    /// # Errors
    /// When the definition is no service, its parts cannot be compiled, or [`super::MAX_ROS_TYPES`]
    /// are known.
    pub fn new(resolved: &ResolvedType) -> Result<Self, RosTypeError> {
        let known = intern(&SERVICES, resolved, |name| {
            let part = |suffix: &str| match resolved.part(suffix) {
                Some(part) => RosType::new(&part),
                None => {
                    Err(RosTypeError(format!("{name} is no service: write it as package/srv/Type")))
                }
            };
            let (request, response) = (part("_Request")?, part("_Response")?);
            Ok(Known { name: name.to_owned(), resolved: resolved.clone(), request, response })
        });
        known.map(Self)
    }

    /// Type of a generated service.
    ///
    /// # Errors
    /// When its definition cannot be compiled, or [`super::MAX_ROS_TYPES`] are known.
    pub fn of<S: Service>() -> Result<Self, RosTypeError> {
        match Self::known(S::ROS_TYPE, S::TYPE_HASH) {
            Some(known) => Ok(known),
            None => Self::new(&defined(S::ROS_TYPE, S::Request::types())?),
        }
    }

    /// The service that takes a `request` and gives a `response`, which the definition has as parts.
    pub(super) fn of_parts(resolved: &ResolvedType, request: RosType, response: RosType) -> Self {
        let (name, resolved) = (resolved.name().to_string(), resolved.clone());
        Self(Box::leak(Box::new(Known { name, resolved, request, response })))
    }

    /// ROS name, for instance `std_srvs/srv/SetBool`.
    pub fn name(self) -> &'static str {
        &self.0.name
    }

    /// Definition of the service, with the definitions that it refers to.
    pub fn resolved(self) -> &'static ResolvedType {
        &self.0.resolved
    }

    /// Type of requests.
    pub fn request(self) -> RosType {
        self.0.request
    }

    /// Type of replies.
    pub fn response(self) -> RosType {
        self.0.response
    }
}

interned!(RosService);

#[cfg(test)]
mod tests {
    use wrapyfi_interfaces::store::TypeStore;

    use super::*;

    #[test]
    fn a_message_is_no_service() {
        let mut store = TypeStore::generated();
        let header = store.resolve_name("std_msgs/msg/Header").unwrap();
        let error = RosService::new(&header).unwrap_err().to_string();
        assert!(error.contains("std_msgs/msg/Header is no service"), "{error}");
        let trigger = store.resolve_name("std_srvs/srv/Trigger").unwrap();
        let (a, b) = (RosService::new(&trigger).unwrap(), RosService::new(&trigger).unwrap());
        assert_eq!(a, b);
        for hash in [trigger.type_hash().as_str(), a.request().type_hash()] {
            assert_eq!(RosService::known("std_srvs/srv/Trigger", hash), Some(a));
        }
        assert_eq!(RosService::known("std_srvs/srv/Trigger", a.response().type_hash()), None);
        assert_eq!(a.response().plan().type_name(), "std_srvs/srv/Trigger_Response");
    }
}
