//! A file that may change: looked at until it is another, and stays so for a while.

use std::os::unix::fs::MetadataExt as _;
use std::path::Path;
use std::time::{Duration, Instant};

use wrapyfi_endpoint::config::read_file;

/// Time after which a file that is gone is complained of: editors take it away for a moment.
const GONE_AFTER: Duration = Duration::from_secs(2);

/// A file as the system sees it: any change of it, or another in its place, is another mark.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Mark([i64; 4], u64, u64);

impl Mark {
    fn of(file: &Path) -> Option<Self> {
        let meta = std::fs::metadata(file).ok()?;
        let times = [meta.mtime(), meta.mtime_nsec(), meta.ctime(), meta.ctime_nsec()];
        Some(Self(times, meta.ino(), meta.len()))
    }
}

/// The file of a configuration, as it was at the last look.
pub(super) struct WatchedFile {
    mark: Option<Mark>,
    /// True when the file is another, and is read once it stays the same.
    is_fresh: bool,
    gone_since: Option<Instant>,
    is_told: bool,
}

impl WatchedFile {
    pub(super) fn new(file: Option<&Path>) -> Self {
        let mark = file.and_then(Mark::of);
        Self { mark, is_fresh: false, gone_since: None, is_told: false }
    }

    /// True when the file has another text than `known`, and has had it for a while.
    pub(super) fn is_other(&mut self, file: &Path, known: &str) -> bool {
        let mark = Mark::of(file);
        if mark.is_none() {
            let since = *self.gone_since.get_or_insert_with(Instant::now);
            if since.elapsed() >= GONE_AFTER && !std::mem::replace(&mut self.is_told, true) {
                tracing::warn!("{} is gone: the routes stay as they are", file.display());
            }
            return false;
        }
        (self.gone_since, self.is_told) = (None, false);
        if mark != self.mark {
            (self.mark, self.is_fresh) = (mark, true);
            return false;
        }
        let is_file = || std::fs::metadata(file).is_ok_and(|meta| meta.is_file());
        // A file that cannot be read counts as changed, so that its reader reports the fault.
        std::mem::take(&mut self.is_fresh)
            && (!is_file() || read_file(file).map_or(true, |text| text != known))
    }
}

#[cfg(test)]
mod tests {
    use wrapyfi_engine::MAX_CONFIG_BYTES;

    use super::*;

    /// A file that is written anew, one put in its place, one that is gone, and one that was only touched.
    #[test]
    fn a_file_is_another_once_it_has_another_text_for_a_while() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("bridge.yaml");
        std::fs::write(&file, "one").unwrap();
        let (mut looked, mut known) = (WatchedFile::new(Some(&file)), "one");
        assert!(!looked.is_other(&file, known));
        std::fs::write(&file, "two").unwrap();
        assert!(!looked.is_other(&file, known), "it may not be all yet");
        assert!(looked.is_other(&file, known));
        known = "two";
        assert!(!looked.is_other(&file, known));
        let beside = folder.path().join("new.yaml");
        std::fs::write(&beside, "three").unwrap();
        std::fs::remove_file(&file).unwrap();
        assert!(!looked.is_other(&file, known));
        std::fs::rename(&beside, &file).unwrap();
        assert!(!looked.is_other(&file, known));
        assert!(looked.is_other(&file, known));
        known = "three";
        std::fs::write(&file, "three").unwrap();
        assert!(!looked.is_other(&file, known));
        assert!(!looked.is_other(&file, known), "its text is the same");
        let endless = read_file(Path::new("/dev/zero")).unwrap();
        assert_eq!(endless.len(), MAX_CONFIG_BYTES + 1);
    }
}
