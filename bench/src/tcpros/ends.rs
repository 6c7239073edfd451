//! The ends of a measured way: a bare publisher on TCPROS, and a bare subscriber there or on DDS.

use std::sync::Arc;
use std::time::Duration;

use anyhow::{Result, ensure};
use wrapyfi_core::endpoint::{History, Qos, Wake};
use wrapyfi_core::middleware::ros2::graph::{
    CdrReader, Graph as _, Notify, ServiceMapping, TopicDescription,
};

use super::load::{Framed, Load};
use super::raw::{RawPublisher, RawSubscriber};
use crate::clock;
use crate::wire::{Incoming, Outgoing, dds};

/// Messages that the reader on DDS keeps, as a listener of `/tf` does.
const DEPTH: u32 = 100;

/// Addresses of an end.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct Place {
    #[arg(long)]
    pub(crate) load: Load,
    #[arg(long)]
    pub(crate) topic: String,
    /// Address of the master.
    #[arg(long)]
    pub(crate) master: String,
    /// DDS domain of a sink there; none: TCPROS.
    #[arg(long)]
    pub(crate) domain: Option<u32>,
}

struct Out {
    publisher: RawPublisher,
    message: Framed,
}

/// The sending end.
pub(crate) fn outgoing(place: &Place) -> Result<Box<dyn Outgoing>> {
    let publisher = RawPublisher::open(&place.master, &place.topic, place.load.ros1_type())?;
    Ok(Box::new(Out { publisher, message: Framed::new(place.load)? }))
}

impl Outgoing for Out {
    fn prepare(&mut self, seq: u32) -> Result<()> {
        self.message.number(seq);
        Ok(())
    }

    fn send(&mut self) -> Result<()> {
        ensure!(self.publisher.send(&self.message.bytes) > 0, "nobody subscribes");
        Ok(())
    }
}

struct Tcpros {
    subscriber: RawSubscriber,
    load: Load,
}

impl Incoming for Tcpros {
    fn next(&mut self, patience: Duration) -> Result<Option<(u32, u64)>> {
        let Some(message) = self.subscriber.next(patience)? else { return Ok(None) };
        let received = clock::now();
        Ok(Some((self.load.number(message)?, received)))
    }
}

struct Dds {
    reader: Box<dyn CdrReader>,
    wake: Wake,
    load: Load,
}

impl Incoming for Dds {
    fn next(&mut self, patience: Duration) -> Result<Option<(u32, u64)>> {
        loop {
            if let Some(sample) = self.reader.take()? {
                let received = clock::now();
                return Ok(Some((self.load.number_in_cdr(&sample.cdr)?, received)));
            }
            if !self.wake.wait(patience) {
                return Ok(None);
            }
        }
    }
}

/// The receiving end.
pub(crate) fn incoming(place: &Place) -> Result<Box<dyn Incoming>> {
    let Place { load, topic, master, domain } = place;
    let Some(domain) = *domain else {
        let subscriber = RawSubscriber::open(master, topic, load.ros1_type())?;
        return Ok(Box::new(Tcpros { subscriber, load: *load }));
    };
    let wake = Wake::new();
    let bell = wake.clone();
    let notify: Notify = Arc::new(move || bell.ring());
    let description = TopicDescription {
        name: topic.clone(),
        type_name: load.ros2_type().to_owned(),
        type_hash: None,
        qos: Qos { history: History::KeepLast(DEPTH), ..Qos::default() },
        max_bytes: 64 << 20,
    };
    let node = format!("sink_{}", load.name());
    let graph = dds::graph(&node, domain, ServiceMapping::Cyclone)?;
    Ok(Box::new(Dds { reader: graph.subscribe(&description, notify)?, wake, load: *load }))
}
