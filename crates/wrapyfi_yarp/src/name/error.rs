//! Error of a request to a name server.

use crate::port::LinkError;
use crate::port::names::Registration;

/// Error of a request to a name server.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NameError {
    /// The name cannot be that of a port.
    #[error("port name {name:?} {reason}: write for instance /robot/camera:o")]
    BadName {
        /// Name.
        name: String,
        /// Rule that the name breaks.
        reason: String,
    },
    /// There was no answer.
    #[error("name server at {address}: {command:?}: {source}")]
    NoAnswer {
        /// Host and port.
        address: String,
        /// Command that was sent.
        command: String,
        /// Failure of the connection.
        source: LinkError,
    },
    /// The answer belongs to no name server.
    #[error("name server at {address}: {command:?} was answered {answer:?}, which makes no sense")]
    Nonsense {
        /// Host and port.
        address: String,
        /// Command that was sent.
        command: String,
        /// Answer that came, shortened.
        answer: String,
    },
    /// The name server tells another number for a port than the one that was registered.
    #[error(
        "name server: {} was registered with port {wanted}, and is told for {}: run yarp clean, or take another name",
        at.name, at.contact()
    )]
    Elsewhere {
        /// Place that the name server tells.
        at: Registration,
        /// Number that was registered.
        wanted: u16,
    },
    /// The name server refused the command.
    #[error("name server: {command:?} was refused: {answer}")]
    Refused {
        /// Command that was sent.
        command: String,
        /// Reason in the name server's words.
        answer: String,
    },
}
