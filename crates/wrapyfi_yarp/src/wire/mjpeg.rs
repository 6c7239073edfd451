//! Pictures of a camera over HTTP: the carrier that the receiver opens.
//!
//! ```text
//!   GET /?action=stream ─▶
//!   ◀─ HTTP/1.0 200 OK  Content-Type: multipart/x-mixed-replace;boundary=B
//!   ◀─ --B  Content-Length: N   FF D8 … FF FE length "42 1700000000.5" NUL … FF D9
//!                                       the envelope is a comment in the picture
//! ```

use bytes::{Buf, Bytes, BytesMut};

use super::http::{head, header};
use super::{Fault, Progress, take};
use crate::WireLimits;

/// Request for the pictures of a port. The odd ends of lines are those of YARP.
pub fn request(host: &str) -> Vec<u8> {
    format!("GET /?action=stream\n\n HTTP/1.1\nHost: {host}\r\n\n").into_bytes()
}

/// Beginning of a port's answer.
pub const RESPONSE_HEAD: &str = "\
HTTP/1.0 200 OK\r
Connection: close\r
Server: yarp/mjpeg_carrier/0.1\r
Cache-Control: no-store, no-cache, must-revalidate, pre-check=0, post-check=0, max-age=0\r
Pragma: no-cache\r
Expires: Mon, 3 Jan 2000 12:34:56 GMT\r
Content-Type: multipart/x-mixed-replace;boundary=boundarydonotcross\r
\r
--boundarydonotcross\r
";

/// Bytes in front of a picture of `size` bytes.
pub fn part_head(size: usize) -> Vec<u8> {
    format!("Content-Type: image/jpeg\r\nContent-Length: {size}\r\n\r\n").into_bytes()
}

/// Bytes behind a picture.
pub const PART_END: &[u8] = b"\r\n--boundarydonotcross\r\n";

/// A picture with the envelope that it carries.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// The JPEG file.
    pub jpeg: Bytes,
    /// The text of its comment.
    pub envelope: Option<Bytes>,
}

#[derive(Debug, Clone, Copy)]
enum MjpegState {
    Response,
    Part,
    Body(usize),
}

/// Reads the pictures off the answer.
#[derive(Debug, Clone)]
pub struct MjpegReader {
    state: MjpegState,
    max_message_bytes: usize,
}

impl MjpegReader {
    /// A reader that refuses pictures beyond [`WireLimits::max_message_bytes`].
    pub fn new(limits: &WireLimits) -> Self {
        Self { state: MjpegState::Response, max_message_bytes: limits.max_message_bytes }
    }

    /// Reads the head of the answer; true where it is complete and pictures follow.
    ///
    /// # Errors
    /// When the answer is not a stream of pictures.
    pub fn poll_answer(&mut self, buffer: &mut BytesMut) -> Result<bool, Fault> {
        if !matches!(self.state, MjpegState::Response) {
            return Ok(true);
        }
        let Some((head, next)) = head(buffer)? else { return Ok(false) };
        buffer.advance(next);
        let status = head.lines().next().unwrap_or_default();
        if status.split_whitespace().nth(1) != Some("200") {
            return Err(Fault::BadHttp(format!("status line {status:?}")));
        }
        let kind = header(&head, "content-type").unwrap_or_default();
        if !kind.to_ascii_lowercase().starts_with("multipart/") {
            return Err(Fault::BadHttp(format!("Content-Type is {kind:?}")));
        }
        self.state = MjpegState::Part;
        Ok(true)
    }

    /// Reads on.
    ///
    /// # Errors
    /// When the answer is not a stream of pictures.
    pub fn poll(&mut self, buffer: &mut BytesMut) -> Result<Progress<Picture>, Fault> {
        loop {
            match self.state {
                MjpegState::Response => {
                    if !self.poll_answer(buffer)? {
                        return Ok(Progress::Need(1));
                    }
                }
                MjpegState::Part => {
                    // Empty lines and the boundary stand in front of a part's own lines.
                    let blank = buffer.iter().take_while(|byte| byte.is_ascii_whitespace()).count();
                    buffer.advance(blank);
                    let Some((head, next)) = head(buffer)? else { return Ok(Progress::Need(1)) };
                    buffer.advance(next);
                    let length = header(&head, "content-length");
                    let length = length.and_then(|length| length.parse::<usize>().ok());
                    let Some(length) = length else {
                        return Err(Fault::BadHttp("a part has no Content-Length".to_owned()));
                    };
                    let limit = self.max_message_bytes;
                    if length > limit {
                        return Err(Fault::MessageTooLarge { size: length, limit });
                    }
                    self.state = MjpegState::Body(length);
                }
                MjpegState::Body(length) => {
                    let Some(jpeg) = take(buffer, length) else {
                        return Ok(Progress::Need(length - buffer.len()));
                    };
                    self.state = MjpegState::Part;
                    let jpeg = jpeg.freeze();
                    let envelope = comment(&jpeg);
                    return Ok(Progress::Event(Picture { jpeg, envelope }));
                }
            }
        }
    }

