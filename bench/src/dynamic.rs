//! Cost of messages of a type known only at run time: `sensor_msgs/msg/JointState` of an arm.

use std::hint::black_box;

use anyhow::Result;
use bytes::Bytes;
use wrapyfi_interfaces::dynamic::TypePlan;
use wrapyfi_interfaces::parser::{Dialect, TypeName};
use wrapyfi_interfaces::store::ResolvedType;

use crate::micro::{Figure, time};

/// Name of the figure: microseconds.
pub(crate) const DECODE: &str = "dynamic decode JointState, 12 joints, 628 bytes";
/// Decodes a second that are promised a share of one core.
pub(crate) const RATE: f64 = 10_000.0;
/// Decodes timed at once: one takes about as long as reading the clock a few times.
const BATCH: u16 = 100;
/// Largest memory that a message may take.
const MEMORY: usize = 1 << 20;

const JOINTS: u32 = 12;
const DEFINITION: &str = "\
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

/// The message, and how it is read.
pub(crate) struct JointState {
    plan: TypePlan,
    cdr: Bytes,
}

impl JointState {
    /// Makes it once.
    pub(crate) fn new() -> Result<Self> {
        let name = TypeName::parse(Dialect::Ros2, "sensor_msgs/msg/JointState")?;
        let plan = ResolvedType::from_text(Dialect::Ros2, &name, DEFINITION)?.plan()?;
        let mut message = plan.default_message();
        message.set("header.frame_id", "base_link")?;
        let names = (0..JOINTS).map(|joint| format!("left_arm_joint_{joint}"));
        message.set("name", names.collect::<Vec<_>>())?;
        for field in ["position", "velocity", "effort"] {
            message.set(field, (0..JOINTS).map(f64::from).collect::<Vec<_>>())?;
        }
        let cdr = plan.encode(&message)?.to_bytes();
        plan.decode(&cdr, MEMORY)?;
        Ok(Self { plan, cdr })
    }

    /// One decode, in microseconds.
    pub(crate) fn round(&self) -> Figure {
        let took = time(|| {
            for _ in 0..BATCH {
                drop(black_box(self.plan.decode(black_box(&self.cdr), MEMORY)));
            }
        });
        (DECODE.to_owned(), took / f64::from(BATCH))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_message_weighs_what_its_name_says() {
        assert_eq!(JointState::new().unwrap().cdr.len(), 628);
    }
}
