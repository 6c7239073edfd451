//! ROS 2 topics over CycloneDDS.

pub mod graph;
