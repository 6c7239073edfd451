//! Names in ROS 1 and what ROS 2 makes of them.
//!
//! | | ROS 1 | ROS 2 |
//! | --- | --- | --- |
//! | type | `sensor_msgs/Image` | `sensor_msgs/msg/Image` |
//! | service | `std_srvs/SetBool` | `std_srvs/srv/SetBool` |
//! | odd names | `My_msgs/my_type`, field `frameId`, `K` | `my_msgs/msg/MyType`, `frame_id`, `k` |

use crate::parser::{Dialect, InterfaceKind, TypeName};

/// The name by which ROS 1 knows the type: without `msg` or `srv`.
///
/// ```
/// use wrapyfi_interfaces::parser::{Dialect, TypeName};
/// let name = TypeName::parse(Dialect::Ros1, "sensor_msgs/msg/Image").unwrap();
/// assert_eq!(wrapyfi_interfaces::ros1::ros1_name(&name), "sensor_msgs/Image");
/// ```
pub fn ros1_name(name: &TypeName) -> String {
    format!("{}/{}", name.package(), name.name())
}

/// The same name where ROS 2 allows it, else the one that follows ROS 2's rules: words of types in
/// CamelCase, packages in lower case. `None` where nothing is left of it.
pub(super) fn allowed_in_ros2(name: &TypeName) -> Option<TypeName> {
    let same = |package: &str, name_in_package: &str| {
        TypeName::with_kind(Dialect::Ros2, package, name.kind(), name_in_package).ok()
    };
    same(name.package(), name.name()).or_else(|| {
        let stem = name.file_stem();
        let suffix = name.name().strip_prefix(stem).unwrap_or_default();
        same(&snake_case(name.package()), &format!("{}{suffix}", camel_case(stem)))
    })
}

/// True where ROS 2 allows the name as it is.
pub(super) fn is_allowed_in_ros2(name: &TypeName) -> bool {
    TypeName::with_kind(Dialect::Ros2, name.package(), name.kind(), name.name()).is_ok()
}

/// `frameId` to `frame_id`, `K` to `k`, `a__b_` to `a_b`.
pub(super) fn snake_case(name: &str) -> String {
    let mut text = String::with_capacity(name.len());
    let mut lower_before = false;
    for c in name.chars() {
        if c == '_' {
            if !text.is_empty() && !text.ends_with('_') {
                text.push('_');
            }
        } else {
            if c.is_ascii_uppercase() && lower_before {
                text.push('_');
            }
            text.push(c.to_ascii_lowercase());
        }
        lower_before = c.is_ascii_lowercase() || c.is_ascii_digit();
    }
    text.trim_end_matches('_').to_owned()
}

/// `tf_message` to `TfMessage`.
fn camel_case(name: &str) -> String {
    let mut text = String::with_capacity(name.len());
    let mut begins = true;
    for c in name.chars() {
        match c {
            '_' => begins = true,
            c if begins => {
                text.push(c.to_ascii_uppercase());
                begins = false;
            }
            c => text.push(c),
        }
    }
    text
}

/// `demo_msgs` to `demo_interfaces`, as packages were renamed on the way to ROS 2.
pub(super) fn interfaces_package(name: &TypeName) -> Option<TypeName> {
    let package = format!("{}_interfaces", name.package().strip_suffix("_msgs")?);
    TypeName::with_kind(Dialect::Ros2, &package, name.kind(), name.name()).ok()
}

/// `demo_interfaces` to `demo_msgs`.
pub(super) fn msgs_package(name: &TypeName) -> Option<TypeName> {
    let package = format!("{}_msgs", name.package().strip_suffix("_interfaces")?);
    TypeName::with_kind(Dialect::Ros1, &package, name.kind(), name.name()).ok()
}

/// `name` with another package, or another name of the definition file.
pub(super) fn renamed(
    name: &TypeName,
    dialect: Dialect,
    package: &str,
    stem: &str,
) -> Option<TypeName> {
    let suffix = name.name().strip_prefix(name.file_stem()).unwrap_or_default();
    TypeName::with_kind(dialect, package, name.kind(), &format!("{stem}{suffix}")).ok()
}

/// True when the type is request or response of a service: what a ROS 1 service carries.
pub(super) fn is_service_part(name: &TypeName) -> bool {
    name.kind() == InterfaceKind::Service && name.file_stem() != name.name()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn odd_names_follow_the_rules_of_ros_2() {
        let allowed = |name| {
            allowed_in_ros2(&TypeName::parse(Dialect::Ros1, name).unwrap()).unwrap().to_string()
        };
        assert_eq!(allowed("sensor_msgs/Image"), "sensor_msgs/msg/Image");
        assert_eq!(allowed("My__Msgs_/my_type"), "my_msgs/msg/MyType");
        assert_eq!(allowed("tf/tfMessage"), "tf/msg/TfMessage");
        assert_eq!(allowed("a/srv/b_c_Request"), "a/srv/BC_Request");
        for (odd, plain) in [("frameId", "frame_id"), ("K", "k"), ("a__b_", "a_b"), ("x1", "x1")] {
            assert_eq!(snake_case(odd), plain);
        }
    }
}
