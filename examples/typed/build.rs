//! Writes the structs of the types that `zones` uses, and of all that they refer to.

use std::process::ExitCode;

use wrapyfi_interfaces::build::Generator;

fn main() -> ExitCode {
    Generator::default().folder("interfaces").generate([
        "geometry_msgs/msg/PolygonStamped",
        "fleet_msgs/srv/Clear",
        "fleet_msgs/action/Patrol",
    ])
}
