//! The Python literal in a `.npy` header: elements, order, shape.
//!
//! ```text
//!   {'descr': '<f4', 'fortran_order': False, 'shape': (2, 3), }
//!   descr = code | [(name, descr[, shape]), …] | (descr, shape)
//! ```

use crate::types::Dtype;

/// A header, understood.
#[derive(Debug)]
pub(super) struct Header {
    pub(super) descr: Descr,
    /// `descr` as it stands in the header.
    pub(super) descr_text: String,
    pub(super) fortran_order: bool,
    pub(super) shape: Vec<usize>,
}

/// Type of one element.
#[derive(Debug, Clone, Copy)]
pub(super) struct Descr {
    pub(super) itemsize: usize,
    /// Number type, with true for big-endian; `None` for elements that are no plain numbers.
    pub(super) number: Option<(Dtype, bool)>,
}

/// Deepest nesting of a structured type.
const MAX_DEPTH: usize = 16;
/// Most dimensions an array may have, as in NumPy.
pub(super) const MAX_DIMENSIONS: usize = 64;

pub(super) fn parse_header(text: &str) -> Result<Header, String> {
    let mut rest = Literal { text, at: 0 };
    let (mut descr, mut fortran_order, mut shape) = (None, None, None);
    rest.expect('{')?;
    while !rest.take('}') {
        let key = rest.string()?;
        rest.expect(':')?;
        match key {
            "descr" => {
                rest.skip_space();
                let start = rest.at;
                let parsed = rest.descr(0)?;
                let raw = text.get(start..rest.at).unwrap_or_default();
                descr = Some((parsed, raw.to_owned()));
            }
            "fortran_order" => fortran_order = Some(rest.boolean()?),
            "shape" => shape = Some(rest.shape()?),
            other => return Err(format!("the header has an unknown key {other:?}")),
        }
        if !rest.take(',') {
            rest.expect('}')?;
            break;
        }
    }
    rest.skip_space();
    if rest.at != text.len() {
        return Err("the header goes on after its closing brace".into());
    }
    let missing = |key: &str| format!("the header lacks {key:?}");
    let (descr, descr_text) = descr.ok_or_else(|| missing("descr"))?;
    Ok(Header {
        descr,
        descr_text,
        fortran_order: fortran_order.ok_or_else(|| missing("fortran_order"))?,
        shape: shape.ok_or_else(|| missing("shape"))?,
    })
}

/// A `descr` that stands alone.
pub(super) fn parse_descr(text: &str) -> Result<Descr, String> {
    let mut rest = Literal { text, at: 0 };
    let descr = rest.descr(0)?;
    match rest.peek() {
        None => Ok(descr),
        Some(_) => Err(format!("more text follows the descr {text}")),
    }
}

struct Literal<'a> {
    text: &'a str,
    at: usize,
}

