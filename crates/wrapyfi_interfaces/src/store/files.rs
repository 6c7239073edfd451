//! Access to definition files, so that tests need neither ROS nor a disk.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

/// Reads files.
pub trait FileAccess {
    /// The text of the file at `path`, when it has at most `limit` bytes. Bytes that are not UTF-8
    /// are replaced: they stand in comments.
    ///
    /// # Errors
    /// [`io::ErrorKind::NotFound`] where there is no such file, [`io::ErrorKind::FileTooLarge`]
    /// beyond the limit, and what the system says.
    fn read(&self, path: &Path, limit: usize) -> io::Result<String>;
}

/// The files of this machine.
#[derive(Debug, Clone, Copy, Default)]
pub struct Disk;

impl FileAccess for Disk {
    fn read(&self, path: &Path, limit: usize) -> io::Result<String> {
        let mut bytes = Vec::new();
        // One byte more than allowed tells a file that is too large; its size may be a lie.
        let most = (limit as u64).saturating_add(1);
        File::open(path)?.take(most).read_to_end(&mut bytes)?;
        check_size(bytes.len(), limit)?;
        Ok(String::from_utf8(bytes)
            .unwrap_or_else(|error| String::from_utf8_lossy(error.as_bytes()).into_owned()))
    }
}

/// Files in memory: path and text.
impl FileAccess for BTreeMap<PathBuf, String> {
    fn read(&self, path: &Path, limit: usize) -> io::Result<String> {
        let text = self.get(path).ok_or(io::ErrorKind::NotFound)?;
        check_size(text.len(), limit)?;
        Ok(text.clone())
    }
}

fn check_size(size: usize, limit: usize) -> io::Result<()> {
    if size <= limit {
        return Ok(());
    }
    let text = format!("over the limit of {limit} bytes for a definition");
    Err(io::Error::new(io::ErrorKind::FileTooLarge, text))
}
