//! A middleware as an observer of it sees it: a look that opens no endpoint and starts no broker.

use std::sync::Arc;

use wrapyfi_data::Limits;
use wrapyfi_endpoint::driver::Purpose;
use wrapyfi_endpoint::{Middleware, MiddlewareSettings as _};
use wrapyfi_ros1::{self as ros1, Ros1};
use wrapyfi_ros2::{self as ros2, Ros2, Ros2Section, environment::DiscoveryRange};

use super::endpoints::{Endpoints, failure, of_start};
use super::learn::observe_ros1;
use crate::exit::Result;

/// A middleware that only looks, and the same once more where it is ROS 1.
pub type Observer = (Arc<dyn Middleware>, Option<Arc<Ros1>>);

/// Starts a middleware that only looks.
///
/// # Errors
/// Exit code 2 for settings that cannot work, 1 when it does not start.
pub fn observer(endpoints: &Endpoints, middleware: &str) -> Result<Observer> {
    if let Some(ros1) = ros1_observer(endpoints, middleware) {
        let ros1 = ros1?;
        return Ok((Arc::clone(&ros1) as Arc<dyn Middleware>, Some(ros1)));
    }
    Ok((endpoints.start(middleware, Purpose::Look)?, None))
}

/// A nameless node of ROS 1 that only looks, where the middleware is that.
pub fn ros1_observer(endpoints: &Endpoints, middleware: &str) -> Option<Result<Arc<Ros1>>> {
    (middleware == ros1::NAME).then(|| Ok(Arc::new(observe_ros1(endpoints)?)))
}

/// ROS 2 that only looks, as the hidden node of a program that asks.
///
/// # Errors
/// As [`observer`].
pub fn ros2_hidden(section: &Ros2Section) -> Result<Ros2> {
    let settings = section.hidden(Limits::default().message_bytes).map_err(failure)?;
    settings.start().map_err(|error| of_start(ros2::NAME, error))
}

/// ROS 2 that only looks, in another domain, or as far as multicast reaches.
///
/// # Errors
/// As [`observer`].
pub fn ros2_elsewhere(section: &Ros2Section, domain_id: u32, wide: bool) -> Result<Ros2> {
    let mut settings = section.hidden(Limits::default().message_bytes).map_err(failure)?;
    settings.cyclone.domain_id = domain_id;
    if wide {
        settings.cyclone.discovery_range = DiscoveryRange::Subnet;
    }
    settings.start().map_err(|error| of_start(ros2::NAME, error))
}

#[cfg(test)]
mod tests {
    use wrapyfi_endpoint::Interaction;
    use wrapyfi_endpoint::driver::{Reach, ServerAddress};

    use crate::middlewares::load_text;

    /// First server of a middleware where a configuration says.
    fn server_address(middleware: &str, settings: &str, interaction: Interaction) -> ServerAddress {
        let route = "routes:\n  - { from: 'zeromq:/a', to: 'ros2:/a', type: Text }\n";
        let text = format!("endpoints: {{ {settings} }}\n{route}");
        let endpoints = load_text(&text, "x.yaml").unwrap().endpoints;
        endpoints.servers(middleware, interaction).unwrap().remove(0)
    }

    #[test]
    fn a_command_of_the_shell_is_led_to_where_the_configuration_says() {
        let ports = "zeromq: { ip: 127.0.0.2, pub_port: 6555, rep_port: 6558, broker: foreign }";
        for (middleware, settings, interaction, variables, options) in [
            ("zeromq", "", Interaction::Topic, "", ""),
            (
                "zeromq",
                ports,
                Interaction::Topic,
                "WRAPYFI_ZEROMQ_SOCKET_IP=127.0.0.2 WRAPYFI_ZEROMQ_SOCKET_PUB_PORT=6555 ",
                "",
            ),
            (
                "zeromq",
                ports,
                Interaction::Service,
                "WRAPYFI_ZEROMQ_SOCKET_IP=127.0.0.2 ",
                " --rep-port 6558",
            ),
            (
                "ros",
                "ros: { master_uri: 'http://localhost:11411' }",
                Interaction::Topic,
                "ROS_MASTER_URI=http://localhost:11411 ",
                "",
            ),
        ] {
            let Reach { variables: led, options: given } =
                server_address(middleware, settings, interaction).reach;
            assert_eq!((led.as_str(), given.as_str()), (variables, options), "{settings}");
        }
    }

    #[test]
    fn what_starts_a_server_does_so_where_the_configuration_says() {
        for (middleware, settings, wanted) in [
            ("zeromq", "", "wrapyfi broker"),
            (
                "zeromq",
                "zeromq: { ip: 10.0.0.2, broker: foreign, pub_port: 6555, req_port: 6559 }",
                "wrapyfi broker --ip 10.0.0.2 --insecure --pub-port 6555 --req-port 6559",
            ),
            (
                "zeromq",
                "zeromq: { ip: 127.0.0.9, broker: foreign }",
                "wrapyfi broker --ip 127.0.0.9",
            ),
            (
                "yarp",
                "yarp: { name_server: '127.0.0.1:10000' }",
                "wrapyfi yarpserver    # or yarpserver",
            ),
            (
                "yarp",
                "yarp: { name_server: '10.0.0.2:10050' }",
                "wrapyfi yarpserver --ip 10.0.0.2 --insecure --port 10050    # or yarpserver --socket 10050",
            ),
            (
                "ros",
                "ros: { master_uri: 'http://localhost:11411' }",
                "roscore -p 11411    # or have `master_uri` say where it runs",
            ),
        ] {
            assert_eq!(server_address(middleware, settings, Interaction::Topic).start, wanted);
        }
    }
}
