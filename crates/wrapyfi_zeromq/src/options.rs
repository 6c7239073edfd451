//! Options that all sockets share.

use std::net::{IpAddr, TcpStream};
use std::time::Duration;

use socket2::{SockRef, TcpKeepalive};

use wrapyfi_endpoint::backoff;

/// Room above a message limit for topic and header frames.
pub(super) const FRAME_SLACK: usize = 64 * 1024;
/// Messages that libzmq holds between a broker and a client or a server.
pub(super) const SEND_HWM: u16 = 2;
/// Time in which a closed socket may still send the messages that it holds.
pub(super) const LINGER: Duration = Duration::from_millis(500);
/// Time between two questions of libzmq whether a peer lives, and time that a peer has to answer: one that does not is
/// noticed within 8 s. A thousand connections at rest cost twice as much with half of it.
const HEARTBEAT: Duration = Duration::from_secs(4);
pub(super) const HEARTBEAT_TIMEOUT: Duration = Duration::from_secs(4);
/// Silence after which the broker asks a listener; most have asked by themselves before.
pub(super) const SILENCE: Duration = Duration::from_millis(4500);
/// Time a peer has to greet.
pub(super) const HANDSHAKE: Duration = Duration::from_secs(5);
/// Silence after which TCP asks, for peers too old for heartbeats.
const KEEPALIVE_IDLE: i32 = 10;
const KEEPALIVE_INTERVAL: i32 = 2;
const KEEPALIVE_COUNT: i32 = 5;

fn millis(duration: Duration) -> i32 {
    i32::try_from(duration.as_millis()).unwrap_or(i32::MAX)
}

/// Time as `zmq::poll` waits for it: milliseconds, so many that it is over afterwards.
pub(super) fn poll_ms(time: Duration) -> i64 {
    i64::try_from(time.as_millis()).unwrap_or(i64::MAX).saturating_add(1)
}

/// Bytes as the option for the largest frame takes them.
pub(super) fn frame_limit(bytes: usize) -> i64 {
    i64::try_from(bytes).unwrap_or(i64::MAX)
}

/// Has libzmq cut the connection at a frame that guards memory only: far enough above the limit of a message that one
/// somewhat too large is received, counted and dropped instead.
pub(super) fn set_message_limit(socket: &zmq::Socket, limit: usize) -> zmq::Result<()> {
    socket.set_maxmsgsize(frame_limit(limit.saturating_mul(2).saturating_add(FRAME_SLACK)))
}

/// Bounded shutdown, endless reconnection, and dead peers noticed within seconds.
pub(super) fn set_common(socket: &zmq::Socket, ip: IpAddr) -> zmq::Result<()> {
    socket.set_ipv6(ip.is_ipv6())?;
    socket.set_linger(millis(LINGER))?;
    socket.set_reconnect_ivl(millis(backoff::FIRST))?;
    socket.set_reconnect_ivl_max(millis(backoff::LONGEST))?;
    socket.set_handshake_ivl(millis(HANDSHAKE))?;
    socket.set_heartbeat_ivl(millis(HEARTBEAT))?;
    socket.set_heartbeat_timeout(millis(HEARTBEAT_TIMEOUT))?;
    socket.set_tcp_keepalive(1)?;
    socket.set_tcp_keepalive_idle(KEEPALIVE_IDLE)?;
    socket.set_tcp_keepalive_intvl(KEEPALIVE_INTERVAL)?;
    socket.set_tcp_keepalive_cnt(KEEPALIVE_COUNT)
}

/// The same for a connection that is not libzmq's.
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
pub(super) fn endpoint(ip: IpAddr, port: u16) -> String {
    format!("tcp://{}", std::net::SocketAddr::new(ip, port))
}
