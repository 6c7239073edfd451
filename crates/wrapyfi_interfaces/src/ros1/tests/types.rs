//! Definitions, rules and pairs.

use super::*;
use crate::store::ResolveError;
use crate::test_data;

#[test]
fn pairs_that_do_not_fit_say_why() {
    let error = compile("int32 a\n", "int64 a\n").unwrap_err().to_string();
    assert_eq!(
        error,
        "a of demo/msg/A is int32 in ROS 1, a of demo/msg/A is int64 in ROS 2: bring the definitions \
         together, or leave the field out with a mapping rule"
    );
    for (one, two) in [
        ("int32[] a\n", "int32[3] a\n"),
        ("int32[2] a\n", "int32[3] a\n"),
        ("float32 a\n", "int32 a\n"),
        ("string a\n", "uint8[] a\n"),
        ("time a\n", "builtin_interfaces/Duration a\n"),
    ] {
        assert!(matches!(compile(one, two), Err(PairError::Mismatch { .. })), "{one} {two}");
    }
    assert!(matches!(compile("int8 a\n", "int8 b\n"), Err(PairError::NothingInCommon { .. })));
    // Same bits under another name are the same.
    compile("char a\nbyte b\nuint8 c\n", "uint8 a\nint8 b\nchar c\n").unwrap();
    compile("", "").unwrap();
    compile("int8 a\n", "").unwrap();
}

/// Towards ROS 2 the second of two such fields was dropped without a word.
#[test]
fn fields_that_ros_2_spells_alike_are_refused_by_name() {
    let both = "int32 D\nint32 d\n";
    let error = compile(both, "int32 d\n").unwrap_err();
    assert!(matches!(&error, PairError::Alike { .. }), "{error}");
    let error = error.to_string();
    assert!(error.starts_with("d and D of demo/A of ROS 1 are both d in ROS 2"), "{error}");
    let mut types = Types::new(Rules::built_in(), TypeStore::empty());
    let inner = format!("B b\n{SEPARATOR}MSG: demo/B\nint8 K\nint8 k\n");
    for (text, fields) in [
        ("string frame_id\nstring frameId\n", ["frame_id", "frameId"]),
        ("string frameId\nstring frame_Id\n", ["frame_Id", "frameId"]),
        (&inner, ["k", "K"]),
    ] {
        let shown = types.show("demo/A", "*", text).unwrap();
        match types.plan(&shown) {
            Err(PairError::Alike { fields: found, .. }) => assert_eq!(found, fields),
            other => panic!("{text}: {other:?}"),
        }
    }
    let rule = "[{ros1_package_name: demo, ros1_message_name: A, ros2_package_name: demo, \
                ros2_message_name: A, fields_1_to_2: {D: upper, d: d}}]";
    let rules = Rules::built_in().then(serde_saphyr::from_str(rule).unwrap());
    compile_with(&rules, both, "int32 d\nint32 upper\n").unwrap();
    compile("float64[9] K\n", "float64[9] k\n").unwrap();
}

#[test]
fn types_that_unfold_without_end_are_refused() {
    // Each of the two refers to the next twice: 2^40 fields.
    let mut text = "Deep0[] a\nDeep0[] b\n".to_owned();
    for depth in 0..40 {
        text.push_str(&format!("{SEPARATOR}MSG: demo/Deep{depth}\n"));
        text.push_str(&format!("Deep{next}[] a\nDeep{next}[] b\n", next = depth + 1));
    }
    text.push_str(&format!("{SEPARATOR}MSG: demo/Deep40\nuint8 x\n"));
    for (one, two) in [(&text, &text), (&text, &"uint8[] b\nuint8[] y\n".to_owned())] {
        let error = compile(one, two).unwrap_err();
        let refused = matches!(error, PairError::TooComplex { .. } | PairError::Mismatch { .. });
        assert!(refused, "{error}");
    }
    for (one, two) in [(text.as_str(), "uint8 z\n"), ("uint8 z\n", text.as_str())] {
        let (one, two) = (format!("uint8 z\n{one}"), format!("uint8 z\n{two}"));
        let error = compile(&one.replace("z\nuint8 z", "z"), &two.replace("z\nuint8 z", "z"));
        assert!(matches!(error, Err(PairError::TooComplex { .. })), "{error:?}");
    }
    assert!(matches!(
        compile("uint8 a\n", "uint8 a\nfloat64[4000000000] b\n"),
        Err(PairError::Type(_))
    ));
}

