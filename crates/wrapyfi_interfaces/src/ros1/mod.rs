//! ROS 1 types and messages: definitions, checksums, and bytes of ROS 1 to CDR and back.
//!
//! ```text
//!   connection header ─ message_definition ─┐
//!   a folder of .msg files ─────────────────┼─▶ Definition ── text, md5sum ─▶ other ROS 1 nodes
//!   standard types, at hand here ───────────┤       │
//!   a ROS 2 type ───────────────────────────┘       │        Rules: which is which
//!                                                   ▼          ▼
//!                     ROS 2 type (ament index, or made from it) ─▶ PairPlan
//!                                                                   │
//!            ROS 1 bytes ◀──────────────── to_ros1, to_cdr ─────────┴──────▶ CDR
//! ```
//!
//! [`Types`] does all of it: it remembers what peers showed, and gives definitions and plans.
//! Nothing here opens a connection.

mod action_types;
mod compile;
mod definition;
mod derive;
mod error;
mod fill;
mod matching;
mod names;
mod op;
mod plan;
mod rule_check;
mod rules;
mod run;
mod service_types;
mod severity;
mod sizes;
mod standard;
pub(crate) mod standard_text;
mod text;
mod types;
mod versions;
mod wire;

#[cfg(test)]
mod tests;
#[cfg(test)]
mod vector_tests;

pub use action_types::ActionMessage;
pub use definition::{Definition, ServiceDefinition};
pub use error::{DefinitionError, PairError, TranscodeError, TypedField};
pub use names::ros1_name;
pub use plan::{Note, Options, PairPlan, Transcoded};
pub use rules::Rules;
pub use types::Types;
