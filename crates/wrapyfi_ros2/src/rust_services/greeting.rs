//! Asks a writer of Fast DDS what it has, as it wants to be asked.
//!
//! ```text
//!   RustDDS   ─ ACKNACK { base 1 } ─▶ Fast DDS: says it with its next heartbeat, in 3 s
//!   Greeting  ─ ACKNACK { base 0 } ─▶ Fast DDS: says it now
//! ```
//!
//! Fast DDS says what it has when it matches a reader. If RustDDS does not know the writer by then,
//! it passes over that and asks again, in words that Fast DDS (2.14) takes for an acknowledgement.
//! Until the next heartbeat it keeps everything from the user that is not the first sample of its
//! writer, and misses a request that came meanwhile: first calls took three seconds.

use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, UdpSocket};

use super::settings::Settings;
use crate::discovery_info::Gid;

/// First bytes of GUIDs of Fast DDS: its vendor id.
const FAST_DDS: [u8; 2] = [0x01, 0x0f];
/// Addresses of one writer that are asked.
const MAX_ADDRESSES: usize = 16;

/// Asks writers of Fast DDS.
#[derive(Debug)]
pub(super) struct Greeting {
    socket: UdpSocket,
}

impl Greeting {
    /// Greeting for the readers of a participant with `settings`.
    pub(super) fn new(settings: &Settings) -> io::Result<Self> {
        let mut networks = settings.networks.iter().flatten();
        // From there nothing leaves the host.
        let confined = settings.networks.is_some() && networks.all(IpAddr::is_loopback);
        let from = if confined { Ipv4Addr::LOCALHOST } else { Ipv4Addr::UNSPECIFIED };
        let socket = UdpSocket::bind((from, 0))?;
        // A question that cannot be sent now is asked again by RustDDS.
        socket.set_nonblocking(true)?;
        Ok(Self { socket })
    }

    /// True when `writer` has to be asked.
    pub(super) fn is_for(writer: &Gid) -> bool {
        writer.starts_with(&FAST_DDS)
    }

    /// Asks `writer`, which listens at `addresses`, what it has for `reader`.
    pub(super) fn ask(&self, reader: &Gid, writer: &Gid, addresses: &[SocketAddr]) {
        let datagram = datagram(reader, writer);
        for address in addresses.iter().take(MAX_ADDRESSES) {
            if let Err(error) = self.socket.send_to(&datagram, address) {
                tracing::debug!(%error, %address, "a writer was not asked");
            }
        }
    }
}

/// One message: header, INFO_DST, ACKNACK.
fn datagram(reader: &Gid, writer: &Gid) -> Vec<u8> {
    let (reader_prefix, reader_id) = reader.split_at(12);
    let (writer_prefix, writer_id) = writer.split_at(12);
    let parts: [&[u8]; 10] = [
        // Header: RTPS 2.4, vendor.
        b"RTPS\x02\x04\x01\x12",
        reader_prefix,
        // INFO_DST, little-endian, 12 bytes.
        &[0x0e, 0x01, 12, 0],
        writer_prefix,
        // ACKNACK, little-endian, not final: to be answered; 24 bytes.
        &[0x06, 0x01, 24, 0],
        reader_id,
        writer_id,
        // Everything from 0 on, of which nothing in particular.
        &[0; 8],
        &[0; 4],
        // The count: Fast DDS hears only of counts from the next on, and the one after this is 0,
        // so that it goes on hearing RustDDS, which counts from 0.
        &[0xff; 4],
    ];
    parts.concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_message_asks_for_everything() {
        let (mut reader, mut writer): (Gid, Gid) = ([0; 16], [0; 16]);
        (0x10..).zip(&mut reader).for_each(|(number, byte)| *byte = number);
        (0x20..).zip(&mut writer).for_each(|(number, byte)| *byte = number);
        let expected = "525450530204 0112 101112131415161718191a1b \
            0e010c00 202122232425262728292a2b \
            06011800 1c1d1e1f 2c2d2e2f 0000000000000000 00000000 ffffffff";
        let hex: String =
            datagram(&reader, &writer).iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(hex, expected.replace(' ', ""));
    }

    #[test]
    fn only_fast_dds_is_asked() {
        let of = |vendor: [u8; 2]| {
            let mut gid: Gid = [7; 16];
            gid[..2].copy_from_slice(&vendor);
            Greeting::is_for(&gid)
        };
        assert!(of([1, 0x0f]));
        assert!(!of([1, 0x10]) && !of([1, 0x12]));
    }
}
