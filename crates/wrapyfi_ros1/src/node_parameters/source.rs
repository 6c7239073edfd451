//! The parameters of one node, as long as something asks for them.
//!
//! ```text
//!   descriptions, updates ─▶ ┐
//!   namespace             ─▶ ├─ task ─▶ State { described, values, plain } ─▶ ParameterStore ─▶ events
//!   what a set has come to ─▶ ┘                 waiting: why nothing is answered
//! ```
//!
//! A server that has gone takes all with it: what is left on the parameter server may be of a node that was killed.

use std::collections::{BTreeMap, BTreeSet};
use std::future::poll_fn;
use std::sync::{Arc, MutexGuard, Weak};
use std::task::Poll;
use std::time::{Duration, Instant};

use tokio::task::AbortHandle;
use tokio::time::timeout;
use wrapyfi_interfaces::rcl_interfaces::msg::{self, ParameterEvent};

use super::events::EventQueue;
use super::found::has_server;
use super::reconfigure::{
    Config, Described, read_config, read_description, service_type, topic_types, write_config,
};
use crate::client::call_once;
use crate::config::NAME;
use crate::listener::Ros1Listener;
use crate::node::Node;
use crate::parameters::{self, ParameterListener};
use crate::xmlrpc::text;
use wrapyfi_data::types::{MessageType, ParameterValue, Payload, Properties, Stamp};
use wrapyfi_endpoint::restart::restarted;
use wrapyfi_endpoint::{
    Absent, Cause, Context, Listener as _, Mutex, OpenResult, Role, TopicSpec, Wake,
};
use wrapyfi_node::parameters::{Parameter, ParameterDescriptor, ParameterStore};

/// Time between two looks for a server of dynamic_reconfigure.
const LOOK: Duration = Duration::from_secs(2);
/// Time after which a server whose connections have closed is gone.
const GONE_AFTER: Duration = Duration::from_secs(1);
/// Longest time between two looks at the connections.
const REST: Duration = Duration::from_millis(500);
/// Largest description, and reply of a server, in bytes.
const MAX_BYTES: usize = 4 << 20;

/// Cause for which nothing is answered before the first look.
const SOUGHT: Cause = Cause::Starting("a look at the parameters of the node");

/// The parameters of other nodes by their names, shared by all that ask for them.
#[derive(Default)]
pub(crate) struct SharedParameters(Mutex<BTreeMap<String, Weak<NodeParameters>>>);

/// The parameters of one node.
pub(crate) struct NodeParameters {
    node: Weak<Node>,
    /// Name of the node, or of the server in it.
    pub(super) name: String,
    state: Mutex<State>,
    task: Mutex<Option<AbortHandle>>,
}

/// Knowledge of the parameters.
pub(super) struct State {
    pub(super) store: ParameterStore,
    /// Those of the parameter server.
    plain: Properties,
    /// Those that a server of dynamic_reconfigure describes, and their values.
    described: Option<Vec<Described>>,
    values: Option<Config>,
    /// Cause for which nothing is answered.
    waiting: Option<Cause>,
    queues: Vec<Weak<EventQueue>>,
    /// Bells of those that wait for an answer.
    bells: Vec<Weak<Wake>>,
    /// Faults that the log has.
    told: BTreeSet<String>,
}

impl SharedParameters {
    /// The parameters of `name`.
    pub(super) fn of(&self, node: &Arc<Node>, name: &str) -> Arc<NodeParameters> {
        let mut known = self.0.lock();
        known.retain(|_, parameters| parameters.strong_count() > 0);
        if let Some(parameters) = known.get(name).and_then(Weak::upgrade) {
            return parameters;
        }
        let parameters = NodeParameters::new(node, name);
        known.insert(name.to_owned(), Arc::downgrade(&parameters));
        parameters
    }
}

impl NodeParameters {
    fn new(node: &Arc<Node>, name: &str) -> Arc<Self> {
        let state = State {
            store: ParameterStore::of_other(name),
            plain: Properties::new(),
            described: None,
            values: None,
            waiting: Some(SOUGHT),
            queues: Vec::new(),
            bells: Vec::new(),
            told: BTreeSet::new(),
        };
        let parameters = Arc::new(Self {
            node: Arc::downgrade(node),
            name: name.to_owned(),
            state: Mutex::new(state),
            task: Mutex::default(),
        });
        let (weak, told) = (Arc::downgrade(&parameters), Arc::downgrade(&parameters));
        let task = restarted(
            format!("the parameters of {name}"),
            move |what| {
                if let Some(told) = told.upgrade() {
                    told.state().wait_for(Some(Cause::Restarting(what)));
                }
            },
            move || follow(weak.clone()),
        );
        *parameters.task.lock() = Some(node.handle.spawn(task).abort_handle());
        parameters
    }

