//! Announcements of participants and endpoints: names, types, USER_DATA, and departures.

use super::definitions::Definitions;
use super::{Record, list_of, parameters};
use crate::dds_terms::{ENCLAVE, end_user_data, type_hash, user_data};
use crate::graph::TopicDescription;
use crate::names::{self, RosName};
use wrapyfi_endpoint::Qos;

const TOPIC_NAME: u16 = 0x0005;
const TYPE_NAME: u16 = 0x0007;
const USER_DATA: u16 = 0x002c;
const PARTICIPANT_GUID: u16 = 0x0050;
const ENDPOINT_GUID: u16 = 0x005a;
const KEY_HASH: u16 = 0x0070;
const STATUS_INFO: u16 = 0x0071;

/// True when a writer of discovery sent the record.
pub(super) fn is_discovery(record: &Record) -> bool {
    ["SPDP_", "SEDP_"].iter().any(|prefix| record.kind.starts_with(prefix))
}

pub(super) fn check(record: &Record, definitions: &mut Definitions) {
    let place = &record.place;
    let payload = record.payload.as_deref().unwrap();
    if record.kind.ends_with(" dispose") {
        return check_removal(record, payload);
    }
    let list = payload.strip_prefix(&[0, 3, 0, 0]).unwrap_or_else(|| panic!("{place}: PL_CDR_LE"));
    let found = parameters(list);
    assert_eq!(list_of(&found), list, "{place}");
    let value = |id: u16| found.iter().find(|(known, _)| *known == id).map(|(_, value)| &value[..]);
    // A length, and as many bytes.
    let counted = |id: u16| {
        let value = value(id).unwrap_or_else(|| panic!("{place}: no {id:#06x}"));
        let (size, bytes) = value.split_first_chunk::<4>().unwrap();
        &bytes[..usize::try_from(u32::from_le_bytes(*size)).unwrap()]
    };
    let said = counted(USER_DATA);
    assert_eq!(said, record.text("user_data").as_bytes(), "{place}");
    if record.kind == "SPDP_W" {
        // Fast DDS counts the NUL.
        let text = if record.fast { said.strip_suffix(b"\0").unwrap() } else { said };
        assert_eq!(text, ENCLAVE.as_bytes(), "{place}");
        return;
    }
    let text = |id: u16| {
        let bytes = counted(id).strip_suffix(b"\0").unwrap();
        std::str::from_utf8(bytes).unwrap().to_owned()
    };
    let (topic, dds_type) = (text(TOPIC_NAME), text(TYPE_NAME));
    assert_eq!((&*topic, &*dds_type), (record.text("topic_name"), record.text("type_name")));
    check_names(&topic, &dds_type);
    let hash = definitions.named(&dds_type).type_hash();
    assert_eq!(type_hash(said).as_ref(), Some(&hash), "{place}");
    assert_eq!(written(record, said, &topic, &hash).as_bytes(), said, "{place}");
}

/// DDS names are read as ROS names, and made of them again.
fn check_names(topic: &str, dds_type: &str) {
    let service = || names::service_type_from_dds(dds_type).unwrap();
    match names::from_dds(topic) {
        RosName::Topic(name) => {
            assert_eq!(names::topic_to_dds(name), topic);
            let ros = names::type_from_dds(dds_type).unwrap();
            assert_eq!(names::type_to_dds(&ros).unwrap(), dds_type);
        }
        RosName::Requests(name) => {
            let names = names::service_to_dds(name, &service()).unwrap();
            assert_eq!(names.requests, (topic.to_owned(), dds_type.to_owned()));
        }
        RosName::Replies(name) => {
            let names = names::service_to_dds(name, &service()).unwrap();
            assert_eq!(names.replies, (topic.to_owned(), dds_type.to_owned()));
        }
        RosName::Dds(name) => assert_eq!(name, "ros_discovery_info"),
    }
}

/// USER_DATA as our own endpoint with this type would have it.
fn written(record: &Record, said: &[u8], topic: &str, hash: &str) -> String {
    let said = std::str::from_utf8(said).unwrap();
    for key in ["serviceid", "clientid"] {
        let Some(id) = said.strip_prefix(&format!("{key}= ")) else { continue };
        let (id, _) = id.split_once(';').unwrap();
        // The last four are a number that counts the ends of the process.
        let number = id.rsplit('.').take(4).enumerate().fold(0, |sum, (place, digits)| {
            sum | u32::from_str_radix(digits, 16).unwrap() << (8 * place)
        });
        assert_eq!(names::end_id(&record.writer(), number), id);
        return end_user_data(key, id, Some(hash), None);
    }
    user_data(&TopicDescription {
        name: topic.to_owned(),
        type_name: String::new(),
        type_hash: Some(hash.to_owned()),
        qos: Qos::default(),
        max_bytes: 0,
        hears_own: false,
    })
}

/// Asserts that a departure names its endpoint: by CycloneDDS in the payload, by Fast DDS in the
/// inline QoS.
fn check_removal(record: &Record, payload: &[u8]) {
    let place = &record.place;
    let inline = parameters(&record.inline_qos);
    assert_eq!(list_of(&inline), record.inline_qos, "{place}");
    assert!(inline.contains(&(STATUS_INFO, vec![0, 0, 0, 3])), "{place}: disposed, unregistered");
    let named = if record.fast {
        assert!(payload.is_empty(), "{place}");
        inline
    } else {
        let list = payload.strip_prefix(&[0, 3, 0, 0]).unwrap();
        let found = parameters(list);
        assert_eq!(list_of(&found), list, "{place}");
        found
    };
    let ids = [KEY_HASH, ENDPOINT_GUID, PARTICIPANT_GUID];
    let guid = named.iter().find(|(id, _)| ids.contains(id)).map(|(_, value)| &value[..]);
    let guid = guid.unwrap_or_else(|| panic!("{place}: who has left"));
    assert_eq!((guid.len(), &guid[..12]), (16, &record.writer()[..12]), "{place}");
}
