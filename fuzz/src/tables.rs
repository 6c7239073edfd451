//! Target of the plug-ins that read tables: pandas, PyArrow, dask.

use bytes::Bytes;
use wrapyfi_data::Limits;
use wrapyfi_data::types::Value;
use wrapyfi_endpoint::codec::json as text;

use crate::tensors::base64;
use crate::{LIMITS, bounded};

/// A table: the first byte chooses the plug-in. For pickles, parts follow, each behind its length
/// in two bytes, little-endian: the pickle, then its buffers. For JSON, the rest is the text.
pub fn plugin_table(data: &[u8]) {
    const LIMIT: usize = 256 << 10;
    const WIDE: Limits = Limits { message_bytes: 64 * LIMIT, ..LIMITS };
    let limits = Limits { message_bytes: LIMIT, ..LIMITS };
    let Some((&choice, rest)) = data.split_first() else { return };
    let body = match choice % 5 {
        0 => pickled("PandasData", rest),
        1 => pickled("PyArrowArray", rest),
        2 => format!(r#""PandasLegacyData", "{}", "DataFrame""#, base64(rest)),
        3 => format!(r#""DaskData", "{}", "DataFrame", 2"#, base64(rest)),
        _ => format!(r#""DaskData", "{}", "Series", 1"#, base64(rest)),
    };
    let message = Bytes::from(format!(r#"{{"__wrapyfi__": [{body}]}}"#));
    if message.len() > LIMIT {
        return;
    }
    // JSON takes sixteen times the limit, an object four times.
    let read = bounded(message.len() + LIMIT, 24, || {
        text::decode(&message, &limits, &wrapyfi_plugins::standard())
    });
    let value = read.expect("an object that is refused is carried");
    if !matches!(value, Value::Table(_)) {
        assert_eq!(text::encode(&value, &wrapyfi_plugins::standard()).expect("carried"), message);
        return;
    }
    // A table that pandas cannot have, such as one with two columns of one label, is an error that
    // says so.
    let Ok(written) = text::encode(&value, &wrapyfi_plugins::standard()) else { return };
    let again = text::decode(&written.clone().into(), &WIDE, &wrapyfi_plugins::standard())
        .expect("what was written is read");
    assert_eq!(again.refusals().map(|(_, reason)| reason).next(), None);
    let rewritten =
        text::encode(&again, &wrapyfi_plugins::standard()).expect("what was read can be written");
    assert!(written == rewritten, "changed by writing and reading");
    let plugins = wrapyfi_plugins::standard();
    let (beside, tensors) = text::encode_with_tensors(&value, &plugins).expect("its graph form");
    text::decode_with_tensors(&beside.into(), &tensors, &WIDE, &plugins).expect("its own text");
}

fn pickled(key: &str, mut rest: &[u8]) -> String {
    let mut parts = Vec::new();
    while let Some((length, behind)) = rest.split_first_chunk::<2>() {
        let length = usize::from(u16::from_le_bytes(*length)).min(behind.len());
        let (part, behind) = behind.split_at(length);
        parts.push(part);
        rest = behind;
    }
    let pickle = parts.first().copied().unwrap_or_default();
    let latin1: String = pickle.iter().map(|byte| format!("\\u00{byte:02x}")).collect();
    let buffers: String =
        parts.iter().skip(1).map(|part| format!(r#", "{}""#, base64(part))).collect();
    format!(r#""{key}", "{latin1}"{buffers}"#)
}
