//! Functions that the tests of ROS 1 types share.

mod messages;
mod types;

use super::*;
use crate::parser::{Dialect, TypeName};
use crate::store::{ResolvedType, TypeStore};

fn resolve(dialect: Dialect, name: &str, text: &str) -> ResolvedType {
    let name = TypeName::parse(dialect, name).unwrap();
    ResolvedType::from_text(dialect, &name, text).unwrap()
}

/// Types `demo/A` with these fields; types they refer to behind `=` lines.
fn compile(ros1: &str, ros2: &str) -> Result<PairPlan, PairError> {
    compile_with(&Rules::built_in(), ros1, ros2)
}

fn compile_with(rules: &Rules, ros1: &str, ros2: &str) -> Result<PairPlan, PairError> {
    let ros1 = resolve(Dialect::Ros1, "demo/A", ros1);
    PairPlan::compile(&ros1, &resolve(Dialect::Ros2, "demo/msg/A", ros2), rules)
}

/// A service, the one that it becomes, and the plans of its request and response.
pub(super) fn service(
    types: &mut Types,
    name: &str,
) -> (ServiceDefinition, ResolvedType, [PairPlan; 2]) {
    let definition = types.service_definition(name, None).unwrap();
    let ros2 = types.ros2_service(name, None).unwrap();
    let plan = |ros1: &ResolvedType, suffix| {
        PairPlan::compile(ros1, &ros2.part(suffix).unwrap(), types.rules()).unwrap()
    };
    let plans = [plan(&definition.request, "_Request"), plan(&definition.response, "_Response")];
    (definition, ros2, plans)
}

fn to_cdr(plan: &PairPlan, ros1: &[u8]) -> Result<(Vec<u8>, Transcoded), TranscodeError> {
    let mut out = Vec::new();
    plan.to_cdr(ros1, &Options::default(), &mut out).map(|done| (out, done))
}

fn to_ros1(plan: &PairPlan, cdr: &[u8]) -> Result<(Vec<u8>, Transcoded), TranscodeError> {
    let mut out = Vec::new();
    plan.to_ros1(cdr, 0, &Options::default(), &mut out).map(|done| (out, done))
}

/// A message in CDR as JSON.
fn read(ros2: &str, cdr: &[u8]) -> serde_json::Value {
    let plan = resolve(Dialect::Ros2, "demo/msg/A", ros2).plan().unwrap();
    plan.decode_exact(&bytes::Bytes::copy_from_slice(cdr), 1 << 20).unwrap().to_json()
}

fn notes(plan: &PairPlan) -> Vec<String> {
    plan.notes().iter().map(ToString::to_string).collect()
}

const SEPARATOR: &str = "\n================\n";
