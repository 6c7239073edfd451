//! Pillow, xarray, pint, zarr and dask arrays: what Wrapyfi's plug-ins wrote (`tests/data/native`),
//! decoded and compared with the descriptions beside it, written again; and what must be refused.

// Helpers of tests count as library code to these lints; here too a panic is the right answer.
#![allow(clippy::unwrap_used, clippy::indexing_slicing, clippy::panic)]

use bytes::Bytes;
use proptest::prelude::*;
use serde_json::{Value as Json, json};
use wrapyfi_core::codec::image_file;
use wrapyfi_core::codec::json as codec;
use wrapyfi_core::plugin::Plugins;
use wrapyfi_core::types::{
    CompressedFormat, Encoding, Image, Labelled, LabelledContent, Map, Picture, Pixels, Quantity,
    RawPixels, Stamp, Tensor, Value, Variable,
};
use wrapyfi_core::{DecodeError, Limits};

/// The vectors of a file that Wrapyfi could encode.
fn vectors(group: &str) -> Vec<Json> {
    let path = format!("{}/tests/data/native/{group}.json", env!("CARGO_MANIFEST_DIR"));
    // NaN inside descriptions is legal to Python, which wrote the file.
    let text = std::fs::read_to_string(path).unwrap().replace(" NaN", " \"NaN\"");
    let file: Json = serde_json::from_str(&text).unwrap();
    let vectors = file["vectors"].as_array().unwrap().clone();
    vectors.into_iter().filter(|vector| vector["wire"].is_string()).collect()
}

fn named(group: &str, name: &str) -> Json {
    vectors(group).into_iter().find(|vector| vector["name"] == name).unwrap()
}

fn wire(vector: &Json) -> Bytes {
    Bytes::from(vector["wire"].as_str().unwrap().to_owned())
}

fn decode(wire: &Bytes) -> Value {
    codec::decode(wire, &Limits::default()).unwrap()
}

fn encode(value: &Value) -> Bytes {
    codec::encode(value).unwrap().into()
}

