//! Targets of `wrapyfi_yarp`: bottles and what is laid out like them.

use bytes::Bytes;
use wrapyfi_yarp::bottle::Frame;
use wrapyfi_yarp::sig::{Image, Matrix, Rows, Sound, Stamp, Vector};
use wrapyfi_yarp::{Bottle, Dialect, WireLimits};

use crate::bounded;

/// Memory for each byte: an int8 in a list of its kind becomes a value of 40 bytes.
const VALUES: usize = 48;
/// Memory for each byte of text: a digit in brackets becomes a list with room for four values.
const WORDS: usize = 160;
/// Memory for each byte of objects, whose numbers are shared or copied.
const BYTES: usize = 4;

fn limits() -> WireLimits {
    // JSON readers take 128 levels, and a dictionary is two of them.
    WireLimits { max_message_bytes: 1 << 20, max_depth: 40, ..WireLimits::default() }
}

fn dialect(choice: u8) -> Dialect {
    if choice & 1 == 0 { Dialect::V3 } else { Dialect::V4 }
}

/// A bottle as bytes. The first byte chooses the dialect.
pub fn yarp_bottle(data: &[u8]) {
    let Some((&choice, body)) = data.split_first() else { return };
    let (dialect, limits) = (dialect(choice), limits());
    let bytes = Bytes::copy_from_slice(body);
    let read = bounded(body.len(), VALUES, || Bottle::decode(&bytes, dialect, &limits));
    let framed = bounded(body.len(), BYTES, || Bottle::frame(body, dialect, &limits));
    let Ok((bottle, used)) = read else {
        assert!(!matches!(framed, Ok(Frame::Complete(_))), "a frame of what is no bottle");
        return;
    };
    assert_eq!(framed, Ok(Frame::Complete(used)), "another frame");
    for cut in 0..used.min(64) {
        let start = body.get(..cut).expect("the bottle is longer");
        let Ok(Frame::NeedMore(more)) = Bottle::frame(start, dialect, &limits) else {
            panic!("complete after {cut} of {used} bytes");
        };
        assert!(cut + more <= used, "more is asked for than the bottle has");
    }

    // As bytes, because a NaN differs from itself.
    let written = Bytes::from(bottle.encode(dialect).expect("what was read can be written"));
    let (again, length) = Bottle::decode(&written, dialect, &limits).expect("what was written");
    assert_eq!(length, written.len());
    assert!(again.encode(dialect).expect("as before") == written, "changed by writing and reading");

    yarp_text(&[&[choice], bottle.to_text_bytes().as_slice()].concat());
}

/// The text of a bottle. The first byte chooses the dialect.
pub fn yarp_text(data: &[u8]) {
    let Some((&choice, text)) = data.split_first() else { return };
    let (dialect, limits) = (dialect(choice), limits());
    let read = bounded(text.len(), WORDS, || Bottle::from_text_as(text, dialect, &limits));
    let Ok(bottle) = read else { return };
    let written = bottle.to_text_bytes();
    // As in YARP, the text of a vocab need not read as the same, being cut to its letters, brackets
    // and all; and the string null reads as a vocab.
    if written.contains(&b'[') || written.windows(4).any(|word| word == b"null") {
        return;
    }
    let wide = WireLimits { max_message_bytes: usize::MAX, ..limits };
    let again = Bottle::from_text_as(&written, dialect, &wide).expect("what was written is read");
    assert!(again.to_text_bytes() == written, "changed by writing and reading");
}

/// An image, sound, vector, matrix or stamp. The first byte chooses which, and the dialect.
pub fn yarp_object(data: &[u8]) {
    let Some((&choice, body)) = data.split_first() else { return };
    let (dialect, limits) = (dialect(choice), limits());
    let bytes = Bytes::copy_from_slice(body);
    match choice >> 1 {
        0 => image(&bytes, Rows::Announced),
        1 => image(&bytes, Rows::Packed),
        2 => sound(&bytes, dialect),
        3 => {
            let read = bounded(body.len(), BYTES, || Vector::decode(body, dialect, &limits));
            let Ok(vector) = read else { return };
            let vector: Vector<f64> = vector;
            assert!(body.starts_with(&vector.encode(dialect).expect("what was read")));
        }
        4 => {
            let read = bounded(body.len(), BYTES, || Matrix::decode(body, dialect, &limits));
            let Ok(matrix) = read else { return };
            assert_eq!(matrix.values().len(), matrix.rows() * matrix.columns());
            assert!(body.starts_with(&matrix.encode(dialect).expect("what was read")));
        }
        _ => {
            // An envelope comes as text, any length.
            if let Some(stamp) = bounded(body.len(), WORDS, || Stamp::from_envelope(body)) {
                let again = Stamp::from_envelope(stamp.to_envelope().as_bytes());
                assert_eq!(again.expect("what was written").count, stamp.count);
            }
        }
    }
}

fn image(bytes: &Bytes, rows: Rows) {
    let limits = limits();
    let read = bounded(bytes.len(), BYTES, || Image::decode(bytes, rows, &limits));
    let Ok(image) = read else { return };
    let header = image.header();
    assert_eq!(image.data().len(), header.image_bytes());
    let pixels = image.rows().map(<[u8]>::len).sum::<usize>();
    assert!(pixels <= image.data().len(), "pixels beyond the bytes");
    let packed: Vec<u8> = image.rows().flatten().copied().collect();
    let written = image.encode(rows).expect("what was read can be written");
    let again = Image::decode(&written.into(), rows, &limits).expect("what was written is read");
    assert!(again.rows().flatten().copied().eq(packed), "changed by writing and reading");
}

fn sound(bytes: &Bytes, dialect: Dialect) {
    let read = bounded(bytes.len(), BYTES, || Sound::decode(bytes, dialect, &limits()));
    let Ok(sound) = read else { return };
    let interleaved = bounded(bytes.len(), BYTES, || sound.to_interleaved());
    assert_eq!(interleaved.len(), sound.samples() * sound.channels());
    let written = sound.encode(dialect).expect("what was read can be written").into();
    let again = Sound::decode(&written, dialect, &limits()).expect("what was written is read");
    assert_eq!(again.data(), sound.data());
    if sound.channels() > 0 {
        let (channels, frequency) = (sound.channels(), sound.frequency_hz());
        let made = Sound::from_interleaved(&interleaved, channels, frequency);
        assert!(made.expect("its own samples").data() == sound.data(), "changed by interleaving");
    }
}