    /// Fault of a stream that ends here; `None` where it may end.
    #[must_use]
    pub fn end(&self, rest: usize) -> Option<Fault> {
        match self.state {
            MjpegState::Part => None,
            MjpegState::Response => Some(Fault::BadHttp("no complete head".to_owned())),
            MjpegState::Body(length) => Some(Fault::Truncated(length.saturating_sub(rest))),
        }
    }
}

/// The segments of a JPEG file up to its first scan: marker, where it begins, content.
fn segments(jpeg: &[u8]) -> impl Iterator<Item = (u8, usize, &[u8])> {
    let mut at = if jpeg.starts_with(&[0xff, 0xd8]) { 2 } else { jpeg.len() };
    std::iter::from_fn(move || {
        let &[0xff, marker, high, low] = jpeg.get(at..)?.first_chunk::<4>()? else { return None };
        if marker == 0xda {
            return None;
        }
        let length = usize::from(u16::from_be_bytes([high, low]));
        let content = jpeg.get(at + 4..at.checked_add(2)?.checked_add(length)?)?;
        let start = at;
        at += 2 + length;
        Some((marker, start, content))
    })
}

/// The text of the first comment.
fn comment(jpeg: &Bytes) -> Option<Bytes> {
    let (_, start, content) = segments(jpeg).find(|&(marker, ..)| marker == 0xfe)?;
    let end = content.iter().position(|&byte| byte < 32).unwrap_or(content.len());
    Some(jpeg.slice(start + 4..start + 4 + end)).filter(|text| !text.is_empty())
}

/// The picture with `envelope` as a comment in it, behind its first segment as YARP writes it;
/// as it is when it is no JPEG file, or the envelope is too long for one.
pub fn with_envelope(jpeg: &Bytes, envelope: &[u8]) -> Bytes {
    let length = u16::try_from(envelope.len() + 3);
    let first = segments(jpeg).next();
    let (Ok(length), Some((marker, start, content))) = (length, first) else {
        return jpeg.clone();
    };
    let behind = if (0xe0..=0xef).contains(&marker) { start + 4 + content.len() } else { start };
    let mut bytes = BytesMut::with_capacity(jpeg.len() + envelope.len() + 5);
    bytes.extend_from_slice(jpeg.get(..behind).unwrap_or_default());
    bytes.extend_from_slice(&[0xff, 0xfe]);
    bytes.extend_from_slice(&length.to_be_bytes());
    bytes.extend_from_slice(envelope);
    bytes.extend_from_slice(&[0]);
    bytes.extend_from_slice(jpeg.get(behind..).unwrap_or_default());
    bytes.freeze()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn jpeg() -> Bytes {
        Bytes::from_static(&[0xff, 0xd8, 0xff, 0xe0, 0, 4, 1, 2, 0xff, 0xda, 0, 2, 9, 0xff, 0xd9])
    }

    #[test]
    fn an_envelope_is_a_comment() {
        let stamped = with_envelope(&jpeg(), b"42 1.5");
        assert_eq!(comment(&stamped).unwrap(), "42 1.5");
        assert_eq!(stamped.len(), jpeg().len() + 11);
        assert_eq!(comment(&jpeg()), None);
        assert_eq!(with_envelope(&Bytes::from_static(b"no"), b"x"), "no");
    }

    #[test]
    fn pictures_come_with_their_envelope() {
        let picture = with_envelope(&jpeg(), b"7 0.25");
        let mut buffer = BytesMut::from(RESPONSE_HEAD);
        for _ in 0..2 {
            buffer.extend_from_slice(&part_head(picture.len()));
            buffer.extend_from_slice(&picture);
            buffer.extend_from_slice(PART_END);
        }
        let mut reader = MjpegReader::new(&WireLimits::default());
        for _ in 0..2 {
            let Progress::Event(found) = reader.poll(&mut buffer).unwrap() else { panic!() };
            assert_eq!(found.jpeg, picture);
            assert_eq!(found.envelope.unwrap(), "7 0.25");
        }
        assert!(matches!(reader.poll(&mut buffer), Ok(Progress::Need(_))));
        assert_eq!(reader.end(0), None);
    }

    #[test]
    fn what_is_no_stream_is_said() {
        for text in ["HTTP/1.0 404 Not Found\r\n\r\n", "HTTP/1.0 200 OK\r\n\r\n", "x\n\n"] {
            let mut reader = MjpegReader::new(&WireLimits::default());
            assert!(reader.poll(&mut BytesMut::from(text)).is_err(), "{text}");
        }
    }
}
