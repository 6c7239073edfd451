use bytes::Bytes;
use proptest::collection::vec;
use proptest::prelude::*;

use super::*;
use crate::Message;
use crate::rmw_dds_common::msg::{Gid, NodeEntitiesInfo, ParticipantEntitiesInfo};
use crate::sensor_msgs::msg::Image;
use crate::std_msgs::msg::String as Text;
use crate::wrapyfi_msgs::msg::{NativeObject, Tensor};

fn text(cdr: &[u8]) -> Result<String, CdrError> {
    Text::decode(&Bytes::copy_from_slice(cdr), 1 << 20).map(|text| text.data)
}

#[test]
fn large_bytes_are_shared_both_ways() {
    let data = Bytes::from(vec![7; 1 << 20]);
    let image = Image { data: data.clone(), encoding: "mono8".into(), ..Image::default() };
    let parts = image.encode();
    let shared = parts.pieces().iter().find(|piece| piece.len() == data.len()).unwrap();
    assert_eq!(shared.as_ptr(), data.as_ptr());
    assert_eq!(parts.pieces().len(), 2);

    let cdr = parts.to_bytes();
    let decoded = Image::decode(&cdr, cdr.len()).unwrap();
    assert_eq!(decoded, image);
    assert_eq!(decoded.data.as_ptr(), cdr[cdr.len() - data.len()..].as_ptr());
}

#[test]
fn text_at_hand_as_bytes_is_shared_both_ways() {
    let long = Bytes::from("x".repeat(5000));
    let mut writer = CdrWriter::new();
    writer.write_text(&long);
    writer.write_text(&Bytes::from_static(b"short"));
    let parts = writer.finish();
    assert_eq!(parts.pieces()[1].as_ptr(), long.as_ptr());
    let cdr = parts.to_bytes();
    let mut reader = CdrReader::new(&cdr).unwrap();
    let read = reader.read_text().unwrap();
    assert_eq!((&read, read.as_ptr()), (&long, cdr[8..].as_ptr()));
    assert_eq!(reader.read_string().unwrap(), "short");
    assert_eq!(reader.remaining(), 0);
}

#[test]
fn alignment_counts_across_shared_pieces() {
    let tensor = |size, shape| Tensor {
        dtype: "uint8".into(),
        shape,
        data: Bytes::from(vec![1; size]),
        ..Tensor::default()
    };
    let object = NativeObject {
        json: "{}".into(),
        tensors: vec![tensor(5001, vec![5001]), tensor(3, vec![3]), tensor(4097, vec![1, 4097])],
        ..NativeObject::default()
    };
    let parts = object.encode();
    assert_eq!(parts.pieces().len(), 4);
    let cdr = parts.to_bytes();
    assert_eq!(NativeObject::decode(&cdr, cdr.len()).unwrap(), object);
}

#[test]
fn tolerates_what_ros_tolerates() {
    let hello = Ok("hello".to_owned());
    assert_eq!(text(b"\0\x01\0\0\x06\0\0\0hello\0"), hello);
    assert_eq!(text(b"\0\0\0\0\0\0\0\x06hello\0"), hello, "big-endian");
    assert_eq!(text(b"\0\x01\xff\xff\x06\0\0\0hello\0"), hello, "any options");
    assert_eq!(text(b"\0\x01\0\0\x06\0\0\0hello\0\xdd\xdd\xff"), hello, "trailing bytes");
    assert_eq!(text(b"\0\x01\0\0\x08\0\0\0hello\0x\0"), hello, "NUL inside");
    assert_eq!(text(b"\0\x01\0\0\0\0\0\0"), Ok(String::new()), "length 0");
}

#[test]
fn big_endian_messages_decode_in_full() {
    let cdr = b"\0\0\0\0\
        \0\0\0\x01\0\0\0\x02\0\0\0\x02a\0..\
        \0\0\0\x03{}\0.\
        \0\0\0\x01\
        \0\0\0\x06uint8\0..\
        \0\0\0\x02....\0\0\0\0\0\0\0\x01\0\0\0\0\0\0\x01\x02\
        \0\0\0\x01\0...\0\0\0\x01\x2a";
    let object = NativeObject::decode(&Bytes::from_static(cdr), 1 << 20).unwrap();
    assert_eq!((object.header.stamp.sec, object.header.stamp.nanosec), (1, 2));
    assert_eq!((object.header.frame_id.as_str(), object.json.as_str()), ("a", "{}"));
    let tensor = &object.tensors[0];
    assert_eq!((tensor.dtype.as_str(), &tensor.shape), ("uint8", &vec![1, 258]));
    assert_eq!(tensor.data, [42_u8][..]);
}

#[test]
fn refuses_with_field_and_numbers() {
    assert_eq!(
        text(b"\0\x03\0\0\x06\0\0\0hello\0").unwrap_err(),
        CdrError::Encapsulation(vec![0, 3, 0, 0])
    );
    for size in 0..4 {
        let short = &b"\0\x01\0"[..size.min(3)];
        assert_eq!(text(short).unwrap_err(), CdrError::Encapsulation(short.to_vec()));
    }
    assert_eq!(
        text(b"\0\x01\0\0\xfe\xff\xff\xffhello\0").unwrap_err().to_string(),
        "data claims 4294967294 elements, which need 4294967294 bytes, 6 are left: corrupt, or \
         of another type"
    );
    assert_eq!(
        text(b"\0\x01\0\0\x05\0\0\0hello\0").unwrap_err(),
        CdrError::Unterminated { path: "data".into(), length: 5, last: b'o' }
    );
    assert_eq!(
        text(b"\0\x01\0\0\x05\0").unwrap_err(),
        CdrError::Truncated { path: "data".into(), needed: 4, available: 2 }
    );
    assert_eq!(
        Text::decode(&Bytes::from_static(b"\0\x01\0\0\x02\0\0\0a\0"), 9).unwrap_err(),
        CdrError::TooLarge { actual: 10, limit: 9 }
    );
}

