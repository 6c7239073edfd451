//! Severities of the log: `rosgraph_msgs/Log` of ROS 1 counts 1, 2, 4, 8, 16, `rcl_interfaces/Log`
//! of ROS 2 counts 10, 20, 30, 40, 50, both from debug to fatal.

/// ROS 1 to ROS 2; between two, the lower one.
pub(super) fn to_ros2(level: u8) -> u8 {
    match level {
        0 => 0,
        1 => 10,
        2..=3 => 20,
        4..=7 => 30,
        8..=15 => 40,
        16.. => 50,
    }
}

/// ROS 2 to ROS 1; between two, the lower one.
pub(super) fn to_ros1(level: u8) -> u8 {
    match level {
        0 => 0,
        1..=19 => 1,
        20..=29 => 2,
        30..=39 => 4,
        40..=49 => 8,
        50.. => 16,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn severities_return() {
        for level in [0, 1, 2, 4, 8, 16] {
            assert_eq!(to_ros1(to_ros2(level)), level);
        }
        for level in [0, 10, 20, 30, 40, 50] {
            assert_eq!(to_ros2(to_ros1(level)), level);
        }
        assert_eq!((to_ros2(255), to_ros1(255), to_ros1(5), to_ros1(25)), (50, 16, 1, 2));
    }
}
