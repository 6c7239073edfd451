//! The parameters of one node.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use wrapyfi_interfaces::rcl_interfaces::msg::{ListParametersResult, ParameterEvent};

use super::event::{Changes, PendingEvents};
use super::from_outside::override_for;
use super::watch::Watches;
use super::{
    DeclareError, GetError, MAX_NAME_BYTES, MAX_PARAMETERS, Parameter, ParameterDescriptor,
    ParameterWatch, SHOWN, SetError, list,
};
use crate::{NODE_SWITCHES, NodeName, ParameterType, ParameterValue};
use wrapyfi_data::types::Stamp;
use wrapyfi_endpoint::Wake;

/// The parameters of one node, as `ros2 param` sees them.
///
/// ```
/// use std::collections::BTreeMap;
/// use wrapyfi_endpoint::Wake;
/// use wrapyfi_node::parameters::{ParameterDescriptor, ParameterStore};
/// use wrapyfi_node::{NodeName, ParameterValue};
///
/// // As `-p camera.rate:=30` gives them.
/// let overrides = BTreeMap::from([("camera.rate".to_owned(), ParameterValue::Integer(30))]);
/// let mut store = ParameterStore::new(&NodeName::new("camera", "/robot")?, overrides)?;
/// let rate = ParameterDescriptor::new("camera.rate").with_integer_range(1, 60, 1);
/// assert_eq!(store.declare(rate, 10)?, ParameterValue::Integer(30));
///
/// let wake = Wake::new();
/// let watch = store.watch(&["camera"], &wake);
/// store.set("camera.rate", 15)?;
/// assert_eq!(watch.take()[0].value, ParameterValue::Integer(15));
/// let error = store.set("camera.rate", 99).unwrap_err().to_string();
/// assert_eq!(error, "Parameter camera.rate out of range. Min: 1, Max: 60, value: 99");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct ParameterStore {
    /// Fully qualified name of the node.
    node: String,
    overrides: BTreeMap<String, ParameterValue>,
    declared: BTreeMap<String, Declared>,
    /// Number of parameters that were ever declared.
    ordinal: u64,
    watches: Watches,
    events: PendingEvents,
}

struct Declared {
    /// Place in the order of declaration.
    ordinal: u64,
    descriptor: ParameterDescriptor,
    value: ParameterValue,
}

impl ParameterStore {
    /// The parameters of a node that has declared only `use_sim_time` (false) and
    /// `start_type_description_service` (true, read-only), as every node does.
    /// `overrides` are the parameters of the command line
    /// ([`NodeOptions::parameters`](crate::NodeOptions)).
    ///
    /// # Errors
    /// When an override of one of the two is neither `true` nor `false`.
    pub fn new(
        node: &NodeName,
        overrides: BTreeMap<String, ParameterValue>,
    ) -> Result<Self, DeclareError> {
        let mut store = Self { overrides, ..Self::of_other(node.fqn()) };
        let [use_sim_time, type_descriptions] = NODE_SWITCHES;
        store.declare(ParameterDescriptor::new(use_sim_time), false)?;
        let service = ParameterDescriptor::new(type_descriptions)
            .with_description("Whether the node answers ~/get_type_description.")
            .read_only();
        store.declare(service, true)?;
        Ok(store)
    }

    /// The parameters of a node that another program has, none of which is known yet: it tells them
    /// ([`become_these`](Self::become_these)). Its name may be none of ROS 2.
    pub fn of_other(node: impl Into<String>) -> Self {
        Self {
            node: node.into(),
            overrides: BTreeMap::new(),
            declared: BTreeMap::new(),
            ordinal: 0,
            watches: Watches::default(),
            events: PendingEvents::default(),
        }
    }

    /// Has these parameters and no others, as the program says to which they belong; one event tells
    /// what came, changed and went. A range that does not hold the value is left out. Returns the faults of
    /// those that cannot be, and of those whose range was left out.
    ///
    /// ```
    /// use wrapyfi_node::parameters::{ParameterDescriptor, ParameterStore};
    /// let mut store = ParameterStore::of_other("/camera-1");
    /// let gain = ParameterDescriptor::new("gain").with_double_range(0.0, 4.0, 0.0);
    /// assert!(store.become_these([(gain, 2.5.into())]).is_empty());
    /// assert_eq!(store.names().collect::<Vec<_>>(), ["gain"]);
    /// ```
    pub fn become_these(
        &mut self,
        all: impl IntoIterator<Item = (ParameterDescriptor, ParameterValue)>,
    ) -> Vec<DeclareError> {
        let mut before = std::mem::take(&mut self.declared);
        let (mut changes, mut faults) = (Changes::default(), Vec::new());
        for (mut descriptor, value) in all {
            if let Err(fault) = self.check_name(&descriptor.name) {
                faults.push(fault);
                continue;
            }
            if descriptor.parameter_type == ParameterType::NotSet {
                descriptor.parameter_type = value.parameter_type();
            }
            if let Err(fault) = descriptor.check(&value) {
                let name = descriptor.name.clone();
                descriptor.range = None;
                let is_other = descriptor.check(&value).is_err();
                faults.push(DeclareError::Default(name, fault));
                if is_other {
                    continue;
                }
            }
            descriptor.parameter_type = value.parameter_type();
            let known = before.remove(&descriptor.name);
            let parameter = || Parameter { name: descriptor.name.clone(), value: value.clone() };
            match &known {
                None => changes.new.push(parameter()),
                Some(known) if known.value != value => changes.changed.push(parameter()),
                Some(_) => {}
            }
            let ordinal = known.map_or(self.ordinal, |known| known.ordinal);
            self.ordinal = self.ordinal.saturating_add(1);
            let name = descriptor.name.clone();
            self.declared.insert(name, Declared { ordinal, descriptor, value });
        }
        let gone = |name| Parameter { name, value: ParameterValue::NotSet };
        changes.deleted = before.into_keys().map(gone).collect();
        self.publish(changes);
        faults
    }

