//! Tests against what Wrapyfi and its libraries wrote: one program, a module for each subject.

#![allow(
    clippy::indexing_slicing,
    clippy::panic,
    clippy::unwrap_used,
    unreachable_pub,
    reason = "in a test a panic is the right answer"
)]

#[cfg(all(feature = "pictures", feature = "tables", feature = "torch", feature = "zarr"))]
mod native_vectors;
mod pickle_vectors;
#[cfg(all(feature = "pictures", feature = "zarr"))]
mod plugin_labelled;
#[cfg(feature = "tables")]
mod plugin_tables;
#[cfg(feature = "torch")]
mod plugin_tensors;
#[cfg(feature = "torch")]
mod plugin_tensors_hostile;
#[cfg(feature = "torch")]
mod tensors;
