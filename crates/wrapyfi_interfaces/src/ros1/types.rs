//! Definitions and plans by name: what peers showed, what folders have, what can be made.
//!
//! ```text
//!   ROS 1 definition   shown by a peer ─▶ folder of .msg files ─▶ standard ─▶ made from ROS 2
//!   ROS 2 definition   ament index, folder ─▶ standard ─▶ made from ROS 1
//! ```
//!
//! Each type is looked for along that line by itself, also one that is a field of another.

use std::collections::BTreeMap;
use std::ffi::OsStr;

use super::definition::{Definition, parse_name};
use super::error::{DefinitionError, PairError};
use super::names::{is_allowed_in_ros2, is_service_part};
use super::plan::PairPlan;
use super::rules::Rules;
use super::{derive, standard};
use crate::parser::{Dialect, InterfaceKind, MessageDefinition, TypeName};
use crate::store::{Disk, Looked, ResolveError, ResolvedType, TypeStore};

/// Most types whose definitions are remembered from peers.
const MAX_ANNOUNCED: usize = 4096;
/// Most definitions of one type that are remembered from peers.
const MAX_VERSIONS: usize = 8;

/// Digits of a checksum.
const MD5_DIGITS: usize = 32;

/// All that is known of types in both ROS.
///
/// ```
/// use wrapyfi_interfaces::ros1::{Rules, Types};
/// use wrapyfi_interfaces::store::TypeStore;
/// let mut types = Types::new(Rules::built_in(), TypeStore::empty());
/// let joints = types.definition("sensor_msgs/JointState").unwrap();
/// assert_eq!(joints.md5sum, "3066dcd76a6cfaef579bd0f34173e9fd");
/// let plan = types.plan(&joints).unwrap();
/// assert_eq!(plan.ros2_type().to_string(), "sensor_msgs/msg/JointState");
/// ```
#[derive(Debug)]
pub struct Types {
    rules: Rules,
    /// Definitions that publishers have shown, the last one last.
    pub(super) announced: BTreeMap<TypeName, Vec<Definition>>,
    /// Names that ROS 2 forbids, of types that were met, by those that the types have there.
    renamed: BTreeMap<TypeName, Vec<TypeName>>,
    pub(super) ros1: TypeStore,
    ros2: TypeStore,
}

impl Types {
    /// Types of ROS 2 as `ros2` finds them, and no folders of ROS 1.
    pub fn new(rules: Rules, ros2: TypeStore) -> Self {
        Self {
            rules,
            announced: BTreeMap::new(),
            renamed: BTreeMap::new(),
            ros1: TypeStore::new(Dialect::Ros1, Disk).or(standard::ros1()),
            ros2: ros2.or(standard::ros2()),
        }
    }

    /// Looks where `AMENT_PREFIX_PATH` and `ROS_PACKAGE_PATH` say.
    pub fn from_environment(rules: Rules) -> Self {
        let mut types = Self::new(rules, TypeStore::from_environment());
        types.add_ros1_path(&std::env::var_os("ROS_PACKAGE_PATH").unwrap_or_default());
        types
    }

    /// Adds folders of ROS 1 packages: a value of `ROS_PACKAGE_PATH`, or one folder.
    pub fn add_ros1_path(&mut self, folders: &OsStr) {
        for folder in std::env::split_paths(folders).filter(|path| !path.as_os_str().is_empty()) {
            self.ros1.add_folder(&folder);
        }
    }

    /// Takes over a type of ROS 2 that was found elsewhere, such as in a folder of a program's own.
    pub fn add_ros2(&mut self, resolved: &ResolvedType) {
        self.ros2.add_resolved(resolved);
    }

    /// The rules.
    pub fn rules(&self) -> &Rules {
        &self.rules
    }

    /// Takes what a publisher shows in its connection header, `type`, `md5sum` and `message_definition`, and
    /// remembers it for those that the type is to be published to. The last one shown under a name
    /// counts. A text that is not that of the checksum, for instance an empty one, gives way to a definition
    /// from elsewhere that is; a checksum of `*` fits any.
    ///
    /// # Errors
    /// As [`Definition::from_header`], and when no definition has the checksum: nothing is remembered
    /// then.
    pub fn show(
        &mut self,
        type_name: &str,
        md5sum: &str,
        text: &str,
    ) -> Result<Definition, DefinitionError> {
        let name = parse_name(InterfaceKind::Message, type_name)?;
        let fits = |definition: &Definition| md5sum == "*" || definition.md5sum == md5sum;
        let error = match Definition::from_header(type_name, text) {
            Ok(definition) if fits(&definition) => {
                self.remember(name, &definition);
                return Ok(definition);
            }
            Ok(definition) => DefinitionError::Checksum {
                name: name.clone(),
                claimed: md5sum.chars().take(MD5_DIGITS).collect(),
                computed: definition.md5sum,
            },
            Err(error) => error,
        };
        // A folder may have an older one than the standard.
        let stored = [&mut self.ros1, &mut standard::ros1()]
            .map(|store| Definition::from_store(store, &name).ok());
        let exact = stored.into_iter().flatten().find(|definition| definition.md5sum == md5sum);
        exact.ok_or(error)
    }

