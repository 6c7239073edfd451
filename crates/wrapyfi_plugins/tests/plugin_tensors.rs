//! Tensors of PyTorch, Paddle, JAX, Trax, TensorFlow, MXNet and CuPy: what Wrapyfi's own plug-ins
//! wrote (`tests/data/native`), and where they go.

use crate::tensors::{decode, encode, hex, object, refusal, vector, vectors, wire};
use proptest::prelude::*;
use serde_json::{Value as Json, json};
use wrapyfi_data::Limits;
use wrapyfi_data::codec::{json as codec, ros};
use wrapyfi_data::plugin::{DeviceMap, DeviceMaps, Framework};
use wrapyfi_data::types::{Dtype, MessageType, Origin, Payload, Tensor, Value};

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
fn written_elements_lie_so_that_they_are_seen_in_place() {
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
            let Ok(text) = codec::encode(&tensor.clone().into(), &wrapyfi_plugins::standard())
            else {
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
    let plugins = wrapyfi_plugins::standard().with_devices(DeviceMaps::default().with(map));
    let place = |key: &str, label: &str| {
        let tensor = Tensor::new(Dtype::U8, [1], vec![1]).unwrap();
        let value = Value::from(tensor.with_device(label).with_origin(Origin::new(key)));
        let received = codec::decode(&encode(&value), &Limits::default(), &plugins).unwrap();
        let from_wire = received.as_tensor().unwrap().device().to_owned();

        // In the graph, where no plug-in is asked, the same.
        let payload = Payload::from(value);
        let cdr = ros::encode(&payload, MessageType::NativeObject, &wrapyfi_plugins::standard())
            .unwrap()
            .to_bytes();
        let received =
            ros::decode(&cdr, MessageType::NativeObject, &Limits::default(), &plugins).unwrap();
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
            let payload = Payload::from(value.clone());
            let cdr =
                ros::encode(&payload, MessageType::NativeObject, &wrapyfi_plugins::standard())
                    .unwrap()
                    .to_bytes();
            let back = ros::decode(
                &cdr,
                MessageType::NativeObject,
                &Limits::default(),
                &wrapyfi_plugins::standard(),
            )
            .unwrap();
            // Device, library, requires_grad, parameter and name are part of equality.
            assert_eq!(back, payload, "{group} {}", vector["name"]);
        }
    }
    let weights = Tensor::from_elements(&[1], vec![1.0_f32])
        .unwrap()
        .with_device("cuda:3")
        .with_origin(Origin::new("PytorchTensor").with("requires_grad", "true"));
    let payload = Payload::from(Value::from(weights));
    let cdr = ros::encode(&payload, MessageType::NativeObject, &wrapyfi_plugins::standard())
        .unwrap()
        .to_bytes();
    let text = String::from_utf8_lossy(&cdr).into_owned();
    for part in [r#"["tensor", 0, {"key": "PytorchTensor", "requires_grad": "true"}]"#, "cuda:3"] {
        assert!(text.contains(part), "{part} in {text}");
    }
    assert_eq!(
        ros::decode(
            &cdr,
            MessageType::NativeObject,
            &Limits::default(),
            &wrapyfi_plugins::standard()
        )
        .unwrap(),
        payload
    );
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
}
