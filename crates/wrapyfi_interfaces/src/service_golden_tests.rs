//! Messages and services of a node against what ROS 2 and Wrapyfi serialised (`tests/data`).

use std::collections::{BTreeMap, BTreeSet};

use bytes::Bytes;
use serde_json::Value;

use crate::store::TypeStore;
use crate::test_data::{json as data, path, unhex};
use crate::{Message, Service};

/// Properties of a generated message that can be told without its type.
struct Generated {
    dds_type: &'static str,
    hash: &'static str,
    min_size: usize,
    default: fn() -> Bytes,
    again: fn(&Bytes) -> Bytes,
}

fn message<M: Message>(all: &mut BTreeMap<&'static str, Generated>) {
    let generated = Generated {
        dds_type: M::DDS_TYPE,
        hash: M::TYPE_HASH,
        min_size: M::MIN_SIZE,
        default: || M::default().encode().to_bytes(),
        again: |cdr| M::decode(cdr, 1 << 20).unwrap().encode().to_bytes(),
    };
    assert!(all.insert(M::ROS_TYPE, generated).is_none(), "{} twice", M::ROS_TYPE);
}

/// Messages by name, and the hashes of services.
#[derive(Default)]
struct All {
    messages: BTreeMap<&'static str, Generated>,
    services: BTreeMap<&'static str, &'static str>,
}

impl All {
    fn service<S: Service>(&mut self) {
        message::<S::Request>(&mut self.messages);
        message::<S::Response>(&mut self.messages);
        message::<S::Event>(&mut self.messages);
        for (part, suffix) in [
            (S::Request::ROS_TYPE, "_Request"),
            (S::Response::ROS_TYPE, "_Response"),
            (S::Event::ROS_TYPE, "_Event"),
        ] {
            assert_eq!(part, format!("{}{suffix}", S::ROS_TYPE));
        }
        assert!(self.services.insert(S::ROS_TYPE, S::TYPE_HASH).is_none());
    }
}

macro_rules! all {
    ([$($message:path),* $(,)?], [$($service:path),* $(,)?]) => {{
        let mut all = All::default();
        $(message::<$message>(&mut all.messages);)*
        $(all.service::<$service>();)*
        all
    }};
}

fn of_ros() -> All {
    use crate::{
        rcl_interfaces, rosgraph_msgs, service_msgs, std_srvs, type_description_interfaces,
    };
    use rcl_interfaces::{msg, srv};
    use type_description_interfaces::{msg as types, srv as type_services};
    all!(
        [
            msg::FloatingPointRange,
            msg::IntegerRange,
            msg::ListParametersResult,
            msg::Log,
            msg::LoggerLevel,
            msg::Parameter,
            msg::ParameterDescriptor,
            msg::ParameterEvent,
            msg::ParameterEventDescriptors,
            msg::ParameterType,
            msg::ParameterValue,
            msg::SetLoggerLevelsResult,
            msg::SetParametersResult,
            types::Field,
            types::FieldType,
            types::IndividualTypeDescription,
            types::KeyValue,
            types::TypeDescription,
            types::TypeSource,
            rosgraph_msgs::msg::Clock,
            service_msgs::msg::ServiceEventInfo,
        ],
        [
            srv::DescribeParameters,
            srv::GetLoggerLevels,
            srv::GetParameterTypes,
            srv::GetParameters,
            srv::ListParameters,
            srv::SetLoggerLevels,
            srv::SetParameters,
            srv::SetParametersAtomically,
            type_services::GetTypeDescription,
            std_srvs::srv::Empty,
            std_srvs::srv::SetBool,
            std_srvs::srv::Trigger,
        ]
    )
}

fn of_wrapyfi() -> All {
    use crate::wrapyfi_ros2_interfaces::srv;
    all!(
        [],
        [
            srv::ROS2NativeObjectService,
            srv::ROS2ImageService,
            srv::ROS2CompressedImageService,
            srv::ROS2AudioService,
        ]
    )
}

fn check_hashes(all: &All, hashes: &Value) {
    for (name, message) in &all.messages {
        assert_eq!(hashes[name], message.hash, "{name}");
        let (package, rest) = name.split_once('/').unwrap();
        let (kind, name) = rest.split_once('/').unwrap();
        assert_eq!(message.dds_type, format!("{package}::{kind}::dds_::{name}_"));
    }
    for (name, hash) in &all.services {
        assert_eq!(hashes[name], *hash, "{name}");
    }
}

#[test]
fn hashes_are_those_of_ros_and_of_wrapyfi() {
    let all = of_ros();
    assert_eq!((all.messages.len(), all.services.len()), (21 + 3 * 12, 12));
    check_hashes(&all, &data("type_hashes.json"));
    let all = of_wrapyfi();
    assert_eq!((all.messages.len(), all.services.len()), (3 * 4, 4));
    let recorded = data("wrapyfi_services.json");
    check_hashes(&all, &recorded["hashes"]);
    assert_eq!(recorded["hashes"].as_object().unwrap().len(), 4 * 4);
}

