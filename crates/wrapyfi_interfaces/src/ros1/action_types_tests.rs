//! Tests of the types of actions.

use std::ffi::OsStr;
use std::path::PathBuf;

use super::super::Rules;
use super::*;
use crate::store::TypeStore;

const FIBONACCI: &str =
    "#goal definition\nint32 order\n---\nint32[] sequence\n---\nint32[] sequence\n";

/// A folder with the package `demo` of ROS 1, until it is dropped.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str, file: &str, text: &str) -> Self {
        let folder = std::env::temp_dir().join(format!("wrapyfi-{name}-{}", std::process::id()));
        let file = folder.join("demo").join(file);
        std::fs::create_dir_all(file.parent().unwrap()).unwrap();
        std::fs::write(folder.join("demo/package.xml"), "<package><name>demo</name></package>")
            .unwrap();
        std::fs::write(file, text).unwrap();
        Self(folder)
    }

    fn types(&self) -> Types {
        let mut types = Types::new(Rules::built_in(), TypeStore::empty());
        types.add_ros1_path(OsStr::new(self.0.as_os_str()));
        types
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        _ = std::fs::remove_dir_all(&self.0);
    }
}

fn fields(resolved: &ResolvedType) -> Vec<String> {
    resolved.definition().unwrap().fields.iter().map(|field| field.name.clone()).collect()
}

/// The checksums are those of `actionlib_tutorials` 0.2, and do not depend on the package.
#[test]
fn an_action_file_gives_the_messages_of_genaction() {
    let folder = Folder::new("action-file", "action/Fibonacci.action", FIBONACCI);
    let mut types = folder.types();
    let made = types.ros2_action("demo/Fibonacci", &[]).unwrap();
    for (name, md5sum) in [
        ("Goal", "006871c7fa1d0e3d5fe2226bf17b2a94"),
        ("Result", "bee73a9fe29ae25e966e105f5553dd03"),
        ("Feedback", "73b8497a9f629a31c0020900e4148f07"),
    ] {
        let (message, _) = types.counterpart(&made.part(&format!("_{name}")).unwrap()).unwrap();
        assert_eq!(message.ros1_name(), format!("demo/FibonacciAction{name}"));
        assert_eq!(message.md5sum, md5sum, "{name}");
    }
    assert_eq!(made.name().to_string(), "demo/action/Fibonacci");
    assert_eq!(fields(&made.part("_Goal").unwrap()), ["order"]);
    assert!(made.part("_SendGoal_Request").is_some());
}

/// A text as a publisher shows it, of a package that nobody has.
fn shown(types: &mut Types, name: &str, companion: &str, carried: &str) -> Definition {
    let (kind, field) = match companion {
        "goal_id" => ("GoalID", "goal"),
        _ if name.ends_with("Result") => ("GoalStatus", "result"),
        _ => ("GoalStatus", "feedback"),
    };
    let line = "=".repeat(80);
    let inner = name.replace("Action", "");
    let mut text = format!(
        "Header header\nactionlib_msgs/{kind} {companion}\n{inner} {field}\n{line}\nMSG: own/{inner}\n{carried}\n"
    );
    for inside in ["std_msgs/Header", "actionlib_msgs/GoalStatus", "actionlib_msgs/GoalID"] {
        let definition = types.definition(inside).unwrap();
        let own = definition.text.split('=').next().unwrap();
        text.push_str(&format!("{line}\nMSG: {inside}\n{own}\n"));
    }
    types.show(&format!("own/{name}"), "*", &text).unwrap()
}

/// Parts whose fields are called as the parts themselves are no difficulty.
#[test]
fn an_action_that_nobody_has_is_learned_from_what_publishers_show() {
    let mut types = Types::new(Rules::built_in(), TypeStore::empty());
    shown(&mut types, "CountActionGoal", "goal_id", "int32 goal\nint32 result\nint32 feedback");
    shown(&mut types, "CountActionResult", "status", "string[] result");
    let error = types.ros2_action("own/Count", &[]).unwrap_err().to_string();
    assert!(error.contains("own/Count_Feedback is not known"), "{error}");
    assert!(error.contains("own/action/Count.action"), "{error}");
    shown(&mut types, "CountActionFeedback", "status", "float32 feedback\ntime status");
    let made = types.ros2_action("own/Count", &[]).unwrap();
    assert_eq!(fields(&made.part("_Goal").unwrap()), ["goal", "result", "feedback"]);
    assert_eq!(fields(&made.part("_Result").unwrap()), ["result"]);
    for suffix in ["_Goal", "_Result", "_Feedback"] {
        types.counterpart(&made.part(suffix).unwrap()).unwrap();
    }
}

#[test]
fn a_message_that_is_none_of_an_action_is_refused() {
    let text = "std_msgs/Header header\nint32 goal_id\nint32 goal\n";
    let header =
        "=".repeat(80) + "\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n";
    let odd = Definition::from_header("own/OddActionGoal", &(text.to_owned() + &header)).unwrap();
    let error = ActionMessage::new(odd).unwrap_err().to_string();
    assert!(error.contains("own/msg/OddActionGoal is no message of an action"), "{error}");
}

