//! Types that this crate has structs for.

/// Definitions of the types that this crate has structs for, by path below a folder of packages.
pub(super) const GENERATED: &[(&str, &str)] = include!(concat!(env!("OUT_DIR"), "/definitions.rs"));

/// Kind, package and name of the types in [`GENERATED`].
pub(super) fn names() -> impl Iterator<Item = (&'static str, &'static str, &'static str)> {
    GENERATED.iter().filter_map(|(path, _)| {
        let (package, file) = path.split_once('/')?;
        let (kind, file) = file.split_once('/')?;
        Some((kind, package, file.split_once('.')?.0))
    })
}
