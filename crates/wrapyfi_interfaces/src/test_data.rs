//! Recorded data for tests (`tests/data`).

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::parser::Dialect;
use crate::store::TypeStore;

pub(crate) fn path(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name)
}

pub(crate) fn json(name: &str) -> Value {
    serde_json::from_slice(&std::fs::read(path(name)).unwrap()).unwrap()
}

pub(crate) fn unhex(text: &str) -> Vec<u8> {
    let digit = |c: &u8| char::from(*c).to_digit(16).unwrap() as u8;
    text.as_bytes().chunks(2).map(|pair| digit(&pair[0]) << 4 | digit(&pair[1])).collect()
}

/// Type as a definition writes it, from the numbers of a type description.
fn written_type(field: &[Value]) -> String {
    let id = field[1].as_u64().unwrap();
    let (capacity, bound) = (field[2].as_u64().unwrap(), field[3].as_u64().unwrap());
    let element = match id % 48 {
        1 => field[4].as_str().unwrap().replace("/msg/", "/"),
        2 => "int8".to_owned(),
        3 => "uint8".to_owned(),
        4 => "int16".to_owned(),
        5 => "uint16".to_owned(),
        6 => "int32".to_owned(),
        7 => "uint32".to_owned(),
        8 => "int64".to_owned(),
        9 => "uint64".to_owned(),
        10 => "float32".to_owned(),
        11 => "float64".to_owned(),
        15 => "bool".to_owned(),
        16 => "byte".to_owned(),
        17 => "string".to_owned(),
        18 => "wstring".to_owned(),
        21 => format!("string<={bound}"),
        22 => format!("wstring<={bound}"),
        other => panic!("type id {other}"),
    };
    match id / 48 {
        0 => element,
        1 => format!("{element}[{capacity}]"),
        2 => format!("{element}[<={capacity}]"),
        _ => format!("{element}[]"),
    }
}

/// Default value as a definition writes it, from the way Python does.
fn written_default(field: &[Value]) -> String {
    let (id, text) = (field[1].as_u64().unwrap(), field[5].as_str().unwrap());
    if let Some(inside) = text.strip_prefix('(').filter(|_| id >= 48) {
        return format!("[{}]", inside.trim_end_matches(')'));
    }
    match (id, text) {
        (_, "") => String::new(),
        (17 | 18 | 21 | 22, text) => format!("\"{}\"", text.replace('"', "\\\"")),
        (_, text) => text.to_owned(),
    }
}

/// A prefix as ROS 2 installs it at `/ros`, rebuilt from the fields of all its types.
pub(crate) fn ament_prefix() -> BTreeMap<PathBuf, String> {
    let fields = json("all_fields.json");
    let fields = fields.as_object().unwrap();
    let definition = |name: &str| -> String {
        let line = |field: &Value| {
            let field = field.as_array().unwrap();
            let name = field[0].as_str().unwrap();
            format!("{} {name} {}\n", written_type(field), written_default(field))
        };
        let fields = fields[name].as_array().unwrap().iter();
        fields.filter(|field| field[0] != "structure_needs_at_least_one_member").map(line).collect()
    };
    let share = Path::new("/ros/share");
    let mut files: BTreeMap<PathBuf, String> = BTreeMap::new();
    for full_name in fields.keys() {
        let parts: Vec<&str> = full_name.split('/').collect();
        let (package, kind, name) = (parts[0], parts[1], parts[2]);
        if name.contains('_') {
            continue; // part of an interface
        }
        let section = |suffix: &str| definition(&format!("{full_name}{suffix}"));
        let text = match kind {
            "msg" => section(""),
            "srv" => format!("{}---\n{}", section("_Request"), section("_Response")),
            _ => format!(
                "{}---\n{}---\n{}",
                section("_Goal"),
                section("_Result"),
                section("_Feedback")
            ),
        };
        files.insert(share.join(package).join(kind).join(format!("{name}.{kind}")), text);
        let index = share.join("ament_index/resource_index/rosidl_interfaces").join(package);
        files.entry(index).or_default().push_str(&format!("{kind}/{name}.{kind}\n"));
    }
    files
}

/// A store of all types of ROS 2.
pub(crate) fn store() -> TypeStore {
    let mut store = TypeStore::new(Dialect::Ros2, ament_prefix());
    store.add_ament_path("/none:/ros".as_ref());
    store
}
