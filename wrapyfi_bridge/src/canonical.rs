//! Native objects as text that is the same in every language, to read and to hash.
//!
//! Compact JSON in ASCII with sorted keys, numbers as Python prints them: what
//! `json.dumps(value, sort_keys=True, separators=(",", ":"))` gives. Anything that JSON has no form
//! for is an object with one key:
//!
//! | value | text |
//! | --- | --- |
//! | tuple, set | `{"@tuple":[…]}`, `{"@set":[…]}` with the items sorted |
//! | array | `{"@array":{"dtype":"<f4","sha256":"…","shape":[2,3]}}`, hash of its row-major bytes |
//! | tensor of a library | the same with `"device":"cuda:0"` and `"framework":"PytorchTensor"` |
//! | datetime | `{"@datetime":"2025-06-07T08:09:10"}`, `{"@datetime64":"…"}` |
//! | bytes | `{"@bytes":{"sha256":"…","size":3}}` |
//! | text with lone surrogates | as JSON: `"\\ud800"` |
//! | plug-in object | `{"@tagged":{"key":"PytorchTensor","sha256":"…","size":812}}` |
//! | NaN, infinities | the tokens `NaN`, `Infinity`, `-Infinity` |

use std::fmt::Write as _;

use wrapyfi_data::types::Value;
use wrapyfi_endpoint::codec::json;

use crate::describe::digest;

/// The canonical text of `value`.
pub fn canonical(value: &Value) -> String {
    let mut out = String::new();
    write(&mut out, value);
    out
}

// Writing to a String cannot fail, so the results of `write!` are not looked at.
fn write(out: &mut String, value: &Value) {
    match value {
        Value::List(items) => list(out, items.iter().map(canonical)),
        Value::Tuple(items) => tagged(out, "tuple", |out| list(out, items.iter().map(canonical))),
        Value::Set(items) => {
            let mut texts: Vec<String> = items.iter().map(canonical).collect();
            texts.sort();
            tagged(out, "set", |out| list(out, texts.into_iter()));
        }
        Value::Map(map) => {
            let mut members: Vec<(String, &Value)> =
                map.iter().map(|(key, value)| (key_text(key), value)).collect();
            members.sort_by(|a, b| a.0.cmp(&b.0));
            let members = members.iter().map(|(key, value)| format!("{key}:{}", canonical(value)));
            _ = write!(out, "{{{}}}", members.collect::<Vec<_>>().join(","));
        }
        Value::DateTime(at) => tagged(out, "datetime", |out| _ = write!(out, "\"{at}\"")),
        Value::DateTime64(text) => tagged(out, "datetime64", |out| _ = write!(out, "\"{text}\"")),
        Value::Tensor(tensor) => {
            let dtype = tensor.dtype();
            let dtype = dtype.npy_descr().unwrap_or_else(|| dtype.name());
            let owner = tensor.framework().map(|key| (tensor.device(), key));
            array(out, dtype, tensor.shape(), tensor.data(), owner);
        }
        Value::Array(numpy) => {
            array(out, numpy.descr.trim_matches('\''), &numpy.shape, &numpy.data, None);
        }
        Value::Bytes(bytes) => {
            let (sha256, size) = (digest(bytes), bytes.len());
            tagged(out, "bytes", |out| _ = write!(out, r#"{{"sha256":"{sha256}","size":{size}}}"#));
        }
        Value::Tagged(object) => {
            let (sha256, size) = (digest(&object.json), object.json.len());
            let key = scalar(&Value::from(object.key.as_str()));
            tagged(out, "tagged", |out| {
                _ = write!(out, r#"{{"key":{key},"sha256":"{sha256}","size":{size}}}"#);
            });
        }
        _ => out.push_str(&scalar(value)),
    }
}

/// A key as JSON wants it; those that are no strings as Python's `json` writes them.
fn key_text(key: &Value) -> String {
    let text = canonical(key);
    if text.starts_with('"') { text } else { scalar(&Value::from(text.as_str())) }
}

/// Null, booleans, numbers and text, as Wrapyfi's JSON has them.
fn scalar(value: &Value) -> String {
    match json::encode(value, &wrapyfi_core::plugin::standard()) {
        Ok(text) => String::from_utf8_lossy(&text).into_owned(),
        Err(_unwritable) => "null".to_owned(),
    }
}

fn list(out: &mut String, items: impl Iterator<Item = String>) {
    _ = write!(out, "[{}]", items.collect::<Vec<_>>().join(","));
}

fn tagged(out: &mut String, tag: &str, body: impl FnOnce(&mut String)) {
    _ = write!(out, r#"{{"@{tag}":"#);
    body(out);
    out.push('}');
}

/// An array; `owner` is the device and the library of a tensor.
fn array(out: &mut String, dtype: &str, shape: &[usize], data: &[u8], owner: Option<(&str, &str)>) {
    let text = |text: &str| scalar(&Value::from(text));
    tagged(out, "array", |out| {
        out.push('{');
        if let Some((device, _)) = owner {
            _ = write!(out, r#""device":{},"#, text(device));
        }
        _ = write!(out, r#""dtype":{},"#, text(dtype));
        if let Some((_, framework)) = owner {
            _ = write!(out, r#""framework":{},"#, text(framework));
        }
        _ = write!(out, r#""sha256":"{}","shape":"#, digest(data));
        list(out, shape.iter().map(usize::to_string));
        out.push('}');
    });
}

#[cfg(test)]
mod tests {
    use bytes::Bytes;
    use wrapyfi_data::Limits;

    use super::*;

    #[test]
    fn reads_as_python_would_dump_it() {
        let text = r#"{"b": [1, 2.0, NaN, 1208925819614629174706176], "a": "\u00ef\ud83d\ude80", "t": {"__wrapyfi__": ["tuple", [1]]}, "s": {"__wrapyfi__": ["set", [10, 9]]}}"#;
        let value =
            json::decode(&Bytes::from(text), &Limits::default(), &wrapyfi_core::plugin::standard())
                .unwrap();
        assert_eq!(
            canonical(&value),
            r#"{"a":"\u00ef\ud83d\ude80","b":[1,2.0,NaN,1208925819614629174706176],"s":{"@set":[10,9]},"t":{"@tuple":[1]}}"#
        );
    }
    #[test]
    fn a_tensor_says_whose_it_is_and_where() {
        use wrapyfi_data::types::{Origin, Tensor};
        let tensor = Tensor::from_elements(&[1], vec![0_u8]).unwrap();
        let plain = canonical(&tensor.clone().into());
        assert!(plain.starts_with(r#"{"@array":{"dtype":"|u1","sha256":"6e340b9c"#), "{plain}");
        let torch = tensor.with_device("cuda:0").with_origin(Origin::new("PytorchTensor"));
        let torch = canonical(&torch.into());
        let wanted =
            r#"{"@array":{"device":"cuda:0","dtype":"|u1","framework":"PytorchTensor","sha256":"#;
        assert!(torch.starts_with(wanted) && torch.ends_with(r#","shape":[1]}}"#), "{torch}");
    }
}
