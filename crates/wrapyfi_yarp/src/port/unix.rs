//! The unix socket of carrier `unix_stream`: two ports that met over TCP go on there.
//!
//! ```text
//!   sender ── TCP: header ──▶ receiver        both: close TCP
//!   sender ──── connect ────▶ FOLDER/<receiver's TCP port>_<sender's TCP port>.sock   (receiver: bind, accept)
//! ```
//!
//! The receiver takes the file away as soon as the sender is there. Nothing tells a sender that the
//! receiver has refused: it looks for the socket for a second, YARP's own for half of one.

use std::fs::DirBuilder;
use std::io;
use std::net::SocketAddr;
use std::os::unix::ffi::OsStrExt as _;
use std::os::unix::fs::{DirBuilderExt as _, FileTypeExt as _};
use std::path::{Path, PathBuf};
use std::time::Duration;

use tokio::net::{UnixListener, UnixStream};
use tokio::time::{Instant, sleep};

use crate::wire::Fault;

/// Longest time that a sender looks for the socket.
const LOOKING: Duration = Duration::from_secs(1);
/// Time between two looks. The receiver binds as soon as it has the header.
const BETWEEN_LOOKS: Duration = Duration::from_millis(2);
/// Longest path that an address has room for, with its NUL.
const MAX_PATH: usize = 108;

/// Unix socket at which two ports meet.
#[derive(Debug)]
pub(super) struct Meeting {
    path: PathBuf,
}

impl Meeting {
    /// The place of a connection between these ends, in the folder that `own` was told.
    ///
    /// # Errors
    /// When they are on two hosts, there is no folder, or its name is too long.
    pub(super) fn new(
        folder: Option<&Path>,
        own: SocketAddr,
        other: SocketAddr,
        own_receives: bool,
    ) -> Result<Self, Fault> {
        let (own_ip, other_ip) = (own.ip().to_canonical(), other.ip().to_canonical());
        if own_ip != other_ip {
            return Err(Fault::OtherHost { own: own_ip, other: other_ip });
        }
        let (receiver, sender) = if own_receives { (own, other) } else { (other, own) };
        let file = format!("{}_{}.sock", receiver.port(), sender.port());
        let Some(folder) = folder else {
            let reason = "has no folder here (YARP_RUNTIME_DIR, XDG_RUNTIME_DIR or USER say it)";
            return Err(Fault::UnixSocket { path: file, reason: reason.to_owned() });
        };
        let path = folder.join(file);
        let length = path.as_os_str().as_bytes().len() + 1;
        let this = Self { path };
        if length > MAX_PATH {
            let reason = format!("has {length} bytes with its NUL, allowed are {MAX_PATH}");
            return Err(this.fault(reason));
        }
        Ok(this)
    }

    fn fault(&self, reason: impl std::fmt::Display) -> Fault {
        Fault::UnixSocket { path: self.path.display().to_string(), reason: reason.to_string() }
    }

    /// Binds the socket, in place of one that a process which ended has left.
    ///
    /// # Errors
    /// When folder or socket cannot be made, or something else has that name.
    pub(super) fn bind(self) -> Result<Bound, Fault> {
        if let Some(folder) = self.path.parent() {
            let made = DirBuilder::new().recursive(true).mode(0o700).create(folder);
            made.map_err(|error| self.fault(format_args!("has no folder ({error})")))?;
        }
        match std::fs::symlink_metadata(&self.path) {
            Ok(found) if found.file_type().is_socket() => {
                let removed = std::fs::remove_file(&self.path);
                removed.map_err(|error| self.fault(format_args!("is in use ({error})")))?;
            }
            Ok(_) => return Err(self.fault("is something else already")),
            Err(_) => {}
        }
        let listener = UnixListener::bind(&self.path);
        let listener =
            listener.map_err(|error| self.fault(format_args!("cannot be bound ({error})")))?;
        Ok(Bound { listener, meeting: self })
    }

    /// Connects to the socket once it is there.
    ///
    /// # Errors
    /// When it does not come, or another user has bound it.
    pub(super) async fn connect(self) -> Result<UnixStream, Fault> {
        let end = Instant::now() + LOOKING;
        loop {
            let error = match UnixStream::connect(&self.path).await {
                Ok(stream) if is_trusted(&stream) => return Ok(stream),
                Ok(_) => return Err(self.fault("was bound by another user")),
                Err(error) => error,
            };
            // There is none yet, or that of a process which ended.
            let waits =
                matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::ConnectionRefused);
            if !waits || Instant::now() >= end {
                let what =
                    format_args!("was not bound by the receiver within {LOOKING:?} ({error})");
                return Err(self.fault(what));
            }
            sleep(BETWEEN_LOOKS).await;
        }
    }
}

