//! Tests of tensors of candle, with the feature of that name.

#![allow(
    clippy::indexing_slicing,
    clippy::panic,
    clippy::unwrap_used,
    unreachable_pub,
    reason = "in a test a panic is the right answer"
)]

#[cfg(feature = "candle")]
mod tensor_candle;
