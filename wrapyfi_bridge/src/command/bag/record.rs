//! `wrapyfi record`: topics of any side as messages of ROS 2 in a file.
//!
//! ```text
//!   discovery of a side ─ topic, type ─▶ listener ─ payload ─▶ CDR of the type in ROS 2 ─▶ recording::Writer
//! ```

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::BufWriter;
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use anyhow::Context as _;
use wrapyfi_bag::recording::{Topic, TopicId, Writer};
use wrapyfi_data::Limits;
use wrapyfi_data::codec::ros;
use wrapyfi_data::types::{Map, MessageType, Stamp};
use wrapyfi_endpoint::pattern::{bare, ros_name};
use wrapyfi_endpoint::{
    Context, Discovered, Discovery, Durability, EndpointAddress, LearnError, Listener, Middleware,
    Overflow, Qos, QueueSpec, Role, Throttle, TopicSpec, Wake,
};
use wrapyfi_interfaces::store::{ResolvedType, TypeStore};

use super::output::Place;
use crate::bag_cli::RecordArgs;
use crate::command::WAIT_SLICE;
use crate::command::definitions;
use crate::exit::{Failure, Result};
use crate::middlewares::{check_topic, conventions, described, for_endpoint, is_ros};
use crate::shutdown::Shutdown;

/// Time after which what has come is in the file, whatever then becomes of the process.
const WRITE_WITHIN: Duration = Duration::from_secs(5);
/// Time between two looks at the endpoints of a side.
const LOOK_EVERY: Duration = Duration::from_millis(100);
/// Topics of ROS about the nodes themselves, which are not recorded with all of a side.
const NODE_TOPICS: [&str; 3] = ["rosout", "rosout_agg", "parameter_events"];
/// Messages that wait for the file, for each topic.
const QUEUE_DEPTH: usize = 1000;

/// Records until the time is over, or the process is asked to end.
///
/// # Errors
/// Exit code 2 for endpoints that cannot be, and a recording that is there already; 1 where it cannot be written, and where nothing
/// came, which leaves no file.
pub fn run(args: &RecordArgs, shutdown: &Shutdown) -> Result<()> {
    let wake = Wake::new();
    let mut types = definitions::of_command(&args.definitions)?;
    let mut sides = sides(args)?;
    let place = Place::new(&args.output)?;
    let mut out = Tape { out: place.create(args.compression.into())?, taken: BTreeMap::new() };
    let end = args.seconds.map(|seconds| Instant::now() + seconds);
    let (mut looked, mut written) = (None::<Instant>, Instant::now());
    while !shutdown.requested() && end.is_none_or(|end| Instant::now() < end) {
        if looked.is_none_or(|at| at.elapsed() >= LOOK_EVERY) {
            for side in &mut sides {
                side.look(&mut types, &wake)?;
            }
            looked = Some(Instant::now());
        }
        let mut is_idle = true;
        for ear in sides.iter_mut().flat_map(|side| side.ears.values_mut()) {
            is_idle &= !ear.take(&mut out)?;
        }
        if written.elapsed() >= WRITE_WITHIN {
            out.out.flush().with_context(|| place.file.display().to_string())?;
            written = Instant::now();
        }
        if is_idle {
            let rest = end.map_or(WAIT_SLICE, |end| end.saturating_duration_since(Instant::now()));
            wake.wait(rest.min(WAIT_SLICE));
        }
    }
    let ears: Vec<_> = sides.iter().flat_map(|side| side.ears.values()).collect();
    ears.iter().for_each(|ear| ear.tell());
    let waiting: Vec<_> = sides.iter().flat_map(Side::unheard).collect();
    let (file, metadata) = (place.file.display(), place.finish(out.out)?);
    let (messages, topics) = (metadata.messages(), metadata.topics.len());
    waiting.iter().for_each(|text| tracing::warn!("not recorded: {text}"));
    if messages == 0 {
        place.remove();
        let sides: BTreeSet<_> = sides.iter().map(|side| side.name.as_str()).collect();
        let lists: Vec<_> = sides.iter().map(|side| format!("`wrapyfi list {side}`")).collect();
        return Err(Failure::Failed(anyhow::anyhow!(
            "no message came, and no recording is left; {} shows what is published",
            lists.join(", ")
        )));
    }
    tracing::info!("recorded {messages} messages of {topics} topics in {file}");
    Ok(())
}

/// The recording, with the names that are taken in it.
struct Tape {
    out: Writer<BufWriter<File>>,
    /// Address of each topic, by its name in the recording.
    taken: BTreeMap<String, EndpointAddress>,
}

