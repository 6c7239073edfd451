//! Rust structs of ROS types, written by the build script of a program.
//!
//! ```text
//!   build.rs: generate(["fleet_msgs/msg/Order"])
//!     folders ─ AMENT_PREFIX_PATH ─ the types of this crate
//!          └─▶ OUT_DIR/ros_interfaces.rs ─▶ include_generated!() ─▶ fleet_msgs::msg::Order : Message
//! ```
//!
//! All types that a type refers to come with it. Of types that this crate has structs for (`std_msgs/msg/Header`) the source names
//! these, so that they are the same type everywhere; where the definition that is found differs, a struct is written.
//!
//! # Example
//!
//! `Cargo.toml` has this crate twice, under `[dependencies]` and under `[build-dependencies]`. `build.rs`:
//!
//! ```no_run
//! use std::process::ExitCode;
//!
//! fn main() -> ExitCode {
//!     wrapyfi_interfaces::build::generate(["geometry_msgs/msg/Twist", "my_msgs/srv/Go"])
//! }
//! ```
//!
//! And in the program:
//!
//! ```ignore
//! mod ros {
//!     wrapyfi_interfaces::include_generated!();
//! }
//! let request = ros::my_msgs::srv::Go_Request::default();
//! ```

// Cargo reads its instructions from a build script's output.
#![allow(clippy::print_stdout)]

mod rust;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::{env, fs, io};

pub use self::rust::GenerateError;
use crate::store::{ResolveError, TypeStore};

/// Name of the file in `OUT_DIR`.
const FILE: &str = "ros_interfaces.rs";

/// Error of [`Generator::source`] and of what is done with the source.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BuildError {
    /// A type was not found, or its definition cannot be read.
    #[error(transparent)]
    Resolve(#[from] ResolveError),
    /// A definition has no Rust form.
    #[error(transparent)]
    Generate(#[from] GenerateError),
    /// The program is no build script.
    #[error("environment variable OUT_DIR: {0}; call this from a build script, which cargo runs")]
    Environment(#[from] env::VarError),
    /// The file could not be written.
    #[error("{}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Error of the system.
        source: io::Error,
    },
}

/// Writes the structs of these types, and of all that they refer to, for [`include_generated!`](crate::include_generated).
/// They are messages (`pkg/msg/Name`), services (`pkg/srv/Name`) and actions (`pkg/action/Name`), looked for where
/// `AMENT_PREFIX_PATH` says and among those of this crate.
///
/// The result is that of `main`: what fails is told to cargo, which shows it.
#[must_use]
pub fn generate<'a>(types: impl IntoIterator<Item = &'a str>) -> ExitCode {
    Generator::default().generate(types)
}

/// Writes structs of types that lie in folders too: [`generate`] with places of your own.
///
/// ```no_run
/// use std::process::ExitCode;
/// use wrapyfi_interfaces::build::Generator;
///
/// fn main() -> ExitCode {
///     Generator::default().folder("interfaces").generate(["fleet_msgs/action/Fetch"])
/// }
/// ```
#[derive(Debug, Clone, Default)]
pub struct Generator {
    folders: Vec<PathBuf>,
}

impl Generator {
    /// Looks for `<package>/{msg,srv,action}/<Name>` in this folder first. A relative path is relative to the package that
    /// is built.
    #[must_use]
    pub fn folder(mut self, path: impl AsRef<Path>) -> Self {
        self.folders.push(path.as_ref().to_owned());
        self
    }

    /// As [`generate`].
    #[must_use]
    pub fn generate<'a>(&self, types: impl IntoIterator<Item = &'a str>) -> ExitCode {
        println!("cargo::rerun-if-env-changed=AMENT_PREFIX_PATH");
        for folder in &self.folders {
            println!("cargo::rerun-if-changed={}", folder.display());
        }
        match self.write(types) {
            Ok(()) => ExitCode::SUCCESS,
            Err(error) => {
                println!("cargo::error={}", error.to_string().replace('\n', " "));
                ExitCode::FAILURE
            }
        }
    }

    fn write<'a>(&self, types: impl IntoIterator<Item = &'a str>) -> Result<(), BuildError> {
        let (source, files) = self.source(types)?;
        for file in files {
            println!("cargo::rerun-if-changed={}", file.display());
        }
        let path = PathBuf::from(env::var("OUT_DIR")?).join(FILE);
        fs::write(&path, source).map_err(|source| BuildError::File { path, source })
    }

    /// Source of one module for each package, and the files that it was made of.
    ///
    /// # Errors
    /// When a type is found nowhere, cannot be read, or has no Rust form.
    pub fn source<'a>(
        &self,
        types: impl IntoIterator<Item = &'a str>,
    ) -> Result<(String, BTreeSet<PathBuf>), BuildError> {
        let mut store = TypeStore::empty();
        for folder in &self.folders {
            store.add_folder(folder);
        }
        store.add_ament_path(&env::var_os("AMENT_PREFIX_PATH").unwrap_or_default());
        let (mut store, mut built_in) = (store.or_generated(), TypeStore::generated());

        let mut definitions = rust::Definitions::new();
        for name in types {
            // The parts of a service or an action stand beside the whole.
            definitions.extend(store.resolve_name(name)?.definitions().clone());
        }
        let (mut ours, mut files, mut texts) = (BTreeSet::new(), BTreeSet::new(), BTreeMap::new());
        for name in definitions.keys() {
            let whole = name.interface();
            let found = store.resolve(&whole)?;
            if built_in.resolve(&whole).is_ok_and(|ours| ours.type_hash() == found.type_hash()) {
                ours.insert(name.clone());
            } else {
                // A program has the texts of this crate's types already.
                let whole = whole.to_string();
                let mut sources = store.sources(&found)?.into_iter();
                texts.extend(
                    sources
                        .find(|own| own.type_name == whole)
                        .map(|own| (format!("{whole}.{}", own.encoding), own.raw_file_contents)),
                );
            }
            files.extend(store.file(&whole)?);
        }
        Ok((rust::modules(&definitions, &ours, Some(&texts))?, files))
    }
}

