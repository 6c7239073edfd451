//! Tagged values: objects whose `__wrapyfi__` member names the value that they stand for.
//!
//! ```text
//!   {"__wrapyfi__": [tag, body, …]}
//!                     │     └ read as the tag asks; what follows it is dropped
//!                     ├ tuple, set, datetime, numpy.datetime64, numpy.ndarray ─▶ that value
//!                     ├ tensor, picture, … (in the graph only) ─▶ neutral.rs
//!                     ├ the key of a plug-in ─▶ what it makes of the rest
//!                     ├ any other string ─▶ carried as it is, for a peer that has the plug-in
//!                     └ no string ─▶ an ordinary dict
//! ```

use memchr::memchr;

use super::super::Path;
use super::decode::{Decoder, Result, Tagged};
use super::neutral;
use crate::base64;
use crate::codec::npy::{self, NpyArray};
use crate::json_text::{TAG, Text};
use crate::plugin::{Body, Element, Unpacking};
use crate::types::{Value, unique_members};

impl Decoder<'_> {
    /// Reads the member `__wrapyfi__` of the object at `path`, `depth` containers deep.
    pub(super) fn tag(&mut self, path: &Path<'_>, depth: usize) -> Result<Tagged> {
        let member = Path::Key(path, TAG);
        let start = self.at;
        match self.peek() {
            Some(b'[') => self.at += 1,
            // Wrapyfi's decoder raises on these; null and text it leaves alone.
            Some(b'{' | b't' | b'f' | b'-' | b'0'..=b'9' | b'N' | b'I') => {
                return Err(self.malformed(&member, "a tag is a list that begins with its name"));
            }
            _ => return self.value(&member, depth).map(Tagged::Plain),
        }
        match self.peek() {
            Some(b'"') => {}
            Some(b']') => return Err(self.malformed(&member, "a tag without its name")),
            _ => {
                self.at = start;
                return self.value(&member, depth).map(Tagged::Plain);
            }
        }
        let name = match self.text(&member)? {
            Text::Valid(name) => name,
            Text::Utf16(units) => String::from_utf16_lossy(&units),
        };
        let known = match name.as_str() {
            "tuple" | "set" | "datetime" | "numpy.datetime64" | "numpy.ndarray" => true,
            tag => self.tensors.is_some() && neutral::is_tag(tag),
        };
        let meaning = if !known {
            self.plugin_object(name.clone(), path, depth)?
        } else if !self.take(b',') {
            return Err(self.malformed(&member, format!("tag {name:?} without its body")));
        } else {
            Tagged::Value(match name.as_str() {
                "tuple" => Value::Tuple(self.members(path, depth)?),
                "set" => self.set(path, depth)?,
                "datetime" => self.datetime(path)?,
                "numpy.datetime64" => self.datetime64(path)?,
                "numpy.ndarray" => self.array(path)?,
                "tensor" => self.tensor(path, depth)?,
                tag => self.neutral(tag, path, depth)?,
            })
        };
        while self.take(b',') {
            self.skip(&member, depth)?;
        }
        if !self.take(b']') {
            return Err(self.malformed(&member, format!("tag {name:?} does not end")));
        }
        Ok(meaning)
    }

    /// Lets the plug-in of `key` decode the parts behind it.
    fn plugin_object(&mut self, key: String, path: &Path<'_>, depth: usize) -> Result<Tagged> {
        let Some(plugin) = self.plugins.get(&key) else {
            return Ok(Tagged::Opaque { key, refused: None });
        };
        let mut elements = Vec::new();
        while self.take(b',') {
            elements.push(match self.peek() {
                Some(b'"') => Element::Text(self.raw_string(path)?),
                _ => Element::Value(self.value(path, depth)?),
            });
        }
        let context = Unpacking::new(self.limits, self.plugins, &self.unpacked);
        match plugin.decode(&Body { elements }, &context) {
            Ok(Value::Tensor(tensor)) => Ok(Tagged::Value(self.plugins.place(tensor).into())),
            Ok(value) => Ok(Tagged::Value(value)),
            Err(error) => {
                let refused = Some(format!("{key} at {path}: {error}"));
                Ok(Tagged::Opaque { key, refused })
            }
        }
    }

    /// Reads the value of a tag of the graph's dialect; its body is one value.
    fn neutral(&mut self, tag: &str, path: &Path<'_>, depth: usize) -> Result<Value> {
        let body = self.value(path, depth)?;
        neutral::read(tag, &body).map_err(|reason| self.malformed(path, format!("{tag}: {reason}")))
    }

    /// Reads the members of anything that Python can iterate over, as `tuple(body)` does.
    fn members(&mut self, path: &Path<'_>, depth: usize) -> Result<Vec<Value>> {
        if self.peek() == Some(b'[') {
            // The list is the container that the tagged object already counted as.
            return self.list(path, depth);
        }
        Ok(match self.value(path, depth)? {
            Value::Tuple(items) | Value::Set(items) => items,
            Value::Str(text) => text.chars().map(|c| Value::Str(c.into())).collect(),
            Value::Utf16(units) => char::decode_utf16(units)
                .map(|c| match c {
                    Ok(c) => Value::Str(c.into()),
                    Err(lone) => Value::Utf16(vec![lone.unpaired_surrogate()]),
                })
                .collect(),
            Value::Map(map) => map.into_iter().map(|(key, _)| key).collect(),
            other => {
                return Err(self.malformed(path, format!("{} has no members", other.kind())));
            }
        })
    }

    fn set(&mut self, path: &Path<'_>, depth: usize) -> Result<Value> {
        let members = self.members(path, depth)?;
        match members.iter().position(|member| !member.is_hashable()) {
            None => Ok(Value::Set(unique_members(members))),
            Some(index) => {
                let kind = members.get(index).map_or("", Value::kind);
                let path = Path::Index(path, index);
                Err(self.malformed(&path, format!("{kind} cannot be a member of a set")))
            }
        }
    }

    /// The body of a tag that must be text.
    fn body_text(&mut self, path: &Path<'_>) -> Result<String> {
        match self.text(path)? {
            Text::Valid(text) => Ok(text),
            Text::Utf16(_) => Err(self.malformed(path, "text with a lone surrogate")),
        }
    }

    fn datetime(&mut self, path: &Path<'_>) -> Result<Value> {
        let text = self.body_text(path)?;
        text.parse().map(Value::DateTime).map_err(|error| self.malformed(path, error))
    }

    fn datetime64(&mut self, path: &Path<'_>) -> Result<Value> {
        let text = self.body_text(path)?;
        if is_datetime64(&text) {
            return Ok(Value::DateTime64(text));
        }
        let shown: String = text.chars().take(64).collect();
        Err(self.malformed(path, format!("{shown:?} is no numpy.datetime64")))
    }

    fn array(&mut self, path: &Path<'_>) -> Result<Value> {
        let file = match self.clean_base64(path) {
            Some(file) => file,
            None => {
                let decoded = match self.raw_string(path)?.decode() {
                    Ok(Text::Valid(text)) => base64::decode_leniently(text.as_bytes()),
                    Ok(Text::Utf16(_)) => Err("base64 text holds a lone surrogate".into()),
                    Err(reason) => Err(reason),
                };
                decoded.map_err(|reason| self.malformed(path, reason))?
            }
        };
        npy::read_at(&file.into(), path).map(|array| match array {
            NpyArray::Tensor(tensor) => Value::Tensor(tensor),
            NpyArray::Array(array) => Value::Array(array),
        })
    }

    /// The bytes of a string that is base64 and nothing else, as every sender but a broken one
    /// writes it. No such string holds an escape, so the next quote ends it.
    ///
    /// The string of an array that is all of a text ends with it: no pass over an image looks for its end.
    fn clean_base64(&mut self, path: &Path<'_>) -> Option<Vec<u8>> {
        self.peek().filter(|&byte| byte == b'"')?;
        let rest = self.rest().get(1..)?;
        let last = Some(rest).filter(|_| matches!(path, Path::Root));
        let last = last.and_then(|rest| rest.strip_suffix(b"\"]}"));
        let decoded = |text: &[u8]| Some((base64::decode_strictly(text)?, text.len()));
        let (file, length) = match last.and_then(decoded) {
            Some(found) => found,
            None => decoded(rest.get(..memchr(b'"', rest)?)?)?,
        };
        self.at += length + 2;
        Some(file)
    }

    fn tensor(&mut self, path: &Path<'_>, depth: usize) -> Result<Value> {
        let tensors = self.tensors.unwrap_or_default();
        let index = self.value(path, depth)?;
        let found = index.as_i64().and_then(|index| tensors.get(usize::try_from(index).ok()?));
        match found {
            Some(tensor) if !self.take(b',') => Ok(Value::Tensor(tensor.clone())),
            Some(tensor) => {
                let origin = neutral::read_origin(&self.value(path, depth)?)
                    .map_err(|reason| self.malformed(path, reason))?;
                Ok(self.plugins.place(tensor.clone().with_origin(origin)).into())
            }
            None => {
                let count = tensors.len();
                let index = match index {
                    Value::Int(index) => index.to_string(),
                    other => other.kind().to_owned(),
                };
                Err(self.malformed(path, format!("tensor {index} of {count} tensors")))
            }
        }
    }
}

