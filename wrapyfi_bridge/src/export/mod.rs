//! `wrapyfi export`: interface packages of ROS 2 from what the nodes of a graph show of their types.
//!
//! ```text
//!   Look ─ learn ─▶ gathered ─ one definition each ─▶ text ─▶ package.xml, CMakeLists.txt, msg/, srv/, action/
//!                      └─ two of one type ─▶ Conflict: both nodes, exit code 1
//!
//!   gathered   definitions by type, and who shows them
//!   text       a definition file, and what of ROS 1 had to change
//!   package    the files beside them
//! ```

mod gathered;
mod package;
mod text;

use std::collections::BTreeSet;

use anyhow::anyhow;
use wrapyfi_endpoint::{Interaction, LearnError, Role};
use wrapyfi_interfaces::parser::{Dialect, parse_interface};
use wrapyfi_interfaces::ros1::ActionMessage;
use wrapyfi_interfaces::store::{ResolvedType, TypeStore};
use wrapyfi_ros1::Ros1;

use self::gathered::{Gathered, dependencies};
use self::text::{DefinitionFile, Interface, Origins};
use crate::command::definitions;
use crate::exit::{Failure, Result};
use crate::learned::{Learned, Look, RosGraph, is_common, shows};
use crate::migration_cli::ExportArgs;
use crate::output;
use crate::shutdown::Shutdown;

/// Place of definitions that a node of ROS 1 names and does not show.
const HERE: &str = "a folder of ROS_PACKAGE_PATH";

/// Writes the packages.
///
/// # Errors
/// Exit code 1 where nodes show different definitions of a type, or one is not to be learned; 2 where no node has the
/// package, or a folder is there already; 3 where the graph does not answer.
pub fn run(args: &ExportArgs, shutdown: &Shutdown) -> Result<()> {
    let mut types = definitions::of_command(&args.definitions)?;
    let look = Look::at(args.graph, args.own, shutdown)?;
    let learned = look.learn(&mut types, shutdown);
    let origins = look.ros1.as_deref().map_or_else(Origins::new, |ros1| origins(ros1, &learned));
    let gathered = gather(&learned, args.graph);
    let packages = wanted(args, &gathered, &origins)?;
    let nodes: BTreeSet<&str> = learned.iter().map(Learned::node).collect();
    if let Some(unknown) = args.from.iter().find(|node| !nodes.contains(node.as_str())) {
        let nodes = nodes.into_iter().collect::<Vec<_>>().join(", ");
        return Err(Failure::Usage(format!(
            "--from {unknown}: there is no such node; there are {nodes}"
        )));
    }
    let mut chosen = Vec::new();
    let mut conflicts = Vec::new();
    for package in &packages {
        match gathered.of_package(package, &args.from) {
            Ok(interfaces) => chosen.push((package.as_str(), interfaces)),
            Err(found) => conflicts.extend(found.iter().map(ToString::to_string)),
        }
    }
    if !conflicts.is_empty() {
        return Err(anyhow!(conflicts.join("\n")).into());
    }
    for (package, interfaces) in &chosen {
        write(args, package, interfaces, &origins)?;
    }
    for (package, interfaces) in &chosen {
        say_missing(package, interfaces, &packages, &mut types)?;
    }
    say_unlearned(&learned, &packages, &gathered)
}

/// All definitions, and who shows them.
fn gather(learned: &[Learned], graph: RosGraph) -> Gathered {
    let mut gathered = Gathered::default();
    for one in learned {
        let Ok(resolved) = &one.told else { continue };
        let by_node = shows(one.endpoint.role, graph);
        // A subscriber of ROS 1 has what was found elsewhere.
        if by_node || one.endpoint.role == Role::Server {
            gathered.take(resolved, if by_node { one.node() } else { HERE }, &one.endpoint.name);
        }
    }
    gathered
}

/// Types of which nodes show different definitions, a sentence each.
pub(crate) fn conflicts(learned: &[Learned], graph: RosGraph) -> Vec<String> {
    let gathered = gather(learned, graph);
    let packages = gathered.packages();
    let of_package = packages.iter().filter_map(|package| gathered.of_package(package, &[]).err());
    of_package.flatten().map(|conflict| conflict.to_string()).collect()
}

/// Packages to write by their names on ROS 2.
fn wanted(args: &ExportArgs, gathered: &Gathered, origins: &Origins) -> Result<BTreeSet<String>> {
    let known = gathered.packages();
    let mut wanted = BTreeSet::new();
    for name in &args.package {
        let of_ros1 = || {
            let of = origins.iter().filter(|(_, origin)| origin.name.package() == name);
            let mut of = of.map(|(ros2, _)| ros2.package());
            of.find(|package| known.contains(package))
        };
        let found = known.get(name.as_str()).copied().or_else(of_ros1);
        let Some(found) = found else {
            let known = known.into_iter().collect::<Vec<_>>().join(", ");
            let known = if known.is_empty() { "none".to_owned() } else { known };
            return Err(Failure::Usage(format!(
                "no node on {} shows a type of {name}; packages that are shown: {known}",
                args.graph
            )));
        };
        wanted.insert(found.to_owned());
    }
    Ok(wanted)
}

