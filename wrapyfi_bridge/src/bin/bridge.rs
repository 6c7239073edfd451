//! The bridge as a ROS 2 node: `ros2 run wrapyfi_bridge bridge --ros-args -p config_file:=…`.

use std::process::ExitCode;

fn main() -> ExitCode {
    wrapyfi_bridge::node_main::main()
}
