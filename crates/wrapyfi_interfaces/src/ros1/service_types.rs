//! Services of ROS 1 and what they become in ROS 2, where no ROS 2 is installed for them; and the way back.
//!
//! ```text
//!   demo/Measure ─ definition of the server's checksum ─ request, response ─ made for ROS 2 ─▶ demo/srv/Measure
//! ```

use std::collections::BTreeMap;

use super::definition::{ServiceDefinition, parse_name};
use super::error::{DefinitionError, PairError};
use super::plan::PairPlan;
use super::types::{Types, is_missing};
use crate::parser::{Dialect, InterfaceKind, TypeName, service_messages};
use crate::store::{Looked, ResolvedType, TypeStore};

impl Types {
    /// Names that a service of ROS 1 may have in ROS 2, given by its ROS 1 name `package/Type`, the likeliest first.
    ///
    /// # Errors
    /// When it is no name.
    pub fn ros2_service_names(&self, type_name: &str) -> Result<Vec<TypeName>, DefinitionError> {
        Ok(self.rules().ros2_names(&parse_name(InterfaceKind::Service, type_name)?))
    }

    /// The ROS 1 definition of a service, by its ROS 1 name `package/Type`. ROS 1 servers do not show theirs, but its
    /// checksum: of the definitions that are known of the types inside, those of that `md5sum` count.
    ///
    /// # Errors
    /// As [`Types::definition`].
    pub fn service_definition(
        &mut self,
        type_name: &str,
        md5sum: Option<&str>,
    ) -> Result<ServiceDefinition, DefinitionError> {
        let name = parse_name(InterfaceKind::Service, type_name)?;
        let found = self.service_found(&name, None)?;
        self.note_names([&name].into_iter().chain(found.1.definitions().keys()));
        Ok(self.fitting(found, true, |one| md5sum.is_none_or(|md5sum| one.md5sum == md5sum)))
    }

    /// The definition of a service of ROS 1 that a service of ROS 2, which is at hand, most likely has there, and the plans
    /// of requests and responses: of the server whose checksum is `md5sum`, else the one that loses no field.
    ///
    /// # Errors
    /// As [`Types::service_definition`] and [`PairPlan::compile`].
    pub fn service_counterpart(
        &mut self,
        ros2: &ResolvedType,
        md5sum: Option<&str>,
    ) -> Result<(ServiceDefinition, [PairPlan; 2]), PairError> {
        let rules = self.rules().clone();
        let plans = |one: &ServiceDefinition| {
            let no_service =
                || DefinitionError::Kind { name: ros2.name().clone(), expected: "service" };
            let plan = |ros1: &ResolvedType, suffix| {
                PairPlan::compile(ros1, &ros2.part(suffix).ok_or_else(no_service)?, &rules)
            };
            Ok::<_, PairError>([plan(&one.request, "_Request")?, plan(&one.response, "_Response")?])
        };
        let found =
            self.likeliest(ros2.name(), |types, name| types.service_found(name, Some(ros2)))?;
        let definition = self.fitting(found, md5sum.is_some(), |one| match md5sum {
            Some(md5sum) => one.md5sum == md5sum,
            None => plans(one).is_ok_and(|plans| plans.iter().all(PairPlan::is_whole)),
        });
        let plans = plans(&definition)?;
        Ok((definition, plans))
    }

    /// A service of ROS 1, with the type that it is of. One that nobody has is made of that of ROS 2, where that is
    /// `at_hand`.
    fn service_found(
        &mut self,
        name: &TypeName,
        at_hand: Option<&ResolvedType>,
    ) -> Result<(ServiceDefinition, ResolvedType), DefinitionError> {
        let from_store = |store: &mut TypeStore, name: &TypeName| {
            Ok::<_, DefinitionError>((
                ServiceDefinition::from_store(store, name)?,
                store.resolve(name)?,
            ))
        };
        match self.found_for_ros1(name, from_store) {
            Err(DefinitionError::Resolve(error)) if is_missing(&error, name) => {
                let made = match at_hand {
                    Some(ros2) => self.derived_for_ros1(ros2, name)?,
                    None => self.made_for_ros1(name)?,
                };
                Ok((ServiceDefinition::new(&made, &BTreeMap::new())?, made))
            }
            found => found,
        }
    }

