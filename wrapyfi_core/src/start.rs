//! The start of middlewares by programs: one builder for each, which begins with the environment.
//!
//! ```no_run
//! use wrapyfi_core::middleware::zeromq::BrokerMode;
//! use wrapyfi_core::start::StartError;
//! let zeromq = wrapyfi_core::zeromq().with(|settings| {
//!     settings.broker = BrokerMode::Foreign;
//!     settings.pub_port = 0;
//! });
//! let error = zeromq.start().err().unwrap();
//! assert_eq!(error.to_string(), "with a foreign broker pub_port must be its port, not 0");
//! ```

#[doc(inline)]
pub use wrapyfi_endpoint::{Builder, MiddlewareSettings, StartError};
#[cfg(feature = "ros1")]
#[doc(inline)]
pub use wrapyfi_ros1::ros1;
#[cfg(feature = "ros2")]
#[doc(inline)]
pub use wrapyfi_ros2::{Ros2Settings, ros2};
#[cfg(feature = "yarp")]
#[doc(inline)]
pub use wrapyfi_yarp_endpoint::yarp;
#[cfg(feature = "zeromq")]
#[doc(inline)]
pub use wrapyfi_zeromq::zeromq;

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "in a test a panic is the right answer")]
mod tests {
    #[test]
    #[cfg(feature = "zeromq")]
    fn settings_are_changed_before_the_start() {
        let started = super::zeromq().with(|settings| {
            settings.ip = "127.0.0.1".to_owned();
            (settings.pub_port, settings.sub_port) = (0, 0);
            settings.broker = wrapyfi_zeromq::BrokerMode::Embedded;
        });
        assert_ne!(started.start().unwrap().pub_port(), 0);
    }

    #[test]
    #[cfg(feature = "ros2")]
    fn a_name_that_no_node_can_have_is_refused_at_the_start() {
        let refused =
            super::ros2("1camera").with(|settings| settings.cyclone.domain_id = 7).start();
        assert!(refused.is_err_and(|error| error.to_string().contains("1camera")));
    }
}
