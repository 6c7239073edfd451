//! Tensors of PyTorch, Paddle, JAX, Trax, TensorFlow, MXNet and CuPy: what Wrapyfi's own plug-ins
//! wrote (`tests/data/native`), and what nobody should have written.

// Helpers of tests count as library code to these lints; here too a panic is the right answer.
#![allow(clippy::unwrap_used, clippy::indexing_slicing, clippy::panic)]

use std::io::{Cursor, Write as _};

use bytes::Bytes;
use proptest::prelude::*;
use serde_json::{Value as Json, json};
use wrapyfi_core::Limits;
use wrapyfi_core::codec::{json as codec, ros};
use wrapyfi_core::plugin::{DeviceMap, DeviceMaps, Framework, Plugins};
use wrapyfi_core::types::{Dtype, MessageType, Origin, Payload, Tensor, Value};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

/// A vector file of `tests/data/native`.
fn vectors(group: &str) -> Vec<Json> {
    let path = format!("{}/tests/data/native/{group}.json", env!("CARGO_MANIFEST_DIR"));
    let file: Json = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    file["vectors"].as_array().unwrap().clone()
}

fn vector(group: &str, name: &str) -> Json {
    vectors(group).into_iter().find(|vector| vector["name"] == name).unwrap()
}

fn wire(vector: &Json) -> Option<Bytes> {
    vector["wire"].as_str().map(|wire| Bytes::from(wire.to_owned()))
}

fn decode(wire: &Bytes) -> Value {
    codec::decode(wire, &Limits::default()).unwrap()
}

fn encode(value: &Value) -> Bytes {
    codec::encode(value).unwrap().into()
}

/// Why an object was refused.
fn refusal(wire: impl Into<Bytes>) -> String {
    let value = decode(&wire.into());
    let (_, reason) = value.refusals().next().unwrap_or_else(|| panic!("decoded: {value:?}"));
    reason.to_owned()
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn object(key: &str, file: &[u8], rest: &[&str]) -> Bytes {
    let mut body = vec![json!(key), json!(base64(file))];
    body.extend(rest.iter().map(|part| json!(part)));
    json!({ "__wrapyfi__": body }).to_string().into()
}

fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::new();
    for chunk in bytes.chunks(3) {
        let group = [0, 1, 2].map(|i| u32::from(chunk.get(i).copied().unwrap_or(0)));
        let group = group[0] << 16 | group[1] << 8 | group[2];
        for place in 0..4 {
            let letter = LETTERS[(group >> (18 - 6 * place) & 63) as usize];
            text.push(if place <= chunk.len() { char::from(letter) } else { '=' });
        }
    }
    text
}

// What Wrapyfi wrote ----------------------------------------------------------------------------

/// The element type in a description: that of the library where the array beside it is a stand-in.
fn described_dtype(described: &Json) -> Dtype {
    let named =
        |key: &str| described[key].as_str().map(|name| name.rsplit('.').next().unwrap().to_owned());
    let name = ["torch_dtype", "paddle_dtype", "tf_dtype"].iter().find_map(|key| named(key));
    let name =
        name.unwrap_or_else(|| described["array"]["dtype_name"].as_str().unwrap().to_owned());
    Dtype::from_name(&name).unwrap_or_else(|| panic!("{name}"))
}

fn check(name: &str, tensor: &Tensor, described: &Json) {
    let array = &described["array"];
    assert_eq!(tensor.dtype(), described_dtype(described), "{name}");
    let shape: Vec<usize> = serde_json::from_value(array["shape"].clone()).unwrap();
    assert_eq!(tensor.shape(), shape, "{name}");
    let mut bytes = tensor.data().to_vec();
    if tensor.dtype() == Dtype::BF16 && array["dtype"] == "<f4" {
        bytes = bytes.chunks(2).flat_map(|half| [0, 0, half[0], half[1]]).collect();
    }
    assert_eq!(json!(hex(&bytes)), array["row_major_bytes_hex"], "{name}");
    let device = match described["type"].as_str().unwrap() {
        "torch.Tensor" | "cupy.ndarray" => described["device"].as_str().unwrap().to_owned(),
        "paddle.Tensor" => "cpu".to_owned(),
        "mxnet.nd.NDArray" => "cpu:0".to_owned(),
        _ => String::new(),
    };
    assert_eq!(tensor.device(), device, "{name}");
    if let Some(learns) = described["requires_grad"].as_bool() {
        let attribute = tensor.origin().unwrap().get("requires_grad");
        assert_eq!(attribute == Some("true"), learns, "{name}");
    }
}

