//! `wrapyfi survey`: what a graph of ROS 1 has, and what of it a move to ROS 2 has to heed.
//!
//! ```text
//!   Look ─ learn ─┬─▶ facts ─┬─▶ report   Markdown
//!   measured ─────┘          └─▶ routes   a configuration for `wrapyfi bridge`
//! ```

mod facts;
mod measured;
mod report;
mod routes;

use std::collections::{BTreeMap, BTreeSet};
use std::fs::OpenOptions;
use std::io::Write as _;
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::anyhow;
use wrapyfi_endpoint::{Discovered, Interaction, Role};
use wrapyfi_interfaces::ros1::PairPlan;
use wrapyfi_interfaces::store::{ResolvedType, TypeStore};
use wrapyfi_ros1::{Registered, Ros1};

use self::facts::{Entry, Facts, RECONFIGURE};
use crate::command::definitions;
use crate::exit::{Failure, Result};
use crate::export::conflicts;
use crate::learned::{Learned, Look, RosGraph, is_common};
use crate::migration_cli::SurveyArgs;
use crate::output;
use crate::shutdown::Shutdown;

/// Longest time until the master has forgotten the subscriptions of the measurement.
const LEAVE_WITHIN: Duration = Duration::from_secs(5);
/// Pause between two looks at the master.
const LOOK_AGAIN: Duration = Duration::from_millis(50);

/// Looks, measures, and writes both files.
///
/// # Errors
/// Exit code 2 where a file is there already, 3 where the master does not answer.
pub fn run(args: &SurveyArgs, shutdown: &Shutdown) -> Result<()> {
    if args.graph != RosGraph::ROS1 {
        return Err(Failure::usage("a survey is of ROS 1: wrapyfi survey ros:"));
    }
    let routes_file = args.output.with_extension("yaml");
    for file in [&args.output, &routes_file] {
        if file.exists() {
            return Err(Failure::usage(format!(
                "{} is there already: remove it, or choose another name with --output",
                file.display()
            )));
        }
    }
    let mut types = definitions::of_command(&args.definitions)?;
    let look = Look::at(args.graph, args.own, shutdown)?;
    let Some(ros1) = look.ros1.clone() else {
        return Err(anyhow!("{} did not start as ROS 1", args.graph).into());
    };
    let learned = look.learn(&mut types, shutdown);
    let is_sourced = std::env::var_os("AMENT_PREFIX_PATH").is_some_and(|it| !it.is_empty());
    let knows_ros2 = is_sourced || !args.definitions.is_empty();
    let mut entries = entries(&look, &ros1, &learned, (&mut types, knows_ros2));
    let resolved: BTreeMap<&str, &ResolvedType> = learned
        .iter()
        .filter(|one| one.endpoint.role == Role::Publisher)
        .filter_map(|one| Some((one.endpoint.name.as_str(), one.told.as_ref().ok()?)))
        .collect();
    let topics: Vec<String> = entries
        .iter()
        .filter(|entry| entry.interaction == Interaction::Topic)
        .map(|entry| entry.name.clone())
        .collect();
    let topics: Vec<(&str, Option<&ResolvedType>)> =
        topics.iter().map(|name| (name.as_str(), resolved.get(name.as_str()).copied())).collect();
    let measured = measured::traffic(&look.middleware, &topics, args.seconds, shutdown);
    let mut subscribed = topics.iter().rev().filter(|(_, resolved)| resolved.is_some());
    if let (Some((last, _)), false) = (subscribed.next(), args.seconds.is_zero()) {
        left(&ros1, last);
    }
    let topics = entries.iter_mut().filter(|entry| entry.interaction == Interaction::Topic);
    topics.zip(measured).for_each(|(entry, traffic)| entry.traffic = traffic);
    let parameters = ros1.parameter_names().map_err(|error| anyhow!("{error}"))?;
    let facts = Facts {
        master: ros1.master_uri().trim_end_matches('/').to_owned(),
        seconds: args.seconds.as_secs_f64(),
        knows_ros2,
        entries,
        parameters,
        has_parameters: learned.iter().any(|one| is_of_parameters(&one.endpoint)),
        simulates_time: ros1.simulates_time(),
        conflicts: conflicts(&learned, args.graph),
    };
    let name = |file: &Path| {
        let name = file.file_name().unwrap_or(file.as_os_str());
        name.to_string_lossy().into_owned()
    };
    write(&args.output, &report::report(&facts, &name(&routes_file)))?;
    write(&routes_file, &routes::routes(&facts, &name(&args.output)))?;
    output::line(&format!(
        "{}: {} nodes, {} topics, {} services, {} actions; routes to start from: {}",
        args.output.display(),
        facts.nodes().len(),
        facts.of(Interaction::Topic).count(),
        facts.of(Interaction::Service).count(),
        facts.of(Interaction::Action).count(),
        routes_file.display()
    ))
}

