//! Pixels and samples as nested lists of decimal numbers, Wrapyfi's form of replies.
//!
//! ```text
//!   {"img": [[[0, 11, 22], [3, 14, 25]], …]}          rows, columns, channels
//!   {"aud": [32, 2, 16000, [[-0.5, -0.495], …]]}      chunk, channels, rate, samples
//!       └──────────── Reader: shape and numbers, in one pass, nothing else is kept
//! ```
//!
//! Numbers are kept as float32, which holds what pixels and samples can be. One takes four bytes and
//! at least two of text, so that a reply takes at most twice its own size.
//!
//! The lists do not say their element type. Integers are `uint8`, or `uint16` where there is one
//! channel and a number above 255; one number with a point or an exponent makes them `float32`.

use crate::ServiceSpec;
use crate::codec::{DecodeError, EncodeError, json, picture};
use wrapyfi_data::types::{AudioChunk, Dtype, Encoding, RawPixels, SampleFormat, Stamp};

/// Deepest nesting of lists: rows, columns, channels.
const MAX_DEPTH: usize = 3;

pub(super) fn write_image(raw: RawPixels, spec: &ServiceSpec) -> Result<Vec<u8>, EncodeError> {
    let (width, channels) = (raw.width as usize, raw.encoding.channels());
    let (encoding, height) = (raw.encoding, raw.height as usize);
    let array = picture::array(raw, spec.color_order)?;
    let size = encoding.bytes_per_pixel() / channels;
    // Three bytes are the shortest number with its comma and its space.
    EncodeError::check_size(
        (array.data().len() / size).saturating_mul(3),
        spec.limits.message_bytes,
    )?;
    // Nearly all numbers of a picture have three digits at most.
    let mut out = Vec::with_capacity((array.data().len() / size).saturating_mul(5) + 64);
    out.extend_from_slice(b"{\"img\": ");
    let write = |bytes: &[u8], out: &mut Vec<u8>| match *bytes {
        [byte] => write_byte(byte, out),
        [a, b] => write_integer(i64::from(u16::from_le_bytes([a, b])), out),
        [a, b, c, d] if encoding == Encoding::I32C1 => {
            write_integer(i64::from(i32::from_le_bytes([a, b, c, d])), out);
        }
        [a, b, c, d] => json::write_float(f64::from(f32::from_le_bytes([a, b, c, d])), out),
        _ => {}
    };
    if array.data().is_empty() {
        // As NumPy writes rows without pixels.
        let rows = vec!["[]"; height].join(", ");
        out.extend_from_slice(format!("[{rows}]}}").as_bytes());
        return Ok(out);
    }
    // A grey picture gets its channel: Wrapyfi's client cannot take two dimensions.
    nest(array.data(), size, width, channels, write, &mut out);
    out.push(b'}');
    Ok(out)
}

pub(super) fn write_sound(sound: &AudioChunk, spec: &ServiceSpec) -> Result<Vec<u8>, EncodeError> {
    let sound = sound.to_format(SampleFormat::F32Le);
    EncodeError::check_size((sound.data.len() / 4).saturating_mul(3), spec.limits.message_bytes)?;
    let AudioChunk { frames, channels, sample_rate, ref data, .. } = sound;
    let mut out = format!("{{\"aud\": [{frames}, {channels}, {sample_rate}, ").into_bytes();
    let write = |bytes: &[u8], out: &mut Vec<u8>| {
        if let Some(sample) = bytes.first_chunk::<4>() {
            json::write_float(f64::from(f32::from_le_bytes(*sample)), out);
        }
    };
    match sound.shape().len() {
        1 => list(data.chunks(4), &mut out, write),
        _ => rows(data, 4, usize::from(channels), write, &mut out),
    }
    out.extend_from_slice(b"]}");
    Ok(out)
}

/// Appends lists of rows of pixels.
fn nest(
    data: &[u8],
    size: usize,
    width: usize,
    channels: usize,
    write: impl Fn(&[u8], &mut Vec<u8>),
    out: &mut Vec<u8>,
) {
    let row = size * width * channels;
    list(data.chunks(row.max(1)), out, |row, out| rows(row, size, channels, &write, out));
}

/// Appends one list for every `per_list` numbers of `size` bytes.
fn rows(
    data: &[u8],
    size: usize,
    per_list: usize,
    write: impl Fn(&[u8], &mut Vec<u8>),
    out: &mut Vec<u8>,
) {
    list(data.chunks((size * per_list).max(1)), out, |numbers, out| {
        list(numbers.chunks(size.max(1)), out, &write);
    });
}

fn list<'a>(
    parts: impl Iterator<Item = &'a [u8]>,
    out: &mut Vec<u8>,
    write: impl Fn(&'a [u8], &mut Vec<u8>),
) {
    out.push(b'[');
    for (index, part) in parts.enumerate() {
        if index > 0 {
            out.extend_from_slice(b", ");
        }
        write(part, out);
    }
    out.push(b']');
}