impl Tape {
    /// Adds a topic under a name that ROS 2 allows, and no other topic has.
    fn add(
        &mut self,
        address: &EndpointAddress,
        resolved: &ResolvedType,
        qos: Qos,
    ) -> Result<TopicId> {
        let wanted = ros_name(&format!("/{}", bare(&address.name)));
        let mut name = wanted.clone();
        for number in 2_u32.. {
            match self.taken.get(&name) {
                Some(taken) if taken != address => name = format!("{wanted}_{number}"),
                _ => break,
            }
        }
        if name != address.name {
            tracing::info!("{address} is {name} in the recording");
        }
        let added = self.out.add_topic(&Topic::of(&name, resolved, vec![qos]));
        self.taken.insert(name, address.clone());
        Ok(added.context("the recording")?)
    }
}

/// A middleware whose topics are recorded.
struct Side {
    name: String,
    middleware: Arc<dyn Middleware>,
    discovery: Box<dyn Discovery>,
    /// Topics that were named; all where this is empty.
    wanted: BTreeSet<String>,
    ears: BTreeMap<String, Ear>,
    /// Reason why a topic has no listener yet.
    why: BTreeMap<String, String>,
    asked: BTreeSet<Option<String>>,
}

/// The sides of the endpoints that were named, each once.
fn sides(args: &RecordArgs) -> Result<Vec<Side>> {
    let mut named: BTreeMap<String, Option<BTreeSet<String>>> = BTreeMap::new();
    for endpoint in &args.endpoints {
        match endpoint.strip_suffix(':') {
            Some(side) => _ = named.insert(side.to_owned(), None),
            None => {
                let address: EndpointAddress = endpoint.parse().map_err(Failure::usage)?;
                check_topic(&address)?;
                let topics =
                    named.entry(address.middleware).or_insert_with(|| Some(BTreeSet::new()));
                if let Some(topics) = topics {
                    topics.insert(format!("/{}", bare(&address.name)));
                }
            }
        }
    }
    let sides = named.into_iter().map(|(name, topics)| {
        args.own.check(&name)?;
        let wanted = topics.unwrap_or_default();
        let first = wanted.first().cloned().unwrap_or_default();
        let address = EndpointAddress { middleware: name.clone(), name: first };
        let middleware = for_endpoint(&address, Role::Listener, args.own)?;
        let only = wanted.first().filter(|_| wanted.len() == 1).map(String::as_str);
        let discovery = middleware.discover_closely(only).map_err(Failure::usage)?;
        let (ears, why, asked) = (BTreeMap::new(), BTreeMap::new(), BTreeSet::new());
        Ok(Side { name, middleware, discovery, wanted, ears, why, asked })
    });
    sides.collect()
}

impl Side {
    /// Opens listeners for topics that have publishers and types, and none yet.
    fn look(&mut self, types: &mut TypeStore, wake: &Wake) -> Result<()> {
        let found = self.discovery.endpoints().with_context(|| self.name.clone())?;
        let publishers = found.iter().filter(|one| one.role == Role::Publisher);
        let new: Vec<_> = publishers
            .filter(|one| self.wants(&one.name) && !self.ears.contains_key(&one.name))
            .collect();
        for one in new {
            if self.ears.contains_key(&one.name) {
                continue;
            }
            let mut learned = self.middleware.learn_topic(one, types);
            if let Err(LearnError::Undefined { .. }) = learned
                && self.asked.insert(one.node.clone())
            {
                described(self.middleware.as_ref(), one, types);
                learned = self.middleware.learn_topic(one, types);
            }
            let address = EndpointAddress { middleware: self.name.clone(), name: one.name.clone() };
            let opened = learned.map_err(|error| error.to_string()).and_then(|learned| {
                let learned = learned.message_type(is_ros(&address));
                let message_type = self.middleware.received_as(learned, &Map::default());
                Ear::open(
                    self.middleware.as_ref(),
                    address,
                    message_type,
                    (one, found.as_slice()),
                    wake,
                )
            });
            match opened {
                Ok(ear) => {
                    tracing::info!(
                        "records {} ({})",
                        ear.address,
                        ear.spec.message_type.ros_type()
                    );
                    self.why.remove(&one.name);
                    self.ears.insert(one.name.clone(), ear);
                }
                Err(why) => _ = self.why.insert(one.name.clone(), why),
            }
        }
        Ok(())
    }

    /// True for topics that were named, and where none was for all but those that every program has about itself.
    fn wants(&self, name: &str) -> bool {
        if !self.wanted.is_empty() {
            return self.wanted.contains(name);
        }
        let bare = bare(name);
        let is_hidden = |part: &str| {
            let rest = part.strip_prefix('_');
            rest.is_some_and(|rest| !rest.starts_with(|first: char| first.is_ascii_digit()))
        };
        let own = conventions(&self.name).program_topics;
        let is_usual = own.iter().any(|prefix| bare.starts_with(prefix));
        !bare.split('/').any(is_hidden) && !NODE_TOPICS.contains(&bare) && !is_usual
    }

