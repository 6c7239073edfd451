//! Limits of an XML-RPC text, checked before values are made of it.
//!
//! The parser that makes values calls itself for each level of nesting, so depth is bounded first, by
//! the same parser's plain events: it cannot be told another structure than the one that follows.

use quick_xml::Reader;
use quick_xml::events::Event;

/// Largest text in bytes. The state of a system of a thousand nodes is a few hundred KiB.
pub const MAX_BYTES: usize = 8 << 20;
/// Deepest nesting of elements: a value in a list takes three levels, a member of a struct four.
pub const MAX_DEPTH: usize = 64;
/// Most elements.
pub const MAX_ELEMENTS: usize = 400_000;

/// Limit that a text exceeds, so that it is not parsed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BoundsError {
    /// Too many bytes.
    #[error("the XML is over {MAX_BYTES} bytes long, which is the limit")]
    TooLarge,
    /// Elements within elements.
    #[error("the XML nests deeper than {MAX_DEPTH} elements, which is the limit")]
    TooDeep,
    /// Too many elements.
    #[error("the XML has more than {MAX_ELEMENTS} elements, which is the limit")]
    TooMany,
    /// Document type, CDATA section or comment, which no node sends.
    #[error("the XML has a {0}, which XML-RPC has no use for")]
    Foreign(&'static str),
    /// The text is no XML.
    #[error("this is no XML in UTF-8")]
    NoXml,
}

/// The text, if it keeps within the bounds.
pub(super) fn check(body: &[u8]) -> Result<&str, BoundsError> {
    if body.len() > MAX_BYTES {
        return Err(BoundsError::TooLarge);
    }
    let xml = std::str::from_utf8(body).map_err(|_e| BoundsError::NoXml)?;
    let mut reader = Reader::from_str(xml);
    let (mut depth, mut elements) = (0_usize, 0_usize);
    loop {
        match reader.read_event().map_err(|_e| BoundsError::NoXml)? {
            Event::Start(_) => {
                depth += 1;
                elements += 1;
            }
            Event::Empty(_) => elements += 1,
            Event::End(_) => depth = depth.saturating_sub(1),
            Event::DocType(_) => return Err(BoundsError::Foreign("document type")),
            Event::CData(_) => return Err(BoundsError::Foreign("CDATA section")),
            Event::Comment(_) => return Err(BoundsError::Foreign("comment")),
            Event::Eof => return Ok(xml),
            _ => {}
        }
        if depth > MAX_DEPTH {
            return Err(BoundsError::TooDeep);
        }
        if elements > MAX_ELEMENTS {
            return Err(BoundsError::TooMany);
        }
    }
}
