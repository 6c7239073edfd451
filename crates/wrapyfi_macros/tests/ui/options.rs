//! Options and their values.
use wrapyfi_macros::communicator;

struct Camera;

const WAIT: bool = true;

#[communicator]
impl Camera {
    #[register(Image, "zeromq", "/a", should_wiat = true)]
    fn unknown(&self) {}

    #[register(Image, "zeromq", "/a", should_wait = 1)]
    fn form(&self) {}

    #[register(Image, "zeromq", "/a", width = "200")]
    fn number(&self) {}

    #[register(Image, "zeromq", "/a", rgb = true, rgb = false)]
    fn twice(&self) {}

    #[register(Image, "zeromq", "/a", should_wait = WAIT)]
    fn constant(&self) {}

    #[register(Image, "zeromq", "/a", listener_kwargs = "/b")]
    fn side(&self) {}

    #[register(Image, "zeromq", "/a", listener_kwargs(listener_kwargs(rgb = true)))]
    fn side_in_side(&self) {}

    #[register(Image, "zeromq", "/a", listener_kwargs(in_topik = "/b"))]
    fn unknown_in_side(&self) {}
}

fn main() {}
