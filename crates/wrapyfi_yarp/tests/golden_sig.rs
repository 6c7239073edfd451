//! Every image, sound, vector, matrix, stamp and property recorded from YARP 3.12.3 and 4.0.0.

use crate::golden::{bytes, cases, packed, payloads, text, with_quantum};
use bytes::Bytes;
use wrapyfi_yarp::sig::{Image, Matrix, PixelCode, Rows, Sound, Stamp, Vector};
use wrapyfi_yarp::{Bottle, Dialect, WireLimits};

fn limits() -> WireLimits {
    WireLimits::default()
}

/// The flag beside an image's quantum: YARP 3.10 to 3.12 write 1 and ignore it, 3.9 and older take
/// 1 for upside down, 4.0 writes 0. We write 0.
const FLAG: usize = 42;

fn without_flag(image: &[u8]) -> Vec<u8> {
    let mut image = image.to_vec();
    image[FLAG..FLAG + 2].fill(0);
    image
}

/// Reads the object of a case, writes it, and compares; then reads its bottle form.
fn check(file: &str, dialect: Dialect) {
    for case in cases(file) {
        let name = text(&case, "name");
        let binary = bytes(&case, "binary");
        assert_eq!(binary.len(), case["bytes"].as_u64().unwrap() as usize, "{name}");
        let written = rewrite(name, &binary, dialect);
        if name.starts_with("img") || name.starts_with("flex") {
            assert_eq!(written, without_flag(&binary), "{file}: {name}");
        } else {
            assert_eq!(written, binary, "{file}: {name}");
        }
        let (bottle, used) = Bottle::decode(&binary, dialect, &limits()).unwrap();
        assert_eq!(used, binary.len(), "{file}: {name}: as a bottle");
        assert_eq!(bottle.to_text(), text(&case, "as_bottle_text"), "{file}: {name}: as a bottle");
        // An empty bottle has no kind: these keep theirs only as sounds and vectors.
        if !["snd_empty", "vec0"].contains(&name) {
            assert_eq!(bottle.encode(dialect).unwrap(), binary, "{file}: {name}: bottle written");
        }
    }
}

fn rewrite(name: &str, binary: &Bytes, dialect: Dialect) -> Vec<u8> {
    let limits = &limits();
    match name.split(['_', ':']).next().unwrap() {
        "img" | "flex" => {
            let image = Image::decode(binary, Rows::Announced, limits).unwrap();
            image.encode(Rows::Announced).unwrap()
        }
        "snd" => Sound::decode(binary, dialect, limits).unwrap().encode(dialect).unwrap(),
        "vec" | "vec0" => {
            Vector::<f64>::decode(binary, dialect, limits).unwrap().encode(dialect).unwrap()
        }
        "veci" => Vector::<i32>::decode(binary, dialect, limits).unwrap().encode(dialect).unwrap(),
        "vecf" => Vector::<f32>::decode(binary, dialect, limits).unwrap().encode(dialect).unwrap(),
        "mat" => Matrix::decode(binary, dialect, limits).unwrap().encode(dialect).unwrap(),
        "stamp" => {
            let bottle = Bottle::decode_whole(binary, dialect, limits).unwrap();
            let Stamp { count, time_s } = Stamp::from_bottle(&bottle).unwrap();
            Bottle::from(vec![count.into(), time_s.into()]).encode(dialect).unwrap()
        }
        "prop" => {
            let bottle = Bottle::decode_whole(binary, dialect, limits).unwrap();
            assert_eq!(bottle.find("k1").unwrap().as_i64(), Some(1));
            bottle.encode(dialect).unwrap()
        }
        other => panic!("a new kind of object: {other}"),
    }
}

#[test]
fn corpus_sig() {
    check("corpus_sig.json", Dialect::V3);
}

#[test]
fn v4_corpus_sig() {
    check("v4_corpus_sig.json", Dialect::V4);
}

/// The pixels that the recorder drew: channel `c` of column `x`, row `y` is `16 y + …` counting up.
#[test]
fn pixels_of_corpus_sig() {
    let case = cases("corpus_sig.json").into_iter().find(|case| case["name"] == "img_rgb:3:2");
    let image =
        Image::decode(&bytes(&case.unwrap(), "binary"), Rows::Announced, &limits()).unwrap();
    assert_eq!(
        (image.header().pixel, image.header().width, image.header().height),
        (PixelCode::Rgb, 3, 2)
    );
    assert_eq!(image.header().stride, 16);
    assert_eq!(image.row(0).unwrap(), [1, 2, 3, 4, 5, 6, 7, 8, 9]);
    assert_eq!(image.row(1).unwrap(), [17, 18, 19, 20, 21, 22, 23, 24, 25]);
    assert_eq!(image.row(2), None);
    assert_eq!(packed(&image).len(), 18);
    let dense = Image::from_packed(PixelCode::Rgb, 3, 2, packed(&image)).unwrap();
    assert_eq!(
        with_quantum(&dense, 8).encode(Rows::Announced).unwrap(),
        image.encode(Rows::Announced).unwrap()
    );
}

