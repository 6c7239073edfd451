//! Finds the definition of any ROS type while running.
//!
//! ```text
//!   AMENT_PREFIX_PATH ─ share/ament_index/…/rosidl_interfaces/<pkg>, share/<pkg>/msg/*.msg ─┐
//!   a folder of packages ─ <pkg>/msg/*.msg ─────────────────────────────── TypeStore::resolve ┤
//!   a full definition text (ROS 1 connection header, MCAP) ─ ResolvedType::from_text ─────────┤
//!                                                                                             ▼
//!                   RIHS01 hash, ROS 1 checksum, full text, TypePlan  ◀──────────────── ResolvedType
//! ```
//!
//! Definitions are checked before they are read: up to [`MAX_DEFINITION_SIZE`], nested up to
//! [`MAX_DEPTH`](crate::description::MAX_DEPTH) deep, at most
//! [`MAX_TYPES`](crate::description::MAX_TYPES) of them for one type, and none inside itself.

mod bundled;
mod error;
mod files;
mod generated;
mod md5;
mod resolved;
mod text;

pub use error::{Looked, MAX_DEFINITION_SIZE, ResolveError};
pub use files::{Disk, FileAccess};
pub use md5::Md5Error;
pub use resolved::ResolvedType;
pub(crate) use text::ros1_builtin;

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::{fmt, io};

use self::generated::GENERATED;
use crate::parser::{Dialect, InterfaceKind, MessageDefinition, TypeName, parse_interface};
use crate::ros1::standard_text;
use crate::type_description_interfaces::msg::TypeSource;

/// Definitions of types, and the places that are searched for further ones.
///
/// ```no_run
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// # let cdr = bytes::Bytes::new();
/// use wrapyfi_interfaces::store::TypeStore;
///
/// let mut store = TypeStore::from_environment();
/// store.add_folder("my_interfaces".as_ref());
/// let joints = store.resolve_name("sensor_msgs/msg/JointState")?;
/// println!("{}", joints.type_hash());
///
/// let plan = joints.plan()?;
/// let message = plan.decode(&cdr, 1 << 20)?;
/// println!("{:?}", message.get("header.stamp.sec"));
/// println!("{}", serde_json::to_string(&message)?);
///
/// let json = serde_json::json!({"name": ["elbow"], "position": [0.5]});
/// let message = plan.from_json(&json, 1 << 20)?;
/// let cdr = plan.encode(&message)?.to_bytes();
/// # Ok(())
/// # }
/// ```
pub struct TypeStore {
    dialect: Dialect,
    files: Box<dyn FileAccess + Send + Sync>,
    places: Vec<Place>,
    known: BTreeMap<TypeName, MessageDefinition>,
    /// Definitions that were found elsewhere.
    added: BTreeMap<TypeName, MessageDefinition>,
    /// Store for each type that no place here has, also one inside another.
    rest: Option<Box<TypeStore>>,
    /// Makes what is found nowhere.
    make: Option<Box<Make>>,
}

/// Makes the definition of a type that is defined nowhere, where it can.
type Make = dyn FnMut(&TypeName) -> Option<MessageDefinition> + Send + Sync;

/// Place that is searched, in the order in which they were added.
#[derive(Debug)]
enum Place {
    Ament(PathBuf),
    Folder(PathBuf),
}

impl fmt::Debug for TypeStore {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { dialect, places, known, .. } = self;
        f.debug_struct("TypeStore")
            .field("dialect", dialect)
            .field("places", places)
            .field("known", &known.len())
            .finish_non_exhaustive()
    }
}

impl TypeStore {
    /// A store without places, which reads with `files`.
    pub fn new(dialect: Dialect, files: impl FileAccess + Send + Sync + 'static) -> Self {
        Self {
            dialect,
            files: Box::new(files),
            places: Vec::new(),
            known: BTreeMap::new(),
            added: BTreeMap::new(),
            rest: None,
            make: None,
        }
    }

    /// A store of ROS 2 definitions without places, which reads from the disk.
    pub fn empty() -> Self {
        Self::new(Dialect::Ros2, Disk)
    }

    /// A store of the types that this crate has structs for. It reads no files, and knows the same
    /// on a machine without ROS.
    pub fn generated() -> Self {
        Self::of_texts(GENERATED)
    }

