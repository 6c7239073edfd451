//! Finds the ROS 2 that is sourced, reads its headers and compiles the type support.
//!
//! ```text
//!   prefixes ─▶ include/rmw/rmw/rmw.h ─▶ bindgen ─▶ $OUT_DIR/rmw.rs
//!               include/fastcdr       ─▶ c++     ─▶ src/type_support.cpp
//!               lib/                  ─▶ librmw_implementation, librmw, librcutils
//! ```
//!
//! The prefixes are those of `WRAPYFI_RMW_PREFIX_PATH`, which CMake sets, else of `AMENT_PREFIX_PATH`: colcon adds
//! each package to the latter that it has built, and everything would be compiled again for the next one.

#![allow(clippy::print_stdout, reason = "Cargo is told on standard output")]
#![allow(clippy::expect_used, clippy::panic, reason = "a build script ends with its message")]

fn main() {
    println!("cargo:rerun-if-env-changed=WRAPYFI_RMW_PREFIX_PATH");
    println!("cargo:rerun-if-changed=src/release.rs");
    println!("cargo:rerun-if-changed=src/rmw.h");
    println!("cargo:rerun-if-changed=src/logging.h");
    println!("cargo:rerun-if-changed=src/logging.cpp");
    println!("cargo:rerun-if-changed=src/type_support.h");
    println!("cargo:rerun-if-changed=src/type_support.cpp");
    #[cfg(feature = "installed")]
    installed::build();
}

#[cfg(feature = "installed")]
#[path = "src/release.rs"]
mod release;

#[cfg(feature = "installed")]
mod installed {
    use super::release::{named, rmw_version};
    use std::env;
    use std::path::{Path, PathBuf};

    /// Middlewares that are linked where nothing loads the one that `RMW_IMPLEMENTATION` names, as in wheels; the
    /// first goes first, which is ROS 2's default.
    const RMWS: [&str; 3] = ["rmw_fastrtps_cpp", "rmw_zenoh_cpp", "rmw_cyclonedds_cpp"];

    pub(super) fn build() {
        let told = env::var("WRAPYFI_RMW_PREFIX_PATH").ok().filter(|path| !path.is_empty());
        let path = told.unwrap_or_else(|| {
            println!("cargo:rerun-if-env-changed=AMENT_PREFIX_PATH");
            env::var("AMENT_PREFIX_PATH").unwrap_or_default()
        });
        let prefixes: Vec<PathBuf> = env::split_paths(&path).collect();
        let find = |file: &str| prefixes.iter().find(|prefix| prefix.join(file).is_file());
        let Some(headers) = find("include/rmw/rmw/rmw.h") else {
            panic!(
                "no rmw/rmw.h under {path:?} (AMENT_PREFIX_PATH): source a ROS 2 that has ros-base \
                 (`. /opt/ros/<distribution>/setup.bash`), or build without the feature rmw"
            );
        };
        let version = rmw_version(headers).unwrap_or_default();
        println!("cargo:rustc-env=WRAPYFI_RMW_VERSION={version}");
        let includes: Vec<PathBuf> = prefixes.iter().flat_map(|prefix| folders(prefix)).collect();
        bind(&includes);
        compile(&includes, &named(&version));
        // Under names of our own: a system may have libraries of other versions, which linkers would find first. What is
        // loaded is what the libraries call themselves.
        let out = PathBuf::from(env::var_os("OUT_DIR").expect("Cargo sets OUT_DIR"));
        println!("cargo:rustc-link-search=native={}", out.display());
        let loads = "rmw_implementation";
        let is_there = |rmw: &&str| find(&format!("lib/lib{rmw}.so")).is_some();
        let Some(rmw) = [loads].into_iter().chain(RMWS).find(is_there) else {
            panic!(
                "no lib/lib{loads}.so under {path:?} (AMENT_PREFIX_PATH), and no lib/lib….so of {RMWS:?}: \
                 source a ROS 2 that has ros-base"
            );
        };
        if rmw != loads {
            println!("cargo:rustc-env=WRAPYFI_RMW_ONLY={rmw}");
        }
        for library in [rmw, "rmw", "rcutils", "fastcdr"] {
            let file = format!("lib/lib{library}.so");
            let Some(prefix) = find(&file) else {
                panic!(
                    "no {file} under {path:?} (AMENT_PREFIX_PATH): source a ROS 2 that has ros-base"
                );
            };
            let link = out.join(format!("libwrapyfi_{library}.so"));
            _ = std::fs::remove_file(&link);
            std::os::unix::fs::symlink(prefix.join(&file), &link)
                .expect("OUT_DIR cannot be written");
            println!("cargo:rustc-link-lib=dylib=wrapyfi_{library}");
        }
    }

    /// Folders of a prefix that hold headers: `include`, and `include/<package>` of each package.
    fn folders(prefix: &Path) -> Vec<PathBuf> {
        let include = prefix.join("include");
        let packages = std::fs::read_dir(&include).into_iter().flatten().flatten();
        let packages = packages
            .filter(|package| package.path().join(package.file_name()).is_dir())
            .map(|package| package.path());
        let mut folders: Vec<PathBuf> = packages.collect();
        folders.sort();
        folders.push(include);
        folders
    }

    fn bind(includes: &[PathBuf]) {
        let out = PathBuf::from(env::var_os("OUT_DIR").expect("Cargo sets OUT_DIR"));
        let bindings = bindgen::Builder::default()
            .header("src/rmw.h")
            .clang_args(includes.iter().map(|folder| format!("-I{}", folder.display())))
            .allowlist_function("(rmw|rcutils|wrapyfi)_.*")
            .allowlist_var("(RMW|WRAPYFI)_.*")
            .allowlist_type("rmw_.*")
            .default_enum_style(bindgen::EnumVariation::Consts)
            .prepend_enum_name(false)
            .derive_default(true)
            .generate_comments(false)
            .layout_tests(false)
            .generate()
            .expect("the headers of rmw cannot be read: see clang's messages above")
            .to_string();
        // As edition 2024 asks for it, which this version of bindgen does not know.
        let bindings = bindings.replace("extern \"C\" {", "unsafe extern \"C\" {");
        std::fs::write(out.join("rmw.rs"), bindings).expect("OUT_DIR cannot be written");
    }

    fn compile(includes: &[PathBuf], version: &str) {
        cc::Build::new()
            .cpp(true)
            .std("c++17")
            .includes(includes)
            .warnings(false)
            .define("WRAPYFI_RMW_VERSION", format!("{version:?}").as_str())
            .file("src/logging.cpp")
            .file("src/type_support.cpp")
            .compile("wrapyfi_type_support");
    }
}