/// True for text that NumPy reads as a `datetime64`: `NaT`, or a year with as much after it as its
/// unit needs.
fn is_datetime64(text: &str) -> bool {
    fn digits(text: &str, count: std::ops::RangeInclusive<usize>) -> Option<&str> {
        let rest = text.trim_start_matches(|c: char| c.is_ascii_digit());
        count.contains(&(text.len() - rest.len())).then_some(rest)
    }
    /// `YYYY[-MM[-DD[Thh[:mm[:ss[.fraction]]]]]]`, from the separators on.
    fn tail(mut rest: &str) -> Option<&str> {
        for separators in [&['-'][..], &['-'], &['T', ' '], &[':'], &[':']] {
            if rest.is_empty() {
                return Some(rest);
            }
            rest = digits(rest.strip_prefix(separators)?, 2..=2)?;
        }
        rest.strip_prefix('.').map_or(Some(rest), |fraction| digits(fraction, 1..=18))
    }
    if text.is_empty() || text.eq_ignore_ascii_case("nat") {
        return true;
    }
    let year = text.strip_prefix(['-', '+']).unwrap_or(text);
    digits(year, 1..=19).and_then(tail).is_some_and(str::is_empty)
}

#[cfg(test)]
mod tests {
    use super::is_datetime64;

    #[test]
    fn datetime64_texts() {
        for text in [
            "NaT",
            "2024",
            "-0044-03-15",
            "2024-01",
            "2024-01-02T03",
            "2024-01-02 03:04",
            "2024-01-02T03:04:05.123456789",
        ] {
            assert!(is_datetime64(text), "{text}");
        }
        for text in ["zzz", "2024-", "2024-1", "2024-01-02T", "2024-01-02T03:04:05.", "2024Z"] {
            assert!(!is_datetime64(text), "{text}");
        }
    }
}
