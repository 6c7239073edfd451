//! Target of types that are known at run time only.

use bytes::Bytes;
use wrapyfi_interfaces::dynamic::{DynamicMessage, TypePlan, ValueError};
use wrapyfi_interfaces::parser::{Dialect, TypeName};
use wrapyfi_interfaces::store::ResolvedType;

use crate::{LIMITS, bounded, measure};

/// Text between the definition and the message.
const THEN: &[u8] = b"\n----\n";
/// Memory for each byte of a definition: a line of few characters becomes a field with its names,
/// in the definition, its description and the plan.
const LINES: usize = 256;
/// Memory of the types that a definition may name without defining them.
const COMMON: usize = 1 << 20;
/// Memory for each byte of a message: a plan allows up to sixteen values around one byte, each with
/// its place in a vector that grows by doubling.
const VALUES: usize = 4096;
/// Limit for reading back: a written message may be longer, by wider texts and default values.
const WIDE: usize = 64 * LIMITS.message_bytes;

/// A definition text, a line `----`, then a message: JSON where it begins with `{`, else CDR with
/// its encapsulation header.
pub fn dynamic(data: &[u8]) {
    let Some(at) = data.windows(THEN.len()).position(|window| window == THEN) else { return };
    let (text, rest) = data.split_at(at);
    let (_, message) = rest.split_at(THEN.len());
    let Ok(text) = std::str::from_utf8(text) else { return };
    let name = TypeName::new("fuzz_msgs", "Fuzzed").expect("a valid name");
    let (plan, peak) = measure(|| {
        let resolved = ResolvedType::from_text(Dialect::Ros2, &name, text).ok()?;
        resolved.plan().ok()
    });
    // A stated default stands in each message, a fixed array in the plan.
    let fixed = plan.as_ref().map_or(0, |plan| plan.min_size().saturating_mul(VALUES));
    let allowed = text.len() * LINES + COMMON + fixed;
    assert!(peak <= allowed, "{} bytes of text took {peak}, allowed are {allowed}", text.len());
    let Some(plan) = plan else { return };
    assert_eq!(plan.type_name(), "fuzz_msgs/msg/Fuzzed");
    if message.first() == Some(&b'{') { json(&plan, message) } else { cdr(&plan, message) }
}

fn cdr(plan: &TypePlan, message: &[u8]) {
    let cdr = Bytes::copy_from_slice(message);
    let limit = LIMITS.message_bytes;
    let read = bounded(cdr.len(), VALUES, || plan.decode(&cdr, limit));
    let exact = plan.decode_exact(&cdr, limit);
    let Ok(read) = read else { return assert!(exact.is_err(), "exactly what cannot be read") };
    assert!(cdr.len() >= plan.min_size(), "nothing is missing");
    let written = written_and_read(plan, &read);
    if let Ok(exact) = exact {
        assert_eq!(exact.encode().to_bytes(), written);
    }
    let text = serde_json::to_string(&read).expect("its keys are strings");
    let value: serde_json::Value = serde_json::from_str(&text).expect("what was written is JSON");
    match plan.from_json(&value, WIDE) {
        // Not the bytes: a NaN has many, and one text.
        Ok(again) => {
            assert_eq!(again.encode().len(), written.len());
            assert_eq!(serde_json::to_string(&again).expect("as above"), text);
        }
        // Readers of CDR do not look at bounds; a wide plan may need more than it may take.
        Err(ValueError::Count { .. } | ValueError::TooLarge { .. }) => {}
        Err(error) => panic!("its own JSON: {error}"),
    }
}

fn json(plan: &TypePlan, message: &[u8]) {
    let Ok(value) = serde_json::from_slice::<serde_json::Value>(message) else { return };
    // `{}` stands for all defaults.
    let input = message.len() + plan.min_size();
    let limit = LIMITS.message_bytes;
    let read = match bounded(input, VALUES, || plan.from_json(&value, limit)) {
        Ok(read) => read,
        Err(error) => return assert!(!error.to_string().is_empty()),
    };
    written_and_read(plan, &read);
    let text = serde_json::to_string(&read).expect("its keys are strings");
    let value = serde_json::from_str(&text).expect("what was written is JSON");
    let again = plan.from_json(&value, WIDE).expect("its own JSON");
    assert_eq!(serde_json::to_string(&again).expect("as above"), text);
}

/// The message as CDR, which reads as the same message; a text that holds a NUL ends there.
fn written_and_read(plan: &TypePlan, message: &DynamicMessage) -> Bytes {
    let written = plan.encode(message).expect("it is of this type").to_bytes();
    let again = plan.decode_exact(&written, usize::MAX).expect("what was written can be read");
    assert_eq!(again.encode().to_bytes(), written, "changed by writing and reading");
    written
}
