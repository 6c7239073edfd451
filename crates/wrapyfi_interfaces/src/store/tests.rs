use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::*;
use crate::hash::hashed_text;
use crate::parser::DefaultValue;
use crate::test_data;

fn ros1(name: &str) -> TypeName {
    TypeName::parse(Dialect::Ros1, name).unwrap()
}

fn md5(name: &str, text: &str) -> String {
    ResolvedType::from_text(Dialect::Ros1, &ros1(name), text).unwrap().md5sum().unwrap()
}

fn memory(files: &[(&str, &str)]) -> BTreeMap<PathBuf, String> {
    files.iter().map(|(path, text)| (PathBuf::from(path), (*text).to_owned())).collect()
}

const HEADER: &str = "#Standard metadata\nuint32 seq\n#stamp\ntime stamp\nstring frame_id\n";

#[test]
fn every_type_of_ros_has_its_hash() {
    let mut store = test_data::store();
    let hashes = test_data::json("type_hashes.json");
    let mut checked = 0;
    for (name, hash) in hashes.as_object().unwrap() {
        if name.starts_with("wrapyfi_ros2_interfaces/") {
            continue;
        }
        let resolved = store.resolve_name(name).unwrap();
        assert_eq!(resolved.type_hash(), hash.as_str().unwrap(), "{name}");
        checked += 1;
    }
    assert_eq!(checked, 428);
}

#[test]
fn fields_and_default_values_are_described_as_ros_does() {
    let mut store = test_data::store();
    let all_fields = test_data::json("all_fields.json");
    for (name, expected) in all_fields.as_object().unwrap() {
        let resolved = store.resolve_name(name).unwrap();
        let described: Vec<_> = resolved
            .description()
            .type_description
            .fields
            .iter()
            .map(|f| {
                let default = f.default.as_ref().map(DefaultValue::to_python).unwrap_or_default();
                serde_json::json!([
                    f.name,
                    f.type_id,
                    f.capacity,
                    f.string_capacity,
                    f.nested_type_name,
                    default
                ])
            })
            .collect();
        assert_eq!(&serde_json::Value::from(described), expected, "{name}");
    }
}

#[test]
fn hashed_texts_are_those_of_ros() {
    let mut store = test_data::store();
    let inputs = test_data::json("hash_inputs.json");
    for (name, input) in inputs.as_object().unwrap() {
        let resolved = store.resolve_name(name).unwrap();
        assert_eq!(hashed_text(resolved.description()), input["canonical_json"], "{name}");
        assert_eq!(resolved.type_hash(), input["hash"], "{name}");
    }
}

#[test]
fn installed_definitions_with_comments_and_constants_have_their_hashes() {
    let mut store = TypeStore::new(Dialect::Ros2, Disk);
    store.add_folder(&test_data::path("interfaces"));
    store.add_folder(&Path::new(env!("CARGO_MANIFEST_DIR")).join("interfaces"));
    let hashes = test_data::json("type_hashes.json");
    for name in [
        "golden_msgs/action/Count",
        "golden_msgs/action/Count_GetResult_Event",
        "golden_msgs/srv/Mixed",
        "golden_msgs/srv/Nothing_Request",
        "golden_msgs/msg/Limits",
    ] {
        assert_eq!(store.resolve_name(name).unwrap().type_hash(), hashes[name], "{name}");
    }
}

