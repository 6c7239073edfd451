//! Target of the plug-ins that read tensors of other libraries.

use bytes::Bytes;
use wrapyfi_data::Limits;
use wrapyfi_data::types::Value;
use wrapyfi_endpoint::codec::json as text;

use crate::{LIMITS, bounded};

/// A tensor's file: the zip of `torch.save`, a pickle of Paddle or Trax, or a `.npy`. The first byte
/// chooses whose.
pub fn plugin_tensor(data: &[u8]) {
    // The unpacked array may be longer than its file, but not than a message.
    const LIMIT: usize = 256 << 10;
    const WIDE: Limits = Limits { message_bytes: 16 * LIMIT, ..LIMITS };
    let limits = Limits { message_bytes: LIMIT, ..LIMITS };
    let Some((&choice, file)) = data.split_first() else { return };
    let base64 = base64(file);
    let body = match choice % 6 {
        0 => format!(r#""PytorchTensor", "{base64}", "cuda:0""#),
        1 => format!(r#""PaddleTensor", "{base64}", "gpu:0""#),
        2 => {
            let latin1: String = file.iter().map(|byte| format!("\\u00{byte:02x}")).collect();
            format!(r#""TraxArray", "{latin1}""#)
        }
        3 => format!(r#""JAXTensor", "{base64}""#),
        4 => format!(r#""MXNetTensor", "{base64}", "cpu:0""#),
        _ => format!(r#""CuPyArray", "{base64}", "cuda:0""#),
    };
    let message = Bytes::from(format!(r#"{{"__wrapyfi__": [{body}]}}"#));
    if message.len() > LIMIT {
        return;
    }
    // The objects of a pickle may take four times the limit.
    let read = bounded(message.len() + LIMIT, 8, || {
        text::decode(&message, &limits, &wrapyfi_plugins::standard())
    });
    let value = read.expect("an object that is refused is carried");
    let Value::Tensor(tensor) = &value else {
        assert_eq!(text::encode(&value, &wrapyfi_plugins::standard()).expect("carried"), message);
        return;
    };
    assert_eq!(tensor.data().len(), tensor.element_count() * tensor.dtype().size());
    assert!(tensor.data().len() <= LIMIT);
    let written =
        text::encode(&value, &wrapyfi_plugins::standard()).expect("what was read can be written");
    let again = text::decode(&written.clone().into(), &WIDE, &wrapyfi_plugins::standard())
        .expect("what was written is read");
    let rewritten =
        text::encode(&again, &wrapyfi_plugins::standard()).expect("what was read can be written");
    assert!(written == rewritten, "changed by writing and reading");
}

pub(crate) fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let letter = |group: u32, place: u32| {
        let index = (group >> (18 - 6 * place)) & 63;
        LETTERS.get(index as usize).map_or('=', |&letter| char::from(letter))
    };
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let byte = |index| u32::from(chunk.get(index).copied().unwrap_or(0));
        let group = byte(0) << 16 | byte(1) << 8 | byte(2);
        text.extend(
            (0..4).map(
                |place| {
                    if place as usize <= chunk.len() { letter(group, place) } else { '=' }
                },
            ),
        );
    }
    text
}