    /// A store of ROS 2 definition files that are given by their paths, for instance `std_msgs/msg/Header.msg`, and
    /// their texts. It reads no others.
    pub fn of_texts(files: &[(&str, &str)]) -> Self {
        let files: BTreeMap<PathBuf, String> =
            files.iter().map(|(path, text)| (PathBuf::from(path), (*text).to_owned())).collect();
        let mut store = Self::new(Dialect::Ros2, files);
        store.add_folder(Path::new(""));
        store
    }

    /// Full names of the types of a kind (`msg`, `srv`) that this crate knows and that have this name, whatever its
    /// capital letters, behind their package.
    pub fn names_like(kind: &str, name: &str) -> Vec<String> {
        let all = generated::names().chain(standard_text::names());
        let mut full: Vec<_> = all
            .filter(|(its, _, one)| *its == kind && one.eq_ignore_ascii_case(name))
            .map(|(_, package, name)| format!("{package}/{kind}/{name}"))
            .collect();
        full.sort();
        full.dedup();
        full
    }

    /// A store of ROS 2 definitions that looks where `AMENT_PREFIX_PATH` says.
    pub fn from_environment() -> Self {
        let mut store = Self::new(Dialect::Ros2, Disk);
        store.add_ament_path(&std::env::var_os("AMENT_PREFIX_PATH").unwrap_or_default());
        store
    }

    /// Adds the prefixes of a value of `AMENT_PREFIX_PATH`, the overlay first.
    pub fn add_ament_path(&mut self, prefixes: &OsStr) {
        let prefixes = std::env::split_paths(prefixes).filter(|path| !path.as_os_str().is_empty());
        self.places.extend(prefixes.map(Place::Ament));
    }

    /// Adds a folder with `<package>/msg/<Name>.msg` or `<package>/<Name>.msg` (the same for `srv`
    /// and `action`), or the folder of one package.
    pub fn add_folder(&mut self, folder: &Path) {
        self.places.push(Place::Folder(folder.to_owned()));
    }

    /// Types that no place has are taken from those that this crate has structs for, so that the
    /// common ones need no ROS. A definition that is there and wrong is not passed over.
    #[must_use]
    pub fn or_generated(self) -> Self {
        self.or(Self::generated())
    }

    /// Each type that no place has is taken from `other`, also one that a type found here refers to.
    /// A definition that is there and wrong is not passed over.
    #[must_use]
    pub fn or(mut self, other: Self) -> Self {
        self.rest = Some(Box::new(match self.rest.take() {
            Some(rest) => rest.or(other),
            None => other,
        }));
        self
    }

    /// Makes a type that is found nowhere, also one inside another, from its name with `make`. It is asked each time, so
    /// that what is found later counts.
    #[must_use]
    pub fn or_made(
        mut self,
        make: impl FnMut(&TypeName) -> Option<MessageDefinition> + Send + Sync + 'static,
    ) -> Self {
        self.make = Some(Box::new(make));
        self
    }

    /// Adds the definition of one type, which is used before any file.
    ///
    /// # Errors
    /// When it cannot be parsed, or is too large.
    pub fn add_definition(&mut self, name: &TypeName, text: &str) -> Result<(), ResolveError> {
        ResolveError::check_size(name, text, "split it into several types")?;
        self.parse(name, text, &format!("definition of {name}"))
    }

    /// Adds a type that was found elsewhere, with all it refers to. Types known already stay.
    pub fn add_resolved(&mut self, resolved: &ResolvedType) {
        for (name, definition) in resolved.definitions() {
            if !self.known.contains_key(name) {
                self.added.entry(name.clone()).or_insert_with(|| definition.clone());
            }
        }
    }

    /// Forgets a type that was found elsewhere; one that a file defines is read again.
    pub(crate) fn forget(&mut self, name: &TypeName) {
        self.known.remove(name);
        self.added.remove(name);
    }

    /// Finds a type by its name as text, for instance `sensor_msgs/msg/Image`.
    ///
    /// # Errors
    /// As [`TypeStore::resolve`], and when `name` is no name.
    pub fn resolve_name(&mut self, name: &str) -> Result<ResolvedType, ResolveError> {
        let name = TypeName::parse(self.dialect, name)
            .map_err(|fault| ResolveError::Name { text: name.to_owned(), fault })?;
        self.resolve(&name)
    }

