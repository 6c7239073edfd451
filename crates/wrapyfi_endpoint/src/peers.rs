//! Lists of the programs that an endpoint hears, or that may hear it, as a route's options name them.
//!
//! ```text
//!   from_peers: [/camera, "192.168.1.*", "/planner@10.0.0.7"]
//!                 name     address        both              a program fits one of them, or is refused
//! ```
//!
//! A name is what a program says of itself; an address is where its connection comes from.

use std::net::IpAddr;

use super::Role;
use super::counters::Refused;
use super::topic_error::{OpenError, OpenResult};
use wrapyfi_data::types::{Map, Value};

/// Programs whose messages an endpoint takes, or that may have its messages.
///
/// ```
/// use wrapyfi_data::types::Value;
/// use wrapyfi_endpoint::Peers;
/// let list = Value::List(vec!["/planner@10.0.0.*".into(), "192.168.1.7".into()]);
/// let peers = Peers::read(&list).unwrap();
/// assert!(peers.admits("/planner", "10.0.0.3") && peers.admits("/x", "192.168.1.7"));
/// assert!(!peers.admits("/planner", "10.1.0.3"));
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Peers(Vec<Entry>);

/// One program: its name, its address or both, with `*` for any characters.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Entry {
    name: Option<String>,
    address: Option<String>,
}

impl Peers {
    /// Option of a topic: the programs that it is heard from.
    pub const FROM: &'static str = "from_peers";
    /// Option of a topic: the programs that may hear it.
    pub const TO: &'static str = "to_peers";
    /// A program that the list `key` of a route to or from `topic` does not let in.
    pub fn refused(key: &str, topic: &str, name: &str, address: &str) -> Refused {
        Refused {
            who: format!("{name} at {address} is not among {key} of the route of {topic}"),
            allow: format!("options: {{ {key}: [\"{name}@{address}\"] }}"),
            roles: vec![if key == Self::FROM { Role::Publisher } else { Role::Listener }],
        }
    }

    /// Longest list.
    const MOST: usize = 256;

    /// Reads the value of an option.
    ///
    /// # Errors
    /// The form that it must have.
    pub fn read(value: &Value) -> Result<Self, &'static str> {
        const WANTED: &str = "a list of names (/node), addresses (192.168.1.7, 192.168.1.*) or both \
                              (/node@192.168.1.7), 1 to 256 of them";
        let Value::List(values) = value else { return Err(WANTED) };
        if values.is_empty() || values.len() > Self::MOST {
            return Err(WANTED);
        }
        let entries = values.iter().map(|value| value.as_str().and_then(Entry::read));
        entries.collect::<Option<_>>().map(Self).ok_or(WANTED)
    }

    /// The list that option `key` of a topic holds, if any.
    ///
    /// # Errors
    /// [`OpenError::InvalidOption`] where it is no such list.
    pub fn of(
        options: &Map,
        key: &str,
        middleware: &'static str,
        topic: &str,
    ) -> OpenResult<Option<Self>> {
        let Some(value) = options.get(key) else { return Ok(None) };
        let invalid = |wanted: &str| OpenError::InvalidOption {
            middleware,
            topic: topic.to_owned(),
            option: key.to_owned(),
            found: format!("{value:?}").chars().take(80).collect(),
            wanted: wanted.to_owned(),
        };
        Self::read(value).map(Some).map_err(invalid)
    }

    /// Refuses both lists where the middleware does not keep them.
    ///
    /// # Errors
    /// [`OpenError::InvalidOption`] where there is one.
    pub fn none(options: &Map, middleware: &'static str, name: &str) -> OpenResult<()> {
        let given = [Self::FROM, Self::TO].into_iter().find(|&key| options.get(key).is_some());
        given.map_or(Ok(()), |key| {
            Err(OpenError::InvalidOption {
                middleware,
                topic: name.to_owned(),
                option: key.to_owned(),
                found: "a list".to_owned(),
                wanted: "left out: parameters and services have no lists of peers".to_owned(),
            })
        })
    }

    /// True where a program of this name at this address is in the list.
    pub fn admits(&self, name: &str, address: &str) -> bool {
        let address = match address.parse::<IpAddr>() {
            Ok(ip) => ip.to_canonical().to_string(),
            Err(_) => address.to_owned(),
        };
        self.0.iter().any(|entry| {
            let of = |pattern: &Option<String>, text: &str| {
                pattern.as_ref().is_none_or(|pattern| fits(pattern, text))
            };
            of(&entry.name, name) && of(&entry.address, &address)
        })
    }
}

impl Entry {
    fn read(text: &str) -> Option<Self> {
        let (name, address) = match text.split_once('@') {
            Some((name, address)) => (Some(name), Some(address)),
            None if text.starts_with('/') => (Some(text), None),
            None => (None, Some(text)),
        };
        let digit = |c: char| c.is_ascii_hexdigit() || ".:*".contains(c);
        let is_address = |text: &str| !text.is_empty() && text.chars().all(digit);
        let is_name = |text: &str| text.starts_with('/') && !text.contains(char::is_whitespace);
        (name.is_none_or(is_name) && address.is_none_or(is_address))
            .then(|| Self { name: name.map(str::to_owned), address: address.map(str::to_owned) })
    }
}

/// True where `text` is `pattern`, in which `*` stands for any characters.
fn fits(pattern: &str, text: &str) -> bool {
    let mut parts = pattern.split('*');
    let Some(mut left) = parts.next().and_then(|first| text.strip_prefix(first)) else {
        return false;
    };
    let Some(last) = parts.next_back() else { return left.is_empty() };
    for part in parts {
        let Some((_, after)) = left.split_once(part) else { return false };
        left = after;
    }
    left.ends_with(last)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn peers(entries: &[&str]) -> Result<Peers, &'static str> {
        Peers::read(&Value::List(entries.iter().map(|&entry| entry.into()).collect()))
    }

    #[test]
    fn a_program_fits_by_name_address_or_both() {
        let list = peers(&["/camera", "/arm/*/state", "192.168.1.*", "/planner@10.0.0.7"]).unwrap();
        for (name, address, fits) in [
            ("/camera", "1.2.3.4", true),
            ("/camera2", "1.2.3.4", false),
            ("/arm/left/state", "1.2.3.4", true),
            ("/arm/state", "1.2.3.4", false),
            ("/any", "192.168.1.20", true),
            ("/any", "::ffff:192.168.1.20", true),
            ("/any", "192.168.10.20", false),
            ("/planner", "10.0.0.7", true),
            ("/planner", "10.0.0.8", false),
            ("/other", "10.0.0.7", false),
        ] {
            assert_eq!(list.admits(name, address), fits, "{name} {address}");
        }
    }

    #[test]
    fn a_star_stands_for_any_characters() {
        for (pattern, text, fit) in [
            ("*", "", true),
            ("a*", "a", true),
            ("a*a", "a", false),
            ("a*b*c", "aXbYc", true),
            ("a*b*c", "acb", false),
            ("a*bc*bc", "abcbc", true),
            ("a", "ab", false),
        ] {
            assert_eq!(fits(pattern, text), fit, "{pattern} {text}");
        }
    }

    #[test]
    fn what_names_nobody_is_refused() {
        for wrong in [&[][..], &[""], &["robot"], &["/a b"], &["@"], &["/a@"], &["@10.0.0.1"]] {
            assert!(peers(wrong).is_err(), "{wrong:?}");
        }
        assert!(Peers::read(&"/camera".into()).is_err());
        assert!(peers(&["/a"; Peers::MOST + 1]).is_err());
    }
}
