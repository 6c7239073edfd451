//! zarr's arrays and groups.

use std::io::Write as _;

use bytes::Bytes;
use proptest::prelude::*;
use serde_json::{Value as Json, json};
use wrapyfi_data::Limits;
use wrapyfi_data::codec::json as codec;
use wrapyfi_data::types::{Dtype, ForeignObject, Origin, Tensor, Value};
use wrapyfi_plugins::ZarrGroup;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use super::{assert_refused, base64, decode, encode, hex, named, refusal, vectors, wire};

/// Arrays in every layout that zarr itself writes, elements `(i * i) mod 251`.
fn layouts() -> Vec<Json> {
    let path = format!("{}/tests/data/zarr/zarr.json", env!("CARGO_MANIFEST_DIR"));
    let file: Json = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    file["vectors"].as_array().unwrap().clone()
}

fn layout(name: &str) -> Value {
    let vector = layouts().into_iter().find(|vector| vector["name"] == name).unwrap();
    decode(&wire(&vector))
}

/// The elements as floats, the real part of complex ones.
fn numbers(tensor: &Tensor) -> Vec<f64> {
    let size = tensor.dtype().size();
    let number = |element: &[u8]| match tensor.dtype() {
        Dtype::Bool | Dtype::U8 => f64::from(element[0]),
        Dtype::U16 => f64::from(u16::from_le_bytes(element.try_into().unwrap())),
        Dtype::I16 => f64::from(i16::from_le_bytes(element.try_into().unwrap())),
        Dtype::I32 => f64::from(i32::from_le_bytes(element.try_into().unwrap())),
        Dtype::I64 => i64::from_le_bytes(element.try_into().unwrap()) as f64,
        Dtype::F16 => f64::from(half::f16::from_le_bytes(element.try_into().unwrap())),
        Dtype::F32 => f64::from(f32::from_le_bytes(element.try_into().unwrap())),
        _ => f64::from_le_bytes(element[..8].try_into().unwrap()),
    };
    tensor.data().chunks(size).map(number).collect()
}

#[test]
fn what_wrapyfi_sends_is_read() {
    let value = decode(&wire(&named("zarr", "array")));
    let tensor = value.as_tensor().unwrap();
    let original = &named("zarr", "array")["original"]["array"];
    assert_eq!(hex(tensor.data()), original["row_major_bytes_hex"].as_str().unwrap());
    assert_eq!(tensor.shape(), [2, 3]);
    assert_eq!(tensor.origin(), Some(&Origin::new("ZarrData")));
    // Of a group Wrapyfi sends the names of its arrays.
    let value = decode(&wire(&named("zarr", "group")));
    let group = value.as_object::<ZarrGroup>().unwrap();
    let [(name, Value::Array(names))] = &*group.arrays else { panic!("{group:?}") };
    assert_eq!((&**name, &*names.descr, &names.data[..]), ("arr_0", "'<U1'", &b"a\0\0\0"[..]));
    assert_eq!(vectors("zarr").len(), 2);
    assert!(vectors("zarr3").is_empty(), "zarr 3 is not sent at all");
}

#[test]
fn every_layout_is_read_and_comes_back() {
    let mut checked = 0;
    for vector in layouts() {
        let name = vector["name"].as_str().unwrap();
        if let Some(wanted) = vector["refused"].as_str() {
            let object: Json = serde_json::from_slice(&wire(&vector)).unwrap();
            let reason = refusal(&object["__wrapyfi__"]);
            assert!(reason.contains(wanted), "{name}: {reason}");
            continue;
        }
        if name == "group" || vector["fill"] != Json::Null {
            continue;
        }
        let value = decode(&wire(&vector));
        let tensor =
            value.as_tensor().unwrap_or_else(|| panic!("{name}: {:?}", value.refusals().next()));
        assert_eq!(json!(tensor.shape()), vector["shape"], "{name}");
        assert_eq!(json!(tensor.dtype().npy_descr()), vector["dtype"], "{name}");
        let is_flag = tensor.dtype() == Dtype::Bool;
        let expected: Vec<f64> = (0..tensor.element_count() as u64)
            .map(|i| (i * i) % 251)
            .map(|i| if is_flag { f64::from(u8::from(i != 0)) } else { i as f64 })
            .collect();
        assert_eq!(numbers(tensor), expected, "{name}");
        assert_eq!(tensor.origin().and_then(|origin| origin.get("name")), Some(name));
        assert_eq!(decode(&encode(&value)), value, "{name}");
        checked += 1;
    }
    assert!(checked >= 60, "{checked} layouts checked");
}

