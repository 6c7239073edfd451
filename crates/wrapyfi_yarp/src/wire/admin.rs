//! Words of administrative requests to ports, and the exact sentences of the answers (protocol section 9).
//!
//! ```text
//!   [add] "tcp://dst"   ─▶ 0 "Added connection from A to B\r\n"
//!   list in             ─▶ "/golden/src" admin
//! ```
//!
//! Verbs come as vocabs or as strings. A port answers by `port::administration`.

use crate::{Bottle, Value};

/// Direction of the connections that are meant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    /// Connections that bring data.
    In,
    /// Connections that take data away; YARP reads this when the word is missing or another.
    Out,
}

/// A value as the name of a port or a key.
pub(crate) fn name(value: &Value) -> String {
    match value {
        Value::String(text) => text.to_string_lossy().into_owned(),
        other => Bottle::from(vec![other.clone()]).to_text(),
    }
}

/// The carrier of a destination, where it names one, and the name of the port: `tcp://dst`.
///
/// `None` when it is malformed: `fast_tcp:/dst` lacks a slash.
pub fn split_destination(destination: &str) -> Option<(Option<&str>, String)> {
    match destination.split_once(':') {
        // A name may have colons, but begins with a slash.
        Some((carrier, rest)) if !carrier.contains('/') => {
            let rest = rest.strip_prefix("//")?;
            Some((Some(carrier), format!("/{}", rest.trim_start_matches('/'))))
        }
        _ => Some((None, destination.to_owned())),
    }
}

fn result(code: i32, mut sentence: String) -> Bottle {
    sentence.push_str("\r\n");
    [Value::from(code), Value::from(sentence)].into_iter().collect()
}

/// `-1` with a reason: a sentence of this module.
pub fn failed(sentence: impl Into<String>) -> Bottle {
    result(-1, sentence.into())
}

/// `0` with what was done: a sentence of this module.
pub fn done(sentence: impl Into<String>) -> Bottle {
    result(0, sentence.into())
}

/// An output was taken away.
pub fn removed(from: &str, to: &str) -> String {
    format!("Removed connection from {from} to {to}")
}

/// An input is being taken away.
pub fn removing(from: &str, to: &str) -> String {
    format!("Removing connection from {from} to {to}")
}

/// There is no such output.
pub fn no_output(name: &str) -> String {
    format!("Could not find an outgoing connection to {name}")
}

/// The destination cannot be reached.
pub fn unreachable_destination(destination: &str) -> String {
    format!("Cannot connect to {destination}")
}

/// The port takes data only.
pub const NO_OUTPUTS: &str = "Outputs not allowed";
/// A client of requests has one server.
pub const ONE_OUTPUT: &str = "RPC output already connected";

/// The answer to `[set]` and `[get]`, by whether there is such a connection.
pub fn configuration(direction: Direction, name: &str, found: bool, set: bool) -> Bottle {
    let side = match direction {
        Direction::In => "from",
        Direction::Out => "to",
    };
    match (found, set) {
        // YARP says "incoming" for both.
        (false, _) => failed(format!("Could not find an incoming connection {side} {name}")),
        (true, true) => done(format!("Configured connection {side} {name}")),
        (true, false) => std::iter::once(Value::Dict(Bottle::new())).collect(),
    }
}

/// `[ver] 1 2 3`: how tools find out that this is a port.
pub fn version() -> Bottle {
    let numbers = [1, 2, 3].map(Value::from);
    std::iter::once(Value::vocab("ver")).chain(numbers).collect()
}

/// `[ok]`.
pub fn ok() -> Bottle {
    std::iter::once(Value::vocab("ok")).collect()
}

/// `[fail]`, with a reason where YARP gives one.
pub fn fail(reason: Option<&str>) -> Bottle {
    let reason = reason.map(Value::string);
    std::iter::once(Value::vocab("fail")).chain(reason).collect()
}

/// The answer to what is no request.
pub fn not_understood() -> Bottle {
    fail(Some("send [help] for list of valid commands"))
}

/// The answer to `[atch]`: there are no monitors here.
pub fn attached(directed: bool) -> Bottle {
    fail(Some(match directed {
        true => "Failed to configure the portmonitor plug-in",
        false => "attach command must be followed by [out] or [in]",
    }))
}

