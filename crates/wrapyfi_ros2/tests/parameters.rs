//! Parameters of one node, read, set and watched by another over loopback.

use std::time::{Duration, Instant};

use wrapyfi_data::types::{MessageType, ParameterValue, Payload, Properties};
use wrapyfi_endpoint::{
    Absent, Cause, Context, DropReason, Listener, Middleware as _, PublishError, Role, TopicSpec,
    Wake,
};
use wrapyfi_node::parameters::ParameterDescriptor;
use wrapyfi_ros2::graph::wait_until;
use wrapyfi_ros2::{ParameterClient, ParameterClientError, RemoteParameters, ServiceOptions};

use crate::common::{TIMEOUT, far_config, near_config};
use crate::node_common::{Asking, Offering, pair};

fn options() -> ServiceOptions {
    ServiceOptions { timeout: TIMEOUT, ..ServiceOptions::default() }
}

fn client(asking: &Asking) -> ParameterClient {
    ParameterClient::open(&asking.ros2, &asking.asked, &options(), &Wake::new()).unwrap()
}

fn remote(asking: &Asking, wake: &Wake) -> RemoteParameters {
    RemoteParameters::watch(&asking.ros2, &asking.asked, &options(), wake).unwrap()
}

/// The next change.
fn next(remote: &mut RemoteParameters, wake: &Wake) -> Properties {
    let mut taken = None;
    assert!(wait_until(wake, TIMEOUT, || {
        taken = remote.take(Instant::now()).unwrap();
        taken.is_some()
    }));
    taken.unwrap()
}

fn shown(properties: &Properties) -> Vec<String> {
    properties.iter().map(|(name, value)| format!("{name}={value}")).collect()
}

/// Parameters that an [`Offering`] has at first.
const ALL: [&str; 5] = [
    "use_sim_time=false",
    "start_type_description_service=true",
    "rate=10",
    "serial=A1",
    "lens.label=left",
];

fn read_and_set(asking: &Asking) {
    let mut client = client(asking);
    let names = ["use_sim_time", "start_type_description_service", "rate", "serial", "lens.label"];
    assert_eq!(client.list().unwrap(), names);
    assert_eq!(shown(&client.get(&names).unwrap()), ALL);
    assert_eq!(shown(&client.get(&["serial", "rate"]).unwrap()), ["serial=A1", "rate=10"]);
    let error = client.get(&["rate", "none", "nothing"]).unwrap_err();
    assert_eq!(
        error,
        ParameterClientError::NotDeclared {
            node: asking.asked.clone(),
            names: vec!["none".into(), "nothing".into()]
        }
    );
    client.set(&Properties::from([("rate", 20_i64)])).unwrap();
    let several = Properties::from_iter([
        ("rate", ParameterValue::from(61_i64)),
        ("lens.label", "right".into()),
        ("serial", "B2".into()),
    ]);
    let text = client.set(&several).unwrap_err().to_string();
    let expected = format!(
        "node {} refused 2 of 3 parameters: rate: Parameter rate out of range. Min: 1, Max: 60, \
         value: 61; serial: Trying to set a read-only parameter: serial.",
        asking.asked
    );
    assert_eq!(text, expected);
    assert_eq!(
        shown(&client.get(&["rate", "lens.label"]).unwrap()),
        ["rate=20", "lens.label=right"]
    );
}

#[test]
fn parameters_are_read_and_set() {
    let (offering, asking) = pair();
    read_and_set(&asking);
    let handle = offering.node.handle();
    handle.parameters(|store| {
        store.declare(ParameterDescriptor::new("ids"), vec![1_i64]).unwrap();
        let waiting = ParameterDescriptor::new("waiting");
        let kind = wrapyfi_data::types::ParameterType::Double;
        store.declare(waiting.with_type(kind), ParameterValue::NotSet).unwrap();
        store.declare(ParameterDescriptor::new("loose").dynamic(), 1).unwrap();
    });
    let mut client = client(&asking);
    // An empty list says nothing of its type: the node does.
    client.set(&Properties::from([("ids", Vec::<String>::new())])).unwrap();
    assert_eq!(client.get(&["ids"]).unwrap().get("ids"), Some(&Vec::<i64>::new().into()));
    // One without a value does not hide the others.
    let values = client.get(&["rate", "waiting", "ids"]).unwrap();
    assert_eq!(shown(&values), ["rate=20", "waiting=not set", "ids=[]"]);
    client.set(&Properties::from([("loose", ParameterValue::NotSet)])).unwrap();
    assert!(!client.list().unwrap().contains(&"loose".to_owned()));
}