#[test]
fn definitions_that_lack_or_repeat_are_refused() {
    let header = |text: &str| Definition::from_header("demo/A", text).unwrap_err();
    let error = header("B b\n");
    assert!(matches!(&error, DefinitionError::Resolve(ResolveError::NotFound { .. })), "{error}");
    let error = header(&format!("B b\n{SEPARATOR}MSG: demo/B\nA a\n"));
    assert!(error.to_string().contains("contains itself"), "{error}");
    assert!(header("B\n").to_string().contains("line 1"));
    let error = Definition::from_header("no name", "").unwrap_err();
    assert!(matches!(error, DefinitionError::Name { .. }), "{error}");
    let error = Definition::from_header("a/b/C", "").unwrap_err();
    assert!(matches!(error, DefinitionError::Name { .. }), "{error}");
    let mut types = Types::new(Rules::built_in(), TypeStore::empty());
    types.add_ros1_path("/none".as_ref());
    assert_eq!(
        types.definition("lab_msgs/Strange").unwrap_err().to_string(),
        "the ROS 1 definition of lab_msgs/Strange is not known: no ROS 1 node has shown it yet; \
         looked for /none/lab_msgs/msg/Strange.msg, /none/lab_msgs/Strange.msg, \
         /none/share/lab_msgs/msg/Strange.msg; start a node that publishes it, or give a folder \
         with lab_msgs/msg/Strange.msg"
    );
    types.show("lab_msgs/Strange", "*", "uint8 x\n").unwrap();
    types.definition("lab_msgs/Strange").unwrap();
    let service = types.service_definition("lab_msgs/Strange", None).unwrap_err().to_string();
    assert!(service.contains("nodes of ROS 1 do not show those of services"), "{service}");
    assert!(service.contains("have ROS_PACKAGE_PATH lead to its package, or give"), "{service}");
}

#[test]
fn what_a_publisher_shows_has_the_checksum_it_names() {
    let mut types = Types::new(Rules::built_in(), TypeStore::empty());
    let string = "992ce8a1687cec8c8bd883ec73ca41d1";
    // No text, or another: the one that is at hand has the checksum.
    for text in ["string data\n", "", "uint8 other\n", "no text"] {
        let shown = types.show("std_msgs/String", string, text).unwrap();
        assert_eq!((shown.md5sum.as_str(), shown.text.trim()), (string, "string data"));
    }
    let error = types.show("lab_msgs/String", &"a".repeat(99), "string data\n").unwrap_err();
    assert!(matches!(&error, DefinitionError::Checksum { .. }), "{error}");
    assert!(error.to_string().contains(string) && error.to_string().len() < 400, "{error}");
    assert!(types.definition("lab_msgs/String").is_err(), "it is not remembered");
    let shown = types.show("lab_msgs/String", string, "string data\n").unwrap();
    assert_eq!(types.definition("lab_msgs/String").unwrap(), shown);
}

