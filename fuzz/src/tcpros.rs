//! Targets of what a ROS 1 node hears before any message: connection headers and XML-RPC.

use wrapyfi_ros1::header::{Header, MAX_FIELDS};
use wrapyfi_ros1::xmlrpc::{self, XmlRpcError};

use crate::bounded;

/// Memory for each byte of a header: a field of five bytes is two texts and its place in a map.
const FIELDS: usize = 64;
/// Memory for each byte of XML: an element of seven is a value with what the parser keeps for it.
const XML: usize = 256;

/// A connection header: its size, and what follows.
pub fn tcpros_header(data: &[u8]) {
    let Some((size, body)) = data.split_first_chunk::<4>() else { return };
    // Whatever is announced, no more is read than there may be.
    if let Ok(size) = Header::declared_size(*size) {
        assert!(size <= wrapyfi_ros1::header::MAX_HEADER_BYTES);
    }
    if let Ok(header) = bounded(data.len(), FIELDS, || Header::decode(body)) {
        assert!(header.fields().count() <= MAX_FIELDS);
        let again = header.encode().expect("what was read is no larger than what was there");
        assert_eq!(again.len(), body.len() + 4);
        assert_eq!(Header::decode(again.get(4..).unwrap_or_default()), Ok(header));
    }
}

/// A call, and an answer.
pub fn xmlrpc(data: &[u8]) {
    if let Ok(call) = bounded(data.len(), XML, || xmlrpc::decode_call(data)) {
        // Control characters have a place in our memory and none in XML.
        if let Ok(text) = xmlrpc::encode_call(&call.method, call.params) {
            _ = xmlrpc::decode_call(text.as_bytes());
        }
    }
    match bounded(data.len(), XML, || xmlrpc::decode_reply(data)) {
        Ok(reply) => {
            if let Ok(text) = xmlrpc::encode_reply(reply) {
                _ = xmlrpc::decode_reply(text.as_bytes());
            }
        }
        Err(XmlRpcError::Unusable(reason)) => assert!(reason.len() < 4096),
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}
