//! A port of the directory of names: who it is, and where.

use wrapyfi_yarp::port::names::Registration;

use super::options::brings_files;

/// A registered port.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Entry {
    /// Differs from that of whatever had the name before: what was known of that port is not known of
    /// this one.
    pub(super) number: u64,
    /// Place of the port, where it is known: events do not tell it.
    pub(super) at: Option<Registration>,
    /// True for a port that the name server before this one knew, and this one does not.
    pub(super) is_unlisted: bool,
}

impl Entry {
    pub(super) fn new(number: u64, at: Option<Registration>) -> Self {
        Self { number, at, is_unlisted: false }
    }

    /// Address of the port, where it is known.
    pub(super) fn contact(&self) -> Option<String> {
        self.at.as_ref().map(Registration::contact)
    }

    /// True when the port is registered under carrier mjpeg: files are asked of it, and it may be no port of
    /// YARP at all.
    pub(super) fn has_files(&self) -> bool {
        self.at.as_ref().is_some_and(|at| brings_files(&at.carrier))
    }
}