/// Waits until the master has forgotten the subscription to the last topic by name, which is the last that ends: a node that
/// ends before leaves them behind.
fn left(ros1: &Ros1, last: &str) {
    let begun = Instant::now();
    let is_ours = |one: &Registered| one.role == Role::Listener && one.node == ros1.node_name();
    let is_there = || ros1.registered(last).is_ok_and(|all| all.iter().any(is_ours));
    while begun.elapsed() < LEAVE_WITHIN && is_there() {
        std::thread::sleep(LOOK_AGAIN);
    }
}

fn write(file: &Path, text: &str) -> Result<()> {
    // What came meanwhile stays.
    let opened = OpenOptions::new().write(true).create_new(true).open(file);
    let written = opened.and_then(|mut opened| opened.write_all(text.as_bytes()));
    written.map_err(|error| anyhow!("{} cannot be written: {error}", file.display()).into())
}

/// Topics, services and actions with all endpoints of each.
fn entries(
    look: &Look,
    ros1: &Ros1,
    learned: &[Learned],
    (types, knows_ros2): (&mut TypeStore, bool),
) -> Vec<Entry> {
    let mut entries = BTreeMap::<(Interaction, &str), Entry>::new();
    let reconfigured: BTreeSet<String> = learned.iter().filter_map(reconfigure).collect();
    for one in learned {
        let Learned { endpoint, told } = one;
        let is_reconfigure = endpoint.role == Role::Server && reconfigured.contains(&endpoint.name);
        if is_of_parameters(endpoint) && !is_reconfigure {
            continue;
        }
        let interaction = endpoint.role.interaction();
        let ros2_type = match told {
            Ok(resolved) => Ok(resolved.name().to_string()),
            Err(why) => Err(why.to_string()),
        };
        let entry = entries.entry((interaction, &endpoint.name)).or_insert_with(|| Entry {
            interaction,
            name: endpoint.name.clone(),
            ros1_type: None,
            ros2_type: ros2_type.clone(),
            is_defined: false,
            providers: Default::default(),
            takers: Default::default(),
            is_latched: false,
            traffic: None,
            differences: Vec::new(),
        });
        let nodes = match endpoint.role.is_provider() {
            true => &mut entry.providers,
            false => &mut entry.takers,
        };
        nodes.insert(one.node().to_owned());
        let type_name = match endpoint.role {
            Role::Server if is_reconfigure => Some(RECONFIGURE.to_owned()),
            Role::Server => ros1.told_type(endpoint),
            _ => endpoint.type_name.clone(),
        };
        if entry.ros1_type.is_none() {
            entry.ros1_type = type_name;
        }
        if entry.ros2_type.is_err() {
            entry.ros2_type = ros2_type;
        }
        if let Ok(resolved) = told {
            let name = resolved.name();
            entry.is_defined |=
                types.resolve_defined(name).is_ok() || !knows_ros2 && is_common(&name.to_string());
        }
        if endpoint.role == Role::Publisher {
            entry.is_latched |= look.middleware.keeps_last(endpoint) == Some(true);
        }
    }
    let mut entries: Vec<Entry> = entries.into_values().collect();
    for entry in &mut entries {
        if let (true, Some(name)) = (entry.is_defined, &entry.ros1_type) {
            entry.differences = differences(ros1, entry.interaction, name);
        }
    }
    entries
}

/// True for what a bridge shows of the parameters of nodes, with types that ROS 1 lacks.
fn is_of_parameters(endpoint: &Discovered) -> bool {
    let of_ros2 = ["rcl_interfaces/srv/", "rcl_interfaces/msg/ParameterEvent"];
    let name = endpoint.type_name.as_deref().unwrap_or_default();
    of_ros2.iter().any(|it| name.starts_with(it))
}

/// The service of the server of dynamic_reconfigure whose descriptions these are.
fn reconfigure(one: &Learned) -> Option<String> {
    let Discovered { name, role, type_name, .. } = &one.endpoint;
    let server = name.strip_suffix("/parameter_descriptions")?;
    let is_description = type_name.as_deref() == Some("dynamic_reconfigure/ConfigDescription");
    (*role == Role::Publisher && is_description).then(|| format!("{server}/set_parameters"))
}

/// Fields that a message loses between the definitions of ROS 1 and ROS 2, a sentence each.
fn differences(ros1: &Ros1, interaction: Interaction, name: &str) -> Vec<String> {
    if interaction != Interaction::Topic {
        return Vec::new();
    }
    let plan = ros1.with_types(|types| {
        let definition = types.definition(name).ok()?;
        types.plan(&definition).ok()
    });
    let notes = plan.iter().flat_map(PairPlan::notes).filter(|note| note.is_loss());
    notes.map(ToString::to_string).collect()
}
