//! Manifests of the packages.

use std::path::Path;

use anyhow::Context as _;
use wrapyfi_e2e::{Result, repository};

/// Text of a file of the repository.
fn read(file: &Path) -> Result<String> {
    std::fs::read_to_string(file).with_context(|| file.display().to_string())
}

/// Text between `<tag …>` and its end.
fn element<'a>(text: &'a str, tag: &str) -> Option<&'a str> {
    let (_, rest) = text.split_once(&format!("<{tag}"))?;
    let (_, rest) = rest.split_once('>')?;
    Some(rest.split_once(&format!("</{tag}>"))?.0)
}

#[test]
fn packages_name_every_middleware_and_nobody_elses_organisation() -> Result {
    let mut packages = 0;
    for entry in std::fs::read_dir(repository())? {
        let file = entry?.path().join("package.xml");
        if !file.is_file() {
            continue;
        }
        let text = read(&file)?;
        let maintainer = element(&text, "maintainer").context("no maintainer")?;
        assert_eq!(maintainer, "To be filled in at release", "{}", file.display());
        let url = element(&text, "url").unwrap_or_default();
        assert!(url.ends_with("/to-be-filled-in-at-release"), "{}: {url}", file.display());
        packages += 1;
    }
    assert!(packages >= 4, "{packages} packages");
    for package in
        ["wrapyfi_core/package.xml", "wrapyfi_core/Cargo.toml", "wrapyfi_bridge/package.xml"]
    {
        let text = read(&repository().join(package))?;
        for middleware in ["ZeroMQ", "YARP", "ROS 1", "ROS 2"] {
            assert!(text.contains(middleware), "{package} says nothing of {middleware}");
        }
    }
    Ok(())
}
