//! Types that no program has named, or no place of definitions has: told by those who publish.
//!
//! ```text
//!   route from ros, type demo/msg/Pose   ┐
//!   wrapyfi echo ros:/pose               ┴─▶ discovery ─▶ Middleware::learn_topic, until it knows
//! ```

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use wrapyfi_data::types::{Map, MessageType, Payload, RosService, ServiceKind, Value};
use wrapyfi_endpoint::{
    Cause, Context, DiscoverError, Discovered, LearnError, Learned, Middleware, Request, Role,
    ServiceSpec,
};
use wrapyfi_engine::{RouteConfig, Spanned};
use wrapyfi_interfaces::Message as _;
use wrapyfi_interfaces::parser::{Dialect, TypeName};
use wrapyfi_interfaces::store::{ResolvedType, TypeStore};
use wrapyfi_interfaces::type_description_interfaces::srv::{
    GetTypeDescription, GetTypeDescription_Response,
};
use wrapyfi_node::type_description::TypeDescriptions;
use wrapyfi_ros1::{self as ros1, Ros1};

use super::endpoints::{Endpoints, of_start};
use crate::exit::{Failure, Result};

/// Pause between two looks.
const LOOK: Duration = Duration::from_millis(20);
/// Time that publishers have to show the types, all together.
const LEARNING: Duration = Duration::from_secs(5);

/// Adds to `types` what publishers show of the types that routes from ROS 1 name and `types` lacks.
///
/// # Errors
/// Exit code 1 when ROS 1 does not start. A publisher that is not there is only said.
pub(super) fn from_publishers(
    endpoints: &Endpoints,
    routes: &[Spanned<RouteConfig>],
    types: &mut TypeStore,
) -> Result<()> {
    let mut node = None;
    let begin = Instant::now();
    for entry in routes {
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
            none => match observe_ros1(endpoints) {
                Ok(started) => none.insert(started),
                Err(refused @ Failure::Usage(_)) => return Err(refused),
                // Its routes wait; what they carry is said to be unknown below.
                Err(absent) => {
                    tracing::warn!("{name} cannot be asked from its publishers: {absent}");
                    continue;
                }
            },
        };
        let end = begin + LEARNING;
        // Of several publishers one may show another type.
        let named = |_learned| {
            ros1.type_named(&name).map_err(|error| LearnError::Undefined {
                type_name: name.to_string(),
                reason: error.to_string(),
            })
        };
        match of_topic(ros1, topic, types, |_| Instant::now() >= end, named) {
            Ok(found) => {
                tracing::info!("{name} is what a publisher of ros:{topic} shows");
                types.add_resolved(&found);
            }
            Err(error) => tracing::warn!(
                "no publisher of ros:{topic} showed a definition of {name} within {} ms: {error}; \
                 start the publisher first, or give a folder with the definition",
                LEARNING.as_millis()
            ),
        }
    }
    Ok(())
}

/// A nameless node of ROS 1 that looks and asks.
///
/// # Errors
/// Exit code 2 for settings that cannot work, 1 when it does not start.
pub(super) fn observe_ros1(endpoints: &Endpoints) -> Result<Ros1> {
    let section = endpoints.section(ros1::NAME)?;
    ros1::observe(section, &endpoints.hosts).map_err(|error| of_start(ros1::NAME, error))
}

/// Most bytes of the description of a type.
const MAX_DESCRIPTION_BYTES: usize = 4 << 20;
/// Time that a node has to describe a type.
const DESCRIBED_WITHIN: Duration = Duration::from_secs(2);

