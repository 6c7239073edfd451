//! Facial expressions: what there is to recognise, and a stand-in for a recogniser.
//!
//! # The recogniser is a stand-in
//!
//! The use case of Wrapyfi's paper has a neural network here. This program has none, and does not
//! pretend to: it looks how bright a frame is, and calls each eighth of the way from black to white by
//! one of the eight names. It shows the chain around a recogniser; put yours in the place of
//! [`stand_in`].
//!
//! ```text
//!   mean of all bytes   0 ── 32 ── 64 ── 96 ── 128 ── 160 ── 192 ── 224 ── 256
//!   is called          anger  contempt  disgust  fear  sadness  neutral  surprise  happiness
//! ```

use serde::{Deserialize, Serialize};
use wrapyfi_core::types::RawPixels;

/// The eight expressions of the paper's participants, from the darkest to the brightest frame.
pub const EXPRESSIONS: [&str; 8] =
    ["anger", "contempt", "disgust", "fear", "sadness", "neutral", "surprise", "happiness"];

/// Mark of a message that no network made.
pub const STAND_IN: &str = "stand-in: mean brightness";

/// The result of a recogniser, a dict in Python.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Recognised {
    /// One of [`EXPRESSIONS`].
    pub expression: String,
    /// Mean of the frame's bytes, rounded down.
    pub brightness: u8,
    /// Recogniser that made the message: [`STAND_IN`].
    pub recogniser: String,
}

/// Calls a frame by its brightness. No recogniser of faces: see above.
#[must_use]
pub fn stand_in(pixels: &RawPixels) -> Option<Recognised> {
    let sum: u64 = pixels.data.iter().map(|&byte| u64::from(byte)).sum();
    let mean = sum.checked_div(pixels.data.len() as u64)?;
    let brightness = u8::try_from(mean).ok()?;
    let expression = EXPRESSIONS.get(usize::from(brightness / 32))?;
    Some(Recognised {
        expression: (*expression).to_owned(),
        brightness,
        recogniser: STAND_IN.to_owned(),
    })
}

/// Colour of Pepper's eyes and chest: red, green, blue.
#[must_use]
pub fn colour(expression: &str) -> [u8; 3] {
    match expression {
        "anger" => [255, 0, 0],
        "contempt" => [160, 80, 0],
        "disgust" => [0, 160, 0],
        "fear" => [128, 0, 128],
        "sadness" => [0, 0, 255],
        "surprise" => [255, 160, 0],
        "happiness" => [255, 255, 0],
        _ => [255, 255, 255],
    }
}

/// Eyebrows and mouth of iCub's face.
#[must_use]
pub fn face(expression: &str) -> &'static str {
    match expression {
        "anger" => ">:(",
        "contempt" => ":/",
        "disgust" => ":S",
        "fear" => "D:",
        "sadness" => ":(",
        "surprise" => ":O",
        "happiness" => ":D",
        _ => ":|",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture;

    #[test]
    fn brightness_has_eight_names() {
        let named = |shade| {
            let frame = picture::bgr(2, 2, vec![shade; 12]).unwrap();
            stand_in(&frame).unwrap().expression
        };
        let names: Vec<_> = (0..8).map(|eighth| named(eighth * 32)).collect();
        assert_eq!(names, EXPRESSIONS);
        assert_eq!((named(31), named(255)), ("anger".to_owned(), "happiness".to_owned()));
        assert_eq!(stand_in(&picture::bgr(0, 0, vec![]).unwrap()), None);
    }

    #[test]
    fn robots_show_each_expression_in_another_way() {
        let different = |shown: Vec<String>| {
            shown.iter().collect::<std::collections::HashSet<_>>().len() == EXPRESSIONS.len()
        };
        assert!(different(EXPRESSIONS.map(|one| format!("{:?}", colour(one))).to_vec()));
        assert!(different(EXPRESSIONS.map(|one| face(one).to_owned()).to_vec()));
    }
}