    pub(super) fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock()
    }

    /// Cause for which nothing is answered now.
    pub(crate) fn waiting_for(&self) -> Option<Cause> {
        self.state().waiting.clone()
    }

    /// Rings `bell` when that has changed, as long as the returned value lives.
    #[must_use]
    pub(super) fn ring(&self, bell: &Wake) -> Arc<Wake> {
        let bell = Arc::new(bell.clone());
        let mut state = self.state();
        state.bells.retain(|bell| bell.strong_count() > 0);
        state.bells.push(Arc::downgrade(&bell));
        bell
    }

    /// Gives `queue` all parameters, and each change from then on.
    pub(super) fn tell(&self, queue: &Arc<EventQueue>) {
        let mut state = self.state();
        let all = state.store.names().map(str::to_owned).collect::<Vec<_>>();
        let value = |name: &String| Some((name.clone(), state.store.get(name).ok()?.clone()));
        let named = all.iter().filter_map(value);
        let new = named.map(|(name, value)| msg::Parameter { name, value: value.into() });
        let event = ParameterEvent {
            stamp: time(Stamp::now()),
            node: self.name.clone(),
            new_parameters: new.collect(),
            ..ParameterEvent::default()
        };
        if !event.new_parameters.is_empty() {
            queue.put(&event);
        }
        state.queues.push(Arc::downgrade(queue));
    }

    /// Sets parameters that are checked already: those that a server describes by its service in one call, the others at
    /// the master. For each what came of it: a remark, or why it was not set.
    pub(super) async fn set(
        &self,
        parameters: &[Parameter],
        within: Duration,
    ) -> BTreeMap<String, Result<String, String>> {
        let mut results = BTreeMap::new();
        let Some(node) = self.node.upgrade() else { return results };
        let described = self.state().described_names();
        let (of_server, plain): (Vec<_>, Vec<_>) =
            parameters.iter().partition(|one| described.contains(&one.name));
        let wanted: Config =
            of_server.into_iter().map(|one| (one.name.clone(), one.value.clone())).collect();
        if !wanted.is_empty() {
            let made = self.reconfigure(&node, &wanted, within).await;
            for (name, value) in &wanted {
                results.insert(
                    name.clone(),
                    match &made {
                        Err(why) => Err(why.clone()),
                        Ok(made) => match made.get(name) {
                            Some(now) if now != value => {
                                Ok(format!("{} made {now} of {value}", self.name))
                            }
                            _ => Ok(String::new()),
                        },
                    },
                );
            }
        }
        for Parameter { name, value } in plain {
            if let Some((server, own)) = self.server_of(&node, name, within).await {
                let why = format!(
                    "{name} is what the dynamic_reconfigure server {server} leaves on the parameter server, and does not read \
                     again: set {own} of the node of that name"
                );
                results.insert(name.clone(), Err(why));
                continue;
            }
            let (key, value_there) =
                (parameters::under(&self.name, name), parameters::to_xml(value));
            let (method, params) = match value_there {
                Some(value) => ("setParam", vec![text(&key), value]),
                None => ("deleteParam", vec![text(&key)]),
            };
            let done = node.master.ask(method, params).await;
            if done.is_ok() {
                let mut state = self.state();
                state.plain.apply(&Properties::from([(name.as_str(), value.clone())]));
                state.show(&self.name);
            }
            // The master does not tell its caller.
            parameters::changed(&node, &key);
            let done = done.map(|_| String::new()).map_err(|error| error.to_string());
            results.insert(name.clone(), done);
        }
        results
    }

    /// The server of dynamic_reconfigure below this node that describes a parameter, and the parameter's name there.
    async fn server_of<'p>(
        &self,
        node: &Arc<Node>,
        name: &'p str,
        within: Duration,
    ) -> Option<(String, &'p str)> {
        let (namespace, own) = name.rsplit_once('.')?;
        let server = parameters::under(&self.name, namespace);
        // A master that does not answer is told of by what is asked of it next.
        if !has_server(&node.master, &server).await.unwrap_or(false) {
            return None;
        }
        let parameters = Self::new(node, &server);
        let wake = Wake::new();
        let _bell = parameters.ring(&wake);
        let described = async {
            while parameters.waiting_for().is_some() {
                _ = timeout(REST, rung(&wake)).await;
            }
        };
        _ = timeout(within.min(LOOK), described).await;
        let is_described = parameters.state().described_names().contains(own);
        is_described.then_some((server, own))
    }

    /// Calls the server; its values then.
    async fn reconfigure(
        &self,
        node: &Arc<Node>,
        wanted: &Config,
        within: Duration,
    ) -> Result<Config, String> {
        let service = format!("{}/set_parameters", self.name);
        let body = write_config(wanted);
        let wire_type = service_type();
        let call = call_once(node, &service, &wire_type, &body, MAX_BYTES);
        let reply = timeout(within, call).await.unwrap_or_else(|_elapsed| {
            Err(format!("{service} did not answer within {} ms", within.as_millis()))
        })?;
        let made = read_config(&reply);
        let made = made.ok_or_else(|| {
            format!("{service} answered {} bytes that are no Config", reply.len())
        })?;
        let mut state = self.state();
        if let Some(values) = &mut state.values {
            values.extend(made.clone());
        }
        state.show(&self.name);
        Ok(made)
    }
}

