//! Measures messages of a type known only at run time: nanoseconds for each step with a
//! `sensor_msgs/msg/JointState` of 12 joints.
//!
//! ```text
//!   cargo run --release -p wrapyfi_interfaces --example dynamic_decode
//! ```

// The figures are what this program is for.
#![allow(clippy::print_stdout)]

use std::error::Error;
use std::hint::black_box;
use std::time::Instant;

use wrapyfi_interfaces::parser::{Dialect, TypeName};
use wrapyfi_interfaces::store::ResolvedType;

const JOINT_STATE: &str = "\
std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
";

const JOINTS: u32 = 12;
const ROUNDS: u32 = 200_000;

fn main() -> Result<(), Box<dyn Error>> {
    let name = TypeName::parse(Dialect::Ros2, "sensor_msgs/msg/JointState")?;
    let joint_state = ResolvedType::from_text(Dialect::Ros2, &name, JOINT_STATE)?;
    let plan = joint_state.plan()?;
    let mut message = plan.default_message();
    message.set("header.frame_id", "base_link")?;
    message.set("name", (0..JOINTS).map(|i| format!("left_arm_joint_{i}")).collect::<Vec<_>>())?;
    for field in ["position", "velocity", "effort"] {
        message.set(field, (0..JOINTS).map(f64::from).collect::<Vec<_>>())?;
    }
    let cdr = plan.encode(&message)?.to_bytes();
    let json = message.to_json();
    println!("{} with {JOINTS} joints, {} bytes", plan.type_name(), cdr.len());

    measure("compile", ROUNDS / 100, || joint_state.plan())?;
    measure("decode", ROUNDS, || plan.decode(&cdr, 1 << 20))?;
    measure("encode", ROUNDS, || plan.encode(&message))?;
    measure("to JSON text", ROUNDS / 10, || serde_json::to_string(&message))?;
    measure("from JSON", ROUNDS / 10, || plan.from_json(&json, 1 << 20))?;
    Ok(())
}

/// Runs `step` so many times, once before to warm up, and prints the mean.
fn measure<T, E: Error + 'static>(
    label: &str,
    rounds: u32,
    step: impl Fn() -> Result<T, E>,
) -> Result<(), Box<dyn Error>> {
    black_box(step()?);
    let start = Instant::now();
    for _ in 0..rounds {
        black_box(step()?);
    }
    let nanoseconds = start.elapsed().as_nanos() / u128::from(rounds);
    println!("{label:>12}: {nanoseconds:>6} ns");
    Ok(())
}
