//! The parameters of another node as they change.
//!
//! ```text
//!              the node is there                 all names            all values
//!   Absent ──────────────────────▶ Listing ──────────────▶ Getting ──────────────▶ Following
//!     ▲                              ▲    no answer: Failed, and again after a while     │
//!     │                              └── events lost, or the node is another one ───────┤
//!     └────────────────────────────────── the node is gone ──────────────────────────────┘
//! ```
//!
//! No thread: the program that owns it calls when the bell rings, and when [`RemoteParameters::deadline`] has
//! come. Events that arrive while the values are read wait in the DDS reader and are applied behind
//! them, so that the last word is the node's.

use std::sync::Arc;
use std::time::{Duration, Instant};

use wrapyfi_interfaces::Message;
use wrapyfi_interfaces::rcl_interfaces::msg::ParameterEvent;
use wrapyfi_interfaces::rcl_interfaces::srv::{
    GetParameters, GetParameters_Request, GetParameters_Response, ListParameters,
    ListParameters_Request,
};

use super::asker::Asker;
use super::client::too_many;
use super::event::changes_by;
use super::options::{CHUNK, MAX_NAMES, ServiceOptions, node_name};
use super::{ParameterClientError, ParameterResult};
use crate::diagnosis::Names;
use crate::graph::{CdrReader, GraphError, PeerWatch, Peers, TopicDescription, ringing};
use crate::ros2::Ros2;
use wrapyfi_data::types::{ParameterValue, Properties};
use wrapyfi_endpoint::backoff::Backoff;
use wrapyfi_endpoint::{History, Qos, Ticket, Wake};
use wrapyfi_node::parameters::ParameterService;

/// Topic on which nodes report changes of their parameters.
const EVENTS: &str = "/parameter_events";
/// Events kept until they are taken, of all nodes.
const EVENTS_KEPT: u32 = 1000;
/// Time to the next look at things without a notification: a server that is found by half, the
/// name of the node behind an endpoint.
const LOOK_AGAIN: Duration = Duration::from_millis(10);
/// The same where it may take long, or never come.
const LOOK_SELDOM: Duration = Duration::from_secs(1);

/// The parameters of another node as they change: by what the node tells on `/parameter_events`, not
/// by asking again and again. Comes and goes with the node.
pub struct RemoteParameters {
    node: String,
    list: Asker<ListParameters>,
    get: Asker<GetParameters>,
    events: Box<dyn CdrReader>,
    /// Publishers of the events, which are other endpoints after a restart of the node.
    tellers: Box<dyn PeerWatch>,
    names: Arc<Names>,
    instance: Instance,
    /// Number of changes of the tellers that were seen, and the time of the next look at them.
    tellers_seen: (u64, Option<Instant>),
    stage: Stage,
    /// Pauses after which a node that did not answer is asked again.
    backoff: Backoff,
    known: Properties,
    /// Read once at least.
    found: bool,
    lost: u64,
    max_bytes: usize,
}

/// Marks that tell one life of the node from the next.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
struct Instance {
    servers: usize,
    tellers: Vec<[u8; 16]>,
}

#[derive(Debug)]
enum Stage {
    /// The node is not there.
    Absent,
    Listing(Ticket),
    Getting(Reading),
    Following,
    /// Asked again then.
    Failed(Instant),
}

/// The values as far as they were read.
#[derive(Debug)]
struct Reading {
    ticket: Ticket,
    /// Asked for now.
    asked: Vec<String>,
    /// Names that are to be asked for, the next ones last.
    left: Vec<Vec<String>>,
    values: Properties,
}

impl RemoteParameters {
    /// Begins to watch `node`, a name in our namespace unless it is absolute. The node need not be
    /// there. `wake` is rung when there may be news; values of more than `max_bytes` of the options
    /// together are refused.
    ///
    /// # Errors
    /// When no node can be called so, or DDS refuses.
    pub fn watch(
        ros2: &Ros2,
        node: &str,
        options: &ServiceOptions,
        wake: &Wake,
    ) -> ParameterResult<Self> {
        let node = node_name(ros2, node)?;
        let qos = Qos { history: History::KeepLast(EVENTS_KEPT), ..Qos::default() };
        let events = TopicDescription::of::<ParameterEvent>(EVENTS, qos, options.max_bytes);
        let backoff = Backoff::of_process(0).starting_at(LOOK_SELDOM);
        // Events first: nothing may change between the values and them.
        Ok(Self {
            events: ros2.graph().subscribe(&events, ringing(wake))?,
            tellers: ros2.graph().watch(EVENTS, true, ringing(wake))?,
            names: Arc::clone(&ros2.names),
            list: Asker::open(ros2, &node, ParameterService::List, options, wake)?,
            get: Asker::open(ros2, &node, ParameterService::Get, options, wake)?,
            node,
            instance: Instance::default(),
            tellers_seen: (u64::MAX, None),
            stage: Stage::Absent,
            backoff,
            known: Properties::new(),
            found: false,
            lost: 0,
            max_bytes: options.max_bytes,
        })
    }

