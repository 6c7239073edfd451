//! `$` names an argument.
#![allow(unused_variables)]

use wrapyfi_macros::communicator;

struct Camera;

#[communicator]
impl Camera {
    #[register(Image, "$mwaer", "/a")]
    fn name(&self, mware: &str) {}

    #[register(Image, "$2", "/a")]
    fn number(&self, mware: &str, wait: bool) {}

    #[register(Image, "zeromq", "/robot/$name")]
    fn inside(&self, name: &str) {}

    #[register(Image, "zeromq", "/a", should_wait = "$wait")]
    fn none(&self) {}
}

fn main() {}
