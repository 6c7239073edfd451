//! Listings of the guides as a reader has them: in a crate of its own, with nothing but what the guide names.

/// The guides, whose code is compiled.
#[cfg(doctest)]
#[doc = include_str!("../../../README.md")]
#[doc = include_str!("../../../docs/rust.md")]
#[doc = include_str!("../../../docs/reference/communicator.md")]
pub struct Guide;

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "in a test a panic is the right answer")]
mod tests {
    use std::path::Path;
    use std::process::Command;

    const GUIDES: [&str; 3] = [
        include_str!("../../../docs/rust.md"),
        include_str!("../../../docs/reference/communicator.md"),
        include_str!("../../../README.md"),
    ];

    /// Listings that begin with a line.
    fn listings<'a>(guide: &'a str, fence: &str) -> Vec<&'a str> {
        let rest = guide.split(fence).skip(1);
        rest.map(|text| text.split("\n```").next().unwrap().trim_start()).collect()
    }

    #[test]
    fn every_listing_is_compiled() {
        for guide in GUIDES {
            assert!(!guide.contains("```rust,ignore"), "a listing that is not compiled");
        }
    }

    #[test]
    fn the_manifest_that_the_guide_shows_is_one() {
        let shown = *listings(GUIDES[0], "```toml\n").first().unwrap();
        let repository = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let own = shown.replace("../wrapyfi/", &format!("{}/", repository.display()));
        assert_ne!(own, shown);
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("src")).unwrap();
        std::fs::write(folder.path().join("Cargo.toml"), &own).unwrap();
        let main = *listings(GUIDES[0], "```rust,no_run\n").first().unwrap();
        std::fs::write(folder.path().join("src/main.rs"), main).unwrap();
        let cargo = Command::new(env!("CARGO"))
            .args(["metadata", "--no-deps", "--offline", "--format-version", "1"])
            .current_dir(folder.path())
            .output()
            .unwrap();
        let (read, told) =
            (String::from_utf8(cargo.stdout).unwrap(), String::from_utf8_lossy(&cargo.stderr));
        assert!(cargo.status.success(), "{told}");
        for dependency in ["serde", "wrapyfi_core"] {
            assert!(read.contains(&format!("\"name\":\"{dependency}\"")), "{read}");
        }
        for path in own.split('"').filter(|text| text.starts_with('/')) {
            assert!(Path::new(path).join("Cargo.toml").is_file(), "{path}");
        }
    }
}
