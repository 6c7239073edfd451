//! Configuration files, and the limit of files and connections that this process may have open.

use std::fs::File;
use std::io::Read as _;
use std::path::Path;

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use serde_saphyr::Location;
use wrapyfi_engine::{MAX_CONFIG_BYTES, Spanned};

/// Raises the limit of open files to what the system allows this user.
///
/// The usual 1024 is for programs that use `select`. An endpoint on ZeroMQ takes five files, so that some two hundred
/// would be all.
pub fn raise_limit() {
    let limit = getrlimit(Resource::Nofile);
    let most = Rlimit { current: limit.maximum, maximum: limit.maximum };
    if limit.current != limit.maximum
        && let Err(error) = setrlimit(Resource::Nofile, most)
    {
        tracing::debug!(%error, "the limit of open files stays as it is");
    }
}

/// Reads a configuration file of at most [`MAX_CONFIG_BYTES`].
///
/// # Errors
/// When it cannot be read, is longer, or is no UTF-8 text: with the line of the first byte that is none.
pub fn read_file(file: &Path) -> std::io::Result<String> {
    let mut bytes = Vec::new();
    File::open(file)?.take(MAX_CONFIG_BYTES as u64 + 1).read_to_end(&mut bytes)?;
    String::from_utf8(bytes).map_err(|error| {
        let (text, wrong) = error.as_bytes().split_at(error.utf8_error().valid_up_to());
        let line = 1 + text.iter().filter(|byte| **byte == b'\n').count();
        let byte = wrong.first().copied().unwrap_or_default();
        let told = format!("line {line}: byte {byte:#04x} is no UTF-8; save the file as UTF-8");
        std::io::Error::new(std::io::ErrorKind::InvalidData, told)
    })
}

/// A setting that stands in no file.
pub(crate) fn in_no_file<T>(value: T) -> Spanned<T> {
    Spanned::new(value, Location::UNKNOWN, Location::UNKNOWN)
}
