//! The options that `#[register]` takes, and the kind of value of each.
//!
//! All of Wrapyfi's are known, so that its scripts can be followed line by line; which of them do
//! something here says docs/reference/communicator.md. A word that is none of them is a mistake.

/// Kind of the value behind the name of an option. `"$name"` fits every kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ValueKind {
    /// `name = true`
    Switch,
    /// `name = 5`
    Number,
    /// `name = "text"`
    Text,
    /// `name(key = value, "other key" = value)`
    Map,
    /// `name(option = value)`, options for one side only
    Side,
    /// `name = true` or `name(quality = 95)`
    SwitchOrMap,
}

impl ValueKind {
    /// Example of the option as it is to be written.
    pub(crate) fn example(self, name: &str) -> String {
        match self {
            Self::Switch | Self::SwitchOrMap => format!("{name} = true"),
            Self::Number => format!("{name} = 5"),
            Self::Text => format!("{name} = \"…\""),
            Self::Map => format!("{name}(key = \"value\")"),
            Self::Side => format!("{name}(in_topic = \"/there\")"),
        }
    }
}

/// Every option.
const OPTIONS: &[(&str, ValueKind)] = &[
    // Any type, any middleware.
    ("carrier", ValueKind::Text),
    ("class_name", ValueKind::Text),
    ("deserializer_kwargs", ValueKind::Map),
    ("in_topic", ValueKind::Text),
    ("listener_kwargs", ValueKind::Side),
    ("middleware", ValueKind::Text),
    ("multi_threaded", ValueKind::Switch),
    ("out_topic", ValueKind::Text),
    ("persistent", ValueKind::Switch),
    ("publisher_kwargs", ValueKind::Side),
    ("queue_size", ValueKind::Number),
    ("serializer_kwargs", ValueKind::Map),
    ("should_wait", ValueKind::Switch),
    ("topic", ValueKind::Text),
    // Beyond Wrapyfi.
    ("encoding", ValueKind::Text),
    ("max_message_mib", ValueKind::Number),
    ("message_type", ValueKind::Text),
    ("qos", ValueKind::Text),
    ("timeout_ms", ValueKind::Number),
    // Action.
    ("action_type", ValueKind::Text),
    ("feedback", ValueKind::Text),
    ("poll", ValueKind::Text),
    ("until", ValueKind::Text),
    ("poll_ms", ValueKind::Number),
    // Image.
    ("fp", ValueKind::Switch),
    ("height", ValueKind::Number),
    ("jpg", ValueKind::SwitchOrMap),
    ("rgb", ValueKind::Switch),
    ("width", ValueKind::Number),
    // AudioChunk.
    ("channels", ValueKind::Number),
    ("chunk", ValueKind::Number),
    ("rate", ValueKind::Number),
    // Plug-ins.
    ("load_cupy_device", ValueKind::Text),
    ("load_mxnet_device", ValueKind::Text),
    ("load_paddle_device", ValueKind::Text),
    ("load_torch_device", ValueKind::Text),
    ("map_cupy_devices", ValueKind::Map),
    ("map_mxnet_devices", ValueKind::Map),
    ("map_paddle_devices", ValueKind::Map),
    ("map_torch_devices", ValueKind::Map),
    // ZeroMQ.
    ("insecure", ValueKind::Switch),
    ("proxy_broker_spawn", ValueKind::Text),
    ("pubsub_monitor_listener_spawn", ValueKind::Text),
    ("pubsub_monitor_topic", ValueKind::Text),
    ("socket_ip", ValueKind::Text),
    ("socket_pub_port", ValueKind::Number),
    ("socket_rep_port", ValueKind::Number),
    ("socket_req_port", ValueKind::Number),
    ("socket_sub_port", ValueKind::Number),
    ("start_proxy_broker", ValueKind::Switch),
    ("start_pubsub_monitor_broker", ValueKind::Switch),
    ("zeromq_kwargs", ValueKind::Map),
    // ROS and ROS 2.
    ("ros2_kwargs", ValueKind::Map),
    ("ros_kwargs", ValueKind::Map),
    // YARP.
    ("out_topic_connect", ValueKind::Text),
    ("yarp_kwargs", ValueKind::Map),
    // WebSocket, Zenoh, MQTT.
    ("broker_address", ValueKind::Text),
    ("broker_port", ValueKind::Number),
    ("ip", ValueKind::Text),
    ("mode", ValueKind::Text),
    ("monitor_listener_spawn", ValueKind::Text),
    ("mqtt_kwargs", ValueKind::Map),
    ("namespace", ValueKind::Text),
    ("port", ValueKind::Number),
    ("socket_port", ValueKind::Number),
    ("websocket_kwargs", ValueKind::Map),
    ("zenoh_kwargs", ValueKind::Map),
];

/// The kind of an option's value; `None` for a word that is none.
pub(crate) fn value_kind(name: &str) -> Option<ValueKind> {
    OPTIONS.iter().find(|(known, _)| *known == name).map(|&(_, kind)| kind)
}

/// All names.
pub(crate) fn names() -> impl Iterator<Item = &'static str> {
    OPTIONS.iter().map(|&(name, _)| name)
}