#[test]
fn missing_chunks_hold_the_fill_value() {
    let value = layout("missing_chunks");
    let found = numbers(value.as_tensor().unwrap());
    for (index, x) in found.iter().enumerate() {
        let stored = index / 4 < 2 && index % 4 < 2;
        assert!(if stored { *x == 1.5 } else { x.is_nan() }, "{index}: {x}");
    }
    let value = layout("fill_and_attributes");
    let tensor = value.as_tensor().unwrap();
    assert_eq!(tensor.to_vec::<i32>().unwrap(), [9, 9, -7, -7, -7]);
    let attributes = tensor.origin().unwrap().get("attrs").unwrap();
    assert_eq!(serde_json::from_str::<Json>(attributes).unwrap(), json!({"unit": "K"}));
    assert_eq!(decode(&encode(&value)), value);
}

#[test]
fn groups_keep_everything() {
    let value = layout("group");
    let group = value.as_object::<ZarrGroup>().unwrap();
    let made: Json = serde_json::from_str(group.attributes.as_deref().unwrap()).unwrap();
    assert_eq!(made, json!({"made": "here"}));
    let [(speed, Value::Tensor(array))] = &*group.arrays else { panic!("{group:?}") };
    assert_eq!((&**speed, array.shape()), ("speed", &[10][..]));
    let [(_, inner)] = &*group.groups else { panic!("{group:?}") };
    let [(text, Value::Array(array))] = &*inner.arrays else { panic!("{inner:?}") };
    assert_eq!((&**text, &*array.descr), ("text", "'<U2'"));
    assert_eq!(inner.groups, [("empty".to_owned(), ZarrGroup::default())]);
    assert_eq!(decode(&encode(&value)), value);
}

#[test]
fn members_that_lead_elsewhere_are_not_written() {
    for name in ["..", ".zarray", "a/b", "", "C:x", "a\\b"] {
        let tensor = Tensor::from_elements(&[1], vec![0_u8]).unwrap();
        let arrays = vec![(name.to_owned(), tensor.into())];
        let group = ZarrGroup { arrays, ..ZarrGroup::default() };
        let error = codec::encode(&ForeignObject::new(group).into(), &wrapyfi_plugins::standard())
            .unwrap_err()
            .to_string();
        assert!(error.contains("a member"), "{name:?}: {error}");
    }
}

/// `.zarray` of two int32, without a compressor.
fn metadata() -> Json {
    json!({
        "zarr_format": 2, "shape": [2], "chunks": [2], "dtype": "<i4", "order": "C",
        "compressor": null, "filters": null, "fill_value": 0,
    })
}

fn with(changes: &[(&str, Json)]) -> Json {
    let mut metadata = metadata();
    for (name, value) in changes {
        metadata[*name] = value.clone();
    }
    metadata
}

