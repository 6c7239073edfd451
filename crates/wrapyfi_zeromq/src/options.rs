//! Options that all sockets share.

use std::net::{SocketAddr, TcpStream};
use std::os::fd::BorrowedFd;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use socket2::{SockRef, TcpKeepalive};

/// Room above a message limit for topic and header frames.
pub(super) const FRAME_SLACK: usize = 64 * 1024;
/// Messages that wait at a broker for one client or server.
pub(super) const SEND_HWM: u16 = 2;
/// Time in which a closed socket may still send the messages that it holds.
pub(super) const LINGER: Duration = Duration::from_millis(500);
/// Time that a peer has to answer whether it lives: one that does not is noticed within 9 s.
pub(super) const HEARTBEAT_TIMEOUT: Duration = Duration::from_secs(4);
/// Silence after which the broker asks a listener; most have asked by themselves before.
pub(super) const SILENCE: Duration = Duration::from_millis(4500);
/// Time a peer has to greet.
pub(super) const HANDSHAKE: Duration = Duration::from_secs(5);
/// Silence after which TCP asks, for peers too old for heartbeats.
const KEEPALIVE_IDLE: i32 = 10;
const KEEPALIVE_INTERVAL: i32 = 2;
const KEEPALIVE_COUNT: i32 = 5;

/// The system's refusal of one more connection, with the remedy.
pub(super) const OUT_OF_FILES: &str =
    "the process is at its limit of open files: raise that (ulimit -n, LimitNOFILE)";

/// Waits until one of the descriptors is readable, at most `time`; which of them are.
///
/// # Errors
/// When the system cannot wait for them; not where a signal interrupts the wait.
pub(super) fn readable<const N: usize>(
    fds: [BorrowedFd<'_>; N],
    time: Duration,
) -> std::io::Result<[bool; N]> {
    let mut fds = fds.map(|fd| PollFd::from_borrowed_fd(fd, PollFlags::IN));
    // A time beyond what the system counts is none at all.
    match poll(&mut fds, Timespec::try_from(time).ok().as_ref()) {
        Ok(_) => Ok(fds.map(|fd| !fd.revents().is_empty())),
        Err(Errno::INTR) => Ok([false; N]),
        Err(error) => Err(error.into()),
    }
}

/// Bounded handshakes, and dead peers noticed within seconds.
pub(super) fn set_stream(stream: &TcpStream) -> std::io::Result<()> {
    stream.set_nonblocking(true)?;
    stream.set_nodelay(true)?;
    let seconds = |seconds: i32| Duration::from_secs(u64::try_from(seconds).unwrap_or(0));
    let keepalive = TcpKeepalive::new()
        .with_time(seconds(KEEPALIVE_IDLE))
        .with_interval(seconds(KEEPALIVE_INTERVAL))
        .with_retries(u32::try_from(KEEPALIVE_COUNT).unwrap_or(0));
    SockRef::from(stream).set_tcp_keepalive(&keepalive)
}

/// `tcp://ip:port`, as sockets bind and connect.
pub(super) fn endpoint(address: SocketAddr) -> String {
    format!("tcp://{address}")
}
