//! A configuration file: its section `endpoints`, its routes, their types.

use std::path::Path;

use serde::Deserialize;
use wrapyfi_core::engine::{Carried, Config, ConfigError, MAX_CONFIG_BYTES, Plan};
use wrapyfi_interfaces::store::TypeStore;

use super::ros1::Ros1Section;
use super::ros2::Ros2Section;
use super::yarp::YarpSection;
use super::zeromq::ZeroMqSection;
use crate::command::any;
use crate::exit::Failure;

/// The `endpoints` section of a configuration: how each middleware is reached.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Endpoints {
    /// The ZeroMQ broker.
    pub zeromq: ZeroMqSection,
    /// The ROS 2 graph.
    pub ros2: Ros2Section,
    /// The ROS 1 master.
    pub ros: Ros1Section,
    /// YARP's name server, and our ports.
    pub yarp: YarpSection,
}

/// A configuration that was read and checked.
#[derive(Debug)]
pub struct Loaded {
    /// How each middleware is reached.
    pub endpoints: Endpoints,
    /// The routes.
    pub plan: Plan,
    /// Where their types come from.
    pub types: TypeStore,
}

/// Reads and checks a configuration file.
///
/// # Errors
/// Exit code 2 with every fault, each with its line.
pub fn load(file: &Path) -> Result<Loaded, Failure> {
    let name = file.display().to_string();
    let size =
        std::fs::metadata(file).map_err(|error| Failure::usage(format!("{name}: {error}")))?;
    if size.len() > MAX_CONFIG_BYTES as u64 {
        let text = format!("{name}: {} bytes long, the limit is {MAX_CONFIG_BYTES}", size.len());
        return Err(Failure::usage(text));
    }
    let text = std::fs::read_to_string(file)
        .map_err(|error| Failure::usage(format!("{name}: {error}")))?;
    // As seen from the file, wherever the program was started.
    read(&text, &name, file.parent().unwrap_or(Path::new("")))
}

/// Reads and checks a configuration that is in no file; `name` stands for it in errors.
///
/// # Errors
/// As [`load`].
pub fn load_text(text: &str, name: &str) -> Result<Loaded, Failure> {
    read(text, name, Path::new(""))
}

fn read(text: &str, name: &str, beside: &Path) -> Result<Loaded, Failure> {
    let config: Config<Endpoints> = Config::from_yaml(text, name).map_err(Failure::usage)?;
    config
        .endpoints
        .zeromq
        .check()
        .and_then(|()| config.endpoints.yarp.check())
        .map_err(|problem| ConfigError { file: name.to_owned(), problems: vec![problem] })
        .map_err(Failure::usage)?;
    let folders: Vec<_> =
        config.definitions.iter().map(|folder| beside.join(&folder.value)).collect();
    let mut types = any::definitions(&folders)
        .map_err(|failure| Failure::Usage(format!("{name}: definitions {failure}")))?;
    let plan = Plan::new(&config, &super::available(), &mut types, name).map_err(Failure::usage)?;
    check_services(&plan).map_err(|fault| Failure::Usage(format!("{name}: {fault}")))?;
    Ok(Loaded { endpoints: config.endpoints, plan, types })
}

/// Services that cannot be found by name are refused before anything starts.
fn check_services(plan: &Plan) -> Result<(), String> {
    let is_zeromq = |middleware: &str| middleware == "zeromq";
    let mut services =
        plan.patterns.iter().filter(|it| matches!(it.carried, Carried::Services { .. }));
    let nameless = services.find(|it| {
        is_zeromq(it.source_middleware()) || (it.is_many() && is_zeromq(&it.to.middleware))
    });
    nameless.map_or(Ok(()), |pattern| {
        Err(format!(
            "{}: services of zeromq have no names, and tell no types: a pair of ports is one service; \
             write a route for it, with a type",
            pattern.name
        ))
    })
}
