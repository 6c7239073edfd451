//! All of YARP into ROS 2 and back: `ros2 run wrapyfi_bridge yarp_bridge`.

use std::process::ExitCode;

use wrapyfi_bridge::middleware_bridge::MiddlewareBridge;

fn main() -> ExitCode {
    wrapyfi_bridge::node_main::main_of(MiddlewareBridge::Yarp)
}
