//! Asks a node where it publishes a topic.

use super::config::NodeUri;
use super::core::Core;
use super::http;
use super::xmlrpc::{Reply, SUCCESS, Value, shortened, text};

/// Asks the node at `uri` for the host and port at which it sends `topic` by TCPROS.
pub(super) async fn request_topic(
    core: &Core,
    uri: &NodeUri,
    topic: &str,
) -> Result<(String, u16), String> {
    let protocols = Value::Array(vec![Value::Array(vec![text("TCPROS")])]);
    let params = vec![text(core.name.full()), text(topic), protocols];
    let reply = http::call(uri, "requestTopic", params).await;
    let Reply { status, text: words, value } =
        reply.map_err(|error| format!("it {}", error.what))?;
    if status != SUCCESS {
        return Err(format!("it does not send the topic: {}", shortened(&words)));
    }
    match &value {
        Value::Array(parts) => match parts.as_slice() {
            [Value::String(_), Value::String(host), Value::Integer(port), ..] => {
                let port = u16::try_from(*port).map_err(|_e| format!("port {port} is none"))?;
                Ok((core.master.whereabouts.of_host(host), port))
            }
            [] => Err("it does not speak TCPROS".to_owned()),
            _ => Err("it names no way to the topic".to_owned()),
        },
        _ => Err("it names no way to the topic".to_owned()),
    }
}
