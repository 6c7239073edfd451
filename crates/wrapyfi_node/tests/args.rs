//! Every observed command line of ROS 2 Jazzy must have the same effects and messages here.
//!
//! `data/ros_args/ros_args_cases.json` holds what an rclpy node named `talker` made of each:
//! names, parameters, log level, and the exception with its warnings where it was refused.

use std::collections::BTreeMap;
use std::io;

use serde_json::{Value, json};
use wrapyfi_node::args::{RosArgs, RosArgsErrorKind};
use wrapyfi_node::{NodeOptions, ParameterValue};

const CASES: &str = include_str!("data/ros_args/ros_args_cases.json");

/// Cases whose outcome differs on purpose, with the reason: none.
const NOT_MATCHED: [(&[&str], &str); 0] = [];

#[test]
fn every_observed_command_line_has_its_effects_and_messages() {
    let golden: Value = serde_json::from_str(CASES).unwrap();
    let cases = golden["cases"].as_array().unwrap();
    let mut wrong = Vec::new();
    for case in cases {
        let argv = strings(&case["args"]);
        if NOT_MATCHED.iter().any(|(skipped, _)| argv == *skipped) {
            continue;
        }
        let mut expected = expectation(case);
        let mut actual = outcome(&argv, &golden["yaml_files"], &case["facts"]["params"]);
        // ROS 2 says the numbers of lexemes there, or nothing; ours says what is wrong.
        let is_number =
            |reason| expected["exception"].as_str().is_some_and(|it| it.contains(reason));
        if ["Error: Expected lexeme", "Error: Expecting token", "Error: error not set"]
            .into_iter()
            .any(is_number)
        {
            [&mut expected, &mut actual].into_iter().for_each(leave_out_reason);
        }
        if actual != expected {
            wrong.push(format!("{argv:?}\n  expected {expected}\n  actual   {actual}"));
        }
    }
    assert!(cases.len() >= 164, "only {} cases", cases.len());
    assert!(wrong.is_empty(), "{} of {}:\n{}", wrong.len(), cases.len(), wrong.join("\n"));
}

/// Leaves out the reason of a refusal, and the warnings that came with it.
fn leave_out_reason(outcome: &mut Value) {
    let exception = outcome["exception"].as_str().unwrap_or_default();
    *outcome = json!({ "exception": exception.split(". Error: ").next() });
}

/// The facts of a case that a parser decides, in one object.
fn expectation(case: &Value) -> Value {
    let warnings: Vec<String> = strings(&case["stderr"])
        .iter()
        .filter_map(|line| line.strip_prefix("[WARN] [TIME] [rcl]: "))
        .map(str::to_owned)
        .collect();
    let mut expected = json!({ "warnings": warnings, "exception": case["exception"] });
    if case["init_ok"] == json!(true) {
        let facts = &case["facts"];
        for key in [
            "fqn",
            "topics",
            "service",
            "param_services",
            "logger",
            "effective_level",
            "enclave",
            "params",
            "overrides",
            "non_ros_args",
        ] {
            expected[key] = facts[key].clone();
        }
        expected["rosout"] = json!(strings(&facts["publishers"]).contains(&"/rosout".to_owned()));
    }
    expected
}

/// The same object from the parser.
fn outcome(argv: &[String], files: &Value, declared: &Value) -> Value {
    let read = |path: &str| match files[path].as_str() {
        Some(text) => Ok(text.as_bytes().to_vec()),
        None => Err(io::ErrorKind::NotFound.into()),
    };
    let args = match RosArgs::parse(argv, read) {
        Ok(args) => args,
        Err(error) => {
            let exception = match &error.kind {
                RosArgsErrorKind::Unknown(words) => {
                    let words: Vec<String> = words.iter().map(|word| format!("'{word}'")).collect();
                    format!("rclpy._rclpy_pybind11.UnknownROSArgsError: [{}]", words.join(", "))
                }
                RosArgsErrorKind::LogConfigFile { .. } => {
                    format!("rclpy._rclpy_pybind11.RCLError: failed to initialize logging: {error}")
                }
                _ => format!("rclpy._rclpy_pybind11.RCLError: failed to initialize rcl: {error}"),
            };
            return json!({ "warnings": error.warnings, "exception": exception });
        }
    };
    let node = match NodeOptions::resolve("talker", "", &args) {
        Ok(node) => node,
        Err(error) => {
            let exception = format!("rclpy.exceptions.InvalidParameterTypeException: {error}");
            return json!({ "warnings": args.warnings, "exception": exception });
        }
    };
    let topics: Vec<String> = ["chatter", "~/private", "/abs"]
        .iter()
        .map(|name| args.resolve_topic(&node.name, name).unwrap())
        .collect();
    let service = |name| args.resolve_service(&node.name, name).unwrap();
    let overrides: BTreeMap<&str, Value> =
        node.parameters.iter().map(|(name, value)| (name.as_str(), typed(value))).collect();
    // A declared parameter has its override where that has a value, else its default.
    let params: BTreeMap<&str, Value> = declared
        .as_object()
        .unwrap()
        .keys()
        .map(|name| {
            let default = match name.as_str() {
                "use_sim_time" => json!(["BOOL", false]),
                "start_type_description_service" => json!(["BOOL", true]),
                _ => json!(["NOT_SET", null]),
            };
            let given = node.parameters.get(name).filter(|value| **value != ParameterValue::NotSet);
            (name.as_str(), given.map_or(default, typed))
        })
        .collect();
    json!({
        "warnings": args.warnings,
        "exception": null,
        "fqn": node.name.fqn(),
        "topics": topics,
        "service": service("serve"),
        "param_services": [service("~/describe_parameters")],
        "logger": node.name.logger_name(),
        "effective_level": args.log_levels().effective(&node.name.logger_name()).number().to_string(),
        "enclave": [args.enclave],
        "params": params,
        "overrides": overrides,
        "non_ros_args": args.program_args,
        "rosout": args.rosout_logs,
    })
}

/// A value as the golden file writes it: type and value, with words for what JSON lacks.
fn typed(value: &ParameterValue) -> Value {
    let double = |x: f64| match x {
        x if x.is_nan() => json!("NaN"),
        f64::INFINITY => json!("Infinity"),
        f64::NEG_INFINITY => json!("-Infinity"),
        x => json!(x),
    };
    let content = match value {
        ParameterValue::NotSet => Value::Null,
        ParameterValue::Bool(x) => json!(x),
        ParameterValue::Integer(x) => json!(x),
        ParameterValue::Double(x) => double(*x),
        ParameterValue::String(x) => json!(x),
        ParameterValue::ByteArray(x) => json!(x),
        ParameterValue::BoolArray(x) => json!(x),
        ParameterValue::IntegerArray(x) => json!(x),
        ParameterValue::DoubleArray(x) => x.iter().copied().map(double).collect(),
        ParameterValue::StringArray(x) => json!(x),
    };
    json!([value.type_name(), content])
}

fn strings(value: &Value) -> Vec<String> {
    value.as_array().unwrap().iter().map(|item| item.as_str().unwrap().to_owned()).collect()
}
