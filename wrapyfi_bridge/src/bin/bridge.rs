//! The bridge node.
fn main() {}
