//! Tensors that no program should have sent: views that leave their storage, bombs, pickles that act,
//! archives that lie. And views of every shape, which are read as their strides say.

use crate::tensors::{
    DEFLATED, STORED, decode, encode, floats, object, pickled, refusal, torch_file, torch_wire,
    vector, wire,
};
use bytes::Bytes;
use proptest::prelude::*;
use serde_json::{Value as Json, json};
use wrapyfi_data::Limits;
use wrapyfi_data::codec::json as codec;

#[test]
fn views_become_row_major() {
    let storage = floats(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]);
    for (offset, size, stride, expected) in [
        (0, &[2, 3][..], &[3, 1][..], &[0.0, 1.0, 2.0, 3.0, 4.0, 5.0][..]),
        (0, &[3, 2], &[1, 3], &[0.0, 3.0, 1.0, 4.0, 2.0, 5.0]),
        (2, &[3], &[3], &[2.0, 5.0, 8.0]),
        (9, &[1, 1], &[77, -0], &[9.0]),
        (4, &[], &[], &[4.0]),
        (1, &[2, 2, 2], &[0, 4, 1], &[1.0, 2.0, 5.0, 6.0, 1.0, 2.0, 5.0, 6.0]),
        (5, &[2, 1, 2], &[2, 9, 1], &[5.0, 6.0, 7.0, 8.0]),
        (0, &[0, 3], &[3, 1], &[]),
        (1 << 40, &[0, 1 << 40, 1 << 40], &[1, 1, 1], &[]),
        (1 << 62, &[1 << 62, 0, 1 << 62], &[1 << 62, 1 << 62, 1 << 62], &[]),
        (0, &[1, 2, 2], &[i64::MAX, 1, 2], &[0.0, 2.0, 1.0, 3.0]),
    ] {
        for method in [STORED, DEFLATED] {
            let value = decode(&torch_wire(&pickled(10, offset, size, stride), &storage, method));
            let tensor = value.as_tensor().unwrap_or_else(|| panic!("{value:?}"));
            assert_eq!(tensor.to_vec::<f32>().unwrap(), expected, "{size:?} {stride:?}");
            assert_eq!(decode(&encode(&value)), value);
        }
    }
}

#[test]
fn a_view_that_leaves_its_storage_is_refused() {
    let storage = floats(&[0.0; 4]);
    for (numel, offset, size, stride) in [
        (4, 0, &[5][..], &[1][..]),
        (4, 1, &[4], &[1]),
        (4, 0, &[2, 2], &[3, 1]),
        (5, 0, &[1], &[1]),
        (4, 4, &[1], &[1]),
        (4, -1, &[1], &[1]),
        (4, 3, &[2], &[-1]),
        (4, 0, &[-1], &[1]),
        (4, 0, &[2], &[1, 1]),
        (-4, 0, &[1], &[1]),
        (i64::MAX, 0, &[1], &[1]),
        (4, i64::MAX, &[2], &[1]),
        (4, 0, &[2], &[i64::MAX]),
        (4, 0, &[i64::MAX, i64::MAX, i64::MAX], &[0, 0, 0]),
        // Inside the storage, but larger than a message may be.
        (4, 0, &[1 << 40], &[0]),
        (4, 0, &[1; 65], &[1; 65]),
    ] {
        let reason = refusal(torch_wire(&pickled(numel, offset, size, stride), &storage, STORED));
        assert!(reason.starts_with("PytorchTensor at $: "), "{reason}");
    }
    let reason = refusal(torch_wire(&pickled(4, 0, &[1 << 40], &[0]), &storage, STORED));
    assert!(reason.contains("the limit is 67108864"), "{reason}");
}

