//! Connections: who published which topic, with which type.

use super::error::Fault;
use super::record::fields;

/// A publisher of a topic, as the recording met it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Connection {
    /// Number in the bag.
    pub id: u32,
    /// Topic, as the bag has it.
    pub topic: String,
    /// Type, for instance `sensor_msgs/Image`.
    pub type_name: String,
    /// Checksum of the type.
    pub md5sum: String,
    /// Definition of the type, with all it refers to.
    pub definition: String,
    /// Node that published, where the bag says so.
    pub caller: Option<String>,
    /// True where the publisher keeps its last message for those who come late.
    pub latching: bool,
}

impl Connection {
    /// Reads the fields that stand in the data of a connection's record.
    pub(super) fn read(id: u32, topic: String, data: &[u8]) -> Result<Self, Fault> {
        let (type_name, md5sum, definition) = Default::default();
        let mut connection =
            Self { id, topic, type_name, md5sum, definition, caller: None, latching: false };
        for field in fields(data) {
            let (name, value) = field?;
            let text = || String::from_utf8_lossy(value).into_owned();
            match name {
                b"type" => connection.type_name = text(),
                b"md5sum" => connection.md5sum = text(),
                b"message_definition" => connection.definition = text(),
                b"callerid" => connection.caller = Some(text()),
                b"latching" => connection.latching = value == b"1",
                _ => {}
            }
        }
        Ok(connection)
    }
}
