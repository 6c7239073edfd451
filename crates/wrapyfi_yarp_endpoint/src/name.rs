//! Name of this middleware, and the rules for names of ports.

use wrapyfi_endpoint::{EndpointAddress, Named, OpenError, OpenResult};

/// Name of this middleware in addresses.
pub const NAME: &str = "yarp";

/// Longest name of a port: YARP reads 1000 bytes with its end, and a reader's name has a number.
const MAX_NAME_BYTES: usize = 900;

/// Address of the port of a name.
pub(super) fn address(port: &str) -> EndpointAddress {
    EndpointAddress { middleware: NAME.to_owned(), name: port.to_owned() }
}

/// The port of a name, as causes have it.
pub(super) fn port(port: &str) -> Named {
    Named::endpoint("port", NAME, port)
}

/// Checks the name of a topic or service, which is the name of a port.
///
/// # Errors
/// The rule that the name breaks.
pub fn check_topic(name: &str) -> Result<(), String> {
    let forbidden = |letter: char| {
        letter.is_control() || letter.is_whitespace() || "\"\\,(){}[]".contains(letter)
    };
    let fault = if !name.starts_with('/') || name.len() < 2 {
        "it must begin with / and go on, such as /icub/cam/left"
    } else if name.len() > MAX_NAME_BYTES {
        "it is longer than 900 bytes; YARP reads 1000 at most"
    } else if name.ends_with('/') {
        "it ends with /; leave that out"
    } else if name.contains(forbidden) {
        "it has a blank, a quote, a comma or a bracket, which YARP's commands use"
    } else if name.contains(":/") {
        "it contains :/, which YARP takes for the end of a carrier"
    } else {
        return Ok(());
    };
    Err(fault.to_owned())
}

pub(super) fn check_name(name: &str) -> OpenResult<()> {
    check_topic(name).map_err(|reason| OpenError::invalid_name(NAME, name, reason))
}
