//! Devices of a robot: a control board whose joints have names, a camera that tells its calibration.

use super::*;

/// The answers of a control board with a joint that turns and one that slides.
async fn board(received: Received, _: bool) -> Answer {
    let words = received.bottle().unwrap_or_default();
    let is_first = words.get(2).and_then(Element::as_i64) == Some(0);
    let (name, kind) = if is_first { ("neck", "atrv") } else { ("heave", "atpr") };
    let asked = words.get(1).cloned().unwrap_or(Element::Int32(0));
    let told = match &asked {
        word if word.is_word("axes") => Element::Int32(2),
        word if word.is_word("name") => Element::string(name),
        _ => Element::Int32(Vocab::new(kind).0),
    };
    Answer::Bottle(Bottle::from(vec![Element::vocab("is"), asked, told]))
}

fn numbers(values: &[f64]) -> Value {
    Tensor::from_elements(&[values.len()], values.to_vec()).unwrap().into()
}

fn message(message_type: MessageType, fields: Map) -> Payload {
    let MessageType::Ros(ros_type) = message_type else { panic!("{message_type}") };
    RosMessage::from_value(ros_type, &fields.into(), 1 << 20).unwrap().into()
}

/// A board is asked for its joints: what it says has names and metres, and so has what moves it.
#[test]
fn a_control_board_names_its_joints_and_is_moved() {
    let net = YarpNetwork::new();
    let (yarp, network) = (net.yarp(), net.network());
    let (here, there) = (Context::default(), Context::default());
    let tells = tokio::sync::watch::Sender::new(true);
    let gate = tells.clone();
    let answer = move |received, wants| {
        let mut tells = gate.subscribe();
        async move {
            tells.wait_for(|tells| *tells).await.unwrap();
            board(received, wants).await
        }
    };
    let (rpc, state, (command, mut commands)) = net.runtime.block_on(async {
        let rpc = network.serve("/robot/rpc:i", &PortOptions::default(), answer).await.unwrap();
        let wanted = PortOptions::default();
        let state = network.open_output("/robot/state:o", &wanted).await.unwrap();
        let command = input(&network, "/robot/command:i").await;
        (rpc, state, command)
    });
    let mut types = TypeStore::generated();
    let mut resolved = |name: &str| MessageType::resolve(name, &mut types).unwrap();
    let joints = resolved("sensor_msgs/msg/JointState");
    let spec = TopicSpec::new("/robot/state:o", joints);
    let mut sink = yarp.open_listener(&spec, &here).unwrap();
    open_way(&here, || sink.link());
    net.runtime.block_on(connected(&state));
    state.write_bottle(&Bottle::from(vec![180.0.into(), 0.25.into()])).unwrap();
    let mut came = None;
    wait_until(&here.wake, "the state", || {
        came = sink.take().unwrap();
        came.is_some()
    });
    let Payload::RosMessage(first) = came.unwrap().payload else { panic!("another payload") };
    let fields = first.to_value(1 << 20).unwrap();
    let names: Vec<_> = fields.get("name").unwrap().as_items().unwrap().to_vec();
    assert_eq!(names, ["neck".into(), "heave".into()], "the very first message has them");
    let position = fields.get("position").unwrap().as_tensor().unwrap().to_vec::<f64>();
    assert_eq!(position.unwrap(), [std::f64::consts::PI, 0.25]);

    let mut heard = || {
        let heard = net.runtime.block_on(commands.recv()).unwrap();
        heard.bottle().unwrap().to_text()
    };
    let source = |name: &str, message_type| {
        let options = [("port", name), ("out_topic_connect", "/robot/command:i")];
        let spec = TopicSpec { options: Map::from(options), ..TopicSpec::new(name, message_type) };
        yarp.open_publisher(&spec, &there).unwrap()
    };
    let names = || ["heave", "neck"].into_iter().collect::<Value>();
    // It is known what is waited for, and the first movement afterwards is one.
    tells.send_replace(false);
    let mut mover = source("/bridge/state", joints);
    wait_until(&there.wake, "the board is waited for", || {
        mover.link().waiting_for.is_some_and(|it| it.subject() == "yarp:/robot/rpc:i")
    });
    tells.send_replace(true);
    open_way(&there, || mover.link());
    let wanted = Map::from([("name", names()), ("position", numbers(&[0.5, 0.0]))]);
    mover.publish(&message(joints, wanted)).unwrap();
    assert_eq!(heard(), "([poss]) (0.0 0.5)");
    let unknown =
        Map::from([("name", ["elbow"].into_iter().collect()), ("position", numbers(&[1.0]))]);
    let error = mover.publish(&message(joints, unknown)).unwrap_err().to_string();
    assert!(error.contains("neck, heave") && error.contains("elbow"), "{error}");

    let trajectories = resolved("trajectory_msgs/msg/JointTrajectory");
    let mut mover = source("/bridge/trajectory", trajectories);
    let trajectory = |points: [(f64, i32); 2]| {
        let point = |(heave, sec)| {
            let time = Map::from([("sec", sec), ("nanosec", 0)]);
            let positions = numbers(&[heave, 0.0]);
            let time = ("time_from_start", Value::from(time));
            Value::from(Map::from([("positions", positions), time]))
        };
        let points = Value::List(points.map(point).to_vec());
        message(trajectories, Map::from([("joint_names", names()), ("points", points)]))
    };
    open_way(&there, || mover.link());
    mover.publish(&trajectory([(0.125, 0), (0.25, 3)])).unwrap();
    // The second one replaces what is left of the first.
    mover.publish(&trajectory([(0.375, 0), (0.75, 4)])).unwrap();
    for heave in ["0.125", "0.375", "0.75"] {
        assert_eq!(heard(), format!("([poss]) (0.0 {heave})"));
    }
    drop((mover, sink));
    net.runtime.block_on(async {
        rpc.close().await;
        state.close().await;
        command.close().await;
    });
}

