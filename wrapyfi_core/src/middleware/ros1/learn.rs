//! Types of ROS 1 topics and services, as routes between middlewares need them: in ROS 2's terms.
//!
//! ```text
//!   demo/Pose ─ definition: known, else shown by its publisher (probe) ─▶ demo/msg/Pose
//! ```

use std::sync::Arc;

use wrapyfi_interfaces::ros1::DefinitionError;
use wrapyfi_interfaces::store::TypeStore;

use super::NAME;
use super::core::Core;
use super::probe::{Answer, ask};
use crate::endpoint::{Discovered, LearnError, Learned, Role};
use crate::types::{RosService, RosType, ServiceKind};

fn undefined(type_name: &str, reason: &dyn std::fmt::Display) -> LearnError {
    LearnError::Undefined { type_name: type_name.to_owned(), reason: reason.to_string() }
}

/// What the node at the other end says, where it has said it.
fn told(core: &Arc<Core>, found: &Discovered) -> Result<String, LearnError> {
    let name = found.name.clone();
    let Some(node) = &found.node else {
        return Err(LearnError::Untold { middleware: NAME.to_owned() });
    };
    match ask(core, found.role, &found.name, node) {
        Answer::Told { type_name, .. } => Ok(type_name),
        Answer::Asked => Err(LearnError::Asked { name }),
        Answer::Failed(reason, _) => {
            Err(LearnError::Silent { name, reason: format!("{node}: {reason}") })
        }
    }
}

/// Whether a publisher latches, which only its own header tells; `None` where it is being asked. One that
/// cannot be reached keeps nothing for anybody.
pub(super) fn latches(core: &Arc<Core>, found: &Discovered) -> Option<bool> {
    let Some(node) = &found.node else { return Some(false) };
    match ask(core, Role::Publisher, &found.name, node) {
        Answer::Told { latches, .. } => Some(latches),
        Answer::Asked => None,
        Answer::Failed(..) => Some(false),
    }
}

/// The ROS 2 type of a topic.
pub(super) fn topic(
    core: &Arc<Core>,
    found: &Discovered,
    store: &mut TypeStore,
) -> Result<Learned, LearnError> {
    let announced = found.type_name.as_deref().filter(|name| *name != "*");
    let mut shown = false;
    let type_name = match announced {
        Some(name) => name.to_owned(),
        // A subscriber cannot be asked.
        None if found.role != Role::Publisher => {
            return Err(LearnError::Untold { middleware: NAME.to_owned() });
        }
        None => {
            shown = true;
            told(core, found)?
        }
    };
    let known = core.types().definition(&type_name);
    let definition = match known {
        Err(DefinitionError::Unknown { .. }) if found.role == Role::Publisher && !shown => {
            told(core, found)?;
            core.types().definition(&type_name)
        }
        known => known,
    };
    let definition = definition.map_err(|error| undefined(&type_name, &error))?;
    let mut types = core.types();
    let names = types.rules().ros2_names(definition.name());
    let resolved = match names.iter().find_map(|name| store.resolve(name).ok()) {
        Some(resolved) => resolved,
        None => {
            types.ros2_type(definition.resolved()).map_err(|error| undefined(&type_name, &error))?
        }
    };
    RosType::new(&resolved).map(Learned::Ros).map_err(|error| undefined(&type_name, &error))
}

/// The ROS 2 type of a service, or the function of Wrapyfi that it is.
pub(super) fn service(
    core: &Arc<Core>,
    found: &Discovered,
    store: &mut TypeStore,
) -> Result<ServiceKind, LearnError> {
    let type_name = told(core, found)?;
    match type_name.as_str() {
        "wrapyfi_services/ROSNativeObject" => return Ok(ServiceKind::NativeObject),
        "wrapyfi_services/ROSImage" => return Ok(ServiceKind::Image),
        "wrapyfi_ros_interfaces/ROSAudioService" => return Ok(ServiceKind::AudioChunk),
        _ => {}
    }
    let mut types = core.types();
    let definition =
        types.service_definition(&type_name).map_err(|error| undefined(&type_name, &error))?;
    let names = types.rules().ros2_names(definition.name());
    let resolved = match names.iter().find_map(|name| store.resolve(name).ok()) {
        Some(resolved) => resolved,
        None => types.ros2_service(&type_name).map_err(|error| undefined(&type_name, &error))?,
    };
    RosService::new(&resolved).map(ServiceKind::Ros).map_err(|error| undefined(&type_name, &error))
}