    /// Full name of the node.
    pub fn node(&self) -> &str {
        &self.node
    }

    /// The parameters as far as they are known; what they last were, while the node is gone.
    pub fn known(&self) -> &Properties {
        &self.known
    }

    /// True while the node is there and its parameters are known.
    pub fn follows(&self) -> bool {
        matches!(self.stage, Stage::Following)
    }

    /// Readiness of the node's parameter services.
    pub fn servers(&self) -> Peers {
        self.list.servers()
    }

    /// Events that DDS lost since the last call. After each loss all values are read again.
    pub fn lost(&mut self) -> u64 {
        std::mem::take(&mut self.lost)
    }

    /// Takes the changes: at first all parameters, then each event, and after a restart of the node
    /// the differences. A parameter without a value is gone. Does not wait.
    ///
    /// # Errors
    /// When the node does not answer, or answers nonsense. It is asked again after a while.
    pub fn take(&mut self, now: Instant) -> ParameterResult<Option<Properties>> {
        let taken = self.look(now).and_then(|()| self.advance());
        if let Err(error) = &taken {
            tracing::debug!(node = self.node, %error, "parameters are not known");
            self.cancel();
            self.stage = Stage::Failed(now + self.backoff.wait());
        }
        taken
    }

    /// Time of the next [`RemoteParameters::take`] though nothing rang.
    pub fn deadline(&self, now: Instant) -> Option<Instant> {
        let stage = match &self.stage {
            Stage::Absent => self.may_be_there().then(|| now + LOOK_AGAIN),
            Stage::Listing(_) => self.list.deadline(),
            Stage::Getting(_) => self.get.deadline(),
            Stage::Following => None,
            Stage::Failed(until) => Some(*until),
        };
        stage.into_iter().chain(self.tellers_seen.1).min()
    }

    /// True when the node is found by half, or wholly since the last look: there is no notification of that.
    fn may_be_there(&self) -> bool {
        let ends = [self.list.servers(), self.get.servers()];
        let ready = ends.iter().all(|peers| matches!(peers, Peers::Ready(_)));
        ready || ends.contains(&Peers::Half)
    }

    /// Notices that the node has come, gone, or is another one than it was.
    fn look(&mut self, now: Instant) -> ParameterResult<()> {
        let (Peers::Ready(servers), Peers::Ready(_)) = (self.list.servers(), self.get.servers())
        else {
            if !matches!(self.stage, Stage::Absent) {
                tracing::debug!(node = self.node, "the node is gone");
                self.cancel();
                self.stage = Stage::Absent;
            }
            return Ok(());
        };
        let mut instance = Instance { servers, tellers: self.instance.tellers.clone() };
        let changes = self.tellers.changes();
        let (seen, due) = self.tellers_seen;
        if seen != changes || due.is_some_and(|due| now >= due) {
            let mut all_named = true;
            instance.tellers.clear();
            for teller in self.tellers.peers() {
                match self.names.owner(&teller.gid) {
                    Some(owner) if owner == self.node => instance.tellers.push(teller.gid),
                    Some(_) => {}
                    None => all_named = false,
                }
            }
            self.tellers_seen = (changes, (!all_named).then(|| now + LOOK_SELDOM));
        }
        let again = match self.stage {
            Stage::Absent => true,
            Stage::Failed(until) => now >= until,
            _ => instance != self.instance,
        };
        self.instance = instance;
        if again { self.read() } else { Ok(()) }
    }

    /// Begins to read all values.
    fn read(&mut self) -> ParameterResult<()> {
        self.cancel();
        // Should the request be refused, the caller says when to try again.
        self.stage = Stage::Listing(self.list.begin(&ListParameters_Request::default())?);
        Ok(())
    }

    fn cancel(&mut self) {
        match &self.stage {
            Stage::Listing(ticket) => self.list.cancel(*ticket),
            Stage::Getting(reading) => self.get.cancel(reading.ticket),
            _ => {}
        }
    }

