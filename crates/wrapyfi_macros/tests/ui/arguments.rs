//! Arguments that a server could not decode, and receivers.
#![allow(unused_variables)]

use std::collections::HashMap;
use wrapyfi_macros::communicator;

struct Camera;

#[communicator]
impl Camera {
    #[register(Image, "zeromq", "/a")]
    fn generic<T>(&self, value: T) {}

    #[register(Image, "zeromq", "/a")]
    fn lifetime<'a>(&self, value: &'a str) {}

    #[register(Image, "zeromq", "/a")]
    fn some_trait(&self, value: impl Clone) {}

    #[register(Image, "zeromq", "/a")]
    fn some_object(&self, value: &dyn std::fmt::Debug) {}

    #[register(Image, "zeromq", "/a")]
    fn inner_reference(&self, value: Option<&str>) {}

    #[register(Image, "zeromq", "/a")]
    fn mutable(&self, value: &mut HashMap<String, u8>) {}

    #[register(Image, "zeromq", "/a")]
    fn pattern(&self, (a, b): (u8, u8)) {}

    #[register(Image, "zeromq", "/a")]
    fn by_value(self) {}

    #[register(Image, "zeromq", "/a")]
    fn associated(value: u8) {}

    #[register(Image, "zeromq", "/a")]
    fn received(&self, #[received] one: Option<u8>, #[received] two: Option<u8>) {}

    #[register(Image, "zeromq", "/a")]
    #[cfg(unix)]
    fn sometimes(&self) {}

    #[register(Image, "zeromq", "/a")]
    unsafe fn dangerous(&self) {}
}

fn main() {}
