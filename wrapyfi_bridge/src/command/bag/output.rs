//! The files of a recording that is written: a file, or a folder with `metadata.yaml`.

use std::env;
use std::fs::{self, File};
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use wrapyfi_bag::recording::{Compression, Metadata, Writer};

use crate::exit::{Failure, Result};

/// Bytes that are gathered: a larger message is written as it is.
const BUFFER: usize = 64 << 10;

/// Place of a recording.
#[derive(Debug)]
pub(super) struct Place {
    /// The recording itself.
    pub(super) file: PathBuf,
    /// Folder that `ros2 bag` opens; none where the file is all.
    folder: Option<PathBuf>,
}

impl Place {
    /// `NAME.mcap` is a file; any other name that of a folder, in which the file is `NAME_0.mcap`, as of `ros2 bag record`.
    ///
    /// # Errors
    /// Exit code 2 where something is there already, or the name is none.
    pub(super) fn new(path: &Path) -> Result<Self> {
        let shown = path.display();
        if path.exists() {
            return Err(Failure::Usage(format!(
                "{shown} is there already: remove it, or give another name"
            )));
        }
        if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("mcap")) {
            return Ok(Self { file: path.to_owned(), folder: None });
        }
        let name = path.file_name().and_then(|name| name.to_str());
        let name = name.ok_or_else(|| Failure::Usage(format!("{shown} is no name of a folder")))?;
        let file = path.join(format!("{name}_0.mcap"));
        Ok(Self { file, folder: Some(path.to_owned()) })
    }

    /// Creates the file, and the folders that lead to it.
    ///
    /// # Errors
    /// Exit code 1 where the system refuses.
    pub(super) fn create(&self, compression: Compression) -> Result<Writer<BufWriter<File>>> {
        if let Some(folder) = self.file.parent() {
            fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
        }
        let file = File::create_new(&self.file).with_context(|| self.file.display().to_string())?;
        let out = Writer::new(BufWriter::with_capacity(BUFFER, file), compression);
        Ok(out.with_context(|| self.file.display().to_string())?)
    }

    /// Ends the recording, and writes `metadata.yaml` where there is a folder.
    ///
    /// # Errors
    /// Exit code 1 where the system refuses.
    pub(super) fn finish(&self, out: Writer<BufWriter<File>>) -> Result<Metadata> {
        let name = self.file.file_name().unwrap_or_default().to_string_lossy();
        let distro = env::var("ROS_DISTRO").unwrap_or_default();
        let (_, metadata) =
            out.finish(&name, &distro).with_context(|| self.file.display().to_string())?;
        if let Some(folder) = &self.folder {
            let file = folder.join("metadata.yaml");
            fs::write(&file, metadata.to_yaml()).with_context(|| file.display().to_string())?;
        }
        Ok(metadata)
    }

    /// Removes a recording that nothing came to, so that the same command can be given again.
    pub(super) fn remove(&self) {
        // What cannot be removed stays, and says by its name what it is.
        _ = fs::remove_file(&self.file);
        if let Some(folder) = &self.folder {
            _ = fs::remove_file(folder.join("metadata.yaml"));
            _ = fs::remove_dir(folder);
        }
    }
}
