//! Limits of the parameters of a node, and of what is said about them.

/// Most parameters of a node, and most names in one request.
pub const MAX_PARAMETERS: usize = 4096;
/// Longest name of a parameter in bytes.
pub const MAX_NAME_BYTES: usize = 1024;
/// Largest value of a parameter in bytes.
pub const MAX_VALUE_BYTES: usize = 1 << 20;
/// Largest reply to one request, in bytes and about. A request may name a large parameter many
/// times.
pub const MAX_REPLY_BYTES: usize = 16 << 20;
/// Most events that wait to be published: the depth of `/parameter_events`.
pub const MAX_EVENTS: usize = 1000;
/// Longest part of a name or value that an error shows, in characters.
pub(super) const SHOWN: usize = 100;
