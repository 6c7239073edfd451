//! The options that `#[register]` takes, and the form of each.
//!
//! All of Wrapyfi's are known, so that its scripts can be followed line by line; which of them do
//! something here says docs/reference/communicator.md. A word that is none of them is a mistake.

/// Form of the value behind the name of an option. `"$name"` fits every form.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Form {
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

impl Form {
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
const OPTIONS: &[(&str, Form)] = &[
    // Any type, any middleware.
    ("carrier", Form::Text),
    ("class_name", Form::Text),
    ("deserializer_kwargs", Form::Map),
    ("in_topic", Form::Text),
    ("listener_kwargs", Form::Side),
    ("middleware", Form::Text),
    ("multi_threaded", Form::Switch),
    ("out_topic", Form::Text),
    ("persistent", Form::Switch),
    ("publisher_kwargs", Form::Side),
    ("queue_size", Form::Number),
    ("serializer_kwargs", Form::Map),
    ("should_wait", Form::Switch),
    ("topic", Form::Text),
    // Beyond Wrapyfi.
    ("encoding", Form::Text),
    ("max_message_mib", Form::Number),
    ("message_type", Form::Text),
    ("qos", Form::Text),
    ("timeout_ms", Form::Number),
    // Image.
    ("fp", Form::Switch),
    ("height", Form::Number),
    ("jpg", Form::SwitchOrMap),
    ("rgb", Form::Switch),
    ("width", Form::Number),
    // AudioChunk.
    ("channels", Form::Number),
    ("chunk", Form::Number),
    ("rate", Form::Number),
    // Plug-ins.
    ("load_cupy_device", Form::Text),
    ("load_mxnet_device", Form::Text),
    ("load_paddle_device", Form::Text),
    ("load_torch_device", Form::Text),
    ("map_cupy_devices", Form::Map),
    ("map_mxnet_devices", Form::Map),
    ("map_paddle_devices", Form::Map),
    ("map_torch_devices", Form::Map),
    // ZeroMQ.
    ("insecure", Form::Switch),
    ("proxy_broker_spawn", Form::Text),
    ("pubsub_monitor_listener_spawn", Form::Text),
    ("pubsub_monitor_topic", Form::Text),
    ("socket_ip", Form::Text),
    ("socket_pub_port", Form::Number),
    ("socket_rep_port", Form::Number),
    ("socket_req_port", Form::Number),
    ("socket_sub_port", Form::Number),
    ("start_proxy_broker", Form::Switch),
    ("start_pubsub_monitor_broker", Form::Switch),
    ("zeromq_kwargs", Form::Map),
    // ROS and ROS 2.
    ("ros2_kwargs", Form::Map),
    ("ros_kwargs", Form::Map),
    // YARP.
    ("out_topic_connect", Form::Text),
    ("yarp_kwargs", Form::Map),
    // WebSocket, Zenoh, MQTT.
    ("broker_address", Form::Text),
    ("broker_port", Form::Number),
    ("ip", Form::Text),
    ("mode", Form::Text),
    ("monitor_listener_spawn", Form::Text),
    ("mqtt_kwargs", Form::Map),
    ("namespace", Form::Text),
    ("port", Form::Number),
    ("socket_port", Form::Number),
    ("websocket_kwargs", Form::Map),
    ("zenoh_kwargs", Form::Map),
];

/// The form of an option; `None` for a word that is none.
pub(crate) fn form(name: &str) -> Option<Form> {
    OPTIONS.iter().find(|(known, _)| *known == name).map(|&(_, form)| form)
}

/// All names.
pub(crate) fn names() -> impl Iterator<Item = &'static str> {
    OPTIONS.iter().map(|&(name, _)| name)
}
