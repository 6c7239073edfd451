//! Notices when the other end of a TCP connection is gone without a word: a cable is out, a machine has
//! no power.
//!
//! ```text
//!   nothing on its way    probes after 4 s and 6 s of silence           ──▶ gone after 8 s    (kernel)
//!   we read, acks wait    unacknowledged for 8 s                        ──▶ gone              (kernel)
//!   we write              no segment acknowledged in 7 looks, 1 s apart ──▶ gone after 8 s    (Silence)
//! ```
//!
//! A reader that is stopped or slow is not gone: its machine acknowledges, with or without room. That is
//! why writers do not leave this to `TCP_USER_TIMEOUT`, which ends a connection without room, too.
//!
//! Contract of the unsafe code here: `getsockopt` and `setsockopt` get the descriptor of a socket that is
//! borrowed for the call, and a pointer to one local value with its size. `tcp_info` is numbers alone, for
//! which every pattern of bits is a value; an older kernel fills less of it and leaves zeros.

#![allow(unsafe_code, reason = "two options of TCP sockets for which socket2 has no call")]

use std::io;
use std::os::fd::AsRawFd;
use std::time::Duration;

use socket2::{SockRef, TcpKeepalive};
use tokio::net::TcpStream;
use tokio::time::{Instant, sleep_until};

/// Silence on a connection before its peer is asked whether it lives.
const IDLE: Duration = Duration::from_secs(4);
/// Time between such questions.
const INTERVAL: Duration = Duration::from_secs(2);
/// Questions without an answer after which the connection ends.
const QUESTIONS: u32 = 2;
/// Age of an unacknowledged byte at which a reader's connection ends.
const UNACKNOWLEDGED: Duration = Duration::from_secs(8);
/// Time between two looks at what a writer has sent.
const LOOK: Duration = Duration::from_secs(1);
/// Looks without an acknowledgement, one after the other, at which a writer's connection ends.
const LOOKS: u32 = 7;
/// Longest wait before a lost segment is sent again, in milliseconds. The system's own doubles up to two
/// minutes, so that a link that was down for ten seconds would stay silent for ten more.
const RETRANSMIT_MS: libc::c_int = 1000;
/// `TCP_RTO_MAX_MS` of Linux 6.15; `libc` does not name it yet.
const TCP_RTO_MAX_MS: libc::c_int = 44;

/// Sets a connection up whose peer sends: what goes out are acknowledgements and replies.
pub fn set_reader(stream: &TcpStream) {
    set(stream, Some(UNACKNOWLEDGED));
}

/// Sets a connection up that [`Silence`] watches.
pub fn set_writer(stream: &TcpStream) {
    set(stream, None);
}

fn set(stream: &TcpStream, unacknowledged: Option<Duration>) {
    let keepalive =
        TcpKeepalive::new().with_time(IDLE).with_interval(INTERVAL).with_retries(QUESTIONS);
    let socket = SockRef::from(stream);
    let set = socket.set_tcp_keepalive(&keepalive);
    if let Err(error) = set.and_then(|()| socket.set_tcp_user_timeout(unacknowledged)) {
        tracing::debug!(%error, "a dead link will be noticed late");
    }
    let (value, size) = (RETRANSMIT_MS, socklen::<libc::c_int>());
    // SAFETY: see the contract above.
    unsafe {
        // An older kernel refuses, and waits longer.
        libc::setsockopt(
            stream.as_raw_fd(),
            libc::IPPROTO_TCP,
            TCP_RTO_MAX_MS,
            std::ptr::from_ref(&value).cast(),
            size,
        );
    }
}

fn socklen<T>() -> libc::socklen_t {
    libc::socklen_t::try_from(size_of::<T>()).unwrap_or(0)
}

/// State of the bytes under way, as the kernel reports it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct BytesUnderWay {
    /// Some were sent again, or the peer was asked for room, without an acknowledgement since.
    unanswered: bool,
    /// Some are not acknowledged yet, or wait for room.
    outstanding: bool,
    /// Time since the last acknowledgement of anything.
    quiet: Duration,
}

fn look(stream: &TcpStream) -> io::Result<BytesUnderWay> {
    // SAFETY: see the contract above.
    let (code, info) = unsafe {
        let mut info: libc::tcp_info = std::mem::zeroed();
        let mut size = socklen::<libc::tcp_info>();
        let place = std::ptr::from_mut(&mut info).cast();
        let fd = stream.as_raw_fd();
        (libc::getsockopt(fd, libc::IPPROTO_TCP, libc::TCP_INFO, place, &raw mut size), info)
    };
    if code != 0 {
        return Err(io::Error::last_os_error());
    }
    let unanswered = info.tcpi_retransmits > 0 || info.tcpi_probes > 0;
    Ok(BytesUnderWay {
        unanswered,
        outstanding: unanswered || info.tcpi_unacked > 0 || info.tcpi_backoff > 0,
        quiet: Duration::from_millis(info.tcpi_last_ack_recv.into()),
    })
}