/// A folder of packages.
fn packages(files: &[(&str, &str)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (path, text) in files {
        let path = folder.path().join(path);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }
    folder
}

/// Types of ROS 1 below `ros1`, of ROS 2 below `ros2`.
fn types_of(packages: &tempfile::TempDir) -> Types {
    let mut store = TypeStore::empty();
    store.add_folder(&packages.path().join("ros2"));
    let mut types = Types::new(Rules::built_in(), store);
    types.add_ros1_path(packages.path().join("ros1").as_os_str());
    types
}

const REPORT: &str = "Header header\nsensor_msgs/CompressedImage picture\nPart[] parts\n";

#[test]
fn types_inside_one_of_a_folder_are_looked_for_along_the_same_line() {
    let packages = packages(&[
        ("ros1/lab_msgs/msg/Report.msg", REPORT),
        ("ros1/lab_msgs/msg/Part.msg", "geometry_msgs/Pose pose\nlab_interfaces/Grip grip\n"),
        ("ros1/lab_msgs/srv/Look.srv", "geometry_msgs/Point at\n---\nReport report\n"),
        ("ros2/lab_interfaces/msg/Grip.msg", "float64 force\nbuiltin_interfaces/Time at\n"),
        // ROS 2 has an outer type only.
        ("ros2/lab_msgs/msg/Report.msg", &REPORT.replace("Header", "std_msgs/Header")),
    ]);
    let mut types = types_of(&packages);
    let report = types.definition("lab_msgs/Report").unwrap();
    for inside in ["std_msgs/Header\nuint32 seq", "lab_interfaces/Grip\nfloat64 force\ntime at"] {
        assert!(report.text.contains(&format!("MSG: {inside}")), "{}", report.text);
    }
    let plan = types.plan(&report).unwrap();
    assert_eq!(plan.ros2_type().to_string(), "lab_msgs/msg/Report");
    assert!(notes(&plan).iter().all(|note| note.contains(".seq is")), "{:?}", notes(&plan));
    service(&mut types, "lab_msgs/Look");
}

#[test]
fn what_a_publisher_shows_is_used_whatever_lies_on_the_disk() {
    let packages = packages(&[
        ("ros1/lab_msgs/msg/Part.msg", "no definition at all\n"),
        ("ros1/lab_msgs/msg/Old.msg", "Nowhere it\n"),
        ("ros2/lab_msgs/msg/Part.msg", "int32[ x\n"),
        ("ros2/lab_msgs/msg/Old.msg", "Nowhere it\n"),
    ]);
    let mut types = types_of(&packages);
    for name in ["lab_msgs/Part", "lab_msgs/Old"] {
        let ros2 = TypeName::parse(Dialect::Ros2, &name.replace('/', "/msg/")).unwrap();
        types.definition(name).unwrap_err();
        types.ros2_type_named(&ros2).unwrap_err();
        let shown = types.show(name, "*", "float32 x\n").unwrap();
        assert_eq!(types.definition(name).unwrap(), shown);
        assert_eq!(types.plan(&shown).unwrap().ros2_type(), &ros2);
        assert_eq!(types.ros2_type_named(&ros2).unwrap().name(), &ros2);
    }
}

#[test]
fn a_type_that_was_found_elsewhere_counts() {
    let pair = resolve(Dialect::Ros2, "lab_msgs/msg/Pair", "int32 a\nint32 b\n");
    let mut types = Types::new(Rules::built_in(), TypeStore::empty());
    let unknown = types.definition("lab_msgs/Pair").unwrap_err();
    assert!(matches!(unknown, DefinitionError::Unknown { .. }), "{unknown}");
    types.add_ros2(&pair);
    let definition = types.definition("lab_msgs/Pair").unwrap();
    assert_eq!(definition.text, "int32 a\nint32 b\n");
    // The known definition stays.
    types.add_ros2(&resolve(Dialect::Ros2, "lab_msgs/msg/Pair", "int8 a\n"));
    assert_eq!(types.definition("lab_msgs/Pair").unwrap(), definition);
}

#[test]
fn a_type_that_only_ros2_has_goes_to_ros1() {
    let mut store = TypeStore::empty();
    let name = TypeName::parse(Dialect::Ros2, "lab_msgs/msg/Sample").unwrap();
    let text = "string UNIT=\"m/s\"\nuint8 MANY=3\nstd_msgs/Header header\nbuiltin_interfaces/Time t\n\
                float64[<=4] values\nstring<=9 unit \"m\"\nwstring w\nsensor_msgs/Range[] ranges\n";
    store.add_definition(&name, text).unwrap();
    for (name, text) in [
        ("std_msgs/msg/Header", "builtin_interfaces/Time stamp\nstring frame_id\n"),
        ("sensor_msgs/msg/Range", "float32 range\nfloat32 variance\n"),
    ] {
        store.add_definition(&TypeName::parse(Dialect::Ros2, name).unwrap(), text).unwrap();
    }
    let mut types = Types::new(Rules::built_in(), store);
    let ros2 = types.ros2_type_named(&name).unwrap();
    let (definition, plan) = types.counterpart(&ros2).unwrap();
    let text = definition.text.as_str();
    assert!(
        text.starts_with(
            "string UNIT=m/s\nuint8 MANY=3\nstd_msgs/Header header\ntime t\nfloat64[] values\n\
             string unit\nstring w\nsensor_msgs/Range[] ranges\n\n====="
        ),
        "{text}"
    );
    // Types that ROS 1 has itself are taken from there.
    assert!(text.contains("MSG: std_msgs/Header\nuint32 seq\ntime stamp\n"), "{text}");
    assert!(text.contains("float32 field_of_view") && !text.contains("variance"), "{text}");
    assert_eq!(Definition::from_header("lab_msgs/Sample", text).unwrap().md5sum, definition.md5sum);
    assert_eq!(plan.ros1_type().to_string(), "lab_msgs/msg/Sample");
    // A service likewise.
    let name = TypeName::parse(Dialect::Ros2, "lab_msgs/srv/Measure").unwrap();
    let mut store = TypeStore::empty();
    store
        .add_definition(&name, "string<=5 what\n---\nbuiltin_interfaces/Time at\nfloat32[] v\n")
        .unwrap();
    let mut types = Types::new(Rules::built_in(), store);
    let ros2 = types.ros2_type_named(&name).unwrap();
    let (definition, [request, _]) = types.service_counterpart(&ros2, None).unwrap();
    assert_eq!(definition.text, "string what\n---\ntime at\nfloat32[] v\n");
    assert_eq!(definition.request_type(), "lab_msgs/MeasureRequest");
    assert_eq!(to_cdr(&request, b"\x01\0\0\0a").unwrap().0, b"\0\x01\0\0\x02\0\0\0a\0");
}

#[test]
fn services_that_wrapyfi_makes_by_hand_have_its_checksums() {
    let mut types = Types::new(Rules::built_in(), TypeStore::empty());
    let (definition, ros2, [_, response]) = service(&mut types, "wrapyfi_services/ROSImage");
    assert_eq!(definition.md5sum, "f720f2021b4bbbe86b0f93b08906381c");
    assert_eq!(definition.request_type(), "std_msgs/String");
    assert_eq!(definition.response_type(), "sensor_msgs/Image");
    assert_eq!(ros2.name().to_string(), "wrapyfi_ros2_interfaces/srv/ROS2ImageService");
    let image = types.definition("sensor_msgs/Image").unwrap();
    let image = types.plan(&image).unwrap();
    let bytes = [&[0; 16 + 8], b"\x05\0\0\0mono8\0\x01\0\0\0\x02\0\0\0ab".as_slice()].concat();
    assert_eq!(to_cdr(&response, &bytes), to_cdr(&image, &bytes));
    assert_eq!(to_ros1(&response, &to_cdr(&image, &bytes).unwrap().0).unwrap().0, bytes);
    let (definition, ros2, [request, response]) =
        service(&mut types, "wrapyfi_services/ROSNativeObject");
    assert_eq!(definition.md5sum, "46a550fd1ca640b396e26ebf988aed7b");
    assert_eq!(ros2.name().to_string(), "wrapyfi_ros2_interfaces/srv/ROS2NativeObjectService");
    let (cdr, _) = to_cdr(&request, b"\x02\0\0\0[]").unwrap();
    assert_eq!(cdr, b"\0\x01\0\0\x03\0\0\0[]\0");
    assert_eq!(to_ros1(&response, &cdr).unwrap().0, b"\x02\0\0\0[]");
}

#[test]
fn odd_names_of_ros1_become_names_of_ros2() {
    let mut types = Types::new(Rules::built_in(), TypeStore::empty());
    let text =
        "uint8 frameId\nmy_part MyPart\nuint8 K\n================\nMSG: Odd/my_part\nuint8 x_\n";
    let odd = types.show("Odd/my_type", "*", text).unwrap();
    let ros2 = types.ros2_type(&odd.resolved).unwrap();
    assert_eq!(ros2.name().to_string(), "odd/msg/MyType");
    let fields = ros2.definitions().values().flat_map(|definition| {
        let fields = definition.fields.iter();
        fields.map(|field| format!("{}: {} {}", definition.name, field.field_type, field.name))
    });
    assert_eq!(
        fields.collect::<Vec<_>>(),
        [
            "odd/msg/MyPart: uint8 x",
            "odd/msg/MyType: uint8 frame_id",
            "odd/msg/MyType: odd/MyPart my_part",
            "odd/msg/MyType: uint8 k"
        ]
    );
    let plan = types.plan(&odd).unwrap();
    assert_eq!(to_cdr(&plan, b"\x01\x02\x03").unwrap().0[4..], [1, 2, 3]);
    assert_eq!(
        notes(&plan),
        [
            "K of ROS 1 is k in ROS 2",
            "MyPart of ROS 1 is my_part in ROS 2",
            "MyPart.x_ of ROS 1 is my_part.x in ROS 2",
            "frameId of ROS 1 is frame_id in ROS 2"
        ]
    );
}

#[test]
fn rules_of_ros1_bridge_choose_names_and_fields() {
    let yaml = "
- ros1_package_name: lab_msgs
  ros2_package_name: lab_interfaces
- ros1_package_name: demo
  ros1_message_name: A
  ros2_package_name: demo
  ros2_message_name: A
  fields_1_to_2: { header.stamp: when.at, Value: result, 'deep.er.x': y }
- ros1_package_name: demo
  ros1_service_name: Do
  ros2_package_name: work
  ros2_service_name: Act
  request_fields_1_to_2: { what: job }
";
    let rules = read_rules(yaml).unwrap();
    let one = format!(
        "Header header\nfloat32 Value\nuint8 same\nDeep deep\n{SEPARATOR}MSG: std_msgs/Header\nuint32 seq\n\
         time stamp\nstring frame_id\n{SEPARATOR}MSG: demo/Deep\nEr er\n{SEPARATOR}MSG: demo/Er\nstring s\nuint16 x\n"
    );
    let two = format!(
        "uint16 y\nfloat32 result\nuint8 same\nWhen when\n{SEPARATOR}MSG: demo/When\nint8 n\n\
         builtin_interfaces/Time at\n"
    );
    let plan = compile_with(&rules, &one, &two).unwrap();
    let mut bytes = vec![9, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 0, 0, 0, 0];
    bytes.extend(1.5_f32.to_le_bytes());
    bytes.extend(b"\x07\x01\0\0\0s\x05\x06");
    let (cdr, _) = to_cdr(&plan, &bytes).unwrap();
    let at = serde_json::json!({"sec": 1, "nanosec": 2});
    assert_eq!(
        read(&two, &cdr),
        serde_json::json!({"y": 0x605, "result": 1.5, "same": 0, "when": {"n": 0, "at": at}})
    );
    let (back, _) = to_ros1(&plan, &cdr).unwrap();
    let mut expected = vec![0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 0, 0, 0, 0];
    expected.extend(1.5_f32.to_le_bytes());
    expected.extend(b"\0\0\0\0\0\x05\x06");
    assert_eq!(back, expected);
    let others = read_rules(
        &yaml.replace("ros1_message_name: A", "ros1_message_name: A\n  match_other_fields: true"),
    );
    let plan = compile_with(&others.unwrap(), &one, &two).unwrap();
    assert_eq!(read(&two, &to_cdr(&plan, &bytes).unwrap().0)["same"], 7);

    let name = |text| TypeName::parse(Dialect::Ros1, text).unwrap();
    let in_ros2 = |text| rules.ros2_names(&name(text))[0].to_string();
    assert_eq!(in_ros2("lab_msgs/X"), "lab_interfaces/msg/X");
    assert_eq!(in_ros2("demo/srv/Do_Request"), "work/srv/Act_Request");
    assert_eq!(in_ros2("tf/tfMessage"), "tf2_msgs/msg/TFMessage");
    assert_eq!(rules.ros1_names(&name("lab_interfaces/X"))[0].to_string(), "lab_msgs/msg/X");
    let error = compile_with(&rules, "uint8 a\n", "uint8 a\n").unwrap_err();
    assert!(matches!(error, PairError::RuleField { .. }), "{error}");
    let twice = yaml.replace("Value: result", "Value: result, header: same");
    let error = compile_with(&read_rules(&twice).unwrap(), &one, &two).unwrap_err();
    assert!(matches!(error, PairError::RuleTwice { .. }), "{error}");
}

fn read_rules(yaml: &str) -> Result<Rules, serde_saphyr::Error> {
    serde_saphyr::from_str::<Option<Rules>>(yaml).map(Option::unwrap_or_default)
}

#[test]
fn rules_that_make_no_sense_are_refused() {
    let refused = |yaml: &str| read_rules(yaml).unwrap_err().to_string();
    let both = "ros1_package_name: a, ros2_package_name: b";
    assert!(refused(&format!("[{{{both}, ros1_mesage_name: C}}]")).contains("ros1_mesage_name"));
    assert!(refused("[{ros1_package_name: a}]").contains("ros2_package_name"));
    for (keys, reason) in [
        ("ros1_message_name: C", "give both"),
        ("ros2_service_name: C", "give both"),
        ("fields_1_to_2: {a: b}", "needs ros1_message_name"),
        ("request_fields_1_to_2: {a: b}", "need ros1_service_name"),
        (
            "ros1_message_name: C, ros2_message_name: C, ros1_service_name: C, ros2_service_name: C",
            "two rules",
        ),
    ] {
        let error = refused(&format!("[{{{both}}}, {{{both}, {keys}}}]"));
        assert!(error.contains("rule 2 (of a)") && error.contains(reason), "{error}");
    }
    assert_eq!(read_rules("").unwrap(), Rules::built_in());
    read_rules(&format!("[{{{both}, enable_foreign_mappings: true}}]")).unwrap();
}

#[test]
fn the_plan_of_an_image_is_one_copy() {
    let mut types = Types::new(Rules::built_in(), test_data::store());
    let image = types.definition("sensor_msgs/Image").unwrap();
    let plan = types.plan(&image).unwrap();
    // header, sizes, encoding, is_bigendian, step, data; twice.
    assert!(format!("{plan:?}").contains("to_ros2: 8"), "{plan:?}");
    let cloud = types.definition("sensor_msgs/PoseArray").unwrap_err();
    assert!(matches!(cloud, DefinitionError::Unknown { .. }));
}

/// Value of a constant as genpy reads it (`convert_constant_value` of genmsg); `None` where it refuses.
fn read_by_genpy(element: &str, text: &str) -> Option<i128> {
    let python_int = |text: &str| {
        let digits = text.strip_prefix(['-', '+']).unwrap_or(text);
        let is_int = !digits.is_empty() && digits.bytes().all(|digit| digit.is_ascii_digit());
        is_int.then(|| text.parse::<i128>().ok()).flatten()
    };
    if element == "bool" {
        return match text {
            "True" => Some(1),
            "False" => Some(0),
            _ => python_int(text).map(|value| i128::from(value != 0)),
        };
    }
    let bits = match element {
        "byte" | "char" => 8,
        _ => element.trim_start_matches("uint").trim_start_matches("int").parse::<u32>().unwrap(),
    };
    let range = match element.starts_with('u') || element == "char" {
        true => 0..=(1_i128 << bits) - 1,
        false => -(1_i128 << (bits - 1))..=(1_i128 << (bits - 1)) - 1,
    };
    python_int(text).filter(|value| range.contains(value))
}

/// Definition that ROS 1 nodes are shown of a ROS 2 type with one constant.
fn shown_with(constant: &str) -> Definition {
    let mut types = Types::new(Rules::built_in(), TypeStore::empty());
    types.add_ros2(&resolve(Dialect::Ros2, "lab_msgs/msg/Kept", &format!("{constant}\nint8 x\n")));
    types.definition("lab_msgs/Kept").unwrap()
}

/// A node of ROS 1 refused `0x1F` and `true`, and no definition of its own could have their checksum.
#[test]
fn constants_are_written_as_ros_1_writes_them() {
    for (ros2, ros1) in [
        ("uint8 X=0x1F", "31"),
        ("uint8 X=0o17", "15"),
        ("uint8 X=0b1", "1"),
        ("int8 X=-0x1", "-1"),
        ("uint8 X=31", "31"),
        ("byte X=0xFF", "-1"),
        ("char X=0x41", "65"),
        ("bool X=true", "True"),
        ("bool X=FALSE", "False"),
        ("bool X=1", "1"),
        ("float32 X=1e3", "1e3"),
        ("string X='a # b'", "a # b"),
    ] {
        let shown = shown_with(ros2);
        let (element, _) = ros2.split_once(' ').unwrap();
        let text = format!("{element} X={ros1}\nint8 x\n");
        assert_eq!(shown.text, text, "{ros2}");
        let of_node = Definition::from_header("lab_msgs/Kept", &text).unwrap();
        assert_eq!(shown.md5sum, of_node.md5sum, "{ros2}");
    }
}

proptest::proptest! {
    /// Every form of a constant that ROS 2 takes is read by genpy with the same value.
    #[test]
    fn every_constant_is_read_by_genpy(
        element in proptest::sample::select(vec![
            "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64", "byte", "char", "bool",
        ]),
        value in proptest::num::i64::ANY,
        form in 0_usize..6,
        sign in proptest::sample::select(vec!["", "+"]),
    ) {
        let value = i128::from(value);
        let value = match element {
            "bool" => value & 1,
            "int8" => value % 128,
            "uint8" | "byte" | "char" => value.rem_euclid(256),
            "int16" => value % 32_768,
            "uint16" => value.rem_euclid(65_536),
            "int32" => value % (1 << 31),
            "uint32" => value.rem_euclid(1 << 32),
            "uint64" => value.rem_euclid(1 << 64),
            _ => value,
        };
        let (minus, size) = (if value < 0 { "-" } else { sign }, value.unsigned_abs());
        let text = match (element, form) {
            ("bool", form) => {
                let forms = [["0", "false", "False"], ["1", "true", "TRUE"]];
                forms[usize::from(value == 1)][form % 3].to_owned()
            }
            (_, 0) => format!("{minus}0x{size:x}"),
            (_, 1) => format!("{minus}0X{size:X}"),
            (_, 2) => format!("{minus}0o{size:o}"),
            (_, 3) => format!("{minus}0b{size:b}"),
            (_, 4) => format!("{minus}00{size}"),
            _ => format!("{minus}{size}"),
        };
        let shown = shown_with(&format!("{element} X={text}"));
        let line = shown.text.lines().next().unwrap();
        let written = line.split_once('=').unwrap().1;
        let same = if element == "byte" && value > 127 { value - 256 } else { value };
        proptest::prop_assert_eq!(read_by_genpy(element, written), Some(same), "{} {}", text, written);
    }
}

/// Writes definitions into a folder.
fn folder_of(files: &[(&str, &str)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (path, text) in files {
        let path = folder.path().join(path);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }
    folder
}

/// Types inside one that a publisher has shown serve services, too: they were defined nowhere.
#[test]
fn a_service_shares_a_type_with_a_topic() {
    let service = "n_msgs/Bb b\n---\nn_msgs/Bb b\nn_msgs/A[] more\n";
    let only_service = folder_of(&[("n/srv/S2.srv", service)]);
    let with_messages = folder_of(&[
        ("n/srv/S2.srv", service),
        ("n_msgs/msg/Bb.msg", "A a\nint32 n\n"),
        ("n_msgs/msg/A.msg", "string text\n"),
    ]);
    let shown = "A a\nint32 n\n\n================\nMSG: n_msgs/A\nstring text\n";
    for (ros1, ros2) in [
        (Some(&with_messages), None),
        (Some(&only_service), None),
        (None, Some(&with_messages)),
        (Some(&only_service), Some(&only_service)),
    ] {
        let mut store = TypeStore::empty();
        ros2.into_iter().for_each(|folder| store.add_folder(folder.path()));
        let mut types = Types::new(Rules::built_in(), store);
        ros1.into_iter().for_each(|folder| types.add_ros1_path(folder.path().as_os_str()));
        for _again in 0..2 {
            let definition = types.show("n_msgs/Bb", "*", shown).unwrap();
            let made = types.ros2_type(&definition.resolved).unwrap();
            types.add_ros2(&made);
            let made = types
                .ros2_service("n/S2", None)
                .unwrap_or_else(|e| panic!("{ros1:?} {ros2:?}: {e}"));
            types.add_ros2(&made);
            let found = types.service_counterpart(&made, None);
            let (_, plans) = found.unwrap_or_else(|e| panic!("{ros1:?} {ros2:?}: {e}"));
            assert_eq!(plans.each_ref().map(notes), [Vec::<String>::new(), Vec::new()]);
        }
    }
}

/// A publisher that was started again with another definition had its new field dropped.
#[test]
fn the_type_that_is_made_follows_its_publisher() {
    let mut types = Types::new(Rules::built_in(), TypeStore::empty());
    let mut made = |text: &str| {
        let shown = types.show("demo/A", "*", text).unwrap();
        let made = types.ros2_type(&shown.resolved).unwrap();
        types.add_ros2(&made);
        let definitions = made.definitions().values();
        let fields = definitions.flat_map(|one| one.fields.iter());
        fields.map(|field| format!("{} {}", field.field_type, field.name)).collect::<Vec<_>>()
    };
    let part = "\n================\nMSG: demo/B\n";
    assert_eq!(made(&format!("B b\n{part}int32 x\n")), ["demo/B b", "int32 x"]);
    let wider = format!("B b\nint32 more\n{part}int64 x\n");
    assert_eq!(made(&wider), ["demo/B b", "int32 more", "int64 x"]);
    assert_eq!(made("int8 x\n"), ["int8 x"]);
}

/// Two routes took turns: each ended the other with what its publisher showed.
#[test]
fn nodes_of_different_versions_each_have_theirs() {
    let mut types = Types::new(Rules::built_in(), TypeStore::empty());
    let part = "B b\n\n================\nMSG: demo/B\n";
    let shown = [
        ("demo/A", "int32 code\n".to_owned()),
        ("demo/A", "int32 code\nstring text\n".to_owned()),
        ("demo/C", format!("{part}int32 x\n")),
        ("demo/D", format!("{part}int32 x\nint32 y\n")),
    ]
    .map(|(name, text)| types.show(name, "*", &text).unwrap());
    for _again in 0..2 {
        for definition in &shown {
            let made = types.ros2_type(&definition.resolved).unwrap();
            types.add_ros2(&made);
            let (counterpart, plan) = types.counterpart(&made).unwrap();
            assert_eq!(counterpart.md5sum, definition.md5sum, "{}", definition.text);
            assert_eq!(notes(&plan), Vec::<String>::new(), "{}", definition.text);
            types.show(&definition.ros1_name(), "*", &definition.text).unwrap();
        }
    }
    // What no node shows goes in the version that loses least, and the loss is told.
    let text = format!("demo/B b{SEPARATOR}MSG: demo/B\nint32 x\nint32 y\nint32 z\n");
    for name in ["demo/msg/C", "demo/msg/Other"] {
        let (found, plan) = types.counterpart(&resolve(Dialect::Ros2, name, &text)).unwrap();
        assert!(!found.text.contains("int32 z") && !plan.is_whole(), "{}", found.text);
    }
}

/// A recording of ROS 2 may have both, and its player publishes both on ROS 1.
#[test]
fn of_two_versions_that_only_ros2_has_each_goes_to_ros1_whole() {
    let mut types = Types::new(Rules::built_in(), TypeStore::empty());
    for text in ["int32 code\n", "int32 code\nstring text\n"] {
        let ros2 = resolve(Dialect::Ros2, "lab_msgs/msg/Status", text);
        types.add_ros2(&ros2);
        assert_eq!(types.counterpart(&ros2).unwrap().0.text, text);
    }
}
