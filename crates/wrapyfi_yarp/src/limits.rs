//! Limits of everything that peers send.

/// Bounds on what peers may send. YARP itself has none: every length on its wire is believed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct WireLimits {
    /// Longest message, in bytes: command and payload together.
    pub max_message_bytes: usize,
    /// Deepest nesting of lists in a bottle; a list without lists has depth 1. Values above
    /// [`WireLimits::DEPTH_CEILING`] count as that.
    pub max_depth: usize,
    /// Most values in one bottle, those of nested lists included. A value takes 40 bytes of
    /// memory, however short it is on the wire.
    pub max_elements: usize,
    /// Longest line of the text carriers and of the name server, in bytes.
    pub max_line_bytes: usize,
    /// Longest port name with its qualifiers, in bytes. YARP reads at most 1000 with the NUL.
    pub max_name_bytes: usize,
    /// Most connections that one port or name server holds at a time.
    pub max_connections: usize,
}

impl WireLimits {
    /// Depth above which [`WireLimits::max_depth`] is not followed: readers use the stack.
    pub const DEPTH_CEILING: usize = 256;

    /// The depth that holds.
    pub(crate) fn depth(&self) -> usize {
        self.max_depth.min(Self::DEPTH_CEILING)
    }
}

impl Default for WireLimits {
    fn default() -> Self {
        Self {
            max_message_bytes: 64 << 20,
            max_depth: 64,
            max_elements: 1 << 20,
            max_line_bytes: 16 << 20,
            max_name_bytes: 999,
            max_connections: 256,
        }
    }
}
