//! The time stamp that travels with a message.

/// When a message was made, and which one it is: YARP's `Stamp`.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Stamp {
    /// Number of the message, counting up.
    pub count: i32,
    /// Time in seconds, since 1970 unless the sender says otherwise.
    pub time_s: f64,
}

#[allow(clippy::unimplemented)]
impl Stamp {
    /// The stamp in an envelope: `42 1700000000.5`. None where the envelope is something else.
    #[must_use]
    pub fn from_envelope(envelope: &[u8]) -> Option<Self> {
        let _ = envelope;
        unimplemented!()
    }

    /// The envelope as YARP writes it: 15 significant digits.
    #[must_use]
    pub fn to_envelope(&self) -> String {
        unimplemented!()
    }
}