    /// Declares a parameter with the value of the command line, or else `default`, and returns that
    /// value.
    ///
    /// # Errors
    /// When name or type cannot be used, the name is declared already, or the value is not allowed.
    pub fn declare(
        &mut self,
        mut descriptor: ParameterDescriptor,
        default: impl Into<ParameterValue>,
    ) -> Result<ParameterValue, DeclareError> {
        let default = default.into();
        self.check_name(&descriptor.name)?;
        let name = descriptor.name.clone();
        let found = default.parameter_type();
        match (descriptor.parameter_type, found) {
            (ParameterType::NotSet, ParameterType::NotSet) if !descriptor.dynamic_typing => {
                return Err(DeclareError::Unfit(format!(
                    "parameter {name} has no type; give a default value, a type, or dynamic typing"
                )));
            }
            (ParameterType::NotSet, _) => descriptor.parameter_type = found,
            (expected, found) if found != ParameterType::NotSet && found != expected => {
                return Err(DeclareError::Unfit(format!(
                    "parameter {name} is declared as {expected}, but its default value is {found}"
                )));
            }
            _ => {}
        }
        if let Some(range) = descriptor.range.map(|range| range.parameter_type())
            && !descriptor.dynamic_typing
            && range != descriptor.parameter_type
        {
            let found = descriptor.parameter_type;
            return Err(DeclareError::Unfit(format!(
                "parameter {name} is {found}, but its range is one of {range}"
            )));
        }
        let (value, overridden) = match self.overrides.get(&name) {
            Some(value) => (override_for(&descriptor, value)?, true),
            None => (default, false),
        };
        // A typed parameter may wait for its value.
        if value != ParameterValue::NotSet {
            descriptor.check(&value).map_err(|source| match overridden {
                true => DeclareError::Override(name.clone(), source),
                false => DeclareError::Default(name.clone(), source),
            })?;
        }
        if descriptor.dynamic_typing {
            descriptor.parameter_type = value.parameter_type();
        }
        let declared = Declared { ordinal: self.ordinal, descriptor, value: value.clone() };
        self.ordinal = self.ordinal.saturating_add(1);
        self.declared.insert(name.clone(), declared);
        if value != ParameterValue::NotSet {
            let new = vec![Parameter { name, value: value.clone() }];
            self.publish(Changes { new, ..Changes::default() });
        }
        Ok(value)
    }

    fn check_name(&self, name: &str) -> Result<(), DeclareError> {
        let start: String = name.chars().take(SHOWN).collect();
        Err(DeclareError::Unfit(match name.len() {
            0 => "a parameter has an empty name; give it one".to_owned(),
            length if length > MAX_NAME_BYTES => format!(
                "the parameter name {start:?}… has {length} bytes, the limit is {MAX_NAME_BYTES}; \
                 shorten it"
            ),
            _ if name.contains('\0') => {
                format!("the parameter name {name:?} contains a NUL; leave it out")
            }
            _ if self.declared.contains_key(name) => {
                return Err(DeclareError::AlreadyDeclared(name.to_owned()));
            }
            _ if self.declared.len() >= MAX_PARAMETERS => format!(
                "parameter {name} is one too many: a node has at most {MAX_PARAMETERS}; use lists \
                 instead"
            ),
            _ => return Ok(()),
        }))
    }

    /// Value of a parameter.
    ///
    /// # Errors
    /// When no parameter of this name is declared, or it has no value.
    pub fn get(&self, name: &str) -> Result<&ParameterValue, GetError> {
        match self.declared.get(name) {
            None => Err(GetError::NotDeclared(name.to_owned())),
            // A parameter of dynamic type may have no value.
            Some(Declared { value: ParameterValue::NotSet, descriptor, .. })
                if !descriptor.dynamic_typing =>
            {
                Err(GetError::NotInitialized(name.to_owned()))
            }
            Some(declared) => Ok(&declared.value),
        }
    }

    /// Description of a parameter, where it is declared.
    pub fn describe(&self, name: &str) -> Option<&ParameterDescriptor> {
        self.declared.get(name).map(|declared| &declared.descriptor)
    }