/// Error of learning the type of a topic.
#[derive(Debug, thiserror::Error)]
pub(crate) enum LearnTopicError {
    /// The middleware cannot be asked now; names what it waits for.
    #[error("{0}")]
    Away(Box<Cause>),
    /// The topic has no endpoint.
    #[error("nobody publishes it")]
    Nobody,
    /// An endpoint is there, and its type is not known.
    #[error(transparent)]
    Untold(#[from] LearnError),
    /// The middleware tells no endpoints.
    #[error(transparent)]
    Discover(#[from] DiscoverError),
}

/// Learns the type of a topic from its publishers, else from its listeners, and gives it to
/// `accept`. Looks again until they tell it, or until `is_over`, which is given the present reason
/// to wait after each look; blocks the caller.
///
/// # Errors
/// The last reason to wait; at once where the middleware tells no types.
pub(crate) fn of_topic<T>(
    middleware: &dyn Middleware,
    topic: &str,
    types: &mut TypeStore,
    mut is_over: impl FnMut(&LearnTopicError) -> bool,
    accept: impl Fn(Learned) -> Result<T, LearnError>,
) -> Result<T, LearnTopicError> {
    let name = format!("/{}", topic.trim_start_matches('/'));
    let mut discovery = middleware.discover_closely(Some(&name))?;
    let (mut last, mut asked) = (false, BTreeSet::new());
    loop {
        let mut why = discovery
            .waiting_for()
            .map_or(LearnTopicError::Nobody, |away| LearnTopicError::Away(Box::new(away)));
        let mut found = discovery.endpoints()?;
        found
            .retain(|one| one.name == name && matches!(one.role, Role::Publisher | Role::Listener));
        found.sort_by_key(|one| one.role);
        let mut errors = Vec::new();
        for one in &found {
            if let Err(LearnError::Undefined { .. }) = middleware.learn_topic(one, types)
                && asked.insert(one.node.clone())
            {
                described(middleware, one, types);
            }
            match middleware.learn_topic(one, types).and_then(&accept) {
                Ok(learned) => return Ok(learned),
                Err(error) => errors.push((one.role, error)),
            }
        }
        let is_never_told = is_never_told(&errors);
        if let Some(error) = most_telling(errors) {
            why = error.into();
        }
        if last || is_never_told {
            return Err(why);
        }
        // It looks once more when the time is over.
        last = is_over(&why);
        std::thread::sleep(if last { Duration::ZERO } else { LOOK });
    }
}

/// Adds the type of an endpoint to `types` as its node describes it: a bridge knows types that it has learned elsewhere.
/// Blocks for as long as that takes; nothing where the node does not say.
pub(crate) fn described(middleware: &dyn Middleware, one: &Discovered, types: &mut TypeStore) {
    match description_of(middleware, one) {
        Ok(described) => types.add_resolved(&described),
        Err(error) => tracing::debug!("a type is not described: {error:#}"),
    }
}

/// The type of an endpoint as its node describes it. Blocks for as long as that takes.
///
/// # Errors
/// When the endpoint tells too little to ask, or the node does not say.
pub(crate) fn description_of(
    middleware: &dyn Middleware,
    one: &Discovered,
) -> anyhow::Result<ResolvedType> {
    let (Some(node), Some(name), Some(hash)) = (&one.node, &one.type_name, &one.type_hash) else {
        anyhow::bail!("{} announces no node, or its type without a hash", one.name);
    };
    let kind = ServiceKind::Ros(RosService::of::<GetTypeDescription>()?);
    let service = format!("{node}/{}", TypeDescriptions::SERVICE);
    let spec = ServiceSpec::new(&service, kind);
    let mut client = middleware.open_client(&spec, &Context::default())?;
    let fields = Map::from([
        ("type_name", Value::from(name.as_str())),
        ("type_hash", Value::from(hash.as_str())),
        ("include_type_sources", Value::from(false)),
    ]);
    let reply = client.call(&Request::default().with(fields), DESCRIBED_WITHIN)?;
    let Payload::RosMessage(message) = &reply.payload else {
        anyhow::bail!("{service} answered otherwise");
    };
    let reply = GetTypeDescription_Response::decode(&message.cdr, MAX_DESCRIPTION_BYTES)?;
    if !reply.successful {
        anyhow::bail!("{node} does not describe {name}: {}", reply.failure_reason);
    }
    Ok(ResolvedType::from_description(&reply.type_description)?)
}

/// True when no later look brings a type: a publisher is there, and it will not tell.
fn is_never_told(errors: &[(Role, LearnError)]) -> bool {
    errors.iter().any(|(role, _)| *role == Role::Publisher)
        && errors.iter().all(|(_, error)| matches!(error, LearnError::Untold(_)))
}

/// Error of the end that may still tell its type, else the first error.
fn most_telling(mut errors: Vec<(Role, LearnError)>) -> Option<LearnError> {
    let tells_yet = |(_, error): &(Role, LearnError)| !matches!(error, LearnError::Untold(_));
    let place = errors.iter().position(tells_yet).unwrap_or(0);
    (place < errors.len()).then(|| errors.swap_remove(place).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A port of YARP that is being asked, and a bridge that reads it and tells nothing.
    #[test]
    fn listeners_that_tell_nothing_end_no_wait_for_a_publisher() {
        let untold = || LearnError::Untold("yarp".into());
        let asked = || LearnError::Asked("/cam".into());
        let errors = || vec![(Role::Publisher, asked()), (Role::Listener, untold())];
        assert!(!is_never_told(&errors()));
        assert!(matches!(most_telling(errors()), Some(LearnError::Asked(_))));
        assert!(is_never_told(&[(Role::Publisher, untold()), (Role::Listener, untold())]));
        assert!(!is_never_told(&[(Role::Listener, untold())]), "a publisher may come");
        assert!(most_telling(Vec::new()).is_none());
    }
}