    /// Topics that were wanted and that nothing is recorded of, with the reason.
    fn unheard(&self) -> Vec<String> {
        let reasons = self.why.iter().map(|(name, why)| format!("{}:{name}: {why}", self.name));
        let is_unknown =
            |name: &&String| !self.ears.contains_key(*name) && !self.why.contains_key(*name);
        let absent = self.wanted.iter().filter(is_unknown);
        let absent = absent.map(|name| format!("{}:{name}: nobody published it", self.name));
        reasons.chain(absent).collect()
    }
}

/// A topic that is being recorded.
struct Ear {
    address: EndpointAddress,
    spec: TopicSpec,
    resolved: ResolvedType,
    qos: Qos,
    listener: Box<dyn Listener>,
    context: Context,
    /// The topic in the recording, from its first message on.
    topic: Option<TopicId>,
    losses: Throttle,
}

impl Ear {
    fn open(
        middleware: &dyn Middleware,
        address: EndpointAddress,
        message_type: MessageType,
        (one, all): (&Discovered, &[Discovered]),
        wake: &Wake,
    ) -> Result<Self, String> {
        let resolved = match message_type {
            MessageType::Ros(ros_type) => Ok(ros_type.resolved().clone()),
            known => TypeStore::generated().resolve_name(known.ros_type()),
        };
        let context = Context { wake: wake.clone(), ..Context::default() };
        let limits = Limits { message_bytes: 256 << 20, ..Limits::default() };
        let spec = TopicSpec {
            match_peers: true,
            queue: QueueSpec { depth: QUEUE_DEPTH, overflow: Overflow::DropOldest },
            limits,
            ..TopicSpec::new(&address.name, message_type)
        };
        let listener =
            middleware.open_listener(&spec, &context).map_err(|error| error.to_string())?;
        let publishers = all.iter().filter(|it| it.name == one.name && it.role == one.role);
        let qos = publishers.fold(None, |qos: Option<Qos>, it| {
            let keeps = middleware.keeps_last(it) == Some(true);
            let mut offered = qos.unwrap_or_default();
            if let Some(announced) = it.qos {
                offered.reliability = announced.reliability;
                offered.history = announced.history.unwrap_or(offered.history);
            }
            if keeps {
                offered.durability = Durability::TransientLocal;
            }
            Some(offered)
        });
        let resolved = resolved.map_err(|error| error.to_string())?;
        let (qos, topic, losses) = (qos.unwrap_or_default(), None, Throttle::default());
        Ok(Self { address, spec, resolved, qos, listener, context, topic, losses })
    }

    /// Writes what waits; false where nothing does.
    fn take(&mut self, out: &mut Tape) -> Result<bool> {
        for warning in self.listener.review(Instant::now()).warnings {
            tracing::warn!("{}: {warning}", self.address);
        }
        let sample = match self.listener.take() {
            Ok(None) => return Ok(false),
            Ok(Some(sample)) => sample,
            Err(error) => {
                self.lost((&error).into(), &error);
                return Ok(true);
            }
        };
        let payload = self.spec.conversion().convert(sample.payload, Stamp::now);
        let cdr = payload.map_err(anyhow::Error::new).and_then(|payload| {
            Ok(ros::encode(&payload, self.spec.message_type, &self.spec.plugins)?.to_bytes())
        });
        let cdr = match cdr {
            Ok(cdr) => cdr,
            Err(error) => {
                self.lost(wrapyfi_endpoint::DropReason::Unencodable, &error);
                return Ok(true);
            }
        };
        let topic = match self.topic {
            Some(topic) => topic,
            None => *self.topic.insert(out.add(&self.address, &self.resolved, self.qos)?),
        };
        // As much time ago as it has waited here.
        let received = SystemTime::now().checked_sub(sample.received_at.elapsed());
        let since = received.and_then(|at| at.duration_since(UNIX_EPOCH).ok()).unwrap_or_default();
        let received_ns = u64::try_from(since.as_nanos()).unwrap_or_default();
        out.out.write(topic, received_ns, received_ns, &cdr).context("the recording")?;
        Ok(true)
    }

    fn lost(&mut self, reason: wrapyfi_endpoint::DropReason, error: &dyn std::fmt::Display) {
        self.context.counters.dropped(reason);
        if let Some(unlogged_before) = self.losses.pass(Instant::now()) {
            tracing::warn!(unlogged_before, "{}: dropped a message: {error}", self.address);
        }
    }

    /// Says what was dropped.
    fn tell(&self) {
        for (reason, count) in self.context.counters.snapshot().drops {
            tracing::warn!("{}: {count} messages dropped: {reason}", self.address);
        }
    }
}
