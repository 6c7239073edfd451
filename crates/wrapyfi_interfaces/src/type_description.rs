//! Type descriptions as messages carry them.

use crate::description::{FieldDescription, IndividualTypeDescription, TypeDescription};
use crate::parser::DefaultValue;
use crate::type_description_interfaces::msg;

impl From<&TypeDescription> for msg::TypeDescription {
    fn from(description: &TypeDescription) -> Self {
        Self {
            type_description: (&description.type_description).into(),
            referenced_type_descriptions: description
                .referenced_type_descriptions
                .iter()
                .map(msg::IndividualTypeDescription::from)
                .collect(),
        }
    }
}

impl From<&IndividualTypeDescription> for msg::IndividualTypeDescription {
    fn from(description: &IndividualTypeDescription) -> Self {
        Self {
            type_name: description.type_name.clone(),
            fields: description.fields.iter().map(msg::Field::from).collect(),
        }
    }
}

impl From<&FieldDescription> for msg::Field {
    fn from(field: &FieldDescription) -> Self {
        Self {
            name: field.name.clone(),
            r#type: msg::FieldType {
                type_id: field.type_id,
                capacity: field.capacity,
                string_capacity: field.string_capacity,
                nested_type_name: field.nested_type_name.clone(),
            },
            default_value: field.default.as_ref().map(DefaultValue::to_python).unwrap_or_default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Message;
    use crate::store::TypeStore;
    use crate::test_data::{json, store};

    #[test]
    fn messages_say_what_those_of_ros_say() {
        let mut store = store();
        let own = store.resolve_name(msg::TypeDescription::ROS_TYPE).unwrap().plan().unwrap();
        let recorded = json("type_descriptions.json");
        for (name, recorded) in recorded.as_object().unwrap() {
            let resolved = store.resolve_name(name).unwrap();
            let message = msg::TypeDescription::from(resolved.description());
            let cdr = message.encode().to_bytes();
            assert_eq!(own.decode(&cdr, 1 << 20).unwrap().to_json(), *recorded, "{name}");
        }
    }

    #[test]
    fn a_generated_type_is_described_with_its_texts() {
        let mut store = TypeStore::generated();
        let set_bool = store.resolve_name("std_srvs/srv/SetBool").unwrap();
        assert_eq!(set_bool.type_hash(), json("type_hashes.json")["std_srvs/srv/SetBool"]);
        let sources = store.sources(&set_bool).unwrap();
        let kinds: Vec<_> = sources
            .iter()
            .map(|source| (source.type_name.as_str(), source.encoding.as_str()))
            .collect();
        assert_eq!(
            kinds,
            [
                ("std_srvs/srv/SetBool", "srv"),
                ("builtin_interfaces/msg/Time", "msg"),
                ("service_msgs/msg/ServiceEventInfo", "msg"),
                ("std_srvs/srv/SetBool_Event", "implicit"),
                ("std_srvs/srv/SetBool_Request", "implicit"),
                ("std_srvs/srv/SetBool_Response", "implicit"),
            ]
        );
        assert!(sources[0].raw_file_contents.contains("bool data\n---\n"));
        assert!(sources[3].raw_file_contents.is_empty());
        // Of a type whose file is elsewhere the text is not known.
        let other = TypeStore::empty().sources(&set_bool).unwrap();
        assert_eq!(other.len(), 3);
        assert!(store.resolve_name("nav_msgs/msg/Path").is_err());
    }

    #[test]
    fn a_generated_store_knows_every_struct() {
        fn check<M: Message>(store: &mut TypeStore) {
            assert_eq!(store.resolve_name(M::ROS_TYPE).unwrap().type_hash(), M::TYPE_HASH);
        }
        let mut store = TypeStore::generated();
        check::<crate::wrapyfi_msgs::msg::NativeObject>(&mut store);
        check::<crate::wrapyfi_msgs::srv::ImageService_Response>(&mut store);
        check::<crate::wrapyfi_ros2_interfaces::msg::ROS2AudioMessage>(&mut store);
        check::<crate::rcl_interfaces::srv::SetParameters_Event>(&mut store);
        check::<crate::rmw_dds_common::msg::ParticipantEntitiesInfo>(&mut store);
    }
}
