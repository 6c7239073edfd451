//! `wrapyfi play`: publishes the messages of a recording, as they were in time.
//!
//! ```text
//!   Source ─ topic, time, CDR ─▶ due at start + (time − first) / rate ─▶ publisher of the topic
//!                                          └─ time of the recording ─▶ /clock
//! ```

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::{Duration, Instant};

use bytes::Bytes;
use wrapyfi_data::Limits;
use wrapyfi_data::codec::ros;
use wrapyfi_data::types::{MessageType, Payload, RosMessage, RosType, Stamp};
use wrapyfi_endpoint::{
    Context, EndpointAddress, Learned, Middleware, PublishError, Publisher, Qos, Role, Throttle,
    TopicSpec,
};
use wrapyfi_interfaces::builtin_interfaces::msg::Time;
use wrapyfi_interfaces::rosgraph_msgs::msg::Clock;
use wrapyfi_ros1::Ros1;

use super::source::{LeftOut, Played, PlayedTopic, Ros1Type, Source};
use crate::bag_cli::PlayArgs;
use crate::exit::{Failure, Result};
use crate::middlewares::{Endpoints, check_topic, for_endpoint, is_ros, ros1_observer};
use crate::shutdown::Shutdown;

/// Topic of the time.
const CLOCK: &str = "/clock";
/// Largest message on the wire of a side, in bytes.
const MOST_BYTES: usize = 512 << 20;
/// Nanoseconds of a second.
const SECOND_NS: u64 = 1_000_000_000;

/// Plays until the recording ends, or for ever with `--loop`, or until the process is asked to end.
///
/// # Errors
/// Exit code 2 for a file that is no recording, and topics that it has not; 1 where it cannot be read on.
pub fn run(args: &PlayArgs, shutdown: &Shutdown) -> Result<()> {
    let mut source = Source::open(&args.file, &args.definitions)?;
    let mut player = Player::new(args)?;
    player.open_new(source.topics())?;
    player.check_wanted(source.topics())?;
    player.wait_for_listeners(shutdown);
    loop {
        player.play(&mut source, shutdown)?;
        if shutdown.requested() || !args.again {
            break;
        }
        source = Source::open(&args.file, &args.definitions)?;
    }
    player.tell();
    if player.messages == 0 && !shutdown.requested() {
        let file = args.file.display();
        return Err(Failure::Failed(anyhow::anyhow!("{file} has no message that can be played")));
    }
    Ok(())
}

/// A topic that is being played.
struct Voice {
    publisher: Box<dyn Publisher>,
    spec: TopicSpec,
    ros_type: RosType,
    sent: u64,
    unheard: u64,
}

struct Player<'a> {
    args: &'a PlayArgs,
    middleware: Arc<dyn Middleware>,
    /// The same where it is ROS 1.
    ros1: Option<Arc<Ros1>>,
    address: EndpointAddress,
    wanted: BTreeSet<String>,
    context: Context,
    /// By the index of the topic in the source; none for those that are not played.
    voices: Vec<Option<Voice>>,
    names: Vec<String>,
    clock: Option<Voice>,
    losses: Throttle,
    lost: u64,
    /// Messages of topics that are played.
    messages: u64,
}

impl<'a> Player<'a> {
    fn new(args: &'a PlayArgs) -> Result<Self> {
        let (side, prefix) = args.to.split_once(':').unwrap_or((args.to.as_str(), ""));
        let (middleware, name) = (side.to_owned(), prefix.trim_end_matches('/').to_owned());
        args.own.check(side)?;
        let address = EndpointAddress { middleware, name };
        let mut endpoints = Endpoints::default();
        endpoints.reached_at(args.own);
        let (middleware, ros1): (Arc<dyn Middleware>, _) = match ros1_observer(&endpoints, side) {
            Some(ros1) => {
                let ros1 = ros1?;
                (Arc::clone(&ros1) as _, Some(ros1))
            }
            None => (for_endpoint(&address, Role::Publisher, args.own)?, None),
        };
        let mut player = Self {
            args,
            middleware,
            ros1,
            address,
            wanted: args.topics.iter().cloned().collect(),
            context: Context::default(),
            voices: Vec::new(),
            names: Vec::new(),
            clock: None,
            losses: Throttle::default(),
            lost: 0,
            messages: 0,
        };
        if args.clock.is_some() {
            let ros_type = RosType::of::<Clock>().map_err(Failure::usage)?;
            let name = CLOCK.to_owned();
            let clock = PlayedTopic { name, ros_type, qos: Qos::default(), of_ros1: None };
            player.clock = Some(player.voice(&clock)?);
        }
        Ok(player)
    }

