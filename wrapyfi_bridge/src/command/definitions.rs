//! Definitions of the types that commands name.
//!
//! ```text
//!   --definitions DIR, AMENT_PREFIX_PATH, built in, made from ROS 1 ─▶ TypeStore ─▶ MessageType
//! ```

use std::path::{Path, PathBuf};

use wrapyfi_data::types::{MessageType, RosType};
use wrapyfi_interfaces::ros1::{Rules, Types};
use wrapyfi_interfaces::store::TypeStore;

use crate::exit::{Failure, Result};

/// Definitions of ROS types: in `folders` first, then where `AMENT_PREFIX_PATH` says, then those
/// this program is built with, so that the common ones need no ROS. Without an installed ROS 2 most of its
/// messages are at hand as those of ROS 1, built in or below `ROS_PACKAGE_PATH`.
pub fn store(folders: &[PathBuf]) -> TypeStore {
    let (folders, mut types) = (folders.to_vec(), None);
    of_ros2(&folders).or_made(move |name| {
        let types = types.get_or_insert_with(|| {
            let mut types = Types::new(Rules::built_in(), of_ros2(&folders));
            types.add_ros1_path(&std::env::var_os("ROS_PACKAGE_PATH").unwrap_or_default());
            types
        });
        types.ros2_type_named(name).ok()?.definition().cloned()
    })
}

fn of_ros2(folders: &[PathBuf]) -> TypeStore {
    let mut store = TypeStore::empty().or_generated();
    for folder in folders {
        store.add_folder(folder);
    }
    store.add_ament_path(&std::env::var_os("AMENT_PREFIX_PATH").unwrap_or_default());
    store
}

/// Refuses what is no folder.
pub(crate) fn check(folder: &Path) -> Result<(), String> {
    match folder.is_dir() {
        true => Ok(()),
        false => Err(format!("{}: there is no such folder", folder.display())),
    }
}

/// Definitions of ROS types for a command, whose option they are named by.
pub(crate) fn of_command(folders: &[PathBuf]) -> Result<TypeStore> {
    let fault = |text| Failure::Usage(format!("--definitions {text}"));
    folders.iter().try_for_each(|folder| check(folder)).map_err(fault)?;
    Ok(store(folders))
}

/// The type `name` as one that every middleware carries.
pub(super) fn message_type(name: &str, folders: &[PathBuf]) -> Result<MessageType> {
    let mut store = of_command(folders)?;
    let resolved = store
        .resolve_name(name)
        .map_err(|error| Failure::Usage(format!("{error} (--definitions DIR)")))?;
    RosType::new(&resolved).map(MessageType::Ros).map_err(Failure::usage)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_that_only_ros_1_has_here_are_found_whoever_asks() {
        // As an engine asks, which learns of a topic while it runs.
        let mut types = store(&[]);
        let map = types.resolve_name("nav_msgs/msg/OccupancyGrid").unwrap();
        let fields = &map.definition().unwrap().fields;
        let names: Vec<&str> = fields.iter().map(|field| field.name.as_str()).collect();
        assert_eq!(names, ["header", "info", "data"]);
        let error = types.resolve_name("nowhere/msg/Nothing").unwrap_err().to_string();
        assert!(error.contains("nowhere/msg/Nothing"), "{error}");
    }
}
