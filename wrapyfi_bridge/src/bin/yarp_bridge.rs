//! All of YARP into ROS 2 and back: `ros2 run wrapyfi_bridge yarp_bridge`.

use std::process::ExitCode;

use wrapyfi_bridge::whole::Whole;

fn main() -> ExitCode {
    wrapyfi_bridge::node::main_of_whole(Whole::Yarp)
}
