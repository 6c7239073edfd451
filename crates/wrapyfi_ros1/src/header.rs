//! The connection header: what two nodes tell each other before the first message.
//!
//! ```text
//!   u32 size │ u32 size │ callerid=/talker │ u32 size │ topic=/chatter │ …      little-endian
//!            └──────────── one field ──────┘
//! ```
//!
//! No socket: [`Header::declared_size`] says how many bytes to read, [`Header::decode`] reads them.
//! Source: the `TCPROS` and `Connection Header` pages of the ROS 1 documentation.

use std::collections::BTreeMap;

/// Largest header, in bytes: the definition of a large type is some 100 KiB.
pub const MAX_HEADER_BYTES: usize = 1 << 20;
/// Most fields in a header; nodes send fewer than ten.
pub const MAX_FIELDS: usize = 256;
/// Field that names the node where `callerid` is a name in its private namespace.
pub(super) const NODE: &str = "wrapyfi_node";
/// Field with the mark of a bridge that publishes a topic by pattern.
pub(super) const MARK: &str = "wrapyfi_bridge";
/// Field of the status of an action that this library offers, or is about to.
pub(super) const OFFER: &str = "wrapyfi_action";

/// Fields by name.
///
/// ```
/// use wrapyfi_ros1::header::Header;
/// let header = Header::new().with("topic", "/chatter").with("md5sum", "*");
/// let bytes = header.encode()?;
/// let (size, body) = bytes.split_at(4);
/// assert_eq!(Header::declared_size(size.try_into()?)?, body.len());
/// assert_eq!(Header::decode(body)?.get("topic"), Some("/chatter"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Header(BTreeMap<String, String>);

/// Error of a connection header that is read or sent.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum HeaderError {
    /// The header is larger than any node sends. Nothing was allocated for it.
    #[error(
        "the connection header is {actual} bytes long, the limit is {MAX_HEADER_BYTES}: is this \
         TCPROS at all?"
    )]
    TooLarge {
        /// Size that it declares, in bytes.
        actual: u64,
    },
    /// The fields are none that a node sends, as the words say.
    #[error("{0}")]
    Malformed(String),
}

impl HeaderError {
    fn field(at: usize, fault: &str) -> Self {
        Self::Malformed(format!("the field at byte {at} of the connection header {fault}"))
    }

    fn truncated(at: usize, needed: u64, left: usize) -> Self {
        Self::field(at, &format!("needs {needed} bytes, {left} are left"))
    }
}

/// Begin of the field whose text may be in another encoding.
const DEFINITION: &[u8] = b"message_definition=";

impl Header {
    /// Header without fields.
    pub fn new() -> Self {
        Self::default()
    }

    /// The same header with one field more, or with another value for it.
    #[must_use]
    pub fn with(mut self, name: impl Into<String>, value: impl Into<String>) -> Self {
        self.0.insert(name.into(), value.into());
        self
    }

    /// The value of a field.
    pub fn get(&self, name: &str) -> Option<&str> {
        self.0.get(name).map(String::as_str)
    }

    /// True where the field is `1`, as nodes write what is on.
    pub fn is_set(&self, name: &str) -> bool {
        self.get(name) == Some("1")
    }

    /// Every field, in order of the names.
    pub fn fields(&self) -> impl Iterator<Item = (&str, &str)> {
        self.0.iter().map(|(name, value)| (name.as_str(), value.as_str()))
    }

    /// Bytes of the header behind the size that is sent first.
    ///
    /// # Errors
    /// When it is larger than [`MAX_HEADER_BYTES`].
    pub fn declared_size(size: [u8; 4]) -> Result<usize, HeaderError> {
        let size = u32::from_le_bytes(size);
        let actual = u64::from(size);
        match usize::try_from(size) {
            Ok(size) if size <= MAX_HEADER_BYTES => Ok(size),
            _ => Err(HeaderError::TooLarge { actual }),
        }
    }

    /// Reads what follows the size.
    ///
    /// # Errors
    /// When the bytes are no fields, or exceed a limit.
    pub fn decode(body: &[u8]) -> Result<Self, HeaderError> {
        if body.len() > MAX_HEADER_BYTES {
            return Err(HeaderError::TooLarge { actual: body.len() as u64 });
        }
        let mut fields = BTreeMap::new();
        let mut rest = body;
        while !rest.is_empty() {
            let at = body.len() - rest.len();
            let Some((size, behind)) = rest.split_first_chunk::<4>() else {
                return Err(HeaderError::truncated(at, 4, rest.len()));
            };
            let needed = u32::from_le_bytes(*size);
            let field =
                usize::try_from(needed).ok().and_then(|needed| behind.split_at_checked(needed));
            let Some((field, behind)) = field else {
                return Err(HeaderError::truncated(at, needed.into(), behind.len()));
            };
            rest = behind;
            let text = match field.strip_prefix(DEFINITION) {
                // Comments of old definitions are in Latin-1, and no program reads them.
                Some(_) => String::from_utf8_lossy(field),
                None => std::str::from_utf8(field).unwrap_or_default().into(),
            };
            // Values may hold the sign, names cannot.
            let Some((name, value)) = text.split_once('=') else {
                return Err(HeaderError::field(at, "is no name=value in UTF-8"));
            };
            if fields.len() >= MAX_FIELDS {
                let text = format!("the connection header has more than {MAX_FIELDS} fields");
                return Err(HeaderError::Malformed(text));
            }
            if fields.insert(name.to_owned(), value.to_owned()).is_some() {
                let text = format!("the connection header has the field {name:?} twice");
                return Err(HeaderError::Malformed(text));
            }
        }
        Ok(Self(fields))
    }

