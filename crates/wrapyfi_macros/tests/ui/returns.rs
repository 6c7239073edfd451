//! Returned values and the number of `#[register]`.
use wrapyfi_macros::communicator;

struct Camera;

#[communicator]
impl Camera {
    #[register(Image, "zeromq", "/a")]
    #[register(Image, "zeromq", "/b")]
    fn too_few(&self) -> (u8, u8, u8) {
        (1, 2, 3)
    }

    #[register(Image, "zeromq", "/a")]
    #[register(Image, "zeromq", "/b")]
    fn no_tuple(&self) -> Vec<u8> {
        vec![]
    }

    #[register([Image, "zeromq", "/a"], [Image, "zeromq", "/b"])]
    fn no_list(&self) -> u8 {
        1
    }

    #[register([[Image, "zeromq", "/a"], [Image, "zeromq", "/b"]])]
    fn too_deep(&self) -> u8 {
        1
    }

    #[register([Image, "zeromq", "/a"], Image, "zeromq", "/b")]
    fn no_bracket(&self) -> (u8, u8) {
        (1, 2)
    }

    #[register(Image, "zeromq", "/a")]
    fn reference(&self) -> &str {
        ""
    }

    #[register(Image, "zeromq", "/a")]
    fn some_trait(&self) -> impl Clone {
        1
    }
}

fn main() {}