#[test]
fn images_of_connections() {
    for file in ["images_tcp.json", "images_fast_tcp.json", "images_tcp_envelope.json"] {
        for payload in payloads(file, "c2s") {
            let image = Image::decode(&payload, Rows::Announced, &limits())
                .unwrap_or_else(|e| panic!("{file}: {e}"));
            assert_eq!(image.encode(Rows::Announced).unwrap(), without_flag(&payload), "{file}");
        }
    }
}

#[test]
fn sound_tcp() {
    let sounds: Vec<Sound> = payloads("sound_tcp.json", "c2s")
        .iter()
        .map(|payload| Sound::decode(payload, Dialect::V3, &limits()).unwrap())
        .collect();
    let [mono, stereo, empty] = sounds.as_slice() else { panic!("three sounds were recorded") };
    assert_eq!(mono.to_interleaved(), [-150, -50, 50, 150, 250, 350]);
    assert_eq!((mono.frequency_hz(), mono.channels()), (16000, 1));
    assert_eq!(stereo.to_interleaved(), [1, -256, 2, -512, 3, -768, 4, -1024]);
    assert_eq!((empty.samples(), empty.channels()), (0, 1));
    let again = Sound::from_interleaved(&stereo.to_interleaved(), 2, 44100).unwrap();
    assert_eq!(&again, stereo);
}

#[test]
fn vector_matrix_stamp_tcp() {
    let (v3, limits) = (Dialect::V3, &limits());
    let payloads = payloads("vector_matrix_stamp_tcp.json", "c2s");
    let [doubles, integers, empty, matrix, stamp, property] = payloads.as_slice() else {
        panic!("six objects were recorded")
    };
    assert_eq!(Vector::<f64>::decode(doubles, v3, limits).unwrap().0, [-1.0, 0.5, 2.0]);
    assert_eq!(Vector::<i32>::decode(integers, v3, limits).unwrap().0, [-1, 2, 5]);
    assert!(Vector::<f64>::decode(empty, v3, limits).unwrap().0.is_empty());
    let matrix = Matrix::decode(matrix, v3, limits).unwrap();
    assert_eq!((matrix.rows(), matrix.columns(), matrix.values().get(3)), (2, 3, Some(&10.5)));
    let stamp = Bottle::decode_whole(stamp, v3, limits).unwrap();
    let stamp = Stamp::from_bottle(&stamp).unwrap();
    assert_eq!((stamp.count, stamp.time_s), (7, 1_700_000_000.125));
    assert_eq!(Bottle::decode_whole(property, v3, limits).unwrap().to_text(), "(k1 1)");
    // As in YARP, a vector of other numbers is refused, and so is one of the other dialect.
    let error = Vector::<f64>::decode(integers, v3, limits).unwrap_err().to_string();
    assert!(error.contains("257") && error.contains("as a bottle"), "{error}");
    let error = Vector::<f64>::decode(doubles, Dialect::V4, limits).unwrap_err().to_string();
    assert!(error.contains("set dialect v3"), "{error}");
}

/// Wrapyfi's listener and publisher agree on rows without padding under a header that announces it.
#[test]
fn wrapyfi_image_rgb() {
    let pixels = |payload: &Bytes| {
        let image = Image::decode(payload, Rows::Packed, &limits()).unwrap();
        assert_eq!(
            (image.header().pixel, image.header().width, image.header().height),
            (PixelCode::Rgb, 7, 3)
        );
        (packed(&image), image)
    };
    for (index, payload) in payloads("wrapyfi_image_rgb.json", "c2s").iter().enumerate() {
        let (packed, image) = pixels(payload);
        let first = u8::try_from(index).unwrap();
        assert_eq!(packed[..62], (first..first + 62).collect::<Vec<u8>>());
        // The image that we send to a Wrapyfi listener: the same, and zeros instead of its memory.
        let sent = Bytes::from(image.encode(Rows::Packed).unwrap());
        assert_eq!(sent[..60 + 63], without_flag(payload)[..60 + 63]);
        assert_eq!(sent.len(), payload.len());
        assert_eq!(pixels(&sent).0, packed);
        // A reader that believes the header sees a sheared picture of the same size.
        assert_eq!(Image::decode(payload, Rows::Announced, &limits()).unwrap().header().stride, 24);
    }
}

#[test]
fn wrapyfi_images_of_other_pixels() {
    for (file, pixel, row_bytes) in [
        ("wrapyfi_image_mono.json", PixelCode::Mono, 7),
        ("wrapyfi_image_float.json", PixelCode::Float, 28),
        ("wrapyfi_image_rgbfloat.json", PixelCode::RgbFloat, 84),
    ] {
        for payload in payloads(file, "c2s") {
            let image = Image::decode(&payload, Rows::Packed, &limits()).unwrap();
            assert_eq!((image.header().pixel, image.header().height), (pixel, 3), "{file}");
            assert_eq!(image.row(2).unwrap().len(), row_bytes, "{file}");
        }
    }
}

#[test]
fn wrapyfi_audio() {
    let payloads = payloads("wrapyfi_audio.json", "c2s");
    for payload in &payloads {
        let sound = Sound::decode(payload, Dialect::V3, &limits()).unwrap();
        assert_eq!((sound.samples(), sound.channels(), sound.frequency_hz()), (10, 1, 8000));
        assert_eq!(&sound.encode(Dialect::V3).unwrap(), payload);
    }
}