/// The answer to `[dtch]`, where no monitor is.
pub fn detached(directed: bool) -> Bottle {
    match directed {
        true => ok(),
        false => fail(Some("detach command must be followed by [out] or [in]")),
    }
}

/// One line of `[list] [in] /name`.
pub fn details(from: &str, to: &str, carrier: &str, connectionless: bool, push: bool) -> Bottle {
    let pair = |key: &str, value: Value| Value::from(Bottle::from(vec![key.into(), value]));
    let mut lists =
        vec![pair("from", from.into()), pair("to", to.into()), pair("carrier", carrier.into())];
    if connectionless {
        lists.push(pair("connectionless", 1.into()));
    }
    if !push {
        lists.push(pair("push", 0.into()));
    }
    lists.into()
}

/// One part of the answer to `[prop] [get] /port`: a key with what is known of it.
pub fn dict(key: &str, pairs: impl IntoIterator<Item = (&'static str, Value)>) -> Value {
    let pair = |(key, value): (&str, Value)| Value::from(Bottle::from(vec![key.into(), value]));
    let dict = Value::Dict(pairs.into_iter().map(pair).collect());
    Bottle::from(vec![key.into(), dict]).into()
}

/// The answer to `[help]`.
pub fn help() -> Bottle {
    let lines = HELP.iter().map(|&line| Value::string(line));
    std::iter::once(Value::vocab("many")).chain(lines).collect()
}

const HELP: [&str; 20] = [
    "[help]                  # give this help",
    "[ver]                   # report protocol version information",
    "[add] $portname         # add an output connection",
    "[add] $portname $car    # add an output with a given protocol",
    "[del] $portname         # remove an input or output connection",
    "[list] [in]             # list input connections",
    "[list] [out]            # list output connections",
    "[list] [in]  $portname  # give details for input",
    "[list] [out] $portname  # give details for output",
    "[prop] [get]            # get all user-defined port properties",
    "[prop] [get] $prop      # get a user-defined port property (prop, val)",
    "[prop] [set] $prop $val # set a user-defined port property (prop, val)",
    "[prop] [get] $portname  # get Qos properties of a connection to/from a port",
    "[prop] [set] $portname  # set Qos properties of a connection to/from a port",
    "[prop] [get] $cur_port  # get information about current process (e.g., scheduling priority, pid)",
    "[prop] [set] $cur_port  # set properties of the current process (e.g., scheduling priority, pid)",
    "[atch] [out] $prop      # attach a portmonitor plug-in to the port's output",
    "[atch] [in]  $prop      # attach a portmonitor plug-in to the port's input",
    "[dtch] [out]            # detach portmonitor plug-in from the port's output",
    "[dtch] [in]             # detach portmonitor plug-in from the port's input",
];

/// The type of service that `(qos ((priority HIGH)))` and its kin ask for; `None` when it is not
/// understood.
pub fn type_of_service(values: &Bottle) -> Option<u32> {
    // The classes of DSCP: class selectors, and assured forwarding of a class and a drop precedence.
    let digit = |letter: &u8| u32::from(letter - b'0');
    let class = |word: &str| match word.as_bytes() {
        [b'C', b'S', class @ b'0'..=b'7'] => Some(8 * digit(class)),
        [b'A', b'F', class @ b'1'..=b'4', drop @ b'1'..=b'3'] => {
            Some(8 * digit(class) + 2 * digit(drop))
        }
        b"VA" => Some(44),
        b"EF" => Some(46),
        _ => word.parse().ok(),
    };
    let qos = values.find("qos")?.as_list()?;
    // The pairs stand in a list of their own, or right here.
    let pairs = qos
        .get(0)
        .and_then(Value::as_list)
        .filter(|list| list.get(0).is_some_and(|value| value.as_list().is_some()));
    let find = |key: &str| pairs.and_then(|pairs| pairs.find(key)).or_else(|| qos.find(key));
    let dscp = if let Some(priority) = find("priority") {
        match name(priority).as_str() {
            "NORM" | "NORMAL" => 0,
            "LOW" => 10,
            "HIGH" => 36,
            "CRIT" | "CRITICAL" => 44,
            _ => return None,
        }
    } else if let Some(dscp) = find("dscp") {
        class(&name(dscp))?
    } else {
        let tos = u32::try_from(find("tos")?.as_i64()?).ok()?;
        return (tos < 256).then_some(tos);
    };
    (dscp < 64).then_some(dscp << 2)
}
