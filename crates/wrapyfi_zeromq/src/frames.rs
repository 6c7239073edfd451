//! Messages of several frames, as sockets receive them.

use bytes::Bytes;

use super::zmtp::Owned;

/// A message that came.
pub(super) struct Received {
    /// The first of its frames.
    pub(super) frames: Vec<Bytes>,
    /// Number of all its frames, and of their bytes.
    pub(super) count: usize,
    pub(super) bytes: usize,
}

/// The next message, if one waits, with at most `keep` of its frames.
pub(super) fn receive(socket: &zmq::Socket, keep: usize) -> zmq::Result<Option<Received>> {
    let mut frame = match socket.recv_msg(zmq::DONTWAIT) {
        Ok(frame) => frame,
        Err(zmq::Error::EAGAIN) => return Ok(None),
        Err(error) => return Err(error),
    };
    let mut received = Received { frames: Vec::with_capacity(3), count: 0, bytes: 0 };
    loop {
        let more = frame.get_more();
        received.count += 1;
        received.bytes += frame.len();
        if received.count <= keep {
            received.frames.push(Bytes::from_owner(Owned(frame)));
        }
        if !more {
            return Ok(Some(received));
        }
        // Frames of one message arrive together: this does not wait.
        frame = socket.recv_msg(0)?;
    }
}
