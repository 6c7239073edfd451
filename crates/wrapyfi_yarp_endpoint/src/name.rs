//! Name of this middleware, and the rules for names of ports.

use wrapyfi_endpoint::{OpenError, OpenResult};

/// Name of this middleware in addresses.
pub const NAME: &str = "yarp";

/// Words after the name of a port that an endpoint waits for.
pub const UNOPENED: &str = ", which no program has opened";

/// Longest name of a port: YARP reads 1000 bytes with its end, and a reader's name has a number.
const MAX_NAME_BYTES: usize = 900;

/// Checks the name of a topic or service, which is the name of a port.
///
/// # Errors
/// The rule that the name breaks.
pub fn check_topic(name: &str) -> Result<(), String> {
    name_fault(name).map_or(Ok(()), |fault| Err(fault.to_owned()))
}

/// The rule that a name breaks, if any.
fn name_fault(name: &str) -> Option<&'static str> {
    if !name.starts_with('/') || name.len() < 2 {
        return Some("it must begin with / and go on, such as /icub/cam/left");
    }
    if name.len() > MAX_NAME_BYTES {
        return Some("it is longer than 900 bytes; YARP reads 1000 at most");
    }
    if name.ends_with('/') {
        return Some("it ends with /; leave that out");
    }
    let forbidden = |letter: char| {
        letter.is_control() || letter.is_whitespace() || "\"\\,(){}[]".contains(letter)
    };
    if name.contains(forbidden) {
        return Some("it has a blank, a quote, a comma or a bracket, which YARP's commands use");
    }
    if name.contains(":/") {
        return Some("it contains :/, which YARP takes for the end of a carrier");
    }
    None
}

pub(super) fn check_name(name: &str) -> OpenResult<()> {
    check_topic(name).map_err(|reason| OpenError::invalid_name(NAME, name, reason))
}
