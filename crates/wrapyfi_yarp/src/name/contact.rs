//! Addresses of ports, and their form in commands.
//!
//! ```text
//!   registration name /cam ip 10.0.0.1 port 10002 type tcp  ──▶ Registration
//!   fast_tcp://cam        ──▶ Target { carrier "fast_tcp", name "/cam" }
//!   /net=10.0./cam        ──▶ Target { network "10.0.",    name "/cam" }
//! ```

/// A port as commands and users name it: perhaps with a carrier before it, perhaps with the network
/// on which it should be reached.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Target {
    /// Carrier with its qualifiers, as in `tcp+recv.priority://cam`; empty where none is named.
    pub carrier: String,
    /// Beginning of the address to choose where the port has several; empty where none is named.
    pub network: String,
    /// The name itself.
    pub name: String,
}

impl Target {
    /// Takes a name apart. It cannot fail: what has no carrier and no network is a name.
    pub fn parse(text: &str) -> Self {
        let (carrier, mut name) = match text.find(":/") {
            // `tcp://cam` names /cam: the second slash belongs to the name.
            Some(at) if at > 0 => {
                let (carrier, rest) = text.split_at(at);
                let name = rest.get(2..).unwrap_or_default();
                (carrier.strip_prefix('/').unwrap_or(carrier), name)
            }
            _ => ("", text),
        };
        let mut network = "";
        if let Some(rest) = name.strip_prefix("/net=").or_else(|| name.strip_prefix("/NET="))
            && let Some(end) = rest.find('/')
        {
            (network, name) = rest.split_at(end);
        }
        Self { carrier: carrier.to_owned(), network: network.to_owned(), name: name.to_owned() }
    }
}

/// True when connections of this carrier, which may have qualifiers, are opened by the receiver.
pub(crate) fn is_pull(carrier: &str) -> bool {
    matches!(carrier.split('+').next(), Some("mjpeg" | "h264"))
}

/// Rule by which a name cannot be that of a port; `None` where it can.
pub(crate) fn name_fault(name: &str, max_bytes: usize) -> Option<String> {
    if name.len() > max_bytes {
        return Some(format!("has {} bytes, the limit is {max_bytes}", name.len()));
    }
    if name == "..." {
        return None;
    }
    if !name.starts_with('/') {
        return Some("does not begin with a slash".to_owned());
    }
    if name.len() > 1 && name.ends_with('/') {
        return Some("ends with a slash".to_owned());
    }
    if name.contains(|letter: char| letter.is_control() || " \"\\,(){}[]".contains(letter)) {
        return Some("has blanks, quotes, brackets or other letters that commands use".to_owned());
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_taken_apart() {
        let parts = |text| {
            let target = Target::parse(text);
            (target.carrier, target.network, target.name)
        };
        let three = |a: &str, b: &str, c: &str| (a.to_owned(), b.to_owned(), c.to_owned());
        assert_eq!(parts("/cam"), three("", "", "/cam"));
        assert_eq!(parts("tcp://cam"), three("tcp", "", "/cam"));
        assert_eq!(parts("tcp:/cam"), three("tcp", "", "cam"));
        assert_eq!(parts("/tcp://cam"), three("tcp", "", "/cam"));
        assert_eq!(parts("tcp://wf/native:in3"), three("tcp", "", "/wf/native:in3"));
        assert_eq!(parts("/net=127/golden/typed"), three("", "127", "/golden/typed"));
        assert_eq!(parts("udp://net=10.0/cam"), three("udp", "10.0", "/cam"));
        assert_eq!(parts("/net=lonely"), three("", "", "/net=lonely"));
        assert_eq!(parts(""), three("", "", ""));
        assert_eq!(Target::parse("tcp+recv.priority://cam").carrier, "tcp+recv.priority");
        assert!(is_pull("mjpeg+recv.x") && !is_pull("tcp"));
    }

    #[test]
    fn names_that_commands_would_tear_apart_are_no_names() {
        for name in ["...", "/a", "/icub/cam/left:o", "/a+b", "/tmp/port/1=tail"] {
            assert_eq!(name_fault(name, 999), None, "{name}");
        }
        let long = "/".repeat(1000);
        for name in ["", "a", "/a b", "/a\n", "/a\"", "/a/", "/(a", long.as_str()] {
            assert!(name_fault(name, 999).is_some(), "{name}");
        }
    }
}
