//! Native objects in the words of a person: what `wrapyfi echo` prints without `--json`.
//!
//! | value | text |
//! | --- | --- |
//! | null, numbers, text, lists and dicts of these | [canonical] JSON, letters of any script as they are |
//! | tuple, set | `(1, 2)`, `{1, 2}` |
//! | array | `array float32 (2, 3): [[0, 1, 2], [3, 4, 5]]`, of large ones the first elements |
//! | tensor of a library | `PytorchTensor float32 (2, 3) on cuda:0: …` |
//! | picture | `Picture 649x465 jpeg` |
//! | table | `DataFrame, 3 rows of 2 columns` and rows below |
//! | quantity | `42 meter` |
//! | labelled array, data set | `t (time: 2, x: 3) float64`, coordinates and arrays below |
//! | bytes; object that stays unread | `12 bytes`; `CuPyArray, not read: …` |

use std::fmt::Write as _;

use wrapyfi_data::Limits;
use wrapyfi_data::types::{
    Dtype, Element, Encoding, Labelled, LabelledContent, MessageType, Picture, Pixels, Tensor,
    Value, Variable,
};
use wrapyfi_endpoint::codec::convert;

use crate::canonical::canonical;
use crate::visible::{escaped, is_obeyed};

/// Elements of an array that are all shown.
const ALL: usize = 24;
/// Elements that are shown of a larger one.
const FIRST: usize = 6;

/// `value` in words; tables take several lines.
pub fn words(value: &Value) -> String {
    let mut out = String::new();
    write(&mut out, value);
    out
}

/// True for what JSON has a form of its own for.
fn is_plain(value: &Value) -> bool {
    match value {
        Value::Null | Value::Bool(_) | Value::Int(_) | Value::BigInt(_) | Value::Float(_) => true,
        Value::Str(_) | Value::Utf16(_) => true,
        Value::List(items) => items.iter().all(is_plain),
        Value::Map(map) => map.iter().all(|(key, value)| is_plain(key) && is_plain(value)),
        _ => false,
    }
}

// Writing to a String cannot fail, so the results of `write!` are not looked at.
fn write(out: &mut String, value: &Value) {
    match value {
        plain if is_plain(plain) => legible(out, &canonical(plain)),
        Value::List(items) => listed(out, "[", items, "]"),
        Value::Tuple(items) => {
            listed(out, "(", items, if items.len() == 1 { ",)" } else { ")" });
        }
        Value::Set(items) => listed(out, "{", items, "}"),
        Value::Map(map) => {
            let members =
                map.iter().map(|(key, value)| format!("{}: {}", words(key), words(value)));
            _ = write!(out, "{{{}}}", members.collect::<Vec<_>>().join(", "));
        }
        Value::DateTime(at) => _ = write!(out, "{at}"),
        Value::DateTime64(text) => out.push_str(text),
        Value::Tensor(tensor) => self::tensor(out, tensor),
        Value::Array(array) => {
            let descr = array.descr.trim_matches('\'');
            _ = write!(out, "array {descr} {}", shape(&array.shape));
        }
        Value::Picture(picture) => self::picture(out, picture),
        Value::Table(table) => _ = write!(out, "{table}"),
        Value::Quantity(quantity) => {
            write(out, &quantity.magnitude);
            _ = write!(out, " {}", quantity.units);
        }
        Value::Labelled(labelled) => self::labelled(out, labelled),
        Value::Bytes(bytes) => _ = write!(out, "{} bytes", bytes.len()),
        Value::Tagged(object) => match &object.refused {
            Some(reason) => _ = write!(out, "{}, not read: {reason}", object.key),
            None => {
                let (key, size) = (&object.key, object.json.len());
                _ = write!(out, "{key}, {size} bytes of an unknown plug-in");
            }
        },
        Value::Object(object) => _ = write!(out, "{object:?}"),
        _ => out.push_str(value.kind()),
    }
}

/// Writes JSON in ASCII with its letters in place of `\\u00e4`; what would not be seen stays as it is.
fn legible(out: &mut String, json: &str) {
    let mut rest = json;
    while let Some((before, escape)) = rest.split_once('\\') {
        out.push_str(before);
        let (units, after) = code_units(escape);
        rest = after;
        if units.is_empty() {
            // Another escape, of one character.
            let length = escape.chars().next().map_or(0, char::len_utf8);
            let (escaped, after) = escape.split_at(length);
            out.push('\\');
            out.push_str(escaped);
            rest = after;
        }
        for read in char::decode_utf16(units) {
            match read {
                Ok(letter) if !is_obeyed(letter) => out.push(letter),
                Ok(obeyed) => out.push_str(&escaped(&String::from(obeyed))),
                Err(lone) => _ = write!(out, "\\u{:04x}", lone.unpaired_surrogate()),
            }
        }
    }
    out.push_str(rest);
}