#[test]
fn a_node_that_is_not_there_is_said_so() {
    let (_offering, asking) = pair();
    let short = ServiceOptions { timeout: Duration::from_millis(50), ..options() };
    let mut nobody = ParameterClient::open(&asking.ros2, "nobody", &short, &Wake::new()).unwrap();
    let error = nobody.list().unwrap_err();
    assert!(matches!(error, ParameterClientError::Absent { .. }), "{error}");
    let text = error.to_string();
    assert!(text.starts_with("there is no node /robot/nobody with parameters"), "{text}");
    assert!(text.contains("/robot/nobody/list_parameters within 50 ms"), "{text}");
    let invalid = ParameterClient::open(&asking.ros2, "/a b", &short, &Wake::new()).map(drop);
    assert!(matches!(invalid, Err(ParameterClientError::Name { .. })));
}

#[test]
fn changes_are_told_and_a_restart_is_noticed() {
    let (offering, asking) = pair();
    let wake = Wake::new();
    let mut remote = remote(&asking, &wake);
    assert_eq!(shown(&next(&mut remote, &wake)), ALL);
    let handle = offering.node.handle().clone();
    // Until the topic of events is matched, which is volatile, changes are not heard.
    let mut rate = 10;
    let mut heard = None;
    assert!(wait_until(&wake, TIMEOUT, || {
        rate = rate % 60 + 1;
        handle.parameters(|store| store.set("rate", rate)).unwrap();
        heard = remote.take(Instant::now()).unwrap();
        heard.is_some()
    }));
    handle
        .parameters(|store| store.declare(ParameterDescriptor::new("late").dynamic(), 1.5))
        .unwrap();
    let mut seen = Properties::new();
    while seen.get("late").is_none() {
        seen.apply(&next(&mut remote, &wake));
    }
    assert_eq!(seen.get("late"), Some(&1.5.into()));
    handle.parameters(|store| store.set("late", ParameterValue::NotSet)).unwrap();
    assert_eq!(shown(&next(&mut remote, &wake)), ["late=not set"]);
    handle.parameters(|store| store.declare(ParameterDescriptor::new("old"), 1)).unwrap();
    assert_eq!(shown(&next(&mut remote, &wake)), ["old=1"]);
    drop(offering);
    assert!(wait_until(&wake, TIMEOUT, || {
        assert_eq!(remote.take(Instant::now()).unwrap(), None);
        !remote.follows()
    }));
    assert_eq!(remote.known().get("old"), Some(&1_i64.into()));
    let again = Offering::new(&near_config("camera"));
    let changes = next(&mut remote, &wake);
    assert_eq!(changes.get("old"), Some(&ParameterValue::NotSet), "{changes:?}");
    assert_eq!(changes.get("serial"), None, "it is what it was");
    assert_eq!(shown(remote.known()), ALL);
    // A restart between two looks is noticed too.
    let handle = again.node.handle().clone();
    let mut rate = 10;
    assert!(wait_until(&wake, TIMEOUT, || {
        rate = rate % 60 + 1;
        handle.parameters(|store| store.set("rate", rate)).unwrap();
        remote.take(Instant::now()).unwrap().is_some_and(|changes| changes.get("rate").is_some())
    }));
    handle.parameters(|store| store.set("rate", 60)).unwrap();
    while remote.known().get("rate") != Some(&60_i64.into()) {
        next(&mut remote, &wake);
    }
    drop(again);
    let _third = Offering::new(&near_config("camera"));
    assert_eq!(shown(&next(&mut remote, &wake)), ["rate=10"]);
}

fn take(listener: &mut dyn Listener, context: &Context) -> Properties {
    let mut taken = None;
    assert!(wait_until(&context.wake, TIMEOUT, || {
        taken = listener.take().unwrap();
        taken.is_some()
    }));
    let Payload::Properties(properties) = taken.unwrap().payload else { panic!("no properties") };
    properties
}

