//! An independent ROS 2 node in the test itself: ros2-client on RustDDS, written in Rust by others.

use std::net::Ipv4Addr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail};
use ros2_client::qos::{Durability, History, WhenFull};
use ros2_client::{
    Context, Message, MessageTypeName, Name, Node, NodeName, NodeOptions, QosProfile,
    ServiceMapping, Subscription, builtin_interfaces,
};
use rustdds::{DomainParticipantBuilder, Topic};
use serde::{Deserialize, Serialize};

use crate::{Asker, Result, TIMEOUT, ros_service};

/// `std_msgs/msg/Header`, written by hand from its definition.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct RosHeader {
    /// Time of the measurement.
    pub stamp: builtin_interfaces::Time,
    /// Name of the coordinate frame.
    pub frame_id: String,
}

/// `sensor_msgs/msg/Image`, written by hand from its definition.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[allow(missing_docs)]
pub struct RosImage {
    pub header: RosHeader,
    pub height: u32,
    pub width: u32,
    pub encoding: String,
    pub is_bigendian: u8,
    pub step: u32,
    pub data: Vec<u8>,
}

impl Message for RosImage {}

impl RosImage {
    /// A frame in one colour, three bytes a pixel in the order of `encoding`.
    pub fn plain(width: u32, height: u32, encoding: &str, pixel: [u8; 3]) -> Self {
        let header =
            RosHeader { stamp: builtin_interfaces::Time::ZERO, frame_id: "camera".to_owned() };
        let pixels = usize::try_from(u64::from(width) * u64::from(height)).unwrap_or(0);
        let data = pixel.repeat(pixels);
        Self {
            header,
            height,
            width,
            encoding: encoding.to_owned(),
            is_bigendian: 0,
            step: width * 3,
            data,
        }
    }
}

/// A node confined to the loopback interface. Keep it: without it, what it created falls silent.
pub struct RosNode {
    node: Node,
}

impl RosNode {
    /// Starts `/name` in a domain.
    pub fn new(domain: u16, name: &str) -> Result<Self> {
        let participant = DomainParticipantBuilder::new(domain)
            .with_only_networks([Ipv4Addr::LOCALHOST])
            .same_host_loopback(true)
            .build()
            .map_err(|e| anyhow::anyhow!("RustDDS participant in domain {domain}: {e:?}"))?;
        let context = Context::from_domain_participant(participant)
            .map_err(|e| anyhow::anyhow!("ros2-client context: {e:?}"))?;
        let name =
            NodeName::new("/", name).map_err(|e| anyhow::anyhow!("node name {name}: {e:?}"))?;
        let node = context
            .new_node(name, NodeOptions::new())
            .map_err(|e| anyhow::anyhow!("ros2-client node: {e:?}"))?;
        Ok(Self { node })
    }

    /// Subscribes to a topic, reliably.
    pub fn subscribe<M: Message + 'static>(
        &mut self,
        topic: &str,
        ros_type: &str,
    ) -> Result<Heard<M>> {
        self.subscribe_with(topic, ros_type, Durability::Volatile)
    }

    /// Subscribes to a topic, reliably, and asks for what was sent before.
    pub fn subscribe_kept<M: Message + 'static>(
        &mut self,
        topic: &str,
        ros_type: &str,
    ) -> Result<Heard<M>> {
        self.subscribe_with(topic, ros_type, Durability::TransientLocal)
    }

    fn subscribe_with<M: Message + 'static>(
        &mut self,
        topic: &str,
        ros_type: &str,
        durability: Durability,
    ) -> Result<Heard<M>> {
        let topic = self.topic(topic, ros_type, durability)?;
        let subscription = self
            .node
            .create_subscription(&topic, None)
            .map_err(|e| anyhow::anyhow!("subscription to {topic:?}: {e:?}"))?;
        Ok(Heard { subscription })
    }

    /// Publishes what `make` makes of 0, 1, 2, … at 20 Hz until the result is dropped.
    pub fn publish<M: Message + Send + 'static>(
        &mut self,
        topic: &str,
        ros_type: &str,
        make: impl Fn(u64) -> M + Send + 'static,
    ) -> Result<AtWork> {
        let topic = self.topic(topic, ros_type, Durability::Volatile)?;
        let publisher = self
            .node
            .create_publisher::<M>(&topic, None)
            .map_err(|e| anyhow::anyhow!("publisher of {topic:?}: {e:?}"))?;
        let mut numbers = 0..;
        Ok(AtWork::start(move || {
            let went = numbers.next().is_some_and(|next| publisher.publish(make(next)).is_ok());
            std::thread::sleep(Duration::from_millis(50)); // the rate
            went
        }))
    }

    /// Serves `example_interfaces/srv/AddTwoInts` until the result is dropped.
    pub fn serve_sums(&mut self, service: &str, mapping: ServiceMapping) -> Result<AtWork> {
        ros_service::adder(&mut self.node, service, mapping)
    }

    /// A client of such a service.
    pub fn ask_for_sums(&mut self, service: &str, mapping: ServiceMapping) -> Result<Asker> {
        Asker::new(&mut self.node, service, mapping)
    }

    fn topic(&self, topic: &str, ros_type: &str, durability: Durability) -> Result<Topic> {
        let (package, name) = ros_type
            .split_once("/msg/")
            .with_context(|| format!("{ros_type} is no message type"))?;
        let parsed =
            Name::parse(topic).map_err(|e| anyhow::anyhow!("topic name {topic}: {e:?}"))?;
        self.node
            .create_topic(&parsed, MessageTypeName::new(package, name), &qos(durability))
            .map_err(|e| anyhow::anyhow!("topic {topic}: {e:?}"))
    }
}

/// Reliable, with ten messages kept.
pub(crate) fn qos(durability: Durability) -> QosProfile {
    QosProfile::subscription_default()
        .reliability_reliable(WhenFull::DEFAULT)
        .durability(durability)
        .history(History::KeepLast { depth: 10 })
}

/// Subscription of a [`RosNode`].
pub struct Heard<M: 'static> {
    subscription: Subscription<M>,
}

impl<M: Message + 'static> Heard<M> {
    /// Waits for the next message.
    pub fn next(&self) -> Result<M> {
        let deadline = Instant::now() + TIMEOUT;
        loop {
            match self.subscription.take() {
                Ok(Some((message, _info))) => return Ok(message),
                Ok(None) if Instant::now() < deadline => {
                    std::thread::sleep(Duration::from_millis(5));
                }
                Ok(None) => bail!("the ros2-client node heard nothing"),
                Err(error) => bail!("the ros2-client node cannot read the message: {error:?}"),
            }
        }
    }
}

/// A [`RosNode`]'s publisher or server at work. Dropping it ends it.
pub struct AtWork {
    leave: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl AtWork {
    /// Turns until a turn says that it was the last.
    pub(crate) fn start(mut turn: impl FnMut() -> bool + Send + 'static) -> Self {
        let leave = Arc::new(AtomicBool::new(false));
        let told = Arc::clone(&leave);
        let thread = std::thread::spawn(move || while !told.load(Relaxed) && turn() {});
        Self { leave, thread: Some(thread) }
    }
}

impl Drop for AtWork {
    fn drop(&mut self) {
        self.leave.store(true, Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic in it was printed already.
            let _ended: std::thread::Result<()> = thread.join();
        }
    }
}
