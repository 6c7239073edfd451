//! Generates the structs of the interfaces this crate knows.
//!
//! ```text
//!   wrapyfi_msgs/{msg,srv}           our own, the source for rosidl too
//!   interfaces/<package>/{msg,srv}   those of ROS 2 and of Wrapyfi that we speak
//!        └─▶ OUT_DIR/interfaces.rs   and their texts: OUT_DIR/definitions.rs
//!   tests/data/interfaces/…          odd shapes for the unit tests, where the folder is there
//!        └─▶ OUT_DIR/golden.rs       with the above
//! ```

// Cargo reads its instructions from a build script's output.
#![allow(clippy::print_stdout)]

#[path = "../src/named.rs"]
mod named;

#[allow(dead_code, unreachable_pub)]
#[path = "../src/description.rs"]
mod description;
#[allow(dead_code, unreachable_pub)]
#[path = "../src/hash.rs"]
mod hash;
#[allow(dead_code, unreachable_pub, unused_imports)]
#[path = "../src/parser/mod.rs"]
mod parser;
#[allow(unreachable_pub)]
#[path = "../src/build/rust.rs"]
mod rust;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::{env, fs};

use parser::{Dialect, InterfaceKind, ParseError, ParseFault, TypeName};
use rust::Definitions;

/// Error of the generator.
#[derive(Debug, thiserror::Error)]
enum BuildError {
    #[error("{}: {source}", path.display())]
    File { path: PathBuf, source: std::io::Error },
    #[error(
        "{}: {source}; the path must be <package>/msg/<Name>.msg or <package>/srv/<Name>.srv",
        path.display()
    )]
    Name { path: PathBuf, source: ParseFault },
    #[error("{}: {source}", path.display())]
    Parse { path: PathBuf, source: Box<ParseError> },
    #[error(transparent)]
    Generate(#[from] rust::GenerateError),
    #[error("environment variable {name}: {source}; run the build script through cargo")]
    Environment { name: &'static str, source: env::VarError },
}

/// Text of each file by its path below the folder of packages, for instance `std_msgs/msg/Header.msg`.
type Texts = BTreeMap<String, String>;

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            println!("cargo::error={error}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<(), BuildError> {
    let variable = |name| {
        env::var(name).map(PathBuf::from).map_err(|source| BuildError::Environment { name, source })
    };
    let root = variable("CARGO_MANIFEST_DIR")?;
    let out = variable("OUT_DIR")?;
    println!("cargo::rerun-if-changed=build");
    println!("cargo::rerun-if-changed=src/build/rust.rs");
    println!("cargo::rerun-if-changed=src/parser");
    println!("cargo::rerun-if-changed=src/description.rs");
    println!("cargo::rerun-if-changed=src/hash.rs");

    let (mut definitions, mut texts) = (Definitions::new(), Texts::new());
    read_package(&root.join("wrapyfi_msgs"), &mut definitions, &mut texts)?;
    read_packages(&root.join("interfaces"), &mut definitions, &mut texts)?;
    write(&out.join("interfaces.rs"), &modules(&definitions)?)?;
    write(&out.join("definitions.rs"), &format!("&{:#?}", texts.iter().collect::<Vec<_>>()))?;

    let golden = root.join("tests/data/interfaces");
    if golden.is_dir() {
        read_packages(&golden, &mut definitions, &mut Texts::new())?;
    }
    write(&out.join("golden.rs"), &modules(&definitions)?)
}

fn modules(definitions: &Definitions) -> Result<String, BuildError> {
    Ok(rust::modules(definitions, &BTreeSet::new(), None)?)
}

fn read_packages(
    folder: &Path,
    definitions: &mut Definitions,
    texts: &mut Texts,
) -> Result<(), BuildError> {
    for package in entries(folder)? {
        read_package(&package, definitions, texts)?;
    }
    Ok(())
}

/// Reads `<package>/msg/*.msg`, `<package>/srv/*.srv` and `<package>/action/*.action`; the folder's name is the package's.
///
/// A service comes as its request, response and event, and under its own name as the message
/// that holds these three, whose hash is that of the service.
fn read_package(
    package: &Path,
    definitions: &mut Definitions,
    texts: &mut Texts,
) -> Result<(), BuildError> {
    println!("cargo::rerun-if-changed={}", package.display());
    for kind in InterfaceKind::ALL {
        let folder = package.join(kind.as_str());
        // Most packages have one kind only.
        if !folder.is_dir() {
            continue;
        }
        for path in entries(&folder)? {
            let failed = |source| BuildError::File { path: path.clone(), source };
            let text = fs::read_to_string(&path).map_err(failed)?;
            let (package, stem) = (part(package.file_name()), part(path.file_stem()));
            let name = TypeName::with_kind(Dialect::Ros2, &package, kind, &stem)
                .map_err(|source| BuildError::Name { path: path.clone(), source })?;
            let parsed =
                parser::parse_interface(Dialect::Ros2, &name, &text).map_err(|source| {
                    BuildError::Parse { path: path.clone(), source: Box::new(source) }
                })?;
            definitions.extend(parsed.into_iter().map(|message| (message.name.clone(), message)));
            texts.insert(format!("{name}.{}", kind.as_str()), text);
        }
    }
    Ok(())
}

fn part(part: Option<&std::ffi::OsStr>) -> String {
    part.map(|part| part.to_string_lossy().into_owned()).unwrap_or_default()
}

/// Entries of a folder, sorted, so that the generated file is the same everywhere.
fn entries(folder: &Path) -> Result<Vec<PathBuf>, BuildError> {
    println!("cargo::rerun-if-changed={}", folder.display());
    let failed = |source| BuildError::File { path: folder.to_owned(), source };
    let mut paths: Vec<PathBuf> = fs::read_dir(folder)
        .and_then(|entries| entries.map(|entry| entry.map(|entry| entry.path())).collect())
        .map_err(failed)?;
    paths.sort();
    Ok(paths)
}

fn write(path: &Path, text: &str) -> Result<(), BuildError> {
    fs::write(path, text).map_err(|source| BuildError::File { path: path.to_owned(), source })
}
