//! The rmw interface as bindgen reads it from the headers of the ROS 2 that is sourced.

#![allow(unsafe_code, reason = "declarations of C")]
#![allow(
    non_camel_case_types,
    non_snake_case,
    non_upper_case_globals,
    dead_code,
    unused_imports,
    unreachable_pub
)]
#![allow(missing_docs, clippy::all, clippy::pedantic, clippy::undocumented_unsafe_blocks)]
#![allow(unsafe_op_in_unsafe_fn, rust_2018_idioms)]

include!(concat!(env!("OUT_DIR"), "/rmw.rs"));
