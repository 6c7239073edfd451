//! `wrapyfi check`: validates a configuration, prints what it would run or what it changes of another, and
//! warns of routes that do not hear each other, and of those that lead in a circle.

use std::path::Path;

use wrapyfi_endpoint::EndpointAddress;
use wrapyfi_engine::{Kind, Plan, Typing};
use wrapyfi_interfaces::ros1::{Rules, Types};
use wrapyfi_interfaces::store::TypeStore;
use wrapyfi_ros1::differences;

use crate::exit::{Failure, Result};
use crate::in_force::{in_lines, warn_of_unheard};
use crate::middlewares::{self, Loaded, Ros1Section, Settings};
use crate::node::Node;
use crate::output;
use crate::sros2;

/// Prints the plan, a route a line, or its policy of SROS 2; with `against`, what it changes for a bridge that
/// runs with that file.
///
/// # Errors
/// Exit code 2 with every fault of a file, each with its line.
pub fn run(file: &Path, against: Option<&Path>, prints_policy: bool) -> Result<()> {
    let mut loaded = middlewares::load(file)?;
    loaded.endpoints.check_permitted(Some(file))?;
    let settings = |of: &Loaded, before: &Settings| Settings::of(&of.endpoints, &of.plan, before);
    // The bridge starts with them, and with variables that no line has.
    settings(&loaded, &Settings::default())?;
    if let Some(against) = against {
        let old = middlewares::load(against)?;
        output::line(&old.plan.diff(&loaded.plan).to_string())?;
        let before = settings(&old, &Settings::default())?;
        let now = settings(&loaded, &before)?;
        for change in before.changes(&now) {
            output::line(&change)?;
        }
        for refusal in before.refusals(&now) {
            output::line(&format!("start the program anew: {refusal}"))?;
        }
        return Ok(());
    }
    warn_of_rules(&loaded.endpoints.ros, &mut loaded.types);
    let plan = loaded.plan;
    let node = Node::bridge().map_err(Failure::usage)?;
    if prints_policy {
        output::line(&sros2::policy(&node, &plan))?;
    } else {
        for route in &plan.routes {
            output::line(&route.to_string())?;
        }
    }
    warn_of_differences(&plan, &loaded.lines, &loaded.endpoints.ros);
    let index = plan.index(|address| node.resolve(address));
    warn_of_unheard(&index, &loaded.lines);
    for circle in index.circles() {
        tracing::warn!("{}: {circle}", in_lines(&circle.places, &loaded.lines));
    }
    Ok(())
}

/// Warns of mapping rules of ROS 1 that can have no effect, as far as their types are known without asking anybody.
fn warn_of_rules(ros1: &Ros1Section, ros2: &mut TypeStore) {
    if ros1.rules != Rules::built_in() {
        let mut types = Types::from_environment(ros1.rules.clone());
        types.check_rules(ros2).iter().for_each(|doubt| tracing::warn!("{doubt}"));
    }
}

/// Warns of fields that a route to or from ROS 1 loses, as far as its definition is known without asking anybody.
fn warn_of_differences(plan: &Plan, lines: &[u64], ros1: &Ros1Section) {
    let is_ros1 = |end: &EndpointAddress| end.middleware == wrapyfi_ros1::NAME;
    let mut types = None;
    for (at, route) in plan.routes.iter().enumerate() {
        if route.typing != Typing::Given || !(is_ros1(&route.from) || is_ros1(&route.to)) {
            continue;
        }
        let types = types.get_or_insert_with(|| {
            Types::from_environment(ros1.rules.clone().then(Rules::built_in()))
        });
        let found = match route.kind {
            Kind::Topic(carried) if is_ros1(&route.from) => {
                differences::of_topic(types, carried.from)
            }
            Kind::Topic(carried) => differences::of_topic(types, carried.to),
            Kind::Service(kind) => differences::of_service(types, kind),
        };
        for difference in found {
            tracing::warn!("{}: {difference}", in_lines(&[at], lines));
        }
    }
}