impl Drop for NodeParameters {
    fn drop(&mut self) {
        if let Some(task) = self.task.lock().take() {
            task.abort();
        }
    }
}

impl State {
    fn described_names(&self) -> BTreeSet<String> {
        let all = self.described.iter().flatten();
        all.map(|one| one.descriptor.name.clone()).collect()
    }

    /// Checks that a parameter may have a value.
    pub(super) fn check(&self, parameter: &Parameter) -> Result<(), String> {
        self.store.check(parameter).map_err(|error| error.reason())?;
        let mut all = self.described.iter().flatten();
        let one = all.find(|one| one.descriptor.name == parameter.name);
        match one {
            Some(one) if !one.choices.is_empty() && !one.choices.contains(&parameter.value) => {
                let (name, allowed) = (&parameter.name, &one.descriptor.additional_constraints);
                Err(format!("Parameter {name} is {allowed}; value: {}", parameter.value))
            }
            _ => Ok(()),
        }
    }

    fn wait_for(&mut self, cause: Option<Cause>) {
        if self.waiting != cause {
            self.waiting = cause;
            self.bells.retain(|bell| bell.strong_count() > 0);
            self.bells.iter().filter_map(Weak::upgrade).for_each(|bell| bell.ring());
        }
    }

    /// Has the store hold what is known, and tells of the changes.
    fn show(&mut self, name: &str) {
        let described = self.described_names();
        let of_server = self.described.iter().flatten().filter_map(|one| {
            let value = self.values.as_ref()?.get(&one.descriptor.name)?;
            Some((one.descriptor.clone(), value.clone()))
        });
        let plain = self.plain.iter().filter(|(name, _)| !described.contains(*name));
        let plain =
            plain.map(|(name, value)| (ParameterDescriptor::new(name).dynamic(), value.clone()));
        let all: Vec<(ParameterDescriptor, ParameterValue)> = of_server.chain(plain).collect();
        let faults = self.store.become_these(all);
        self.log(name, faults.iter().map(ToString::to_string));
        self.queues.retain(|queue| queue.strong_count() > 0);
        for event in self.store.take_events(Stamp::now()) {
            self.queues.iter().filter_map(Weak::upgrade).for_each(|queue| queue.put(&event));
        }
    }

    /// Logs faults, each once.
    fn log(&mut self, name: &str, faults: impl IntoIterator<Item = String>) {
        const MAX_TOLD: usize = 100;
        let mut more = 0_usize;
        for fault in faults {
            if self.told.len() >= MAX_TOLD {
                more += 1;
            } else if self.told.insert(fault.clone()) {
                tracing::warn!("ROS 1: parameters of {name}: {fault}");
            }
        }
        if more > 0 && self.told.insert(String::new()) {
            tracing::warn!("ROS 1: parameters of {name}: {more} more faults");
        }
    }

    fn forget(&mut self, name: &str) {
        (self.plain, self.described, self.values) = (Properties::new(), None, None);
        self.wait_for(Some(SOUGHT));
        self.show(name);
    }
}

fn time(stamp: Stamp) -> wrapyfi_interfaces::builtin_interfaces::msg::Time {
    wrapyfi_interfaces::builtin_interfaces::msg::Time { sec: stamp.sec, nanosec: stamp.nanosec }
}

/// Sources of the parameters until their server goes.
struct Heard {
    context: Context,
    namespace: ParameterListener,
    /// Descriptions and values of a server, where there is one.
    topics: Option<[Ros1Listener; 2]>,
    looked: Option<Instant>,
    is_sought: bool,
    /// There was one, with which all has gone until it comes back.
    had_server: bool,
    gone_since: Option<Instant>,
}

async fn follow(parameters: Weak<NodeParameters>) {
    for had_server in [false].into_iter().chain(std::iter::repeat(true)) {
        let mut heard = {
            let Some(parameters) = parameters.upgrade() else { return };
            let Some(node) = parameters.node.upgrade() else { return };
            Heard::open(&node, &parameters.name, had_server)
        };
        loop {
            let wake = heard.context.wake.clone();
            {
                let Some(parameters) = parameters.upgrade() else { return };
                if !heard.look(&parameters).await {
                    parameters.state().forget(&parameters.name);
                    break;
                }
            }
            _ = timeout(REST, rung(&wake)).await;
        }
    }
}