#[test]
fn bombs_are_not_inflated() {
    // 100 MB of zeros in 100 kB.
    let zeros = vec![0; 100 << 20];
    let numel = i64::try_from(zeros.len() / 4).unwrap();
    let bomb = torch_wire(&pickled(numel, 0, &[numel], &[1]), &zeros, DEFLATED);
    assert!(bomb.len() < 1 << 18);
    let reason = refusal(bomb);
    assert!(reason.contains("data/0") && reason.contains("the limit is 67108864"), "{reason}");
    // Many small ones share one allowance: 32 times 4 MiB are too much for 64 MiB.
    let zeros = vec![0; 4 << 20];
    let small = torch_wire(&pickled(1 << 20, 0, &[1 << 20], &[1]), &zeros, DEFLATED);
    let small = String::from_utf8(small.to_vec()).unwrap();
    let many = format!("[{}]", vec![small.as_str(); 32].join(", "));
    let value = decode(&many.into());
    let read = value.as_items().unwrap().iter().filter(|item| item.as_tensor().is_some()).count();
    // Not 16: the pickles were deflated, too.
    assert_eq!((read, value.refusals().count()), (15, 17));
}

#[test]
fn pickles_that_do_something_are_never_run() {
    let storage = floats(&[1.0]);
    for (pickle, named) in [
        (&b"\x80\x02cposix\nsystem\nX\x02\0\0\0id\x85R."[..], "posix.system"),
        (b"\x80\x02cos\nsystem\nX\x02\0\0\0id\x85R.", "os.system"),
        (b"\x80\x02cbuiltins\neval\nX\x01\0\0\x001\x85R.", "builtins.eval"),
        (b"\x80\x04\x8c\x08builtins\x8c\x04exec\x93\x8c\x01p\x85R.", "builtins.exec"),
        (b"\x80\x02c__builtin__\ngetattr\nctorch\nFloatStorage\nX\x01\0\0\0x\x86R.", "getattr"),
        (b"\x80\x02ctorch._utils\n_rebuild_sparse_tensor\n)R.", "_rebuild_sparse_tensor"),
        (b"\x80\x02ctorch\nload\nX\x01\0\0\0x\x85R.", "torch.load"),
        (b"\x80\x02ctorch\nFloatStorage\n)R.", "torch.FloatStorage"),
        (b"(S'id'\nios\nsystem\n.", "os.system"),
    ] {
        let reason = refusal(torch_wire(pickle, &storage, STORED));
        assert!(reason.contains(named), "{named}: {reason}");
        assert!(reason.starts_with("PytorchTensor at $: "), "{reason}");
        // The same bytes in the other two formats.
        let reason = refusal(object("PaddleTensor", pickle, &["cpu"]));
        assert!(reason.starts_with("PaddleTensor at $: "), "{reason}");
        let latin1: String = pickle.iter().copied().map(char::from).collect();
        let trax = json!({"__wrapyfi__": ["TraxArray", latin1]}).to_string();
        assert!(refusal(trax).starts_with("TraxArray at $: "));
    }
}

#[test]
fn archives_that_lie_are_refused() {
    let good = pickled(1, 0, &[1], &[1]);
    let storage = floats(&[1.0]);
    for (members, complaint) in [
        (&[("m/data/0", &storage[..], STORED)][..], "no data.pkl"),
        (&[("m/data.pkl", &good, STORED)], "no storage \"0\""),
        (&[("m/data.pkl", &good, STORED), ("n/data.pkl", &good, STORED)], "more than one data.pkl"),
        (&[("m/data.pkl", &good, STORED), ("m/data/0", &[1, 2, 3], STORED)], "it has 3 bytes"),
        (
            &[
                ("m/data.pkl", &good, STORED),
                ("m/data/0", &storage, STORED),
                ("m/byteorder", b"middle", STORED),
            ],
            "neither little nor big",
        ),
        (
            &[
                ("m/data.pkl", &good, STORED),
                ("m/data/0", &storage, STORED),
                ("m/byteorder", &[b' '; 100], STORED),
            ],
            "the limit is 16",
        ),
        (&[("m/data.pkl", b"", STORED), ("m/data/0", &storage, STORED)], "ends"),
    ] {
        let reason = refusal(object("PytorchTensor", &torch_file(members), &["cpu"]));
        assert!(reason.contains(complaint), "{complaint}: {reason}");
    }
    let mut file = torch_file(&[("m/data.pkl", &good, STORED), ("m/data/0", &storage, STORED)]);
    while let Some(at) = file.windows(8).position(|part| part == b"m/data/0") {
        file[at..at + 8].copy_from_slice(b"m/../../");
    }
    let reason = refusal(object("PytorchTensor", &file, &["cpu"]));
    assert!(reason.contains("leads out of the archive"), "{reason}");
    let reason =
        refusal(object("PytorchTensor", b"\x80\x02\x8a\nl\xfc\x9cF\xf9 j\xa8P\x19.", &["cpu"]));
    assert!(reason.contains("before version 1.6"), "{reason}");
}

