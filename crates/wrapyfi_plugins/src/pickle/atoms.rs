//! Instructions that make one object of nothing but their operand.

use num_bigint::BigInt;

use super::arena::{Kind, NodeId, Span};
use super::error::PickleError;
use super::machine::{Machine, Result};
use super::{opcode as op, text};

/// Newest protocol there is.
const PROTOCOL: u8 = 5;
/// Digits of the longest integer written as text: Python's own limit.
const MAX_DIGITS: usize = 4300;

impl<'a> Machine<'a> {
    pub(super) fn line_text(&self, line: Span) -> Option<&'a str> {
        str::from_utf8(self.scanner.get(line)).ok().map(str::trim)
    }

    pub(super) fn protocol(&mut self) -> Result<()> {
        let [version] = self.scanner.array("PROTO")?;
        if version > PROTOCOL {
            return Err(self.fault(format!("protocol {version}, the newest known is {PROTOCOL}")));
        }
        Ok(())
    }

    /// A frame says only how much may be read ahead; one that is not there is refused.
    pub(super) fn frame(&mut self) -> Result<()> {
        let length = self.scanner.unsigned("FRAME", 8)?;
        let start = self.scanner.at;
        self.scanner.span("a frame", length)?;
        self.scanner.at = start;
        Ok(())
    }

    pub(super) fn short_int(&mut self, width: u8) -> Result<()> {
        let value = self.scanner.unsigned("an integer", width)?;
        self.push_integer(value.into())
    }

    /// The bytes behind a length of `width` bytes.
    fn counted_span(&mut self, width: u8) -> Result<Span> {
        let length = self.scanner.unsigned("a length", width)?;
        self.scanner.span("counted bytes", length)
    }

    pub(super) fn counted(&mut self, width: u8, kind: fn(Span) -> Kind) -> Result<()> {
        let span = self.counted_span(width)?;
        self.push(kind(span))
    }

    pub(super) fn unicode(&mut self, width: u8) -> Result<()> {
        let span = self.counted_span(width)?;
        let kind = text::utf8(self.scanner.get(span), span);
        let kind = kind.ok_or_else(|| self.fault("the text is not UTF-8"))?;
        self.push(kind)
    }

    pub(super) fn byte_string(&mut self, width: u8) -> Result<()> {
        let span = self.counted_span(width)?;
        self.push(text::latin1(self.scanner.get(span), Some(span)))
    }

    pub(super) fn long(&mut self, width: u8) -> Result<()> {
        let span = self.counted_span(width)?;
        let value = BigInt::from_signed_bytes_le(self.scanner.get(span));
        self.push_integer(value)
    }

    fn push_integer(&mut self, value: BigInt) -> Result<()> {
        let kind = i64::try_from(&value);
        self.push(kind.map_or_else(|_| Kind::BigInt(Box::new(value)), Kind::Int))
    }

    /// `INT`, where `00` and `01` are bools, and `LONG`, which may end in `L`.
    pub(super) fn decimal(&mut self) -> Result<()> {
        let line = self.scanner.line("an integer")?;
        let bytes = self.scanner.get(line);
        if let (op::INT, b"00" | b"01") = (self.code, bytes) {
            self.stack.push(if bytes == b"01" { NodeId::TRUE } else { NodeId::FALSE });
            return Ok(());
        }
        if bytes.len() > MAX_DIGITS + 2 {
            return Err(self.fault(format!("more than {MAX_DIGITS} digits")));
        }
        let digits = self.line_text(line).unwrap_or_default();
        let value = digits.strip_suffix('L').unwrap_or(digits).parse::<BigInt>();
        let value = value.ok().ok_or_else(|| self.fault("no integer"))?;
        self.push_integer(value)
    }

    pub(super) fn float(&mut self) -> Result<()> {
        let line = self.scanner.line("FLOAT")?;
        let value = self.line_text(line).and_then(|text| text.parse().ok());
        let value = value.ok_or_else(|| self.fault("no float"))?;
        self.push(Kind::Float(value))
    }

    pub(super) fn buffer(&mut self) -> Result<()> {
        let index = self.next_buffer;
        if index >= self.buffers.len() {
            return Err(PickleError::Buffer {
                wanted: index + 1,
                count: self.buffers.len(),
                at: self.at,
            });
        }
        self.next_buffer += 1;
        let index = u32::try_from(index).ok().ok_or_else(|| self.fault("too many buffers"))?;
        self.push(Kind::Buffer(index))
    }

    pub(super) fn readonly(&mut self) -> Result<()> {
        let top = self.top()?;
        match *self.arena.kind(top) {
            Kind::ByteArray(span) => {
                self.pop()?;
                self.push(Kind::Bytes(span))
            }
            Kind::Buffer(_) | Kind::Bytes(_) | Kind::OwnedBytes(_) => Ok(()),
            ref other => Err(self.fault(format!("{} is no buffer", other.name()))),
        }
    }
}
