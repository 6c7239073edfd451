//! Options of images and sound, checked on both sides as Wrapyfi does.
//!
//! An option that is not written is not checked: an image method without options carries any image.

use super::settings::jpeg_quality;
use wrapyfi_data::returned::PayloadError;
use wrapyfi_data::types::{
    AudioChunk, CompressedFormat, Encoding, Image, Payload, Pixels, RawPixels,
};
use wrapyfi_endpoint::codec::jpeg;
use wrapyfi_endpoint::method::{OptionError, Options};

/// Size, channels and rate that the payloads of one value must have.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(super) struct Rules {
    width: Option<u32>,
    height: Option<u32>,
    rgb: Option<bool>,
    fp: Option<bool>,
    channels: Option<u8>,
    rate: Option<u32>,
    chunk: Option<u32>,
    /// Quality of JPEG, where it is written.
    quality: Option<u8>,
}

impl Rules {
    pub(super) fn from_options(options: &Options) -> Result<Self, OptionError> {
        // -1 is any, as in Wrapyfi.
        let size = |name| -> Result<Option<u32>, OptionError> {
            match options.number::<i64>(name)? {
                None | Some(-1) => Ok(None),
                Some(_) => options.number(name),
            }
        };
        let channels = match size("channels")? {
            None => None,
            Some(_) => options.number("channels")?,
        };
        Ok(Self {
            width: size("width")?,
            height: size("height")?,
            rgb: options.switch("rgb")?,
            fp: options.switch("fp")?,
            channels,
            rate: size("rate")?,
            chunk: size("chunk")?,
            quality: jpeg_quality(options)?,
        })
    }

    /// Checks a payload that is to be sent, and compresses it where an option says how.
    pub(super) fn apply(&self, payload: Payload) -> Result<Payload, PayloadError> {
        self.check(&payload)?;
        match (payload, self.quality) {
            (
                Payload::Image(Image { stamp, frame_id, pixels: Pixels::Raw(raw) }),
                Some(quality),
            ) => {
                let data = jpeg::encode(&raw, quality)?;
                let pixels = Pixels::Compressed { format: CompressedFormat::Jpeg, data };
                Ok(Image { stamp, frame_id, pixels }.into())
            }
            (payload, _) => Ok(payload),
        }
    }

    pub(super) fn check(&self, payload: &Payload) -> Result<(), PayloadError> {
        match payload {
            Payload::Image(image) => match &image.pixels {
                Pixels::Raw(raw) => self.check_pixels(raw),
                // A file is not opened to be measured.
                Pixels::Compressed { .. } => Ok(()),
            },
            Payload::AudioChunk(sound) => self.check_sound(sound),
            Payload::NativeObject(_) | Payload::Properties(_) | Payload::RosMessage(_) => Ok(()),
        }
    }

    fn check_pixels(&self, raw: &RawPixels) -> Result<(), PayloadError> {
        compare("the image's width", "width", self.width, &raw.width)?;
        compare("the image's height", "height", self.height, &raw.height)?;
        let is_float = matches!(raw.encoding, Encoding::F32C1 | Encoding::F32C3);
        let is_other = |rgb: &bool| raw.encoding.channels() != if *rgb { 3 } else { 1 };
        let of_rgb = self.rgb.filter(is_other).map(|rgb| ("rgb", rgb));
        let of_fp = self.fp.filter(|fp| *fp != is_float).map(|fp| ("fp", fp));
        match of_rgb.or(of_fp) {
            None => Ok(()),
            Some((option, wanted)) => Err(PayloadError::Rule {
                what: "the image",
                option,
                wanted: wanted.to_string(),
                actual: raw.encoding.to_string(),
            }),
        }
    }

    fn check_sound(&self, sound: &AudioChunk) -> Result<(), PayloadError> {
        compare("the number of channels", "channels", self.channels, &sound.channels)?;
        compare("the sample rate", "rate", self.rate, &sound.sample_rate)?;
        compare("the chunk's length", "chunk", self.chunk, &sound.frames)
    }
}

