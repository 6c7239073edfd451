//! Pickles that Python, NumPy, pandas, pyarrow, torch, paddle and JAX wrote, read as data.
//!
//! `tests/data/native` has what Wrapyfi sent, `tests/data/pickle` what Python writes in each
//! protocol.

use bytes::Bytes;
use serde_json::Value as Json;
use wrapyfi_data::Limits;
use wrapyfi_data::codec::json;
use wrapyfi_data::types::{Dtype, Map, Tensor, Value};
use wrapyfi_plugins::pickle::{self, Allowed, Pickle, PickledArray, View};

fn vectors(path: &str) -> Vec<Json> {
    let path = format!("{}/tests/data/{path}.json", env!("CARGO_MANIFEST_DIR"));
    // NaN as a member of a description is legal to Python, which wrote the file.
    let text = std::fs::read_to_string(path).unwrap().replace("\": NaN", "\": null");
    let file: Json = serde_json::from_str(&text).unwrap();
    file["vectors"].as_array().unwrap().clone()
}

/// Base64 as bytes, through the array codec that has it.
fn base64(text: &str) -> Bytes {
    let digit = |byte: u8| match byte {
        b'A'..=b'Z' => byte - b'A',
        b'a'..=b'z' => byte - b'a' + 26,
        b'0'..=b'9' => byte - b'0' + 52,
        b'+' => 62,
        b'/' => 63,
        other => panic!("{other}"),
    };
    let mut bytes = Vec::new();
    for chunk in text.trim_end_matches('=').as_bytes().chunks(4) {
        let bits = chunk.iter().fold(0_u32, |bits, &byte| bits << 6 | u32::from(digit(byte)));
        let bits = bits << (6 * (4 - chunk.len()));
        bytes.extend(&bits.to_be_bytes()[1..chunk.len()]);
    }
    bytes.into()
}

/// The pickle in a vector of `tests/data/native`, and the buffers beside it.
fn recorded(vector: &Json) -> Option<(Bytes, Vec<Bytes>)> {
    let object: Json = serde_json::from_str(vector["wire"].as_str()?).ok()?;
    let tagged = object["__wrapyfi__"].as_array()?.clone();
    let text = |index: usize| tagged.get(index).and_then(Json::as_str).unwrap();
    match text(0) {
        "PandasData" | "PyArrowArray" | "TraxArray" => {
            let data: Vec<u8> = text(1).chars().map(|c| u8::try_from(c).unwrap()).collect();
            Some((data.into(), (2..tagged.len()).map(|index| base64(text(index))).collect()))
        }
        "PaddleTensor" => Some((base64(text(1)), Vec::new())),
        // `data.pkl` is the first member of the archive, and not compressed.
        "PytorchTensor" => {
            let archive = base64(text(1));
            let length = |at| usize::from(u16::from_le_bytes([archive[at], archive[at + 1]]));
            assert!(archive[30..].starts_with(b"archive/data.pkl"));
            Some((archive.slice(30 + length(26) + length(28)..), Vec::new()))
        }
        _ => None,
    }
}

fn read(vector: &Json, allowed: &Allowed) -> Option<Pickle> {
    let (data, buffers) = recorded(vector)?;
    let read = pickle::read(&data, &buffers, allowed, &Limits::default());
    Some(read.unwrap_or_else(|error| panic!("{}: {error}", vector["name"])))
}

#[test]
fn what_wrapyfi_sent_is_read_under_its_list() {
    for (group, allowed, count) in [
        ("pandas", Allowed::PANDAS, 8),
        ("pandas3", Allowed::PANDAS, 8),
        ("pyarrow", Allowed::PYARROW, 5),
        ("torch", Allowed::TORCH, 18),
        ("paddle", Allowed::PADDLE, 3),
        ("stubs", Allowed::JAX, 1),
    ] {
        let all = vectors(&format!("native/{group}"));
        let read: Vec<Pickle> = all.iter().filter_map(|vector| read(vector, &allowed)).collect();
        assert_eq!(read.len(), count, "{group}");
    }
}

