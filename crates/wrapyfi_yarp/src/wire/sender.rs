//! Sender of a connection: the name in the header, and the qualifiers of its carrier.
//!
//! ```text
//!   tcp+recv.priority+a.b  from /golden/src   ◀──▶   "/golden/src (recv priority) (a b)"
//! ```

use std::fmt;

use super::Carrier;

/// One qualifier of a carrier: `+key.value`, or `+key`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Qualifier {
    /// Key, in front of the point.
    pub key: String,
    /// Value, behind the point.
    pub value: Option<String>,
}

/// The name of a sender and the qualifiers that travel in it.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Sender {
    /// `/golden/src`; without a slash for peers that are no ports (`admin`, `anon_rpc`).
    pub name: String,
    /// Qualifiers that stood behind the name, in their order.
    pub qualifiers: Vec<Qualifier>,
}

impl Sender {
    /// A sender without qualifiers.
    pub fn new(name: impl Into<String>) -> Self {
        Self { name: name.into(), qualifiers: Vec::new() }
    }

    /// Reads the name of a header; bytes that are no text are replaced.
    ///
    /// Whatever the bytes are, there is a result: a part that is no qualifier is left out, since
    /// no program could act on it.
    #[must_use]
    pub fn parse(text: &[u8]) -> Self {
        let text = String::from_utf8_lossy(text);
        let text = text.trim();
        let (name, rest) = match text.find([' ', '\t', '(']) {
            Some(at) => text.split_at(at),
            None => (text, ""),
        };
        let name = name.trim_matches('"').to_owned();
        let mut qualifiers = Vec::new();
        for group in rest.split('(').skip(1) {
            let inside = group.split(')').next().unwrap_or_default();
            let mut words = inside.split_whitespace().map(|word| word.trim_matches('"'));
            if let Some(key) = words.next() {
                let value = words.collect::<Vec<_>>().join(" ");
                let value = (!value.is_empty()).then_some(value);
                qualifiers.push(Qualifier { key: key.to_owned(), value });
            }
        }
        Self { name, qualifiers }
    }

    /// Adds the qualifiers of a carrier as it is written in a request: `tcp+recv.priority`.
    /// Returns the name of the carrier itself.
    pub fn qualify<'a>(&mut self, carrier: &'a str) -> &'a str {
        let mut parts = carrier.split('+');
        let bare = parts.next().unwrap_or_default();
        self.qualifiers.extend(parts.filter(|part| !part.is_empty()).map(|part| {
            match part.split_once('.') {
                Some((key, value)) => {
                    Qualifier { key: key.to_owned(), value: Some(value.to_owned()) }
                }
                None => Qualifier { key: part.to_owned(), value: None },
            }
        }));
        bare
    }

    /// The modifier that the receiver must apply, if there is one.
    pub fn receiver_modifier(&self) -> Option<&str> {
        let named = self.qualifiers.iter().find(|qualifier| qualifier.key == "recv")?;
        Some(named.value.as_deref().unwrap_or_default())
    }

    /// The modifier that the receiver must apply and that ports of ours lack: any but `priority`, which
    /// changes no bytes.
    pub fn foreign_modifier(&self) -> Option<&str> {
        self.receiver_modifier().filter(|&modifier| modifier != "priority")
    }

    /// The qualifier that makes the sender itself change what it sends: `send.portmonitor` and its kin,
    /// and `log.in`, which sends what the port receives.
    pub fn sender_modifier(&self) -> Option<&Qualifier> {
        self.qualifiers.iter().find(|one| matches!(one.key.as_str(), "send" | "log"))
    }

    /// The carrier with the qualifiers, as `[list]` tells it.
    pub fn carrier_text(&self, carrier: Carrier) -> String {
        let mut text = carrier.name().to_owned();
        for Qualifier { key, value } in &self.qualifiers {
            text.push('+');
            text.push_str(key);
            if let Some(value) = value {
                text.push('.');
                text.push_str(value);
            }
        }
        text
    }
}

/// Writes the sender as it stands in a header.
impl fmt::Display for Sender {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.name)?;
        for Qualifier { key, value } in &self.qualifiers {
            match value {
                Some(value) => write!(f, " ({key} {value})")?,
                None => write!(f, " ({key})")?,
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn qualifiers_go_in_the_name_and_come_back() {
        let mut sender = Sender::new("/golden/src");
        assert_eq!(sender.qualify("tcp+recv.priority+a.b+flag"), "tcp");
        let text = sender.to_string();
        assert_eq!(text, "/golden/src (recv priority) (a b) (flag)");
        let read = Sender::parse(text.as_bytes());
        assert_eq!(read, sender);
        assert_eq!(read.carrier_text(Carrier::Tcp), "tcp+recv.priority+a.b+flag");
        assert_eq!(read.receiver_modifier(), Some("priority"));
    }

    #[test]
    fn any_name_gives_a_sender() {
        assert_eq!(Sender::parse(b"admin\r"), Sender::new("admin"));
        assert_eq!(Sender::parse(b"/a ((( ) x ("), Sender::new("/a"));
        assert_eq!(Sender::parse(b""), Sender::default());
        assert_eq!(Sender::parse(&[0xff]).name, "\u{fffd}");
    }
}