fn compare<T: PartialEq + ToString>(
    what: &'static str,
    option: &'static str,
    wanted: Option<T>,
    actual: &T,
) -> Result<(), PayloadError> {
    match wanted {
        Some(wanted) if wanted != *actual => Err(PayloadError::Rule {
            what,
            option,
            wanted: wanted.to_string(),
            actual: actual.to_string(),
        }),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wrapyfi_data::types::{SampleFormat, Stamp};
    use wrapyfi_endpoint::method::OptionValue;

    fn rules(options: &[(&str, OptionValue)]) -> Rules {
        let options = options
            .iter()
            .fold(Options::default(), |all, (name, value)| all.with(*name, value.clone()));
        Rules::from_options(&options).unwrap()
    }

    #[test]
    fn images_are_measured_by_what_is_written() {
        let raw = RawPixels::dense(2, 1, Encoding::Mono8, vec![0; 2]).unwrap();
        let image = Payload::from(Image::new(Stamp::default(), raw));
        assert_eq!(rules(&[]).check(&image), Ok(()));
        assert_eq!(rules(&[("width", OptionValue::Integer(-1))]).check(&image), Ok(()));
        let error = rules(&[("width", OptionValue::Integer(3))]).check(&image).unwrap_err();
        assert_eq!(
            error.to_string(),
            "the image's width is 2, and the option says width = 3: change one of them"
        );
        let error = rules(&[("rgb", OptionValue::Switch(true))]).check(&image).unwrap_err();
        assert!(
            error.to_string().starts_with("the image is mono8, and the option says rgb = true")
        );
        assert!(rules(&[("fp", OptionValue::Switch(true))]).check(&image).is_err());
        assert!(rules(&[("fp", OptionValue::Switch(false))]).check(&image).is_ok());
    }

    #[test]
    fn jpeg_has_the_quality_that_is_written() {
        let noise: Vec<u8> = (0..64 * 64 * 3_u32).map(|n| (n * 7919 % 251) as u8).collect();
        let raw = RawPixels::dense(64, 64, Encoding::Rgb8, noise).unwrap();
        let image = Payload::from(Image::new(Stamp::default(), raw));
        let with = |options: Options| {
            Rules::from_options(&Options::default().with("jpg", OptionValue::Map(options)))
        };
        let length = |quality| {
            let options = Options::default().with("quality", OptionValue::Integer(quality));
            match with(options).unwrap().apply(image.clone()).unwrap() {
                Payload::Image(Image { pixels: Pixels::Compressed { data, .. }, .. }) => data.len(),
                other => panic!("{other:?}"),
            }
        };
        assert!(length(10) * 2 < length(95), "{} {}", length(10), length(95));
        // The option `encoder` is for Python; without a quality the endpoint compresses.
        let options = Options::default().with("encoder", OptionValue::Text("pil".into()));
        assert_eq!(with(options).unwrap().apply(image.clone()), Ok(image.clone()));
        for (name, value, words) in [
            ("quality", 101, "option quality is 101, and should be a whole number from 0 to 100"),
            ("quallity", 60, "option jpg(quallity) is 60, and should be quality, encoder or"),
        ] {
            let options = Options::default().with(name, OptionValue::Integer(value));
            let error = with(options).unwrap_err().to_string();
            assert!(error.starts_with(words), "{error}");
        }
    }

    #[test]
    fn sound_is_measured_by_what_is_written() {
        let sound = AudioChunk::new(Stamp::default(), 1, 2, 8000, SampleFormat::S16Le, vec![0; 4]);
        let sound = Payload::from(sound.unwrap());
        assert!(rules(&[("channels", OptionValue::Integer(2))]).check(&sound).is_ok());
        assert!(rules(&[("rate", OptionValue::Integer(44_100))]).check(&sound).is_err());
        assert!(rules(&[("chunk", OptionValue::Integer(2))]).check(&sound).is_err());
        assert!(
            Rules::from_options(&Options::default().with("rate", OptionValue::Text("x".into())))
                .is_err()
        );
    }
}
