//! Type descriptions as messages carry them.

use std::collections::BTreeMap;

use crate::description::{
    CONTAINER_STEP, FieldDescription, HIDDEN_FIELD, IndividualTypeDescription, MAX_TYPES,
    TypeDescription, primitive_of_id,
};
use crate::parser::{
    Container, DefaultValue, Dialect, Element, Field, MessageDefinition, ParseFault, TypeName,
};
use crate::store::{Looked, ResolveError, ResolvedType};
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

impl ResolvedType {
    /// The type that a node describes, by its name.
    ///
    /// # Errors
    /// When the description is none of a type of ROS 2, lacks a type, or is too large or too deep.
    pub fn from_description(described: &msg::TypeDescription) -> Result<Self, ResolveError> {
        let all = &described.referenced_type_descriptions;
        let mut known = BTreeMap::new();
        for one in all.iter().chain([&described.type_description]).take(MAX_TYPES) {
            let name = named(&one.type_name)?;
            let fields = one.fields.iter().filter(|field| field.name != HIDDEN_FIELD);
            let fields = fields.map(read_field).collect::<Result<_, _>>()?;
            known.insert(name.clone(), MessageDefinition::new(name, fields));
        }
        let looked = Looked(vec!["it among the types that the node describes".to_owned()]);
        Self::among(Dialect::Ros2, &named(&described.type_description.type_name)?, &known, &looked)
    }
}

fn named(text: &str) -> Result<TypeName, ResolveError> {
    TypeName::parse(Dialect::Ros2, text)
        .map_err(|fault| ResolveError::Name { text: text.to_owned(), fault })
}

/// Reads a field; its default value is not needed to read messages.
fn read_field(field: &msg::Field) -> Result<Field, ResolveError> {
    let msg::FieldType { type_id, capacity, string_capacity, nested_type_name } = &field.r#type;
    let bound = |size: u64| u32::try_from(size).unwrap_or(u32::MAX);
    let unknown = || ResolveError::Name {
        text: field.name.clone(),
        fault: ParseFault::TypeName(format!("type_id {type_id}")),
    };
    let element = match type_id % CONTAINER_STEP {
        1 => Element::Nested(named(nested_type_name)?),
        17 => Element::String { bound: None },
        18 => Element::WString { bound: None },
        21 => Element::String { bound: Some(bound(*string_capacity)) },
        22 => Element::WString { bound: Some(bound(*string_capacity)) },
        other => Element::Primitive(primitive_of_id(other).ok_or_else(unknown)?),
    };
    let container = match type_id / CONTAINER_STEP {
        0 => Container::Single,
        1 => Container::Array(bound(*capacity)),
        2 => Container::Sequence { bound: Some(bound(*capacity)) },
        3 => Container::Sequence { bound: None },
        _ => return Err(unknown()),
    };
    Ok(Field::new(&field.name, element, container))
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
            let again = ResolvedType::from_description(&message).unwrap();
            assert_eq!(again.type_hash(), resolved.type_hash(), "{name}");
            assert!(again.plan().is_ok(), "{name}");
        }
    }

    #[test]
    fn a_description_that_makes_no_sense_is_refused() {
        let field = |type_id, nested: &str| msg::Field {
            name: "x".to_owned(),
            r#type: msg::FieldType {
                type_id,
                nested_type_name: nested.to_owned(),
                ..msg::FieldType::default()
            },
            default_value: String::new(),
        };
        let read = |name: &str, field: msg::Field| {
            let one =
                msg::IndividualTypeDescription { type_name: name.to_owned(), fields: vec![field] };
            ResolvedType::from_description(&msg::TypeDescription {
                type_description: one,
                referenced_type_descriptions: Vec::new(),
            })
        };
        assert!(read("demo/msg/A", field(2, "")).is_ok());
        for (name, field) in [
            ("demo/msg/A", field(0, "")),
            ("demo/msg/A", field(255, "")),
            ("demo/msg/A", field(1, "demo/msg/B")),
            ("demo/msg/A", field(1, "demo/msg/A")),
            ("", field(2, "")),
        ] {
            assert!(read(name, field).is_err(), "{name}");
        }
        assert!(ResolvedType::from_description(&msg::TypeDescription::default()).is_err());
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
