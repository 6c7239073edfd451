//! Types of ROS 1 topics, services and actions, as routes between middlewares need them: in ROS 2's terms.
//!
//! ```text
//!   demo/Pose ─ definition: shown by its publisher (peer_types), else known ─▶ demo/msg/Pose
//! ```
//!
//! A definition from a folder may be older than the one that is published.

use std::sync::Arc;

use wrapyfi_interfaces::parser::TypeName;
use wrapyfi_interfaces::store::{ResolveError, TypeStore};

use super::config::NAME;
use super::core::Core;
use super::discovery::action_type;
use super::node_parameters;
use super::peer_types::{TypeInfo, TypeQuestion, Unanswered, ask};
use super::services::known;
use wrapyfi_data::types::{RosAction, RosService, RosType, ServiceKind};
use wrapyfi_endpoint::{Discovered, LearnError, LearnResult, Learned, Role};

fn undefined(type_name: &str, reason: &dyn std::fmt::Display) -> LearnError {
    LearnError::Undefined { type_name: type_name.to_owned(), reason: reason.to_string() }
}

/// Type and latching that the node at the other end has told of this topic or service.
fn type_info(core: &Arc<Core>, found: &Discovered) -> LearnResult<TypeInfo> {
    let name = found.name.clone();
    let Some(node) = &found.node else {
        return Err(LearnError::Untold(NAME.to_owned()));
    };
    match ask(core, found.role, &found.name, node) {
        TypeQuestion::Known(told) => Ok(told),
        TypeQuestion::Asked => Err(LearnError::Asked(name)),
        TypeQuestion::Failed(Unanswered::Away(reason), _) => {
            Err(LearnError::Silent { name, reason: format!("{node}: {reason}") })
        }
        TypeQuestion::Failed(Unanswered::Unreadable(told, reason), _) => {
            let announced = found.type_name.clone();
            let type_name = told.or(announced).unwrap_or_else(|| format!("the type of {name}"));
            Err(undefined(&type_name, &format!("{node}: {reason}")))
        }
    }
}

/// True when a publisher latches, which only its own header tells; `None` while it has not told
/// yet.
pub(super) fn latches(core: &Arc<Core>, found: &Discovered) -> Option<bool> {
    if node_parameters::is_answered_here(found) {
        return Some(false);
    }
    type_info(core, found).ok().map(|told| told.latches)
}

/// Name of the type that the node at the other end has told, as ROS 1 writes it.
pub(super) fn told_type(core: &Arc<Core>, found: &Discovered) -> Option<String> {
    type_info(core, found).ok().map(|told| told.type_name)
}

/// The ROS 2 type of a topic.
pub(super) fn topic(
    core: &Arc<Core>,
    found: &Discovered,
    store: &mut TypeStore,
) -> LearnResult<Learned> {
    if node_parameters::is_answered_here(found) {
        let events = node_parameters::event_type();
        return events.map(Learned::Ros).map_err(|error| undefined(&found.name, &error));
    }
    let announced = found.type_name.clone().filter(|name| name != "*");
    // A subscriber cannot be asked.
    let told = (found.role == Role::Publisher).then(|| type_info(core, found));
    let mut shown = None;
    let (type_name, silent) = match (told, announced) {
        (Some(Ok(told)), _) => {
            shown = told.definition;
            (told.type_name, None)
        }
        (Some(Err(error @ LearnError::Asked(_))), _) | (Some(Err(error)), None) => {
            return Err(error);
        }
        (None, None) => return Err(LearnError::Untold(NAME.to_owned())),
        (silent, Some(name)) => (name, silent.and_then(Result::err)),
    };
    let mut types = core.types();
    let definition = match shown {
        Some(shown) => shown,
        None => types
            .definition(&type_name)
            .map(Arc::new)
            .map_err(|error| silent.unwrap_or_else(|| undefined(&type_name, &error)))?,
    };
    let names = types.rules().ros2_names(definition.name());
    let resolved = match names.iter().find_map(|name| store.resolve_defined(name).ok()) {
        Some(resolved) => resolved,
        None => {
            types.ros2_type(&definition.resolved).map_err(|error| undefined(&type_name, &error))?
        }
    };
    RosType::new(&resolved).map(Learned::Ros).map_err(|error| undefined(&type_name, &error))
}

