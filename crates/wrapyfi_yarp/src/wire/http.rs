//! Requests that a browser, or a camera's viewer, sends to a port over HTTP.

use bytes::{Buf, Bytes, BytesMut};

use super::{Fault, Progress};

/// Longest head of a request or an answer.
pub const MAX_HEAD: usize = 16 * 1024;
/// Longest body of a request.
pub const MAX_BODY: usize = 64 * 1024;

/// A request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct HttpRequest {
    /// Path with its query: `/?action=stream`.
    pub path: String,
    /// Body of a form.
    pub body: Bytes,
}

impl HttpRequest {
    /// True when the request asks for the port's pictures as MJPEG.
    pub fn wants_stream(&self) -> bool {
        self.path.starts_with("/?action=stream")
    }
}

/// The end of a head: where it ends, and where what follows begins.
fn head_end(bytes: &[u8]) -> Option<(usize, usize)> {
    let mut at = 0;
    // An empty line, however lines end: YARP's own requests mix both ways.
    while let Some(found) = bytes.get(at..)?.iter().position(|&byte| byte == b'\n') {
        let next = at + found + 1;
        match bytes.get(next..) {
            Some([b'\n', ..]) => return Some((next, next + 1)),
            Some([b'\r', b'\n', ..]) => return Some((next, next + 2)),
            _ => at = next,
        }
    }
    None
}

/// The value of a header, by its name in small letters.
pub(super) fn header<'a>(head: &'a str, name: &str) -> Option<&'a str> {
    head.lines().find_map(|line| {
        let (key, value) = line.split_once(':')?;
        key.trim().eq_ignore_ascii_case(name).then(|| value.trim())
    })
}

/// The head at the start of `buffer`, and where what follows it begins; none where it is incomplete.
pub(super) fn head(buffer: &[u8]) -> Result<Option<(String, usize)>, Fault> {
    match head_end(buffer) {
        Some((end, next)) if end <= MAX_HEAD => {
            let head = buffer.get(..end).unwrap_or_default();
            Ok(Some((String::from_utf8_lossy(head).into_owned(), next)))
        }
        None if buffer.len() <= MAX_HEAD => Ok(None),
        _ => Err(Fault::LineTooLong(MAX_HEAD)),
    }
}

/// Takes a request off.
pub(super) fn request(buffer: &mut BytesMut) -> Result<Progress<HttpRequest>, Fault> {
    let Some((head, next)) = head(buffer)? else { return Ok(Progress::Need(1)) };
    let length = header(&head, "content-length").unwrap_or("0");
    let length: usize = length
        .parse()
        .map_err(|_not_a_number| Fault::BadHttp(format!("Content-Length is {length:?}")))?;
    if length > MAX_BODY {
        return Err(Fault::MessageTooLarge { size: length, limit: MAX_BODY });
    }
    if buffer.len() < next + length {
        return Ok(Progress::Need(next + length - buffer.len()));
    }
    buffer.advance(next);
    let body = buffer.split_to(length).freeze();
    let mut words = head.lines().next().unwrap_or_default().split_whitespace();
    let path = words.nth(1).unwrap_or_default().to_owned();
    Ok(Progress::Event(HttpRequest { path, body }))
}

/// An answer with a page, after which the connection closes.
pub fn page(body: &str) -> Vec<u8> {
    let length = body.len();
    format!(
        "HTTP/1.1 200 OK\r\nContent-Type: text/html; charset=utf-8\r\nContent-Length: {length}\r\n\
         Connection: close\r\n\r\n{body}"
    )
    .into_bytes()
}

/// Text that a browser shows as it is, wherever it stands.
pub(crate) fn escape(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            '\'' => safe.push_str("&#39;"),
            other => safe.push(other),
        }
    }
    safe
}

/// An answer that refuses a stream of pictures, after which the connection closes.
pub fn not_acceptable(reason: &str) -> Vec<u8> {
    let length = reason.len() + 2;
    format!(
        "HTTP/1.1 406 Not Acceptable\r\nContent-Type: text/plain; charset=utf-8\r\n\
         Content-Length: {length}\r\nConnection: close\r\n\r\n{reason}\r\n"
    )
    .into_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> (Result<Progress<HttpRequest>, Fault>, usize) {
        let mut buffer = BytesMut::from(text);
        (request(&mut buffer), buffer.len())
    }

    #[test]
    fn requests_end_with_an_empty_line() {
        let (found, rest) = read("GET /?action=stream\n\n HTTP/1.1\nHost: x\r\n\n");
        let Ok(Progress::Event(request)) = found else { panic!("{found:?}") };
        assert!(request.wants_stream());
        assert_eq!(rest, 20, "what YARP writes behind its own first empty line");
        let (found, _) = read("POST /form HTTP/1.1\r\ncontent-length: 6\r\n\r\ndata=1");
        let Ok(Progress::Event(request)) = found else { panic!("{found:?}") };
        assert_eq!((&*request.path, &request.body[..]), ("/form", &b"data=1"[..]));
        assert_eq!(read("GET / HTTP/1.1\r\nHost: x\r\n").0, Ok(Progress::Need(1)));
        assert!(read("POST /form HTTP/1.1\r\nContent-Length: 1e9\r\n\r\n").0.is_err());
        assert!(read("POST /form HTTP/1.1\r\nContent-Length: 100000\r\n\r\n").0.is_err());
    }
}