#[test]
fn big_endian_files_are_read() {
    let pickle = pickled(2, 0, &[2], &[1]);
    let storage: Vec<u8> = [1.5_f32, -2.0].iter().flat_map(|value| value.to_be_bytes()).collect();
    let file = torch_file(&[
        ("m/data.pkl", &pickle, STORED),
        ("m/data/0", &storage, STORED),
        ("m/byteorder", b"big", STORED),
    ]);
    let value = decode(&object("PytorchTensor", &file, &["cpu"]));
    assert_eq!(value.as_tensor().unwrap().to_vec::<f32>().unwrap(), [1.5, -2.0]);
}

#[test]
fn truncated_text_and_missing_parts_are_refused_with_their_place() {
    let whole = wire(&vector("torch", "f32")).unwrap();
    let tag: Json = serde_json::from_slice(&whole).unwrap();
    let text = tag["__wrapyfi__"][1].as_str().unwrap();
    for end in (0..text.len()).step_by(7) {
        let wire =
            json!({"a": [{"__wrapyfi__": ["PytorchTensor", text[..end], "cpu"]}]}).to_string();
        let reason = refusal(wire);
        assert!(reason.starts_with("PytorchTensor at $.a[0]: part 0"), "{reason}");
    }
    let wire = json!({"__wrapyfi__": ["PytorchTensor", text]}).to_string();
    assert!(refusal(wire).contains("part 1"), "the device is missing");
    let wire = json!({"__wrapyfi__": ["PytorchTensor", text, 3]}).to_string();
    assert!(refusal(wire).contains("part 1"), "the device is no text");
}

#[test]
fn damaged_tensors_do_no_harm() {
    let limits = Limits { message_bytes: 1 << 20, ..Limits::default() };
    for (group, name) in [
        ("torch", "parameter"),
        ("torch", "offset_view"),
        ("paddle", "f32"),
        ("stubs", "trax_jax_array"),
    ] {
        let wire = wire(&vector(group, name)).unwrap();
        for at in 0..wire.len() {
            let mut damaged = wire.to_vec();
            for damage in [wire[at] ^ 1, b'A', b'/', b'9', b'"'] {
                damaged[at] = damage;
                if let Ok(value) = codec::decode(
                    &Bytes::copy_from_slice(&damaged),
                    &limits,
                    &wrapyfi_plugins::standard(),
                ) {
                    codec::encode(&value, &wrapyfi_plugins::standard()).unwrap();
                }
            }
        }
    }
}

proptest! {
    #[test]
    fn any_view_is_read_as_its_strides_say(
        extents in prop::collection::vec((1_i64..4, 0_i64..6), 0..4),
        offset in 0_i64..10,
    ) {
        let storage: Vec<f32> = (0_u8..40).map(f32::from).collect();
        let (size, stride): (Vec<i64>, Vec<i64>) = extents.iter().copied().unzip();
        let mut expected = vec![offset];
        for (extent, stride) in &extents {
            expected = expected.iter().flat_map(|base| (0..*extent).map(move |i| base + i * stride)).collect();
        }
        let value = decode(&torch_wire(&pickled(40, offset, &size, &stride), &floats(&storage), STORED));
        if expected.iter().any(|index| *index >= 40) {
            prop_assert!(value.as_tensor().is_none());
        } else {
            let expected: Vec<f32> = expected.iter().map(|index| storage[usize::try_from(*index).unwrap()]).collect();
            prop_assert_eq!(value.as_tensor().unwrap().to_vec::<f32>().unwrap(), expected);
        }
    }
}
