//! `wrapyfi survey`: what a graph of ROS 1 has, or a bag, and what of it a move to ROS 2 has to heed.
//!
//! ```text
//!   Look ─ learn ─┬─▶ facts ─┬─▶ report   Markdown
//!   measured ─────┤          └─▶ routes   a configuration for `wrapyfi bridge`
//!   bag ──────────┘
//! ```

#[cfg(feature = "bags")]
mod bag;
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
use wrapyfi_interfaces::parser::TypeName;
use wrapyfi_interfaces::store::{ResolvedType, TypeStore};
use wrapyfi_ros1::{Registered, Ros1, is_anonymous};

#[cfg(feature = "bags")]
use self::bag::InBag;
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
/// Exit code 2 where a file is there already, 3 where the master does not answer, 1 where a bag is broken in places.
pub fn run(args: &SurveyArgs, shutdown: &Shutdown) -> Result<()> {
    if args.graph != RosGraph::ROS1 {
        return Err(Failure::usage("a survey is of ROS 1: wrapyfi survey ros:"));
    }
    let routes_file = args.output.with_extension("yaml");
    check_output(&args.output, &routes_file)?;
    let mut known = Known::of(args)?;
    let recorded: Option<(Facts, Vec<String>)> = None;
    #[cfg(feature = "bags")]
    let recorded = match &args.bag {
        Some(bag) => Some(of_bag(bag, &mut known, args, shutdown)?),
        None => recorded,
    };
    let (facts, damage) = match recorded {
        Some(found) => found,
        None => (of_graph(&mut known, args, shutdown)?, Vec::new()),
    };
    let name = |file: &Path| {
        let name = file.file_name().unwrap_or(file.as_os_str());
        name.to_string_lossy().into_owned()
    };
    write(&args.output, &report::report(&facts, &name(&routes_file)))?;
    write(&routes_file, &routes::routes(&facts, &name(&args.output)))?;
    damage.iter().try_for_each(|line| output::line(line))?;
    let [topics, services, actions] =
        Interaction::ALL.map(|interaction| facts.own(interaction).count());
    let offered = match facts.is_bag {
        true => String::new(),
        false => format!(", {services} services, {actions} actions"),
    };
    output::line(&format!(
        "{}: {} nodes, {topics} topics{offered}; routes to start from: {}",
        args.output.display(),
        facts.nodes().len(),
        routes_file.display()
    ))?;
    if damage.is_empty() { Ok(()) } else { Err(Failure::Found) }
}

/// Refuses files that cannot be written, before anything is measured.
fn check_output(report: &Path, routes: &Path) -> Result<()> {
    if report == routes {
        return Err(Failure::usage(format!(
            "{} is the name of the configuration: give the report another ending, such as .md",
            report.display()
        )));
    }
    for file in [report, routes] {
        if file.exists() {
            return Err(Failure::usage(format!(
                "{} is there already: remove it, or choose another name with --output",
                file.display()
            )));
        }
    }
    match report.parent() {
        Some(folder) if !folder.as_os_str().is_empty() && !folder.is_dir() => {
            Err(Failure::usage(format!("{}: there is no such folder", folder.display())))
        }
        _ => Ok(()),
    }
}

/// Types that ROS 2 has here.
struct Known {
    types: TypeStore,
    /// True where a ROS 2 is sourced, or folders of definitions are given.
    knows_ros2: bool,
}

impl Known {
    fn of(args: &SurveyArgs) -> Result<Self> {
        let is_sourced = std::env::var_os("AMENT_PREFIX_PATH").is_some_and(|it| !it.is_empty());
        let knows_ros2 = is_sourced || !args.definitions.is_empty();
        Ok(Self { types: definitions::of_command(&args.definitions)?, knows_ros2 })
    }

    fn has(&mut self, name: &TypeName) -> bool {
        let is_here = self.types.resolve_defined(name).is_ok();
        is_here || !self.knows_ros2 && is_common(&name.to_string())
    }
}

/// Facts of a bag, and the places of it that could not be read.
#[cfg(feature = "bags")]
fn of_bag(
    file: &Path,
    known: &mut Known,
    args: &SurveyArgs,
    shutdown: &Shutdown,
) -> Result<(Facts, Vec<String>)> {
    let mut types = crate::command::bag::types(&args.definitions)?;
    let InBag { learned, mut traffic, latched, seconds, damage } =
        bag::read(file, &mut types, shutdown)?;
    let latches = |one: &Discovered| latched.contains(&one.name);
    let mut entries = entries(&learned, known, &latches, &|_| None);
    for entry in &mut entries {
        entry.traffic = traffic.remove(&entry.name);
        entry.find_differences(&mut types);
    }
    let facts = Facts {
        of: file.display().to_string(),
        is_bag: true,
        seconds,
        knows_ros2: known.knows_ros2,
        simulates_time: entries.iter().any(|entry| entry.name == "/clock"),
        entries,
        conflicts: conflicts(&learned, args.graph),
        ..Facts::default()
    };
    Ok((facts, damage))
}

/// Facts of a graph, without what bridges have in it.
fn of_graph(known: &mut Known, args: &SurveyArgs, shutdown: &Shutdown) -> Result<Facts> {
    let look = Look::at(args.graph, args.own, shutdown)?;
    let Some(ros1) = look.ros1.clone() else {
        return Err(anyhow!("{} did not start as ROS 1", args.graph).into());
    };
    let mut learned = look.learn(&mut known.types, shutdown);
    learned.retain(|one| one.endpoint.mark.is_none() && !is_anonymous(one.node()));
    let latches = |one: &Discovered| look.middleware.keeps_last(one) == Some(true);
    let mut entries = entries(&learned, known, &latches, &|one| ros1.told_type(one));
    entries.iter_mut().for_each(|entry| ros1.with_types(|types| entry.find_differences(types)));
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
    Ok(Facts {
        of: ros1.master_uri().trim_end_matches('/').to_owned(),
        is_bag: false,
        seconds: args.seconds.as_secs_f64(),
        knows_ros2: known.knows_ros2,
        entries,
        parameters,
        has_parameters: learned.iter().any(|one| is_of_parameters(&one.endpoint)),
        simulates_time: ros1.simulates_time(),
        conflicts: conflicts(&learned, args.graph),
    })
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

/// Topics, services and actions with all endpoints of each. `latches` tells whether a publisher keeps its last message,
/// `type_of_server` the type of a service.
fn entries(
    learned: &[Learned],
    known: &mut Known,
    latches: &dyn Fn(&Discovered) -> bool,
    type_of_server: &dyn Fn(&Discovered) -> Option<String>,
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
            Role::Server => type_of_server(endpoint),
            _ => endpoint.type_name.clone(),
        };
        if entry.ros1_type.is_none() {
            entry.ros1_type = type_name;
        }
        if entry.ros2_type.is_err() {
            entry.ros2_type = ros2_type;
        }
        if let Ok(resolved) = told {
            entry.is_defined |= known.has(resolved.name());
        }
        if endpoint.role == Role::Publisher {
            entry.is_latched |= latches(endpoint);
        }
    }
    entries.into_values().collect()
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
