//! End-to-end tests: one program, a module for each subject.

#![allow(clippy::indexing_slicing, clippy::panic, reason = "in a test a panic is the right answer")]

mod bridge;
mod bridge_graph;
mod cli;
mod communicator;
mod discovery;
mod endings;
mod example_sensors;
mod examples;
mod fastdds;
mod frameworks;
mod headers;
mod hostile;
mod hosts;
mod node;
mod packages;
mod pairs;
mod patterns;
mod peers;
mod plugins;
mod properties;
mod qos;
mod real_ros2;
mod real_wrapyfi;
mod real_yarp;
mod real_yarp_base;
mod real_yarp_board;
mod reload;
mod requests;
mod rmw;
mod ros1;
mod ros1_bridge;
mod ros1_churn;
mod ros1_cpp;
mod ros1_graph;
mod ros1_latched;
mod ros1_types;
mod ros_types;
mod service_routes;
mod services;
mod yarp_commands;
mod yarp_links;
mod yarp_robot;
mod yarp_routes;
mod zeromq;
