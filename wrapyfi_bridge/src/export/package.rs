//! Files of an interface package beside its definitions: `package.xml` and `CMakeLists.txt`, as `ros2 pkg create` and the
//! tutorials of ROS 2 have them.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::text::DefinitionFile;

/// Error of writing a package.
#[derive(Debug, thiserror::Error)]
pub(super) enum WriteError {
    /// Something is at its place already.
    #[error("{path} is there already: remove it, or choose another folder with --output")]
    Taken {
        /// Folder of the package.
        path: String,
    },
    /// The system refuses.
    #[error("{path} cannot be written: {source}")]
    System {
        /// File or folder.
        path: String,
        /// Reason.
        source: io::Error,
    },
}

/// Writes a package below `output`, and returns its folder. Nothing that is there is changed.
///
/// # Errors
/// When the folder is there already, or the system refuses.
pub(super) fn write(
    output: &Path,
    name: &str,
    description: &str,
    files: &[DefinitionFile],
    dependencies: &[&str],
) -> Result<PathBuf, WriteError> {
    let folder = output.join(name);
    let refused = |path: &Path, source| {
        let path = path.display().to_string();
        WriteError::System { path, source }
    };
    fs::create_dir_all(output).map_err(|error| refused(output, error))?;
    fs::create_dir(&folder).map_err(|error| match error.kind() {
        io::ErrorKind::AlreadyExists => WriteError::Taken { path: folder.display().to_string() },
        _ => refused(&folder, error),
    })?;
    let mut all = BTreeMap::from([
        ("package.xml", package_xml(name, description, dependencies)),
        ("CMakeLists.txt", cmake(name, files, dependencies)),
    ]);
    all.extend(files.iter().map(|file| (file.path.as_str(), file.text.clone())));
    for (path, text) in all {
        let path = folder.join(path);
        let above = path.parent().unwrap_or(&folder);
        fs::create_dir_all(above).map_err(|error| refused(above, error))?;
        fs::write(&path, text).map_err(|error| refused(&path, error))?;
    }
    Ok(folder)
}

fn package_xml(name: &str, description: &str, dependencies: &[&str]) -> String {
    let depends = dependencies.iter().map(|it| format!("  <depend>{it}</depend>\n"));
    let depends: String = depends.collect();
    let gap = if depends.is_empty() { "" } else { "\n" };
    format!(
        "<?xml version=\"1.0\"?>\n\
         <?xml-model href=\"http://download.ros.org/schema/package_format3.xsd\" \
         schematypens=\"http://www.w3.org/2001/XMLSchema\"?>\n\
         <package format=\"3\">\n\
         \x20 <name>{name}</name>\n\
         \x20 <version>0.0.0</version>\n\
         \x20 <description>{description}</description>\n\
         \x20 <maintainer email=\"user@todo.todo\">TODO: who maintains it</maintainer>\n\
         \x20 <license>TODO: License declaration</license>\n\n\
         \x20 <buildtool_depend>ament_cmake</buildtool_depend>\n\
         \x20 <buildtool_depend>rosidl_default_generators</buildtool_depend>\n\n\
         {depends}{gap}\
         \x20 <exec_depend>rosidl_default_runtime</exec_depend>\n\n\
         \x20 <member_of_group>rosidl_interface_packages</member_of_group>\n\n\
         \x20 <export>\n\
         \x20   <build_type>ament_cmake</build_type>\n\
         \x20 </export>\n\
         </package>\n"
    )
}

fn cmake(name: &str, files: &[DefinitionFile], dependencies: &[&str]) -> String {
    let find = dependencies.iter().map(|it| format!("find_package({it} REQUIRED)\n"));
    let find: String = find.collect();
    let definitions: String = files.iter().map(|file| format!("  {}\n", file.path)).collect();
    let depends = match dependencies {
        [] => String::new(),
        some => format!("  DEPENDENCIES {}\n", some.join(" ")),
    };
    format!(
        "cmake_minimum_required(VERSION 3.20)\n\
         project({name})\n\n\
         find_package(ament_cmake REQUIRED)\n\
         find_package(rosidl_default_generators REQUIRED)\n\
         {find}\n\
         rosidl_generate_interfaces(${{PROJECT_NAME}}\n\
         {definitions}{depends})\n\n\
         ament_export_dependencies(rosidl_default_runtime)\n\
         ament_package()\n"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_package_is_written_once_and_nothing_is_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        let file = DefinitionFile {
            path: "srv/Go.srv".to_owned(),
            text: "---\n".to_owned(),
            changes: Vec::new(),
        };
        let write = || {
            let files = std::slice::from_ref(&file);
            write(&folder.path().join("src"), "demo", "Of a robot.", files, &["std_msgs"])
        };
        let written = write().unwrap();
        let read = |path: &str| fs::read_to_string(written.join(path)).unwrap();
        assert_eq!(read("srv/Go.srv"), "---\n");
        assert!(read("package.xml").contains("  <depend>std_msgs</depend>\n\n  <exec_depend>"));
        let cmake = read("CMakeLists.txt");
        let wanted =
            "rosidl_generate_interfaces(${PROJECT_NAME}\n  srv/Go.srv\n  DEPENDENCIES std_msgs\n)";
        assert!(cmake.contains(wanted), "{cmake}");
        assert!(matches!(write(), Err(WriteError::Taken { .. })));
    }
}
