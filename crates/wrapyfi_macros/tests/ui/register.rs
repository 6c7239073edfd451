//! Mistakes in `#[register]`.
use wrapyfi_macros::communicator;

struct Camera;

#[communicator]
impl Camera {
    #[register(Imge, "zeromq", "/a")]
    fn data_type(&self) {}

    #[register(Ros2Mesage, "ros2", "/a")]
    fn misspelt_ros_message(&self) {}

    #[register]
    fn nothing(&self) {}

    #[register()]
    fn still_nothing(&self) {}

    #[register(Image, middleware = "zeromq")]
    fn no_topic(&self) {}

    #[register(Image, "zeromq", "")]
    fn empty_topic(&self) {}

    #[register(Image, "zeromq", "Camera", "/a", "/b")]
    fn too_many(&self) {}

    #[register(Image, "zeromq", "/a", topic = "/b")]
    fn two_topics(&self) {}

    #[register(Image, 5, "/a")]
    fn no_text(&self) {}

    #[register(Image, "zeromq", should_wait = false, "/a")]
    fn late_topic(&self) {}

    #[register(Image, "zeromq", "/a", {"should_wait": false})]
    fn dict(&self) {}
}

fn main() {}
