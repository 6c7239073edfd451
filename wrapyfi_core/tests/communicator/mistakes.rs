//! Error messages for mistakes in calls, options and configurations.

use std::sync::Arc;

use wrapyfi_core::communicator::{
    ActivateError, CommunicatorContext, Method, MethodError, Mode, communicator,
};
use wrapyfi_data::types::{Properties, Value};
use wrapyfi_endpoint::{
    Client, Context, Listener, Middleware, OpenError, Opened, Publisher, ServiceSpec, TopicSpec,
};

use super::robot::{Nobody, NobodyMethod, RobotMethod, context, robot};

#[test]
fn one_topic_for_both_ways_is_refused() {
    let mut robot = robot(&context());
    robot.activate(RobotMethod::Chat, Mode::Transceive).unwrap();
    let error = robot.chat("/a", "/a", None, b"").unwrap_err();
    assert!(matches!(error, MethodError::SameTopic { .. }));
    assert!(error.to_string().contains("listener_kwargs(in_topic = \"…\")"), "{error}");
    // A first call that failed leaves nothing behind.
    assert!(robot.chat("/a", "/b", None, b"").is_ok());
}

#[test]
fn a_middleware_nobody_knows_is_a_mistake_and_none_is_no_middleware() {
    let mut nobody = Nobody.communicator_in(&context());
    nobody.activate(NobodyMethod::Elsewhere, Mode::Listen).unwrap();
    let error = nobody.elsewhere(Some("memroy".into())).unwrap_err();
    assert_eq!(
        error.to_string(),
        "Nobody::elsewhere: \"memroy\" is no middleware; did you mean `memory`? available: memory"
    );
    assert_eq!(nobody.elsewhere(None).unwrap(), None);
    nobody.close();
    assert_eq!(nobody.elsewhere(Some("zenoh".into())).unwrap(), None);
}

/// A middleware that opens nothing.
struct Closed;

fn closed<T: ?Sized>(name: &str) -> Opened<T> {
    Err(OpenError::transport("memory", name, "closed today".to_owned()))
}

impl Middleware for Closed {
    fn name(&self) -> &str {
        "memory"
    }

    fn open_listener(&self, spec: &TopicSpec, _: &Context) -> Opened<dyn Listener> {
        closed(&spec.topic)
    }

    fn open_publisher(&self, spec: &TopicSpec, _: &Context) -> Opened<dyn Publisher> {
        closed(&spec.topic)
    }

    fn open_client(&self, spec: &ServiceSpec, _: &Context) -> Opened<dyn Client> {
        closed(&spec.service)
    }
}

#[test]
fn a_middleware_without_services_says_so() {
    let context = CommunicatorContext::builder().only(Arc::new(Closed)).build();
    let mut nobody = Nobody.communicator_in(&context);
    nobody.activate(NobodyMethod::Ask, Mode::Request).unwrap();
    let error = nobody.ask().unwrap_err();
    assert!(matches!(error, MethodError::Open { .. }), "{error:?}");
    assert!(error.to_string().contains("closed today"), "{error}");
}

#[test]
fn mistakes_of_activation_are_named() {
    let mut robot = robot(&context());
    let error = robot.activate("sya", Mode::Listen).unwrap_err().to_string();
    assert!(
        error.starts_with("Robot has no registered method \"sya\"; did you mean `say`?"),
        "{error}"
    );
    let error = robot.activate("say", "lisen").unwrap_err().to_string();
    assert!(error.contains("did you mean `listen`?"), "{error}");
    let error = robot.activate(RobotMethod::Say, Mode::Receive).unwrap_err();
    assert!(matches!(error, ActivateError::NothingReceived { .. }));
    assert!(error.to_string().contains("#[received] prev: Option<…>"), "{error}");
    assert_eq!(RobotMethod::Say.name(), "say");
    assert_eq!(RobotMethod::ALL.len(), 6);
}

#[test]
fn a_listener_with_another_type_says_what_came() {
    let context = context();
    let mut here = robot(&context);
    here.activate(RobotMethod::Say, Mode::Publish).unwrap();
    let mut other = Numbers.communicator_in(&context);
    other.activate(NumbersMethod::Say, Mode::Listen).unwrap();
    assert_eq!(other.say().unwrap(), None);
    here.say("memory", "x", true).unwrap();
    let error = other.say().unwrap_err();
    assert!(matches!(error, MethodError::WrongType { .. }), "{error:?}");
    assert!(error.to_string().contains("memory:/say"), "{error}");
    assert_eq!(other.say().unwrap(), None, "it is gone");
}

struct Numbers;

#[communicator]
impl Numbers {
    #[register("NativeObject", "memory", "Numbers", "/say", should_wait = false)]
    fn say(&self) -> u64 {
        0
    }
}

struct Choosy;

#[communicator]
impl Choosy {
    #[register(
        NativeObject,
        "memory",
        "/choosy",
        should_wait = false,
        message_type = "$message_type",
        queue_size = "$queue_size"
    )]
    fn pick(&self, message_type: Option<String>, queue_size: Option<String>) -> Value {
        _ = (message_type, queue_size);
        Value::Null
    }

    #[register(Properties, "memory", "/node", timeout_ms = 20)]
    fn settings(&self) -> Properties {
        Properties::new()
    }
}

#[test]
fn a_type_or_a_number_that_is_none_is_named_with_what_may_be_written() {
    let context = context();
    for mode in [Mode::Publish, Mode::Listen] {
        let mut choosy = Choosy.communicator_in(&context);
        choosy.activate(ChoosyMethod::Pick, mode).unwrap();
        for (message_type, queue_size, words) in [
            (Some("Imag"), None, "option message_type is \"Imag\", and should be another one"),
            (Some("Image"), None, "and should be a type that carries NativeObject"),
            (None, Some("many"), "option queue_size is \"many\", and should be a whole number"),
        ] {
            let error = choosy
                .pick(message_type.map(str::to_owned), queue_size.map(str::to_owned))
                .unwrap_err();
            assert!(matches!(error, MethodError::Option { .. }), "{error:?}");
            let text = error.to_string();
            assert!(text.starts_with("Choosy::pick: ") && text.contains(words), "{text}");
        }
        // The same method with what can be is not harmed.
        assert!(choosy.pick(None, None).is_ok());
    }
    let mut choosy = Choosy.communicator_in(&context);
    for mode in [Mode::Request, Mode::Reply] {
        choosy.activate(ChoosyMethod::Settings, mode).unwrap();
        let error = choosy.settings().unwrap_err();
        assert!(matches!(error, MethodError::Option { .. }), "{error:?}");
        assert!(error.to_string().contains("data type is Properties, and should be"), "{error}");
    }
}
