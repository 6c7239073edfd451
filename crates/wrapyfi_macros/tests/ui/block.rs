//! Places where `#[communicator]` and `#[register]` may stand.
use wrapyfi_macros::{communicator, register};

struct Camera;

#[communicator]
impl Camera {
    fn nothing(&self) {}
}

struct Generic<T>(T);

#[communicator]
impl<T> Generic<T> {
    #[register(Image, "zeromq", "/a")]
    fn read(&self) {}
}

trait Read {
    fn read(&self);
}

#[communicator]
impl Read for Camera {
    #[register(Image, "zeromq", "/a")]
    fn read(&self) {}
}

#[communicator]
struct NoBlock;

struct Names;

#[communicator(topic = "/a")]
impl Names {
    #[register(Image, "zeromq", "/a")]
    fn activate(&self) {}

    #[register(Image, "zeromq", "/a")]
    fn read_it(&self) {}

    #[register(Image, "zeromq", "/a")]
    #[allow(non_snake_case)]
    fn readIt(&self) {}
}

struct Alone;

impl Alone {
    #[register(Image, "zeromq", "/a")]
    fn read(&self) {}
}

fn main() {}
