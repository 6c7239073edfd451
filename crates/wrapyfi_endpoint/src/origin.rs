//! Publishers that messages come from, for destinations that keep the last message of each.
//!
//! ```text
//!   /tf_static of three nodes ─▶ Listener ─ SampleOrigin 1, 2, 3 ─▶ Publisher keeps the last of each
//!                                   └─ ended_publisher: 2 ──▶ forgets that of 2
//! ```

/// The publisher that a message comes from, as far as its listener can tell publishers apart.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_endpoint as endpoint; }
/// use wrapyfi_core::endpoint::{Sample, SampleOrigin};
/// /// True where the message comes from a publisher that keeps it for later listeners.
/// fn is_latched(sample: &Sample) -> bool {
///     sample.origin.is_some_and(|origin| origin.keeps > 0)
/// }
/// # use std::time::Instant;
/// # let mut sample = Sample { payload: wrapyfi_data::types::Value::Null.into(), wire_bytes: 4,
/// #     received_at: Instant::now(), origin: None };
/// assert!(!is_latched(&sample));
/// sample.origin = Some(SampleOrigin { publisher: 1, keeps: SampleOrigin::UNTOLD });
/// assert!(is_latched(&sample));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct SampleOrigin {
    /// Number of the publisher for as long as its listener exists. Numbers of two listeners have
    /// nothing to do with each other.
    pub publisher: u64,
    /// Number of messages that the publisher keeps for later listeners: 1 where it latches in ROS
    /// 1, its history where it is transient local in ROS 2, [`SampleOrigin::UNTOLD`] where it does not
    /// announce that history, 0 where it keeps none.
    pub keeps: u32,
}

impl SampleOrigin {
    /// Value for a publisher that keeps messages and does not announce how many.
    pub const UNTOLD: u32 = u32::MAX;
}

/// Extent to which a source's publishers keep their last message for listeners that come later.
///
/// ```
/// use wrapyfi_endpoint::SourceDurability;
/// assert_eq!(SourceDurability::of([true, false]), SourceDurability::NotAll);
/// assert_eq!(SourceDurability::of([]), SourceDurability::NoPublisher);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum SourceDurability {
    /// The listener cannot tell.
    #[default]
    Unknown,
    /// The source has no publishers now.
    NoPublisher,
    /// All publishers keep it.
    All,
    /// At least one publisher does not keep it.
    NotAll,
}

impl SourceDurability {
    /// Extent for `publishers`, each of which is true when it keeps its last message.
    pub fn of(publishers: impl IntoIterator<Item = bool>) -> Self {
        publishers.into_iter().fold(Self::NoPublisher, |all, keeps| match (all, keeps) {
            (Self::NoPublisher | Self::All, true) => Self::All,
            _ => Self::NotAll,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_that_does_not_keep_decides() {
        assert_eq!(SourceDurability::of([]), SourceDurability::NoPublisher);
        assert_eq!(SourceDurability::of([true, true]), SourceDurability::All);
        assert_eq!(SourceDurability::of([true, false, true]), SourceDurability::NotAll);
        assert_eq!(SourceDurability::of([false]), SourceDurability::NotAll);
    }
}
