//! The end of a participant, in a form that Fast DDS reads.
//!
//! ```text
//!   RustDDS  ─ DATA { key in the payload } ──▶ CycloneDDS: gone;  Fast DDS: passes over it
//!   Goodbye  ─ DATA { key hash in the inline QoS } ─────────────▶ Fast DDS: gone
//! ```
//!
//! Fast DDS (2.14) takes the key of what is disposed of from the key hash alone. RustDDS sends none
//! and has no setting for it, so that services stayed in `ros2 service list`, and clients took them
//! to be there, until their lease was over: a minute. So the datagram is written here.
//!
//! It is best effort, as all messages about participants are: who does not hear it waits.

use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddrV4, UdpSocket};

use super::ports;
use super::settings::{Settings, addresses};
use crate::discovery_info::Gid;

/// Says on drop that the participant has gone.
#[derive(Debug)]
pub(super) struct Goodbye {
    datagram: Vec<u8>,
    domain_id: u16,
    /// Interfaces it is said on.
    addresses: Vec<Ipv4Addr>,
}

/// Group on which participants announce themselves.
const GROUP: Ipv4Addr = Ipv4Addr::new(239, 255, 0, 1);

impl Goodbye {
    /// The end of `participant`, which is created with `settings`.
    pub(super) fn new(settings: &Settings, participant: &Gid) -> Self {
        let networks = settings.networks.as_deref();
        let addresses = networks.map_or_else(addresses, |networks| {
            let v4 = |address: &IpAddr| match address {
                IpAddr::V4(address) => Some(*address),
                IpAddr::V6(_) => None,
            };
            networks.iter().filter_map(v4).collect()
        });
        Self { datagram: datagram(participant), domain_id: settings.domain_id, addresses }
    }

    fn say_from(&self, address: Ipv4Addr) -> io::Result<()> {
        let socket = UdpSocket::bind((address, 0))?;
        // A full queue is no reason to wait at the end of a program.
        socket.set_nonblocking(true)?;
        if address.is_loopback() {
            let of_index = |index| ports::discovery(self.domain_id, index);
            for port in (0..ports::PARTICIPANTS).map_while(of_index) {
                // No program has most of these ports.
                _ = socket.send_to(&self.datagram, (address, port));
            }
        } else if let Some(port) = ports::multicast(self.domain_id) {
            // Linux sends to a group by the interface that has the address of the socket.
            socket.send_to(&self.datagram, SocketAddrV4::new(GROUP, port))?;
        }
        Ok(())
    }
}

impl Drop for Goodbye {
    fn drop(&mut self) {
        for &address in &self.addresses {
            if let Err(error) = self.say_from(address) {
                tracing::debug!(%error, %address, "the end of the services was not said");
            }
        }
    }
}

/// One message: header, one DATA of the writer of participants, without payload.
fn datagram(participant: &Gid) -> Vec<u8> {
    /// Number of the message behind all of RustDDS's: readers pass over older ones.
    const NUMBER: i32 = i32::MAX;
    const VENDOR: [u8; 2] = [0x01, 0x12];
    let mut data = Vec::with_capacity(76);
    // Header: RTPS 2.4, vendor, prefix of the GUID.
    data.extend_from_slice(b"RTPS\x02\x04");
    data.extend_from_slice(&VENDOR);
    data.extend(participant.iter().take(12));
    // DATA, little-endian, with inline QoS: 52 bytes.
    data.extend_from_slice(&[0x15, 0x03, 52, 0]);
    // No flags; inline QoS after 16 bytes.
    data.extend_from_slice(&[0, 0, 16, 0]);
    // Reader and writer of participants.
    data.extend_from_slice(&[0, 1, 0, 0xc7, 0, 1, 0, 0xc2]);
    // The number, its high half first.
    data.extend_from_slice(&[0; 4]);
    data.extend_from_slice(&NUMBER.to_le_bytes());
    // PID_KEY_HASH: of a participant, its GUID.
    data.extend_from_slice(&[0x70, 0, 16, 0]);
    data.extend_from_slice(participant);
    // PID_STATUS_INFO: disposed, unregistered. PID_SENTINEL.
    data.extend_from_slice(&[0x71, 0, 4, 0, 0, 0, 0, 3]);
    data.extend_from_slice(&[1, 0, 0, 0]);
    data
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_message_says_who_has_gone() {
        let mut gid: Gid = [0; 16];
        (1..).zip(&mut gid).for_each(|(number, byte)| *byte = number);
        let expected = "525450530204 0112 0102030405060708090a0b0c \
            15033400 00001000 000100c7 000100c2 00000000ffffff7f \
            70001000 0102030405060708090a0b0c0d0e0f10 7100040000000003 01000000";
        let hex: String = datagram(&gid).iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(hex, expected.replace(' ', ""));
    }
}
