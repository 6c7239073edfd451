//! The ROS 2 service that a service of ROS 1 becomes, where no ROS 2 is installed for it.
//!
//! ```text
//!   demo/Measure ─ request, response ─ made for ROS 2 ─▶ demo/srv/Measure
//! ```

use std::collections::BTreeMap;

use super::definition::parse_name;
use super::error::{DefinitionError, PairError};
use super::types::Types;
use crate::parser::{Dialect, InterfaceKind, TypeName, service_messages};
use crate::store::{Looked, ResolvedType};

impl Types {
    /// Names that a service of ROS 1 may have in ROS 2, given by its ROS 1 name `package/Type`, the likeliest first.
    ///
    /// # Errors
    /// When it is no name.
    pub fn ros2_service_names(&self, type_name: &str) -> Result<Vec<TypeName>, DefinitionError> {
        Ok(self.rules().ros2_names(&parse_name(InterfaceKind::Service, type_name)?))
    }

    /// The ROS 2 service for one of ROS 1, given by its ROS 1 name `package/Type`: as installed, else
    /// made from it.
    ///
    /// # Errors
    /// As [`Types::service_definition`], and when a definition is there and cannot be used.
    pub fn ros2_service(&mut self, type_name: &str) -> Result<ResolvedType, PairError> {
        let definition = self.service_definition(type_name)?;
        let names = self.rules().ros2_names(&definition.name);
        for name in &names {
            if let Some(found) = self.ros2_known(name)? {
                return Ok(found);
            }
        }
        let name = names.first().unwrap_or(&definition.name).clone();
        let mut known = BTreeMap::new();
        let mut part = |ros1, suffix| {
            let part = self.made_for_ros2(ros1, &name.derived(suffix))?;
            known.extend(part.definitions().clone());
            let definition = part.definition().cloned();
            definition
                .ok_or_else(|| DefinitionError::Kind { name: name.clone(), expected: "service" })
        };
        let request = part(&definition.request, "_Request")?;
        let response = part(&definition.response, "_Response")?;
        let messages = service_messages(&name, request, response).into_iter();
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
        let made = types.ros2_service("demo/Measure").unwrap();
        std::fs::remove_dir_all(&folder).unwrap();
        assert_eq!(made.name().to_string(), "demo/srv/Measure");
        let response = made.part("_Response").unwrap();
        let fields = &response.definition().unwrap().fields;
        let names: Vec<&str> = fields.iter().map(|field| field.name.as_str()).collect();
        assert_eq!(names, ["poses", "when"]);
        assert!(made.part("_Request").unwrap().plan().is_ok());
        assert!(types.ros2_service("demo/None").is_err());
    }

    #[test]
    fn a_standard_service_needs_no_package() {
        let mut types = Types::new(Rules::built_in(), TypeStore::empty());
        let made = types.ros2_service("std_srvs/SetBool").unwrap();
        assert_eq!(made.name().to_string(), "std_srvs/srv/SetBool");
        assert!(made.part("_Request").is_some());
    }
}
