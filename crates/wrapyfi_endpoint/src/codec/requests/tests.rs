use proptest::prelude::*;

use super::*;
use wrapyfi_data::types::{AudioChunk, Encoding, RawPixels, SampleFormat, ServiceKind};

const NOW: Stamp = Stamp { sec: 7, nanosec: 5 };

fn spec(kind: ServiceKind) -> ServiceSpec {
    ServiceSpec::new("/x", kind)
}

fn picture(width: u32, height: u32, encoding: Encoding, data: Vec<u8>) -> Payload {
    Image::new(NOW, RawPixels::dense(width, height, encoding, data).unwrap()).into()
}

fn read(kind: ServiceKind, text: &str) -> Result<Payload, DecodeError> {
    let body = Bytes::copy_from_slice(text.as_bytes());
    decode_reply(&body, &spec(kind), NOW).map(|answer| answer.expect("no error"))
}

#[test]
fn requests_as_wrapyfi_writes_them() {
    let spec = spec(ServiceKind::NativeObject);
    let request = Request::new([1.into(), "a".into()]).with(Map::from([("k", 2)]));
    let text = encode_request(&request, &spec).unwrap();
    assert_eq!(text, br#"[{"__wrapyfi__": ["tuple", [1, "a"]]}, {"k": 2}]"#);
    assert_eq!(decode_request(&text.into(), &spec), Ok(request.clone()));
    let plain = Bytes::from_static(br#"[[1,"a"],{"k":2}]"#);
    assert_eq!(decode_request(&plain, &spec), Ok(request.clone()));
    assert_eq!(from_value(to_value(&request.call().unwrap())), Ok(request));
    assert_eq!(from_value(Value::Null), Ok(Request::default()));
    let arguments = Value::List(vec!["get".into(), 0.into()]);
    assert_eq!(from_value(arguments), Ok(Request::new(["get".into(), 0.into()])));
}

#[test]
fn what_is_no_request_is_named() {
    for (text, words) in [
        ("", "the text ends"),
        ("{}", "expected a request [args, kwargs], received dict"),
        ("[]", "received a list of 0"),
        ("[[],{},{}]", "received a list of 3"),
        ("[1,{}]", "received [int, dict]"),
        ("[[],[]]", "received [list, list]"),
        ("\u{feff}[[],{}]", "byte order mark"),
    ] {
        let body = Bytes::copy_from_slice(text.as_bytes());
        let error = decode_request(&body, &spec(ServiceKind::NativeObject)).unwrap_err();
        assert!(error.to_string().contains(words), "{text}: {error}");
    }
    for (value, words) in [
        (
            Value::from(5),
            "expected a list of arguments, or a map with args and kwargs, received int",
        ),
        (Map::from([("args", 1)]).into(), "expected a list under args, received int"),
        (Map::from([("kwargs", 1)]).into(), "expected a map under kwargs, received int"),
    ] {
        assert_eq!(from_value(value).unwrap_err().to_string(), words);
    }
    let request = Request::default().with([(1, 2)].into_iter().collect());
    let error = encode_request(&request, &spec(ServiceKind::NativeObject)).unwrap_err();
    assert!(error.to_string().contains("a keyword that is int"), "{error}");
    let bytes = Request::new([Value::Bytes(Bytes::from_static(b"x"))]);
    assert!(encode_request(&bytes, &spec(ServiceKind::NativeObject)).is_err());
}

#[test]
fn pictures_in_every_encoding_come_back() {
    for encoding in Encoding::ALL {
        let spec = spec(ServiceKind::Image);
        let size = encoding.bytes_per_pixel() * 6;
        let data: Vec<u8> = match encoding {
            Encoding::F32C1 | Encoding::F32C3 => {
                (0..size / 4).flat_map(|n| (n as f32 / 7.0 - 0.5).to_le_bytes()).collect()
            }
            two if two.bytes_per_pixel() == 2 => {
                (0..6_u16).flat_map(|n| (n * 300).to_le_bytes()).collect()
            }
            Encoding::I32C1 => (0..6_i32).flat_map(|n| (n - 3).to_le_bytes()).collect(),
            _ => (0..size).map(|n| u8::try_from(n * 9).unwrap()).collect(),
        };
        let sent = picture(3, 2, encoding, data);
        let body = Bytes::from(encode_reply(&sent, &spec).unwrap());
        let got = decode_reply(&body, &spec, NOW);
        if encoding == Encoding::I32C1 {
            // Wrapyfi's own clients could not take it either.
            assert!(matches!(got, Err(DecodeError::Mismatch { .. })), "{got:?}");
            continue;
        }
        let Ok(Ok(Payload::Image(got))) = got else { panic!("{encoding}: {got:?}") };
        let Payload::Image(sent) = sent else { unreachable!() };
        let (Pixels::Raw(got), Pixels::Raw(sent)) = (got.pixels, sent.pixels) else { panic!() };
        // The lists are in the order of the service, blue first.
        let sent = if matches!(encoding, Encoding::Rgb8 | Encoding::Rgba8) {
            sent.swap_red_blue()
        } else {
            sent
        };
        // Nor do they tell a mosaic from a grey picture.
        let encoding = match (sent.encoding.channels(), sent.encoding.bytes_per_pixel()) {
            (1, 1) => Encoding::Mono8,
            (1, 2) => Encoding::Mono16,
            _ => sent.encoding,
        };
        assert_eq!(got, RawPixels { encoding, ..sent });
    }
}

#[test]
fn a_grey_picture_has_its_channel_for_wrapyfis_client() {
    let grey = picture(2, 1, Encoding::Mono8, vec![0, 255]);
    let body = encode_reply(&grey, &spec(ServiceKind::Image)).unwrap();
    assert_eq!(body, br#"{"img": [[[0], [255]]]}"#);
    assert_eq!(read(ServiceKind::Image, r#"{"img": [[0, 255]]}"#), Ok(grey));
}

#[test]
fn lists_that_are_no_picture_are_refused() {
    for (text, words) in [
        (r#"{"img": [[[0, 1], [2]]]}"#, "a list of 1 among lists of 2"),
        (r#"{"img": [[1, 2], [3]]}"#, "a list of 1 among lists of 2"),
        (r#"{"img": [[1, [2]]]}"#, "an element like those before"),
        (r#"{"img": [[[1], 2]]}"#, "an element like those before"),
        (r#"{"img": [[], [1]]}"#, "a list of 1 among lists of 0"),
        (r#"{"img": [[[[1]]]]}"#, "nesting at $ is 4, the limit is 3"),
        (r#"{"img": [1, 2]}"#, "expected pixels in two or three dimensions"),
        (r#"{"img": [[[1, 2]]]}"#, "received integers from 1 to 2 of shape [1, 1, 2]"),
        (r#"{"img": [[[-1, 2, 3]]]}"#, "received integers from -1 to 3"),
        (r#"{"img": [[[1, 2, 256]]]}"#, "received integers from 1 to 256"),
        (r#"{"img": [[[1, 2, x]]]}"#, "'x' where a number should be"),
        (r#"{"img": [[[1, 2, +3]]]}"#, "'+' where a number should be"),
        (r#"{"img": [[[1, 2, 3]]"#, "the end where ']' should be"),
        (r#"{"img": [[[1, 2, 3]]]} x"#, "'x' where the end should be"),
        (r#"{"aud": [1, 1, 1, [0.0]]}"#, "expected a reply {\"img\": …}"),
        (r#"[[[1, 2, 3]]]"#, "expected a reply {\"img\": …}, received no object"),
        ("", "received no object"),
        (r#"{"img": "#, "the end where '[' should be"),
    ] {
        let error = read(ServiceKind::Image, text).unwrap_err().to_string();
        assert!(error.contains(words), "{text}: {error}");
    }
}

#[test]
fn sound_flat_and_nested() {
    let floats = |samples: &[f32]| -> Vec<u8> {
        samples.iter().flat_map(|sample| sample.to_le_bytes()).collect()
    };
    let mono =
        AudioChunk::new(NOW, 2, 1, 8000, SampleFormat::F32Le, floats(&[0.5, -0.25])).unwrap();
    let flat = AudioChunk { is_flat: true, ..mono.clone() };
    for (text, sound) in [
        (r#"{"aud": [2, 1, 8000, [[0.5], [-0.25]]]}"#, mono),
        (r#"{"aud": [2, 1, 8000, [0.5, -0.25]]}"#, flat),
    ] {
        assert_eq!(read(ServiceKind::AudioChunk, text), Ok(sound.clone().into()));
        let body = encode_reply(&sound.into(), &spec(ServiceKind::AudioChunk)).unwrap();
        assert_eq!(body, text.as_bytes());
    }
    let strange = AudioChunk::new(NOW, 1, 2, 1, SampleFormat::F32Le, floats(&[f32::NAN, f32::MAX]));
    let body = encode_reply(&strange.unwrap().into(), &spec(ServiceKind::AudioChunk)).unwrap();
    assert_eq!(body, br#"{"aud": [1, 2, 1, [[NaN, 3.4028234663852886e+38]]]}"#);
    for (text, words) in [
        (r#"{"aud": [2, 1, 8000, [0.5]]}"#, "needs 8 bytes, 4 are there"),
        (r#"{"aud": [1, 256, 8000, [0.5]]}"#, "256 channels, the limit is 255"),
        (r#"{"aud": [1, 0, 8000, [0.5]]}"#, "channel"),
        (r#"{"aud": [1, 1, 0, [0.5]]}"#, "0 Hz"),
        (r#"{"aud": [1, 1, 99999999999, [0.5]]}"#, "a number from 0 to 4294967295"),
        (r#"{"aud": [1, 1, -1, [0.5]]}"#, "a number from 0 to 4294967295"),
        (r#"{"img": [[1]]}"#, "expected a reply {\"aud\": …}"),
    ] {
        let error = read(ServiceKind::AudioChunk, text).unwrap_err().to_string();
        assert!(error.contains(words), "{text}: {error}");
    }
}

#[test]
fn sizes_are_checked_before_anything_is_written_or_read() {
    let mut narrow = spec(ServiceKind::Image);
    narrow.limits.message_bytes = 100;
    let large = picture(10, 10, Encoding::Mono8, vec![0; 100]);
    let error = encode_reply(&large, &narrow);
    assert!(matches!(error, Err(EncodeError::TooLarge { limit: 100, .. })), "{error:?}");
    let body = Bytes::from(encode_reply(&large, &spec(ServiceKind::Image)).unwrap());
    let error = decode_reply(&body, &narrow, NOW);
    assert!(matches!(error, Err(DecodeError::TooLarge { limit: 100, .. })), "{error:?}");
}

#[test]
fn errors_are_told_apart_from_values() {
    let text = encode_error("no \"camera\" is open");
    let shown = str::from_utf8(&text).unwrap();
    assert_eq!(
        shown,
        r#"{"error": "no \"camera\" is open", "__wrapyfi__": ["datetime", "error: no \"camera\" is open"]}"#
    );
    for kind in ServiceKind::ALL {
        let body = Bytes::from(text.clone());
        let told = decode_reply(&body, &spec(kind), NOW).unwrap();
        assert_eq!(told, Err("no \"camera\" is open".to_owned()));
    }
    let value = read(ServiceKind::NativeObject, r#"{"error": "a word"}"#).unwrap();
    assert_eq!(value, Value::from(Map::from([("error", "a word")])).into());
}

#[test]
fn a_reply_of_another_kind_is_refused() {
    let color = picture(2, 1, Encoding::Rgb8, vec![1, 2, 3, 4, 5, 6]);
    let whole = AudioChunk::new(NOW, 1, 2, 8000, SampleFormat::S16Le, vec![1, 2, 3, 4]).unwrap();
    for (kind, payload) in [
        (ServiceKind::Image, color),
        (ServiceKind::AudioChunk, whole.into()),
        (ServiceKind::NativeObject, Value::from(5).into()),
    ] {
        for other in [ServiceKind::Image, ServiceKind::AudioChunk, ServiceKind::NativeObject] {
            let refused = encode_reply(&payload, &spec(other));
            let mismatch = matches!(refused, Err(EncodeError::Mismatch { .. }));
            assert_eq!(mismatch, other != kind, "{refused:?}");
        }
    }
}

#[test]
fn pictures_go_in_the_form_of_the_service_and_come_in_that_of_the_reply() {
    let grey = picture(8, 8, Encoding::Mono8, vec![100; 64]);
    let (file, lists) = (spec(ServiceKind::CompressedImage), spec(ServiceKind::Image));
    let refused = encode_reply(&grey, &file);
    assert!(matches!(refused, Err(EncodeError::Mismatch { .. })), "{refused:?}");
    let picture = file.conversion().unwrap().convert(grey.clone(), || NOW).unwrap();
    let jpeg = Bytes::from(encode_reply(&picture, &file).unwrap());
    assert!(jpeg.starts_with(&[0xFF, 0xD8, 0xFF]));
    let Ok(Ok(got)) = decode_reply(&jpeg, &lists, NOW) else { panic!() };
    assert_eq!(got, picture);
    let Ok(Payload::Image(got)) = lists.conversion().unwrap().convert(got, || NOW) else {
        panic!()
    };
    assert!(matches!(got.pixels, Pixels::Raw(raw) if (raw.width, raw.height) == (8, 8)));
}

proptest! {
    #[test]
    fn any_sound_comes_back(samples: Vec<u32>, rate in 1_u32.., channels in 1_u8..4) {
        let frames = samples.len() / usize::from(channels);
        let used = frames * usize::from(channels);
        let data: Vec<u8> = samples[..used].iter().flat_map(|bits| bits.to_le_bytes()).collect();
        let frames = u32::try_from(frames).unwrap();
        let sound = AudioChunk::new(NOW, frames, channels, rate, SampleFormat::F32Le, data).unwrap();
        let spec = spec(ServiceKind::AudioChunk);
        let body = Bytes::from(encode_reply(&sound.clone().into(), &spec).unwrap());
        let Ok(Ok(Payload::AudioChunk(got))) = decode_reply(&body, &spec, NOW) else { panic!() };
        let floats = |data: &[u8]| -> Vec<f32> {
            data.as_chunks::<4>().0.iter().map(|&sample| f32::from_le_bytes(sample)).collect()
        };
        let (got, sent) = (floats(&got.data), floats(&sound.data));
        prop_assert_eq!(got.len(), sent.len());
        for (got, sent) in got.iter().zip(&sent) {
            prop_assert!(got == sent || got.is_nan() && sent.is_nan(), "{} {}", got, sent);
        }
    }

    #[test]
    fn any_bytes_are_read_or_refused(body: Vec<u8>) {
        let body = Bytes::from(body);
        for kind in ServiceKind::ALL {
            _ = decode_reply(&body, &spec(kind), NOW);
            _ = decode_request(&body, &spec(kind));
        }
    }

    #[test]
    fn lists_are_read_or_refused(text in r#"\{"(img|aud)": ?[\[\]0-9,. eN-]{0,60}\}?"#) {
        for kind in [ServiceKind::Image, ServiceKind::AudioChunk] {
            _ = read(kind, &text);
        }
    }
}
