//! Plain CycloneDDS: CDR in, CDR out, with the quality of service that the bridge's route has.

use std::sync::Arc;

use anyhow::Result;
use wrapyfi_endpoint::codec::ros;
use wrapyfi_endpoint::{History, Qos, Wake};
use wrapyfi_node::NodeName;
use wrapyfi_ros2::graph::{CdrWriter, Graph, Notify, TopicDescription};
use wrapyfi_ros2::{CycloneConfig, CycloneGraph};

use super::end::{Incoming, LOOK, Outgoing, Place};
use crate::clock;
use crate::payload::{Maker, Numbered, number_in_cdr};

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
        qos: Qos { history: History::KeepLast(place.payload.depth()), ..Qos::default() },
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

pub(super) fn incoming(place: &Place) -> Result<Incoming> {
    let (wake, kind) = (Wake::new(), place.payload);
    let bell = wake.clone();
    let notify: Notify = Arc::new(move || bell.ring());
    let mut reader = graph("sink", place.domain)?.subscribe(&topic(place), notify)?;
    Ok(Box::new(move || {
        loop {
            if let Some(sample) = reader.take()? {
                let received = clock::now();
                return Ok((number_in_cdr(kind, &sample.cdr)?, received));
            }
            wake.wait(LOOK);
        }
    }))
}