#[test]
fn lists_are_no_wider_than_the_plug_in() {
    for (group, allowed, refused) in [
        ("pandas", Allowed::PYARROW, "pandas.core."),
        ("pandas3", Allowed::NUMPY, "pandas."),
        ("torch", Allowed::PANDAS, "torch._utils."),
        ("pyarrow", Allowed::NUMPY, "pyarrow.lib."),
        ("stubs", Allowed::PADDLE, "jax._src.array._reconstruct_array"),
    ] {
        for vector in vectors(&format!("native/{group}")) {
            let Some((data, buffers)) = recorded(&vector) else { continue };
            let error = pickle::read(&data, &buffers, &allowed, &Limits::default()).unwrap_err();
            let message = error.to_string();
            assert!(message.contains(refused) && message.contains("not on the list"), "{message}");
        }
    }
}

fn named(group: &str, name: &str, allowed: &Allowed) -> Pickle {
    let all = vectors(&format!("native/{group}"));
    read(all.iter().find(|vector| vector["name"] == name).unwrap(), allowed).unwrap()
}

#[test]
fn a_walk_through_a_frame() {
    for group in ["pandas", "pandas3"] {
        let pickle = named(group, "frame_numeric", &Allowed::PANDAS);
        let frame = pickle.root().call_of(&["pandas.core.frame.DataFrame", "pandas.DataFrame"]);
        let state = frame.unwrap().state().unwrap().dict().unwrap();
        let manager = state.get("_mgr").unwrap();
        let manager = manager.call("pandas.core.internals.managers.BlockManager").unwrap();
        let [blocks, axes] = manager.args().exact().unwrap();
        let mut columns = Vec::new();
        for block in blocks.tuple().unwrap().iter() {
            let block = block.call("pandas._libs.internals._unpickle_block").unwrap();
            let [values, places, dimensions] = block.args().exact().unwrap();
            let PickledArray::Tensor(values) = values.array().unwrap() else { panic!("numbers") };
            let place = places.slice().unwrap().unwrap().collect::<Vec<_>>();
            assert_eq!((dimensions.int().unwrap(), values.shape()), (2, &[1, 2][..]));
            columns.push((place, values));
        }
        let (ints, floats) = (vec![1_i64, 2], vec![1.5_f64, 2.5]);
        let tensors = [
            (vec![0], Tensor::from_elements(&[1, 2], ints).unwrap()),
            (vec![1], Tensor::from_elements(&[1, 2], floats).unwrap()),
        ];
        assert_eq!(columns, tensors);
        assert_eq!(axes.list().unwrap().len(), 2);
        let error = state.get("_mgr").unwrap().call("pandas.Series").unwrap_err().to_string();
        let wanted = "$.state._mgr should be an object of pandas.Series, it is an object of \
                      pandas.core.internals.managers.BlockManager";
        assert!(error.starts_with(wanted), "{error}");
    }
}

#[test]
fn a_walk_through_tensors() {
    let pickle = named("torch", "offset_view", &Allowed::TORCH);
    let tensor = pickle.root().call("torch._utils._rebuild_tensor_v2").unwrap();
    let [storage, offset, shape, stride, ..] = tensor.args().exact::<6>().unwrap();
    let [kind, class, key, device, count] =
        storage.persistent().unwrap().tuple().unwrap().exact().unwrap();
    assert_eq!(kind.str().unwrap(), "storage");
    assert!(class.is_global("torch.IntStorage"));
    assert_eq!((key.str().unwrap(), device.str().unwrap()), ("0", "cpu"));
    assert_eq!((count.size().unwrap(), offset.size().unwrap()), (10, 2));
    let sizes = |node: pickle::Node<'_>| {
        node.tuple().unwrap().iter().map(|size| size.size().unwrap()).collect::<Vec<_>>()
    };
    assert_eq!((sizes(shape), sizes(stride)), (vec![3], vec![2]));

    let pickle = named("paddle", "f32", &Allowed::PADDLE);
    let [name, array] = pickle.root().tuple().unwrap().exact().unwrap();
    assert_eq!(name.str().unwrap(), "generated_tensor_0");
    let PickledArray::Tensor(tensor) = array.array().unwrap() else { panic!("numbers") };
    assert_eq!((tensor.dtype(), tensor.shape()), (Dtype::F32, &[2, 3][..]));

    let pickle = named("stubs", "trax_jax_array", &Allowed::JAX);
    let jax = pickle.root().call("jax._src.array._reconstruct_array").unwrap();
    let [function, _, state, _] = jax.args().exact().unwrap();
    assert!(function.is_global("numpy.core.multiarray._reconstruct"));
    let PickledArray::Tensor(tensor) = state.array_state().unwrap() else { panic!("numbers") };
    assert_eq!(tensor.to_vec::<f32>().unwrap(), [0.0, 1.0, 2.0]);
}

