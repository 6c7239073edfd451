//! Pictures and sound for the sensor examples.

use std::path::PathBuf;

use crate::{Result, TestEnv};

/// Files that cameras and microphones of examples take.
#[derive(Debug)]
pub struct Scenes {
    /// Folder with the folders `frames`, `sad`, `happy` and `corner`, and `voice.wav`.
    pub folder: PathBuf,
    /// Hash of the pixels of each file in `frames`.
    pub frames: Vec<String>,
    /// Hash of the samples in `voice.wav` as floats.
    pub voice: String,
}

impl TestEnv {
    /// Pictures and sound in a folder of the test.
    pub fn scenes(&self) -> Result<Scenes> {
        let folder = self.path("scenes");
        std::fs::create_dir(&folder)?;
        let maker = self.peer("make_scenes.py", &folder.display().to_string())?;
        let frames = maker.event("frames")?;
        let hashes = frames.get("sha256").and_then(|hashes| hashes.as_array());
        let frames = hashes.into_iter().flatten().filter_map(|hash| hash.as_str());
        let frames = frames.map(str::to_owned).collect();
        let voice = crate::texts(&[maker.event("voice")?], "sha256").concat();
        Ok(Scenes { folder, frames, voice })
    }
}
