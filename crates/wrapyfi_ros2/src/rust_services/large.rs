//! Replies that RustDDS would cut into fragments.
//!
//! ```text
//!   reply ─ 1. fragments that say whose it is, from a socket of our own ─▶ readers of its clients
//!         └ 2. the same sample to RustDDS, without identity ──▶ its fragments: passed over as known,
//!                                                               repeated where one of ours is lost
//! ```
//!
//! RTPS tells who sends by the GUID in a message, not by the address it comes from, so both are
//! samples of one writer. Ours go first: a reader takes the identity from what it has first (Fast
//! DDS) or last (RustDDS). The number of the sample must be known before RustDDS gives it, which is
//! so because no other program uses the writer. A sample for which RustDDS then has no room is owed: no
//! other may have its number.

use std::io;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::time::Instant;

use bytes::Bytes;

use super::fragments::Identified;
use crate::discovery_info::Gid;

/// A reply for which there is no way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(super) enum UnsendableReply {
    /// The client's reader announces no address to send to.
    #[error(
        "a reply of {size} bytes is over the {limit} bytes that RustDDS sends with its identity, and its client announces no IPv4 address to send more to: set RMW_IMPLEMENTATION=rmw_cyclonedds_cpp on both sides"
    )]
    NoAddress {
        /// Bytes with the encapsulation header.
        size: usize,
        /// Bytes that fit one datagram.
        limit: usize,
    },
    /// Larger than is sent in one go.
    #[error(
        "a reply of {size} bytes is over the limit of {limit} bytes of the Fast DDS mapping: for larger replies set RMW_IMPLEMENTATION=rmw_cyclonedds_cpp on both sides"
    )]
    TooLarge {
        /// Bytes with the encapsulation header.
        size: usize,
        /// Most bytes.
        limit: usize,
    },
}

/// Largest reply that is cut into fragments, with its encapsulation header. They go out in one
/// burst, which the receiver's socket has to hold: of 208 KiB, Linux's default, with what the
/// kernel adds.
pub(super) const MAX_LARGE: usize = 128 << 10;

/// State of the samples that a writer has sent.
#[derive(Debug, Default)]
pub(super) struct Sent {
    /// Number of the last sample, and when it was given to RustDDS.
    pub(super) last: Option<(i64, Instant)>,
    /// A sample that has its number already and that RustDDS has not taken yet.
    pub(super) owed: Option<Bytes>,
}

impl Sent {
    /// Number of the next sample.
    pub(super) fn next(&self) -> i64 {
        self.last.map_or(0, |(number, _)| number).saturating_add(1)
    }
}

/// A reader and where it listens.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Addressed {
    pub(super) reader: Gid,
    pub(super) addresses: Vec<SocketAddr>,
    /// Bytes of a datagram on the way there.
    pub(super) room: usize,
}

/// Sends a sample to readers.
pub(super) fn send(sample: &Identified<'_>, readers: &[Addressed]) -> io::Result<()> {
    let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?;
    for Addressed { reader, addresses, room } in readers {
        for datagram in sample.datagrams(*reader, *room) {
            let mut sent = Err(io::ErrorKind::AddrNotAvailable.into());
            // One of several networks may be down.
            for address in addresses {
                let result = socket.send_to(&datagram, address);
                if sent.is_err() {
                    sent = result;
                }
            }
            sent?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn numbers_count_from_one() {
        let mut sent = Sent::default();
        assert_eq!(sent.next(), 1);
        sent.last = Some((7, Instant::now()));
        assert_eq!(sent.next(), 8);
    }

    #[test]
    fn every_reader_gets_every_fragment_wherever_one_of_its_addresses_is() {
        let heard = [(); 2].map(|()| UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap());
        let body = vec![7; 5000];
        let sample =
            Identified { writer: [1; 16], number: 1, related: ([2; 16], 1), stamp: 0, body: &body };
        let nowhere = SocketAddr::from(([255, 255, 255, 255], 9));
        let readers: Vec<_> = heard
            .iter()
            .zip([3, 4])
            .map(|(socket, who)| Addressed {
                reader: [who; 16],
                addresses: vec![nowhere, socket.local_addr().unwrap()],
                room: 1400,
            })
            .collect();
        send(&sample, &readers).unwrap();
        for (socket, reader) in heard.iter().zip(&readers) {
            socket.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
            for datagram in sample.datagrams(reader.reader, 1400) {
                let mut room = [0; 2000];
                let got = socket.recv(&mut room).unwrap();
                assert_eq!(room[..got], datagram);
            }
        }
        let unreachable = Addressed { reader: [3; 16], addresses: vec![nowhere], room: 1400 };
        assert!(send(&sample, &[unreachable]).is_err());
    }
}
