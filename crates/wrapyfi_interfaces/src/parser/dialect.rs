//! The two languages of definitions.

/// Version of ROS that a definition is written for.
///
/// | | ROS 1 | ROS 2 |
/// | --- | --- | --- |
/// | `time`, `duration` | built in; read as `builtin_interfaces/Time` and `Duration` | unknown |
/// | `Header` alone | `std_msgs/Header` | type of the own package |
/// | `byte` | signed, values from -128 to 255 are read | 0 to 255 |
/// | bounds, `wstring`, default values | unknown | known |
/// | `string X=a "b" # c` | all behind `=` is the value | quotes and comments are taken off |
/// | field `K`, constant `left`, type `tfMessage` | allowed | refused |
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Dialect {
    /// ROS 1 (`genmsg`).
    Ros1,
    /// ROS 2 (`rosidl`).
    #[default]
    Ros2,
}
