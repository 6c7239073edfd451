//! `example_interfaces/srv/AddTwoInts` between an independent node and ours.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::bail;
use ros2_client::qos::{Durability, History, WhenFull};
use ros2_client::{Client, Message, Name, Node, QosProfile, ServiceMapping, ServiceTypeName};
use serde::{Deserialize, Serialize};

use crate::{Result, TIMEOUT};

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

fn qos() -> QosProfile {
    QosProfile::subscription_default()
        .reliability_reliable(WhenFull::DEFAULT)
        .durability(Durability::Volatile)
        .history(History::KeepLast { depth: 10 })
}

fn names(service: &str) -> Result<(Name, ServiceTypeName)> {
    let name =
        Name::parse(service).map_err(|e| anyhow::anyhow!("service name {service}: {e:?}"))?;
    Ok((name, ServiceTypeName::new("example_interfaces", "AddTwoInts")))
}

/// A server that adds, until it is dropped.
pub struct Adder {
    leave: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Adder {
    pub(crate) fn new(node: &mut Node, service: &str, mapping: ServiceMapping) -> Result<Self> {
        let (name, kind) = names(service)?;
        let server = node
            .create_server::<Request, Response>(mapping, &name, &kind, qos(), qos())
            .map_err(|e| anyhow::anyhow!("server of {service}: {e:?}"))?;
        let leave = Arc::new(AtomicBool::new(false));
        let told = Arc::clone(&leave);
        let thread = std::thread::spawn(move || {
            while !told.load(Relaxed) {
                match server.receive_request() {
                    Ok(Some((id, request))) => {
                        let sum = request.a.wrapping_add(request.b);
                        if server.send_response(id, Response { sum }).is_err() {
                            break;
                        }
                    }
                    _ => std::thread::sleep(LOOK_EVERY),
                }
            }
        });
        Ok(Self { leave, thread: Some(thread) })
    }
}

impl Drop for Adder {
    fn drop(&mut self) {
        self.leave.store(true, Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic in it was printed already.
            let _ended: std::thread::Result<()> = thread.join();
        }
    }
}

/// A client of a server that adds.
pub struct Asker {
    client: Client<Request, Response>,
}

impl Asker {
    pub(crate) fn new(node: &mut Node, service: &str, mapping: ServiceMapping) -> Result<Self> {
        let (name, kind) = names(service)?;
        let client = node
            .create_client::<Request, Response>(mapping, &name, &kind, qos(), qos())
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

    fn ask(&self, a: i64, b: i64, patience: Duration) -> Result<Option<i64>> {
        let id = self
            .client
            .send_request(Request { a, b })
            .map_err(|e| anyhow::anyhow!("request {a} + {b}: {e:?}"))?;
        let deadline = Instant::now() + patience;
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
