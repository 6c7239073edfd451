//! Names of ROS, made from those of other middlewares.
//!
//! ```text
//!   /skin/0/out    ─▶ /skin/_0/out     no part begins with a digit
//!   /rs-1.d435/ä   ─▶ /rs_1_d435/_     letters, digits and underscores
//!   /head/state:o  ─▶ /head/state/o    a colon of YARP is a slash
//! ```

/// Name of ROS 2, which ROS 1 takes as well, for a name that a pattern has made. Two names may become the same one.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_endpoint as endpoint; }
/// use wrapyfi_core::endpoint::pattern::ros_name;
/// assert_eq!(ros_name("/robot-1/1st:o"), "/robot_1/_1st/o");
/// assert_eq!(ros_name("/camera/left"), "/camera/left");
/// ```
pub fn ros_name(name: &str) -> String {
    let mut made = String::with_capacity(name.len() + 1);
    let parts = name.split(['/', ':']).filter(|part| !part.is_empty());
    for (number, part) in parts.enumerate() {
        if number > 0 || name.starts_with('/') {
            made.push('/');
        }
        if part.starts_with(|first: char| first.is_ascii_digit()) {
            made.push('_');
        }
        // A destination may be private (`~/x`) or name its node (`{node}`).
        let is_kept = |letter: char| letter.is_ascii_alphanumeric() || "{}".contains(letter);
        let letters = part.chars().enumerate().map(|(at, letter)| match letter {
            '~' if number + at == 0 && made.is_empty() => letter,
            _ if is_kept(letter) => letter,
            _ => '_',
        });
        let letters: String = letters.collect();
        made.push_str(&letters);
    }
    made
}

/// The name whose parts begin with digits where those of `name` begin with an underscore and a digit.
pub fn with_leading_digits(name: &str) -> String {
    let parts = name.split('/').map(|part| {
        let rest = part.strip_prefix('_');
        rest.filter(|rest| rest.starts_with(|first: char| first.is_ascii_digit())).unwrap_or(part)
    });
    parts.collect::<Vec<_>>().join("/")
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn names_become_those_of_ros() {
        for (name, wanted) in [
            ("/camera/1st", "/camera/_1st"),
            ("/skin/0/out", "/skin/_0/out"),
            ("/x/1:o", "/x/_1/o"),
            ("/a/b:1", "/a/b/_1"),
            ("/my-module/out", "/my_module/out"),
            ("/rs.d435/info", "/rs_d435/info"),
            ("/tür/größe", "/t_r/gr__e"),
            ("/a//b/:", "/a/b"),
            ("/a~b", "/a_b"),
            ("~/1", "~/_1"),
            ("{node}/1.2", "{node}/_1_2"),
            ("/fine_1/x", "/fine_1/x"),
        ] {
            assert_eq!(ros_name(name), wanted, "{name}");
        }
        assert_eq!(with_leading_digits("/x/_1/_o/a_1"), "/x/1/_o/a_1");
    }

    proptest! {
        /// A name that was made is not changed again, and its digits lead back to it.
        #[test]
        fn a_made_name_stays(name in "/[a-z0-9_.:~ä/-]{1,20}") {
            let made = ros_name(&name);
            prop_assert_eq!(ros_name(&made), made.clone());
            prop_assert_eq!(ros_name(&with_leading_digits(&made)), made);
        }
    }
}
