//! Images, sounds, vectors, matrices and time stamps: YARP's library `sig`.
//!
//! ```text
//!   payload ──Image::decode──▶ header + rows (shared)      ──Bottle::decode──▶ the same as a list
//!           ──Sound::decode──▶ samples (shared)
//!           ──Vector::decode─▶ numbers (one copy)
//! ```
//!
//! Each object is laid out so that its bytes are a bottle, too: the program that does not know what a port
//! sends reads it as one.

mod error;
mod fields;
mod image;
mod image_header;
mod pixel;
mod sound;
mod stamp;
mod vector;

pub use error::SigError;
pub use image::{Image, Rows};
pub use image_header::{DEFAULT_QUANTUM, IMAGE_HEADER_BYTES, ImageHeader};
pub use pixel::PixelCode;
pub use sound::{SOUND_HEADER_BYTES, Sound};
pub use stamp::Stamp;
pub use vector::{Matrix, Number, Vector};
