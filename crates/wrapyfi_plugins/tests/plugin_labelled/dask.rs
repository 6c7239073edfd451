//! dask's arrays.

use proptest::prelude::*;
use serde_json::json;
use wrapyfi_data::types::{Dtype, Origin, Tensor, Value};

use super::{assert_refused, base64, decode, encode, hex, named, through_the_graph, wire};

#[test]
fn a_dask_array_is_what_was_sent() {
    let vector = named("dask", "array");
    let value = decode(&wire(&vector));
    let tensor = value.as_tensor().unwrap();
    let computed = &vector["original"]["computed"];
    assert_eq!(tensor.dtype().npy_descr().unwrap(), computed["dtype"]);
    assert_eq!(json!(tensor.shape()), computed["shape"]);
    assert_eq!(hex(tensor.data()), computed["row_major_bytes_hex"].as_str().unwrap());
    // What Wrapyfi sends: one, though the array had two chunks.
    assert_eq!(tensor.origin(), Some(&Origin::new("DaskData").with("partitions", "1")));
    assert_eq!(encode(&value), wire(&vector));
    let (text, again) = through_the_graph(&value);
    assert_eq!(text, r#"{"__wrapyfi__": ["tensor", 0, {"key": "DaskData", "partitions": "1"}]}"#);
    assert_eq!(again, value);
}

#[test]
fn hostile_dask_arrays_are_refused() {
    let dask = |file: &[u8]| json!(["DaskData", base64(file), "Array", 1]);
    let header = |descr: &str, shape: &str| {
        let text = format!("{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}\n");
        let mut file = b"\x93NUMPY\x01\x00".to_vec();
        file.extend(u16::try_from(text.len()).unwrap().to_le_bytes());
        file.extend(text.bytes());
        file
    };
    assert_refused(&[
        (json!(["DaskData"]), "the object has 0 parts"),
        (json!(["DaskData", "k05V"]), "the object has 1 parts"),
        (json!(["DaskData", "k05V", "Array", 1]), "part 0"),
        (json!(["DaskData", "k05", "Array", 1]), "part 0"),
        (json!(["DaskData", 5, "Array", 1]), "text should be there"),
        (dask(b"\x80\x04N."), "a pickle, which is never executed"),
        (dask(b"PK\x03\x04"), "archive"),
        (dask(&header("'|O'", "(2,)")), "pickle"),
        (dask(&header("'<f8'", "(1099511627776,)")), "8796093022208 bytes"),
        (dask(&header("'<f8'", "(-1,)")), "extent"),
        (dask(&header("'<U1'", "(0,)")), "an array of numbers"),
        (json!(["DaskData", base64(&header("'<f8'", "(0,)")), "Array", 0]), "above 0"),
        (json!(["DaskData", base64(&header("'<f8'", "(0,)")), "Array"]), "no text"),
        (json!(["DaskData", "k05V", "Bag", 1]), "\"Bag\""),
    ]);
}

proptest! {
    #[test]
    fn dask_arrays_come_back(
        dtype in proptest::sample::select(&Dtype::ALL[..]),
        rows in 0_usize..5,
        columns in 0_usize..5,
        partitions in 1_u8..9,
    ) {
        prop_assume!(dtype != Dtype::BF16);
        let data = vec![1_u8; rows * columns * dtype.size()];
        let origin = Origin::new("DaskData").with("partitions", partitions.to_string());
        let tensor = Tensor::new(dtype, [rows, columns], data).unwrap().with_origin(origin);
        let value = Value::from(tensor);
        prop_assert_eq!(&decode(&encode(&value)), &value);
        prop_assert_eq!(&through_the_graph(&value).1, &value);
    }
}
