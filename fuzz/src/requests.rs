//! The target of requests and replies on ZeroMQ.

use bytes::Bytes;
use wrapyfi_data::Limits;
use wrapyfi_data::types::{Encoding, ServiceKind, Stamp};
use wrapyfi_endpoint::ServiceSpec;
use wrapyfi_endpoint::codec::requests;
use wrapyfi_zeromq::codec::mark;

use crate::{LIMITS, bounded};

/// Memory a value may take for each byte of its text, as for native objects.
const TEXT: usize = 160;
/// Room for what is packed inside: a picture from a file of any size below the limit.
const UNPACKED: usize = 8 * LIMITS.message_bytes;

/// A request, a reply of Python's, or a reply of ours. The first byte chooses the kind of service, the
/// second what it is; a reply of ours begins with its mark.
pub fn zeromq_requests(data: &[u8]) {
    let [choice, form, body @ ..] = data else { return };
    let kinds = ServiceKind::ALL;
    let Some(&kind) = kinds.get(usize::from(choice & 0x7f) % kinds.len()) else { return };
    let mut spec = ServiceSpec::new("/x", kind);
    spec.limits = LIMITS;
    spec.color_order = if choice & 0x80 == 0 { Encoding::Bgr8 } else { Encoding::Rgb8 };
    match form % 3 {
        0 => request(body, &spec),
        1 => reply(body, &spec),
        _ => binary(body, &spec),
    }
}

/// Service with wider limits, for reading back: a written message may be longer.
fn wide(spec: &ServiceSpec) -> ServiceSpec {
    let limits = Limits { message_bytes: 16 * LIMITS.message_bytes, ..LIMITS };
    ServiceSpec { limits, ..spec.clone() }
}

fn request(body: &[u8], spec: &ServiceSpec) {
    let text = Bytes::copy_from_slice(body);
    let size = body.len() + UNPACKED / TEXT;
    let Ok(request) = bounded(size, TEXT, || requests::decode_request(&text, spec)) else {
        return;
    };
    let wide = wide(spec);
    // A keyword that is no Unicode has no name.
    let Ok(written) = requests::encode_request(&request, &wide) else { return };
    let again = requests::decode_request(&written.clone().into(), &wide).expect("its own text");
    let rewritten = requests::encode_request(&again, &wide).expect("what was read can be written");
    assert!(written == rewritten, "changed by writing and reading");
    let through = requests::from_value(requests::to_value(&request.call().expect("a call")))
        .expect("its own value");
    let rewritten = requests::encode_request(&through, &wide).expect("what was read");
    assert!(written == rewritten, "changed by the form of ROS 2");
}

fn reply(body: &[u8], spec: &ServiceSpec) {
    let now = Stamp { sec: 1, nanosec: 2 };
    let text = Bytes::copy_from_slice(body);
    let size = body.len() + UNPACKED / TEXT;
    let Ok(answer) = bounded(size, TEXT, || requests::decode_reply(&text, spec, now)) else {
        return;
    };
    let wide = wide(spec);
    let payload = match answer {
        Ok(payload) => payload,
        Err(told) => {
            let written = requests::encode_error(&told);
            let again = requests::decode_reply(&written.into(), &wide, now);
            assert_eq!(again, Ok(Err(told)), "an error changed");
            return;
        }
    };
    assert_eq!(payload.data_type(), spec.kind.data_type());
    // A picture of the other form is converted on the way out, or refused.
    let Ok(written) = requests::encode_reply(&payload, &wide) else { return };
    let again = requests::decode_reply(&written.clone().into(), &wide, now)
        .expect("what was written is read")
        .expect("no error");
    if spec.kind == ServiceKind::CompressedImage {
        return;
    }
    let rewritten = requests::encode_reply(&again, &wide).expect("what was read can be written");
    assert!(written == rewritten, "changed by writing and reading");
}

fn binary(body: &[u8], spec: &ServiceSpec) {
    let Some((frame, body)) = body.split_at_checked(mark::SIZE) else { return };
    let Some(read) = mark::Mark::decode(frame) else { return };
    assert_eq!(read.encode(), frame, "a mark changed");
    let body = Bytes::copy_from_slice(body);
    let size = body.len() + UNPACKED / TEXT;
    let read = bounded(size, TEXT, || mark::decode(read.content, &body, spec));
    let Ok(payload) = read else { return };
    assert_eq!(payload.data_type(), spec.kind.data_type());
    let wide = wide(spec);
    let (content, written) = mark::encode(&payload, &wide).expect("what was read");
    let again = mark::decode(content, &written, &wide).expect("what was written");
    let (_, rewritten) = mark::encode(&again, &wide).expect("what was read");
    assert!(written == rewritten, "changed by writing and reading");
}
