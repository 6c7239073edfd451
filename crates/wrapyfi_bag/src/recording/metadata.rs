//! `metadata.yaml`: what is in a recording, for `ros2 bag info`.

use std::fmt::Write as _;

use super::qos::profiles;
use super::writer::Topic;

/// Version of the file that ROS 2 Jazzy writes.
const VERSION: u32 = 9;

/// Contents of a recording of one file.
#[derive(Debug, Clone, PartialEq)]
pub struct Metadata {
    /// Name of the file beside `metadata.yaml`.
    pub file: String,
    /// Topics, with their numbers of messages.
    pub topics: Vec<(Topic, u64)>,
    /// Time of the first message in nanoseconds since 1970; 0 without messages.
    pub start_ns: u64,
    /// Time from the first message to the last in nanoseconds.
    pub duration_ns: u64,
    /// Distribution of ROS 2 that was sourced, for instance `jazzy`; empty without one.
    pub ros_distro: String,
}

impl Metadata {
    /// Number of messages.
    pub fn messages(&self) -> u64 {
        self.topics.iter().map(|(_, messages)| messages).sum()
    }

    /// Text of `metadata.yaml`.
    pub fn to_yaml(&self) -> String {
        let mut text = "rosbag2_bagfile_information:\n".to_owned();
        self.write(&mut text, "  ");
        text
    }

    /// The same without its first line, as it stands inside the recording.
    pub(super) fn inner(&self) -> String {
        let mut text = String::new();
        self.write(&mut text, "");
        text
    }

    fn write(&self, text: &mut String, indent: &str) {
        let Self { file, topics, start_ns, duration_ns, ros_distro } = self;
        let (file, messages) = (quoted(file), self.messages());
        let mut line = |deeper: &str, line: &str| {
            _ = writeln!(text, "{indent}{deeper}{line}");
        };
        line("", &format!("version: {VERSION}"));
        line("", "storage_identifier: mcap");
        line("", &format!("duration:\n{indent}  nanoseconds: {duration_ns}"));
        line("", &format!("starting_time:\n{indent}  nanoseconds_since_epoch: {start_ns}"));
        line("", &format!("message_count: {messages}"));
        let none = if topics.is_empty() { " []" } else { "" };
        line("", &format!("topics_with_message_count:{none}"));
        for (topic, count) in topics {
            let Topic { name, type_name, type_hash, qos, .. } = topic;
            line("  ", "- topic_metadata:");
            line("      ", &format!("name: {}", quoted(name)));
            line("      ", &format!("type: {}", quoted(type_name)));
            line("      ", "serialization_format: cdr");
            match profiles(qos, &format!("{indent}        ")) {
                none if none.is_empty() => line("      ", "offered_qos_profiles: []"),
                some => line("      ", &format!("offered_qos_profiles:\n{}", some.trim_end())),
            }
            line("      ", &format!("type_description_hash: {}", quoted(type_hash)));
            line("    ", &format!("message_count: {count}"));
        }
        line("", "compression_format: \"\"");
        line("", "compression_mode: \"\"");
        line("", &format!("relative_file_paths:\n{indent}  - {file}"));
        line("", &format!("files:\n{indent}  - path: {file}"));
        line("    ", &format!("starting_time:\n{indent}      nanoseconds_since_epoch: {start_ns}"));
        line("    ", &format!("duration:\n{indent}      nanoseconds: {duration_ns}"));
        line("    ", &format!("message_count: {messages}"));
        line("", "custom_data: ~");
        line("", &format!("ros_distro: {}", quoted(ros_distro)));
    }
}

/// Text in quotes, which YAML reads as JSON writes it.
fn quoted(text: &str) -> String {
    serde_json::Value::from(text).to_string()
}
