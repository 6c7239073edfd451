//! Messages, requests and replies: read by their definitions, written, and compared.

use bytes::Bytes;
use wrapyfi_interfaces::Message;
use wrapyfi_interfaces::action_msgs::msg::GoalStatusArray;
use wrapyfi_interfaces::action_msgs::srv::{CancelGoal_Request, CancelGoal_Response};
use wrapyfi_interfaces::rcl_interfaces::{msg, srv};
use wrapyfi_interfaces::rmw_dds_common::msg::ParticipantEntitiesInfo;
use wrapyfi_interfaces::std_msgs::msg::String as Text;
use wrapyfi_interfaces::std_srvs::srv::{
    Empty_Request, Empty_Response, SetBool_Request, SetBool_Response,
};
use wrapyfi_interfaces::type_description_interfaces::srv::{
    GetTypeDescription_Request, GetTypeDescription_Response,
};

use super::Record;
use super::definitions::Definitions;
use crate::action::{split_id, with_id};
use crate::names::{self, RosName};
use crate::service_header;
use wrapyfi_data::types::{RosAction, RosMessage};

const MAX_BYTES: usize = 1 << 20;

pub(super) fn check(record: &Record, definitions: &mut Definitions) {
    let Some(payload) = &record.payload else { return check_large(record, definitions) };
    let place = &record.place;
    let Some(resolved) = definitions.on(&record.kind) else {
        panic!("{place}: what {} carries is not known", record.kind)
    };
    let in_service =
        matches!(names::from_dds(&record.kind), RosName::Requests(_) | RosName::Replies(_));
    // CycloneDDS writes the identity before the body, Fast DDS beside it.
    let (identity, body) = match in_service && !record.fast {
        true => {
            let split = service_header::split(payload).unwrap_or_else(|| panic!("{place}"));
            (Some((split.client, split.sequence)), split.cdr)
        }
        false => (None, payload.clone()),
    };
    let plan = resolved.plan().unwrap();
    let read = |cdr: &Bytes| plan.decode(cdr, MAX_BYTES).ok();
    let message = read(&body).unwrap_or_else(|| panic!("{place} is no {}", resolved.name()));
    let written = plan.encode(&message).unwrap().to_bytes();
    reproduces(record, identity, &body, &written, &|cdr| read(cdr).as_ref() == Some(&message));
    let name = resolved.name().to_string();
    check_typed(record, identity, &body, &name);
    check_parts_of_action(&body, definitions, &name);
    if record.kind == "ros_discovery_info" {
        check_nodes(record, &body);
    }
}

/// The same by the generated struct, where there is one.
fn check_typed(record: &Record, identity: Option<(u64, i64)>, body: &Bytes, name: &str) {
    macro_rules! typed {
        ($($message:ty),* $(,)?) => {$(
            if name == <$message>::ROS_TYPE {
                return check_as::<$message>(record, identity, body);
            }
        )*};
    }
    typed!(
        Text,
        msg::Log,
        msg::ParameterEvent,
        ParticipantEntitiesInfo,
        srv::DescribeParameters_Request,
        srv::DescribeParameters_Response,
        srv::GetParameters_Request,
        srv::GetParameters_Response,
        srv::GetParameterTypes_Request,
        srv::GetParameterTypes_Response,
        srv::ListParameters_Request,
        srv::ListParameters_Response,
        srv::SetParameters_Request,
        srv::SetParameters_Response,
        srv::SetParametersAtomically_Request,
        srv::SetParametersAtomically_Response,
        Empty_Request,
        Empty_Response,
        SetBool_Request,
        SetBool_Response,
        GetTypeDescription_Request,
        GetTypeDescription_Response,
        CancelGoal_Request,
        CancelGoal_Response,
        GoalStatusArray,
    );
    assert!(name.starts_with("example_interfaces/"), "{name} has no struct");
}

/// A goal or feedback is taken from the message that carries it, and put into it again.
fn check_parts_of_action(body: &Bytes, definitions: &mut Definitions, name: &str) {
    let action = definitions.part("example_interfaces/action/Fibonacci", "");
    let action = RosAction::new(&action).unwrap();
    let (goal, feedback) = (action.send_goal().request(), action.feedback_message());
    let whole = [(goal, "goal", action.goal()), (feedback, "feedback", action.feedback())];
    for (whole, field, part) in whole.into_iter().filter(|(whole, ..)| whole.name() == name) {
        let message = RosMessage::new(whole, body.clone());
        let (id, own) = split_id(&message, part, MAX_BYTES).unwrap();
        let fields = message.fields(MAX_BYTES).unwrap();
        assert_eq!(own.fields(MAX_BYTES).as_ref().ok(), fields.get(field).unwrap().as_message());
        assert_eq!(with_id(&id, &own, whole), message);
    }
}