    /// Opens publishers for the topics of the source that have none yet.
    fn open_new(&mut self, topics: &[Result<PlayedTopic, LeftOut>]) -> Result<()> {
        for topic in topics.iter().skip(self.voices.len()) {
            let voice = match topic {
                Err(why) => {
                    tracing::warn!("left out: {why}");
                    None
                }
                Ok(topic) => {
                    self.names.push(topic.name.clone());
                    let is_clock = self.clock.is_some() && topic.name == CLOCK;
                    let is_wanted = self.wanted.is_empty() || self.wanted.contains(&topic.name);
                    if is_wanted && !is_clock { Some(self.voice(topic)?) } else { None }
                }
            };
            self.voices.push(voice);
        }
        Ok(())
    }

    fn voice(&self, topic: &PlayedTopic) -> Result<Voice> {
        let PlayedTopic { name, ros_type, qos, of_ros1 } = topic;
        let name = format!("{}/{}", self.address.name, name.trim_start_matches('/'));
        let address = EndpointAddress { middleware: self.address.middleware.clone(), name };
        check_topic(&address)?;
        // Elsewhere programs expect the types of Wrapyfi.
        let message_type = Learned::Ros(*ros_type).message_type(is_ros(&address));
        let limits = Limits { message_bytes: MOST_BYTES, ..Limits::default() };
        let spec = TopicSpec { qos: *qos, limits, ..TopicSpec::new(&address.name, message_type) };
        if let (Some(ros1), Some(Ros1Type { name, md5sum, definition })) = (&self.ros1, of_ros1) {
            // One that cannot be read has been left out; one whose checksum lies is played as ROS 2 has it.
            _ = ros1.with_types(|types| types.show(name, md5sum, definition));
        }
        let publisher = self.middleware.open_publisher(&spec, &self.context);
        let publisher = publisher.map_err(|error| Failure::Usage(format!("{address}: {error}")))?;
        Ok(Voice { publisher, spec, ros_type: *ros_type, sent: 0, unheard: 0 })
    }

    /// Refuses names that the recording has not, or that cannot be played.
    fn check_wanted(&self, topics: &[Result<PlayedTopic, LeftOut>]) -> Result<()> {
        let file = self.args.file.display();
        let mut left_out = topics.iter().filter_map(|topic| topic.as_ref().err());
        if let Some(why) = left_out.find(|topic| self.wanted.contains(&topic.name)) {
            return Err(Failure::Usage(format!("{file}: {why}")));
        }
        let mut missing = self.wanted.iter().filter(|name| !self.names.contains(name));
        match missing.next() {
            // One without an index shows its topics as it is played.
            Some(name) if !self.names.is_empty() => Err(Failure::Usage(format!(
                "{file} has no topic {name}; it has {}",
                self.names.join(", ")
            ))),
            _ => Ok(()),
        }
    }

    /// Waits until each topic has a listener, at most as long as was said.
    fn wait_for_listeners(&mut self, shutdown: &Shutdown) {
        let end = Instant::now() + self.args.wait;
        loop {
            let all = self.voices.iter().flatten().chain(&self.clock);
            let is_heard = |voice: &Voice| {
                let link = voice.publisher.link();
                link.waiting_for.is_none() && link.peers != Some(0)
            };
            let open: Vec<_> = all.filter(|voice| !is_heard(voice)).collect();
            if open.is_empty() || shutdown.requested() {
                return;
            }
            if Instant::now() >= end {
                let names: Vec<_> = open.iter().map(|voice| voice.spec.topic.as_str()).collect();
                if !self.args.wait.is_zero() {
                    tracing::warn!("plays without a listener of {}", names.join(", "));
                }
                return;
            }
            let rest = end.saturating_duration_since(Instant::now());
            self.context.wake.wait(rest.min(crate::command::WAIT_SLICE));
        }
    }