    /// Remembers what a publisher shows. Nodes that were built from different versions may show several.
    fn remember(&mut self, name: TypeName, definition: &Definition) {
        let before = self.announced.get(&name).and_then(|all| all.last()).cloned();
        let is_full = self.announced.len() >= MAX_ANNOUNCED && before.is_none();
        if before.as_ref() == Some(definition) || is_full {
            return;
        }
        let all = self.announced.entry(name).or_default();
        all.retain(|known| known != definition);
        if all.len() >= MAX_VERSIONS {
            all.remove(0);
        }
        all.push(definition.clone());
        self.forget_made(before.iter().chain([definition]));
        self.note_names(definition.resolved.definitions().keys());
        self.note_action(definition);
    }

    /// Notes names that ROS 2 forbids, so that the types are found again by those that they have there.
    pub(super) fn note_names<'n>(&mut self, names: impl IntoIterator<Item = &'n TypeName>) {
        for name in names.into_iter().filter(|name| !is_allowed_in_ros2(name)) {
            for ros2 in self.rules.ros2_names(name) {
                if self.renamed.len() < MAX_ANNOUNCED || self.renamed.contains_key(&ros2) {
                    let all = self.renamed.entry(ros2).or_default();
                    if !all.contains(name) && all.len() < MAX_VERSIONS {
                        all.push(name.clone());
                    }
                }
            }
        }
    }

    /// Names that a ROS 2 type may have in ROS 1, the likeliest first, with those that ROS 2 forbids.
    pub(super) fn ros1_names(&self, ros2: &TypeName) -> Vec<TypeName> {
        let Self { rules, announced, renamed, .. } = self;
        ros1_names(rules, announced, renamed, ros2)
    }

    /// Forgets the types of ROS 2 that may have been made of these definitions: what their publisher shows has changed.
    fn forget_made<'d>(&mut self, shown: impl Iterator<Item = &'d Definition>) {
        for name in shown.flat_map(|definition| definition.resolved.definitions().keys()) {
            self.rules.ros2_names(name).iter().for_each(|ros2| self.ros2.forget(ros2));
            self.ros1.forget(name);
        }
    }

    /// The ROS 1 definition of a message, by its ROS 1 name `package/Type`.
    ///
    /// # Errors
    /// [`DefinitionError::Unknown`] where it is not known yet; it may be shown later.
    pub fn definition(&mut self, type_name: &str) -> Result<Definition, DefinitionError> {
        let name = parse_name(InterfaceKind::Message, type_name)?;
        let found = self.definition_of(&name)?;
        self.note_names(found.resolved.definitions().keys());
        Ok(found)
    }

    pub(super) fn definition_of(&mut self, name: &TypeName) -> Result<Definition, DefinitionError> {
        self.definition_or(name, Self::made_for_ros1)
    }

    /// The ROS 1 definition of a message; one that nobody has is what `make` gives.
    pub(super) fn definition_or(
        &mut self,
        name: &TypeName,
        make: impl FnOnce(&mut Self, &TypeName) -> Result<ResolvedType, DefinitionError>,
    ) -> Result<Definition, DefinitionError> {
        if let Some(shown) = self.shown(name) {
            return Ok(shown);
        }
        match self.found_for_ros1(name, Definition::from_store) {
            Err(DefinitionError::Resolve(error)) if is_missing(&error, name) => {
                Definition::new(make(self, name)?, &BTreeMap::new())
            }
            found => found,
        }
    }

    /// Definition that a publisher has shown, of its own type or of one inside.
    fn shown(&self, name: &TypeName) -> Option<Definition> {
        if let Some(announced) = self.announced.get(name).and_then(|all| all.last()) {
            return Some(announced.clone());
        }
        let has_it = |one: &&Definition| one.resolved.definitions().contains_key(name);
        let mut last_of_each = self.announced.values().filter_map(|all| all.last());
        let inside = last_of_each.find(has_it)?.resolved.definitions();
        let part = ResolvedType::among(Dialect::Ros1, name, inside, &Looked::default()).ok()?;
        Definition::new(part, &BTreeMap::new()).ok()
    }

    /// Asks the store of ROS 1, and again once a type inside is made that only ROS 2 has.
    pub(super) fn found_for_ros1<T>(
        &mut self,
        name: &TypeName,
        from_store: impl Fn(&mut TypeStore, &TypeName) -> Result<T, DefinitionError>,
    ) -> Result<T, DefinitionError> {
        loop {
            let found = from_store(&mut self.ros1, name);
            let Err(DefinitionError::Resolve(ResolveError::NotFound { name: missing, .. })) =
                &found
            else {
                return found;
            };
            let made = if missing == name { None } else { self.found_elsewhere(missing) };
            match made {
                Some(made) => self.ros1.add_resolved(&made),
                // The missing type is named in the error.
                None => return found,
            }
        }
    }

    /// A ROS 1 type that no folder has: shown by a publisher, else made from ROS 2.
    fn found_elsewhere(&mut self, name: &TypeName) -> Option<ResolvedType> {
        let shown = self.shown(name).map(|shown| shown.resolved);
        shown.or_else(|| self.made_for_ros1(name).ok())
    }

    /// Makes a ROS 1 type from that of ROS 2.
    pub(super) fn made_for_ros1(
        &mut self,
        name: &TypeName,
    ) -> Result<ResolvedType, DefinitionError> {
        let mut looked = Vec::new();
        note_looked(self.ros1.resolve(name), &mut looked);
        for ros2 in self.rules.ros2_names(name) {
            match self.ros2.resolve(&ros2) {
                Ok(ros2) => return Ok(self.derived_for_ros1(&ros2, name)?),
                Err(error) if is_missing(&error, &ros2) => note_looked(Err(error), &mut looked),
                Err(error) => return Err(error.into()),
            }
        }
        Err(DefinitionError::Unknown { name: name.clone(), looked: Looked(looked) })
    }

    /// Makes the ROS 1 type `name` from one of ROS 2. Types inside that ROS 1 has stay as they are there.
    pub(super) fn derived_for_ros1(
        &mut self,
        ros2: &ResolvedType,
        name: &TypeName,
    ) -> Result<ResolvedType, ResolveError> {
        let Self { rules, announced, renamed, ros1, .. } = self;
        let names = |ros2: &TypeName| ros1_names(rules, announced, renamed, ros2);
        let find = |wanted: &TypeName| {
            let last_of_each = announced.values().filter_map(|all| all.last());
            let mut shown = last_of_each.map(|one| one.resolved.definitions());
            let own = announced.get(wanted).and_then(|all| all.last()?.resolved.definition());
            let shown = own.or_else(|| shown.find_map(|inside| inside.get(wanted)));
            shown.cloned().or_else(|| ros1.resolve(wanted).ok()?.definition().cloned())
        };
        derive::to_ros1(ros2, name, names, find)
    }

    /// The ROS 2 type that a ROS 1 type becomes: as installed, else made from it. An installed one
    /// that cannot be used is passed over: the ROS 1 type is known. What was made of another definition of the type
    /// does not count, so that nodes that were built from different versions of it each have theirs.
    ///
    /// # Errors
    /// When none can be made from it.
    pub fn ros2_type(&mut self, ros1: &ResolvedType) -> Result<ResolvedType, ResolveError> {
        for name in self.rules.ros2_names(ros1.name()) {
            if let Ok(Some(found)) = self.installed(&name, &BTreeMap::new()) {
                return Ok(found);
            }
        }
        self.made_for_ros2(ros1, &derive::name_in_ros2(ros1.name(), &self.rules))
    }

    /// A ROS 2 type by name, also one that no ROS 2 is installed for, where ROS 1 has it. One that is
    /// installed and cannot be used is passed over where a publisher has shown it.
    ///
    /// # Errors
    /// When neither has it, or a definition is there and cannot be used.
    pub fn ros2_type_named(&mut self, name: &TypeName) -> Result<ResolvedType, PairError> {
        let unusable = match self.ros2_known(name) {
            Ok(Some(found)) => return Ok(found),
            Ok(None) => None,
            Err(error) => Some(error),
        };
        if name.kind() == InterfaceKind::Message && !is_service_part(name) {
            for ros1 in self.ros1_names(name) {
                if unusable.is_some() && !self.announced.contains_key(&ros1) {
                    continue;
                }
                match self.definition_of(&ros1) {
                    Ok(ros1) => return Ok(self.made_for_ros2(&ros1.resolved, name)?),
                    Err(DefinitionError::Unknown { .. }) => {}
                    Err(error) => return Err(error.into()),
                }
            }
        }
        match unusable {
            Some(error) => Err(error.into()),
            None => Ok(self.ros2.resolve(name)?),
        }
    }

    /// A type of ROS 2 that is installed, or standard. Of the types inside it, those that only ROS 1
    /// has are made from there.
    pub(super) fn ros2_known(
        &mut self,
        name: &TypeName,
    ) -> Result<Option<ResolvedType>, ResolveError> {
        loop {
            match self.ros2.resolve(name) {
                Ok(found) => return Ok(Some(found)),
                Err(error) if is_missing(&error, name) => return Ok(None),
                Err(ResolveError::NotFound { name: missing, user, looked }) => {
                    match self.made_from_ros1(&missing) {
                        Some(made) => self.ros2.add_resolved(&made),
                        None => {
                            return Err(ResolveError::NotFound { name: missing, user, looked });
                        }
                    }
                }
                Err(error) => return Err(error),
            }
        }
    }

    fn made_from_ros1(&mut self, name: &TypeName) -> Option<ResolvedType> {
        self.ros1_names(name).iter().find_map(|ros1| {
            let ros1 = self.definition_of(ros1).ok()?;
            self.made_for_ros2(&ros1.resolved, name).ok()
        })
    }

    pub(super) fn made_for_ros2(
        &mut self,
        ros1: &ResolvedType,
        name: &TypeName,
    ) -> Result<ResolvedType, ResolveError> {
        let Self { rules, ros2, .. } = self;
        let find =
            |wanted: &TypeName| ros2.resolve_here(wanted, |_part| None).ok()?.definition().cloned();
        derive::to_ros2(ros1, name, rules, find)
    }

    /// A type of ROS 2 that is installed, or standard. Of the types inside it, those that are not are the ones in `inside`,
    /// else as in [`Types::ros2_known`].
    pub(super) fn installed(
        &mut self,
        name: &TypeName,
        inside: &BTreeMap<TypeName, MessageDefinition>,
    ) -> Result<Option<ResolvedType>, ResolveError> {
        match self.ros2.resolve_here(name, |part| inside.get(part).cloned()) {
            Ok(found) => Ok(Some(found)),
            Err(error) if is_missing(&error, name) => Ok(None),
            Err(_) => self.ros2_known(name),
        }
    }

    /// The plan for a ROS 1 message and the ROS 2 type it becomes.
    ///
    /// # Errors
    /// As [`Types::ros2_type`] and [`PairPlan::compile`].
    pub fn plan(&mut self, ros1: &Definition) -> Result<PairPlan, PairError> {
        let ros2 = self.ros2_type(&ros1.resolved)?;
        PairPlan::compile(&ros1.resolved, &ros2, &self.rules)
    }

    /// The first ROS 1 name of a ROS 2 type that has a definition.
    pub(super) fn likeliest<T>(
        &mut self,
        ros2: &TypeName,
        mut get: impl FnMut(&mut Self, &TypeName) -> Result<T, DefinitionError>,
    ) -> Result<T, DefinitionError> {
        let mut first = None;
        for name in self.ros1_names(ros2) {
            match get(self, &name) {
                Err(error @ DefinitionError::Unknown { .. }) => first = first.or(Some(error)),
                got => return got,
            }
        }
        Err(first.unwrap_or_else(|| DefinitionError::Kind {
            name: ros2.clone(),
            expected: "type of ROS 1",
        }))
    }
}

/// Names of `ros2` by rule. Those that ROS 2 forbids come before the same name, under which a definition can always be
/// made, unless a publisher has shown that.
fn ros1_names(
    rules: &Rules,
    announced: &BTreeMap<TypeName, Vec<Definition>>,
    renamed: &BTreeMap<TypeName, Vec<TypeName>>,
    ros2: &TypeName,
) -> Vec<TypeName> {
    let mut names = rules.ros1_names(ros2);
    let forbidden = renamed.get(ros2).into_iter().flatten();
    let forbidden: Vec<_> = forbidden.filter(|name| !names.contains(name)).cloned().collect();
    let same = names.iter().position(|name| name == ros2 && !announced.contains_key(name));
    let at = same.unwrap_or(names.len());
    names.splice(at..at, forbidden);
    names
}

/// True when the missing type is `name` itself.
pub(super) fn is_missing(error: &ResolveError, name: &TypeName) -> bool {
    matches!(error, ResolveError::NotFound { name: missing, .. } if missing == name)
}

/// Adds the places where something was not found.
fn note_looked(found: Result<ResolvedType, ResolveError>, places: &mut Vec<String>) {
    if let Err(ResolveError::NotFound { looked: Looked(looked), .. }) = found {
        places.extend(looked);
    }
}