fn check_as<M: Message>(record: &Record, identity: Option<(u64, i64)>, body: &Bytes) {
    let read = |cdr: &Bytes| M::decode(cdr, MAX_BYTES).ok();
    let message = read(body).unwrap_or_else(|| panic!("{} is no {}", record.place, M::ROS_TYPE));
    let written = message.encode().to_bytes();
    reproduces(record, identity, body, &written, &|cdr| read(cdr).as_ref() == Some(&message));
}

/// Asserts that the written bytes are the captured ones. `same` says whether a body means the same
/// as the captured one: Fast DDS leaves whatever is in memory between the fields, and only there.
fn reproduces(
    record: &Record,
    identity: Option<(u64, i64)>,
    body: &Bytes,
    written: &Bytes,
    same: &dyn Fn(&Bytes) -> bool,
) {
    let place = &record.place;
    let (end, tail) = body.split_at_checked(written.len()).unwrap_or_else(|| panic!("{place}"));
    assert_eq!(body.len(), written.len().next_multiple_of(4), "{place}: length");
    assert!(tail.iter().all(|&byte| byte == 0), "{place}: the padding at the end");
    for (at, (captured, ours)) in end.iter().zip(written).enumerate() {
        if captured != ours {
            let mut other = body.to_vec();
            other[at] ^= 0xff;
            assert!(record.fast && same(&other.into()), "{place}: byte {at} of {written:02x?}");
        }
    }
    let Some((client, sequence)) = identity else { return };
    let mut room = [0; service_header::HEADER];
    let parts = [&written[..], tail];
    let joined = service_header::join(client, sequence, &parts, &mut room).unwrap().concat();
    assert_eq!(Some(&joined[..]), record.payload.as_deref(), "{place}: with its identity");
}

/// A large message, of which the capture has the first bytes of each piece.
fn check_large(record: &Record, definitions: &mut Definitions) {
    let topic = record.json["topic"].as_str().unwrap_or(&record.kind);
    assert_eq!(topic, "rt/big", "{}: a payload that was not kept", record.place);
    let plan = definitions.part("std_msgs/msg/UInt8MultiArray", "").plan().unwrap();
    let bytes: Vec<u64> = (0..20_000).map(|n| n % 251).collect();
    let json = serde_json::json!({ "data": bytes });
    let message = plan.from_json(&json, MAX_BYTES).unwrap();
    let written = plan.encode(&message).unwrap().to_bytes();
    let number = |value: &serde_json::Value| usize::try_from(value.as_u64().unwrap()).unwrap();
    let size = number(&record.json["payload_len"]);
    let (begin, total) = match record.json["frag"].as_object() {
        Some(piece) => {
            ((number(&piece["first"]) - 1) * number(&piece["size"]), number(&piece["sample_size"]))
        }
        None => (0, size),
    };
    assert_eq!(written.len(), total);
    let first = super::unhex(record.text("payload_hex_first_64"));
    assert_eq!(written[begin..begin + first.len()], first);
    assert!(begin + size <= total);
}

/// The nodes in an announcement are those that were there.
fn check_nodes(record: &Record, body: &Bytes) {
    let info = ParticipantEntitiesInfo::decode(body, MAX_BYTES).unwrap();
    let decoded = &record.json["decoded"];
    assert_eq!(info.gid.data, super::gid(decoded["gid"].as_str().unwrap()));
    let nodes = decoded["node_entities_info_seq"].as_array().unwrap();
    assert_eq!(info.node_entities_info_seq.len(), nodes.len());
    for (node, expected) in info.node_entities_info_seq.iter().zip(nodes) {
        assert_eq!(node.node_name, expected["node_name"].as_str().unwrap());
        assert_eq!(node.node_namespace, expected["node_namespace"].as_str().unwrap());
        for (gids, key) in
            [(&node.reader_gid_seq, "reader_gid_seq"), (&node.writer_gid_seq, "writer_gid_seq")]
        {
            let expected: Vec<[u8; 16]> = expected[key]
                .as_array()
                .unwrap()
                .iter()
                .map(|one| super::gid(one["gid"].as_str().unwrap()))
                .collect();
            assert_eq!(gids.iter().map(|gid| gid.data).collect::<Vec<_>>(), expected);
        }
    }
}
