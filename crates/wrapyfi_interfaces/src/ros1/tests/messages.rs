//! Messages that are carried over.

use proptest::prelude::*;

use super::*;
use crate::cdr::CdrError;

#[test]
fn fields_in_another_order_are_found() {
    let one = "string c\nuint8 a\nIn in\nuint32[] b\n";
    let in1 = "MSG: demo/In\nuint16 y\nstring x\n";
    let two = "uint32[] b\nIn in\nuint8 a\nstring c\n";
    let in2 = "MSG: demo/In\nstring x\nuint16 y\n";
    let (one, two) = (format!("{one}{SEPARATOR}{in1}"), format!("{two}{SEPARATOR}{in2}"));
    let plan = compile(&one, &two).unwrap();
    let bytes = b"\x01\0\0\0C\x07\x05\x01\x02\0\0\0XY\x02\0\0\0\x01\0\0\0\x02\0\0\0";
    let (cdr, _) = to_cdr(&plan, bytes).unwrap();
    assert_eq!(
        read(&two, &cdr),
        serde_json::json!({"b": [1, 2], "in": {"x": "XY", "y": 0x105}, "a": 7, "c": "C"})
    );
    assert_eq!(to_ros1(&plan, &cdr).unwrap().0, bytes);
    assert_eq!(plan.notes(), []);
    // The same inside a loop, where each turn has its own places.
    let one = format!("A[] all\n{SEPARATOR}MSG: demo/A\nstring c\nuint8 a\n");
    let two = format!("A[] all\n{SEPARATOR}MSG: demo/A\nuint8 a\nstring c\n");
    let compile = |one: &str, two: &str| {
        let one = resolve(Dialect::Ros1, "demo/L", one);
        PairPlan::compile(&one, &resolve(Dialect::Ros2, "demo/msg/L", two), &Rules::built_in())
    };
    let plan = compile(&one, &two).unwrap();
    let bytes = b"\x02\0\0\0\x01\0\0\0A\x01\x02\0\0\0BB\x02";
    let (cdr, _) = to_cdr(&plan, bytes).unwrap();
    assert_eq!(cdr[4..], *b"\x02\0\0\0\x01\0\0\0\x02\0\0\0A\0\x02\0\x03\0\0\0BB\0");
    assert_eq!(to_ros1(&plan, &cdr).unwrap().0, bytes);
}

#[test]
fn fields_of_one_side_are_dropped_or_have_their_default() {
    let in1 = "MSG: demo/In\nstring s\nfloat64 kept\nIn2[] many\n";
    let in12 = "MSG: demo/In2\nstring t\nuint8 u\n";
    let one = format!(
        "uint8 gone\nIn in\nfloat64[3] three\nstring[2] two\nIn2[] messages\nuint8[] bytes\nuint16 last\n\
         {SEPARATOR}{in1}{SEPARATOR}{in12}"
    );
    let two = "int32 new 7\nfloat32[2] pair [0.5, 2]\nstring text \"hi\"\nuint16 last\nIn in\nbool[] f [true, false]\n\
               wstring w\nDeep[2] deep\nHole hole\nint16 m -2\nstring[] texts [\"a\", \"b\"]\n";
    let two = format!(
        "{two}{SEPARATOR}MSG: demo/In\nfloat64 kept\n{SEPARATOR}MSG: demo/Deep\nstring t\nfloat64 x 1.5\n\
         {SEPARATOR}MSG: demo/Hole\n"
    );
    let plan = compile(&one, &two).unwrap();
    let mut bytes = b"\x09\x01\0\0\0S".to_vec();
    bytes.extend(2.5_f64.to_le_bytes());
    bytes.extend(b"\x01\0\0\0\x01\0\0\0T\x05"); // in.many
    bytes.extend([0; 24]);
    bytes.extend(b"\0\0\0\0\x01\0\0\0Z"); // two
    bytes.extend(b"\x02\0\0\0\0\0\0\0\x01\x01\0\0\0Q\x02"); // messages
    bytes.extend(b"\x03\0\0\0abc\x34\x12");
    let (cdr, _) = to_cdr(&plan, &bytes).unwrap();
    let deep = serde_json::json!({"t": "", "x": 1.5});
    let expected = serde_json::json!({
        "new": 7, "pair": [0.5, 2.0], "text": "hi", "last": 0x1234, "in": {"kept": 2.5},
        "f": [true, false], "w": "", "deep": [deep, deep], "hole": {}, "m": -2, "texts": ["a", "b"],
    });
    assert_eq!(read(&two, &cdr), expected);
    // And back: what ROS 2 lacks is empty.
    let (back, _) = to_ros1(&plan, &cdr).unwrap();
    let mut expected = b"\0\0\0\0\0".to_vec();
    expected.extend(2.5_f64.to_le_bytes());
    expected.extend([0; 4 + 24 + 8 + 4 + 4]);
    expected.extend(b"\x34\x12");
    assert_eq!(back, expected);
    let notes = notes(&plan);
    assert!(
        notes.contains(
            &"in.s is in ROS 1 only: dropped towards ROS 2, empty towards ROS 1".to_owned()
        )
    );
    assert!(notes.contains(
        &"deep is in ROS 2 only: default value towards ROS 2, dropped towards ROS 1".to_owned()
    ));
    assert_eq!(notes.len(), 7 + 9, "{notes:?}");
}