/// A camera is asked once for each time that its pictures are connected, and each of them has what it tells.
#[test]
fn a_camera_tells_its_calibration_once() {
    const CALIBRATION: &str = "sensor_msgs/msg/CameraInfo";
    let net = YarpNetwork::new();
    let (yarp, network, here) = (net.yarp(), net.network(), Context::default());
    let asked = Arc::new(AtomicUsize::new(0));
    let count = Arc::clone(&asked);
    let camera = move |received: Received, _: bool| {
        count.fetch_add(1, Relaxed);
        let question = received.bottle().unwrap_or_default().to_text();
        assert_eq!(question, "[visr] [get] [intp]");
        let told = "[visr] [intp] [is] ((focalLengthX 512) (focalLengthY 510.5) (principalPointX 235) \
                    (principalPointY 231) (distortionModel plumb_bob) (k1 0.5))";
        let told = Bottle::from_text(told.as_bytes(), &WireLimits::default()).unwrap();
        std::future::ready(Answer::Bottle(told))
    };
    let open_eye = || {
        let wanted = PortOptions::default();
        let eye = network.open_output("/robot/rgbImage:o", &wanted);
        net.runtime.block_on(eye).unwrap()
    };
    let plain = PortOptions::default();
    let rpc = net.runtime.block_on(network.serve("/robot/rpc:i", &plain, camera)).unwrap();
    let mut eye = open_eye();
    let name = "/robot/rgbImage:camera_info";
    let mut look = yarp.discover().unwrap();
    look.only(Box::new(move |other| other == name));
    wait_until(&here.wake, "a calibration beside the pictures", || {
        let found = look.endpoints().unwrap();
        let told = found.iter().find(|one| one.name == name);
        told.is_some_and(|one| {
            assert_eq!(one.node.as_deref(), Some("/robot/rgbImage:o"));
            one.type_name.as_deref() == Some(CALIBRATION)
        })
    });
    let kind = MessageType::resolve(CALIBRATION, &mut TypeStore::generated()).unwrap();
    let mut sink = yarp.open_listener(&TopicSpec::new(name, kind), &here).unwrap();
    for connections in 1..=2 {
        open_way(&here, || sink.link());
        net.runtime.block_on(connected(&eye));
        let number = |value: &Value, name: &str| value.get(name).and_then(Value::as_f64);
        // Pictures wait for the answer, though not for ever.
        let (mut time_s, deadline) = (10.0, Instant::now() + TIMEOUT);
        let info = loop {
            time_s += 1.0;
            let picture = Image::from_packed(PixelCode::Rgb, 4, 2, vec![7; 24].into()).unwrap();
            let picture = Message::new(PortPayload::object(
                picture.encode(wrapyfi_yarp::sig::Rows::Announced).unwrap(),
            ));
            assert_eq!(eye.write_object(picture.stamped(Stamp { count: 1, time_s })).targets, 1);
            let mut came = None;
            wait_until(&here.wake, "a calibration", || {
                came = sink.take().unwrap();
                came.is_some()
            });
            let Payload::RosMessage(info) = came.unwrap().payload else { panic!("no message") };
            let info = info.to_value(1 << 20).unwrap();
            if info.get("distortion_model") == Some(&"plumb_bob".into()) {
                break info;
            }
            assert!(Instant::now() < deadline, "it never told");
        };
        let k = info.get("k").unwrap().as_tensor().unwrap().to_vec::<f64>().unwrap();
        assert_eq!(k, [512.0, 0.0, 235.0, 0.0, 510.5, 231.0, 0.0, 0.0, 1.0]);
        assert_eq!((number(&info, "width"), number(&info, "height")), (Some(4.0), Some(2.0)));
        let stamp = info.get("header").unwrap().get("stamp").unwrap();
        assert_eq!(number(stamp, "sec"), Some(time_s), "the picture's");
        assert_eq!(asked.load(Relaxed), connections);
        net.runtime.block_on(eye.close());
        wait_until(&here.wake, "the pictures to end", || sink.link().waiting_for.is_some());
        eye = open_eye();
    }
    drop(sink);
    net.runtime.block_on(async {
        rpc.close().await;
        eye.close().await;
    });
}
