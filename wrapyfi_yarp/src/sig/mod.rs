//! Images, sounds, vectors, matrices and time stamps: YARP's library `sig`.

mod stamp;

pub use stamp::Stamp;