    /// The first of a service's definitions that fits, of those that [`Types::variants`] gives; where none does, the one
    /// that was found.
    fn fitting(
        &mut self,
        (found, resolved): (ServiceDefinition, ResolvedType),
        all: bool,
        fits: impl Fn(&ServiceDefinition) -> bool,
    ) -> ServiceDefinition {
        if fits(&found) {
            return found;
        }
        let variants = self.variants(&resolved, all).into_iter();
        let mut variants =
            variants.filter_map(|one| ServiceDefinition::new(&one, &BTreeMap::new()).ok());
        variants.find(fits).unwrap_or(found)
    }

    /// The ROS 2 service for one of ROS 1, given by its ROS 1 name `package/Type` and the checksum that its server tells:
    /// as installed, else made from it.
    ///
    /// # Errors
    /// As [`Types::service_definition`], and when a definition is there and cannot be used.
    pub fn ros2_service(
        &mut self,
        type_name: &str,
        md5sum: Option<&str>,
    ) -> Result<ResolvedType, PairError> {
        let definition = self.service_definition(type_name, md5sum)?;
        let names = self.rules().ros2_names(&definition.name);
        let name = names.first().unwrap_or(&definition.name).clone();
        let mut known = BTreeMap::new();
        let mut part = |ros1, suffix| {
            let part = self.made_for_ros2(ros1, &name.derived(suffix))?;
            known.extend(part.definitions().clone());
            let definition = part.definition().cloned();
            definition
                .ok_or_else(|| DefinitionError::Kind { name: name.clone(), expected: "service" })
        };
        let request = part(&definition.request, "_Request");
        let response = part(&definition.response, "_Response");
        for name in &names {
            if let Some(found) = self.installed(name, &known)? {
                return Ok(found);
            }
        }
        let messages = service_messages(&name, request?, response?).into_iter();
        known.extend(messages.map(|message| (message.name.clone(), message)));
        Ok(ResolvedType::among(Dialect::Ros2, &name, &known, &Looked::default())?)
    }
}

#[cfg(test)]
mod tests {
    use std::ffi::OsStr;

    use super::super::Rules;
    use super::*;
    use crate::store::TypeStore;

    #[test]
    fn a_service_of_a_ros_1_package_becomes_one_of_ros_2() {
        let folder = std::env::temp_dir().join(format!("wrapyfi-srv-{}", std::process::id()));
        let (messages, services) = (folder.join("demo/msg"), folder.join("demo/srv"));
        std::fs::create_dir_all(&messages).unwrap();
        std::fs::create_dir_all(&services).unwrap();
        std::fs::write(folder.join("demo/package.xml"), "<package><name>demo</name></package>")
            .unwrap();
        std::fs::write(messages.join("Pose.msg"), "time stamp\nfloat64[3] at\n").unwrap();
        std::fs::write(
            services.join("Measure.srv"),
            "uint8 FAST=1\nstring what\n---\nPose[] poses\ntime when\n",
        )
        .unwrap();
        let mut types = Types::new(Rules::built_in(), TypeStore::empty());
        types.add_ros1_path(OsStr::new(folder.as_os_str()));
        let made = types.ros2_service("demo/Measure", None).unwrap();
        std::fs::remove_dir_all(&folder).unwrap();
        assert_eq!(made.name().to_string(), "demo/srv/Measure");
        let response = made.part("_Response").unwrap();
        let fields = &response.definition().unwrap().fields;
        let names: Vec<&str> = fields.iter().map(|field| field.name.as_str()).collect();
        assert_eq!(names, ["poses", "when"]);
        assert!(made.part("_Request").unwrap().plan().is_ok());
        assert!(types.ros2_service("demo/None", None).is_err());
    }

    #[test]
    fn a_standard_service_needs_no_package() {
        let mut types = Types::new(Rules::built_in(), TypeStore::empty());
        let made = types.ros2_service("std_srvs/SetBool", None).unwrap();
        assert_eq!(made.name().to_string(), "std_srvs/srv/SetBool");
        assert!(made.part("_Request").is_some());
    }
}
