//! Data frames in a build without feature `tables`: there are none, and their objects are carried as they are.

use std::fmt;

/// A data frame, of which a build without feature `tables` has none.
#[derive(Debug, Clone, PartialEq)]
pub enum Table {}

impl Table {
    pub(crate) fn key(&self) -> &str {
        match *self {}
    }

    pub(crate) fn memory_bytes(&self) -> usize {
        match *self {}
    }
}

impl fmt::Display for Table {
    fn fmt(&self, _f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {}
    }
}