    /// Type of a parameter's value, where it is declared.
    pub fn type_of(&self, name: &str) -> Option<ParameterType> {
        self.declared.get(name).map(|declared| declared.value.parameter_type())
    }

    /// Names of all parameters in the order of declaration.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        let mut names: Vec<(u64, &str)> =
            self.declared.iter().map(|(name, one)| (one.ordinal, name.as_str())).collect();
        names.sort_unstable();
        names.into_iter().map(|(_, name)| name)
    }

    /// Names at most `depth` names deep below the groups `prefixes`, and their groups; 0 is any
    /// depth, no prefix is all.
    pub fn list(&self, prefixes: &[String], depth: u64) -> ListParametersResult {
        list::list(self.names(), prefixes, depth)
    }

    /// Parameters that were given from outside and are not declared: perhaps misspelt.
    pub fn unused_overrides(&self) -> impl Iterator<Item = (&str, &ParameterValue)> {
        self.overrides
            .iter()
            .filter(|(name, _)| !self.declared.contains_key(*name))
            .map(|(name, value)| (name.as_str(), value))
    }

    /// Values given from outside, by name.
    pub fn overrides(&self) -> &BTreeMap<String, ParameterValue> {
        &self.overrides
    }

    /// Sets a parameter.
    ///
    /// # Errors
    /// When it is not declared, read-only, or may not have the value.
    pub fn set(&mut self, name: &str, value: impl Into<ParameterValue>) -> Result<(), SetError> {
        self.set_atomically(vec![Parameter::new(name, value)])
    }

    /// Sets all of these parameters or none of them.
    ///
    /// # Errors
    /// The first that is not declared; if all are, the first that is read-only or may not have its
    /// value.
    pub fn set_atomically(&mut self, parameters: Vec<Parameter>) -> Result<(), SetError> {
        self.set_all(parameters, false)
    }

    /// Sets a parameter as its own node, which may set what is read-only for others.
    ///
    /// # Errors
    /// When it is not declared, or may not have the value.
    pub fn set_own(
        &mut self,
        name: &str,
        value: impl Into<ParameterValue>,
    ) -> Result<(), SetError> {
        self.set_all(vec![Parameter::new(name, value)], true)
    }

    /// Checks that a parameter may be set so, apart from others.
    ///
    /// # Errors
    /// When it is not declared, read-only, or may not have the value.
    pub fn check(&self, parameter: &Parameter) -> Result<(), SetError> {
        self.check_set(parameter, false)
    }

    fn check_set(
        &self,
        Parameter { name, value }: &Parameter,
        is_own: bool,
    ) -> Result<(), SetError> {
        let declared = self.declared.get(name);
        let descriptor = &declared.ok_or_else(|| SetError::NotDeclared(name.clone()))?.descriptor;
        if descriptor.read_only && !is_own {
            return Err(SetError::ReadOnly(name.clone()));
        }
        descriptor.check(value)
    }

    fn set_all(&mut self, parameters: Vec<Parameter>, is_own: bool) -> Result<(), SetError> {
        let (count, limit) = (parameters.len(), MAX_PARAMETERS);
        if count > limit {
            return Err(SetError::TooMany { count, limit });
        }
        let mut names = BTreeSet::new();
        for Parameter { name, .. } in &parameters {
            if !self.declared.contains_key(name) {
                return Err(SetError::NotDeclared(name.clone()));
            }
            if !names.insert(name) {
                return Err(SetError::Twice(name.clone()));
            }
        }
        parameters.iter().try_for_each(|one| self.check_set(one, is_own))?;
        let mut changes = Changes::default();
        for parameter in parameters {
            let Some(declared) = self.declared.get_mut(&parameter.name) else { continue };
            let before = std::mem::replace(&mut declared.value, parameter.value.clone());
            if declared.descriptor.dynamic_typing {
                declared.descriptor.parameter_type = parameter.value.parameter_type();
            }
            if parameter.value == ParameterValue::NotSet {
                self.declared.remove(&parameter.name);
                changes.deleted.push(parameter);
            } else if before == ParameterValue::NotSet {
                changes.new.push(parameter);
            } else {
                changes.changed.push(parameter);
            }
        }
        self.publish(changes);
        Ok(())
    }

    /// Watches parameters and groups by name, all where none is given. `wake` is rung after each
    /// change.
    #[must_use]
    pub fn watch(&mut self, names: &[&str], wake: &Wake) -> ParameterWatch {
        self.watches.add(names, wake)
    }

    fn publish(&mut self, changes: Changes) {
        if changes.all().next().is_none() {
            return;
        }
        self.watches.tell(&changes);
        self.events.push(changes);
    }

    /// Events since the last call that are to be published on `/parameter_events`, oldest first.
    #[must_use]
    pub fn take_events(&mut self, stamp: Stamp) -> Vec<ParameterEvent> {
        self.events.take(&self.node, stamp)
    }
}

impl fmt::Debug for ParameterStore {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ParameterStore")
            .field("node", &self.node)
            .field("parameters", &self.names().collect::<Vec<_>>())
            .finish_non_exhaustive()
    }
}