/// The code units at the beginning of `text`, which stands behind a backslash: `u00e4\\u00f6 and`; and what
/// follows them.
fn code_units(text: &str) -> (Vec<u16>, &str) {
    let (mut units, mut rest) = (Vec::new(), text);
    let mut next = Some(text);
    while let Some(digits) = next.and_then(|text| text.strip_prefix('u'))
        && let Some((digits, after)) = digits.split_at_checked(4)
        && let Ok(unit) = u16::from_str_radix(digits, 16)
    {
        units.push(unit);
        (rest, next) = (after, after.strip_prefix('\\'));
    }
    (units, rest)
}

fn listed(out: &mut String, open: &str, items: &[Value], close: &str) {
    let items: Vec<_> = items.iter().map(words).collect();
    _ = write!(out, "{open}{}{close}", items.join(", "));
}

fn shape(shape: &[usize]) -> String {
    let extents: Vec<_> = shape.iter().map(usize::to_string).collect();
    format!("({}{})", extents.join(", "), if shape.len() == 1 { "," } else { "" })
}

fn tensor(out: &mut String, tensor: &Tensor) {
    let owner = tensor.framework().unwrap_or("array");
    _ = write!(out, "{owner} {} {}", tensor.dtype(), shape(tensor.shape()));
    if !tensor.device().is_empty() {
        _ = write!(out, " on {}", tensor.device());
    }
    if let Some(elements) = elements(tensor) {
        out.push_str(": ");
        if tensor.element_count() > ALL {
            _ = write!(out, "[{}, …]", elements.join(", "));
        } else {
            out.push_str(&nested(&mut elements.into_iter(), tensor.shape()));
        }
    }
}

fn nested(elements: &mut impl Iterator<Item = String>, shape: &[usize]) -> String {
    let [extent, inner @ ..] = shape else { return elements.next().unwrap_or_default() };
    let parts: Vec<_> = (0..*extent).map(|_| nested(elements, inner)).collect();
    format!("[{}]", parts.join(", "))
}

/// The elements that are shown; nothing where Rust has no numbers of their type.
fn elements(tensor: &Tensor) -> Option<Vec<String>> {
    let count = tensor.element_count();
    let shown = if count > ALL { FIRST } else { count };
    fn first<T: Element + ToString>(tensor: &Tensor, shown: usize) -> Option<Vec<String>> {
        let size = tensor.dtype().size().checked_mul(shown)?;
        let part = tensor.data().get(..size)?.to_vec();
        let part = Tensor::new(tensor.dtype(), [shown], part).ok()?.to_vec::<T>()?;
        Some(part.iter().map(ToString::to_string).collect())
    }
    match tensor.dtype() {
        Dtype::Bool => first::<bool>(tensor, shown),
        Dtype::I8 => first::<i8>(tensor, shown),
        Dtype::I16 => first::<i16>(tensor, shown),
        Dtype::I32 => first::<i32>(tensor, shown),
        Dtype::I64 => first::<i64>(tensor, shown),
        Dtype::U8 => first::<u8>(tensor, shown),
        Dtype::U16 => first::<u16>(tensor, shown),
        Dtype::U32 => first::<u32>(tensor, shown),
        Dtype::U64 => first::<u64>(tensor, shown),
        Dtype::F32 => first::<f32>(tensor, shown),
        Dtype::F64 => first::<f64>(tensor, shown),
        _ => None,
    }
}

fn picture(out: &mut String, picture: &Picture) {
    let size = |out: &mut String, width, height| _ = write!(out, "Picture {width}x{height} ");
    match &picture.image.pixels {
        Pixels::Raw(raw) => {
            size(out, raw.width, raw.height);
            out.push_str(picture.mode.as_deref().unwrap_or(raw.encoding.name()));
        }
        Pixels::Compressed { format, .. } => {
            let limits = Limits::default();
            let image = convert(picture.image.clone(), MessageType::Image, Encoding::Bgr8, &limits);
            match image.map(|image| image.pixels) {
                Ok(Pixels::Raw(raw)) => size(out, raw.width, raw.height),
                _ => out.push_str("Picture "),
            }
            out.push_str(format.name());
        }
    }
}

fn labelled(out: &mut String, labelled: &Labelled) {
    match &labelled.content {
        LabelledContent::Array(array) => {
            _ = write!(out, "{} ", labelled.name.as_deref().unwrap_or("DataArray"));
            variable(out, array);
        }
        LabelledContent::Dataset { variables, .. } => {
            _ = write!(out, "Dataset of {} arrays", variables.len());
            for (name, member) in variables {
                _ = write!(out, "\n  {name} ");
                variable(out, member);
            }
        }
    }
    for (name, coordinate) in &labelled.coords {
        _ = write!(out, "\n  {name}: ");
        write(out, &coordinate.data);
    }
}

