//! Types that every ROS 1 installation has, at hand where there is none.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::standard_text::{ROS1, ROS2, sections};
use crate::parser::{Dialect, TypeName};
use crate::store::{ResolveError, TypeStore};

/// A service that Python Wrapyfi makes by hand: its checksum is not that of its fields, and request and
/// response are messages of other packages.
#[derive(Debug, Clone, Copy)]
pub(super) struct HandMade {
    pub(super) md5sum: &'static str,
    pub(super) request_type: &'static str,
    pub(super) response_type: &'static str,
}

/// Checksum and types of the service where it is one of Wrapyfi's.
pub(super) fn hand_made(name: &TypeName) -> Option<HandMade> {
    let (md5sum, response_type) = match (name.package(), name.name()) {
        ("wrapyfi_services", "ROSNativeObject") => {
            ("46a550fd1ca640b396e26ebf988aed7b", "std_msgs/String")
        }
        ("wrapyfi_services", "ROSImage") => {
            ("f720f2021b4bbbe86b0f93b08906381c", "sensor_msgs/Image")
        }
        _ => return None,
    };
    Some(HandMade { md5sum, request_type: "std_msgs/String", response_type })
}

/// A store of ROS 1.
pub(super) fn ros1() -> TypeStore {
    let mut store = TypeStore::new(Dialect::Ros1, files(ROS1));
    store.add_folder(Path::new(""));
    store
}

/// A store of ROS 2: what this crate has structs for, and what is ours here.
pub(super) fn ros2() -> TypeStore {
    let mut store = TypeStore::generated();
    let parsed: Result<Vec<()>, ResolveError> = sections(ROS2)
        .map(|(_, package, name, text)| {
            store.add_definition(&TypeName::well_known(package, name), text)
        })
        .collect();
    debug_assert!(parsed.is_ok(), "{parsed:?}");
    store
}

fn files(text: &str) -> BTreeMap<PathBuf, String> {
    sections(text)
        .map(|(kind, package, name, text)| {
            (Path::new(package).join(kind).join(format!("{name}.{kind}")), text.to_owned())
        })
        .collect()
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::standard_text::names;
    use super::*;

    #[test]
    fn every_type_at_hand_can_be_read() {
        assert!(names().count() > 180, "{}", names().count());
        let mut store = ros1();
        for (kind, package, name) in names() {
            store.resolve_name(&format!("{package}/{kind}/{name}")).unwrap();
        }
        let mut store = ros2();
        assert!(sections(ROS2).count() > 4);
        for (_, package, name, _) in sections(ROS2) {
            // Types that they refer to may be elsewhere.
            match store.resolve_name(&format!("{package}/msg/{name}")) {
                Ok(_) | Err(ResolveError::NotFound { user: Some(_), .. }) => {}
                Err(error) => panic!("{error}"),
            }
        }
    }
}
