//! Types of routes that no place of definitions has, asked from those who publish them on ROS 1.

use std::time::{Duration, Instant};

use wrapyfi_core::engine::Config;
use wrapyfi_core::middleware::ros1;
use wrapyfi_core::types::MessageType;
use wrapyfi_interfaces::parser::{Dialect, TypeName};
use wrapyfi_interfaces::store::TypeStore;

use super::load::Endpoints;
use crate::exit::Failure;

/// How long publishers have to show the types, all together.
const LEARNING: Duration = Duration::from_secs(5);

/// Adds to `types` what publishers show of the types that routes from ROS 1 name and `types` lacks.
///
/// # Errors
/// Exit code 1 when ROS 1 does not start. A publisher that is not there is only said.
pub(super) fn from_publishers(
    config: &Config<Endpoints>,
    types: &mut TypeStore,
) -> Result<(), Failure> {
    let mut node = None;
    let begin = Instant::now();
    for entry in &config.routes {
        let route = &entry.value;
        let Some((ros1::NAME, topic)) =
            route.from.as_ref().and_then(|from| from.value.split_once(':'))
        else {
            continue;
        };
        let Some(wanted) = route.from_type.as_ref().or(route.message_type.as_ref()) else {
            continue;
        };
        if MessageType::resolve(&wanted.value, types).is_ok() {
            continue;
        }
        let Ok(name) = TypeName::parse(Dialect::Ros2, &wanted.value) else { continue };
        let ros1 = match &mut node {
            Some(ros1) => ros1,
            none => match config.endpoints.ros.start(&config.endpoints.hosts) {
                Ok(started) => none.insert(started),
                Err(refused @ Failure::Usage(_)) => return Err(refused),
                // Its routes wait; what they carry is said to be unknown below.
                Err(absent) => {
                    tracing::warn!("{name} cannot be asked from its publishers: {absent}");
                    continue;
                }
            },
        };
        match ros1.learn(topic, &name, LEARNING.saturating_sub(begin.elapsed())) {
            Ok(found) => {
                tracing::info!("{name} is what a publisher of ros:{topic} shows");
                types.add_resolved(&found);
            }
            Err(error) => tracing::warn!("{error}"),
        }
    }
    Ok(())
}