#[test]
fn what_is_no_unicode_is_replaced() {
    let string = Bytes::from_static(b"\0\x01\0\0\x04\0\0\x0045\xb0\0");
    assert_eq!(CdrReader::new(&string).unwrap().read_string().unwrap(), "45\u{fffd}");
    // A surrogate without its other half, and a unit that has more than 16 bits.
    let wide = b"\0\x01\0\0\x03\0\0\0\x00\xd8\0\0a\0\0\0\0\0\x01\0";
    let wide = Bytes::from_static(wide);
    assert_eq!(CdrReader::new(&wide).unwrap().read_wstring().unwrap(), "\u{fffd}a\u{fffd}");
}

#[test]
fn a_lie_deep_inside_names_its_path() {
    let node = NodeEntitiesInfo { node_name: "n".into(), ..NodeEntitiesInfo::default() };
    let info = ParticipantEntitiesInfo {
        node_entities_info_seq: vec![node.clone(), node],
        ..ParticipantEntitiesInfo::default()
    };
    let mut cdr = info.encode().to_bytes().to_vec();
    let end = cdr.len();
    cdr[end - 4..].copy_from_slice(&0x1000_0000_u32.to_le_bytes());
    let error = ParticipantEntitiesInfo::decode(&cdr.into(), 1 << 20).unwrap_err();
    assert_eq!(
        error,
        CdrError::Length {
            path: "node_entities_info_seq[1].writer_gid_seq".into(),
            claimed: 0x1000_0000,
            needed: 0x1_0000_0000,
            available: 0
        }
    );
}

/// Bytes are refused, or are a message that can be written and read again.
fn read_or_refuse<M: Message>(cdr: &Bytes) {
    if let Ok(message) = M::decode(cdr, 1 << 20) {
        let again = message.encode().to_bytes();
        assert_eq!(M::decode(&again, 1 << 20), Ok(message));
    }
}

fn gids() -> impl Strategy<Value = Vec<Gid>> {
    vec(any::<[u8; 16]>().prop_map(|data| Gid { data }), 0..4)
}

prop_compose! {
    fn participant()(
        gid: [u8; 16],
        nodes in vec(("[^\0]{0,9}", "[^\0]{0,9}", gids(), gids()), 0..4),
    ) -> ParticipantEntitiesInfo {
        let node = |(node_namespace, node_name, reader_gid_seq, writer_gid_seq)| {
            NodeEntitiesInfo { node_namespace, node_name, reader_gid_seq, writer_gid_seq }
        };
        ParticipantEntitiesInfo {
            gid: Gid { data: gid },
            node_entities_info_seq: nodes.into_iter().map(node).collect(),
        }
    }
}

prop_compose! {
    fn object()(
        sec: i32,
        nanosec: u32,
        json in "[^\0]{0,20}",
        tensors in vec(("[a-z0-9]{0,9}", vec(any::<u64>(), 0..4), vec(any::<u8>(), 0..5000)), 0..3),
    ) -> NativeObject {
        let mut object = NativeObject { json, ..NativeObject::default() };
        object.header.stamp.sec = sec;
        object.header.stamp.nanosec = nanosec;
        let tensor = |(dtype, shape, data): (_, _, Vec<u8>)| {
            Tensor { dtype, shape, device: String::new(), data: data.into() }
        };
        object.tensors = tensors.into_iter().map(tensor).collect();
        object
    }
}

proptest! {
    #[test]
    fn participants_return(info in participant()) {
        let cdr = info.encode().to_bytes();
        prop_assert_eq!(ParticipantEntitiesInfo::decode(&cdr, cdr.len()).unwrap(), info);
    }

    #[test]
    fn objects_return(object in object()) {
        let parts = object.encode();
        prop_assert!(parts.pieces().iter().all(|piece| !piece.is_empty()));
        let cdr = parts.to_bytes();
        prop_assert_eq!(NativeObject::decode(&cdr, cdr.len()).unwrap(), object);
    }

    #[test]
    fn any_bytes_are_read_or_refused(mut bytes in vec(any::<u8>(), 0..200), order in 0_u8..3) {
        for (byte, header) in bytes.iter_mut().zip([0, order]) {
            *byte = header;
        }
        let cdr = Bytes::from(bytes);
        read_or_refuse::<ParticipantEntitiesInfo>(&cdr);
        read_or_refuse::<NativeObject>(&cdr);
        read_or_refuse::<Image>(&cdr);
    }

    #[test]
    fn every_truncation_is_refused(object in object(), cut: prop::sample::Index) {
        let cdr = object.encode().to_bytes();
        let cut = cut.index(cdr.len());
        prop_assert!(NativeObject::decode(&cdr.slice(..cut), 1 << 20).is_err());
    }

    #[test]
    fn a_changed_byte_is_read_or_refused(object in object(), at: prop::sample::Index, to: u8) {
        let mut cdr = object.encode().to_bytes().to_vec();
        let at = at.index(cdr.len());
        cdr[at] = to;
        read_or_refuse::<NativeObject>(&cdr.into());
    }
}