/// Includes the source that [`build::generate`](crate::build::generate) wrote: one module for each package.
#[macro_export]
macro_rules! include_generated {
    () => {
        include!(concat!(env!("OUT_DIR"), "/ros_interfaces.rs"));
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    fn source(types: &[&str]) -> Result<String, BuildError> {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/interfaces");
        Ok(Generator::default().folder(folder).source(types.iter().copied())?.0)
    }

    #[test]
    fn a_type_that_this_crate_has_is_named_and_any_other_written() {
        let source = source(&["golden_msgs/action/Count"]).unwrap();
        assert!(source.contains("pub struct Count_Goal {"), "{source}");
        assert!(source.contains("pub use ::wrapyfi_interfaces::builtin_interfaces::msg::Time;"));
        assert!(!source.contains("pub struct Time"), "{source}");
    }

    #[test]
    fn a_program_has_the_text_of_each_type_once() {
        let source = source(&["golden_msgs/action/Count", "std_msgs/msg/Header"]).unwrap();
        let (_, texts) = source.split_once("TypeStore::of_texts").unwrap();
        assert!(texts.contains("golden_msgs/action/Count.action"), "{texts}");
        assert!(!texts.contains("std_msgs") && !texts.contains("builtin_interfaces"), "{texts}");
    }

    #[test]
    fn what_is_nowhere_is_named_with_the_places() {
        let error = source(&["golden_msgs/msg/Absent"]).unwrap_err().to_string();
        assert!(error.contains("golden_msgs/msg/Absent is defined nowhere"), "{error}");
        assert!(error.contains("tests/data/interfaces/golden_msgs/msg/Absent.msg"), "{error}");
        let error = source(&["Absent"]).unwrap_err().to_string();
        assert!(error.contains("\"Absent\" names no type"), "{error}");
    }

    /// Error for a package `fleet_msgs` that has this file, asked for a type.
    fn fault(file: &str, text: &str, wanted: &str) -> String {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("fleet_msgs").join(file);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
        let error = Generator::default().folder(folder.path()).source([wanted]).unwrap_err();
        error.to_string()
    }

    #[test]
    fn a_package_without_its_dependencies_is_told_what_to_install() {
        let error = fault("msg/Order.msg", "depot_msgs/Shelf[] shelves\n", "fleet_msgs/msg/Order");
        let needed =
            "depot_msgs/msg/Shelf, which fleet_msgs/msg/Order has a field of, is defined nowhere";
        assert!(error.starts_with(needed), "{error}");
        assert!(error.contains("install its package (ros-jazzy-depot-msgs)"), "{error}");
        assert!(error.ends_with("or give a folder with depot_msgs/msg/Shelf.msg"), "{error}");
        assert!(!error.contains('\n'), "{error}");
    }

    #[test]
    fn names_that_ros_2_forbids_are_told_with_their_line() {
        let order = "fleet_msgs/msg/Order";
        for (text, told) in [
            ("int8 a\nint8 Shelf\n", "line 2: \"Shelf\" is no field name; use lower case letters"),
            ("int8 a__b\n", "line 1: \"a__b\" is no field name"),
            ("int8 slow=1\n", "line 1: \"slow\" is no constant name; use upper case letters"),
            ("my-msgs/Shelf s\n", "line 1: \"my-msgs\" is no package name; use lower case letters"),
            ("order_item i\n", "line 1: \"order_item\" is no type; use a built-in type"),
        ] {
            let error = fault("msg/Order.msg", text, order);
            assert!(error.contains(told) && error.contains("fleet_msgs/msg/Order.msg"), "{error}");
            assert!(!error.contains('\n'), "{error}");
        }
        let error = fault("msg/order.msg", "", "fleet_msgs/msg/order");
        let told = "\"fleet_msgs/msg/order\" names no type: \"order\" is no type";
        assert!(error.starts_with(told), "{error}");
    }
}
