//! Target of what others ask a node: its parameter services, type descriptions.

use std::collections::BTreeMap;

use bytes::Bytes;
use wrapyfi_data::types::Stamp;
use wrapyfi_interfaces::Message;
use wrapyfi_interfaces::cdr::CdrParts;
use wrapyfi_interfaces::rcl_interfaces::srv::{
    DescribeParameters_Response, GetParameterTypes_Response, GetParameters_Response,
    ListParameters_Response, SetParameters_Response, SetParametersAtomically_Response,
};
use wrapyfi_interfaces::store::TypeStore;
use wrapyfi_interfaces::type_description_interfaces::srv::{
    GetTypeDescription_Request, GetTypeDescription_Response,
};
use wrapyfi_node::parameters::{ParameterDescriptor, ParameterService, ParameterStore};
use wrapyfi_node::type_description::TypeDescriptions;
use wrapyfi_node::{NodeName, ParameterType, ParameterValue};

use crate::{LIMITS, bounded};

/// Memory for each byte of a request: a name of few characters asks for a descriptor, which is held
/// once as found and once as written.
const REPLY: usize = 256;

/// A node with parameters of some kinds.
fn store() -> ParameterStore {
    let node = NodeName::new("fuzzed", "/").expect("a valid name");
    let mut store = ParameterStore::new(&node, BTreeMap::new()).expect("no overrides");
    let mut declare = |descriptor, value| store.declare(descriptor, value).expect("a new one");
    let named = ParameterDescriptor::new;
    declare(named("i").with_integer_range(0, 10, 2), ParameterValue::Integer(4));
    declare(named("d").with_double_range(0.0, 1.0, 0.0), ParameterValue::Double(0.5));
    declare(named("group.s"), "text".into());
    declare(named("group.sub.l").read_only(), vec!["locked".to_owned()].into());
    declare(named("any").dynamic(), true.into());
    declare(named("b").with_type(ParameterType::ByteArray), ParameterValue::NotSet);
    store
}

/// A request, as CDR, to the service that the first byte names: those of parameters in their order,
/// then the type description.
pub fn node_services(data: &[u8]) {
    let Some((&service, request)) = data.split_first() else { return };
    let request = Bytes::copy_from_slice(request);
    match ParameterService::ALL.get(usize::from(service)) {
        Some(service) => parameters(*service, &request),
        None => type_description(&request),
    }
}

fn parameters(service: ParameterService, request: &Bytes) {
    let mut store = store();
    _ = store.take_events(Stamp::default());
    let reply =
        bounded(request.len(), REPLY, || store.answer(service, request, LIMITS.message_bytes));
    let Ok(reply) = reply else { return };
    let changes = store.take_events(Stamp::default()).len();
    let setter = matches!(service, ParameterService::Set | ParameterService::SetAtomically);
    assert!(setter || changes == 0, "{service:?} changes nothing");
    match service {
        ParameterService::Describe => _ = read::<DescribeParameters_Response>(&reply),
        ParameterService::Get => _ = read::<GetParameters_Response>(&reply),
        ParameterService::GetTypes => _ = read::<GetParameterTypes_Response>(&reply),
        ParameterService::List => _ = read::<ListParameters_Response>(&reply),
        ParameterService::Set => {
            let results = read::<SetParameters_Response>(&reply).results;
            let accepted = results.iter().filter(|result| result.successful).count();
            assert_eq!(accepted, changes, "an event for each that was accepted");
            assert!(results.iter().all(|result| result.successful == result.reason.is_empty()));
        }
        ParameterService::SetAtomically => {
            let result = read::<SetParametersAtomically_Response>(&reply).result;
            assert!(changes <= usize::from(result.successful));
        }
    }
    let value = |name: &str| store.get(name).expect("of static type, so it stays");
    assert!(matches!(value("i"), ParameterValue::Integer(0 | 2 | 4 | 6 | 8 | 10)));
    let ParameterValue::Double(d) = *value("d") else { panic!("d is a number") };
    assert!((-1e-6..1.0 + 1e-5).contains(&d), "{d}");
    assert!(matches!(value("group.s"), ParameterValue::String(_)));
    assert_eq!(*value("group.sub.l"), vec!["locked".to_owned()].into());
    assert_eq!(*value("use_sim_time") == true.into(), *value("use_sim_time") != false.into());
}

fn type_description(request: &Bytes) {
    let mut types = TypeDescriptions::default();
    let string = "std_msgs/msg/String";
    let hash = types.add_named(&mut TypeStore::generated(), string).expect("a known type");
    let reply = bounded(request.len(), REPLY, || {
        let request = GetTypeDescription_Request::decode(request, LIMITS.message_bytes).ok()?;
        Some(types.answer(&request).encode())
    });
    let Some(reply) = reply else { return };
    let reply = read::<GetTypeDescription_Response>(&reply);
    assert_eq!(reply.successful, reply.failure_reason.is_empty());
    let named = reply.type_description.type_description.type_name;
    assert_eq!(named, if reply.successful { string } else { "" });
    // Only who knows the hash is told.
    let knows =
        request.to_ascii_lowercase().windows(64).any(|part| hash.as_bytes().ends_with(part));
    assert!(knows || !reply.successful);
}

fn read<M: Message>(reply: &CdrParts) -> M {
    M::decode(&reply.to_bytes(), usize::MAX).expect("what was written can be read")
}
