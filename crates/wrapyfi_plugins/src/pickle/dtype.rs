//! `numpy.dtype` as pickles describe it.
//!
//! ```text
//!   dtype('f8', align, copy), state (3, '<', subarray, names, fields, size, alignment, flags)
//!   datetime64 and timedelta64:     (4, …, ({}, (b'ns', 1, 1, 1)))
//! ```

use std::collections::HashMap;
use std::fmt::Write;

use super::error::PickleError;
use super::node::{Node, View};

/// Element type of a pickled array.
///
/// ```
/// use wrapyfi_data::Limits;
/// use wrapyfi_plugins::pickle::{self, Allowed, ArrayDtype};
/// // pickle.dumps(numpy.dtype("uint8"), 0), without its state
/// let data = b"cnumpy\ndtype\n(Vu1\ntR.".to_vec().into();
/// let pickle = pickle::read(&data, &[], &Allowed::NUMPY, &Limits::default())?;
/// assert_eq!(pickle.root().dtype()?, ArrayDtype::Described("'|u1'".into()));
/// # Ok::<(), pickle::PickleError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum ArrayDtype {
    /// As `descr` in the header of a `.npy` file: `'<f4'`, `'<M8[ns]'`, `[('a', '<i4')]`.
    Described(String),
    /// `bfloat16` of the `ml_dtypes` package, little-endian.
    Bfloat16,
    /// Python objects.
    Object,
}

/// Deepest nesting of a structured type.
const MAX_DEPTH: usize = 16;
/// Longest `descr`: one type used many times by number could be written without end.
const MAX_TEXT: usize = 1 << 16;
/// Units of time that NumPy knows.
const UNITS: [&[u8]; 13] =
    [b"Y", b"M", b"W", b"D", b"h", b"m", b"s", b"ms", b"us", b"ns", b"ps", b"fs", b"as"];

type Result<T> = std::result::Result<T, PickleError>;

impl Node<'_> {
    /// Reads a `numpy.dtype`.
    ///
    /// # Errors
    /// When it is none, or one that no array of this crate can have.
    pub fn dtype(&self) -> Result<ArrayDtype> {
        let call = self.call("numpy.dtype")?;
        let code = call.arg(0)?;
        if code.is_global("ml_dtypes.bfloat16") {
            return Ok(ArrayDtype::Bfloat16);
        }
        if matches!(code.str()?, "O" | "O8" | "O4") {
            return Ok(ArrayDtype::Object);
        }
        let mut text = String::new();
        describe(self, &mut text, 0)?;
        Ok(ArrayDtype::Described(text))
    }
}

fn invalid(node: &Node<'_>, reason: impl Into<String>) -> PickleError {
    node.invalid("numpy.dtype", reason)
}

/// State of a dtype.
struct DtypeState<'p> {
    order: &'p str,
    subarray: Option<Node<'p>>,
    names: Option<Node<'p>>,
    fields: Option<Node<'p>>,
    size: Option<i64>,
    metadata: Option<Node<'p>>,
}

fn state<'p>(node: &Node<'p>) -> Result<DtypeState<'p>> {
    let native = DtypeState {
        order: "<",
        subarray: None,
        names: None,
        fields: None,
        size: None,
        metadata: None,
    };
    let Some(state) = node.call("numpy.dtype")?.find_state() else { return Ok(native) };
    let parts = state.tuple()?;
    let version = parts.get(0)?.int()?;
    if !(3..=4).contains(&version) {
        return Err(invalid(node, format!("state of version {version}, read are 3 and 4")));
    }
    Ok(DtypeState {
        order: parts.get(1)?.str()?,
        subarray: parts.get(2)?.option(),
        names: parts.get(3)?.option(),
        fields: parts.get(4)?.option(),
        size: Some(parts.get(5)?.int()?),
        metadata: parts.find(8).and_then(Node::option),
    })
}