#[test]
fn endpoints_carry_properties() {
    let (_offering, asking) = pair();
    let spec = TopicSpec::new(&asking.asked, MessageType::Properties);
    let (heard, set) = (Context::default(), Context::default());
    let mut listener = asking.ros2.open_listener(&spec, &heard).unwrap();
    let mut publisher = asking.ros2.open_publisher(&spec, &set).unwrap();
    assert_eq!(shown(&take(listener.as_mut(), &heard)), ALL);
    assert_eq!(listener.link().peers, Some(1));
    let ready = || {
        let link = publisher.link();
        link.peers == Some(1) && link.waiting_for.is_none()
    };
    assert!(wait_until(&set.wake, TIMEOUT, ready));
    let mut rate = 0;
    let mut changes = None;
    // As above: the first events may be missed.
    assert!(wait_until(&heard.wake, TIMEOUT, || {
        rate = rate % 60 + 1;
        publisher.publish(&Properties::from([("rate", rate)]).into()).unwrap();
        changes = listener.take().unwrap();
        changes.is_some()
    }));
    let refused = publisher.publish(&Properties::from([("serial", "B2")]).into()).unwrap_err();
    assert!(matches!(refused, PublishError::Refused { .. }), "{refused}");
    assert_eq!(refused.drop_reason(), DropReason::Refused);
    let text = refused.to_string();
    assert!(text.contains("serial: Trying to set a read-only parameter: serial."), "{text}");
    // No listener wants them; then one does, and begins with all.
    assert!(wait_until(&heard.wake, TIMEOUT, || !listener.discard()));
    assert_eq!(take(listener.as_mut(), &heard).len(), ALL.len());
    let wrong = publisher.publish(&wrapyfi_data::types::Value::Null.into()).unwrap_err();
    assert_eq!(wrong.drop_reason(), DropReason::Unencodable);
}

#[test]
fn an_endpoint_waits_for_its_node() {
    let (_offering, asking) = pair();
    let spec = TopicSpec::new("later", MessageType::Properties);
    let context = Context::default();
    let mut listener = asking.ros2.open_listener(&spec, &context).unwrap();
    let mut publisher = asking.ros2.open_publisher(&spec, &context).unwrap();
    for link in [listener.link(), publisher.link()] {
        assert_eq!(link.peers, Some(0));
        let node = Absent::new(Role::Server, "node", "ros2", "/robot/later");
        assert_eq!(link.waiting_for, Some(Cause::Nobody(node)));
    }
    let lost = publisher.publish(&Properties::from([("rate", 5_i64)]).into()).unwrap_err();
    assert_eq!(lost.drop_reason(), DropReason::NoConsumer);
    let _later = Offering::new(&far_config("later"));
    assert_eq!(shown(&take(listener.as_mut(), &context)), ALL);
    assert!(wait_until(&context.wake, TIMEOUT, || publisher.link().waiting_for.is_none()));
    publisher.publish(&Properties::from([("rate", 5_i64)]).into()).unwrap();
}

#[cfg(feature = "fastdds-services")]
mod fast_dds {
    use wrapyfi_ros2::CycloneConfig;
    use wrapyfi_ros2::graph::ServiceMapping;

    use super::*;
    use crate::common::{domain, name};

    /// RustDDS knows no domain tags, and service names are those of the process.
    #[test]
    fn parameters_are_read_set_and_watched_as_of_fast_dds() {
        let config = |node: &str| CycloneConfig {
            services: Some(ServiceMapping::FastDds),
            ..CycloneConfig::loopback(name(node), domain())
        };
        let offering = Offering::new(&config("camera"));
        let asking = Asking::new(&config("tool"), &offering);
        let wake = Wake::new();
        let mut remote = remote(&asking, &wake);
        assert_eq!(shown(&next(&mut remote, &wake)), ALL);
        read_and_set(&asking);
        // The topic of events is volatile: the first ones may be missed.
        let (handle, mut rate, mut seen) = (offering.node.handle(), 0_i64, Properties::new());
        assert!(wait_until(&wake, TIMEOUT, || {
            rate = rate % 60 + 1;
            handle.parameters(|store| store.set("rate", rate)).unwrap();
            seen.extend(remote.take(Instant::now()).unwrap().into_iter().flatten());
            seen.get("rate").is_some()
        }));
    }
}
