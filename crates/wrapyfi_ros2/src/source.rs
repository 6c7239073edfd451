//! ROS 2: one node for all publishers and servers of a context, one for its listeners and
//! clients.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use super::ros2::NAME;
use super::settings::Ros2Settings;
use wrapyfi_endpoint::method::{EndpointNeeds, Source, queue_size};
use wrapyfi_endpoint::{Planned, StartError};
use wrapyfi_node::args::RosArgs;
use wrapyfi_node::{NodeName, NodeOptions};

/// ROS 2 for registered methods, with the remap rules and names of a command line.
pub fn source(args: RosArgs) -> Arc<dyn Source> {
    Arc::new(Ros2Source::new(args))
}

/// Number of nodes without a name made in the process.
static NAMELESS: AtomicU32 = AtomicU32::new(0);

struct Ros2Source {
    /// Number in the names of this context's nameless nodes.
    number: u32,
    args: Arc<RosArgs>,
}

impl Ros2Source {
    fn new(args: RosArgs) -> Self {
        Self { number: NAMELESS.fetch_add(1, Relaxed), args: Arc::new(args) }
    }
}

impl Source for Ros2Source {
    fn name(&self) -> &str {
        NAME
    }

    fn plan(&self, wanted: &EndpointNeeds<'_>) -> Result<Planned, StartError> {
        let kwargs = wanted.options.part("ros2_kwargs")?;
        let base = match kwargs.text("node_name")? {
            Some(name) => name.to_owned(),
            None => format!("wrapyfi_{:x}_{}", std::process::id(), self.number),
        };
        let options = NodeOptions::resolve(&base, "/", &self.args).map_err(StartError::refused)?;
        let own = options.name;
        // Two sides, two nodes: a node does not hear itself.
        let node = match wanted.role.is_provider() {
            true => own.clone(),
            false => NodeName::new(&format!("{}_in", own.name()), own.namespace())
                .map_err(StartError::refused)?,
        };
        let (name, args) = (node.fqn(), Arc::clone(&self.args));
        let mut settings = Ros2Settings::of_node(node, |name| std::env::var(name).ok())?;
        let most = &mut settings.cyclone.max_message_bytes;
        *most = wanted.max_message_bytes.max(*most);
        settings.enclave.clone_from(&args.enclave);
        // Both sides use the rules for the node's own name.
        let remap =
            move |topic: &str| args.resolve_topic(&own, topic).map_err(|error| error.to_string());
        Ok(Planned::new(name, settings.remapped(remap)))
    }

    fn queue_depth(&self) -> Option<usize> {
        Some(queue_size("WRAPYFI_ROS2_QUEUE_SIZE"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wrapyfi_endpoint::Role;
    use wrapyfi_endpoint::method::{OptionValue, Options};

    fn key(argv: &[&str], role: Role, options: &Options) -> Result<String, StartError> {
        let argv = argv.iter().map(|word| (*word).to_owned());
        let none = |_: &str| Err(std::io::Error::other("no files here"));
        let source = Ros2Source::new(RosArgs::parse(argv, none).unwrap());
        let wanted = EndpointNeeds { role, options, max_message_bytes: 1 };
        source.plan(&wanted).map(|planned| planned.key)
    }

    #[test]
    fn the_command_line_names_both_nodes() {
        let named = Options::default().with(
            "ros2_kwargs",
            OptionValue::Map(Options::default().with("node_name", OptionValue::Text("eye".into()))),
        );
        let lab = ["--ros-args", "-r", "__ns:=/lab"];
        assert_eq!(key(&[], Role::Publisher, &named).unwrap(), "/eye");
        assert_eq!(key(&lab, Role::Publisher, &named).unwrap(), "/lab/eye");
        assert_eq!(key(&lab, Role::Listener, &named).unwrap(), "/lab/eye_in");
        let other = ["--ros-args", "-r", "__node:=driver"];
        assert_eq!(key(&other, Role::Listener, &named).unwrap(), "/driver_in");
        let wrong = ["--ros-args", "-p", "use_sim_time:=5"];
        let error = key(&wrong, Role::Publisher, &named).unwrap_err().to_string();
        assert!(error.contains("'use_sim_time'"), "{error}");
    }
}
