//! Targets of ROS 1 types: a definition as a peer shows it, messages of a pair of types, rules for pairs.

use wrapyfi_interfaces::parser::{Dialect, TypeName};
use wrapyfi_interfaces::ros1::{Definition, Options, PairPlan, Rules, Types};
use wrapyfi_interfaces::store::{ResolvedType, TypeStore};

use crate::{bounded, measure};

/// Text between the parts of an input.
const THEN: &str = "\n----\n";
/// Memory for each byte of a definition: a line of few characters becomes a field with its names,
/// in the definition, its description, its text and two plans.
const LINES: usize = 1024;
/// Memory of the standard types, and of those that a definition may name without defining them.
const COMMON: usize = 8 << 20;
/// Memory for each byte of a message: an empty string of ROS 1 doubles, a buffer doubles to grow.
const GROWTH: usize = 8;
/// Memory for each byte of YAML, whose events carry positions.
const YAML: usize = 1024;
/// A big-endian message is read into values first, as every message of the target `dynamic`.
const GROWTH_BIG_ENDIAN: usize = 4096;
/// Small limits, so that what exceeds them is small, too.
const OPTIONS: Options = Options { message_bytes: 1 << 16, elements: 1 << 13 };

/// A definition text: read, or refused for a reason; what was read is described in ROS 2 and has a
/// plan.
pub fn ros1_definition(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    let (_, peak) = measure(|| {
        let mut types = Types::new(Rules::built_in(), TypeStore::empty());
        let definition = match types.show("fuzz_msgs/Fuzzed", "*", text) {
            Ok(definition) => definition,
            Err(error) => return assert!(!error.to_string().is_empty()),
        };
        assert_eq!(definition.md5sum.len(), 32);
        match types.plan(&definition) {
            Ok(plan) => {
                assert_eq!(plan.ros2_type().to_string(), "fuzz_msgs/msg/Fuzzed");
                plan.notes().iter().for_each(|note| assert!(!note.to_string().is_empty()));
            }
            Err(error) => assert!(!error.to_string().is_empty()),
        }
    });
    let allowed = text.len() * LINES + COMMON;
    assert!(peak <= allowed, "{} bytes of text took {peak}, allowed are {allowed}", text.len());
}

/// A ROS 1 definition, a line `----`, a ROS 2 definition (none: as made from the first), a line `----`, a byte that
/// chooses the direction, then a message: of ROS 1, or in CDR with its
/// encapsulation header.
pub fn ros1_messages(data: &[u8]) {
    let then = THEN.as_bytes();
    let split = |data: &'_ [u8]| data.windows(then.len()).position(|window| window == then);
    let Some(first) = split(data) else { return };
    let (ros1, rest) = data.split_at(first);
    let (_, rest) = rest.split_at(then.len());
    let Some(second) = split(rest) else { return };
    let (ros2, rest) = rest.split_at(second);
    let (_, message) = rest.split_at(then.len());
    let (Ok(ros1), Ok(ros2)) = (std::str::from_utf8(ros1), std::str::from_utf8(ros2)) else {
        return;
    };
    let Some((choice, message)) = message.split_first() else { return };
    let Some(plan) = plan(ros1, ros2) else { return };
    let mut out = b"before".to_vec();
    let growth = if message.starts_with(&[0, 0]) { GROWTH_BIG_ENDIAN } else { GROWTH };
    let carried = bounded(message.len() + OPTIONS.message_bytes, growth, || {
        if choice % 2 == 0 {
            plan.to_cdr(message, &OPTIONS, &mut out)
        } else {
            plan.to_ros1(message, 7, &OPTIONS, &mut out)
        }
    });
    assert!(out.starts_with(b"before"), "what was there stays");
    let written = out.split_off(6);
    let Ok(_) = carried else { return assert!(written.is_empty(), "nothing of a refused message") };
    assert!(written.len() <= OPTIONS.message_bytes + 4);
    // The written message is read, and from then on nothing changes any more.
    let wide = Options { message_bytes: usize::MAX, elements: usize::MAX };
    let (mut there, mut back, mut again) = (Vec::new(), Vec::new(), Vec::new());
    if choice % 2 == 0 {
        plan.to_ros1(&written, 7, &wide, &mut there).expect("its own CDR");
        plan.to_cdr(&there, &wide, &mut back).expect("its own bytes");
        plan.to_ros1(&back, 7, &wide, &mut again).expect("as before");
    } else {
        // ROS 2 has bounds that ROS 1 has not, and CDR is read without looking at them.
        if plan.to_cdr(&written, &wide, &mut there).is_err() {
            return;
        }
        plan.to_ros1(&there, 7, &wide, &mut back).expect("its own CDR");
        assert_eq!(back, written, "there and back");
        plan.to_cdr(&back, &wide, &mut again).expect("as before");
    }
    assert_eq!(again, there, "there, back and there");
}

fn plan(ros1: &str, ros2: &str) -> Option<PairPlan> {
    let definition = Definition::from_header("fuzz_msgs/Fuzzed", ros1).ok()?;
    if ros2.is_empty() {
        let mut types = Types::new(Rules::built_in(), TypeStore::empty());
        return types.plan(&definition).ok();
    }
    let name = TypeName::new("fuzz_msgs", "Fuzzed").expect("a valid name");
    let ros2 = ResolvedType::from_text(Dialect::Ros2, &name, ros2).ok()?;
    PairPlan::compile(&definition.resolved, &ros2, &Rules::built_in()).ok()
}

/// Mapping rules as a file has them; after a line `----`, a ROS 1 definition and after another a ROS 2 definition of
/// types that the rules may bring together.
pub fn mapping_rules(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    let mut parts = text.split(THEN);
    let yaml = parts.next().unwrap_or_default();
    let read = || serde_saphyr::from_str::<Option<Rules>>(yaml);
    let rules = match bounded(yaml.len(), YAML, read) {
        Ok(rules) => rules.unwrap_or_default(),
        Err(error) => return assert!(!error.to_string().is_empty()),
    };
    for (dialect, names) in
        [(Dialect::Ros1, Rules::ros2_names as fn(&_, &_) -> _), (Dialect::Ros2, Rules::ros1_names)]
    {
        for name in ["fuzz_msgs/Fuzzed", "rosgraph_msgs/Log", "std_srvs/srv/Empty", "tf/tfMessage"]
        {
            let Ok(name) = TypeName::parse(dialect, name) else { continue };
            let found: Vec<TypeName> = names(&rules, &name);
            assert!(!found.is_empty() && found.iter().all(|other| other.kind() == name.kind()));
            let same = found
                .iter()
                .enumerate()
                .any(|(n, one)| found.iter().skip(n + 1).any(|two| one == two));
            assert!(!same, "a name comes twice: {found:?}");
        }
    }
    let (Some(ros1), Some(ros2)) = (parts.next(), parts.next()) else { return };
    let Ok(definition) = Definition::from_header("fuzz_msgs/Fuzzed", ros1) else { return };
    let name = TypeName::new("fuzz_msgs", "Fuzzed").expect("a valid name");
    let Ok(ros2) = ResolvedType::from_text(Dialect::Ros2, &name, ros2) else { return };
    match PairPlan::compile(&definition.resolved, &ros2, &rules) {
        Ok(plan) => {
            let mut out = Vec::new();
            _ = plan.to_cdr(&[0; 64], &OPTIONS, &mut out);
            out.clear();
            _ = plan.to_ros1(&[0, 1, 0, 0, 0, 0, 0, 0], 7, &OPTIONS, &mut out);
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}
