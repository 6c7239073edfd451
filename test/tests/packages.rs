//! Manifests of the packages.

use std::path::Path;

use anyhow::Context as _;
use wrapyfi_e2e::{Result, repository, run};

use super::cli::PROGRAM;

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
fn packages_name_every_middleware_and_one_maintainer() -> Result {
    let cargo = read(&repository().join("Cargo.toml"))?;
    let place = value(&cargo, "workspace.package", "repository")?;
    let bridge = read(&repository().join("wrapyfi_bridge/Cargo.toml"))?;
    let whom = value(&bridge, "package.metadata.deb", "maintainer")?;
    let mut packages = 0;
    for entry in std::fs::read_dir(repository())? {
        let file = entry?.path().join("package.xml");
        if !file.is_file() {
            continue;
        }
        let text = read(&file)?;
        let maintainer = element(&text, "maintainer").context("no maintainer")?;
        let email = text.split_once("<maintainer email=\"").context("no address")?.1;
        let email = email.split('"').next().unwrap_or_default();
        assert_eq!(format!("{maintainer} <{email}>"), whom, "{}", file.display());
        assert_eq!(element(&text, "url"), Some(place), "{}", file.display());
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

/// Value of `key = "…"` in the section of a manifest of Cargo.
fn value<'a>(manifest: &'a str, section: &str, key: &str) -> Result<&'a str> {
    let inside = manifest.split_once(&format!("\n[{section}]\n")).context("no such section")?.1;
    let mut lines = inside.lines().take_while(|line| !line.starts_with('['));
    let line = lines.find_map(|line| line.strip_prefix(key)?.strip_prefix(" = \""));
    line.and_then(|line| line.split('"').next()).context(format!("no {key} in [{section}]"))
}

#[test]
fn the_version_is_the_same_wherever_it_stands() -> Result {
    let cargo = read(&repository().join("Cargo.toml"))?;
    let version = value(&cargo, "workspace.package", "version")?;
    let ours = cargo.lines().filter(|line| line.starts_with("wrapyfi_"));
    let mut said: Vec<(String, String)> = ours
        .filter_map(|line| Some((line, line.split_once("version = \"")?.1.split('"').next()?)))
        .map(|(line, version)| (line.to_owned(), version.to_owned()))
        .collect();
    assert!(said.len() >= 16, "{said:?}");
    for package in ["wrapyfi", "wrapyfi_bridge", "wrapyfi_core", "wrapyfi_msgs", "wrapyfi_py"] {
        let text = read(&repository().join(package).join("package.xml"))?;
        said.push((package.to_owned(), element(&text, "version").unwrap_or_default().to_owned()));
    }
    for (place, other) in said {
        assert_eq!(other, version, "{place}: `make version TO={version}` writes all");
    }
    let changes = read(&repository().join("CHANGELOG.md"))?;
    let newest = changes.lines().find(|line| line.starts_with("## ")).context("no release")?;
    assert!(newest.split([' ', ':']).any(|word| word == version), "CHANGELOG.md: {newest}");
    // The wheels, the Debian packages and wrapyfi_py take theirs from these.
    for wheel in ["packaging/wheel/pyproject.toml", "wrapyfi_rs/pyproject.toml"] {
        let wheel = read(&repository().join(wheel))?;
        assert!(wheel.contains("dynamic = [\"version\"]"), "{wheel}");
    }
    let python = read(&repository().join("wrapyfi_py/setup.py"))?;
    assert!(python.contains("version=manifest.findtext(\"version\")"), "{python}");
    Ok(())
}

/// Steps `run: make …` of the workflows of continuous integration, with the files they are in.
fn made_by_workflows() -> Result<Vec<(String, String)>> {
    let mut steps = Vec::new();
    for entry in std::fs::read_dir(repository().join(".github/workflows"))? {
        let file = entry?.path();
        let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let text = read(&file)?;
        // The parts of the night run beside each other, each as a step `make PART`.
        let parts = text.lines().find_map(|line| line.trim().strip_prefix("part: ["));
        let parts = parts.unwrap_or_default().trim_end_matches(']').split(", ");
        let made = text.lines().filter_map(|line| line.trim().strip_prefix("- run: make "));
        let targets = made.flat_map(str::split_whitespace).filter(|word| !word.contains("{{"));
        let targets = targets.filter(|word| !["matrix.part", "}}"].contains(word));
        let all = targets.chain(parts).filter(|word| !word.is_empty());
        steps.extend(all.map(|target| (name.clone(), target.to_owned())));
    }
    Ok(steps)
}

#[test]
fn continuous_integration_runs_what_a_developer_runs() -> Result {
    let makefile = read(&repository().join("Makefile"))?;
    let steps = made_by_workflows()?;
    let targets = |line: &str| line.split_once(':').map(|(targets, _)| targets.to_owned());
    let known: Vec<String> = makefile
        .lines()
        .filter(|line| !line.starts_with(['\t', '#']))
        .filter_map(targets)
        .flat_map(|line| line.split_whitespace().map(str::to_owned).collect::<Vec<_>>())
        .collect();
    for (file, target) in &steps {
        assert!(known.contains(target), "{file} makes {target}, which the Makefile has not");
    }
    let nightly = makefile.lines().find_map(|line| line.strip_prefix("nightly: "));
    for part in nightly.context("no nightly")?.split_whitespace() {
        assert!(
            steps.iter().any(|(_, target)| target == part),
            "no workflow makes {part}, a part of `make nightly`"
        );
    }
    Ok(())
}

#[test]
fn every_library_that_the_program_loads_has_its_licence_named() -> Result {
    let page = read(&repository().join("THIRD_PARTY.md"))?;
    run("every_library_that_the_program_loads_has_its_licence_named", PROGRAM, |env| {
        let mut readelf = env.shell("readelf --dynamic \"$(command -v wrapyfi)\"")?;
        readelf.exits_with(0)?;
        let needed = readelf.stdout();
        let libraries: Vec<&str> = needed
            .lines()
            .filter(|line| line.contains("(NEEDED)"))
            .filter_map(|line| line.split_once('[')?.1.split(".so").next())
            .collect();
        assert!(libraries.contains(&"libc"), "{libraries:?}");
        // What every system of glibc has.
        let of_the_system = ["libc", "libm", "libgcc_s", "ld-linux-x86-64", "ld-linux-aarch64"];
        for library in libraries.iter().filter(|library| !of_the_system.contains(library)) {
            assert!(page.contains(library), "THIRD_PARTY.md says nothing of {library}");
        }
        Ok(())
    })
}