/// Writes the decimal digits of a byte. It is written by hand, because a picture has millions of
/// them.
fn write_byte(value: u8, out: &mut Vec<u8>) {
    let digits = [b'0' + value / 100, b'0' + value / 10 % 10, b'0' + value % 10];
    let first = usize::from(value < 100) + usize::from(value < 10);
    out.extend_from_slice(digits.get(first..).unwrap_or_default());
}

fn write_integer(value: i64, out: &mut Vec<u8>) {
    use std::io::Write as _;
    // Writing to a vector does not fail.
    _ = write!(out, "{value}");
}

pub(super) fn read_image(body: &[u8], spec: &ServiceSpec) -> Result<RawPixels, DecodeError> {
    let mut reader = Reader::new(body);
    reader.key("img")?;
    let lists = reader.lists()?;
    reader.token(b'}')?;
    reader.end()?;
    let (height, width, channels) = match lists.shape[..] {
        [0] => (0, 0, 1),
        [height, width] => (height, width, 1),
        [height, width, channels] => (height, width, channels),
        _ => return Err(mismatch("pixels in two or three dimensions", &lists)),
    };
    let dtype = match () {
        () if lists.floats => Some(Dtype::F32),
        () if lists.numbers.is_empty() || lists.within(0, 255) => Some(Dtype::U8),
        () if lists.within(0, 65535) => Some(Dtype::U16),
        () => None,
    };
    let encoding = dtype.and_then(|dtype| picture::encoding(dtype, channels, spec.color_order));
    let encoding = encoding.ok_or_else(|| {
        mismatch("uint8 in 1, 3 or 4 channels, uint16 in 1, float in 1 or 3", &lists)
    })?;
    let data: Vec<u8> = match encoding {
        Encoding::F32C1 | Encoding::F32C3 => lists.to_f32(),
        Encoding::Mono16 => lists.numbers.iter().flat_map(|&n| small(n).to_le_bytes()).collect(),
        _ => lists.numbers.iter().map(|&n| small(n).to_le_bytes()[0]).collect(),
    };
    let (Ok(width), Ok(height)) = (u32::try_from(width), u32::try_from(height)) else {
        return Err(mismatch("fewer than 4294967296 rows and columns", &lists));
    };
    RawPixels::dense(width, height, encoding, data).map_err(|error| malformed(error.to_string(), 0))
}

pub(super) fn read_sound(body: &[u8], received: Stamp) -> Result<AudioChunk, DecodeError> {
    let mut reader = Reader::new(body);
    reader.key("aud")?;
    reader.token(b'[')?;
    let mut header = [0_u32; 3];
    for number in &mut header {
        *number = reader.count()?;
        reader.token(b',')?;
    }
    let lists = reader.lists()?;
    reader.token(b']')?;
    reader.token(b'}')?;
    reader.end()?;
    let [frames, channels, rate] = header;
    let Ok(channels) = u8::try_from(channels) else {
        return Err(malformed(format!("{channels} channels, the limit is 255"), 0));
    };
    if rate == 0 {
        return Err(malformed("a rate of 0 Hz".to_owned(), 0));
    }
    let is_flat = channels == 1 && lists.shape.len() == 1;
    let sound =
        AudioChunk::new(received, frames, channels, rate, SampleFormat::F32Le, lists.to_f32())
            .map_err(|error| malformed(error.to_string(), 0))?;
    Ok(AudioChunk { is_flat, ..sound })
}

// Checked by `within`.
fn small(number: f32) -> u16 {
    number as u16
}

/// Nested lists of one shape.
#[derive(Debug, Default)]
struct Lists {
    /// Number of elements of a list at each depth.
    shape: Vec<usize>,
    numbers: Vec<f32>,
    /// True once a number was no integer.
    floats: bool,
    least: f32,
    greatest: f32,
}

impl Lists {
    fn within(&self, least: u16, greatest: u16) -> bool {
        self.least >= f32::from(least) && self.greatest <= f32::from(greatest)
    }

    fn to_f32(&self) -> Vec<u8> {
        self.numbers.iter().flat_map(|number| number.to_le_bytes()).collect()
    }
}