impl<'a> Literal<'a> {
    fn rest(&self) -> &'a str {
        self.text.get(self.at..).unwrap_or_default()
    }

    fn skip_space(&mut self) {
        let rest = self.rest();
        self.at += rest.len() - rest.trim_start_matches([' ', '\t', '\n', '\r']).len();
    }

    fn peek(&mut self) -> Option<char> {
        self.skip_space();
        self.rest().chars().next()
    }

    fn take(&mut self, wanted: char) -> bool {
        let found = self.peek() == Some(wanted);
        if found {
            self.at += wanted.len_utf8();
        }
        found
    }

    fn expect(&mut self, wanted: char) -> Result<(), String> {
        if self.take(wanted) {
            return Ok(());
        }
        Err(match self.peek() {
            Some(found) => format!("the header has {found:?} where {wanted:?} should be"),
            None => format!("the header ends where {wanted:?} should be"),
        })
    }

    /// A quoted string, escapes left as they are.
    fn string(&mut self) -> Result<&'a str, String> {
        let quote = self.peek().filter(|c| matches!(c, '\'' | '"'));
        let quote = quote.ok_or("the header lacks a quoted string")?;
        self.at += 1;
        let rest = self.rest();
        let mut escaped = false;
        let end = rest.find(|c| {
            let ends = c == quote && !escaped;
            escaped = c == '\\' && !escaped;
            ends
        });
        let end = end.ok_or("the header ends inside a string")?;
        self.at += end + 1;
        Ok(rest.get(..end).unwrap_or_default())
    }

    fn boolean(&mut self) -> Result<bool, String> {
        self.skip_space();
        for (word, value) in [("True", true), ("False", false)] {
            if self.rest().starts_with(word) {
                self.at += word.len();
                return Ok(value);
            }
        }
        Err("fortran_order is neither True nor False".into())
    }

    fn extent(&mut self) -> Result<usize, String> {
        self.skip_space();
        let rest = self.rest();
        let digits = rest.len() - rest.trim_start_matches(|c: char| c.is_ascii_digit()).len();
        self.at += digits;
        let extent = rest.get(..digits).unwrap_or_default().parse().ok().ok_or_else(|| {
            let shown: String = rest.chars().take(24).collect();
            format!("{shown:?} does not begin with an extent")
        })?;
        // Python 2 wrote long integers with a suffix.
        self.take('L');
        Ok(extent)
    }

    fn shape(&mut self) -> Result<Vec<usize>, String> {
        self.expect('(')?;
        let mut shape = Vec::new();
        while !self.take(')') {
            if shape.len() == MAX_DIMENSIONS {
                return Err(format!("the shape has more than {MAX_DIMENSIONS} dimensions"));
            }
            shape.push(self.extent()?);
            if !self.take(',') {
                self.expect(')')?;
                break;
            }
        }
        Ok(shape)
    }

    fn descr(&mut self, depth: usize) -> Result<Descr, String> {
        if depth > MAX_DEPTH {
            return Err(format!("the descr nests deeper than {MAX_DEPTH}"));
        }
        if self.take('[') {
            return self.fields(depth);
        }
        if self.take('(') {
            let element = self.descr(depth + 1)?;
            self.expect(',')?;
            let itemsize = self.repeated(element.itemsize)?;
            self.take(',');
            self.expect(')')?;
            return Ok(Descr { itemsize, number: None });
        }
        code(self.string()?)
    }

    /// `(name, descr[, shape]), …]`
    fn fields(&mut self, depth: usize) -> Result<Descr, String> {
        let mut itemsize = 0_usize;
        while !self.take(']') {
            self.expect('(')?;
            if self.take('(') {
                // A title before the name.
                self.string()?;
                self.expect(',')?;
                self.string()?;
                self.expect(')')?;
            } else {
                self.string()?;
            }
            self.expect(',')?;
            let mut size = self.descr(depth + 1)?.itemsize;
            if self.take(',') && self.peek() != Some(')') {
                size = self.repeated(size)?;
                self.take(',');
            }
            self.expect(')')?;
            itemsize = itemsize.checked_add(size).ok_or("the descr's size overflows")?;
            if !self.take(',') {
                self.expect(']')?;
                break;
            }
        }
        Ok(Descr { itemsize, number: None })
    }

    /// Size of a sub-array whose shape follows.
    fn repeated(&mut self, itemsize: usize) -> Result<usize, String> {
        let shape = if self.peek() == Some('(') { self.shape()? } else { vec![self.extent()?] };
        crate::types::element_count(&shape)
            .and_then(|count| count.checked_mul(itemsize))
            .ok_or_else(|| format!("a sub-array of shape {shape:?} overflows"))
    }
}

/// A type code: byte order, kind, size, unit.
fn code(code: &str) -> Result<Descr, String> {
    let (big_endian, rest) = match code.as_bytes().first() {
        Some(b'>') => (true, code.get(1..)),
        Some(b'<' | b'=' | b'|') => (false, code.get(1..)),
        _ => (false, Some(code)),
    };
    let unknown = || format!("the descr {code:?} is not known");
    let rest = rest.unwrap_or_default();
    if let Some(dtype) = Dtype::from_name(rest).filter(|&dtype| dtype != Dtype::BF16) {
        return Ok(Descr { itemsize: dtype.size(), number: Some((dtype, big_endian)) });
    }
    let mut chars = rest.chars();
    let kind = chars.next().ok_or_else(unknown)?;
    if kind == 'O' {
        return Err("an array of Python objects is a pickle, which is never executed".into());
    }
    let (digits, unit) = chars.as_str().split_at(
        chars.as_str().find(|c: char| !c.is_ascii_digit()).unwrap_or(chars.as_str().len()),
    );
    let is_time = matches!(kind, 'M' | 'm');
    let unit_fits = unit.is_empty() || (is_time && unit.starts_with('[') && unit.ends_with(']'));
    if !unit_fits {
        return Err(unknown());
    }
    let size: usize = digits.parse().ok().ok_or_else(unknown)?;
    let plain = format!("{kind}{size}");
    let is_plain =
        |dtype: &Dtype| dtype.npy_descr().and_then(|known| known.get(1..)) == Some(plain.as_str());
    let number = Dtype::ALL.into_iter().find(is_plain);
    match (kind, size) {
        _ if number.is_some() => {}
        // Extended precision, whose layout depends on the machine.
        ('f', 10..=16) | ('c', 20..=32) | ('M' | 'm', 8) | ('S' | 'a' | 'V', _) => {}
        ('U', _) => {
            let itemsize = size.checked_mul(4).ok_or_else(unknown)?;
            return Ok(Descr { itemsize, number: None });
        }
        _ => return Err(unknown()),
    }
    Ok(Descr { itemsize: size, number: number.map(|dtype| (dtype, big_endian)) })
}