#[test]
fn an_action_of_ros_2_gives_the_messages_of_ros_1() {
    let mut ros2 = TypeStore::empty();
    let name = TypeName::parse(Dialect::Ros2, "lab_interfaces/action/Fibonacci").unwrap();
    ros2.add_definition(&name, FIBONACCI).unwrap();
    let mut types = Types::new(Rules::built_in(), ros2);
    let goal = types.ros2_type_named(&name).unwrap().part("_Goal").unwrap();
    let (message, _) = types.counterpart(&goal).unwrap();
    assert_eq!(message.ros1_name(), "lab_interfaces/FibonacciActionGoal");
    assert_eq!(message.md5sum, "006871c7fa1d0e3d5fe2226bf17b2a94");
}

#[test]
fn a_rule_brings_actions_of_different_names_and_fields_together() {
    let folder = Folder::new("action-rule", "action/Fibonacci.action", FIBONACCI);
    let rules = r#"[{"ros1_package_name": "demo", "ros1_action_name": "Fibonacci",
        "ros2_package_name": "lab_interfaces", "ros2_action_name": "Row",
        "goal_fields_1_to_2": {"order": "length"},
        "result_fields_1_to_2": {"sequence": "numbers"},
        "feedback_fields_1_to_2": {"sequence": "so_far"}}]"#;
    let mut ros2 = TypeStore::empty();
    let name = TypeName::parse(Dialect::Ros2, "lab_interfaces/action/Row").unwrap();
    let text = "int32 length\n---\nint32[] numbers\n---\nint32[] so_far\n";
    ros2.add_definition(&name, text).unwrap();
    let mut types = Types::new(serde_json::from_str(rules).unwrap(), ros2);
    types.add_ros1_path(OsStr::new(folder.0.as_os_str()));
    let found = types.ros2_action("demo/Fibonacci", &[]).unwrap();
    assert_eq!(found.name(), &name);
    for suffix in ["_Goal", "_Result", "_Feedback"] {
        let (_, plan) = types.counterpart(&found.part(suffix).unwrap()).unwrap();
        assert_eq!(plan.notes().iter().filter(|note| note.is_loss()).count(), 0);
    }
    let mut known = TypeStore::empty();
    known.add_definition(&name, text).unwrap();
    assert_eq!(types.check_rules(&mut known), Vec::<String>::new());
}

/// Two servers took turns: the types of each went by what was shown last, be they of one action or of two.
#[test]
fn actions_of_different_versions_each_have_theirs() {
    let mut types = Types::new(Rules::built_in(), TypeStore::empty());
    let line = "=".repeat(80);
    let servers = [("Count", "int32 x"), ("Row", "int32 x\nint32 y"), ("Count", "string text")];
    let servers = servers.map(|(action, fields)| {
        let parts = [("Goal", "goal_id"), ("Result", "status"), ("Feedback", "status")];
        let carried = format!("Part part\n{line}\nMSG: own/Part\n{fields}");
        let shown = parts.map(|(part, companion)| {
            shown(&mut types, &format!("{action}Action{part}"), companion, &carried)
        });
        (action, fields, shown)
    });
    for _again in 0..2 {
        for (action, fields, shown) in &servers {
            // Nobody has sent a goal yet.
            for told in [&shown.each_ref()[..], &shown.each_ref()[1..]] {
                let made = types.ros2_action(&format!("own/{action}"), told).unwrap();
                types.add_ros2(&made);
                let part = TypeName::parse(Dialect::Ros2, "own/msg/Part").unwrap();
                let inside = made.definitions()[&part].fields.iter();
                let inside = inside.map(|it| format!("{} {}", it.field_type.element, it.name));
                assert_eq!(inside.collect::<Vec<_>>().join("\n"), *fields);
                for (suffix, shown) in ["_Goal", "_Result", "_Feedback"].iter().zip(shown) {
                    let (found, _) = types.counterpart(&made.part(suffix).unwrap()).unwrap();
                    assert_eq!(found.md5sum, shown.md5sum, "{action}{suffix} {fields}");
                }
            }
        }
    }
}

/// The names of its messages, too, were those of ROS 2.
#[test]
fn an_action_whose_name_ros_2_forbids_is_found_again() {
    let mut types = Types::new(Rules::built_in(), TypeStore::empty());
    let shown = [("Goal", "goal_id"), ("Result", "status"), ("Feedback", "status")].map(
        |(part, companion)| {
            shown(&mut types, &format!("go_homeAction{part}"), companion, "int32 x")
        },
    );
    let made = types.ros2_action("own/go_home", &shown.each_ref()).unwrap();
    assert_eq!(made.name().to_string(), "own/action/GoHome");
    types.add_ros2(&made);
    for (suffix, shown) in ["_Goal", "_Result", "_Feedback"].iter().zip(&shown) {
        let (found, _) = types.counterpart(&made.part(suffix).unwrap()).unwrap();
        assert_eq!(&found, shown);
    }
}
