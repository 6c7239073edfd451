//! The identity of a request as `rmw_cyclonedds_cpp` writes it: 16 bytes in front of the body.
//!
//! ```text
//!   00 01 00 00 │ client u64 │ sequence i64 │ body …      on DDS, byte order of the first word
//!   00 01 00 00 │ body …                                   to and from codecs
//! ```
//!
//! Sixteen bytes leave the alignment of the body as it was.

use bytes::{Bytes, BytesMut};

use super::graph::RequestId;

/// Length of the encapsulation header.
const ENCAPSULATION: usize = 4;
/// Length of the identity.
pub(super) const HEADER: usize = 16;
/// Shortest request or reply.
pub(super) const LEAST: usize = ENCAPSULATION + HEADER;

/// A request or a reply, its identity taken off.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Identified {
    /// Number of the client that asks or is answered.
    pub(super) client: u64,
    /// Number of the request at that client.
    pub(super) sequence: i64,
    /// Encapsulation header and body.
    pub(super) cdr: Bytes,
}

/// The identity of a client, made of the GUID of its request writer.
pub(super) fn client_id(guid: [u8; 16]) -> u64 {
    // The halves hold the participant's random bytes and the entity's number.
    let folded = u128::from_le_bytes(guid);
    (folded as u64) ^ ((folded >> 64) as u64)
}

/// Identity of a client's request.
pub(super) fn request_id(client: u64, sequence: i64) -> RequestId {
    let mut id = [0; 16];
    if let Some(first) = id.first_chunk_mut::<8>() {
        *first = client.to_le_bytes();
    }
    RequestId { client: id, sequence }
}

/// The client of a request.
pub(super) fn client(id: &RequestId) -> u64 {
    id.client.first_chunk::<8>().copied().map(u64::from_le_bytes).unwrap_or_default()
}

/// Takes the identity off; `None` where there is none.
pub(super) fn split(cdr: &Bytes) -> Option<Identified> {
    let (encapsulation, rest) = cdr.split_first_chunk::<ENCAPSULATION>()?;
    let (client, rest) = rest.split_first_chunk::<8>()?;
    let (sequence, body) = rest.split_first_chunk::<8>()?;
    let (client, sequence) = if is_little_endian(encapsulation) {
        (u64::from_le_bytes(*client), i64::from_le_bytes(*sequence))
    } else {
        (u64::from_be_bytes(*client), i64::from_be_bytes(*sequence))
    };
    let mut plain = BytesMut::with_capacity(ENCAPSULATION + body.len());
    plain.extend_from_slice(encapsulation);
    plain.extend_from_slice(body);
    Some(Identified { client, sequence, cdr: plain.freeze() })
}

/// The pieces of a message and of its identity, as [`split`] reads them; `None` where the first
/// piece does not begin with an encapsulation header. `room` holds the identity.
pub(super) fn join<'a>(
    client: u64,
    sequence: i64,
    parts: &'a [&'a [u8]],
    room: &'a mut [u8; HEADER],
) -> Option<Vec<&'a [u8]>> {
    let (first, others) = parts.split_first()?;
    let (encapsulation, begin) = first.split_first_chunk::<ENCAPSULATION>()?;
    let (id, number) = room.split_first_chunk_mut::<8>()?;
    if is_little_endian(encapsulation) {
        *id = client.to_le_bytes();
        number.copy_from_slice(&sequence.to_le_bytes());
    } else {
        *id = client.to_be_bytes();
        number.copy_from_slice(&sequence.to_be_bytes());
    }
    let mut joined = Vec::with_capacity(parts.len() + 2);
    joined.extend([&encapsulation[..], &room[..], begin]);
    joined.extend(others);
    Some(joined)
}

/// The lowest bit of an encapsulation's kind says it for every kind.
fn is_little_endian(&[_, kind, ..]: &[u8; ENCAPSULATION]) -> bool {
    kind & 1 == 1
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn bytes(hex: &str) -> Bytes {
        let digits: String = hex.split_whitespace().collect();
        (0..digits.len() / 2)
            .map(|at| u8::from_str_radix(&digits[2 * at..2 * at + 2], 16).unwrap())
            .collect()
    }

    /// Captured from `rmw_cyclonedds_cpp`: `add_two_ints` with 2 and 3, and `std_srvs/srv/Empty`.
    #[test]
    fn captured_requests_and_replies_are_read_and_written() {
        for (capture, client, sequence, body) in [
            (
                "00010000 5eeccb7bdbcd8b25 0100000000000000 0200000000000000 0300000000000000",
                0x258b_cddb_7bcb_ec5e,
                1,
                "00010000 0200000000000000 0300000000000000",
            ),
            (
                "00010000 5eeccb7bdbcd8b25 0100000000000000 0500000000000000",
                0x258b_cddb_7bcb_ec5e,
                1,
                "00010000 0500000000000000",
            ),
            (
                "00010000 4c1dd2d1bee40997 0300000000000000 00000000",
                0x9709_e4be_d1d2_1d4c,
                3,
                "00010000 00000000",
            ),
        ] {
            let cdr = bytes(body);
            let identified = Identified { client, sequence, cdr: cdr.clone() };
            assert_eq!(split(&bytes(capture)).unwrap(), identified);
            let parts: [&[u8]; 1] = [&cdr];
            let mut room = [0; HEADER];
            let joined = join(client, sequence, &parts, &mut room).unwrap().concat();
            assert_eq!(joined, bytes(capture));
        }
    }

    #[test]
    fn what_is_too_short_has_no_identity() {
        let whole = Bytes::from(vec![0; LEAST]);
        assert!(split(&whole).is_some());
        for length in 0..LEAST {
            assert_eq!(split(&whole.slice(..length)), None);
        }
        let mut room = [0; HEADER];
        assert_eq!(join(1, 1, &[], &mut room), None);
        let mut room = [0; HEADER];
        assert_eq!(join(1, 1, &[&[0, 1, 0]], &mut room), None);
    }

    proptest! {
        #[test]
        fn identities_survive_in_both_byte_orders(
            client: u64,
            sequence: i64,
            kind in 0_u8..2,
            body in proptest::collection::vec(any::<u8>(), 0..64),
            cut in 0_usize..64,
        ) {
            let first = [&[0, kind, 0, 0], &body[..cut.min(body.len())]].concat();
            let parts: [&[u8]; 2] = [&first, &body[cut.min(body.len())..]];
            let mut room = [0; HEADER];
            let joined = Bytes::from(join(client, sequence, &parts, &mut room).unwrap().concat());
            let cdr = Bytes::from(parts.concat());
            prop_assert_eq!(split(&joined), Some(Identified { client, sequence, cdr }));
        }
    }
}