fn variable(out: &mut String, variable: &Variable) {
    let extents = variable.data.as_tensor().map(Tensor::shape).unwrap_or_default();
    let dims = variable.dims.iter().enumerate().map(|(index, name)| match extents.get(index) {
        Some(extent) => format!("{name}: {extent}"),
        None => name.clone(),
    });
    _ = write!(out, "({}) ", dims.collect::<Vec<_>>().join(", "));
    write(out, &variable.data);
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use wrapyfi_data::types::{CompressedFormat, Image, Map, Quantity, RawPixels, Stamp};
    use wrapyfi_endpoint::codec::{image_file, json};

    use super::*;

    fn read(text: &str) -> Value {
        json::decode(&text.to_owned().into(), &Limits::default(), &wrapyfi_core::plugin::standard())
            .unwrap()
    }

    #[test]
    fn what_json_has_is_json() {
        for text in [r#"{"a":[1,2.5,null],"b":"x"}"#, "[true]", "5"] {
            assert_eq!(words(&read(text)), text);
        }
    }

    #[test]
    fn letters_of_any_script_are_letters() {
        for (text, said) in [
            ("hällo", "\"hällo\""),
            ("日本 🤖", "\"日本 🤖\""),
            ("a\\u00e4 \"q\" \n", r#""a\\u00e4 \"q\" \n""#),
            ("bell \u{7} del \u{7f}", r#""bell \u0007 del \u007f""#),
        ] {
            assert_eq!(words(&text.into()), said);
        }
        assert_eq!(words(&read(r#"{"ü": ["ö", "\ud800"]}"#)), r#"{"ü":["ö","\ud800"]}"#);
    }

    #[test]
    fn objects_are_said_in_words() {
        let tensor = Tensor::from_elements(&[2, 3], vec![0_f32, 1.0, 2.0, 3.0, 4.0, 5.5]).unwrap();
        let text = "array float32 (2, 3): [[0, 1, 2], [3, 4, 5.5]]";
        assert_eq!(words(&tensor.clone().into()), text);
        let origin = Arc::new(wrapyfi_data::types::Origin::new("PytorchTensor"));
        let tensor = tensor.with_device("cuda:0").with_origin(origin);
        assert!(words(&tensor.into()).starts_with("PytorchTensor float32 (2, 3) on cuda:0: [[0"));
        let large = Tensor::from_elements(&[100], vec![7_u8; 100]).unwrap();
        assert_eq!(words(&large.into()), "array uint8 (100,): [7, 7, 7, 7, 7, 7, …]");

        let quantity = Value::from(Quantity { magnitude: 42.into(), units: "meter".into() });
        assert_eq!(words(&quantity), "42 meter");
        let inside = Value::Map(Map::from_iter([("far", quantity), ("n", 1.into())]));
        assert_eq!(words(&inside), r#"{"far": 42 meter, "n": 1}"#);
        assert_eq!(words(&Value::Tuple(vec![1.into(), "x".into()])), r#"(1, "x")"#);
        let raw = RawPixels::dense(3, 2, Encoding::Rgb8, vec![9; 18]).unwrap();
        let file = image_file::encode(&raw, None).unwrap();
        let compressed = Pixels::Compressed { format: CompressedFormat::Png, data: file };
        for (pixels, mode, text) in [
            (raw.clone().into(), None, "Picture 3x2 rgb8"),
            (raw.into(), Some("HSV".to_owned()), "Picture 3x2 HSV"),
            (compressed, None, "Picture 3x2 png"),
        ] {
            let image = Image::new(Stamp::default(), pixels);
            assert_eq!(words(&Picture { image, mode }.into()), text);
        }
        // {"columns": ["speed", "name"], "index": [0, 1], "data": [[1.5, "left"], [2.0, null]]}
        let table = read(
            r#"{"__wrapyfi__": ["PandasLegacyData", "eyJjb2x1bW5zIjpbInNwZWVkIiwibmFtZSJdLCJpbmRleCI6WzAsMV0sImRhdGEiOltbMS41LCJsZWZ0Il0sWzIuMCxudWxsXV19", "DataFrame"]}"#,
        );
        let text = "DataFrame, 2 rows of 2 columns\n  speed  name\n  1.5    left\n  2      -";
        assert_eq!(words(&table), text);
        let unread = read(r#"{"__wrapyfi__": ["Unknown", "abc"]}"#);
        assert!(words(&unread).starts_with("Unknown, "), "{}", words(&unread));
    }
}