/// The ROS 2 type of a service, or the function of Wrapyfi that it is.
pub(super) fn service(
    core: &Arc<Core>,
    found: &Discovered,
    store: &mut TypeStore,
) -> LearnResult<ServiceKind> {
    let here = found.type_name.as_deref().and_then(node_parameters::service_kind);
    if let Some(kind) = here {
        return kind.map(ServiceKind::Ros).map_err(|error| undefined(&found.name, &error));
    }
    let TypeInfo { type_name, md5sum, .. } = type_info(core, found)?;
    let kinds = [ServiceKind::NativeObject, ServiceKind::Image, ServiceKind::AudioChunk];
    if let Some(kind) = kinds.into_iter().find(|kind| known(*kind).name == type_name) {
        return Ok(kind);
    }
    let mut types = core.types();
    let names =
        types.ros2_service_names(&type_name).map_err(|error| undefined(&type_name, &error))?;
    let made = types.ros2_service(&type_name, md5sum.as_deref());
    // A folder may have the service, and a publisher show the types inside.
    let mut part = |name: &TypeName| {
        let of_server = made.as_ref().ok().and_then(|made| made.definitions().get(name)).cloned();
        of_server.or_else(|| types.ros2_type_named(name).ok()?.definition().cloned())
    };
    let mut lacking = None;
    let known = names.iter().find_map(|name| match store.resolve_with(name, &mut part) {
        Ok(found) => Some(found),
        Err(ResolveError::NotFound { name: missing, .. }) if missing == *name => None,
        Err(error) => {
            lacking.get_or_insert(error);
            None
        }
    });
    let resolved = match (known, lacking) {
        (Some(resolved), _) => resolved,
        (None, lacking) => made.map_err(|error| match lacking {
            Some(lacking) => undefined(&type_name, &lacking),
            None => undefined(&type_name, &error),
        })?,
    };
    RosService::new(&resolved).map(ServiceKind::Ros).map_err(|error| undefined(&type_name, &error))
}

/// The ROS 2 type of an action. Its server shows the definitions of results and feedback, and a client that of goals;
/// what nobody shows is looked for among those that are known.
pub(super) fn action(
    core: &Arc<Core>,
    found: &Discovered,
    store: &mut TypeStore,
) -> LearnResult<RosAction> {
    let part = |word: &str, node: Option<String>| {
        let name = format!("{}/{word}", found.name);
        type_info(core, &Discovered { node, ..Discovered::new(name, Role::Publisher) })
    };
    let client = core.action_clients.lock().get(&found.name).cloned();
    // All are asked at once.
    let goal = client.map(|client| part("goal", Some(client)));
    let feedback = part("feedback", found.node.clone());
    let (result, feedback) = (part("result", found.node.clone())?, feedback?);
    let goal = match goal {
        Some(Err(asked @ LearnError::Asked(_))) => return Err(asked),
        goal => goal.and_then(Result::ok),
    };
    let type_name = action_type(&result.type_name).ok_or_else(|| {
        let reason = "it is no result of an action (package/NameActionResult)";
        undefined(&result.type_name, &reason)
    })?;
    let told = [goal.as_ref(), Some(&result), Some(&feedback)].into_iter().flatten();
    let shown: Vec<_> = told.filter_map(|told| told.definition.as_deref()).collect();
    let mut types = core.types();
    let names = types.ros2_action_names(type_name).map_err(|error| undefined(type_name, &error))?;
    let known = names.iter().find_map(|name| store.resolve_defined(name).ok());
    let resolved = match known {
        Some(resolved) => resolved,
        None => {
            types.ros2_action(type_name, &shown).map_err(|error| undefined(type_name, &error))?
        }
    };
    RosAction::new(&resolved).map_err(|error| undefined(type_name, &error))
}