    /// Plays the source once.
    fn play(&mut self, source: &mut Source, shutdown: &Shutdown) -> Result<()> {
        let begin = Instant::now();
        let (mut first_ns, mut tick) = (None, 0_u64);
        while let Some(next) = source.next()? {
            self.open_new(source.topics())?;
            if !self.voices.get(next.topic).is_some_and(Option::is_some) {
                continue;
            }
            self.messages += 1;
            let first = *first_ns.get_or_insert(next.time_ns);
            let since = Duration::from_nanos(next.time_ns.saturating_sub(first));
            let due = begin + since.div_f64(self.args.rate);
            if let Some(hz) = self.args.clock {
                // The time goes on where nothing else was recorded.
                loop {
                    let at = Duration::from_secs_f64(tick as f64 / hz);
                    if begin + at > due {
                        break;
                    }
                    if shutdown.wait_until(begin + at) {
                        return Ok(());
                    }
                    let time = at.mul_f64(self.args.rate).as_nanos();
                    let time = u64::try_from(time).unwrap_or(u64::MAX);
                    self.tell_time(first.saturating_add(time))?;
                    tick += 1;
                }
            }
            if shutdown.wait_until(due) {
                return Ok(());
            }
            self.publish(next);
        }
        Ok(())
    }

    fn publish(&mut self, next: Played) {
        let Some(Some(voice)) = self.voices.get_mut(next.topic) else { return };
        let sent = voice.publish(Bytes::from(next.cdr), next.time_ns);
        if let Err(error) = sent {
            self.lost += 1;
            if let Some(unlogged_before) = self.losses.pass(Instant::now()) {
                let topic = &voice.spec.topic;
                tracing::warn!(unlogged_before, "{topic}: a message was not sent: {error:#}");
            }
        }
    }

    fn tell_time(&mut self, time_ns: u64) -> Result<()> {
        let Some(clock) = &mut self.clock else { return Ok(()) };
        let sec = i32::try_from(time_ns / SECOND_NS).unwrap_or(i32::MAX);
        let nanosec = u32::try_from(time_ns % SECOND_NS).unwrap_or_default();
        let time =
            RosMessage::of(&Clock { clock: Time { sec, nanosec } }).map_err(Failure::usage)?;
        match clock.publish(time.cdr.to_bytes(), time_ns) {
            Ok(()) => Ok(()),
            Err(error) => Err(error.context(CLOCK).into()),
        }
    }

    /// Says what was played.
    fn tell(&self) {
        let all: Vec<_> = self.voices.iter().flatten().collect();
        let sent: u64 = all.iter().map(|voice| voice.sent).sum();
        let topics = all.len();
        tracing::info!("played {sent} messages of {topics} topics to {}", self.address.middleware);
        for voice in all.iter().filter(|voice| voice.unheard > 0) {
            let (count, topic) = (voice.unheard, &voice.spec.topic);
            tracing::info!("{topic}: nobody listened to {count} of its messages");
        }
        if self.lost > 0 {
            tracing::warn!("{} messages were not sent", self.lost);
        }
    }
}

impl Voice {
    fn publish(&mut self, cdr: Bytes, time_ns: u64) -> anyhow::Result<()> {
        let TopicSpec { limits, plugins, .. } = &self.spec;
        let payload = match self.spec.message_type {
            MessageType::Ros(_) => Payload::from(RosMessage::new(self.ros_type, cdr)),
            known => {
                let payload = ros::decode(&cdr, known, limits, plugins)?;
                let nanosec = u32::try_from(time_ns % SECOND_NS).unwrap_or_default();
                let sec = i32::try_from(time_ns / SECOND_NS).unwrap_or(i32::MAX);
                self.spec.conversion().convert(payload, || Stamp { sec, nanosec })?
            }
        };
        match self.publisher.publish(&payload) {
            Ok(_) => self.sent += 1,
            Err(PublishError::NoConsumer(_)) => self.unheard += 1,
            Err(error) => return Err(error.into()),
        }
        Ok(())
    }
}