    /// Finds a type and all that it refers to.
    ///
    /// # Errors
    /// When one of them is not found, cannot be read or parsed, contains itself, is nested too
    /// deeply, or when there are too many.
    pub fn resolve(&mut self, name: &TypeName) -> Result<ResolvedType, ResolveError> {
        ResolvedType::collect(self.dialect, name, |wanted, user| self.find(wanted, user))
    }

    /// As [`TypeStore::resolve`], where nothing is made.
    ///
    /// # Errors
    /// As there.
    pub fn resolve_defined(&mut self, name: &TypeName) -> Result<ResolvedType, ResolveError> {
        let make = self.make.take();
        let found = self.resolve(name);
        self.make = make;
        found
    }

    /// As [`TypeStore::resolve_with`], without what was found elsewhere: as files have it.
    pub(crate) fn resolve_here(
        &mut self,
        name: &TypeName,
        part: impl FnMut(&TypeName) -> Option<MessageDefinition>,
    ) -> Result<ResolvedType, ResolveError> {
        let added = std::mem::take(&mut self.added);
        let found = self.resolve_with(name, part);
        self.added = added;
        found
    }

    /// As [`TypeStore::resolve_defined`], where the types inside that are defined nowhere are those that `part` knows.
    ///
    /// # Errors
    /// As there.
    pub fn resolve_with(
        &mut self,
        name: &TypeName,
        mut part: impl FnMut(&TypeName) -> Option<MessageDefinition>,
    ) -> Result<ResolvedType, ResolveError> {
        let make = self.make.take();
        let found = ResolvedType::collect(self.dialect, name, |wanted, user| {
            match self.find(wanted, user) {
                Err(missing @ ResolveError::NotFound { .. }) if user.is_some() => {
                    part(wanted).ok_or(missing)
                }
                found => found,
            }
        });
        self.make = make;
        found
    }

    fn find(
        &mut self,
        name: &TypeName,
        user: Option<&TypeName>,
    ) -> Result<MessageDefinition, ResolveError> {
        let mut looked = Vec::new();
        if !self.known.contains_key(name) && !self.added.contains_key(name) {
            if let Some((text, path)) = self.read_here(name, &mut looked)? {
                self.parse(name, &text, &path.display().to_string())?;
            } else {
                match self.rest.as_mut().map(|rest| rest.find(name, user)) {
                    Some(Err(error)) if !matches!(error, ResolveError::NotFound { .. }) => {
                        return Err(error);
                    }
                    Some(Ok(found)) => return Ok(found),
                    _ => self.known.extend(bundled::definition(name).map(|d| (name.clone(), d))),
                }
            }
        }
        let found = self.known.get(name).or_else(|| self.added.get(name)).cloned();
        found.or_else(|| self.make.as_mut()?(name)).ok_or_else(|| ResolveError::NotFound {
            name: name.clone(),
            user: user.cloned(),
            looked: Looked(looked),
        })
    }

    fn parse(&mut self, name: &TypeName, text: &str, place: &str) -> Result<(), ResolveError> {
        let messages = parse_interface(self.dialect, name, text).map_err(|source| {
            ResolveError::Parse { place: place.to_owned(), source: Box::new(source) }
        })?;
        self.known.extend(messages.into_iter().map(|message| (message.name.clone(), message)));
        Ok(())
    }

    /// Texts that define a type and all it refers to, for those whose file is found: of the type
    /// first, then of the others by name. Types that are made from an interface, such as
    /// `SetBool_Request`, have none of their own (encoding `implicit`).
    ///
    /// # Errors
    /// When a file is there and cannot be read.
    pub fn sources(&self, resolved: &ResolvedType) -> Result<Vec<TypeSource>, ResolveError> {
        let others = resolved.definitions().keys().filter(|name| *name != resolved.name());
        // ROS sorts by the name as text.
        let mut others: Vec<(String, &TypeName)> =
            others.map(|name| (name.to_string(), name)).collect();
        others.sort();
        let own = (resolved.name().to_string(), resolved.name());
        let mut sources = Vec::new();
        for (type_name, name) in std::iter::once(own).chain(others) {
            let (encoding, raw_file_contents) = if name.file_stem() != name.name() {
                ("implicit", String::new())
            } else {
                let Some(text) = self.read(name)? else { continue };
                (name.kind().as_str(), text)
            };
            sources.push(TypeSource {
                type_name,
                encoding: encoding.to_owned(),
                raw_file_contents,
            });
        }
        Ok(sources)
    }