#[test]
fn ros1_definitions_have_their_checksums() {
    let service = |name: &str, text: &str| {
        let name =
            TypeName::with_kind(Dialect::Ros1, "std_srvs", InterfaceKind::Service, name).unwrap();
        ResolvedType::from_text(Dialect::Ros1, &name, text).unwrap().md5sum().unwrap()
    };
    assert_eq!(md5("std_msgs/String", "string data\n"), "992ce8a1687cec8c8bd883ec73ca41d1");
    assert_eq!(md5("std_msgs/Header", HEADER), "2176decaecbce78abc3b96ef049fabed");
    let image = format!(
        "# An image\nHeader header  # stamp\nuint32 height\nuint32 width\nstring encoding\n\
         uint8 is_bigendian\nuint32 step\nuint8[] data\n{}\nMSG: std_msgs/Header\n{HEADER}",
        "=".repeat(80)
    );
    assert_eq!(md5("sensor_msgs/Image", &image), "060021388200f6f0f447d0fcd9c64743");
    let twist = "Vector3  linear\nVector3  angular\n\n\
        ================================================================================\n\
        MSG: geometry_msgs/Vector3\n# comment\n\nfloat64 x\nfloat64 y\nfloat64 z\n";
    assert_eq!(md5("geometry_msgs/Twist", twist), "9f195f881246fdfa2798d1d3eebca84a");
    let set_bool = "bool data # on\n---\nbool success   # well?\nstring message # why\n";
    assert_eq!(service("SetBool", set_bool), "09fb03525b03e7ea1fd3992bafd87e16");
    assert_eq!(service("Empty", "---\n"), "d41d8cd98f00b204e9800998ecf8427e");
    // Constants come first, however the file orders them, and keep their text.
    assert_eq!(
        md5("demo/C", "int32 x\nstring S= a # b \nbyte B=-1\n"),
        md5("demo/D", "string S=a # b\nbyte   B = -1 # c\nint32    x\n")
    );
}

#[test]
fn the_overlay_wins_and_folders_are_found() {
    let index = "share/ament_index/resource_index/rosidl_interfaces/demo_msgs";
    let mut store = TypeStore::new(
        Dialect::Ros2,
        memory(&[
            (&format!("/over/{index}"), "msg/Thing.msg\n"),
            ("/over/share/demo_msgs/msg/Thing.msg", "uint8 over"),
            (&format!("/under/{index}"), "msg/Thing.msg\nmsg/Wide.idl\n"),
            ("/under/share/demo_msgs/msg/Thing.msg", "uint8 under"),
            ("/mine/demo_msgs/msg/Other.msg", "Thing thing"),
            ("/mine/flat/More.msg", "uint8 more"),
            ("/mine/own_msgs/srv/Ask.srv", "---"),
        ]),
    );
    store.add_ament_path("/over::/under".as_ref());
    store.add_folder(Path::new("/mine"));
    store.add_folder(Path::new("/mine/flat"));
    store.add_folder(Path::new("/mine/own_msgs"));
    let thing = store.resolve_name("demo_msgs/Thing").unwrap();
    assert_eq!(thing.definition().unwrap().fields[0].name, "over");
    assert_eq!(store.resolve_name("demo_msgs/msg/Other").unwrap().definitions().len(), 2);
    store.resolve_name("flat/msg/More").unwrap();
    store.resolve_name("own_msgs/srv/Ask_Event").unwrap();
    assert_eq!(
        store.resolve_name("demo_msgs/msg/Wide").unwrap_err().to_string(),
        "demo_msgs/msg/Wide is installed as IDL only (/under/share/ament_index/resource_index/\
         rosidl_interfaces/demo_msgs lists no .msg file); give a folder with the same type as \
         demo_msgs/msg/Wide.msg"
    );
}

#[test]
fn a_misspelt_type_is_told_the_one_that_is_meant() {
    let mut store = TypeStore::empty().or_generated();
    for (name, meant) in [
        ("sensor_msgs/msg/Imgae", "defined nowhere; did you mean `Image`? "),
        ("geometry_msg/msg/Twist", "defined nowhere; did you mean `geometry_msgs`? "),
        ("std_srvs/srv/SetBol", "defined nowhere; did you mean `SetBool`? "),
        ("demo/msg/Imgae", "defined nowhere; no place"),
        ("sensor_msgs/msg/Imuu", "did you mean `Imu`? "),
    ] {
        let told = store.resolve_name(name).unwrap_err().to_string();
        assert!(told.contains(meant), "{told}");
    }
}

