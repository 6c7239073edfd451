//! Identity of a request: the related sample identity of RPC over DDS, as Fast DDS fills it.
//!
//! ```text
//!   request   { GUID of the client's reply reader, number unknown }   its DATA has number n
//!   reply     { the same GUID,                     n              }
//! ```
//!
//! A request may carry none: then it is named by its own writer and number, as the standard has it
//! and Fast DDS accepts it. RustDDS writes the 24 bytes under both parameter ids that Fast DDS
//! writes (0x0083 and 0x800f), and reads either.

use rustdds::rpc::SampleIdentity;
use rustdds::{GUID, SequenceNumber};

use crate::discovery_info::Gid;
use crate::graph::RequestId;

/// Bytes of the identity: a GUID and a sequence number.
pub(super) const BYTES: usize = 24;

/// A GUID that names no client.
const UNKNOWN: Gid = [0; 16];

/// Identity that a request carries: the reader on which its client awaits the reply.
pub(super) fn of_request(reply_reader: GUID) -> SampleIdentity {
    SampleIdentity { writer_guid: reply_reader, sequence_number: SequenceNumber::UNKNOWN }
}

/// Identity that a reply carries.
pub(super) fn of_reply(id: &RequestId) -> SampleIdentity {
    SampleIdentity {
        writer_guid: GUID::from_bytes(id.client),
        sequence_number: SequenceNumber::new(id.sequence),
    }
}

/// Name of a request that `writer` sent under `number`, with what it carries.
pub(super) fn request_id(related: Option<SampleIdentity>, writer: Gid, number: i64) -> RequestId {
    let client = related.map(|identity| identity.writer_guid.to_bytes());
    RequestId { client: client.filter(|gid| *gid != UNKNOWN).unwrap_or(writer), sequence: number }
}

/// Client and number that a reply names; `None` where it names no client.
pub(super) fn reply_to(related: Option<SampleIdentity>) -> Option<(Gid, i64)> {
    let identity = related?;
    let client = identity.writer_guid.to_bytes();
    (client != UNKNOWN).then(|| (client, i64::from(identity.sequence_number)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Related sample identities of wire/decoded, service `add_two_ints` of rmw_fastrtps_cpp.
    const READER: Gid = [1, 0x0f, 0xb0, 0x64, 0x69, 0x2b, 7, 0xa3, 0, 0, 0, 0, 0, 0, 0x13, 4];
    const WRITER: Gid = [1, 0x0f, 0xb0, 0x64, 0x69, 0x2b, 7, 0xa3, 0, 0, 0, 0, 0, 0, 0x14, 3];

    #[test]
    fn a_request_names_the_reader_of_its_client() {
        let carried = of_request(GUID::from_bytes(READER));
        assert_eq!((carried.sequence_number.high(), carried.sequence_number.low()), (-1, 0));
        let id = request_id(Some(carried), WRITER, 1);
        assert_eq!(id, RequestId { client: READER, sequence: 1 });
        let reply = of_reply(&id);
        assert_eq!((reply.sequence_number.high(), reply.sequence_number.low()), (0, 1));
        assert_eq!(reply_to(Some(reply)), Some((READER, 1)));
    }

    #[test]
    fn a_request_without_identity_is_named_by_its_sample() {
        let id = RequestId { client: WRITER, sequence: 7 };
        assert_eq!(request_id(None, WRITER, 7), id);
        let empty = of_request(GUID::from_bytes(UNKNOWN));
        assert_eq!(request_id(Some(empty), WRITER, 7), id);
        assert_eq!(reply_to(None), None);
        assert_eq!(reply_to(Some(empty)), None);
    }

    #[test]
    fn numbers_beyond_32_bits_survive() {
        for sequence in [1, i64::from(u32::MAX), i64::from(u32::MAX) + 1, i64::MAX] {
            let id = RequestId { client: READER, sequence };
            assert_eq!(reply_to(Some(of_reply(&id))), Some((READER, sequence)));
        }
    }
}
