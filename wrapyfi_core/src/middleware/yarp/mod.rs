//! YARP: ports, the name server and what YARP's programs send.

pub mod options;
pub mod payload;
