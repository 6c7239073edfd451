//! The release of ROS 2 that an installation is of, by the version of its package `rmw`: the build script and the crate
//! read it alike.

use std::path::Path;

/// Version of the package `rmw` below a prefix, for instance `7.3.2`; `None` where there is none.
pub(crate) fn rmw_version(prefix: &Path) -> Option<String> {
    let package = std::fs::read_to_string(prefix.join("share/rmw/package.xml")).ok()?;
    let (version, _) = package.split_once("<version>")?.1.split_once("</version>")?;
    Some(version.trim().to_owned())
}

/// Major and minor version: what they have in common fits together, fields of structs too.
pub(crate) fn series(version: &str) -> &str {
    version.rsplit_once('.').map_or(version, |(series, _)| series)
}

/// A version of `rmw`, and the distribution that has it.
pub(crate) fn named(version: &str) -> String {
    let distribution = match series(version) {
        "7.3" => "Jazzy",
        "7.8" => "Kilted",
        "7.10" => "Lyrical",
        _ => return format!("rmw {version}"),
    };
    format!("rmw {version} of {distribution}")
}