/// A socket where a sender is expected; its file goes with it.
#[derive(Debug)]
pub(super) struct Bound {
    listener: UnixListener,
    meeting: Meeting,
}

impl Bound {
    /// The sender. Other users who connect are sent away.
    ///
    /// # Errors
    /// When the system takes no more connections.
    pub(super) async fn accept(self) -> Result<UnixStream, Fault> {
        loop {
            let (stream, _) = self.listener.accept().await.map_err(|error| {
                self.meeting.fault(format_args!("accepts no connection ({error})"))
            })?;
            if is_trusted(&stream) {
                return Ok(stream);
            }
        }
    }
}

impl Drop for Bound {
    fn drop(&mut self) {
        // A sender of YARP may have taken it away.
        std::fs::remove_file(&self.meeting.path).ok();
    }
}

/// True when the other end belongs to this user, or to root.
fn is_trusted(stream: &UnixStream) -> bool {
    let own = rustix::process::geteuid().as_raw();
    stream.peer_cred().is_ok_and(|peer| may_meet(own, peer.uid()))
}

const fn may_meet(own: u32, other: u32) -> bool {
    other == own || other == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    const OWN: &str = "127.0.0.1:10002";
    const OTHER: &str = "127.0.0.1:40000";

    fn meeting(folder: Option<&Path>, own_receives: bool) -> Result<Meeting, Fault> {
        Meeting::new(folder, OWN.parse().unwrap(), OTHER.parse().unwrap(), own_receives)
    }

    #[test]
    fn both_ends_go_to_the_same_place() {
        let folder = Some(Path::new("/run/user/7/yarp"));
        let path = |own_receives| meeting(folder, own_receives).unwrap().path;
        assert_eq!(path(true), Path::new("/run/user/7/yarp/10002_40000.sock"));
        assert_eq!(path(false), Path::new("/run/user/7/yarp/40000_10002.sock"));
    }

    #[test]
    fn ends_that_cannot_meet_are_told_why() {
        let there = "192.0.2.7:10002".parse().unwrap();
        let fault = Meeting::new(None, OWN.parse().unwrap(), there, true).unwrap_err();
        assert!(fault.to_string().contains("192.0.2.7 is not on the one of 127.0.0.1"), "{fault}");
        let mapped = "[::ffff:127.0.0.1]:40000".parse().unwrap();
        assert!(Meeting::new(Some(Path::new("/x")), OWN.parse().unwrap(), mapped, true).is_ok());
        let fault = meeting(None, true).unwrap_err().to_string();
        assert!(fault.contains("has no folder here"), "{fault}");
        let long = "/x".repeat(60);
        let fault = meeting(Some(Path::new(&long)), true).unwrap_err().to_string();
        assert!(fault.contains("has 138 bytes with its NUL, allowed are 108"), "{fault}");
    }

    #[test]
    fn other_users_are_not_trusted() {
        assert!(may_meet(1000, 1000) && may_meet(1000, 0));
        assert!(!may_meet(1000, 1001) && !may_meet(0, 1000));
    }

    #[tokio::test]
    async fn a_socket_that_was_left_is_replaced_and_nothing_else_is() {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path().join("deep/folder");
        drop(meeting(Some(&at), true).unwrap().bind().unwrap());
        let path = meeting(Some(&at), true).unwrap().path;
        drop(std::os::unix::net::UnixListener::bind(&path).unwrap());
        assert!(path.exists());
        let bound = meeting(Some(&at), true).unwrap().bind().unwrap();
        let there = Meeting { path: path.clone() };
        let (one, other) = tokio::join!(bound.accept(), there.connect());
        assert!(one.is_ok() && other.is_ok());
        assert!(!path.exists(), "the file stays");

        std::fs::write(&path, "precious").unwrap();
        let fault = meeting(Some(&at), true).unwrap().bind().unwrap_err().to_string();
        assert!(fault.contains("is something else already"), "{fault}");
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "precious");
        let fault = Meeting { path }.connect().await.unwrap_err().to_string();
        assert!(fault.contains("YARP_RUNTIME_DIR"), "{fault}");
    }
}
