//! Values to text.

use std::borrow::Cow;
use std::io::Write as _;

use super::super::{EncodeError, Path};
use super::neutral;
use super::number::{MAX_DIGITS, big_integer, write_float};
use crate::base64;
use crate::codec::npy;
use crate::json_text::{self as text, TAG};
use crate::plugin::{Part, Plugins};
use crate::types::{Map, Tensor, Value};

type Result<T> = std::result::Result<T, EncodeError>;

/// Deepest nesting that is written: Python's decoder raises beyond about three times this.
const MAX_DEPTH: usize = 300;
/// Room for a text at its begin: a short one needs no more, an array takes what it needs at once.
const SHORT: usize = 256;

struct Encoder<'a> {
    plugins: &'a Plugins,
    out: Vec<u8>,
    /// Tensors that are taken out of the text; `None` where they are written into it.
    tensors: Option<Vec<Tensor>>,
    /// The whole value, until there is room for its arrays.
    whole: Option<&'a Value>,
}

pub(super) fn run(
    value: &Value,
    tensors: Option<Vec<Tensor>>,
    plugins: &Plugins,
) -> Result<(Vec<u8>, Vec<Tensor>)> {
    let out = Vec::with_capacity(SHORT);
    let mut encoder = Encoder { plugins, out, tensors, whole: Some(value) };
    encoder.value(value, &Path::Root, 0)?;
    // Shrinks in place. Of a short text it would not be worth the call.
    if encoder.out.capacity() > SHORT {
        encoder.out.shrink_to_fit();
    }
    Ok((encoder.out, encoder.tensors.unwrap_or_default()))
}

/// Length of the arrays of a value in a text, about.
fn length_of_arrays(value: &Value) -> usize {
    /// Header and tag of an array.
    const FRAME: usize = 256;
    match value {
        Value::List(items) | Value::Tuple(items) | Value::Set(items) => {
            items.iter().map(length_of_arrays).sum()
        }
        Value::Map(map) => map.iter().map(|(_, value)| length_of_arrays(value)).sum(),
        Value::Array(_)
        | Value::Tensor(_)
        | Value::Table(_)
        | Value::Picture(_)
        | Value::Quantity(_)
        | Value::Labelled(_)
        | Value::Object(_) => FRAME + base64::encoded_length(value.size_hint()),
        _ => 0,
    }
}

fn unrepresentable(what: impl Into<String>, path: &Path<'_>, remedy: &str) -> EncodeError {
    EncodeError::Unrepresentable {
        format: "JSON",
        what: what.into(),
        path: path.to_string(),
        remedy: remedy.to_owned(),
    }
}

