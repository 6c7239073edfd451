//! Definitions of the types that commands name.
//!
//! ```text
//!   --definitions DIR, AMENT_PREFIX_PATH, built in ─▶ TypeStore ─▶ MessageType
//! ```

use std::path::{Path, PathBuf};

use wrapyfi_core::types::{MessageType, RosType};
use wrapyfi_interfaces::parser::{Dialect, TypeName};
use wrapyfi_interfaces::ros1::{Rules, Types};
use wrapyfi_interfaces::store::TypeStore;

use crate::exit::Failure;

/// Definitions of ROS types: in `folders` first, then where `AMENT_PREFIX_PATH` says, then those
/// this program is built with, so that the common ones need no ROS.
pub(crate) fn store(folders: &[PathBuf]) -> TypeStore {
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
pub(crate) fn of_command(folders: &[PathBuf]) -> Result<TypeStore, Failure> {
    let fault = |text| Failure::Usage(format!("--definitions {text}"));
    folders.iter().try_for_each(|folder| check(folder)).map_err(fault)?;
    Ok(store(folders))
}

/// The type `name` as one that every middleware carries.
pub(super) fn message_type(name: &str, folders: &[PathBuf]) -> Result<MessageType, Failure> {
    let mut store = of_command(folders)?;
    add_standard(name, folders, &mut store);
    let resolved = store
        .resolve_name(name)
        .map_err(|error| Failure::Usage(format!("{error} (--definitions DIR)")))?;
    RosType::new(&resolved).map(MessageType::Ros).map_err(Failure::usage)
}

/// Adds the message `name` to a store that does not find it. Where no ROS 2 is installed, most of its
/// types are at hand as those of ROS 1, built in or below `ROS_PACKAGE_PATH`.
pub(crate) fn add_standard(name: &str, folders: &[PathBuf], store: &mut TypeStore) {
    if store.resolve_name(name).is_ok() {
        return;
    }
    let Ok(parsed) = TypeName::parse(Dialect::Ros2, name) else { return };
    let mut types = Types::new(Rules::built_in(), self::store(folders));
    types.add_ros1_path(&std::env::var_os("ROS_PACKAGE_PATH").unwrap_or_default());
    // The fault of the type is reported by the store, when it is asked.
    if let Ok(found) = types.ros2_type_named(&parsed) {
        store.add_resolved(&found);
    }
}
