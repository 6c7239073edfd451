//! One subscriber of a publication: its queue and its socket.
//!
//! ```text
//!   publisher's thread:  push ─ queue empty ─▶ socket            no thread between
//!                             └ socket full ─▶ [ begun │ … ] ─▶ task: socket writable ─▶ socket
//!                                              full: the oldest goes, counted
//! ```
//!
//! A subscriber that does not read fills its own queue only.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::Duration;

use bytes::Bytes;
use tokio::io::Interest;
use tokio::net::TcpStream;
use tokio::sync::Notify;
use tokio::time::timeout;

use wrapyfi_endpoint::{Counters, DropReason, Mutex, Outbox, Overflow, Pieces, Waits};
use wrapyfi_retry::liveness::{self, Silence};

/// Longest time that the last messages have after their publisher went.
const LINGER: Duration = Duration::from_secs(1);
/// Bytes that a subscriber may send: it has nothing to say.
const CHATTER: usize = 64 * 1024;

/// A message as it goes on the wire: its size, and its pieces.
#[derive(Debug, Clone)]
pub(super) struct Frame(Arc<Content>);

#[derive(Debug)]
struct Content {
    pieces: Box<[Bytes]>,
    /// A subscriber did not get it, and that is counted.
    missed: AtomicBool,
}

impl Frame {
    /// `None` for what no size can say.
    pub(super) fn new(pieces: Vec<Bytes>) -> Option<Self> {
        let size: usize = pieces.iter().map(Bytes::len).sum();
        let size = u32::try_from(size).ok()?;
        let size = Bytes::copy_from_slice(&size.to_le_bytes());
        let pieces = std::iter::once(size).chain(pieces).collect();
        Some(Self(Arc::new(Content { pieces, missed: AtomicBool::new(false) })))
    }

    /// Counts that a subscriber did not get it: once, however many.
    fn missed(&self, reason: DropReason, counters: &Counters) {
        if !self.0.missed.swap(true, Relaxed) {
            counters.undelivered(reason, self.len());
        }
    }

    /// Bytes, the size included.
    pub(super) fn len(&self) -> usize {
        self.0.pieces.iter().map(Bytes::len).sum()
    }
}

impl Waits for Frame {
    fn bytes(&self) -> usize {
        self.len()
    }
}

/// A message that waits for one subscriber, and where it is counted.
struct Waiting {
    frame: Frame,
    counters: Arc<Counters>,
}

impl Waiting {
    fn missed(&self, reason: DropReason) {
        self.frame.missed(reason, &self.counters);
    }
}

impl Waits for Waiting {
    fn bytes(&self) -> usize {
        self.frame.len()
    }
}

impl Pieces for Waiting {
    fn pieces(&self) -> impl Iterator<Item = &[u8]> {
        self.frame.0.pieces.iter().map(|piece| &piece[..])
    }
}

/// One connection of a topic, as the slave API tells it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct BusLink {
    /// Number of the connection in this node.
    pub(super) id: u64,
    /// The other end: a node's name, or the address of its XML-RPC server.
    pub(super) peer: String,
    /// The socket at the other end.
    pub(super) address: String,
    /// Messages flow.
    pub(super) connected: bool,
    /// Messages so far.
    pub(super) messages: u64,
    /// Bytes so far.
    pub(super) bytes: u64,
}

pub(super) struct Subscriber {
    id: u64,
    pub(super) peer: String,
    /// Name under which it connected; empty where it gave none.
    caller_id: String,
    address: SocketAddr,
    stream: TcpStream,
    queue: Mutex<Queue>,
    work: Notify,
}

#[derive(Default)]
struct Queue {
    outbox: Outbox<Waiting>,
    /// True when the task watches whether the subscriber's machine acknowledges what is on its way.
    is_watched: bool,
    /// True when nothing more is accepted; queued messages are still sent.
    finishing: bool,
    /// The connection is gone.
    broken: bool,
    /// Fault of a write that ended it.
    fault: Option<io::ErrorKind>,
}

impl Subscriber {
    pub(super) fn new(
        id: u64,
        [peer, caller_id]: [&str; 2],
        address: SocketAddr,
        stream: TcpStream,
    ) -> Self {
        liveness::set_writer(&stream);
        Self {
            id,
            peer: peer.to_owned(),
            caller_id: caller_id.to_owned(),
            address,
            stream,
            queue: Mutex::default(),
            work: Notify::new(),
        }
    }

    /// True for another connection of the same subscriber.
    pub(super) fn is_same(&self, other: &Self) -> bool {
        !self.caller_id.is_empty() && self.caller_id == other.caller_id
    }

    /// Address of its machine.
    pub(super) fn host(&self) -> String {
        self.address.ip().to_string()
    }