#[test]
fn every_tensor_decodes_as_described_and_returns() {
    let mut checked = 0;
    for group in ["torch", "paddle", "stubs", "tensorflow", "jax", "mxnet"] {
        for vector in vectors(group) {
            let name = format!("{group} {}", vector["name"]);
            let Some(wire) = wire(&vector) else { continue };
            let value = decode(&wire);
            if vector["name"] == "string" {
                let (_, reason) = value.refusals().next().unwrap();
                assert!(
                    reason.contains("TensorflowTensor") && reason.contains("pickle"),
                    "{reason}"
                );
                assert_eq!(encode(&value), wire, "carried as it came");
                checked += 1;
                continue;
            }
            let tensor = value.as_tensor().unwrap_or_else(|| panic!("{name}: {value:?}"));
            let tag: Json = serde_json::from_slice(&wire).unwrap();
            assert_eq!(json!(tensor.framework()), tag["__wrapyfi__"][0], "{name}");
            // The original, not what Wrapyfi makes of it: it turns every MXNet tensor into float32.
            check(&name, tensor, &vector["original"]);

            let again = decode(&encode(&value));
            let again = again.as_tensor().unwrap();
            if tensor.dtype() == Dtype::BF16 && group == "jax" {
                // What JAX cannot read back from itself is sent as float32.
                assert_eq!((again.dtype(), again.shape()), (Dtype::F32, tensor.shape()));
            } else {
                assert_eq!(again, tensor, "{name}");
            }
            checked += 1;
        }
    }
    assert!(checked >= 30, "{checked} vectors checked");
}

#[test]
fn parameters_stay_parameters() {
    let value = decode(&wire(&vector("torch", "parameter")).unwrap());
    let origin = value.as_tensor().unwrap().origin().unwrap();
    assert_eq!(
        (origin.get("parameter"), origin.get("requires_grad")),
        (Some("true"), Some("true"))
    );
    let value = decode(&wire(&vector("torch", "requires_grad")).unwrap());
    let origin = value.as_tensor().unwrap().origin().unwrap();
    assert_eq!((origin.get("parameter"), origin.get("requires_grad")), (None, Some("true")));
    assert_eq!(decode(&encode(&value)), value);
}

#[test]
fn stored_elements_are_shared_with_the_decoded_file() {
    // 64 KiB: if they were copied, the copy would lie elsewhere than its neighbour.
    let tensor = Tensor::new(Dtype::F32, [128, 128], vec![7; 1 << 16]).unwrap();
    let value = Value::from(tensor.with_origin(Origin::new("PytorchTensor")));
    let received = decode(&encode(&value));
    let view = received.as_tensor().unwrap().view::<f32>();
    assert_eq!(view.map(|view| view.len()), Some(128 * 128), "aligned, so seen in place");
}

#[test]
fn every_element_type_goes_there_and_back() {
    for key in [
        "PytorchTensor",
        "PaddleTensor",
        "TraxArray",
        "JAXTensor",
        "TensorflowTensor",
        "MXNetTensor",
        "CuPyArray",
    ] {
        for dtype in Dtype::ALL {
            let data: Vec<u8> =
                (0..6 * dtype.size()).map(|byte| u8::try_from(byte % 2).unwrap()).collect();
            let tensor = Tensor::new(dtype, [2, 3], data).unwrap().with_origin(Origin::new(key));
            let Ok(text) = codec::encode(&tensor.clone().into()) else {
                assert!(key == "PaddleTensor" && dtype.name().starts_with("uint"), "{key} {dtype}");
                continue;
            };
            let received = decode(&text.into());
            let received =
                received.as_tensor().unwrap_or_else(|| panic!("{key} {dtype}: {received:?}"));
            let as_float = dtype == Dtype::BF16
                && !["PytorchTensor", "PaddleTensor", "TraxArray"].contains(&key);
            if as_float {
                assert_eq!(received.dtype(), Dtype::F32, "{key}");
            } else {
                assert_eq!((received.dtype(), received.data()), (dtype, tensor.data()), "{key}");
            }
        }
    }
}

