//! Registrations and their ends, received from the name server as they happen.
//!
//! ```text
//!   ─▶ CONNECT anon_events, r       "turn this connection around: I read now"
//!   ◀─ D, [add] "/cam"              one message for each change
//! ```
//!
//! The connection is ours, so nothing has to listen here: it works through a firewall, and ends
//! when the name server ends. YARP's own programs have the name server connect to a port of theirs
//! instead, which our name server does, too.

use super::client::NameClient;
use crate::port::link::{Link, LinkError};
use crate::wire::text::TextReader;
use crate::wire::{Body, Carrier, Command, Incoming};
use crate::{Bottle, Dialect, Value};

/// A change of the names there are. Multicast groups are not told.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub enum NameEvent {
    /// A port was registered.
    Added(String),
    /// A port was unregistered, or is about to be registered again.
    Removed(String),
}

impl NameEvent {
    /// Message of the name server about the change: `[add] "/cam"`.
    pub fn to_bottle(&self) -> Bottle {
        let (word, name) = match self {
            Self::Added(name) => ("add", name),
            Self::Removed(name) => ("del", name),
        };
        Bottle::from(vec![Value::vocab(word), name.as_str().into()])
    }

    /// Reads what a name server sent; none where it is something else.
    pub fn from_bottle(bottle: &Bottle) -> Option<Self> {
        let name = bottle.get(1)?.as_str()?.to_owned();
        match bottle.get(0)? {
            word if word.is_word("add") => Some(Self::Added(name)),
            word if word.is_word("del") => Some(Self::Removed(name)),
            _ => None,
        }
    }
}

/// The changes that one name server tells.
#[derive(Debug)]
pub struct NameEvents {
    client: NameClient,
    link: Link,
    reader: TextReader,
}

impl NameEvents {
    /// Listens to a name server. Changes from now on are told.
    ///
    /// # Errors
    /// When it does not answer.
    pub async fn open(client: &NameClient) -> Result<Self, LinkError> {
        let opened = client.in_time(async {
            let mut link = client.greet(Carrier::Text, "anon_events").await?;
            link.write_raw(&[b"r\r\n"]).await?;
            Ok(link)
        });
        let reader = TextReader::new(client.limits());
        Ok(Self { client: client.clone(), link: opened.await?, reader })
    }

    /// The next change, however long it takes; messages that are no changes are counted and left
    /// out. Cancel-safe: what was read stays.
    ///
    /// # Errors
    /// When the connection ends, as it does with the name server; open another one then, and ask
    /// for the list: what happened meanwhile is not told.
    pub async fn next(&mut self) -> Result<NameEvent, LinkError> {
        loop {
            let Incoming { command, body } =
                self.link.poll(|buffer| self.reader.poll(buffer)).await?;
            match command {
                Command::Quit => return Err(LinkError::Closed),
                Command::Data { .. } => {
                    if let Some(event) = self.read(&body) {
                        return Ok(event);
                    }
                }
                _ => {}
            }
        }
    }

    fn read(&self, body: &Body) -> Option<NameEvent> {
        let bottle = body.bottle(Dialect::V3, self.client.limits()).ok()?;
        NameEvent::from_bottle(&bottle)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::WireLimits;

    #[test]
    fn events_are_the_bottles_of_the_capture() {
        // Payloads of ns_event_stream.json.
        for (event, hex) in [
            (
                NameEvent::Added("/golden/ev1".into()),
                "00010000020000000900000061646400040000000b0000002f676f6c64656e2f657631",
            ),
            (
                NameEvent::Removed("/golden/ev1".into()),
                "0001000002000000090000006465 6c00040000000b0000002f676f6c64656e2f657631",
            ),
        ] {
            let hex: Vec<u8> = hex.bytes().filter(u8::is_ascii_hexdigit).collect();
            let byte = |pair: &[u8]| u8::from_str_radix(std::str::from_utf8(pair).unwrap(), 16);
            let bytes: Vec<u8> = hex.chunks(2).map(|pair| byte(pair).unwrap()).collect();
            assert_eq!(event.to_bottle().encode(Dialect::V3).unwrap(), bytes);
            let (bottle, _) =
                Bottle::decode(&bytes.into(), Dialect::V3, &WireLimits::default()).unwrap();
            assert_eq!(NameEvent::from_bottle(&bottle), Some(event));
        }
        assert_eq!(NameEvent::from_bottle(&Bottle::new()), None);
        assert_eq!(NameEvent::from_bottle(&Bottle::from(vec!["mod".into(), "/a".into()])), None);
    }
}
