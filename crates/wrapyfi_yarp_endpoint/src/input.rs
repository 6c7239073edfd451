//! The input port of another program that a publisher's name means.
//!
//! ```text
//!   /robot/in              ─▶ /robot/in                 the port of that name
//!   /icub/head/command/i   ─▶ /icub/head/command:i      names of ROS have no colon
//!   /a/b/i, /a/b/i_        ─▶ /a/b/i, /a/b:i            where both exist
//! ```
//!
//! Inputs are known by the customs of YARP: the last part of their name is `i`, `in` or `input`, behind
//! a slash or a colon. No program publishes under such a name: the program that means one wants to write to it.

/// Last parts of names of input ports.
const INPUTS: [&str; 3] = ["i", "in", "input"];

/// True when the name `port` is that of an input, to which other programs write.
pub(super) fn is_input(port: &str) -> bool {
    let last = port.rsplit(['/', ':']).next().unwrap_or(port);
    INPUTS.contains(&last)
}

/// The name with a colon before its last part: `/icub/head/command:i`.
pub(super) fn with_colon(name: &str) -> Option<String> {
    let (before, last) = name.rsplit_once('/')?;
    let has_one = name.contains(':');
    (!before.is_empty() && !last.is_empty() && !has_one).then(|| format!("{before}:{last}"))
}

/// Ports that `name` may mean, and those whose existence decides.
pub(super) fn may_mean(name: &str) -> Vec<String> {
    let bare = name.strip_suffix('_').filter(|bare| is_input(bare));
    let mut ports: Vec<String> = [Some(name.to_owned()), with_colon(name)]
        .into_iter()
        .chain([bare.map(str::to_owned), bare.and_then(with_colon)])
        .flatten()
        .collect();
    ports.retain(|port| is_input(port));
    ports
}

/// The input port that `name` means, of those that `exists` knows.
pub(super) fn meant(name: &str, exists: impl Fn(&str) -> bool) -> Option<String> {
    if is_input(name) {
        let names = std::iter::once(name.to_owned()).chain(with_colon(name));
        return names.into_iter().find(|port| exists(port));
    }
    let bare = name.strip_suffix('_').filter(|bare| is_input(bare))?;
    with_colon(bare).filter(|port| exists(bare) && exists(port))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn among(ports: &[&str], name: &str) -> Option<String> {
        meant(name, |port| ports.contains(&port))
    }

    #[test]
    fn names_of_ros_mean_ports_with_a_colon_and_those_of_the_same_name() {
        for (name, port) in [
            ("/icub/head/command/i", "/icub/head/command:i"),
            ("/icub/head/command:i", "/icub/head/command:i"),
            ("/robot/in", "/robot/in"),
            ("/robot/in", "/robot:in"),
            ("/speech/input", "/speech/input"),
            ("/odd/i", "/odd/i"),
        ] {
            assert_eq!(among(&[port], name).as_deref(), Some(port), "{name}");
            assert_eq!(among(&[], name), None, "{name}");
        }
        for name in ["/icub/head/state/o", "/cam", "/main", "/i_", "/input_mode", "/in/x"] {
            let ports = [name, "/icub/head/state:o", "/in:x", "/i"];
            assert_eq!(among(&ports, name), None, "{name}");
        }
    }

    #[test]
    fn two_ports_that_differ_by_the_colon_have_two_names() {
        let both = ["/a/b/i", "/a/b:i"];
        assert_eq!(among(&both, "/a/b/i").as_deref(), Some("/a/b/i"));
        assert_eq!(among(&both, "/a/b/i_").as_deref(), Some("/a/b:i"));
        assert_eq!(among(&["/a/b:i"], "/a/b/i_"), None);
        assert_eq!(may_mean("/a/b/i_"), ["/a/b/i", "/a/b:i"]);
        assert_eq!(may_mean("/a/b/i"), ["/a/b/i", "/a/b:i"]);
        assert!(may_mean("/cam").is_empty());
    }
}
