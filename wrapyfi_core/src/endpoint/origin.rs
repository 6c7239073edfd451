//! Whose message it is, for destinations that keep messages.
//!
//! ```text
//!   /tf_static of three nodes ─▶ Listener ─ Origin 1, 2, 3 ─▶ Publisher keeps the last of each
//!                                   └─ departed: 2 ─────────▶ forgets that of 2
//! ```

/// The publisher that a message comes from, as far as its listener can tell publishers apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Origin {
    /// Stands for the publisher while its listener exists. Numbers of two listeners have nothing
    /// to do with each other.
    pub publisher: u64,
    /// It keeps its last message for whoever comes later: latched in ROS 1, transient local in
    /// ROS 2.
    pub keeps_last: bool,
}