// Devices ---------------------------------------------------------------------------------------

#[test]
fn labels_are_spelled_as_on_each_wire() {
    for (key, label, spelled) in [
        ("PytorchTensor", "gpu:1", "cuda:1"),
        ("PytorchTensor", "", "cpu"),
        ("MXNetTensor", "gpu:1", "cuda:1"),
        ("MXNetTensor", "", "cpu:0"),
        ("PaddleTensor", "cuda:1", "gpu:1"),
        ("PaddleTensor", "", "cpu"),
        ("CuPyArray", "", "cuda:0"),
    ] {
        let tensor = Tensor::new(Dtype::U8, [1], vec![1]).unwrap();
        let value = Value::from(tensor.with_device(label).with_origin(Origin::new(key)));
        assert_eq!(decode(&encode(&value)).as_tensor().unwrap().device(), spelled, "{key} {label}");
    }
}

#[test]
fn maps_say_where_received_tensors_go() {
    let map = DeviceMap::new(Framework::Torch, Some("cuda:1"), [("cuda:0", "cpu")]).unwrap();
    let plugins = Plugins::standard().with_devices(DeviceMaps::default().with(map));
    let place = |key: &str, label: &str| {
        let tensor = Tensor::new(Dtype::U8, [1], vec![1]).unwrap();
        let value = Value::from(tensor.with_device(label).with_origin(Origin::new(key)));
        let received = codec::decode_with(&encode(&value), &Limits::default(), &plugins).unwrap();
        let from_wire = received.as_tensor().unwrap().device().to_owned();

        // In the graph, where no plug-in is asked, the same.
        let payload = Payload::NativeObject(Box::new(value));
        let cdr = ros::encode(&payload, MessageType::NativeObject).unwrap().to_bytes();
        let received =
            ros::decode_with(&cdr, MessageType::NativeObject, &Limits::default(), &plugins)
                .unwrap();
        let Payload::NativeObject(received) = received else { panic!("{received:?}") };
        assert_eq!(received.as_tensor().unwrap().device(), from_wire);
        from_wire
    };
    assert_eq!(place("PytorchTensor", "cuda:0"), "cpu");
    assert_eq!(place("PytorchTensor", "cpu"), "cuda:1");
    assert_eq!(place("PaddleTensor", "gpu:0"), "gpu:0", "another library");
    assert_eq!(place("JAXTensor", ""), "");
}

#[test]
fn the_graph_keeps_what_belongs_to_a_tensor() {
    for group in ["torch", "paddle", "stubs", "tensorflow", "jax", "mxnet"] {
        for vector in vectors(group) {
            let Some(wire) = wire(&vector) else { continue };
            let value = decode(&wire);
            if value.as_tensor().is_none() {
                continue;
            }
            let payload = Payload::NativeObject(Box::new(value.clone()));
            let cdr = ros::encode(&payload, MessageType::NativeObject).unwrap().to_bytes();
            let back = ros::decode(&cdr, MessageType::NativeObject, &Limits::default()).unwrap();
            // Device, library, requires_grad, parameter and name are part of equality.
            assert_eq!(back, payload, "{group} {}", vector["name"]);
        }
    }
    let weights = Tensor::from_elements(&[1], vec![1.0_f32])
        .unwrap()
        .with_device("cuda:3")
        .with_origin(Origin::new("PytorchTensor").with("requires_grad", "true"));
    let payload = Payload::NativeObject(Box::new(weights.into()));
    let cdr = ros::encode(&payload, MessageType::NativeObject).unwrap().to_bytes();
    let text = String::from_utf8_lossy(&cdr).into_owned();
    for part in [r#"["tensor", 0, {"key": "PytorchTensor", "requires_grad": "true"}]"#, "cuda:3"] {
        assert!(text.contains(part), "{part} in {text}");
    }
    assert_eq!(ros::decode(&cdr, MessageType::NativeObject, &Limits::default()).unwrap(), payload);
}