    /// The header with its size in front.
    ///
    /// # Errors
    /// When it would be larger than a peer accepts.
    pub fn encode(&self) -> Result<Vec<u8>, HeaderError> {
        let sizes = self.0.iter().map(|(name, value)| 4 + name.len() + 1 + value.len());
        let body: usize = sizes.sum();
        let size = match u32::try_from(body) {
            Ok(size) if body <= MAX_HEADER_BYTES => size,
            _ => return Err(HeaderError::TooLarge { actual: body as u64 }),
        };
        let mut bytes = Vec::with_capacity(4 + body);
        bytes.extend_from_slice(&size.to_le_bytes());
        for (name, value) in &self.0 {
            let field = name.len() + 1 + value.len();
            // Smaller than the whole, which was just measured.
            bytes.extend_from_slice(&u32::try_from(field).unwrap_or(u32::MAX).to_le_bytes());
            bytes.extend_from_slice(name.as_bytes());
            bytes.push(b'=');
            bytes.extend_from_slice(value.as_bytes());
        }
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Header in the documentation of TCPROS, without the definition.
    const DOCUMENTED: &[u8] = b"\xb0\0\0\0\
        \x20\0\0\0message_definition=string data\n\n\
        \x25\0\0\0callerid=/rostopic_4767_1316912741557\
        \x0a\0\0\0latching=1\
        \x27\0\0\0md5sum=992ce8a1687cec8c8bd883ec73ca41d1\
        \x0e\0\0\0topic=/chatter\
        \x14\0\0\0type=std_msgs/String";

    fn decode(bytes: &[u8]) -> Result<Header, HeaderError> {
        let (size, body) = bytes.split_first_chunk::<4>().unwrap();
        assert_eq!(Header::declared_size(*size)?, body.len());
        Header::decode(body)
    }

    #[test]
    fn the_documented_header_reads() {
        let header = decode(DOCUMENTED).unwrap();
        assert_eq!(header.get("md5sum"), Some("992ce8a1687cec8c8bd883ec73ca41d1"));
        assert_eq!(header.get("message_definition"), Some("string data\n\n"));
        assert!(header.is_set("latching") && !header.is_set("tcp_nodelay"));
        assert_eq!(decode(&header.encode().unwrap()), Ok(header));
    }

    #[test]
    fn values_may_hold_the_sign() {
        let header = Header::decode(b"\x1f\0\0\0message_definition=# 45\xb0\nint8 a").unwrap();
        assert_eq!(header.get("message_definition"), Some("# 45\u{fffd}\nint8 a"));
        assert!(Header::decode(b"\x0b\0\0\0callerid=/\xb0").is_err());
        let header = Header::new().with("message_definition", "int32 A=1\nint32 B=2");
        assert_eq!(decode(&header.encode().unwrap()), Ok(header));
    }

    #[test]
    fn sizes_are_refused_before_anything_is_read() {
        let endless = Header::declared_size([0xff; 4]).unwrap_err();
        assert_eq!(endless, HeaderError::TooLarge { actual: u64::from(u32::MAX) });
        // The first bytes of a web browser.
        let http = Header::declared_size(*b"GET ").unwrap_err();
        assert!(http.to_string().contains("the limit is 1048576"), "{http}");
        let large = Header::new().with("a", "x".repeat(MAX_HEADER_BYTES));
        assert!(matches!(large.encode(), Err(HeaderError::TooLarge { .. })));
    }

    #[test]
    fn what_is_no_field_is_named() {
        let beyond = Header::decode(b"\xff\xff\xff\xffab").unwrap_err();
        assert_eq!(beyond, HeaderError::truncated(0, 0xffff_ffff, 2));
        assert_eq!(
            Header::decode(b"\x03\0\0\0a=b\x01\0").unwrap_err(),
            HeaderError::truncated(7, 4, 2)
        );
        for bytes in [&b"\x02\0\0\0ab"[..], b"\x02\0\0\0=\xff", b"\0\0\0\0"] {
            let error = Header::decode(bytes).unwrap_err().to_string();
            assert!(error.contains("byte 0") && error.contains("name=value"), "{bytes:?}: {error}");
        }
        let twice = b"\x03\0\0\0a=b\x03\0\0\0a=c";
        let error = Header::decode(twice).unwrap_err().to_string();
        assert!(error.contains("the field \"a\" twice"), "{error}");
        let many: Vec<u8> =
            (0..300).flat_map(|n| format!("\x04\0\0\0{n:03}=").into_bytes()).collect();
        let error = Header::decode(&many).unwrap_err().to_string();
        assert!(error.contains("more than 256 fields"), "{error}");
    }

    proptest! {
        #[test]
        fn what_is_written_is_read(
            fields in proptest::collection::btree_map("[^=]{0,20}", ".{0,100}", 0..20)
        ) {
            let header = Header(fields);
            prop_assert_eq!(decode(&header.encode().unwrap()), Ok(header));
        }

        #[test]
        fn any_bytes_are_read_or_refused(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
            if let Ok(header) = Header::decode(&bytes) {
                let again = header.encode().unwrap();
                prop_assert_eq!(again.len(), bytes.len() + 4);
                prop_assert_eq!(decode(&again), Ok(header));
            }
        }
    }
}
