//! Mistakes in actions.
#![allow(unused_variables)]

use wrapyfi_macros::communicator;

struct Arm;

struct Feedback;

#[communicator]
impl Arm {
    #[register(Action, "ros2", "/a")]
    fn no_type(&self) {}

    #[register(NativeObject, "ros2", "/a", action_type = "demo/action/Count")]
    fn no_action(&self) {}

    #[register(Action, "ros2", "/a", action_type = "demo/action/Count")]
    #[register(Image, "ros2", "/b")]
    fn one_of_two(&self) -> ((), ()) {
        ((), ())
    }

    #[register(Action, "ros2", "/a", action_type = "demo/action/Count")]
    fn received(&self, #[received] prev: Option<u8>) {}

    #[register(NativeObject, "ros2", "/a")]
    fn no_goal(&self, #[feedback] progress: &Feedback) {}

    #[register(Action, "ros2", "/a", action_type = "demo/action/Count")]
    fn owned(&self, #[feedback] progress: Feedback) {}

    #[register(Action, "ros2", "/a", action_type = "demo/action/Count")]
    fn two(&self, #[feedback] one: &Feedback, #[feedback] two: &Feedback) {}
}

fn main() {}