#[test]
fn a_header_loses_its_number_and_counts_anew() {
    let mut types = Types::new(Rules::built_in(), TypeStore::empty());
    let tf = types.definition("tf2_msgs/TFMessage").unwrap();
    let joints = types.definition("sensor_msgs/JointState").unwrap();
    assert_eq!(
        notes(&types.plan(&tf).unwrap()),
        ["transforms[].header.seq is in ROS 1 only: dropped towards ROS 2, empty towards ROS 1"]
    );
    let plan = types.plan(&joints).unwrap();
    assert_eq!(
        notes(&plan),
        ["header.seq is in ROS 1 only: dropped towards ROS 2, counted towards ROS 1"]
    );
    let bytes = [&[9, 0, 0, 0], [0; 8 + 4 * 5].as_slice()].concat();
    let (cdr, _) = to_cdr(&plan, &bytes).unwrap();
    let mut out = vec![0xaa; 4];
    plan.to_ros1(&cdr, 0x0102_0304, &Options::default(), &mut out).unwrap();
    // Bytes that were in the buffer stay, for instance a length.
    assert_eq!(out[..8], [0xaa, 0xaa, 0xaa, 0xaa, 4, 3, 2, 1]);
    assert_eq!(out[8..], bytes[4..]);
}

#[test]
fn strings_that_ros2_does_not_take_are_mended_and_counted() {
    let plan = compile("string s\n", "string s\n").unwrap();
    let string = |bytes: &[u8]| [&(bytes.len() as u32).to_le_bytes(), bytes].concat();
    let cdr = |text: &[u8]| {
        [b"\0\x01\0\0", (text.len() as u32 + 1).to_le_bytes().as_slice(), text, b"\0"].concat()
    };
    let (written, done) = to_cdr(&plan, &string(b"ab\0cd\0")).unwrap();
    assert_eq!((written.as_slice(), done.cut_texts), (cdr(b"ab").as_slice(), 1));
    let bad = b"a\xff\xe2\x82b\xe2\x82\xac";
    let (written, done) = to_cdr(&plan, &string(bad)).unwrap();
    assert_eq!(written, cdr("a\u{fffd}\u{fffd}b€".as_bytes()));
    assert_eq!(done, Transcoded { bad_texts: 1, ..Transcoded::default() });
    // On the way back as well, and a length of 0 is an empty string.
    assert_eq!(to_ros1(&plan, &cdr(b"ab\0cd")).unwrap().0, string(b"ab"));
    assert_eq!(to_ros1(&plan, &cdr(b"\xff")).unwrap().0, string("\u{fffd}".as_bytes()));
    assert_eq!(to_ros1(&plan, &[0, 1, 0, 0, 0, 0, 0, 0]).unwrap().0, string(b""));
    assert_eq!(
        to_ros1(&plan, b"\0\x01\0\0\x02\0\0\0ab"),
        Err(CdrError::Unterminated { path: "s".into(), length: 2, last: b'b' }.into())
    );
}

