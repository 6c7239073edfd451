//! Answers of a name server to one-line requests, without sockets.
//!
//! ```text
//!   registration name /cam ip 10.0.0.1 port 10002 type tcp\r\n
//!   *** end of message\r\n        the first line of more than one letter that begins with * or [
//! ```

use bytes::BytesMut;

use crate::WireLimits;
use crate::port::names::Registration;
use crate::wire::Progress;
use crate::wire::text::{AnswerReader, Lined};

/// True for the line that ends an answer.
pub(crate) fn is_end(line: &[u8]) -> bool {
    line.len() > 1 && matches!(line.first(), Some(b'*' | b'['))
}

/// The ports in an answer that is there as a whole; none where it does not end or is too long.
pub(crate) fn read_answer(bytes: &[u8], limits: &WireLimits) -> Option<Vec<Registration>> {
    let mut buffer = BytesMut::from(bytes);
    match AnswerReader::new(limits, is_end).poll(&mut buffer) {
        Ok(Progress::Event(Lined { lines, .. })) => {
            Some(lines.iter().filter_map(|line| registration(line)).collect())
        }
        _ => None,
    }
}

/// Address of a port, from a line of a name server.
pub(crate) fn registration(line: &[u8]) -> Option<Registration> {
    let rest = std::str::from_utf8(line).ok()?.trim_end().strip_prefix("registration name ")?;
    // From behind: a name may be empty, and then two blanks follow each other.
    let (rest, carrier) = rest.rsplit_once(" type ")?;
    let (rest, port) = rest.rsplit_once(" port ")?;
    let (name, host) =
        rest.rsplit_once(" ip ").or_else(|| Some(("", rest.strip_prefix("ip ")?)))?;
    Some(Registration {
        name: name.to_owned(),
        host: host.to_owned(),
        port: port.parse().ok().filter(|&port| port != 0)?,
        carrier: carrier.to_owned(),
    })
}

/// The values in `port NAME property KEY = V1 V2`.
pub(crate) fn property(line: &[u8], name: &str, key: &str) -> Option<Vec<String>> {
    let line = std::str::from_utf8(line).ok()?;
    let values = line.strip_prefix(&format!("port {name} property {key} ="))?;
    Some(values.split_ascii_whitespace().map(str::to_owned).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_registrations_are_read() {
        let found = registration(b"registration name /a ip 127.0.0.1 port 10002 type tcp").unwrap();
        assert_eq!((&*found.name, &*found.host, found.port), ("/a", "127.0.0.1", 10_002));
        // ns_text_line_edge_cases.json registers a port without a name.
        let line = b"registration name  ip 127.0.0.1 port 10005 type tcp";
        assert_eq!(registration(line).unwrap().name, "");
        for line in [
            &b"registration name /a ip 127.0.0.1 port 70000 type tcp"[..],
            b"registration name /a ip 127.0.0.1 port 0 type tcp",
            b"registration name /a ip 127.0.0.1",
            b"port /a property b = c",
            b"\xff",
            b"",
        ] {
            assert_eq!(registration(line), None, "{}", String::from_utf8_lossy(line));
        }
    }

    #[test]
    fn lines_of_properties_are_read() {
        let values = |line: &str| property(line.as_bytes(), "/a", "color");
        assert_eq!(values("port /a property color = 5 red").unwrap(), ["5", "red"]);
        assert_eq!(values("port /a property color =").unwrap(), [""; 0]);
        assert_eq!(values("port /b property color = 5"), None);
    }

    #[test]
    fn an_answer_ends_with_its_last_line_and_is_bounded() {
        let mut reader = AnswerReader::new(&WireLimits::default(), is_end);
        let mut buffer = BytesMut::from("one\r\n*\r\n\r\n*** end");
        assert_eq!(reader.poll(&mut buffer), Ok(Progress::Need(1)));
        buffer.extend_from_slice(b" of message\r\nmore");
        let Ok(Progress::Event(Lined { lines, end })) = reader.poll(&mut buffer) else { panic!() };
        assert_eq!(lines, ["one", "*", ""]);
        assert_eq!((&end[..], &buffer[..]), (&b"*** end of message"[..], &b"more"[..]));

        let limits = WireLimits { max_message_bytes: 1000, ..WireLimits::default() };
        let mut flood = BytesMut::from("\n".repeat(1000).as_str());
        assert!(AnswerReader::new(&limits, is_end).poll(&mut flood).is_err());
    }
}
