//! Conventions of middlewares on which the reading of a configuration depends, before anything starts.

/// Services that every node of ROS 2, a managed one or our own offers about itself, also where a bridge carries
/// them. The mark of a bridge's endpoint is no help: the mapping of Fast DDS shows none of a service, and
/// whoever calls `change_state` ends the bridge.
const NODE_SERVICES: [&str; 21] = [
    "get_parameters",
    "get_parameter_types",
    "set_parameters",
    "set_parameters_atomically",
    "list_parameters",
    "describe_parameters",
    "get_type_description",
    "get_loggers",
    "get_logger_levels",
    "set_logger_level",
    "set_logger_levels",
    "change_state",
    "get_state",
    "get_available_states",
    "get_available_transitions",
    "get_transition_graph",
    "add_route",
    "remove_route",
    "list_routes",
    "explain",
    "reload",
];

/// Conventions of a middleware for types and for names that programs have about themselves.
///
/// ```
/// use wrapyfi_endpoint::Conventions;
/// let ours = Conventions { has_text_type: true, program_topics: &["rosout"], ..Conventions::NONE };
/// assert!(ours.node_services.contains(&"get_parameters"));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Conventions {
    /// True where a text has a message type of its own, so that it crosses to another such
    /// middleware as it is and not as JSON, which would put it in quotes.
    pub has_text_type: bool,
    /// True where topics and services take names of ROS only, so that a pattern makes such ones.
    pub has_ros_names: bool,
    /// Prefixes, without the first slash, of the topics that programs have about themselves.
    pub program_topics: &'static [&'static str],
    /// Last parts of the names of services that every node offers about itself.
    pub node_services: &'static [&'static str],
}

impl Conventions {
    /// Conventions of a middleware that has none of its own.
    pub const NONE: Self = Self {
        has_text_type: false,
        has_ros_names: false,
        program_topics: &[],
        node_services: &NODE_SERVICES,
    };
}
