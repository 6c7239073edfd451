//! Properties and connections of a port, asked of the port on one connection.
//!
//! ```text
//!   ─▶ [prop] [get] /cam   (port ((is_input 0) (is_output 1) (is_rpc 0) (type "yarp/image")))
//!   ─▶ [list] [out]        /view
//!   ─▶ [list] [in]
//! ```

use super::link::{Link, LinkError, LinkOptions};
use crate::wire::Command;
use crate::{Bottle, Value};

/// Directions of a port, as its program has set them up. Most programs of YARP leave both open.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Modes {
    /// True when the port takes connections that bring data.
    pub input: bool,
    /// True when the port takes connections that take data away.
    pub output: bool,
    /// True when the port is for requests: a server where it is an input, else a client.
    pub rpc: bool,
}

/// Answers of a port about itself.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Inspection {
    /// Directions of the port; `None` where it does not tell.
    pub modes: Option<Modes>,
    /// Type that its program has promised, or that it has read: `yarp/image`.
    pub type_name: Option<String>,
    /// Ports that bring data, without the tools that ask.
    pub inputs: Vec<String>,
    /// Ports that take data away.
    pub outputs: Vec<String>,
}

/// Asks the port `name` on a connection to `contact`.
pub(super) async fn interview(
    options: &LinkOptions,
    name: &str,
    contact: &str,
    whole: bool,
) -> Result<Inspection, LinkError> {
    let mut link = Link::admin(contact, options).await?;
    let mut ask = async |request: Bottle| link.ask(&Command::Admin, &request).await;
    let words = |words: [&str; 2]| words.map(Value::vocab);
    let mut itself: Bottle = words(["prop", "get"]).into_iter().collect();
    itself.push(name);
    let itself = if whole { ask(itself).await? } else { Bottle::new() };
    let outputs = ask(words(["list", "out"]).into_iter().collect()).await?;
    let inputs = ask(words(["list", "in"]).into_iter().collect()).await?;
    link.quit().await.ok();
    let names = |list: Bottle| {
        let names = list.into_iter().filter_map(|value| value.as_str().map(str::to_owned));
        names.filter(|name| name.starts_with('/')).collect()
    };
    let (modes, type_name) = read(&itself);
    Ok(Inspection { modes, type_name, inputs: names(inputs), outputs: names(outputs) })
}

/// The group `port` of an answer.
fn read(itself: &Bottle) -> (Option<Modes>, Option<String>) {
    let Some(port) = itself.find("port").and_then(Value::as_list) else { return (None, None) };
    let flag = |key: &str| port.find(key).and_then(Value::as_i64).map(|value| value != 0);
    let modes = match (flag("is_input"), flag("is_output"), flag("is_rpc")) {
        (Some(input), Some(output), rpc) => {
            Some(Modes { input, output, rpc: rpc.unwrap_or_default() })
        }
        _ => None,
    };
    let type_name = port.find("type").and_then(Value::as_str).filter(|name| !name.is_empty());
    (modes, type_name.map(str::to_owned))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::WireLimits;

    #[test]
    fn what_yarps_ports_say_is_read() {
        // YARP 3.12.3, a camera of frameGrabber_nws_yarp.
        let said = r#"(sched ((policy 0) (priority 0) (tid 31241))) (process ((arguments "--write") (name yarpdev) (pid 31239) (policy 0) (priority 0))) (platform ((hostname "127.0.0.1") (os Linux))) (port ((is_input 0) (is_output 1) (is_rpc 0) (type "yarp/image")))"#;
        let said = Bottle::from_text(said.as_bytes(), &WireLimits::default()).unwrap();
        let modes = Modes { input: false, output: true, rpc: false };
        assert_eq!(read(&said), (Some(modes), Some("yarp/image".to_owned())));
        assert_eq!(read(&Bottle::from(vec![Value::vocab("fail"), "no".into()])), (None, None));
        assert_eq!(read(&Bottle::new()), (None, None));
    }
}
