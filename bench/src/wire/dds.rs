//! Plain CycloneDDS: CDR in, CDR out, with the quality of service that a route has by default.

use std::sync::Arc;
use std::time::Duration;

use anyhow::Result;
use wrapyfi_endpoint::codec::ros;
use wrapyfi_endpoint::{Qos, Wake};
use wrapyfi_node::NodeName;
use wrapyfi_ros2::graph::{CdrReader, CdrWriter, Graph, Notify, TopicDescription};
use wrapyfi_ros2::{CycloneConfig, CycloneGraph};

use super::end::{Incoming, Outgoing, Place};
use crate::clock;
use crate::payload::{Kind, Maker, Numbered, number_in_cdr};

/// A node of its own on this host.
fn graph(name: &str, domain: u32) -> Result<CycloneGraph> {
    let node = NodeName::new(name, "/bench")?;
    Ok(CycloneGraph::new(&CycloneConfig::loopback(node, domain))?)
}

fn topic(place: &Place) -> TopicDescription {
    let message_type = place.payload.message_type();
    TopicDescription {
        name: place.topic.clone(),
        type_name: message_type.ros_type().to_owned(),
        type_hash: Some(ros::type_hash(message_type).to_owned()),
        qos: Qos::default(),
        max_bytes: 64 << 20,
        hears_own: false,
    }
}

pub(super) struct Out {
    writer: Box<dyn CdrWriter>,
    message: Numbered,
}

impl Out {
    pub(super) fn new(maker: &Maker, place: &Place) -> Result<Self> {
        let writer = graph("source", place.domain)?.advertise(&topic(place), Arc::new(|| {}))?;
        Ok(Self { writer, message: maker.cdr()? })
    }
}

impl Outgoing for Out {
    fn prepare(&mut self, seq: u32) -> Result<()> {
        self.message.number_cdr(seq);
        Ok(())
    }

    fn send(&mut self) -> Result<()> {
        Ok(self.writer.write(&[&self.message.body])?)
    }
}

pub(super) struct In {
    reader: Box<dyn CdrReader>,
    wake: Wake,
    kind: Kind,
}

impl In {
    pub(super) fn new(place: &Place) -> Result<Self> {
        let wake = Wake::new();
        let bell = wake.clone();
        let notify: Notify = Arc::new(move || bell.ring());
        let reader = graph("sink", place.domain)?.subscribe(&topic(place), notify)?;
        Ok(Self { reader, wake, kind: place.payload })
    }
}

impl Incoming for In {
    fn next(&mut self, patience: Duration) -> Result<Option<(u32, u64)>> {
        loop {
            if let Some(sample) = self.reader.take()? {
                let received = clock::now();
                return Ok(Some((number_in_cdr(self.kind, &sample.cdr)?, received)));
            }
            if !self.wake.wait(patience) {
                return Ok(None);
            }
        }
    }
}