#[test]
fn wide_strings_of_ros2_are_utf8_in_ros1() {
    let plan = compile("string s\nstring[] t\n", "wstring s\nwstring<=2[] t\n").unwrap();
    let bytes = "\x06\0\0\0a🙂b\x01\0\0\0\x02\0\0\0ß".as_bytes();
    let (cdr, done) = to_cdr(&plan, bytes).unwrap();
    assert_eq!(
        read("wstring s\nwstring<=2[] t\n", &cdr),
        serde_json::json!({"s": "a🙂b", "t": ["ß"]})
    );
    assert_eq!(to_ros1(&plan, &cdr).unwrap(), (bytes.to_vec(), done));
    assert_eq!(
        to_cdr(&plan, b"\0\0\0\0\x01\0\0\0\x03\0\0\0abc"),
        Err(TranscodeError::Bound { path: "t[0]".into(), actual: 3, bound: 2 })
    );
    let (mended, done) = to_cdr(&plan, b"\x02\0\0\0\xffa\0\0\0\0").unwrap();
    assert_eq!(read("wstring s\nwstring<=2[] t\n", &mended)["s"], "\u{fffd}a");
    assert_eq!(done.bad_texts, 1);
    let lone = b"\0\x01\0\0\x02\0\0\0\x00\xd8\0\0a\0\0\0\0\0\0\0";
    let (mended, done) = to_ros1(&plan, lone).unwrap();
    assert_eq!((&mended[4..8], done.bad_texts), ("\u{fffd}a".as_bytes(), 1));
}

#[test]
fn booleans_are_0_or_1_and_times_keep_their_bits() {
    let text = "bool b\nuint8 n\nbool[2] two\nbool[] many\ntime t\nduration d\n";
    let two = "bool b\nuint8 n\nbool[2] two\nbool[] many\nbuiltin_interfaces/Time t\nbuiltin_interfaces/Duration d\n";
    let plan = compile(text, two).unwrap();
    let times = b"\xff\xff\xff\xff\x01\0\0\0\xfe\xff\xff\xff\x02\0\0\0";
    let bytes = [b"\x02\x02\xff\x00\x03\0\0\0\x00\x03\x80".as_slice(), times].concat();
    let (cdr, done) = to_cdr(&plan, &bytes).unwrap();
    assert_eq!(
        read(two, &cdr),
        serde_json::json!({
            "b": true, "n": 2, "two": [true, false], "many": [false, true, true],
            "t": {"sec": -1, "nanosec": 1}, "d": {"sec": -2, "nanosec": 2}
        })
    );
    assert_eq!(done, Transcoded { wrapped_times: 1, ..Transcoded::default() });
    let (back, again) = to_ros1(&plan, &cdr).unwrap();
    assert_eq!(back[..11], *b"\x01\x02\x01\x00\x03\0\0\0\x00\x01\x01");
    assert_eq!((&back[11..], again), (times.as_slice(), done));
    // In sequences of fixed layout, too.
    let one = format!("A[] a\nA[100] h\n{SEPARATOR}MSG: demo/A\ntime t\nbool[4] b\nint32 z\n");
    let two = one.replace("time", "builtin_interfaces/Time");
    let ros1 = resolve(Dialect::Ros1, "demo/L", &one);
    let ros2 = resolve(Dialect::Ros2, "demo/msg/L", &two);
    let plan = PairPlan::compile(&ros1, &ros2, &Rules::built_in()).unwrap();
    let element = b"\0\0\0\x80\0\0\0\0\x02\0\0\x05\0\0\0\0";
    let bytes = [b"\x03\0\0\0".as_slice(), &element.repeat(103)].concat();
    let (cdr, done) = to_cdr(&plan, &bytes).unwrap();
    assert_eq!(done.wrapped_times, 103);
    assert_eq!(cdr.len(), 4 + bytes.len());
    assert!(cdr[8..].chunks(16).all(|element| element[8..12] == [1, 0, 0, 1]));
}

