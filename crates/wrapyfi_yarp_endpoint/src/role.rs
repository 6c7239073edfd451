//! Role of a port, from its own answers and from its name.
//!
//! ```text
//!   /cam:in417   a reader of /cam        /head/rpc:i   takes requests
//!   /cam         a publisher             …/in, …:i     readers of their own
//! ```

use wrapyfi_yarp::port::{Inspection, Modes};

use super::input;
use wrapyfi_endpoint::Role;

/// Topic or service of a port and its role, from the port's own answers and from its name.
pub(super) fn role<'n>(name: &'n str, told: Option<&Inspection>) -> (&'n str, Role) {
    let modes = told.and_then(|told| told.modes);
    let inputs = told.is_some_and(|told| !told.inputs.is_empty());
    let outputs = told.is_some_and(|told| !told.outputs.is_empty());
    let (topic, reads) = topic_of(name);
    if reads {
        // It asks what it is connected to.
        let asks = outputs || modes.is_some_and(|modes| !modes.input);
        return (topic, if asks { Role::Client } else { Role::Listener });
    }
    let last = name.rsplit('/').next().unwrap_or(name);
    let by_custom = match last.split_once(':') {
        _ if last.starts_with("rpc") => Role::Server,
        Some((_, "rpc")) => Role::Server,
        _ if input::is_input(name) || last == "quit" => Role::Listener,
        _ => Role::Publisher,
    };
    let role = match modes {
        Some(Modes { rpc: true, input: true, .. }) => Role::Server,
        Some(Modes { rpc: true, .. }) => Role::Client,
        _ if by_custom == Role::Server => Role::Server,
        Some(Modes { input: true, output: false, .. }) => Role::Listener,
        Some(Modes { input: false, output: true, .. }) => Role::Publisher,
        _ if outputs => Role::Publisher,
        _ if inputs => Role::Listener,
        _ => by_custom,
    };
    (name, role)
}

/// The topic that a port is about, and whether its name is that of a reader of it.
pub(super) fn topic_of(name: &str) -> (&str, bool) {
    match name.rsplit_once(":in") {
        Some((topic, number))
            if !number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit()) =>
        {
            (topic, true)
        }
        _ => (name, false),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(modes: Option<(bool, bool, bool)>, inputs: bool, outputs: bool) -> Inspection {
        let names = |there: bool| if there { vec!["/other".to_owned()] } else { Vec::new() };
        let modes = modes.map(|(input, output, rpc)| Modes { input, output, rpc });
        Inspection { modes, type_name: None, inputs: names(inputs), outputs: names(outputs) }
    }

    #[test]
    fn names_tell_what_ports_do() {
        for (port, name, wanted) in [
            ("/cam", "/cam", Role::Publisher),
            ("/cam:in417", "/cam", Role::Listener),
            ("/cam:in", "/cam:in", Role::Listener),
            ("/robot/in", "/robot/in", Role::Listener),
            ("/icub/head/state:o", "/icub/head/state:o", Role::Publisher),
            ("/icub/head/command:i", "/icub/head/command:i", Role::Listener),
            ("/icub/head/rpc:i", "/icub/head/rpc:i", Role::Server),
            ("/grabber/rpc", "/grabber/rpc", Role::Server),
            ("/speech/in", "/speech/in", Role::Listener),
            ("/speech/input", "/speech/input", Role::Listener),
            ("/speech/i", "/speech/i", Role::Listener),
            ("/speech/o", "/speech/o", Role::Publisher),
            ("/cam/quit", "/cam/quit", Role::Listener),
        ] {
            assert_eq!(role(port, None), (name, wanted), "{port}");
            let idle = told(Some((true, true, false)), false, false);
            assert_eq!(role(port, Some(&idle)), (name, wanted), "{port}");
        }
    }

    #[test]
    fn connections_tell_more_than_names() {
        for (port, (inputs, outputs), name, wanted) in [
            ("/view", (true, false), "/view", Role::Listener),
            ("/relay", (true, true), "/relay", Role::Publisher),
            ("/odd:i", (false, true), "/odd:i", Role::Publisher),
            ("/cam:in417", (true, false), "/cam", Role::Listener),
            ("/ask:in3", (false, true), "/ask", Role::Client),
            ("/head/rpc:i", (true, false), "/head/rpc:i", Role::Server),
        ] {
            for modes in [None, Some((true, true, false))] {
                assert_eq!(
                    role(port, Some(&told(modes, inputs, outputs))),
                    (name, wanted),
                    "{port}"
                );
            }
        }
    }

    #[test]
    fn what_a_port_was_made_tells_most() {
        for (port, modes, wanted) in [
            ("/view", (true, false, false), Role::Listener),
            ("/odd:i", (false, true, false), Role::Publisher),
            ("/motors", (true, false, true), Role::Server),
            ("/asker", (false, true, true), Role::Client),
            ("/head/rpc:i", (true, false, false), Role::Server),
        ] {
            for (inputs, outputs) in [(false, false), (true, false), (false, true)] {
                let told = told(Some(modes), inputs, outputs);
                assert_eq!(role(port, Some(&told)), (port, wanted), "{port}");
            }
        }
        let idle = told(Some((false, true, true)), false, false);
        assert_eq!(role("/ask:in3", Some(&idle)), ("/ask", Role::Client));
    }
}