/// Waits until a bell has rung.
async fn rung(bell: &Wake) {
    poll_fn(|task| {
        bell.notify(task.waker());
        if bell.wait(Duration::ZERO) { Poll::Ready(()) } else { Poll::Pending }
    })
    .await;
}

impl Heard {
    fn open(node: &Arc<Node>, name: &str, had_server: bool) -> Self {
        let context = Context::default();
        let spec = TopicSpec::new(name, MessageType::Properties);
        let namespace = ParameterListener::open(node, name, &spec, &context);
        Self {
            context,
            namespace,
            topics: None,
            looked: None,
            is_sought: true,
            had_server,
            gone_since: None,
        }
    }

    /// Opens the topics of a server of dynamic_reconfigure once the master lists one.
    async fn seek(&mut self, node: &Arc<Node>, name: &str) {
        if self.topics.is_some() || self.looked.is_some_and(|at| at.elapsed() < LOOK) {
            return;
        }
        self.looked = Some(Instant::now());
        match has_server(&node.master, name).await {
            Ok(true) => match self.listen(node, name) {
                Ok(topics) => (self.topics, self.is_sought) = (Some(topics), false),
                Err(error) => tracing::warn!("ROS 1: parameters of {name}: {error}"),
            },
            Ok(false) => self.is_sought = false,
            // The node waits for the master, and says so.
            Err(_) => {}
        }
    }

    fn listen(&self, node: &Arc<Node>, name: &str) -> OpenResult<[Ros1Listener; 2]> {
        let [described, values] = topic_types();
        let listen = |topic: &str, wire_type| {
            let topic = format!("{name}/{topic}");
            let mut spec = TopicSpec::new(&topic, MessageType::Properties);
            spec.limits.message_bytes = MAX_BYTES;
            Ros1Listener::open(node, &topic, wire_type, &spec, &self.context)
        };
        Ok([listen("parameter_descriptions", described)?, listen("parameter_updates", values)?])
    }

    /// Takes what has come; false once the server has gone.
    async fn look(&mut self, parameters: &NodeParameters) -> bool {
        let name = &parameters.name;
        let Some(node) = parameters.node.upgrade() else { return true };
        self.seek(&node, name).await;
        let mut state = parameters.state();
        let mut is_news = false;
        loop {
            match self.namespace.take() {
                Ok(None) => break,
                Ok(Some(sample)) => {
                    if let Payload::Properties(changes) = &sample.payload {
                        state.plain.apply(changes);
                        is_news = true;
                    }
                }
                Err(fault) => state.log(name, [fault.to_string()]),
            }
        }
        if let Some([descriptions, updates]) = &mut self.topics {
            while let Some(arrival) = descriptions.next() {
                let read = read_description(&arrival.message);
                let (described, faults) = read.unwrap_or_else(|| {
                    (Vec::new(), vec!["its description is not readable".to_owned()])
                });
                state.log(name, faults);
                state.described = Some(described);
                is_news = true;
            }
            while let Some(arrival) = updates.next() {
                match read_config(&arrival.message) {
                    Some(values) => state.values = Some(values),
                    None => state.log(name, ["its values are not readable".to_owned()]),
                }
                is_news = true;
            }
        }
        let waiting = self.waiting(&node, &state, name);
        if waiting.is_none() && (is_news || state.waiting.is_some()) {
            state.show(name);
        }
        state.wait_for(waiting);
        !self.is_gone(state.described.is_some() && state.values.is_some())
    }

    /// True once a server that was there has no connection for a while.
    fn is_gone(&mut self, was_there: bool) -> bool {
        let Some(topics) = &self.topics else { return false };
        let is_up = topics.iter().all(|topic| topic.link().has_peers());
        if is_up || !was_there {
            self.gone_since = None;
            return false;
        }
        self.gone_since.get_or_insert_with(Instant::now).elapsed() >= GONE_AFTER
    }

    /// Cause for which the parameters are not known.
    fn waiting(&self, node: &Node, state: &State, name: &str) -> Option<Cause> {
        let is_known = match &self.topics {
            Some(_) => state.described.is_some() && state.values.is_some(),
            None => !self.is_sought && !self.had_server && !state.plain.is_empty(),
        };
        if is_known {
            return None;
        }
        let lacks = self.topics.iter().flatten().find_map(|topic| topic.link().waiting_for);
        let nobody = || Absent::new(Role::Server, "parameters of ROS 1 below", NAME, name).into();
        Some(node.fault().or(lacks).unwrap_or_else(nobody))
    }
}
