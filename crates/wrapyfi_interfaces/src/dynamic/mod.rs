//! Messages of types that become known while running.
//!
//! ```text
//!   definitions ──ResolvedType::plan──▶ TypePlan ─┬─ decode ◀── CDR bytes, either byte order
//!                                            ├─ encode ──▶ CDR parts, little-endian
//!                                            ├─ from_json ◀─▶ to_json
//!                                            └─ default_message
//!                                                   │
//!                                            DynamicMessage: named fields in order
//! ```
//!
//! Arrays and sequences of primitives stay in one piece of memory ([`Primitives`]), and `uint8[]`
//! shares that of the serialised message. Every size in bytes or JSON is compared with what is
//! there, or allowed, before memory is reserved for it.

mod codec;
mod default;
mod error;
mod json_in;
mod json_out;
mod message;
mod plan;
mod scalar;
mod shape;
mod value;

pub use error::{PlanError, ValueError};
pub use message::DynamicMessage;
pub use plan::{MAX_FIXED_SIZE, MAX_FIXED_VALUES, TypePlan};
pub use value::{DynamicValue, Primitives};

#[cfg(test)]
mod golden_tests;
#[cfg(test)]
mod tests;
