//! A configuration in YAML: read with all its faults at once, each with its line, column and remedy.
//!
//! | module | one idea |
//! | --- | --- |
//! | `problem` | a fault, in the words of a user |
//! | `reading` | a text as a value, without the entries that are wrong |
//! | `section` | the section of one middleware, out of the whole text |
//! | `file` | a file of limited size |

mod file;
mod problem;
mod reading;
mod section;

pub use file::{open, read_file};
pub use problem::{ConfigError, Examples, MAX_CONFIG_BYTES, Problem};
pub use reading::Reading;
pub use section::{InsecureWord, NamedSection, in_no_file, section_of};
pub use serde_saphyr::Spanned;