#[test]
fn buffers_are_shared() {
    let vector = &vectors("native/pandas")[0];
    let (data, buffers) = recorded(vector).unwrap();
    let pickle = pickle::read(&data, &buffers, &Allowed::PANDAS, &Limits::default()).unwrap();
    let series = pickle.root().call("pandas.core.series.Series").unwrap().state().unwrap();
    let manager = series.dict().unwrap().get("_mgr").unwrap().any_call().unwrap();
    // Older manager: state (axes, blocks, …, {"0.14.1": {"axes": …, "blocks": …}}).
    let state = manager.state().unwrap().tuple().unwrap();
    let newest = state.get(3).unwrap().dict().unwrap().get("0.14.1").unwrap();
    let blocks = newest.dict().unwrap().get("blocks").unwrap().list().unwrap();
    let values = blocks.get(0).unwrap().dict().unwrap().get("values").unwrap();
    let PickledArray::Tensor(tensor) = values.array().unwrap() else { panic!("numbers") };
    assert_eq!(tensor.data().as_ptr(), buffers[0].as_ptr());
}

#[test]
fn every_protocol_means_the_same() {
    let limits = Limits::default();
    let all = vectors("pickle/protocols");
    assert!(all.len() > 100);
    for vector in all {
        let name = vector["name"].as_str().unwrap();
        let data = base64(vector["pickle"].as_str().unwrap());
        let buffers = vector["buffers"].as_array().unwrap();
        let buffers: Vec<Bytes> = buffers.iter().map(|b| base64(b.as_str().unwrap())).collect();
        let native = Bytes::from(vector["native"].as_str().unwrap().to_owned());
        // Through the decoder, which tells tuples from lists and `nan` from text.
        let wanted = json::encode(
            &json::decode(&native, &limits, &wrapyfi_plugins::standard()).unwrap(),
            &wrapyfi_plugins::standard(),
        )
        .unwrap();
        let read = pickle::read(&data, &buffers, &Allowed::NUMPY, &limits);
        let read = read.unwrap_or_else(|error| panic!("{name}: {error}"));
        let text = |json: Vec<u8>| String::from_utf8(json).unwrap();
        assert_eq!(
            text(json::encode(&value(read.root()), &wrapyfi_plugins::standard()).unwrap()),
            text(wanted),
            "{name}"
        );
    }
}

/// Plain data as a native object.
fn value(node: pickle::Node<'_>) -> Value {
    let items = |items: pickle::Items<'_>| items.iter().map(value).collect::<Vec<_>>();
    let map = |pairs: pickle::Pairs<'_>| {
        Value::Map(pairs.iter().map(|(key, member)| (value(key), value(member))).collect::<Map>())
    };
    match node.view() {
        View::None => Value::Null,
        View::Bool(value) => value.into(),
        View::Int(value) => value.into(),
        View::BigInt(value) => value.clone().into(),
        View::Float(value) => value.into(),
        View::Str(text) => text.into(),
        View::Utf16(units) => Value::Utf16(units.to_vec()),
        View::Bytes(_) | View::ByteArray(_) | View::Buffer(_) => {
            Value::Bytes(node.bytes().unwrap())
        }
        View::List(list) => Value::List(items(list)),
        View::Tuple(tuple) => Value::Tuple(items(tuple)),
        View::Set(set) | View::FrozenSet(set) => Value::Set(items(set)),
        View::Dict(pairs) => map(pairs),
        View::Call(call) if call.global().is("collections.OrderedDict") => map(call.pairs()),
        View::Call(call) if call.global().is("datetime.datetime") => {
            Value::DateTime(node.datetime().unwrap())
        }
        _ => match node.array().unwrap() {
            PickledArray::Tensor(tensor) => tensor.into(),
            PickledArray::Array(array) => array.into(),
            _ => panic!("objects"),
        },
    }
}