/// Appends the type in the form of a `.npy` header.
fn describe(node: &Node<'_>, out: &mut String, depth: usize) -> Result<()> {
    if depth > MAX_DEPTH {
        return Err(invalid(node, format!("it nests deeper than {MAX_DEPTH}")));
    }
    let state = state(node)?;
    if let Some(subarray) = state.subarray {
        let [base, shape] = subarray.tuple()?.exact()?;
        out.push('(');
        describe(&base, out, depth + 1)?;
        out.push_str(", ");
        write_shape(&shape, out)?;
        out.push(')');
    } else if let (Some(names), Some(fields)) = (state.names, state.fields) {
        let size = state.size.and_then(|size| usize::try_from(size).ok());
        let size = size.ok_or_else(|| invalid(node, "a structure without a size"))?;
        structure(node, &names, &fields, size, out, depth)?;
    } else {
        simple(node, &state, out)?;
    }
    check_length(node, out)
}

fn check_length(node: &Node<'_>, out: &str) -> Result<()> {
    if out.len() <= MAX_TEXT {
        return Ok(());
    }
    Err(invalid(node, format!("its description is longer than {MAX_TEXT} characters")))
}

fn write_shape(shape: &Node<'_>, out: &mut String) -> Result<()> {
    out.push('(');
    let extents = shape.tuple()?;
    for (index, extent) in extents.iter().enumerate() {
        let separator = if index > 0 { ", " } else { "" };
        write!(out, "{separator}{}", extent.size()?).ok();
        check_length(shape, out)?;
    }
    if extents.len() == 1 {
        out.push(',');
    }
    out.push(')');
    Ok(())
}

/// Writes the `descr` of an element type that is no structure or subarray: `'<f4'`.
fn simple(node: &Node<'_>, state: &DtypeState<'_>, out: &mut String) -> Result<()> {
    let code = node.call("numpy.dtype")?.arg(0)?.str()?;
    let plain = code.len() <= 24 && code.chars().all(|c| c.is_ascii_alphanumeric());
    let (kind, digits) = code.split_at_checked(1).filter(|_| plain).unwrap_or(("", ""));
    let Ok(size) = digits.parse::<usize>() else {
        return Err(invalid(node, "its code is no letter with a number"));
    };
    if kind == "O" {
        return Err(invalid(node, "objects inside a structure"));
    }
    let wide = size > 1 && !matches!(kind, "S" | "a" | "V") || kind == "U";
    let order = match (wide, state.order) {
        (false, _) => '|',
        (true, "<" | "=" | "|") => '<',
        (true, ">") => '>',
        (true, other) => {
            let other: String = other.chars().take(8).collect();
            return Err(invalid(node, format!("{other:?} is no byte order")));
        }
    };
    write!(out, "'{order}{kind}{size}").ok();
    if let Some(metadata) = state.metadata.filter(|_| matches!(kind, "M" | "m")) {
        unit(&metadata, out)?;
    }
    out.push('\'');
    Ok(())
}

/// `({}, (b'ns', 1, 1, 1))` as `[ns]`.
fn unit(metadata: &Node<'_>, out: &mut String) -> Result<()> {
    let unit = metadata.tuple()?.get(1)?;
    let parts = unit.tuple()?;
    let (name, count, divisor) = (parts.get(0)?.bytes()?, parts.get(1)?, parts.get(2)?);
    if &*name == b"generic" {
        return Ok(());
    }
    if !UNITS.contains(&&*name) || divisor.int()? != 1 {
        return Err(invalid(metadata, "its unit of time is not known"));
    }
    let name = String::from_utf8_lossy(&name);
    match count.size()? {
        1 => write!(out, "[{name}]"),
        count => write!(out, "[{count}{name}]"),
    }
    .ok();
    Ok(())
}