    /// Path of the file that defines a type in a place of this store.
    pub(crate) fn file(&self, name: &TypeName) -> Result<Option<PathBuf>, ResolveError> {
        Ok(self.read_here(name, &mut Vec::new())?.map(|(_, path)| path))
    }

    /// Text of the definition file of a type, here or in the rest.
    fn read(&self, name: &TypeName) -> Result<Option<String>, ResolveError> {
        match (self.read_here(name, &mut Vec::new())?, &self.rest) {
            (Some((text, _)), _) => Ok(Some(text)),
            (None, Some(rest)) if !self.known.contains_key(name) => rest.read(name),
            (None, _) => Ok(None),
        }
    }

    /// Text of the first definition file there is; the others go into `looked`.
    fn read_here(
        &self,
        name: &TypeName,
        looked: &mut Vec<String>,
    ) -> Result<Option<(String, PathBuf)>, ResolveError> {
        for place in &self.places {
            let paths = match place {
                Place::Folder(folder) => paths_below(folder, name),
                Place::Ament(prefix) => match self.ament_path(prefix, name, looked)? {
                    Some(path) => vec![path],
                    None => continue,
                },
            };
            for path in paths {
                match self.read_file(&path)? {
                    Some(text) => return Ok(Some((text, path))),
                    None => looked.push(path.display().to_string()),
                }
            }
        }
        Ok(None)
    }

    /// Path of the definition, where the prefix has the package.
    fn ament_path(
        &self,
        prefix: &Path,
        name: &TypeName,
        looked: &mut Vec<String>,
    ) -> Result<Option<PathBuf>, ResolveError> {
        let share = prefix.join("share");
        let index = share.join("ament_index/resource_index/rosidl_interfaces").join(name.package());
        let Some(listed) = self.read_file(&index)? else {
            looked.push(index.display().to_string());
            return Ok(None);
        };
        let file = file_name(name);
        let kind = name.kind().as_str();
        let lists = |file: &str| listed.lines().any(|line| line.trim() == format!("{kind}/{file}"));
        if !lists(&file) && lists(&format!("{}.idl", name.file_stem())) {
            let listed_in = index.display().to_string();
            return Err(ResolveError::OnlyIdl { name: name.clone(), listed_in });
        }
        Ok(Some(share.join(name.package()).join(kind).join(file)))
    }

    fn read_file(&self, path: &Path) -> Result<Option<String>, ResolveError> {
        match self.files.read(path, MAX_DEFINITION_SIZE) {
            Ok(text) => Ok(Some(text)),
            // A file where a folder should be is as good as none.
            Err(error)
                if matches!(
                    error.kind(),
                    io::ErrorKind::NotFound | io::ErrorKind::NotADirectory
                ) =>
            {
                Ok(None)
            }
            Err(source) => Err(ResolveError::File { path: path.display().to_string(), source }),
        }
    }
}

/// `Image.msg`, `SetBool.srv`, `Fibonacci.action`.
fn file_name(name: &TypeName) -> String {
    format!("{}.{}", name.file_stem(), name.kind().as_str())
}

/// Paths at which the definition can lie in a folder that the user gave.
fn paths_below(folder: &Path, name: &TypeName) -> Vec<PathBuf> {
    let kind: InterfaceKind = name.kind();
    let (package, kind, file) = (Path::new(name.package()), kind.as_str(), file_name(name));
    let mut paths = vec![
        folder.join(package).join(kind).join(&file),
        folder.join(package).join(&file),
        folder.join("share").join(package).join(kind).join(&file),
    ];
    if folder.ends_with(package) {
        paths.push(folder.join(kind).join(&file));
    }
    if folder.ends_with(package) || folder.ends_with(package.join(kind)) {
        paths.push(folder.join(&file));
    }
    paths
}

#[cfg(test)]
mod tests;
