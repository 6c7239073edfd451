//! A service of a type known at run time, called and served as a program of a user does.

use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context as _, Result, ensure};
use wrapyfi_core::endpoint::{CallError, Wake};
use wrapyfi_core::middleware::ros2::{AnyClient, AnyServer, Ros2, ServiceOptions};
use wrapyfi_core::types::RosService;
use wrapyfi_interfaces::dynamic::DynamicMessage;
use wrapyfi_interfaces::parser::{Dialect, TypeName};
use wrapyfi_interfaces::store::TypeStore;

use super::{Far, Load, Near, Place, TIMEOUT};
use crate::wire::dds::graph;

/// Bytes of the text.
const TEXT: usize = 64 << 10;
const NAME: &str = "/asked";

/// The type of a load.
fn service(load: Load) -> Result<RosService> {
    let (name, text) = match load {
        Load::AddTwoInts => {
            ("example_interfaces/srv/AddTwoInts", "int64 a\nint64 b\n---\nint64 sum\n")
        }
        Load::Text64k => ("wrapyfi_bench/srv/Text", "string text\n---\nstring text\n"),
    };
    let mut store = TypeStore::empty();
    let name = TypeName::parse(Dialect::Ros2, name)?;
    store.add_definition(&name, text)?;
    Ok(RosService::new(&store.resolve(&name)?)?)
}

/// A request of a load.
fn request(load: Load, service: RosService) -> Result<DynamicMessage> {
    let mut request = service.request().plan().default_message();
    match load {
        Load::AddTwoInts => {
            request.set("a", 40_i64)?;
            request.set("b", 2_i64)?;
        }
        Load::Text64k => request.set("text", "x".repeat(TEXT))?,
    }
    Ok(request)
}

/// A reply of a load before it is known what is asked. The text is in it: what a program does to make
/// one is no part of a call.
fn reply(load: Load, service: RosService) -> Result<DynamicMessage> {
    let mut reply = service.response().plan().default_message();
    if load == Load::Text64k {
        reply.set("text", "y".repeat(TEXT))?;
    }
    Ok(reply)
}

/// Completes the reply to a request.
fn answer(load: Load, request: &DynamicMessage, reply: &mut DynamicMessage) -> Result<()> {
    match load {
        Load::AddTwoInts => {
            let operands = integer(request, "a").zip(integer(request, "b"));
            let (a, b) = operands.context("a request without a and b")?;
            reply.set("sum", i64::try_from(a + b)?)?;
        }
        Load::Text64k => ensure!(text_bytes(request) == Some(TEXT), "a request of another size"),
    }
    Ok(())
}

fn integer(message: &DynamicMessage, field: &str) -> Option<i128> {
    message.get(field)?.as_integer()
}

fn text_bytes(message: &DynamicMessage) -> Option<usize> {
    Some(message.get("text")?.as_str()?.len())
}

/// Bytes of request and reply with the encapsulation header, without what names the request.
pub(super) fn sizes(load: Load) -> Result<(usize, usize)> {
    let service = service(load)?;
    let request = request(load, service)?;
    let reply = reply(load, service)?;
    let request = service.request().plan().encode(&request)?.to_bytes().len();
    Ok((request, service.response().plan().encode(&reply)?.to_bytes().len()))
}

fn ros2(name: &str, place: &Place) -> Result<Ros2> {
    let graph = graph(name, place.domain, place.trip.way.mapping())?;
    Ok(Ros2::new(Arc::new(graph), |name| Ok(name.to_owned())))
}

/// The end that calls.
pub(super) struct Client {
    client: AnyClient,
    request: DynamicMessage,
    load: Load,
}

impl Client {
    pub(super) fn new(place: &Place) -> Result<Self> {
        let load = place.trip.load;
        let service = service(load)?;
        let request = request(load, service)?;
        let options = ServiceOptions { timeout: TIMEOUT, ..ServiceOptions::default() };
        let ros2 = ros2("near", place)?;
        let client = AnyClient::open(&ros2, NAME, service, &options, &Wake::new())?;
        Ok(Self { client, request, load })
    }
}

impl Near for Client {
    fn call(&mut self, _number: u32, _patience: Duration) -> Result<bool> {
        match self.client.call_and_wait(&self.request) {
            Ok(reply) => {
                let right = match self.load {
                    Load::AddTwoInts => integer(&reply, "sum") == Some(42),
                    Load::Text64k => text_bytes(&reply) == Some(TEXT),
                };
                ensure!(right, "a wrong reply");
                Ok(true)
            }
            Err(CallError::TimedOut { .. }) => Ok(false),
            Err(error) => Err(error.into()),
        }
    }
}

/// The end that serves.
pub(super) struct Server {
    server: AnyServer,
    reply: DynamicMessage,
    load: Load,
    wake: Wake,
}

impl Server {
    pub(super) fn new(place: &Place) -> Result<Self> {
        let (load, wake) = (place.trip.load, Wake::new());
        let ros2 = ros2("far", place)?;
        let options = ServiceOptions::default();
        let service = service(load)?;
        let reply = reply(load, service)?;
        let server = AnyServer::open(&ros2, NAME, service, &options, &wake)?;
        Ok(Self { server, reply, load, wake })
    }
}

impl Far for Server {
    fn serve(&mut self, patience: Duration) -> Result<()> {
        while let Some(request) = self.server.take()? {
            answer(self.load, &request.fields, &mut self.reply)?;
            self.server.reply(request.id, &self.reply)?;
        }
        let now = std::time::Instant::now();
        let due = self.server.deadline().map(|at| at.saturating_duration_since(now));
        self.wake.wait(due.map_or(patience, |due| due.min(patience)));
        Ok(())
    }
}
