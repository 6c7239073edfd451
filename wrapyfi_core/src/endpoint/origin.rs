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
    /// Number of messages that it keeps for whoever comes later: 1 where it latches in ROS 1, its
    /// history where it is transient local in ROS 2, [`Origin::UNTOLD`] where it does not announce how
    /// long that is, 0 where it keeps none.
    pub keeps: u32,
}

impl Origin {
    /// It keeps messages, and does not announce how many.
    pub const UNTOLD: u32 = u32::MAX;
}

/// Whether the publishers of a source keep their last message for whoever comes later.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Keeping {
    /// Its listener cannot tell.
    #[default]
    Unknown,
    /// There are none now.
    Nobody,
    /// All do.
    All,
    /// Some, or all, do not.
    NotAll,
}

impl Keeping {
    /// What publishers say, one after the other.
    pub(crate) fn of(publishers: impl IntoIterator<Item = bool>) -> Self {
        publishers.into_iter().fold(Self::Nobody, |all, keeps| match (all, keeps) {
            (Self::Nobody | Self::All, true) => Self::All,
            _ => Self::NotAll,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_that_does_not_keep_decides() {
        assert_eq!(Keeping::of([]), Keeping::Nobody);
        assert_eq!(Keeping::of([true, true]), Keeping::All);
        assert_eq!(Keeping::of([true, false, true]), Keeping::NotAll);
        assert_eq!(Keeping::of([false]), Keeping::NotAll);
    }
}