/// `[('a', '<i4'), ('', '|V4'), ('b', '<f8', (2,))]`: gaps between members are written as members
/// without a name, as NumPy does.
fn structure(
    node: &Node<'_>,
    names: &Node<'_>,
    fields: &Node<'_>,
    size: usize,
    out: &mut String,
    depth: usize,
) -> Result<()> {
    let (names, fields) = (names.tuple()?, fields.dict()?);
    // A field with a title is in the dict twice. Larger dicts would cost time with each dtype.
    if fields.len() > names.len().saturating_mul(2) {
        let (fields, names) = (fields.len(), names.len());
        return Err(invalid(node, format!("{fields} fields for {names} names")));
    }
    let by_name: HashMap<&str, Node<'_>> = fields
        .iter()
        .filter_map(|(key, field)| match key.view() {
            View::Str(name) => Some((name, field)),
            _ => None,
        })
        .collect();
    let mut at = 0_usize;
    out.push('[');
    for name in names.iter() {
        let name_text = name.str()?;
        let field = by_name.get(name_text).ok_or_else(|| name.unexpected("the name of a field"))?;
        let parts = field.tuple()?;
        let (dtype, offset) = (parts.get(0)?, parts.get(1)?.size()?);
        gap(node, at, offset, out)?;
        let title = parts.find(2).and_then(Node::option);
        out.push('(');
        match title {
            Some(title) => write!(out, "({}, {})", quoted(title.str()?), quoted(name_text)).ok(),
            None => write!(out, "{}", quoted(name_text)).ok(),
        };
        out.push_str(", ");
        at = offset.checked_add(field_type(&dtype, out, depth)?).ok_or_else(|| {
            invalid(node, format!("the field at {offset} is larger than memory can be"))
        })?;
        out.push_str("), ");
    }
    gap(node, at, size, out)?;
    if out.ends_with(", ") {
        out.truncate(out.len() - 2);
    }
    out.push(']');
    Ok(())
}

/// Appends type and shape of a field; its size.
fn field_type(dtype: &Node<'_>, out: &mut String, depth: usize) -> Result<usize> {
    let start = out.len();
    let Some(subarray) = state(dtype)?.subarray else {
        describe(dtype, out, depth + 1)?;
        return size_of_descr(dtype, out.get(start..).unwrap_or_default());
    };
    let [base, shape] = subarray.tuple()?.exact()?;
    describe(&base, out, depth + 1)?;
    let base_size = size_of_descr(dtype, out.get(start..).unwrap_or_default())?;
    out.push_str(", ");
    write_shape(&shape, out)?;
    let mut size = base_size;
    for extent in shape.tuple()?.iter() {
        let product = size.checked_mul(extent.size()?);
        size = product.ok_or_else(|| invalid(dtype, "it is larger than memory can be"))?;
    }
    Ok(size)
}

fn size_of_descr(node: &Node<'_>, text: &str) -> Result<usize> {
    wrapyfi_data::codec::npy::itemsize(text).map_err(|reason| invalid(node, reason))
}

fn gap(node: &Node<'_>, at: usize, next: usize, out: &mut String) -> Result<()> {
    match next.checked_sub(at) {
        None => Err(invalid(node, format!("the field at byte {next} overlaps the one before"))),
        Some(0) => Ok(()),
        Some(bytes) => {
            write!(out, "('', '|V{bytes}'), ").ok();
            Ok(())
        }
    }
}

/// A string as Python writes it.
fn quoted(text: &str) -> String {
    let quote = if text.contains('\'') && !text.contains('"') { '"' } else { '\'' };
    let mut out = String::from(quote);
    for c in text.chars() {
        match c {
            '\\' => out.push_str("\\\\"),
            c if c == quote => out.extend(['\\', c]),
            '\n' => out.push_str("\\n"),
            '\r' => out.push_str("\\r"),
            '\t' => out.push_str("\\t"),
            c if c.is_control() => {
                write!(out, "\\u{:04x}", u32::from(c)).ok();
            }
            c => out.push(c),
        }
    }
    out.push(quote);
    out
}
