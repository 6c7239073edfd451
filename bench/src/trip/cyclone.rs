//! Bare CycloneDDS there and back, with the quality of service that a route has by default, which is
//! that of services too: reliable, keep last 10.

use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Result;
use wrapyfi_core::endpoint::{Qos, Wake};
use wrapyfi_core::middleware::ros2::graph::{
    CdrReader, CdrWriter, Graph as _, Notify, TopicDescription,
};

use super::{Far, Near, Place, message, number_of, service, set_number};
use crate::wire::dds::graph;

/// A writer one way and a reader the other.
pub(super) struct End {
    writer: Box<dyn CdrWriter>,
    reader: Box<dyn CdrReader>,
    wake: Wake,
    message: Vec<u8>,
}

impl End {
    pub(super) fn near(place: &Place) -> Result<Self> {
        let (request, _) = service::sizes(place.trip.load)?;
        Self::new("near", place, ("/ping", "/pong"), request)
    }

    pub(super) fn far(place: &Place) -> Result<Self> {
        let (_, reply) = service::sizes(place.trip.load)?;
        Self::new("far", place, ("/pong", "/ping"), reply)
    }

    fn new(name: &str, place: &Place, topics: (&str, &str), size: usize) -> Result<Self> {
        let mapping = place.trip.way.mapping();
        let graph = graph(name, place.domain, mapping)?;
        let topic = |name: &str| TopicDescription {
            name: name.to_owned(),
            type_name: "wrapyfi_bench/msg/Bare".to_owned(),
            type_hash: None,
            qos: Qos::default(),
            max_bytes: 1 << 20,
        };
        let wake = Wake::new();
        let bell = wake.clone();
        let notify: Notify = Arc::new(move || bell.ring());
        let reader = graph.subscribe(&topic(topics.1), notify)?;
        let writer = graph.advertise(&topic(topics.0), Arc::new(|| {}))?;
        Ok(Self { writer, reader, wake, message: message(size, mapping) })
    }

    fn write(&mut self, number: u32) -> Result<()> {
        set_number(&mut self.message, number);
        Ok(self.writer.write(&[&self.message])?)
    }
}

impl Near for End {
    fn call(&mut self, number: u32, patience: Duration) -> Result<bool> {
        self.write(number)?;
        let until = Instant::now() + patience;
        loop {
            while let Some(sample) = self.reader.take()? {
                if number_of(&sample.cdr) == Some(number) {
                    return Ok(true);
                }
            }
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(false);
            }
            self.wake.wait(left);
        }
    }
}

impl Far for End {
    fn serve(&mut self, patience: Duration) -> Result<()> {
        while let Some(sample) = self.reader.take()? {
            if let Some(number) = number_of(&sample.cdr) {
                self.write(number)?;
            }
        }
        self.wake.wait(patience);
        Ok(())
    }
}
