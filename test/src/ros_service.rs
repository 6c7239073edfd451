//! `example_interfaces/srv/AddTwoInts` between an independent node and ours.

use std::time::{Duration, Instant};

use anyhow::bail;
use ros2_client::qos::Durability;
use ros2_client::{Client, Message, Name, Node, ServiceMapping, ServiceTypeName};
use serde::{Deserialize, Serialize};

use crate::ros_node::qos;
use crate::{AtWork, Result, TIMEOUT};

#[derive(Debug, Clone, Serialize, Deserialize)]
struct Request {
    a: i64,
    b: i64,
}

impl Message for Request {}

#[derive(Debug, Clone, Serialize, Deserialize)]
struct Response {
    sum: i64,
}

impl Message for Response {}

/// Time between two looks of an end that is not notified of arrivals.
const LOOK_EVERY: Duration = Duration::from_millis(5);

fn names(service: &str) -> Result<(Name, ServiceTypeName)> {
    let name =
        Name::parse(service).map_err(|e| anyhow::anyhow!("service name {service}: {e:?}"))?;
    Ok((name, ServiceTypeName::new("example_interfaces", "AddTwoInts")))
}

/// A server that adds, until it is dropped.
pub(crate) fn adder(node: &mut Node, service: &str, mapping: ServiceMapping) -> Result<AtWork> {
    let ((name, kind), qos) = (names(service)?, qos(Durability::Volatile));
    let server = node
        .create_server::<Request, Response>(mapping, &name, &kind, qos.clone(), qos)
        .map_err(|e| anyhow::anyhow!("server of {service}: {e:?}"))?;
    Ok(AtWork::start(move || match server.receive_request() {
        Ok(Some((id, request))) => {
            let sum = request.a.wrapping_add(request.b);
            server.send_response(id, Response { sum }).is_ok()
        }
        _ => {
            std::thread::sleep(LOOK_EVERY);
            true
        }
    }))
}

/// A client of a server that adds.
pub struct Asker {
    client: Client<Request, Response>,
}

impl Asker {
    pub(crate) fn new(node: &mut Node, service: &str, mapping: ServiceMapping) -> Result<Self> {
        let ((name, kind), qos) = (names(service)?, qos(Durability::Volatile));
        let client = node
            .create_client::<Request, Response>(mapping, &name, &kind, qos.clone(), qos)
            .map_err(|e| anyhow::anyhow!("client of {service}: {e:?}"))?;
        Ok(Self { client })
    }

    /// Asks until there is an answer: RustDDS may lose what it sends right after a match.
    pub fn first(&self, a: i64, b: i64) -> Result<i64> {
        let deadline = Instant::now() + TIMEOUT;
        while Instant::now() < deadline {
            if let Some(sum) = self.ask(a, b, Duration::from_millis(500))? {
                return Ok(sum);
            }
        }
        bail!("nobody answers {a} + {b}")
    }

    /// Asks once.
    pub fn next(&self, a: i64, b: i64) -> Result<i64> {
        match self.ask(a, b, TIMEOUT)? {
            Some(sum) => Ok(sum),
            None => bail!("{a} + {b} was not answered"),
        }
    }

    fn ask(&self, a: i64, b: i64, max_wait: Duration) -> Result<Option<i64>> {
        let id = self
            .client
            .send_request(Request { a, b })
            .map_err(|e| anyhow::anyhow!("request {a} + {b}: {e:?}"))?;
        let deadline = Instant::now() + max_wait;
        while Instant::now() < deadline {
            match self.client.receive_response() {
                Ok(Some((answered, reply))) if answered == id => return Ok(Some(reply.sum)),
                Ok(Some(_)) => {}
                Ok(None) => std::thread::sleep(LOOK_EVERY),
                Err(error) => bail!("the reply cannot be read: {error:?}"),
            }
        }
        Ok(None)
    }
}
