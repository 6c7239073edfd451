//! Definitions that others are built from, at hand even where no ROS is installed: what `time`
//! and `duration` of ROS 1 stand for, and what every service and action contains.

use crate::parser::{MessageDefinition, TypeName, parse_message};

const BUNDLED: [(&str, &str, &str); 4] = [
    ("builtin_interfaces", "Time", "int32 sec\nuint32 nanosec\n"),
    ("builtin_interfaces", "Duration", "int32 sec\nuint32 nanosec\n"),
    (
        "service_msgs",
        "ServiceEventInfo",
        "uint8 REQUEST_SENT=0\nuint8 REQUEST_RECEIVED=1\nuint8 RESPONSE_SENT=2\n\
         uint8 RESPONSE_RECEIVED=3\nuint8 event_type\nbuiltin_interfaces/Time stamp\n\
         uint8[16] client_gid\nint64 sequence_number\n",
    ),
    ("unique_identifier_msgs", "UUID", "uint8[16] uuid\n"),
];

/// The definition of `name`, where it is one of those above.
pub(super) fn definition(name: &TypeName) -> Option<MessageDefinition> {
    let (_, _, text) = BUNDLED
        .iter()
        .find(|(package, message, _)| TypeName::well_known(package, message) == *name)?;
    parse_message(name, text).ok()
}