/// Time for which the peer of a writer has acknowledged nothing. It does not grow while nothing is
/// under way.
#[derive(Debug, Default)]
pub struct Silence {
    /// Absent while nothing is on its way.
    next: Option<Instant>,
    looks: u32,
}

impl Silence {
    /// Notes that something is being sent.
    pub fn sent(&mut self) {
        self.next.get_or_insert_with(|| Instant::now() + LOOK);
    }

    /// Waits for the next look at what is on its way; for ever where nothing was sent since it was all acknowledged. True
    /// when something is not acknowledged yet. Cancel-safe: it goes on from where it was.
    ///
    /// # Errors
    /// When the peer is gone.
    pub async fn look(&mut self, stream: &TcpStream) -> io::Result<bool> {
        let Some(next) = self.next else { return std::future::pending().await };
        sleep_until(next).await;
        let now = look(stream)?;
        if self.note(now) {
            return Err(io::Error::new(
                io::ErrorKind::TimedOut,
                format!("nothing was acknowledged for {:.0?}", now.quiet),
            ));
        }
        self.next = now.outstanding.then(|| Instant::now() + LOOK);
        Ok(now.outstanding)
    }

    /// Waits until the peer is gone; for ever while it acknowledges. Cancel-safe, as [`Silence::look`].
    /// Without a TCP connection it waits for ever: the kernel ends what is on one host.
    pub async fn gone(&mut self, stream: Option<&TcpStream>) -> io::Error {
        let Some(stream) = stream else { return std::future::pending().await };
        loop {
            if let Err(error) = self.look(stream).await {
                return error;
            }
        }
    }

    /// Notes the state of a look; true when the peer is gone.
    fn note(&mut self, now: BytesUnderWay) -> bool {
        self.looks = if now.unanswered { self.looks + 1 } else { 0 };
        self.looks >= LOOKS && now.quiet >= LOOK * (LOOKS - 1)
    }
}

#[cfg(test)]
mod tests {
    use tokio::io::AsyncReadExt as _;
    use tokio::net::TcpListener;

    use super::*;

    const UNANSWERED: BytesUnderWay =
        BytesUnderWay { unanswered: true, outstanding: true, quiet: Duration::from_secs(100) };

    #[test]
    fn a_peer_is_gone_after_looks_without_any_answer() {
        let mut silence = Silence::default();
        let gone: Vec<bool> = (0..LOOKS).map(|_| silence.note(UNANSWERED)).collect();
        assert_eq!(gone.iter().filter(|&&gone| gone).count(), 1);
        assert_eq!(gone.last(), Some(&true));
        // One answer in between begins anew.
        let mut silence = Silence::default();
        for _ in 0..LOOKS - 1 {
            assert!(!silence.note(UNANSWERED));
        }
        assert!(!silence.note(BytesUnderWay { unanswered: false, ..UNANSWERED }));
        assert!(!silence.note(UNANSWERED));
        // Acknowledgements came between the looks.
        let mut silence = Silence::default();
        let lossy = BytesUnderWay { quiet: Duration::from_millis(900), ..UNANSWERED };
        assert!((0..100).all(|_| !silence.note(lossy)));
    }

    #[tokio::test]
    async fn options_are_set_and_a_stopped_reader_is_not_gone() {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let writer = TcpStream::connect(listener.local_addr().unwrap()).await.unwrap();
        let (mut reader, _) = listener.accept().await.unwrap();
        set_writer(&writer);
        set_reader(&reader);
        let set = SockRef::from(&reader);
        assert!(set.keepalive().unwrap());
        assert_eq!(set.tcp_keepalive_time().unwrap(), IDLE);
        assert_eq!(set.tcp_user_timeout().unwrap(), Some(UNACKNOWLEDGED));
        assert_eq!(SockRef::from(&writer).tcp_user_timeout().unwrap(), None);

        // Until the reader's machine has no room left.
        let mut silence = Silence::default();
        let block = vec![7; 1 << 20];
        loop {
            writer.writable().await.unwrap();
            silence.sent();
            match writer.try_write(&block) {
                Ok(_) => {}
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => break,
                Err(error) => panic!("{error}"),
            }
        }
        while look(&writer).unwrap().quiet.is_zero() {
            tokio::task::yield_now().await;
        }
        assert!(!silence.note(look(&writer).unwrap()));
        let mut rest = vec![0; 1 << 20];
        assert!(reader.read(&mut rest).await.unwrap() > 0);
    }
}
