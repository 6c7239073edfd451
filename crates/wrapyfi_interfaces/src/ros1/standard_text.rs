//! Texts of the types that every ROS 1 installation has.
//!
//! `standard/ros1.txt` has fields and constants of the interfaces that Debian ships for ROS 1, and of
//! Wrapyfi's; `standard/ros2.txt` has those of ROS 2 that differ from them by more than ROS 2 itself
//! does. A line of `=`, then `MSG: package/Type` or `SRV: package/Type`, then the definition.

pub(super) const ROS1: &str = include_str!("standard/ros1.txt");
pub(super) const ROS2: &str = include_str!("standard/ros2.txt");

/// Kind, package and name of the types of ROS 1, such as `(srv, std_srvs, Empty)`.
pub(crate) fn names() -> impl Iterator<Item = (&'static str, &'static str, &'static str)> {
    sections(ROS1).map(|(kind, package, name, _)| (kind, package, name))
}

/// Kind, package, name and text of each definition.
pub(super) fn sections(text: &str) -> impl Iterator<Item = (&'static str, &str, &str, &str)> {
    const SEPARATOR: &str =
        "================================================================================\n";
    text.split(SEPARATOR).filter_map(|section| {
        let (head, text) = section.split_once('\n')?;
        let (kind, name) = head.split_once(": ")?;
        let (package, name) = name.split_once('/')?;
        Some((if kind == "SRV" { "srv" } else { "msg" }, package, name, text))
    })
}