#[test]
fn a_big_endian_message_is_read() {
    let plan = compile("uint16 a\nstring s\n", "uint16 a\nstring s\n").unwrap();
    let (ros1, _) = to_ros1(&plan, b"\0\0\0\0\x01\x02\0\0\0\0\0\x02x\0").unwrap();
    assert_eq!(ros1, b"\x02\x01\x01\0\0\0x");
    assert!(matches!(
        to_ros1(&plan, b"\0\0\0\0\x01"),
        Err(TranscodeError::Malformed(CdrError::Truncated { .. }))
    ));
    assert_eq!(
        to_ros1(&plan, b"\0\x07\0\0"),
        Err(CdrError::Encapsulation(vec![0, 7, 0, 0]).into())
    );
}

#[test]
fn severities_of_the_log_are_translated() {
    let mut types = Types::new(Rules::built_in(), TypeStore::empty());
    let log = types.definition("rosgraph_msgs/Log").unwrap();
    let plan = types.plan(&log).unwrap();
    assert_eq!(plan.ros2_type().to_string(), "rcl_interfaces/msg/Log");
    let bytes = [[0; 16].as_slice(), &[4], &[0; 24]].concat();
    let (cdr, _) = to_cdr(&plan, &bytes).unwrap();
    assert_eq!(cdr[4 + 8], 30);
    assert_eq!(to_ros1(&plan, &cdr).unwrap().0, bytes);
    assert!(notes(&plan).contains(&"header.stamp of ROS 1 is stamp in ROS 2".to_owned()));
}

#[test]
fn wrong_lengths_name_the_field() {
    let inner = format!("{SEPARATOR}MSG: demo/In\nstring name\nfloat64 x\n");
    let text = format!("uint32 a\nuint16 b\nIn[] list\n{inner}");
    let plan = compile(&text, &text).unwrap();
    let truncated = |path: &str, needed, available| {
        Err(CdrError::Truncated { path: path.into(), needed, available }.into())
    };
    assert_eq!(to_cdr(&plan, b"\x01\0\0\0\x02"), truncated("b", 2, 1));
    assert_eq!(to_cdr(&plan, b"\x01\0"), truncated("a", 4, 2));
    assert_eq!(to_cdr(&plan, b"\x01\0\0\0\x02\0"), truncated("list", 4, 0));
    let mut bytes = b"\x01\0\0\0\x02\0\x02\0\0\0\0\0\0\0".to_vec();
    bytes.extend([0; 8]);
    bytes.extend(b"\x09\0\0\0abcdefgh");
    assert_eq!(
        to_cdr(&plan, &bytes),
        Err(CdrError::Length { path: "list[1].name".into(), claimed: 9, needed: 9, available: 8 }
            .into())
    );
    assert_eq!(
        to_cdr(&plan, b"\x01\0\0\0\x02\0\xff\xff\xff\xff").unwrap_err().to_string(),
        "list claims 4294967295 elements, which need 51539607540 bytes, 0 are left: corrupt, or \
         of another type"
    );
    assert_eq!(to_cdr(&plan, b"\x01\0\0\0\x02\0\0\0\0\0!"), Err(CdrError::Trailing(1).into()));
    // CDR is padded to whole words on the way.
    let (cdr, _) = to_cdr(&plan, b"\x01\0\0\0\x02\0\0\0\0\0").unwrap();
    for left in 0..5 {
        let padded = [cdr.as_slice(), &vec![0; left]].concat();
        let expected = if left < 4 { None } else { Some(CdrError::Trailing(left).into()) };
        assert_eq!(to_ros1(&plan, &padded).err(), expected);
    }
}