#[test]
fn errors_name_type_places_and_remedy() {
    let mut store = TypeStore::new(
        Dialect::Ros2,
        memory(&[("/f/demo_msgs/msg/Outer.msg", "Inner inner"), ("/f/demo_msgs/msg/Bad.msg", "x")]),
    );
    assert!(
        store.resolve_name("demo_msgs/Outer").unwrap_err().to_string().contains("PATH is empty")
    );
    store.add_folder(Path::new("/f"));
    assert_eq!(
        store.resolve_name("demo_msgs/Outer").unwrap_err().to_string(),
        "demo_msgs/msg/Inner, which demo_msgs/msg/Outer has a field of, is defined nowhere; looked \
         for /f/demo_msgs/msg/Inner.msg, /f/demo_msgs/Inner.msg, \
         /f/share/demo_msgs/msg/Inner.msg; install its package (ros-jazzy-demo-msgs) and source \
         its setup file, or give a folder with demo_msgs/msg/Inner.msg"
    );
    assert_eq!(
        store.resolve_name("demo_msgs/Bad").unwrap_err().to_string(),
        "/f/demo_msgs/msg/Bad.msg: demo_msgs/msg/Bad, line 1: a name must follow the type (the \
         line is \"x\")"
    );
    assert!(matches!(store.resolve_name("../../etc"), Err(ResolveError::Name { .. })));
    let text = "uint8 a\n========\nIDL: a/b\n";
    let name = TypeName::new("demo_msgs", "Thing").unwrap();
    let error = ResolvedType::from_text(Dialect::Ros2, &name, text).unwrap_err();
    assert!(error.to_string().contains("line 3: \"IDL: a/b\""), "{error}");
    let text = "uint8 a\n========\nMSG: a/B\n\nuint9 c";
    let error = ResolvedType::from_text(Dialect::Ros2, &name, text).unwrap_err();
    assert!(error.to_string().contains("line 5"), "{error}");
}

#[test]
fn cycles_depth_numbers_and_sizes_are_limited() {
    let mut files = BTreeMap::new();
    let mut add = |name: &str, text: String| {
        files.insert(PathBuf::from(format!("/f/d/msg/{name}.msg")), text);
    };
    add("A", "B b".into());
    add("B", "C c".into());
    add("C", "B[] b".into());
    for depth in 1..70 {
        add(&format!("Deep{depth}"), format!("Deep{} deeper", depth - 1));
    }
    add("Deep0", "uint8 x".into());
    add("Many", (0..1100).map(|i| format!("Leaf{i} leaf{i}\n")).collect());
    for leaf in 0..1100 {
        add(&format!("Leaf{leaf}"), String::new());
    }
    add("Huge", "#".repeat(MAX_DEFINITION_SIZE + 1));
    let mut store = TypeStore::new(Dialect::Ros2, files);
    store.add_folder(Path::new("/f"));
    let mut error = |name: &str| store.resolve_name(name).unwrap_err().to_string();
    assert_eq!(
        error("d/A"),
        "d/msg/B contains itself through d/msg/C; a message cannot be recursive"
    );
    assert!(error("d/Deep69").contains("more than 64 messages deep"));
    assert!(error("d/Deep64").contains("more than 64 messages deep"));
    assert!(error("d/Many").contains("more than 1024 types"));
    assert!(error("d/Huge").contains("over the limit of 1048576 bytes"));
    store.resolve_name("d/Deep63").unwrap();
}

proptest::proptest! {
    #[test]
    fn any_full_text_is_read_or_refused(text in "((uint8|time|a/B|Header)(\\[[0-9]?\\])? [a-z]+( 1|=1)?\n|---\n|========\n|MSG: a/B\n){0,9}") {
        for dialect in [Dialect::Ros1, Dialect::Ros2] {
            for kind in [InterfaceKind::Message, InterfaceKind::Service, InterfaceKind::Action] {
                let name = TypeName::with_kind(dialect, "demo", kind, "Thing").unwrap();
                if let Ok(resolved) = ResolvedType::from_text(dialect, &name, &text) {
                    assert!(resolved.type_hash().starts_with("RIHS01_"));
                }
            }
        }
    }
}