    /// Sends a message, now or when the subscriber has read; of more than `depth` the oldest goes.
    pub(super) fn push(&self, frame: &Frame, depth: usize, counters: &Arc<Counters>) {
        let mut queue = self.queue.lock();
        if queue.broken || queue.finishing {
            return frame.missed(queue.end(), counters);
        }
        let lose = |oldest: Waiting| oldest.missed(DropReason::SendQueueFull);
        let waiting = Waiting { frame: frame.clone(), counters: Arc::clone(counters) };
        if let Err((_, reason)) = queue.outbox.push(waiting, depth, Overflow::DropOldest, lose) {
            return frame.missed(reason, counters);
        }
        if queue.outbox.len() == 1 {
            queue.flush(&self.stream);
        }
        let begins = !std::mem::replace(&mut queue.is_watched, true);
        if begins || !queue.outbox.is_empty() || queue.broken {
            self.work.notify_one();
        }
    }

    /// Has the connection end when what is queued is sent.
    pub(super) fn finish(&self) {
        self.queue.lock().finishing = true;
        self.work.notify_one();
    }

    /// Has the connection end at once.
    pub(super) fn cut(&self) {
        self.queue.lock().broken = true;
        self.work.notify_one();
    }

    pub(super) fn link(&self) -> BusLink {
        let queue = self.queue.lock();
        let (messages, bytes) = queue.outbox.sent();
        BusLink {
            id: self.id,
            peer: self.peer.clone(),
            address: self.address.to_string(),
            connected: !queue.broken,
            messages,
            bytes,
        }
    }

    /// Writes what the publisher's thread could not, until either end closes. Messages that wait then
    /// are lost. True where the network ended the connection, not the program at the other end.
    pub(super) async fn run(&self) -> bool {
        let ended = self.write().await;
        let mut queue = self.queue.lock();
        queue.broken = true;
        let reason = queue.end();
        queue.outbox.drain().for_each(|waiting| waiting.missed(reason));
        let of_program = [io::ErrorKind::ConnectionReset, io::ErrorKind::BrokenPipe];
        ended.is_err_and(|fault| !of_program.contains(&fault.kind()))
    }

    async fn write(&self) -> io::Result<()> {
        let (mut heard, mut silence) = (0_usize, Silence::default());
        loop {
            let (pending, finishing) = {
                let queue = self.queue.lock();
                if queue.broken {
                    return queue.fault.map_or(Ok(()), |kind| Err(kind.into()));
                }
                if queue.is_watched {
                    silence.sent();
                }
                (!queue.outbox.is_empty(), queue.finishing)
            };
            if finishing {
                if pending {
                    _ = timeout(LINGER, self.drain()).await;
                }
                return Ok(());
            }
            let interest =
                if pending { Interest::READABLE | Interest::WRITABLE } else { Interest::READABLE };
            tokio::select! {
                () = self.work.notified() => {}
                // The kernel's own questions are for a connection on which nothing is on its way.
                is_under_way = silence.look(&self.stream) => match is_under_way {
                    Ok(is_under_way) => self.queue.lock().is_watched = is_under_way,
                    Err(error) => {
                        let Self { peer, address, .. } = self;
                        tracing::info!(peer, %address, "ROS 1: a subscriber is gone: {error}");
                        return Err(io::ErrorKind::TimedOut.into());
                    }
                },
                ready = self.stream.ready(interest) => {
                    let ready = ready?;
                    if ready.is_writable() {
                        self.queue.lock().flush(&self.stream);
                    }
                    if ready.is_readable() && !self.listen(&mut heard)? {
                        return Ok(());
                    }
                }
            }
        }
    }

    async fn drain(&self) {
        while self.stream.writable().await.is_ok() {
            let mut queue = self.queue.lock();
            queue.flush(&self.stream);
            if queue.outbox.is_empty() || queue.broken {
                return;
            }
        }
    }

    /// Reads what a subscriber has no business to send; false when it is gone.
    fn listen(&self, heard: &mut usize) -> io::Result<bool> {
        let mut bytes = [0; 256];
        match self.stream.try_read(&mut bytes) {
            Ok(0) => Ok(false),
            Ok(read) => {
                *heard += read;
                if *heard > CHATTER {
                    tracing::warn!(peer = self.peer, "ROS 1: a subscriber that sends was cut off");
                }
                Ok(*heard <= CHATTER)
            }
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => Ok(true),
            Err(error) => Err(error),
        }
    }
}

impl Queue {
    /// Reason as which the waiting messages are counted when the connection ends.
    fn end(&self) -> DropReason {
        if self.finishing { DropReason::Closed } else { DropReason::ConnectionLost }
    }

    /// Writes until the socket takes no more.
    fn flush(&mut self, stream: &TcpStream) {
        let written = self.outbox.write(|slices| stream.try_write_vectored(slices), |_| {});
        if let Err(error) = written {
            (self.broken, self.fault) = (true, Some(error.kind()));
        }
    }
}