fn zip(members: &[(&str, &[u8])], method: CompressionMethod) -> Vec<u8> {
    let mut zip = ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for (name, content) in members {
        let options = SimpleFileOptions::default().compression_method(method);
        zip.start_file(*name, options).unwrap();
        zip.write_all(content).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

fn folder(metadata: &Json, chunks: &[(&str, &[u8])]) -> Json {
    let text = metadata.to_string();
    let mut members = vec![(".zarray", text.as_bytes())];
    members.extend(chunks);
    object(&zip(&members, CompressionMethod::Stored))
}

fn object(zip: &[u8]) -> Json {
    json!(["ZarrData", base64(zip), "Array", null])
}

#[test]
fn hostile_metadata_is_refused() {
    let bad = |name: &str, value: Json| folder(&with(&[(name, value)]), &[]);
    let huge = json!([4_294_967_296_u64, 4_294_967_296_u64]);
    let squares = json!([2, 2]);
    assert_refused(&[
        (bad("zarr_format", json!(3)), "$.zarr_format is not 2"),
        (bad("shape", json!([-1])), "$.shape is no list"),
        (bad("shape", json!("2")), "$.shape is no list"),
        (bad("shape", json!([1.5])), "$.shape is no list"),
        (bad("shape", json!([2, 2])), "differ in dimensions"),
        (bad("shape", json!(vec![1; 65])), "at most 64"),
        (bad("chunks", json!([0])), "are empty"),
        (bad("shape", json!([1_099_511_627_776_u64])), "is 4398046511104, the limit is 67108864"),
        (folder(&with(&[("shape", huge), ("chunks", squares.clone())]), &[]), "larger than memory"),
        (bad("chunks", json!([1_099_511_627_776_u64])), "a chunk [1099511627776]"),
        (bad("dtype", json!("|O")), "pickle"),
        (bad("dtype", json!("<i3")), "not known"),
        (bad("dtype", json!("<i4', 'x")), "not known"),
        (bad("dtype", json!("|S0")), "0 bytes"),
        (bad("dtype", json!([["a", "<i4"]])), "a structured zarr array"),
        (bad("dtype", json!("<U1")), "no numbers"),
        (bad("order", json!("K")), "neither C nor F"),
        (bad("dimension_separator", json!("-")), "neither . nor /"),
        (bad("compressor", json!({})), "no id"),
        (bad("compressor", json!({"id": "lzma"})), "compressor \"lzma\""),
        (bad("filters", json!([{"id": "delta"}])), "filters"),
        (bad("fill_value", json!(1.5)), "fill_value is no <i4"),
        (bad("fill_value", json!(2_147_483_648_u64)), "fill_value is no <i4"),
        (bad("fill_value", json!({"a": 1})), "fill_value is no <i4"),
        (object(&zip(&[(".zarray", &b"{"[..])], CompressionMethod::Stored)), "malformed JSON"),
        (
            object(&zip(&[(".zarray", &[b' '; 70_000][..])], CompressionMethod::Stored)),
            "the limit is 65536",
        ),
        (object(&zip(&[], CompressionMethod::Stored)), "the zip lacks .zarray"),
        (object(&zip(&[("zarr.json", &b"{}"[..])], CompressionMethod::Stored)), "zarr format 3"),
    ]);
}

#[test]
fn hostile_chunks_are_refused() {
    let chunk = |name: &str, content: &[u8]| folder(&metadata(), &[(name, content)]);
    let packed = |id: &str, content: &[u8]| {
        folder(&with(&[("compressor", json!({"id": id}))]), &[("0", content)])
    };
    assert_refused(&[
        (chunk("0", &[1; 7]), "it holds 7 bytes, its chunk is 8"),
        (chunk("0", &[1; 9]), "it holds 9 bytes, its chunk is 8"),
        (chunk("1", &[1; 8]), "no chunk of shape [2]"),
        (chunk("00", &[1; 8]), "no chunk of shape [2]"),
        (chunk("+0", &[1; 8]), "no chunk of shape [2]"),
        (chunk("0.0", &[1; 8]), "no chunk of shape [2]"),
        (chunk("x", &[1; 8]), "no chunk of shape [2]"),
        (chunk("18446744073709551615", &[1; 8]), "no chunk of shape [2]"),
        (packed("zlib", &[0; 8]), "zip member \"0\""),
        (packed("gzip", &[0; 8]), "zip member \"0\""),
        (packed("zstd", &[0; 8]), "zip member \"0\""),
        (packed("lz4", &[8, 0, 0, 0, 255]), "zip member \"0\""),
        (packed("lz4", &[255, 255, 255, 255, 0]), "it holds 4294967295 bytes"),
        (packed("lz4", &[1]), "cut off"),
        (packed("blosc", &[2, 1]), "a Blosc header is 16 bytes, 2 are there"),
    ]);
}

#[test]
fn hostile_archives_are_refused() {
    let whole = zip(&[(".zarray", metadata().to_string().as_bytes())], CompressionMethod::Stored);
    assert_refused(&[
        (json!(["ZarrData"]), "the object has 0 parts"),
        (json!(["ZarrData", "UEs", "Array", null]), "part 0"),
        (json!(["ZarrData", "UEsDBA==", "Array", null]), "no end record"),
        (json!(["ZarrData", base64(&whole[..whole.len() / 2]), "Array", null]), "no end record"),
        (json!(["ZarrData", base64(&whole), "Table", null]), "a zarr \"Table\""),
        (json!(["ZarrData", base64(&whole), "Group", null]), "the zip lacks .zgroup"),
        (json!(["ZarrData", base64(&whole), "Array", 5]), "text should be there"),
    ]);
    // Its writer would repair such a name: put it in afterwards, in both places of the archive.
    let mut leads_out = zip(
        &[(".zarray", metadata().to_string().as_bytes()), ("xxxxxxxxxx", b"")],
        CompressionMethod::Stored,
    );
    let places: Vec<usize> = leads_out
        .windows(10)
        .enumerate()
        .filter(|(_, w)| *w == b"xxxxxxxxxx")
        .map(|(at, _)| at)
        .collect();
    assert_eq!(places.len(), 2);
    for at in places {
        leads_out[at..at + 10].copy_from_slice(b"../../evil");
    }
    assert!(refusal(&object(&leads_out)).contains("leads out of the archive"));
    let deep: Vec<String> = (0..80).map(|depth| "a/".repeat(depth) + ".zgroup").collect();
    let members: Vec<(&str, &[u8])> = deep.iter().map(|name| (&**name, &b"{}"[..])).collect();
    let deep = zip(&members, CompressionMethod::Stored);
    let reason = refusal(&json!(["ZarrData", base64(&deep), "Group", null]));
    assert!(
        reason.contains("nesting of zarr groups") && reason.contains("the limit is 64"),
        "{reason}"
    );
}

/// A zip bomb, and claims of large arrays in small messages: all of a message together stay below
/// its limit.
#[test]
fn bombs_cost_no_more_than_the_limit() {
    let limits = Limits { message_bytes: 1 << 20, ..Limits::default() };
    let decode = |message: Json| {
        let value =
            codec::decode(&Bytes::from(message.to_string()), &limits, &wrapyfi_plugins::standard())
                .unwrap();
        let reasons: Vec<_> = value.refusals().map(|(_, reason)| reason.to_owned()).collect();
        reasons
    };
    let tagged = |object: Json| json!({"__wrapyfi__": object});
    let text = metadata().to_string();
    let zeros = vec![0; 4 << 20];
    let bomb = zip(&[(".zarray", text.as_bytes()), ("0", &zeros)], CompressionMethod::Deflated);
    assert!(bomb.len() < 10_000);
    let [reason] = &*decode(tagged(object(&bomb))) else { panic!("refused once") };
    assert!(
        reason.contains("zip member \"0\" is ") && reason.contains("the limit is 1048576"),
        "{reason}"
    );

    // 400 kB each, of which not one chunk was sent: the third is one too many.
    let claim = folder(&with(&[("shape", json!([100_000])), ("chunks", json!([100_000]))]), &[]);
    let claims: Vec<Json> = (0..100).map(|_| tagged(claim.clone())).collect();
    assert_eq!(decode(claims.into()).len(), 98);

    // One element each, in chunks of 400 kB.
    let mut packed = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
    packed.write_all(&vec![0; 400_000]).unwrap();
    let packed = packed.finish().unwrap();
    let padding = with(&[
        ("shape", json!([1])),
        ("chunks", json!([100_000])),
        ("compressor", json!({"id": "zlib"})),
    ]);
    let padding = folder(&padding, &[("0", &packed)]);
    let paddings: Vec<Json> = (0..100).map(|_| tagged(padding.clone())).collect();
    assert_eq!(decode(paddings.into()).len(), 98);
}

proptest! {
    #[test]
    fn zarr_arrays_come_back(
        dtype in proptest::sample::select(&Dtype::ALL[..]),
        shape in proptest::collection::vec(0_usize..5, 0..4),
        seed: u8,
    ) {
        prop_assume!(dtype != Dtype::BF16);
        let size = shape.iter().product::<usize>() * dtype.size();
        let data: Vec<u8> = (0..size).map(|i| (i as u8).wrapping_mul(31).wrapping_add(seed)).collect();
        let tensor = Tensor::new(dtype, shape, data).unwrap().with_origin(Origin::new("ZarrData"));
        let value = Value::from(tensor);
        prop_assert_eq!(&decode(&encode(&value)), &value);
    }

    /// Damage inside the archive, which damage of the base64 text rarely reaches.
    #[test]
    fn damaged_archives_do_no_harm(which in 0_usize..70, at in 0_usize..6000, byte: u8) {
        let all = layouts();
        let vector = &all[which % all.len()];
        let object: Json = serde_json::from_slice(&wire(vector)).unwrap();
        let text = object["__wrapyfi__"][1].as_str().unwrap();
        let mut archive = base64_simd::STANDARD.decode_to_vec(text).unwrap();
        let at = at % archive.len();
        archive[at] = byte;
        let kind = &object["__wrapyfi__"][2];
        let object = json!({"__wrapyfi__": ["ZarrData", base64(&archive), kind, null]});
        let limits = Limits { message_bytes: 1 << 20, ..Limits::default() };
        drop(codec::decode(&Bytes::from(object.to_string()), &limits, &wrapyfi_plugins::standard()));
    }
}
