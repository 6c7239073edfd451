//! State of a ROS 1 master, asked over a plain socket: a tool would take a second to start.

use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::time::Duration;

use anyhow::Context as _;

use crate::{Result, TIMEOUT};

/// One list of the state of a master: names, and the nodes that have them.
pub type Owners = Vec<(String, Vec<String>)>;

/// Registrations at a ROS 1 master.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Books {
    /// Topics and who publishes them.
    pub publishers: Owners,
    /// Topics and who subscribes to them.
    pub subscribers: Owners,
    /// Services and who offers them.
    pub services: Owners,
}

impl Books {
    /// Asks the master at this port.
    pub(crate) fn ask(port: u16) -> Result<Self> {
        let mut stream = TcpStream::connect(("127.0.0.1", port))?;
        stream.set_read_timeout(Some(Duration::min(TIMEOUT, Duration::from_secs(10))))?;
        let body = "<?xml version='1.0'?><methodCall><methodName>getSystemState</methodName>\
                    <params><param><value><string>/test</string></value></param></params></methodCall>";
        let length = body.len();
        let head = format!("POST / HTTP/1.0\r\nContent-Type: text/xml\r\nContent-Length: {length}");
        stream.write_all(format!("{head}\r\n\r\n{body}").as_bytes())?;
        let mut answer = String::new();
        stream.read_to_string(&mut answer)?;
        Self::read(&answer).with_context(|| format!("the master says {answer}"))
    }

    /// Reads `[1, text, [publishers, subscribers, services]]`, each a list of `[name, [node, …]]`.
    fn read(answer: &str) -> Option<Self> {
        let mut lists = Vec::new();
        let mut names: Vec<String> = Vec::new();
        let mut depth = 0_usize;
        // Depth: 1 the reply, 2 the three lists, 3 one of them, 4 a pair, 5 the nodes of a pair.
        for piece in answer.split('<').skip(1) {
            let (tag, text) = piece.split_once('>')?;
            match tag {
                "array" => {
                    depth += 1;
                    match depth {
                        3 => lists.push(Owners::new()),
                        4 => names.clear(),
                        _ => {}
                    }
                }
                "/array" => {
                    if depth == 4 {
                        let (name, nodes) = names.split_first()?;
                        lists.last_mut()?.push((name.clone(), nodes.to_vec()));
                    }
                    depth = depth.checked_sub(1)?;
                }
                "string" if depth >= 4 => names.push(text.to_owned()),
                _ => {}
            }
        }
        let [publishers, subscribers, services] = lists.try_into().ok()?;
        Some(Self { publishers, subscribers, services })
    }

    /// Number of entries of `node`, of all three kinds.
    pub fn entries_of(&self, node: &str) -> usize {
        let all = [&self.publishers, &self.subscribers, &self.services];
        let nodes = all.into_iter().flatten().flat_map(|(_, nodes)| nodes);
        nodes.filter(|one| one.as_str() == node).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_are_told_apart() {
        let text = |text: &str| format!("<value><string>{text}</string></value>");
        let array = |items: &[String]| {
            format!("<value><array><data>\n{}</data></array></value>", items.concat())
        };
        let nodes = array(&[text("/a"), text("/b")]);
        let publishers = array(&[array(&[text("/x"), nodes])]);
        let services = array(&[array(&[text("/s"), array(&[text("/a")])])]);
        let state = array(&[publishers, array(&[]), services]);
        let reply = array(&["<value><int>1</int></value>".to_owned(), text("current"), state]);
        let found = Books::read(&format!("HTTP/1.0 200 OK\r\n\r\n<?xml version='1.0'?>{reply}"));
        let found = found.unwrap_or_default();
        let both = vec!["/a".to_owned(), "/b".to_owned()];
        assert_eq!(found.publishers, [("/x".to_owned(), both)]);
        assert_eq!((found.subscribers.len(), found.entries_of("/a")), (0, 2));
        assert_eq!(Books::read("<array></array>"), None);
    }
}
