//! A ROS 2 service type known at run time, as small as a name.

use std::collections::BTreeMap;
use std::sync::Mutex;

use wrapyfi_interfaces::store::ResolvedType;

use super::ros_type::{Interned, RosType, RosTypeError, intern, interned};

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

impl RosService {
    /// Enters the service of a definition; the same definition gives the same service.
    ///
    /// # Errors
    /// When the definition is no service, its parts cannot be compiled, or [`super::MAX_ROS_TYPES`]
    /// are known.
    pub fn new(resolved: &ResolvedType) -> Result<Self, RosTypeError> {
        static SERVICES: Interned<Known> = Mutex::new(BTreeMap::new());
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
        assert_eq!(a.response().plan().type_name(), "std_srvs/srv/Trigger_Response");
    }
}
