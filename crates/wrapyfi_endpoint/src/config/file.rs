//! A configuration file: opened and read so that none is waited for without end, or takes all memory.

use std::fs::File;
use std::io::{Error, ErrorKind, Read as _};
use std::os::unix::fs::FileTypeExt as _;
use std::path::Path;
use std::sync::mpsc;
use std::time::Duration;

use super::problem::MAX_CONFIG_BYTES;

/// Time for which a program may keep the other end of a pipe closed.
const PIPE_TIMEOUT: Duration = Duration::from_secs(3);

/// Opens a file to be read. A named pipe into which no program writes is refused after a while, because the system
/// waits for one without end.
///
/// # Errors
/// When the system refuses, or no program writes.
pub fn open(file: &Path) -> std::io::Result<File> {
    if !std::fs::metadata(file)?.file_type().is_fifo() {
        return File::open(file);
    }
    let (opened, open) = mpsc::channel();
    let path = file.to_owned();
    std::thread::Builder::new().name("open-pipe".to_owned()).spawn(move || {
        // No program hears it after the time is over.
        _ = opened.send(File::open(path));
    })?;
    open.recv_timeout(PIPE_TIMEOUT).unwrap_or_else(|_late| {
        let seconds = PIPE_TIMEOUT.as_secs();
        let told = format!("is a pipe that no program has opened to write within {seconds} s");
        Err(Error::new(ErrorKind::TimedOut, told))
    })
}

/// Reads a configuration file of at most [`MAX_CONFIG_BYTES`].
///
/// # Errors
/// When it cannot be read, is longer, or is no UTF-8 text: with the line of the first byte that is none.
pub fn read_file(file: &Path) -> std::io::Result<String> {
    let mut bytes = Vec::new();
    open(file)?.take(MAX_CONFIG_BYTES as u64 + 1).read_to_end(&mut bytes)?;
    String::from_utf8(bytes).map_err(|error| {
        let (text, wrong) = error.as_bytes().split_at(error.utf8_error().valid_up_to());
        let line = 1 + text.iter().filter(|byte| **byte == b'\n').count();
        let byte = wrong.first().copied().unwrap_or_default();
        let told = format!("line {line}: byte {byte:#04x} is no UTF-8; save the file as UTF-8");
        Error::new(ErrorKind::InvalidData, told)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pipe_is_read_and_one_into_which_nobody_writes_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe.yaml");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let into = pipe.clone();
        let writer = std::thread::spawn(move || std::fs::write(into, "routes: []\n"));
        assert_eq!(read_file(&pipe).unwrap(), "routes: []\n");
        writer.join().unwrap().unwrap();
        let told = read_file(&pipe).unwrap_err().to_string();
        assert!(told.starts_with("is a pipe that no program has opened to write"), "{told}");
    }
}