// What nobody should have written ---------------------------------------------------------------

/// A torch file with these members, made by another zip writer.
fn torch_file(members: &[(&str, &[u8], CompressionMethod)]) -> Vec<u8> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, content, method) in members {
        zip.start_file(*name, SimpleFileOptions::default().compression_method(*method)).unwrap();
        zip.write_all(content).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

/// `data.pkl` of a float tensor over storage 0 of `numel` elements; numbers as Python's LONG1.
fn pickled(numel: i64, offset: i64, size: &[i64], stride: &[i64]) -> Vec<u8> {
    fn int(out: &mut Vec<u8>, value: i64) {
        out.extend(b"\x8a\x08");
        out.extend(value.to_le_bytes());
    }
    fn tuple(out: &mut Vec<u8>, values: &[i64]) {
        out.push(b'(');
        values.iter().for_each(|value| int(out, *value));
        out.push(b't');
    }
    let mut out = b"\x80\x02ctorch._utils\n_rebuild_tensor_v2\n((X\x07\0\0\0storagectorch\nFloatStorage\nX\x01\0\0\x000X\x03\0\0\0cpu".to_vec();
    int(&mut out, numel);
    out.extend(b"tQ");
    int(&mut out, offset);
    tuple(&mut out, size);
    tuple(&mut out, stride);
    out.extend(b"\x89ccollections\nOrderedDict\n)RtR.");
    out
}

const STORED: CompressionMethod = CompressionMethod::Stored;
const DEFLATED: CompressionMethod = CompressionMethod::Deflated;

fn torch_wire(pickle: &[u8], storage: &[u8], method: CompressionMethod) -> Bytes {
    let file = torch_file(&[("m/data.pkl", pickle, method), ("m/data/0", storage, method)]);
    object("PytorchTensor", &file, &["cpu"])
}

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

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
                if let Ok(value) = codec::decode(&Bytes::copy_from_slice(&damaged), &limits) {
                    codec::encode(&value).unwrap();
                }
            }
        }
    }
}

#[test]
fn void_elements_are_bfloat16_for_jax_and_nothing_for_others() {
    let file = |descr: &str| {
        let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': (1,), }}");
        let mut file = b"\x93NUMPY\x01\0".to_vec();
        file.extend(u16::try_from(header.len()).unwrap().to_le_bytes());
        file.extend(header.as_bytes());
        file.extend([0x80, 0x3f]);
        file
    };
    for descr in ["<V2", "|V2", "V2"] {
        for key in ["JAXTensor", "TensorflowTensor"] {
            let value = decode(&object(key, &file(descr), &[]));
            assert_eq!(
                value.as_tensor().unwrap().to_vec::<half::bf16>().unwrap(),
                [half::bf16::ONE]
            );
        }
        assert!(refusal(object("MXNetTensor", &file(descr), &["cpu:0"])).contains("not supported"));
    }
    assert!(refusal(object("JAXTensor", &file("|V1"), &[])).contains("not supported"));
}

proptest! {
    #[test]
    fn any_tensor_returns_from_torch(
        dtype in prop::sample::select(Dtype::ALL.to_vec()),
        shape in prop::collection::vec(0_usize..4, 0..5),
        seed: u8,
        device in "cpu|cuda:[0-9]|",
        learns: bool,
        parameter: bool,
    ) {
        let bytes = shape.iter().product::<usize>() * dtype.size();
        let mut data: Vec<u8> = (0..bytes).map(|i| seed.wrapping_mul(31).wrapping_add(i.to_le_bytes()[0])).collect();
        if dtype == Dtype::Bool {
            data.iter_mut().for_each(|byte| *byte &= 1);
        }
        let flags = [("requires_grad", learns), ("parameter", parameter)];
        let origin = flags.iter().filter(|flag| flag.1).fold(
            Origin::new("PytorchTensor"), |origin, (name, _)| origin.with(*name, "true"));
        let tensor = Tensor::new(dtype, shape, data).unwrap().with_device(device).with_origin(origin);
        let received = decode(&encode(&tensor.clone().into()));
        let expected = if tensor.device().is_empty() { tensor.with_device("cpu") } else { tensor };
        prop_assert_eq!(received, Value::from(expected));
    }

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