/// Writes a package, and says what is in it and what had to change.
fn write(
    args: &ExportArgs,
    package: &str,
    interfaces: &[&Interface],
    origins: &Origins,
) -> Result<()> {
    let files: Vec<DefinitionFile> = interfaces.iter().map(|one| one.file(origins)).collect();
    for (interface, file) in interfaces.iter().zip(&files) {
        // What ROS 2 would refuse is found here, not in the workspace.
        parse_interface(Dialect::Ros2, &interface.name, &file.text)
            .map_err(|error| anyhow!("{} cannot be written for ROS 2: {error}", interface.name))?;
    }
    let dependencies = dependencies(package, interfaces.iter().copied());
    let names: Vec<&str> = dependencies.keys().map(String::as_str).collect();
    let description = match args.graph {
        RosGraph::ROS1 => format!("Interfaces of {package}, as nodes of ROS 1 showed them."),
        _ => format!("Interfaces of {package}, as nodes of ROS 2 described them."),
    };
    let folder = package::write(&args.output, package, &description, &files, &names)
        .map_err(Failure::usage)?;
    let count = |kind: &str, word: &str| {
        let number = files.iter().filter(|file| file.path.starts_with(kind)).count();
        format!("{number} {word}{}", if number == 1 { "" } else { "s" })
    };
    output::line(&format!(
        "{}: {}, {}, {}; depends on {}",
        folder.display(),
        count("msg/", "message"),
        count("srv/", "service"),
        count("action/", "action"),
        if names.is_empty() { "nothing".to_owned() } else { names.join(", ") }
    ))?;
    files.iter().flat_map(|file| &file.changes).try_for_each(|change| output::line(change))
}

/// Says which packages the written ones need that are not found here.
fn say_missing(
    package: &str,
    interfaces: &[&Interface],
    written: &BTreeSet<String>,
    types: &mut TypeStore,
) -> Result<()> {
    for (needed, names) in dependencies(package, interfaces.iter().copied()) {
        let lacking = names.iter().find(|name| types.resolve_defined(name).is_err());
        if let (Some(lacking), false) = (lacking, written.contains(&needed)) {
            let or_write = match is_common(&lacking.to_string()) {
                true => String::new(),
                false => format!(", or write it with --package {needed}"),
            };
            output::line(&format!(
                "{package} needs {lacking}, which no ROS 2 here has: install {needed}{or_write}"
            ))?;
        }
    }
    Ok(())
}

/// Says what was not to be learned of the packages.
///
/// # Errors
/// Exit code 1 where there is such a type.
fn say_unlearned(
    learned: &[Learned],
    packages: &BTreeSet<String>,
    gathered: &Gathered,
) -> Result<()> {
    let mut said = BTreeSet::new();
    for one in learned {
        let Err(why) = &one.told else { continue };
        let told = match why {
            LearnError::Undefined { type_name, .. } => Some(type_name),
            _ => one.endpoint.type_name.as_ref(),
        };
        let Some(told) = told else { continue };
        let is_wanted = told.split_once('/').is_some_and(|(package, _)| packages.contains(package));
        if is_wanted && !gathered.has(told) && said.insert(told.clone()) {
            let (name, role) = (&one.endpoint.name, one.endpoint.role.words());
            output::line(&format!("not learned: {told} of {name} ({role} {}): {why}", one.node()))?;
        }
    }
    if said.is_empty() { Ok(()) } else { Err(Failure::Found) }
}

/// Definitions as nodes of ROS 1 showed them, with their comments.
fn origins(ros1: &Ros1, learned: &[Learned]) -> Origins {
    let told = |one: &Learned| match one.endpoint.role {
        Role::Server => ros1.told_type(&one.endpoint),
        _ => one.endpoint.type_name.clone(),
    };
    let told: Vec<(Interaction, String)> = learned
        .iter()
        .filter(|one| one.told.is_ok())
        .filter_map(|one| Some((one.endpoint.role.interaction(), told(one)?)))
        .collect();
    let mut origins = Origins::new();
    for (interaction, name) in told {
        ros1.with_types(|types| {
            let found: Vec<ResolvedType> = match interaction {
                Interaction::Topic => {
                    types.definition(&name).map(|it| it.resolved).into_iter().collect()
                }
                Interaction::Service => {
                    let found = types.service_definition(&name, None);
                    let parts = found.map(|it| [it.request, it.response]);
                    parts.into_iter().flatten().collect()
                }
                Interaction::Action => ["Goal", "Result", "Feedback"]
                    .into_iter()
                    .filter_map(|part| types.definition(&format!("{name}Action{part}")).ok())
                    .filter_map(|message| Some(ActionMessage::new(message).ok()?.part))
                    .collect(),
            };
            for (ros1_name, definition) in found.iter().flat_map(ResolvedType::definitions) {
                for ros2_name in types.rules().ros2_names(ros1_name) {
                    origins.entry(ros2_name).or_insert_with(|| definition.clone());
                }
            }
        });
    }
    origins
}