impl Encoder<'_> {
    fn push(&mut self, text: &str) {
        self.out.extend_from_slice(text.as_bytes());
    }

    /// Writes `{"__wrapyfi__": ["NAME", ` body `]}`.
    fn tagged(&mut self, name: &str, body: impl FnOnce(&mut Self) -> Result<()>) -> Result<()> {
        for part in ["{\"", TAG, "\": [\"", name, "\", "] {
            self.push(part);
        }
        body(self)?;
        self.push("]}");
        Ok(())
    }

    fn value(&mut self, value: &Value, path: &Path<'_>, depth: usize) -> Result<()> {
        if depth > MAX_DEPTH {
            let what = format!("a value nested deeper than {MAX_DEPTH}");
            return Err(unrepresentable(what, path, "nest it less"));
        }
        match value {
            Value::Null => self.push("null"),
            Value::Bool(true) => self.push("true"),
            Value::Bool(false) => self.push("false"),
            Value::Int(value) => _ = write!(self.out, "{value}"),
            Value::BigInt(value) => match big_integer(value) {
                Some(digits) => self.push(&digits),
                None => {
                    let what = format!("an integer of more than {MAX_DIGITS} digits");
                    return Err(unrepresentable(what, path, "send it as text"));
                }
            },
            Value::Float(value) => write_float(*value, &mut self.out),
            Value::Str(value) => text::write(value, &mut self.out),
            Value::Utf16(units) => text::write_units(units, &mut self.out),
            Value::Bytes(bytes) => {
                let what = format!("{} raw bytes", bytes.len());
                return Err(unrepresentable(what, path, "send an array of uint8"));
            }
            Value::List(items) => self.items(items, path, depth)?,
            // Wrapyfi's own encoder loses tuples inside tuples, but its decoder, which works from
            // the inside out, reads them when every one is tagged.
            Value::Tuple(items) => self.tagged("tuple", |to| to.items(items, path, depth))?,
            Value::Set(items) => self.set(items, path, depth)?,
            Value::Map(map) => self.map(map, path, depth)?,
            Value::DateTime(when) => {
                if !(1..=9999).contains(&chrono::Datelike::year(&when.local)) {
                    let what = format!("the date {when}");
                    return Err(unrepresentable(what, path, "use the years 1 to 9999"));
                }
                self.tagged("datetime", |to| to.quoted(&when.to_string()))?;
            }
            Value::DateTime64(text) => self.tagged("numpy.datetime64", |to| to.quoted(text))?,
            Value::Tensor(tensor) => self.tensor(value, tensor, path, depth)?,
            Value::Array(array) => {
                let header = npy::array_header(array);
                self.tagged("numpy.ndarray", |to| to.base64(&header, &array.data))?;
            }
            Value::Table(_)
            | Value::Picture(_)
            | Value::Quantity(_)
            | Value::Labelled(_)
            | Value::Object(_) => self.object(value, path, depth)?,
            Value::Tagged(tagged) => {
                if self.tensors.is_some() && neutral::is_tag(&tagged.key) {
                    let what = format!("a plug-in object with the key {:?}", tagged.key);
                    let remedy = "rename the plug-in: the key has another meaning in the graph";
                    return Err(unrepresentable(what, path, remedy));
                }
                self.out.extend_from_slice(&tagged.json);
            }
        }
        Ok(())
    }

    fn quoted(&mut self, value: &str) -> Result<()> {
        text::write(value, &mut self.out);
        Ok(())
    }

    fn base64(&mut self, header: &[u8], data: &[u8]) -> Result<()> {
        self.out.push(b'"');
        // For all of them, and what stands between and behind: a text of megabytes is not to be moved for it.
        if let Some(whole) = self.whole.take() {
            self.out.reserve(length_of_arrays(whole) + 2 * SHORT);
        }
        base64::append(header, data, &mut self.out);
        self.out.push(b'"');
        Ok(())
    }

    fn tensor(
        &mut self,
        value: &Value,
        tensor: &Tensor,
        path: &Path<'_>,
        depth: usize,
    ) -> Result<()> {
        let Some(tensors) = &mut self.tensors else {
            if tensor.origin.is_some() {
                return self.plugin_object(value, path, depth);
            }
            let (header, data) = npy::parts(tensor);
            return self.tagged("numpy.ndarray", |to| to.base64(&header, &data));
        };
        let index = tensors.len();
        tensors.push(tensor.clone());
        self.tagged("tensor", |to| {
            to.push(&index.to_string());
            if let Some(origin) = &tensor.origin {
                to.push(", ");
                to.value(&neutral::origin_body(origin), path, depth)?;
            }
            Ok(())
        })
    }

    /// An object that a plug-in writes on the wire, and the graph's dialect in the graph.
    fn object(&mut self, value: &Value, path: &Path<'_>, depth: usize) -> Result<()> {
        if self.tensors.is_some() {
            let written = neutral::write(value).map_err(|reason| {
                unrepresentable(format!("a {}: {reason}", value.kind()), path, "send its parts")
            })?;
            if let Some((tag, body)) = written {
                return self.tagged(tag, |to| to.value(&body, path, depth + 1));
            }
        }
        self.plugin_object(value, path, depth)
    }

    fn plugin_object(&mut self, value: &Value, path: &Path<'_>, depth: usize) -> Result<()> {
        let key = value.plugin_key().unwrap_or_default();
        let Some(plugin) = self.plugins.get(key) else {
            let what = format!("a {} of the plug-in {key:?}", value.kind());
            let remedy = "register that plug-in, or send its parts";
            return Err(unrepresentable(what, path, remedy));
        };
        let parts = plugin.encode(value).map_err(|error| {
            let what = format!("a {} of the plug-in {key:?}", value.kind());
            unrepresentable(what, path, &error.to_string())
        })?;
        for part in ["{\"", TAG, "\": ["] {
            self.push(part);
        }
        text::write(key, &mut self.out);
        for (index, part) in parts.iter().enumerate() {
            self.push(", ");
            match part {
                Part::Text(text) => text::write(text, &mut self.out),
                Part::Base64(head, tail) => self.base64(head, tail)?,
                Part::Latin1(file) => text::write_units(file, &mut self.out),
                Part::Value(value) => self.value(value, &Path::Index(path, index), depth + 1)?,
            }
        }
        self.push("]}");
        Ok(())
    }

    fn items(&mut self, items: &[Value], path: &Path<'_>, depth: usize) -> Result<()> {
        self.push("[");
        for (index, item) in items.iter().enumerate() {
            if index > 0 {
                self.push(", ");
            }
            self.value(item, &Path::Index(path, index), depth + 1)?;
        }
        self.push("]");
        Ok(())
    }

    fn set(&mut self, members: &[Value], path: &Path<'_>, depth: usize) -> Result<()> {
        if let Some(index) = members.iter().position(|member| !member.is_hashable()) {
            let kind = members.get(index).map_or("", Value::kind);
            let what = format!("a {kind} as member of a set");
            let remedy = "use tuples inside sets, or a list";
            return Err(unrepresentable(what, &Path::Index(path, index), remedy));
        }
        self.tagged("set", |to| to.items(members, path, depth))
    }

    fn map(&mut self, map: &Map, path: &Path<'_>, depth: usize) -> Result<()> {
        self.push("{");
        for (index, (key, value)) in map.iter().enumerate() {
            if index > 0 {
                self.push(", ");
            }
            let shown = self.key(key, path)?;
            let path = Path::Key(path, &shown);
            if shown == TAG && is_misread(value) {
                let what = "a dict that a receiver takes for a tagged value";
                return Err(unrepresentable(what, &path, "use another key"));
            }
            self.push(": ");
            self.value(value, &path, depth + 1)?;
        }
        self.push("}");
        Ok(())
    }

    /// Writes a key as Python's `json` does, which makes text of numbers and constants; the key.
    fn key<'a>(&mut self, key: &'a Value, path: &Path<'_>) -> Result<Cow<'a, str>> {
        match key {
            Value::Str(key) => {
                text::write(key, &mut self.out);
                return Ok(Cow::Borrowed(key));
            }
            Value::Utf16(units) => {
                text::write_units(units, &mut self.out);
                return Ok(String::from_utf16_lossy(units).into());
            }
            Value::Null | Value::Bool(_) | Value::Int(_) | Value::BigInt(_) | Value::Float(_) => {}
            other => {
                let what = format!("a {} as key of a dict", other.kind());
                return Err(unrepresentable(what, path, "use text, a number, a bool or None"));
            }
        }
        self.out.push(b'"');
        let start = self.out.len();
        self.value(key, path, 0)?;
        let written = self.out.get(start..).unwrap_or_default();
        let shown = String::from_utf8_lossy(written).into_owned();
        self.out.push(b'"');
        Ok(shown.into())
    }
}

/// True when Wrapyfi's decoder would read an object with `value` under the tag's name as a tagged
/// value, or raise. There is no way to escape the name.
fn is_misread(value: &Value) -> bool {
    match value {
        Value::Null | Value::Str(_) | Value::Utf16(_) => false,
        Value::List(items) => {
            items.first().is_none_or(|first| matches!(first, Value::Str(_) | Value::Utf16(_)))
        }
        _ => true,
    }
}
