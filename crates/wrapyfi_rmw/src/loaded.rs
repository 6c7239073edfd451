//! The ROS 2 that is loaded, beside the one that the program was built with.
//!
//! ```text
//!   built with  /opt/ros/jazzy     rmw 7.3 ─┐
//!   loaded from /opt/ros/kilted    rmw 7.8 ─┴─▶ differ: their structs have other fields, nothing is called
//! ```

#![allow(unsafe_code, reason = "the path of a library is a text of C")]

use std::ffi::{CStr, OsStr};
use std::os::unix::ffi::OsStrExt as _;
use std::path::Path;

use super::release::{named, rmw_version, series};
use super::{Fault, sys};

/// Version of `rmw` that the program was built with.
const BUILT: &str = env!("WRAPYFI_RMW_VERSION");
/// The one middleware of the ROS 2 that the program was built with, where that ROS 2 has no `rmw_implementation`.
const ONLY: Option<&str> = option_env!("WRAPYFI_RMW_ONLY");

/// Refuses a ROS 2 of another distribution, and a middleware that cannot be loaded because one is linked.
pub(crate) fn check() -> Result<(), Fault> {
    let refuse = |reason| Err(Fault::new("loading the middleware", reason));
    // SAFETY: no arguments; the text is the loader's, which keeps it as long as the library.
    let file = unsafe { sys::wrapyfi_rmw_file() };
    if !file.is_null() {
        // SAFETY: not null, and ends with a zero.
        let file = Path::new(OsStr::from_bytes(unsafe { CStr::from_ptr(file) }.to_bytes()));
        if let Some(reason) = file.ancestors().skip(1).find_map(|prefix| differs(prefix, BUILT)) {
            return refuse(reason);
        }
    }
    let wanted = std::env::var("RMW_IMPLEMENTATION").unwrap_or_default();
    match ONLY {
        Some(only) if !wanted.is_empty() && wanted != only => refuse(format!(
            "RMW_IMPLEMENTATION={wanted}, and this program was built with a ROS 2 that has {only} alone, without rmw_implementation"
        )),
        _ => Ok(()),
    }
}

/// Reason to refuse the ROS 2 below `prefix` where it is of another distribution than that of `rmw` version `built`, where
/// that is known.
fn differs(prefix: &Path, built: &str) -> Option<String> {
    let version = rmw_version(prefix)?;
    (!built.is_empty() && series(&version) != series(built)).then(|| {
        let (built, found) = (named(built), named(&version));
        format!(
            "this program was built with {built}, and {} has {found}: source the ROS 2 that it was built with, or build it again",
            prefix.display()
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn another_distribution_is_told_with_both_names() {
        let prefix = std::env::temp_dir().join(format!("wrapyfi_rmw_{}", std::process::id()));
        let package = prefix.join("share/rmw");
        std::fs::create_dir_all(&package).unwrap();
        let write = |version: &str| {
            let text = format!("<package>\n  <name>rmw</name>\n  <version>{version}</version>");
            std::fs::write(package.join("package.xml"), text).unwrap();
        };
        write("7.3.3");
        assert_eq!(differs(&prefix, "7.3.2"), None, "one distribution");
        write("7.10.1");
        let said = differs(&prefix, "7.3.2").unwrap();
        for part in
            ["rmw 7.3.2 of Jazzy", "rmw 7.10.1 of Lyrical", "wrapyfi_rmw_", "build it again"]
        {
            assert!(said.contains(part), "{said}");
        }
        std::fs::remove_dir_all(&prefix).unwrap();
        assert_eq!(differs(&prefix, "7.3.2"), None, "an installation that does not tell");
    }

    #[test]
    fn what_is_loaded_is_what_it_was_built_with() {
        assert_eq!(check(), Ok(()));
    }
}