struct Reader<'a> {
    body: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    fn new(body: &'a [u8]) -> Self {
        Self { body, at: 0 }
    }

    fn rest(&self) -> &'a [u8] {
        self.body.get(self.at..).unwrap_or_default()
    }

    fn fault(&self, wanted: &str) -> DecodeError {
        let found = match self.rest().first() {
            None => "the end".to_owned(),
            Some(byte) => format!("{:?}", char::from(*byte)),
        };
        malformed(format!("{found} where {wanted} should be"), self.at)
    }

    fn peek(&mut self) -> Option<u8> {
        let space = |byte: &u8| matches!(byte, b' ' | b'\t' | b'\n' | b'\r');
        self.at += self.rest().iter().take_while(|byte| space(byte)).count();
        self.rest().first().copied()
    }

    fn take(&mut self, wanted: u8) -> bool {
        let found = self.peek() == Some(wanted);
        self.at += usize::from(found);
        found
    }

    fn token(&mut self, wanted: u8) -> Result<(), DecodeError> {
        if self.take(wanted) {
            Ok(())
        } else {
            Err(self.fault(&format!("{:?}", char::from(wanted))))
        }
    }

    /// Reads `{"key":`; another object is another kind of reply.
    fn key(&mut self, key: &str) -> Result<(), DecodeError> {
        let expected = || format!("a reply {{\"{key}\": …}}");
        if !self.take(b'{') {
            return Err(DecodeError::mismatch(expected(), "no object"));
        }
        let quoted = format!("\"{key}\"");
        if self.peek() != Some(b'"') || !self.rest().starts_with(quoted.as_bytes()) {
            let actual = "an object that does not begin with it";
            return Err(DecodeError::mismatch(expected(), actual));
        }
        self.at += quoted.len();
        self.token(b':')
    }

    fn end(&mut self) -> Result<(), DecodeError> {
        if self.peek().is_none() { Ok(()) } else { Err(self.fault("the end")) }
    }

    /// Reads a whole number from 0.
    fn count(&mut self) -> Result<u32, DecodeError> {
        self.peek();
        let digits = self.rest().iter().take_while(|byte| byte.is_ascii_digit()).count();
        let text = self.rest().get(..digits).and_then(|digits| str::from_utf8(digits).ok());
        let Some(count) = text.and_then(|text| text.parse().ok()) else {
            return Err(self.fault("a number from 0 to 4294967295"));
        };
        self.at += digits;
        Ok(count)
    }

    fn lists(&mut self) -> Result<Lists, DecodeError> {
        let mut lists =
            Lists { least: f32::INFINITY, greatest: f32::NEG_INFINITY, ..Lists::default() };
        self.list(0, &mut lists)?;
        Ok(lists)
    }

    fn list(&mut self, depth: usize, lists: &mut Lists) -> Result<(), DecodeError> {
        if depth >= MAX_DEPTH {
            return Err(DecodeError::TooLarge {
                what: "nesting",
                path: "$".into(),
                actual: depth as u64 + 1,
                limit: MAX_DEPTH as u64,
            });
        }
        self.token(b'[')?;
        let known = lists.shape.get(depth).copied();
        if known.is_none() {
            lists.shape.push(0);
        }
        let mut count = 0;
        if !self.take(b']') {
            loop {
                let is_list = self.peek() == Some(b'[');
                // The first element on the way down decides where the numbers are.
                if is_list && (known.is_none() && count == 0 || lists.shape.len() > depth + 1) {
                    self.list(depth + 1, lists)?;
                } else if !is_list && lists.shape.len() == depth + 1 {
                    self.number(lists)?;
                } else {
                    return Err(self.fault("an element like those before it"));
                }
                count += 1;
                if !self.take(b',') {
                    break;
                }
            }
            self.token(b']')?;
        }
        match known {
            None => {
                if let Some(length) = lists.shape.get_mut(depth) {
                    *length = count;
                }
                Ok(())
            }
            Some(length) if length == count => Ok(()),
            Some(length) => {
                Err(malformed(format!("a list of {count} among lists of {length}"), self.at))
            }
        }
    }

    fn number(&mut self, lists: &mut Lists) -> Result<(), DecodeError> {
        let rest = self.rest();
        let words = [
            (&b"NaN"[..], f32::NAN),
            (b"Infinity", f32::INFINITY),
            (b"-Infinity", f32::NEG_INFINITY),
        ];
        if let Some((word, value)) = words.into_iter().find(|(word, _)| rest.starts_with(word)) {
            self.at += word.len();
            lists.floats = true;
            lists.numbers.push(value);
            return Ok(());
        }
        let in_number = |byte: &u8| matches!(byte, b'0'..=b'9' | b'-' | b'+' | b'.' | b'e' | b'E');
        let length = rest.iter().take_while(|byte| in_number(byte)).count();
        let text = rest.get(..length).and_then(|text| str::from_utf8(text).ok());
        let value: Option<f32> = text.and_then(|text| text.parse().ok());
        let Some(value) = value.filter(|_| !matches!(rest.first(), Some(b'+' | b'.'))) else {
            return Err(self.fault("a number"));
        };
        lists.floats |= text.is_some_and(|text| text.contains(['.', 'e', 'E']));
        lists.least = lists.least.min(value);
        lists.greatest = lists.greatest.max(value);
        lists.numbers.push(value);
        self.at += length;
        Ok(())
    }
}

fn malformed(reason: String, at: usize) -> DecodeError {
    let reason = if at == 0 { reason } else { format!("{reason} (byte {at})") };
    DecodeError::malformed("lists of numbers", reason)
}

fn mismatch(expected: &str, lists: &Lists) -> DecodeError {
    let kind = if lists.floats { "floats" } else { "integers" };
    DecodeError::mismatch(
        expected.to_owned(),
        format!("{kind} from {} to {} of shape {:?}", lists.least, lists.greatest, lists.shape),
    )
}
