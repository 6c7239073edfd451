//! Registered methods that return ROS messages: generated types, and types by name.

use std::sync::Arc;

use wrapyfi_core::communicator::{CommunicatorContext, MethodError, Mode, communicator};
use wrapyfi_data::types::{RosMessage, RosType, Value};
use wrapyfi_endpoint::memory::Memory;
use wrapyfi_interfaces::geometry_msgs::msg::{Twist, Vector3};
use wrapyfi_interfaces::parser::{Dialect, TypeName};
use wrapyfi_interfaces::store::TypeStore;

struct Robot {
    x: f64,
}

#[communicator]
impl Robot {
    /// The type says its ROS name.
    #[register(RosMessage, "memory", "/cmd_vel", should_wait = false, timeout_ms = 20)]
    fn drive(&mut self) -> Twist {
        self.x += 1.0;
        Twist { linear: Vector3 { x: self.x, ..Vector3::default() }, ..Twist::default() }
    }

    /// Python's name of the data type; the ROS type has no Rust type.
    #[register(ROS2Message, "memory", "/pair", should_wait = false, message_type = "demo/msg/Pair")]
    fn pair(&self) -> RosMessage {
        let ros_type = RosType::new(&definitions().resolve_name("demo/msg/Pair").unwrap()).unwrap();
        let mut fields = ros_type.plan().default_message();
        fields.set("a", 7_i32).unwrap();
        RosMessage::from_fields(ros_type, &fields).unwrap()
    }

    #[register(RosMessage, "memory", "/untyped", should_wait = false)]
    fn untyped(&self) -> RosMessage {
        self.pair()
    }

    #[register(RosMessage, "memory", "/named", should_wait = false, message_type = "$0")]
    fn named(&self, message_type: &str) -> RosMessage {
        _ = message_type;
        self.pair()
    }

    #[register(
        RosMessage,
        "memory",
        "/other",
        should_wait = false,
        message_type = "std_msgs/msg/Bool"
    )]
    fn contradiction(&self) -> Twist {
        Twist::default()
    }

    #[register(RosMessage, "memory", "/cmd_vel", should_wait = false)]
    fn misread(&self) -> Vector3 {
        Vector3::default()
    }
}

fn definitions() -> TypeStore {
    let mut store = TypeStore::generated();
    let name = TypeName::parse(Dialect::Ros2, "demo/msg/Pair").unwrap();
    store.add_definition(&name, "int32 a\nint32 b\n").unwrap();
    store
}

fn pair_of_robots() -> [RobotCommunicator; 2] {
    let memory = Arc::new(Memory::new("memory"));
    let context = CommunicatorContext::builder().only(memory).types(definitions()).build();
    let mut robots = [0, 1].map(|_| Robot { x: 0.0 }.communicator_in(&context));
    for method in [RobotMethod::Drive, RobotMethod::Pair, RobotMethod::Named] {
        robots[0].activate(method, Mode::Publish).unwrap();
        robots[1].activate(method, Mode::Listen).unwrap();
    }
    robots
}

#[test]
fn a_generated_message_needs_no_other_name() {
    let [mut here, mut there] = pair_of_robots();
    assert_eq!(there.drive().unwrap(), None);
    let said = here.drive().unwrap();
    assert_eq!(said.as_ref().map(|twist| twist.linear.x), Some(1.0));
    assert_eq!(there.drive().unwrap(), said);
    // A listener with another type is told, and what it got is gone.
    there.activate(RobotMethod::Misread, Mode::Listen).unwrap();
    assert_eq!(there.misread().unwrap(), None);
    here.drive().unwrap();
    let error = there.misread().unwrap_err();
    assert!(matches!(error, MethodError::WrongType { .. }), "{error:?}");
    let text = error.to_string();
    assert!(text.contains("Robot::misread") && text.contains("memory:/cmd_vel"), "{text}");
    assert!(text.contains("geometry_msgs/msg/Twist (RIHS01_"), "{text}");
}

#[test]
fn a_message_by_name_has_the_fields_of_its_definition() {
    let [here, there] = pair_of_robots();
    assert_eq!(there.pair().unwrap(), None);
    here.pair().unwrap();
    let heard = there.pair().unwrap().unwrap();
    assert_eq!(heard.ros_type.name(), "demo/msg/Pair");
    assert_eq!(heard.to_value(1 << 10).unwrap().get("a"), Some(&Value::from(7)));
}

#[test]
fn a_type_that_is_not_said_not_found_or_another_one_is_told() {
    let [mut here, _there] = pair_of_robots();
    let option = |error: MethodError| match error {
        MethodError::Option { method, fault } => format!("{method}: {fault}"),
        other => format!("another error: {other}"),
    };
    here.activate(RobotMethod::Untyped, Mode::Publish).unwrap();
    assert_eq!(
        option(here.untyped().unwrap_err()),
        "Robot::untyped: option message_type is not given, and should be the type of the message, \
         as package/msg/Type"
    );
    let text = option(here.named("demo/msg/None").unwrap_err());
    assert!(text.starts_with("Robot::named: option message_type is \"demo/msg/None\""), "{text}");
    assert!(text.contains("a type whose definition is found: "), "{text}");
    here.activate(RobotMethod::Contradiction, Mode::Publish).unwrap();
    let text = option(here.contradiction().unwrap_err());
    assert!(text.contains("should be geometry_msgs/msg/Twist, which is what the method"), "{text}");
    here.activate(RobotMethod::Drive, Mode::Request).unwrap();
    let text = option(here.drive().unwrap_err());
    assert!(text.contains("should be the type of a service, as package/srv/Type"), "{text}");
}