/// Through the graph and back.
fn through_the_graph(value: &Value) -> (String, Value) {
    let plugins = Plugins::standard();
    let (text, tensors) = codec::encode_with_tensors(value, &plugins).unwrap();
    let shown = String::from_utf8(text.clone()).unwrap();
    let again =
        codec::decode_with_tensors(&text.into(), &tensors, &Limits::default(), &plugins).unwrap();
    (shown, again)
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn base64(bytes: &[u8]) -> String {
    // Through the codec's own writer: bytes of an array behind a header of a multiple of three.
    const ALPHABET: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::new();
    for chunk in bytes.chunks(3) {
        let word = chunk.iter().fold(0_u32, |word, byte| word << 8 | u32::from(*byte))
            << (8 * (3 - chunk.len()));
        for place in 0..4 {
            let digit = ALPHABET[(word >> (18 - 6 * place) & 63) as usize];
            text.push(if place <= chunk.len() { char::from(digit) } else { '=' });
        }
    }
    text
}

/// Why an object was refused. It must then be carried as it is.
fn refusal(object: &Json) -> String {
    let wire = Bytes::from(json!({"objects": [{"__wrapyfi__": object}]}).to_string());
    let value = decode(&wire);
    let reasons: Vec<_> = value.refusals().map(|(_, reason)| reason.to_owned()).collect();
    let [reason] = &*reasons else { panic!("{object} became {value:?}") };
    let key = object[0].as_str().unwrap();
    assert!(reason.starts_with(&format!("{key} at $.objects[0]: ")), "{reason}");
    let untouched: Json = serde_json::from_slice(&encode(&value)).unwrap();
    assert_eq!(untouched, json!({"objects": [{"__wrapyfi__": object}]}));
    reason.clone()
}

fn assert_refused(cases: &[(Json, &str)]) {
    for (object, wanted) in cases {
        let reason = refusal(object);
        assert!(reason.contains(wanted), "{object}: {reason}");
    }
}

// Pillow ----------------------------------------------------------------------------------------

/// A picture in the words of the vectors: mode, size and pixels as Pillow has them.
fn describe_picture(value: &Value) -> Json {
    let picture = value.as_picture().unwrap();
    let raw = match &picture.image.pixels {
        Pixels::Raw(raw) => raw.clone(),
        Pixels::Compressed { data, .. } => {
            image_file::decode(data, &Limits::default(), Some(Encoding::Rgb8)).unwrap()
        }
        other => panic!("{other:?}"),
    };
    let mode = picture.mode.as_deref().unwrap_or(match raw.encoding {
        Encoding::Rgb8 => "RGB",
        Encoding::Rgba8 => "RGBA",
        Encoding::Mono8 => "L",
        Encoding::F32C1 => "F",
        other => panic!("{other}"),
    });
    let bytes = if mode == "1" {
        let row = |row: &[u8]| {
            row.chunks(8)
                .map(|eight| {
                    eight.iter().enumerate().fold(0, |bits, (i, p)| bits | (p & 1) << (7 - i))
                })
                .collect::<Vec<u8>>()
        };
        raw.data.chunks(raw.width as usize).flat_map(row).collect()
    } else {
        raw.data.to_vec()
    };
    json!({"mode": mode, "size_w_h": [raw.width, raw.height], "raw_bytes_hex": hex(&bytes)})
}

/// JPEG decoders may differ by rounding.
fn assert_near(a: &str, b: &str, tolerance: u8, name: &str) {
    let bytes = |hex: &str| -> Vec<u8> {
        hex.as_bytes()
            .chunks(2)
            .map(|two| u8::from_str_radix(std::str::from_utf8(two).unwrap(), 16).unwrap())
            .collect()
    };
    let (a, b) = (bytes(a), bytes(b));
    assert_eq!(a.len(), b.len(), "{name}");
    assert!(a.iter().zip(&b).all(|(a, b)| a.abs_diff(*b) <= tolerance), "{name}: {a:?} {b:?}");
}

#[test]
fn every_pillow_image_is_what_was_sent() {
    let mut checked = 0;
    for vector in vectors("pillow") {
        let name = vector["name"].as_str().unwrap();
        let value = decode(&wire(&vector));
        // Not what Wrapyfi makes of it, which are wrong pixels where they came without a file.
        let (found, original) = (describe_picture(&value), &vector["original"]);
        assert_eq!(found["mode"], original["mode"], "{name}");
        assert_eq!(found["size_w_h"], original["size_w_h"], "{name}");
        let tolerance = if original["format"] == "JPEG" { 3 } else { 0 };
        let bytes = |description: &Json| description["raw_bytes_hex"].as_str().unwrap().to_owned();
        assert_near(&bytes(&found), &bytes(original), tolerance, name);

        // Written as a file, which is the form that Wrapyfi reads right.
        let written = encode(&value);
        let tag: Json = serde_json::from_slice(&written).unwrap();
        assert_eq!(tag["__wrapyfi__"].as_array().unwrap().len(), 2, "{name}");
        let again = decode(&written);
        if name == "raw_1bit" {
            // The file says one bit itself; until it is opened it is a PNG like any other.
            let picture = again.as_picture().unwrap();
            assert!(matches!(picture.image.pixels, Pixels::Compressed { .. }));
        } else {
            assert_eq!(describe_picture(&again), found, "{name}");
        }
        assert_eq!(through_the_graph(&value).1, value, "{name}");
        checked += 1;
    }
    assert_eq!(checked, 8);
}

#[test]
fn files_that_ros_knows_stay_as_they_are() {
    for (name, format) in
        [("file_png", CompressedFormat::Png), ("file_jpeg", CompressedFormat::Jpeg)]
    {
        let vector = named("pillow", name);
        let value = decode(&wire(&vector));
        let picture = value.as_picture().unwrap();
        assert!(
            matches!(&picture.image.pixels, Pixels::Compressed { format: found, .. } if *found == format)
        );
        assert_eq!(encode(&value), wire(&vector), "{name}");
        let (text, again) = through_the_graph(&value);
        let head = format!("{{\"__wrapyfi__\": [\"picture\", {{\"format\": \"{format}\", ");
        assert!(text.starts_with(&head), "{text}");
        assert_eq!(again, value);
    }
}

#[test]
fn pictures_are_readable_in_the_graph() {
    let (text, _) = through_the_graph(&decode(&wire(&named("pillow", "raw_rgb"))));
    assert_eq!(
        text,
        r#"{"__wrapyfi__": ["picture", {"encoding": "rgb8", "width": 3, "height": 2, "data": {"__wrapyfi__": ["tensor", 0]}}]}"#
    );
    let tensors = [Tensor::from_elements(&[2, 3], vec![0_u8; 6]).unwrap()];
    for (body, wanted) in [
        (r#"{"encoding": "rgb8", "width": 3, "height": 2, "data": T}"#, "needs 18 bytes, 6"),
        (r#"{"encoding": "mono8", "width": 6, "height": 1, "data": T}"#, "of shape [1, 6]"),
        (r#"{"encoding": "mono8", "width": -3, "height": 2, "data": T}"#, "width is no number"),
        (r#"{"encoding": "yuv", "width": 3, "height": 2, "data": T}"#, "\"yuv\" is none of"),
        (r#"{"format": "png", "data": T}"#, "a file is uint8 of one dimension"),
        (r#"{"format": "bmp", "data": T}"#, "neither jpeg nor png"),
        (r#"{"width": 3}"#, "data is no tensor"),
    ] {
        let body = body.replace('T', r#"{"__wrapyfi__": ["tensor", 0]}"#);
        let text = format!(r#"{{"__wrapyfi__": ["picture", {body}]}}"#);
        let error = codec::decode_with_tensors(
            &text.into(),
            &tensors,
            &Limits::default(),
            &Plugins::standard(),
        );
        let error = error.unwrap_err().to_string();
        assert!(error.contains(wanted), "{body}: {error}");
    }
}

#[test]
fn hostile_pictures_are_refused() {
    let big = base64(&[0; 30]);
    assert_refused(&[
        (json!(["PILImage"]), "the object has 0 parts"),
        (json!(["PILImage", 5]), "text should be there"),
        (json!(["PILImage", "%PDF-1.7"]), "begins with \"%PDF-1.7\""),
        (json!(["PILImage", ""]), "a file of 0 bytes"),
        (json!(["PILImage", "\u{2603}"]), "stands for no byte"),
        (json!(["PILImage", "BM\u{0}\u{0}"]), "malformed BMP"),
        (json!(["PILImage", "GIF89a"]), "malformed GIF"),
        (json!(["PILImage", "II*\u{0}\u{8}\u{0}\u{0}\u{0}"]), "malformed TIFF"),
        (json!(["PILImage", big, [-3, 2], "RGB"]), "[width, height]"),
        (json!(["PILImage", big, [3, 2, 1], "RGB"]), "[width, height]"),
        (json!(["PILImage", big, [3.5, 2], "RGB"]), "[width, height]"),
        (json!(["PILImage", big, "3x2", "RGB"]), "no text"),
        (json!(["PILImage", big, [4_294_967_296_u64, 1], "L"]), "[width, height]"),
        (
            json!(["PILImage", big, [4_294_967_295_u64, 4_294_967_295_u64], "F"]),
            "larger than memory",
        ),
        (json!(["PILImage", big, [100_000, 100_000], "L"]), "10000000000 bytes, 30 are there"),
        (json!(["PILImage", big, [4_294_967_295_u64, 4_294_967_295_u64], "1"]), "30 are there"),
        (json!(["PILImage", big, [3, 2], "RGB"]), "needs 18 bytes, 30 are there"),
        (json!(["PILImage", big, [5, 2], "CMYK"]), "mode \"CMYK\""),
        (json!(["PILImage", big, [5, 2], 7]), "text should be there"),
        (json!(["PILImage", "AAEC", [2, 1], "RGB"]), "needs 6 bytes, 3 are there"),
        (json!(["PILImage", "AAE", [3, 1], "L"]), "part 0"),
    ]);
}

/// Small files that stand for large pictures: all of a message together stay below its limit.
#[test]
fn many_small_files_cannot_fill_the_memory() {
    // A GIF of 1000 x 1000 pixels in some hundred bytes would do; a BMP of bits is simpler to make.
    let (width, height) = (4096_u32, 512_u32);
    let mut file = b"BM".to_vec();
    file.extend([0; 8]);
    for word in [62_u32, 40, width, height, 1 | 1 << 16, 0, 0, 0, 0, 2, 2, 0, 0x00FF_FFFF] {
        file.extend(word.to_le_bytes());
    }
    file.extend(vec![0_u8; (width / 8 * height) as usize]);
    let text: String = file.iter().map(|byte| char::from(*byte)).collect();
    let object = json!({"__wrapyfi__": ["PILImage", text]});
    let limits = Limits { message_bytes: 16 << 20, ..Limits::default() };
    let message = Bytes::from(json!([object, object, object, object]).to_string());
    let value = codec::decode(&message, &limits).unwrap();
    let refused: Vec<_> = value.refusals().map(|(_, reason)| reason.to_owned()).collect();
    assert!(refused.len() >= 2, "{refused:?}");
    for reason in &refused {
        assert!(reason.contains("BMP of 4096x512") && reason.contains("the limit is"), "{reason}");
    }
    let one = codec::decode(&Bytes::from(object.to_string()), &limits).unwrap();
    assert!(one.as_picture().is_some(), "{:?}", one.refusals().next());
}

#[test]
fn pictures_that_no_file_holds_say_what_to_do() {
    let picture = |encoding, width, data: Vec<u8>| {
        let raw = RawPixels::dense(width, 1, encoding, data).unwrap();
        Value::from(Picture { image: Image::new(Stamp::default(), raw), mode: None })
    };
    let error = codec::encode(&picture(Encoding::F32C3, 1, vec![0; 12])).unwrap_err().to_string();
    assert!(error.contains("32FC3") && error.contains("send it as an array"), "{error}");
    // Nothing can be misread in an image without pixels.
    let empty = encode(&picture(Encoding::Bgr8, 0, vec![]));
    assert_eq!(&empty[..], br#"{"__wrapyfi__": ["PILImage", "", [0, 1], "RGB"]}"#);
    assert!(decode(&empty).as_picture().is_some());
}

// xarray ----------------------------------------------------------------------------------------

/// A labelled array as xarray's `to_dict` describes it.
fn describe_labelled(labelled: &Labelled) -> Json {
    fn plain(value: &Value) -> Json {
        match value {
            Value::Null => Json::Null,
            Value::Bool(value) => json!(value),
            Value::Int(value) => json!(value),
            Value::Float(value) if value.is_nan() => json!("NaN"),
            Value::Float(value) => json!(value),
            Value::Str(value) => json!(value),
            Value::DateTime(value) => json!(value.to_string().replace('T', " ")),
            Value::List(items) => items.iter().map(plain).collect(),
            Value::Map(map) => {
                map.iter().map(|(k, v)| (k.as_str().unwrap().to_owned(), plain(v))).collect()
            }
            Value::Tensor(tensor) => {
                let numbers: Vec<Json> = if let Some(floats) = tensor.to_vec::<f64>() {
                    floats.into_iter().map(|x| plain(&x.into())).collect()
                } else {
                    tensor.to_vec::<i64>().unwrap().into_iter().map(|x| json!(x)).collect()
                };
                match *tensor.shape() {
                    [_] => numbers.into(),
                    [_, columns] => numbers.chunks(columns).map(|row| json!(row)).collect(),
                    _ => panic!("{:?}", tensor.shape()),
                }
            }
            other => panic!("{other:?}"),
        }
    }
    let variable = |variable: &Variable| {
        let attrs = plain(&variable.attrs.clone().into());
        json!({"dims": variable.dims, "attrs": attrs, "data": plain(&variable.data)})
    };
    let all = |named: &[(String, Variable)]| -> Json {
        named.iter().map(|(name, member)| (name.clone(), variable(member))).collect()
    };
    let coords = all(&labelled.coords);
    match &labelled.content {
        LabelledContent::Array(array) => {
            let mut object = variable(array);
            object["coords"] = coords;
            object["name"] = json!(labelled.name);
            object
        }
        LabelledContent::Dataset { dims, variables, attrs } => {
            let dims: Json = dims.iter().map(|(k, v)| (k.clone(), json!(v))).collect();
            let attrs = plain(&attrs.clone().into());
            json!({"coords": coords, "attrs": attrs, "dims": dims, "data_vars": all(variables)})
        }
    }
}

#[test]
fn every_labelled_array_is_what_was_sent() {
    let mut checked = 0;
    for vector in vectors("xarray") {
        let name = vector["name"].as_str().unwrap();
        let value = decode(&wire(&vector));
        let labelled = value.as_labelled().unwrap();
        assert_eq!(describe_labelled(labelled), vector["decoded"]["as_dict"], "{name}");
        // Byte for byte.
        assert_eq!(encode(&value), wire(&vector), "{name}");
        let (text, again) = through_the_graph(&value);
        assert!(text.starts_with(r#"{"__wrapyfi__": ["labelled", {"#), "{text}");
        assert_eq!(
            describe_labelled(again.as_labelled().unwrap()),
            vector["decoded"]["as_dict"],
            "{name}"
        );
        checked += 1;
    }
    assert_eq!(checked, 3);
}

#[test]
fn numbers_are_tensors() {
    let value = decode(&wire(&named("xarray", "data_array")));
    let labelled = value.as_labelled().unwrap();
    let LabelledContent::Array(array) = &labelled.content else { panic!("an array") };
    let tensor = array.data.as_tensor().unwrap();
    assert_eq!(tensor.to_vec::<f64>().unwrap(), [0.0, 1.0, 2.0, 3.0]);
    assert_eq!(
        (tensor.shape(), &*array.dims),
        (&[2, 2][..], &["x".to_owned(), "y".to_owned()][..])
    );
    let (_, x) = &labelled.coords[0];
    assert_eq!(x.data.as_tensor().unwrap().to_vec::<i64>().unwrap(), [10, 20]);
}

fn xarray(text: &str, kind: &str) -> Json {
    json!(["XArrayData", base64(text.as_bytes()), kind, "t"])
}

#[test]
fn hostile_labelled_arrays_are_refused() {
    let var = |body: &str| xarray(&format!(r#"{{"data_vars": {{"t": {body}}}}}"#), "DataArray");
    assert_refused(&[
        (json!(["XArrayData"]), "the object has 0 parts"),
        (json!(["XArrayData", "e30=", "DataArray"]), "$.data_vars is missing"),
        (json!(["XArrayData", "e3", "Dataset", null]), "part 0"),
        (xarray("{\"data_vars\": {}}", "Variable"), "an xarray \"Variable\""),
        (xarray("[1]", "Dataset"), "a list where a dict should be"),
        (xarray("{\"data_vars\": 5}", "Dataset"), "$.data_vars is a int, no dict"),
        (xarray("{\"data_vars\": {}}", "DataArray"), "$.data_vars lacks \"t\""),
        (xarray("{\"data_vars\": {}, \"dims\": {\"x\": -1}}", "Dataset"), "$.dims holds"),
        (xarray("{\"data_vars\": {}, \"attrs\": 1}", "Dataset"), "$.attrs is a int"),
        (var("7"), "$.data_vars.t is a int"),
        (var("{}"), "$.data_vars.t.dims is missing"),
        (var(r#"{"dims": ["x"]}"#), "$.data_vars.t.data is missing"),
        (var(r#"{"dims": [1], "data": []}"#), "$.data_vars.t.dims is no list of names"),
        (var(r#"{"dims": ["x"], "data": [[1]]}"#), "has 2 dimensions, $.data_vars.t.dims names 1"),
        (var(r#"{"dims": ["x"], "data": 1}"#), "has 0 dimensions"),
        (xarray(&format!("{}{}", "[".repeat(99), "]".repeat(99)), "Dataset"), "the limit is 64"),
    ]);
}

#[test]
fn text_dates_and_odd_attributes_travel() {
    let text = r#"{"coords": {}, "attrs": {"made": {"data": "2024-01-02T03:04:05", "dtype": "datetime"}, "l": [1, {"a": null}]}, "dims": {"x": 2}, "data_vars": {"s": {"dims": ["x"], "attrs": {}, "data": ["a", "b"]}, "n": {"dims": [], "attrs": {}, "data": 5}, "e": {"dims": ["x", "y"], "attrs": {}, "data": [[], []]}}}"#;
    let wire = Bytes::from(json!({"__wrapyfi__": xarray(text, "Dataset")}).to_string());
    let value = decode(&wire);
    let Some(Labelled { content: LabelledContent::Dataset { attrs, .. }, .. }) =
        value.as_labelled()
    else {
        panic!("{value:?}")
    };
    assert!(matches!(attrs.get("made"), Some(Value::DateTime(_))));
    let again: Json = serde_json::from_slice(&encode(&value)).unwrap();
    assert_eq!(again["__wrapyfi__"][1], base64(text.as_bytes()));
    assert_eq!(through_the_graph(&value).1, value);
}

#[test]
fn what_wrapyfi_cannot_read_back_is_not_written() {
    let variable = |data: Value| Variable { dims: vec![], data, attrs: Map::new() };
    let array = |name: Option<&str>, data: Value| {
        let content = LabelledContent::Array(variable(data));
        Value::from(Labelled { name: name.map(Into::into), content, coords: vec![] })
    };
    for (value, wanted) in [
        (array(None, 1.into()), "a DataArray without a name"),
        (array(Some("t"), Value::Bytes(Bytes::new())), "a bytes in an xarray object"),
        (
            array(Some("t"), Map::from([("data", 1), ("dtype", 2)]).into()),
            "takes it for a point in time",
        ),
    ] {
        let error = codec::encode(&value).unwrap_err().to_string();
        assert!(error.contains(wanted), "{error}");
    }
}

// pint ------------------------------------------------------------------------------------------

#[test]
fn every_quantity_is_what_was_sent() {
    let mut checked = 0;
    for vector in vectors("pint") {
        let name = vector["name"].as_str().unwrap();
        let value = decode(&wire(&vector));
        let quantity = value.as_quantity().unwrap();
        let decoded = &vector["decoded"];
        assert_eq!(quantity.units, decoded["units"].as_str().unwrap(), "{name}");
        let magnitude = match &quantity.magnitude {
            Value::Int(value) => json!({"type": "int", "value": value.to_string()}),
            Value::Float(value) => json!({
                "type": "float64", "value": value, "bits_hex": format!("{:016x}", value.to_bits())
            }),
            other => panic!("{other:?}"),
        };
        assert_eq!(magnitude, decoded["magnitude"], "{name}");
        assert_eq!(encode(&value), wire(&vector), "{name}");
        let (text, again) = through_the_graph(&value);
        assert!(text.starts_with(r#"{"__wrapyfi__": ["quantity", {"magnitude": "#), "{text}");
        assert_eq!(again, value);
        checked += 1;
    }
    assert_eq!(checked, 3);
}

#[test]
fn hostile_quantities_are_refused() {
    let pint = |text: &str| json!(["PintData", base64(text.as_bytes()), "Quantity"]);
    let nested =
        format!("{{\"magnitude\": {{\"__wrapyfi__\": {}}}, \"units\": \"m\"}}", pint("{}"));
    assert_refused(&[
        (json!(["PintData"]), "the object has 0 parts"),
        (json!(["PintData", "e30="]), "the object has 1 parts"),
        (json!(["PintData", "e30=", "Unit"]), "a pint \"Unit\""),
        (json!(["PintData", "e3", "Quantity"]), "part 0"),
        (json!(["PintData", 5, "Quantity"]), "text should be there"),
        (pint("{"), "malformed JSON"),
        (pint("[]"), "no magnitude"),
        (pint("{}"), "no magnitude"),
        (pint(r#"{"magnitude": [1], "units": "m"}"#), "magnitude is a list"),
        (pint(r#"{"magnitude": 1}"#), "no units"),
        (pint(r#"{"magnitude": 1, "units": 2}"#), "no units"),
        (pint(&nested), "magnitude is a plug-in object"),
        (pint(&"[".repeat(70)), "nesting"),
    ]);
    let wrong = Quantity { magnitude: Value::List(vec![]), units: "m".into() };
    assert!(through_the_graph_fails(&wrong.into()));
}

/// A magnitude that is no number must not be read back from the graph.
fn through_the_graph_fails(value: &Value) -> bool {
    let plugins = Plugins::standard();
    let Ok((text, tensors)) = codec::encode_with_tensors(value, &plugins) else { return true };
    let read = codec::decode_with_tensors(&text.into(), &tensors, &Limits::default(), &plugins);
    matches!(read, Err(DecodeError::Malformed { .. }))
}

// Properties ------------------------------------------------------------------------------------

proptest! {
    #[test]
    fn pictures_come_back(
        encoding in proptest::sample::select(vec![
            Encoding::Mono8, Encoding::Mono16, Encoding::Rgb8, Encoding::Rgba8,
            Encoding::I32C1, Encoding::F32C1,
        ]),
        width in 1_u32..9,
        height in 1_u32..9,
        seed: u64,
    ) {
        let size = (width * height) as usize * encoding.bytes_per_pixel();
        let data: Vec<u8> = (0..size as u64).map(|i| (i.wrapping_mul(seed) >> 9) as u8).collect();
        let raw = RawPixels::dense(width, height, encoding, data).unwrap();
        let picture = Picture { image: Image::new(Stamp::default(), raw.clone()), mode: None };
        let value = Value::from(picture);
        prop_assert_eq!(&through_the_graph(&value).1, &value);
        let again = decode(&encode(&value));
        let pixels = match &again.as_picture().unwrap().image.pixels {
            Pixels::Raw(raw) => raw.clone(),
            Pixels::Compressed { data, .. } => {
                image_file::decode(data, &Limits::default(), Some(Encoding::Rgb8)).unwrap()
            }
            other => panic!("{other:?}"),
        };
        prop_assert_eq!(pixels, raw);
    }

    #[test]
    fn labelled_arrays_come_back(
        floats in proptest::collection::vec(any::<f64>(), 1..20),
        ints in proptest::collection::vec(any::<i64>(), 0..5),
        name in "[a-zé\"]{1,5}",
        attr in ".{0,8}",
    ) {
        let finite: Vec<f64> = floats.into_iter().map(|x| if x.is_nan() { 0.5 } else { x }).collect();
        let extent = finite.len();
        let data = Tensor::from_elements(&[1, extent], finite).unwrap();
        let attrs = Map::from([("note", attr)]);
        let coord = Tensor::from_elements(&[ints.len()], ints.clone()).unwrap();
        prop_assume!(!ints.is_empty());
        let value = Value::from(Labelled {
            name: Some(name.clone()),
            content: LabelledContent::Array(Variable {
                dims: vec!["a".into(), "b".into()], data: data.into(), attrs,
            }),
            coords: vec![("c".into(), Variable {
                dims: vec!["c".into()], data: coord.into(), attrs: Map::new(),
            })],
        });
        prop_assert_eq!(&decode(&encode(&value)), &value);
        prop_assert_eq!(&through_the_graph(&value).1, &value);
    }

    #[test]
    fn quantities_come_back(magnitude: i64, float: f64, units in ".{0,12}") {
        prop_assume!(!float.is_nan());
        for magnitude in [Value::from(magnitude), float.into()] {
            let value = Value::from(Quantity { magnitude, units: units.clone() });
            prop_assert_eq!(&decode(&encode(&value)), &value);
        }
    }

    /// Whatever a damaged object becomes, it does no harm.
    #[test]
    fn damaged_objects_do_no_harm(
        which in 0_usize..16, at in 0_usize..4000, byte: u8, cut: bool,
    ) {
        let all: Vec<Json> = ["pillow", "xarray", "pint", "zarr", "dask"].into_iter().flat_map(vectors).collect();
        let mut wire = wire(&all[which % all.len()]).to_vec();
        let at = at % wire.len();
        if cut { wire.truncate(at) } else { wire[at] = byte }
        let limits = Limits { message_bytes: 1 << 20, ..Limits::default() };
        drop(codec::decode(&wire.into(), &limits));
    }
}