#[test]
fn recorded_messages_encode_to_their_bytes_again() {
    let all = of_ros();
    let mut seen = BTreeSet::new();
    for package in [
        "rcl_interfaces",
        "type_description_interfaces",
        "rosgraph_msgs",
        "service_msgs",
        "std_srvs",
    ] {
        let cases = data(&format!("cdr/{package}.json"));
        for case in cases.as_array().unwrap() {
            let name = case["type"].as_str().unwrap();
            let label = format!("{name} {}", case["case"]);
            let message = all.messages.get(name).unwrap_or_else(|| panic!("no struct for {name}"));
            let cyclone = Bytes::from(unhex(case["hex"].as_str().unwrap()));
            assert_eq!((message.again)(&cyclone), cyclone, "{label}");
            assert!(cyclone.len() >= 4 + message.min_size, "{label}");
            if case["case"] == "default" {
                assert_eq!((message.default)(), cyclone, "{label}");
            }
            // Fast DDS leaves garbage in the padding and behind the message.
            if let Some(fast) = case["hex_rmw_fastrtps_cpp"].as_str() {
                assert_eq!((message.again)(&Bytes::from(unhex(fast))), cyclone, "{label}");
            }
            seen.insert(name.to_owned());
        }
    }
    let missing: Vec<_> = all.messages.keys().filter(|name| !seen.contains(**name)).collect();
    assert!(missing.is_empty(), "{missing:?}");
}

#[test]
fn requests_and_responses_of_wrapyfi_encode_to_their_bytes_again() {
    use crate::wrapyfi_ros2_interfaces::srv::{
        ROS2AudioService_Response, ROS2ImageService_Response, ROS2NativeObjectService_Request,
    };
    let all = of_wrapyfi();
    let recorded = data("wrapyfi_services.json");
    let cases = recorded["cases"].as_array().unwrap();
    let types: BTreeSet<_> = cases.iter().map(|case| case["type"].as_str().unwrap()).collect();
    assert_eq!(types.len(), 2 * 4);
    for case in cases {
        let name = case["type"].as_str().unwrap();
        let cdr = Bytes::from(unhex(case["hex"].as_str().unwrap()));
        let again = (all.messages[name].again)(&cdr);
        if case["rmw"] == "rmw_cyclonedds_cpp" {
            assert_eq!(again, cdr, "{case}");
        }
        assert_eq!((all.messages[name].again)(&again), again, "{case}");
        let values = &case["values"];
        match name.rsplit('/').next().unwrap() {
            "ROS2NativeObjectService_Request" => {
                let request = ROS2NativeObjectService_Request::decode(&cdr, 1 << 20).unwrap();
                assert_eq!(request.request, values["request"]);
            }
            "ROS2ImageService_Response" => {
                let image = ROS2ImageService_Response::decode(&cdr, 1 << 20).unwrap().response;
                assert_eq!(image.encoding, values["response"]["encoding"]);
                assert_eq!(image.step, values["response"]["step"]);
            }
            "ROS2AudioService_Response" => {
                let audio = ROS2AudioService_Response::decode(&cdr, 1 << 20).unwrap().response;
                assert_eq!(audio.sample_rate, values["response"]["sample_rate"]);
            }
            _ => {}
        }
    }
}

#[test]
fn our_services_are_what_a_store_reads_from_the_same_files() {
    use crate::wrapyfi_msgs::srv::{AudioService, ImageService, NativeObjectService};
    let mut store = TypeStore::empty();
    store.add_folder(&path("../../interfaces"));
    store.add_folder(&path("../../wrapyfi_msgs"));
    let mut check = |name: &str, hash: &str| {
        assert_eq!(store.resolve_name(name).unwrap().type_hash(), hash, "{name}");
    };
    fn each<S: Service>(check: &mut dyn FnMut(&str, &str)) {
        check(S::ROS_TYPE, S::TYPE_HASH);
        check(S::Request::ROS_TYPE, S::Request::TYPE_HASH);
        check(S::Response::ROS_TYPE, S::Response::TYPE_HASH);
        check(S::Event::ROS_TYPE, S::Event::TYPE_HASH);
    }
    each::<NativeObjectService>(&mut check);
    each::<ImageService>(&mut check);
    each::<AudioService>(&mut check);
}

#[test]
fn constants_have_the_numbers_of_ros() {
    use crate::rcl_interfaces::{msg, srv};
    use crate::type_description_interfaces::msg::FieldType;
    assert_eq!(msg::ParameterType::PARAMETER_STRING_ARRAY, 9);
    assert_eq!((msg::Log::DEBUG, msg::Log::FATAL), (10, 50));
    assert_eq!(srv::ListParameters_Request::DEPTH_RECURSIVE, 0);
    assert_eq!(FieldType::FIELD_TYPE_STRING, 17);
    assert_eq!(FieldType::FIELD_TYPE_NESTED_TYPE_UNBOUNDED_SEQUENCE, 145);
    assert_eq!(crate::service_msgs::msg::ServiceEventInfo::RESPONSE_RECEIVED, 3);
}