    /// Goes on as far as what has arrived allows.
    fn advance(&mut self) -> ParameterResult<Option<Properties>> {
        loop {
            match std::mem::replace(&mut self.stage, Stage::Absent) {
                stage @ (Stage::Absent | Stage::Failed(_)) => {
                    self.stage = stage;
                    return Ok(None);
                }
                Stage::Listing(ticket) => {
                    let Some((ended, result)) = self.list.poll() else {
                        self.stage = Stage::Listing(ticket);
                        return Ok(None);
                    };
                    // Of a call before this one.
                    if ended != ticket {
                        self.stage = Stage::Listing(ticket);
                        continue;
                    }
                    if let Some(changes) = self.listed(&result?.result.names)? {
                        return Ok(Some(changes));
                    }
                }
                Stage::Getting(reading) => {
                    let Some((ended, result)) = self.get.poll() else {
                        self.stage = Stage::Getting(reading);
                        return Ok(None);
                    };
                    if ended != reading.ticket {
                        self.stage = Stage::Getting(reading);
                        continue;
                    }
                    if let Some(changes) = self.got(reading, result?)? {
                        return Ok(Some(changes));
                    }
                }
                Stage::Following => {
                    self.stage = Stage::Following;
                    return self.follow();
                }
            }
        }
    }

    fn listed(&mut self, names: &[String]) -> ParameterResult<Option<Properties>> {
        if names.len() > MAX_NAMES {
            return Err(too_many(&self.node, names.len()));
        }
        let mut left: Vec<Vec<String>> = names.chunks(CHUNK).map(<[String]>::to_vec).collect();
        left.reverse();
        self.ask_for_next(left, Properties::new())
    }

    /// Asks for the next values; what changed, where there are none left.
    fn ask_for_next(
        &mut self,
        mut left: Vec<Vec<String>>,
        values: Properties,
    ) -> ParameterResult<Option<Properties>> {
        let Some(asked) = left.pop() else { return Ok(self.have_read(values)) };
        let ticket = self.get.begin(&GetParameters_Request { names: asked.clone() })?;
        self.stage = Stage::Getting(Reading { ticket, asked, left, values });
        Ok(None)
    }

    fn got(
        &mut self,
        reading: Reading,
        reply: GetParameters_Response,
    ) -> ParameterResult<Option<Properties>> {
        let Reading { asked, mut left, mut values, .. } = reading;
        if reply.values.len() == asked.len() {
            for (name, value) in asked.into_iter().zip(reply.values) {
                let value = ParameterValue::try_from(value)
                    .map_err(|error| self.get.fault(format!("{name}: {error}")))?;
                // Without a value it is, for us, as if it were not there.
                if value != ParameterValue::NotSet {
                    values.insert(name, value);
                }
            }
            self.check_size(values.size())?;
        } else if asked.len() > 1 {
            // One of them has gone since it was listed, or has no value: which, is found by halves.
            let second = asked.get(asked.len() / 2..).map(<[String]>::to_vec);
            let first = asked.get(..asked.len() / 2).map(<[String]>::to_vec);
            left.extend(second.into_iter().chain(first));
        }
        self.ask_for_next(left, values)
    }

    fn have_read(&mut self, values: Properties) -> Option<Properties> {
        let changes = self.known.changes_to(&values);
        self.known = values;
        self.stage = Stage::Following;
        self.backoff.reset();
        let first = !std::mem::replace(&mut self.found, true);
        tracing::debug!(node = self.node, parameters = self.known.len(), "parameters are read");
        (first || !changes.is_empty()).then_some(changes)
    }

    /// The next event that changes something.
    fn follow(&mut self) -> ParameterResult<Option<Properties>> {
        loop {
            let lost = self.events.lost();
            if lost > 0 {
                self.lost = self.lost.saturating_add(lost);
                self.read()?;
                return Ok(None);
            }
            let sample = match self.events.take() {
                Ok(Some(sample)) => sample,
                Ok(None) => return Ok(None),
                Err(GraphError::TooLarge { .. }) => {
                    self.lost = self.lost.saturating_add(1);
                    self.read()?;
                    return Ok(None);
                }
                Err(error) => return Err(error.into()),
            };
            let event = match ParameterEvent::decode(&sample.cdr, self.max_bytes) {
                Ok(event) => event,
                // Of whichever node: the others go on.
                Err(error) => {
                    tracing::debug!(%error, "{EVENTS}: an event is not readable");
                    continue;
                }
            };
            if event.node != self.node {
                continue;
            }
            let changes = changes_by(&self.known, event).map_err(|fault| self.list.fault(fault))?;
            self.check_size(self.known.size().saturating_add(changes.size()))?;
            if !changes.is_empty() {
                self.known.apply(&changes);
                return Ok(Some(changes));
            }
        }
    }

    fn check_size(&self, actual: usize) -> ParameterResult<()> {
        if actual <= self.max_bytes {
            return Ok(());
        }
        let (node, what) = (self.node.clone(), "bytes of parameters:");
        Err(ParameterClientError::TooMuch { node, what, actual, limit: self.max_bytes })
    }
}
