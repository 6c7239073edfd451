//! Conventions of middlewares on which the reading of a configuration depends, before anything starts.

/// Conventions of a middleware for types and for names that programs have about themselves.
///
/// ```
/// use wrapyfi_endpoint::Conventions;
/// let ours = Conventions { has_text_type: true, program_topics: &["rosout"], ..Conventions::NONE };
/// assert!(ours.node_services.is_empty());
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
    /// Last parts of the names of services that every node offers about itself, in lists: those of each kind of node.
    pub node_services: &'static [&'static [&'static str]],
    /// False where services have no names: a pair of ports is one.
    pub has_service_names: bool,
    /// False where a publisher shows by its messages alone: a broker tells what passes, and not who is there.
    pub shows_publishers: bool,
    /// Server at which programs register their addresses, where there is one.
    pub name_service: Option<NameService>,
    /// A program there in words, such as `a ROS 1 node`.
    pub program: &'static str,
    /// Places of its keys in words, where a server may refuse those of this program.
    pub keys: Option<&'static str>,
}

/// Server at which the programs of a middleware register their addresses: the master of ROS 1, the name server of YARP.
/// Other programs then connect to these, and a listener is noticed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NameService {
    /// True where it knows who listens, too.
    pub knows_listeners: bool,
    /// Variable that gives the address at which others reach a program.
    pub address_variable: &'static str,
    /// Variable that says where the server is, where a variable does.
    pub server_variable: Option<&'static str>,
    /// Command that removes the names of programs that were killed.
    pub clean: &'static str,
    /// Remedy where nothing says where the server is, where that may be.
    pub find: Option<&'static str>,
}

impl Conventions {
    /// Conventions of a middleware that has none of its own.
    pub const NONE: Self = Self {
        has_text_type: false,
        has_ros_names: false,
        program_topics: &[],
        node_services: &[],
        has_service_names: true,
        shows_publishers: true,
        name_service: None,
        program: "a program there",
        keys: None,
    };
}
