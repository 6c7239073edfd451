//! Announcement of a participant's nodes in `ros_discovery_info`, as nodes of any distribution
//! write it.
//!
//! ```text
//!   Iron and later   gid[16] ─ nodes [ namespace, name, [gid[16]], [gid[16]] ]
//!   before           gid[16] 0[8] ─ nodes [ namespace, name, [gid[16] 0[8]], [gid[16] 0[8]] ]
//! ```
//!
//! `rmw_dds_common/msg/Gid` was `char[24]` up to Humble; the message kept its name. Read the new way
//! the old one names no node at all.

use bytes::Bytes;
use wrapyfi_interfaces::Message;
use wrapyfi_interfaces::cdr::{CdrError, CdrReader, CdrValue};
use wrapyfi_interfaces::rmw_dds_common::msg::{Gid, NodeEntitiesInfo, ParticipantEntitiesInfo};

/// Bytes of a GID that say nothing, before Iron.
const UNUSED: usize = 8;
/// Encapsulation header and a GID of 16 bytes.
const AFTER_GID: usize = 4 + 16;
/// Smallest message before Iron: header, GID, no nodes.
const LEAST_BEFORE_IRON: usize = AFTER_GID + UNUSED + 4;

/// An announcement.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Announcement {
    pub(super) info: ParticipantEntitiesInfo,
    /// Written by a distribution before Iron, whose endpoints announce no type hashes.
    pub(super) before_iron: bool,
}

/// Reads an announcement of at most `max_bytes`.
pub(super) fn read(cdr: &Bytes, max_bytes: usize) -> Result<Announcement, CdrError> {
    // After a GID of 16 bytes comes the number of nodes, and nothing where that is zero.
    let before_iron = cdr.len() >= LEAST_BEFORE_IRON
        && cdr
            .get(AFTER_GID..AFTER_GID + UNUSED)
            .is_some_and(|bytes| bytes.iter().all(|b| *b == 0));
    if !before_iron || cdr.len() > max_bytes {
        let info = ParticipantEntitiesInfo::decode(cdr, max_bytes)?;
        return Ok(Announcement { info, before_iron: false });
    }
    let reader = &mut CdrReader::new(cdr)?;
    let gid = read_gid(reader)?;
    let node_entities_info_seq = read_sequence(reader, |reader| {
        Ok(NodeEntitiesInfo {
            node_namespace: reader.read_string()?,
            node_name: reader.read_string()?,
            reader_gid_seq: read_sequence(reader, read_gid)?,
            writer_gid_seq: read_sequence(reader, read_gid)?,
        })
    })?;
    let info = ParticipantEntitiesInfo { gid, node_entities_info_seq };
    Ok(Announcement { info, before_iron: true })
}

fn read_gid(reader: &mut CdrReader<'_>) -> Result<Gid, CdrError> {
    let data = CdrValue::read(reader)?;
    reader.read_byte_array(UNUSED)?;
    Ok(Gid { data })
}

/// Reads a sequence. Nothing is reserved by its count: each element has bytes of its own.
fn read_sequence<T>(
    reader: &mut CdrReader<'_>,
    mut element: impl FnMut(&mut CdrReader<'_>) -> Result<T, CdrError>,
) -> Result<Vec<T>, CdrError> {
    let count: u32 = reader.read_primitive()?;
    (0..count).map(|_| element(reader)).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use wrapyfi_interfaces::cdr::CdrWriter;

    use super::*;

    const MAX: usize = 1 << 20;

    /// Bytes of an announcement as a node of Humble writes it.
    fn write_before_iron(info: &ParticipantEntitiesInfo) -> Bytes {
        fn gid(writer: &mut CdrWriter, gid: &Gid) {
            writer.write_primitive_array(&gid.data);
            writer.write_primitive_array(&[0u8; UNUSED]);
        }
        let count = |all: usize| u32::try_from(all).unwrap();
        let mut writer = CdrWriter::new();
        gid(&mut writer, &info.gid);
        writer.write_primitive(count(info.node_entities_info_seq.len()));
        for node in &info.node_entities_info_seq {
            writer.write_string(&node.node_namespace);
            writer.write_string(&node.node_name);
            for gids in [&node.reader_gid_seq, &node.writer_gid_seq] {
                writer.write_primitive(count(gids.len()));
                gids.iter().for_each(|one| gid(&mut writer, one));
            }
        }
        writer.finish().to_bytes()
    }

    fn infos() -> impl Strategy<Value = ParticipantEntitiesInfo> {
        let gid = || any::<[u8; 16]>().prop_map(|data| Gid { data });
        let gids = move || prop::collection::vec(gid(), 0..4);
        let node = ("/[a-z/]{0,9}", "[a-z_]{1,9}", gids(), gids()).prop_map(
            |(node_namespace, node_name, reader_gid_seq, writer_gid_seq)| NodeEntitiesInfo {
                node_namespace,
                node_name,
                reader_gid_seq,
                writer_gid_seq,
            },
        );
        (gid(), prop::collection::vec(node, 0..4)).prop_map(|(gid, node_entities_info_seq)| {
            ParticipantEntitiesInfo { gid, node_entities_info_seq }
        })
    }

    proptest! {
        #[test]
        fn either_layout_is_known_by_itself(info in infos()) {
            let old = read(&write_before_iron(&info), MAX).unwrap();
            prop_assert_eq!(&old, &Announcement { info: info.clone(), before_iron: true });
            let new = read(&info.encode().to_bytes(), MAX).unwrap();
            prop_assert_eq!(new, Announcement { info, before_iron: false });
        }

        #[test]
        fn a_piece_of_one_is_an_error(info in infos(), cut in 0usize..400) {
            let whole = write_before_iron(&info);
            let cut = cut % whole.len();
            // An empty announcement that is cut reads as an empty one of the new kind.
            prop_assume!(!(24..LEAST_BEFORE_IRON).contains(&cut));
            prop_assert!(read(&whole.slice(..cut), MAX).is_err());
        }

        #[test]
        fn any_bytes_are_read_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            drop(read(&Bytes::from(bytes), MAX));
        }
    }

    #[test]
    fn a_count_that_no_bytes_back_is_refused() {
        let empty = ParticipantEntitiesInfo::default();
        let mut bytes = write_before_iron(&empty).to_vec();
        bytes[AFTER_GID + UNUSED..].fill(0xff);
        assert!(read(&Bytes::from(bytes), MAX).is_err());
    }
}