#[test]
fn limits_hold_before_memory_is_taken() {
    // Messages of nothing: none of them takes a byte in ROS 1, each takes one in ROS 2.
    let text = format!("Nothing[] list\n{SEPARATOR}MSG: demo/Nothing\n");
    let plan = compile(&text, &text).unwrap();
    let (cdr, _) = to_cdr(&plan, b"\x03\0\0\0").unwrap();
    assert_eq!(cdr[4..], [3, 0, 0, 0, 0, 0, 0]);
    assert_eq!(to_ros1(&plan, &cdr).unwrap().0, b"\x03\0\0\0");
    let options = Options { message_bytes: 1000, elements: 2000 };
    let mut out = Vec::new();
    assert_eq!(
        plan.to_cdr(b"\xff\xff\xff\xff", &options, &mut out),
        Err(TranscodeError::TooMany { path: "list".into(), limit: 2000 })
    );
    assert!(matches!(
        plan.to_cdr(&1500_u32.to_le_bytes(), &options, &mut out),
        Err(TranscodeError::ResultTooLarge { limit: 1000, .. })
    ));
    assert!(out.capacity() < 1000);
    let plan = compile("uint8[] data\n", "uint8[] data\n").unwrap();
    assert_eq!(
        plan.to_cdr(&[0; 1001], &options, &mut out),
        Err(TranscodeError::TooLarge { actual: 1001, limit: 1000 })
    );
    // Empty strings double in CDR.
    let plan = compile("string[] s\n", "string[] s\n").unwrap();
    let bytes = [200_u32.to_le_bytes().as_slice(), &[0; 800]].concat();
    let error = plan.to_cdr(&bytes, &options, &mut out).unwrap_err();
    assert!(matches!(error, TranscodeError::ResultTooLarge { .. }), "{error}");
    // Defaults of ROS 2 as well.
    let plan = compile("uint8 a\n", "uint8 a\nuint8[2000] b\n").unwrap();
    let error = plan.to_cdr(b"a", &options, &mut out).unwrap_err();
    assert!(matches!(error, TranscodeError::ResultTooLarge { .. }), "{error}");
}

#[test]
fn bounds_of_ros2_hold() {
    let plan =
        compile("int32[] a\nstring s\nstring[] t\n", "int32[<=2] a\nstring<=3 s\nstring[<=1] t\n");
    let plan = plan.unwrap();
    let bound =
        |path: &str, actual, bound| Err(TranscodeError::Bound { path: path.into(), actual, bound });
    let a = |count: u32| [count.to_le_bytes().as_slice(), &vec![0; 4 * count as usize]].concat();
    assert_eq!(to_cdr(&plan, &a(3)), bound("a", 3, 2));
    assert_eq!(to_cdr(&plan, &[&a(2), b"\x04\0\0\0abcd".as_slice()].concat()), bound("s", 4, 3));
    let rest = b"\x03\0\0\0abc\x02\0\0\0\0\0\0\0\0\0\0\0";
    assert_eq!(to_cdr(&plan, &[&a(2), rest.as_slice()].concat()), bound("t", 2, 1));
}

proptest! {
    #[test]
    fn any_bytes_are_carried_over_or_refused(
        which in any::<prop::sample::Index>(),
        bytes in prop::collection::vec(prop_oneof![Just(0_u8), Just(1), Just(2), any::<u8>()], 0..200),
        seq in any::<u32>(),
    ) {
        let mut types = Types::new(Rules::built_in(), TypeStore::empty());
        let names: Vec<_> = crate::ros1::standard_text::names()
            .filter(|(kind, _, _)| *kind == "msg")
            .collect();
        let (_, package, name) = names[which.index(names.len())];
        let definition = types.definition(&format!("{package}/{name}")).unwrap();
        let plan = types.plan(&definition).unwrap();
        let options = Options { message_bytes: 1 << 16, elements: 1 << 12 };
        let (mut cdr, mut ros1) = (Vec::new(), Vec::new());
        if plan.to_cdr(&bytes, &options, &mut cdr).is_ok() {
            // The written message is read by the other reader, and goes back and forth unchanged.
            let ros2 = types.ros2_type(&definition.resolved).unwrap().plan().unwrap();
            ros2.decode_exact(&cdr.clone().into(), 1 << 20).unwrap();
            plan.to_ros1(&cdr, seq, &options, &mut ros1).unwrap();
            let mut again = Vec::new();
            plan.to_cdr(&ros1, &options, &mut again).unwrap();
            prop_assert_eq!(again, cdr);
        } else {
            prop_assert_eq!(cdr.len(), 0);
        }
        let cdr = [b"\0\x01\0\0", bytes.as_slice()].concat();
        if plan.to_ros1(&cdr, seq, &options, &mut ros1).is_err() {
            prop_assert!(plan.to_ros1(&bytes, seq, &options, &mut ros1).is_err() || bytes.starts_with(&[0]));
        }
    }
}
