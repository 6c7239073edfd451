//! A topic published: an output port that any program may connect.
//!
//! ```text
//!   publish ── payload::encode ──▶ Port ══▶ readers            the caller's thread, then tasks
//!   task: opens the port, counts its readers, keeps it connected to `out_topic_connect`
//!
//!   JointTrajectory ─▶ movements for a control board ─▶ a task writes each at its time, unless another
//!                                                       message comes before
//!
//!   /cam                  ─▶ port /cam                              any program connects it
//!   /icub/head/command:i  ─▶ port /icub/head/command:i:out:417 ══▶ the robot's /icub/head/command:i
//! ```
//!
//! A topic whose name is that of an input port of another program ([`input`]) writes to that port,
//! now or whenever it comes. Our own port then has a name that no program has to know, so the input's
//! name stays free for the program that opens it. Publishers of one name share the port ([`super::shared_output`]).

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::time::Duration;

use tokio::sync::watch;
use tokio::time::Instant;
use wrapyfi_yarp::port::{Connected, Overflow, PortOptions, Written};
use wrapyfi_yarp::{Bottle, Dialect};

use super::device::Device;
use super::input;
use super::link_state::LinkState;
use super::losses::Sent;
use super::name::{NAME, check_name};
use super::opening::{number, until_open};
use super::options::{BottleFormat, YarpOptions};
use super::payload::{self, Outgoing};
use super::port_connection::PortConnection;
use super::shared::InstanceState;
use super::shared_output::{PortSettings, SharedOutput};
use super::tasks::Stop;
use super::{found_format, name};
use wrapyfi_data::types::{DataType, MessageType, Payload, Stamp};
use wrapyfi_endpoint::backoff::Backoff;
use wrapyfi_endpoint::{
    Absent, Cause, Context, Counters, DropReason, Link, Mutex, OpenResult, PublishError, Publisher,
    Role, TopicSpec,
};
use wrapyfi_yarp::task::erased;

/// Sends one topic.
pub(super) struct YarpPublisher {
    spec: TopicSpec,
    /// The same under the name of the input port that it may mean, by which boards are known.
    command_spec: Option<TopicSpec>,
    dialect: Dialect,
    depth: usize,
    state: Arc<PublisherState>,
    counters: Arc<Counters>,
    shared: Arc<InstanceState>,
    _stop: Stop,
}

/// State that the publisher shares with its task.
#[derive(Debug)]
struct PublisherState {
    /// The port's name before the environment changes it.
    given: String,
    name: String,
    options: YarpOptions,
    /// True where the messages are pictures.
    pictures: bool,
    port: Mutex<Option<Arc<SharedOutput>>>,
    /// The port writes to an input of another program.
    commands: AtomicBool,
    /// A port is being opened: its name may be known already, and is not another program's.
    opening: watch::Sender<bool>,
    device: Device,
    /// True where native objects are written as Wrapyfi does, unless they go to an input port.
    writes_json: bool,
    link_state: Arc<LinkState>,
    /// Counts messages: a movement that is under way ends when another one comes.
    messages: AtomicU64,
}

impl PublisherState {
    /// Writes the forms of a message to their readers, files to those of carrier mjpeg and objects to
    /// all others; none where the port is closed.
    fn write(
        &self,
        messages: impl IntoIterator<Item = Outgoing>,
        sent: &Arc<Sent>,
    ) -> Option<Written> {
        let (mut written, mut number) = (Written::default(), None);
        let output = self.port.lock();
        let SharedOutput { port, count, .. } = output.as_deref()?;
        for Outgoing { payload, stamp } in messages {
            let stamp = stamp.map(|stamp| {
                let count = *number.get_or_insert_with(|| count.fetch_add(1, Relaxed));
                wrapyfi_yarp::sig::Stamp { count, ..stamp }
            });
            sent.write(port, payload, stamp, &mut written);
        }
        Some(written)
    }

    /// Names of the ports that read.
    fn readers(&self) -> Vec<String> {
        let port = self.port.lock();
        let status = port.as_ref().map(|output| output.port.status()).unwrap_or_default();
        status.into_iter().filter(|one| !one.incoming).map(|one| one.name).collect()
    }
}

impl YarpPublisher {
    pub(super) fn open(
        shared: &Arc<InstanceState>,
        spec: &TopicSpec,
        options: YarpOptions,
        context: &Context,
    ) -> OpenResult<Self> {
        let name = options.port.clone().unwrap_or_else(|| spec.topic.clone());
        check_name(&name)?;
        let given = name;
        let name = shared.own_name(&given);
        let waiting = Cause::peer(name::port(&name), " to open", None, "");
        let link_state = Arc::new(LinkState::new(context.wake.clone(), waiting));
        let with_colon = input::with_colon(&spec.topic).filter(|port| input::is_input(port));
        let destination = options.out_topic_connect.as_deref();
        let destination = destination.or(with_colon.as_deref()).unwrap_or(&spec.topic);
        let command_spec = with_colon.clone().map(|topic| TopicSpec { topic, ..spec.clone() });
        let state = Arc::new(PublisherState {
            given,
            name,
            port: Mutex::default(),
            commands: AtomicBool::new(false),
            opening: watch::Sender::new(false),
            device: Device::new(spec.message_type, &options, destination),
            writes_json: found_format::writes_json(spec.message_type, &options),
            link_state,
            messages: AtomicU64::new(0),
            pictures: spec.message_type.data_type() == DataType::Image,
            options,
        });
        let dialect = shared.network(&state.options).dialect();
        let kept = (Arc::clone(shared), Arc::clone(&state));
        let stop = shared.tasks.spawn(&state.name, &state.link_state, kept, keep, close);
        Ok(Self {
            spec: spec.clone(),
            command_spec,
            dialect,
            depth: shared.send_queue,
            state,
            counters: Arc::clone(&context.counters),
            shared: Arc::clone(shared),
            _stop: stop,
        })
    }

    fn nobody(&self) -> PublishError {
        PublishError::NoConsumer(self.spec.topic.clone())
    }

    /// Writes a message; what readers miss of it is counted.
    fn write(
        &self,
        messages: impl IntoIterator<Item = Outgoing>,
        sent: &Arc<Sent>,
    ) -> Result<(), PublishError> {
        let written = self.state.write(messages, sent).unwrap_or_default();
        if written.dropped < written.targets || written.over_budget > 0 {
            sent.queued(written);
            return Ok(());
        }
        sent.refused();
        if written.targets == 0 {
            return Err(self.nobody());
        }
        let (topic, depth) = (self.spec.topic.clone(), self.depth);
        Err(PublishError::QueueFull { topic, depth })
    }

    /// Makes a request of the board that the messages are for; its bytes.
    fn request(&self, request: Bottle, bytes: usize) -> usize {
        let (state, sent) = (Arc::clone(&self.state), Sent::new(&self.counters, bytes));
        let shared = Arc::clone(&self.shared);
        self.shared.tasks.spawn_aside(async move {
            if let Err(why) = state.device.request(&shared, &request).await {
                tracing::warn!("{}: {} was not done: {why}", state.name, request.to_text());
                sent.missed(DropReason::ConnectionLost);
            }
        });
        bytes
    }

    /// Writes movements at their times, those of now at once; their bytes.
    fn run(&self, movements: Vec<(Duration, Outgoing)>, own: u64) -> Result<usize, PublishError> {
        let begin = Instant::now();
        let bytes = movements.iter().map(|(_, movement)| movement.payload.bytes.len()).sum();
        let (mut later, sent) = (Vec::new(), Sent::new(&self.counters, bytes));
        for (due, movement) in movements {
            if due.is_zero() {
                self.write([movement], &sent)?;
            } else {
                later.push((due, movement));
            }
        }
        let state = Arc::clone(&self.state);
        self.shared.tasks.spawn_aside(async move {
            for (due, movement) in later {
                let Some(time) = begin.checked_add(due) else { break };
                tokio::time::sleep_until(time).await;
                if state.messages.load(Relaxed) != own {
                    break;
                }
                match state.write([movement], &sent) {
                    Some(written) if written.targets > 0 => sent.queued(written),
                    _ => return sent.missed(DropReason::ConnectionLost),
                }
            }
        });
        Ok(bytes)
    }
}

/// The life of a publisher: ports one after the other, as input ports of its name come.
async fn keep((shared, state): (Arc<InstanceState>, Arc<PublisherState>)) {
    let options = &state.options;
    // A user who names the port, or what it is connected to, means that.
    let is_fixed = options.port.is_some() || options.out_topic_connect.is_some();
    let is_free = !is_fixed && input::is_input(&state.given);
    let mut destination = is_free.then(|| state.given.clone());
    if !is_fixed && !input::may_mean(&state.given).is_empty() {
        // A port of ours that is closed again at once would only confuse.
        shared.directory.was_asked_in_time().await;
    }
    loop {
        let found = async {
            if is_fixed {
                return std::future::pending().await;
            }
            new_input(&shared, &state, destination.as_deref()).await
        };
        let found = tokio::select! {
            found = found => found,
            () = serve(&shared, &state, destination.as_deref()) => return,
        };
        // To its end, whatever ends meanwhile.
        _ = tokio::spawn(erased(close((Arc::clone(&shared), Arc::clone(&state))))).await;
        tracing::info!("{} writes to the port {found}, which exists", state.name);
        destination = Some(found);
    }
}

/// Waits for an input port that the publisher's name means, other than `now`, which is written to.
async fn new_input(shared: &InstanceState, state: &PublisherState, now: Option<&str>) -> String {
    let ports = input::may_mean(&state.given);
    if ports.is_empty() {
        return std::future::pending().await;
    }
    let bell = shared.directory.watch_any(&ports);
    let mut opening = state.opening.subscribe();
    loop {
        // One that is being opened is opened first: its registration would stay behind.
        if !*opening.borrow_and_update() {
            let is_others = |port: &str| shared.directory.knows(port) && !shared.own.contains(port);
            match input::meant(&state.given, is_others) {
                Some(found) if Some(found.as_str()) != now => return found,
                _ => {}
            }
        }
        tokio::select! {
            () = bell.notified() => {}
            Ok(()) = opening.changed() => {}
        }
    }
}

/// Has a port open for as long as it is run.
async fn serve(shared: &InstanceState, state: &PublisherState, destination: Option<&str>) {
    let PublisherState { options, pictures, .. } = state;
    let pictures = *pictures;
    let wanted = PortOptions {
        pictures,
        readers: YarpOptions::admission(options.to_peers.as_ref()),
        queue: shared.send_queue,
        // The publisher is told what finds no room, as on ZeroMQ.
        overflow: Overflow::DropNewest,
        ..PortOptions::default()
    };
    // Two colons: no other bridge takes it for an endpoint.
    let numbered = destination.map(|port| format!("{port}:out:{}", number()));
    let given = numbered.as_deref().unwrap_or(&state.given);
    let connects = options.out_topic_connect.clone();
    let settings = PortSettings {
        pictures,
        to_peers: options.to_peers.clone(),
        connects: connects.map(|to| (to, options.carrier.clone(), options.persistent)),
    };
    let opened = || async {
        let port = until_open(shared, &state.name, &state.link_state, || async {
            state.opening.send_replace(true);
            let opened = shared.network(options).open_output(given, &wanted).await;
            if opened.is_err() {
                state.opening.send_replace(false);
            }
            opened
        })
        .await;
        shared.own.insert(port.name());
        if state.writes_json && destination.is_none() {
            found_format::mark(shared, port.name()).await;
        }
        port
    };
    let mut backoff = Backoff::of_name(given);
    let output = loop {
        // Another publisher may be opening it: then its name is not another program's either.
        state.opening.send_replace(true);
        if let Some(output) = shared.outputs.open(given, &settings, opened).await {
            break output;
        }
        state.opening.send_replace(false);
        state.link_state.waiting(Cause::PortShared(name::address(given)));
        backoff.pause().await;
    };
    let name = output.port.name().to_owned();
    let changes = output.port.connected();
    state.commands.store(destination.is_some(), Relaxed);
    *state.port.lock() = Some(output);
    state.opening.send_replace(false);
    let connection = connection(&name, options, destination);
    let kept = async {
        let Some(connection) = &connection else { return std::future::pending().await };
        let is_connected = || state.readers().iter().any(|reader| reader == connection.other());
        connection
            .keep(shared, changes.clone(), &is_connected, &|why| {
                // A connection needs no name server: messages go on while it is away.
                if changes.borrow().outputs == 0 {
                    state.link_state.waiting(why);
                }
            })
            .await;
    };
    let has_outputs = || changes.borrow().outputs > 0;
    tokio::select! {
        () = count_readers(shared, &name, changes.clone(), state, connection.is_some()) => {}
        () = kept => {}
        () = state.device.follow(shared, changes.clone(), &has_outputs) => {}
    }
}

/// The connection that the port `own` of the publisher makes by itself.
fn connection(
    own: &str,
    options: &YarpOptions,
    destination: Option<&str>,
) -> Option<PortConnection> {
    match destination {
        // The name server would keep the wish of a port whose name is never used again.
        Some(to) => {
            Some(PortConnection::to(to, own, &YarpOptions { persistent: false, ..options.clone() }))
        }
        None => options.out_topic_connect.as_deref().map(|to| PortConnection::to(to, own, options)),
    }
}

/// Gives the port up that is open, if any; it closes with its last publisher.
async fn close((shared, state): (Arc<InstanceState>, Arc<PublisherState>)) {
    state.opening.send_replace(false);
    let output = state.port.lock().take();
    let Some(output) = output else { return };
    let name = output.port.name().to_owned();
    let wish = connection(&name, &state.options, None).filter(|_| !state.commands.load(Relaxed));
    output
        .close(&shared.own, async {
            if let Some(connection) = wish {
                connection.forget(&shared).await;
            }
        })
        .await;
}

/// Tells how many read, for as long as the port lives.
async fn count_readers(
    shared: &InstanceState,
    own: &str,
    mut changes: watch::Receiver<Connected>,
    state: &PublisherState,
    commands: bool,
) {
    loop {
        match changes.borrow_and_update().outputs {
            // The keeper of the connection knows why it is not there.
            0 if commands => {}
            0 => {
                let reader = Absent::new(Role::Listener, "a reader of", NAME, &state.name);
                state.link_state.waiting(reader);
            }
            readers => state.link_state.connected(readers),
        }
        state.readers().iter().for_each(|reader| shared.survey.met(reader, own, false));
        if changes.changed().await.is_err() {
            return;
        }
    }
}

impl Publisher for YarpPublisher {
    /// While no program is connected nothing is encoded: [`PublishError::NoConsumer`]. Messages that slow
    /// readers miss are counted as `send_queue_full`; those that a connection takes with it when it ends,
    /// as `connection_lost`. Readers of carrier mjpeg get a picture as a file, all others as an object.
    fn publish(&mut self, payload: &Payload) -> Result<usize, PublishError> {
        let (objects, pictures) = self.state.port.lock().as_ref().map_or((0, 0), |output| {
            let port = &output.port;
            let pictures = port.picture_readers();
            (port.connected().borrow().outputs.saturating_sub(pictures), pictures)
        });
        if objects + pictures == 0 {
            return Err(self.nobody());
        }
        let mut options = self.state.device.options();
        let dialect = options.dialect.unwrap_or(self.dialect);
        let commands = self.state.commands.load(Relaxed);
        let spec = self.command_spec.as_ref().filter(|_| commands).unwrap_or(&self.spec);
        // Objects for an input port of another program are bottles; messages of ROS have forms of
        // their own.
        let is_object = !matches!(spec.message_type, MessageType::Ros(_));
        if is_object && options.bottle.is_none() && commands {
            options =
                Arc::new(YarpOptions { bottle: Some(BottleFormat::Bottle), ..(*options).clone() });
        }
        let now = Stamp::now();
        let movements = payload::trajectory(payload, spec, &options, dialect, now)?;
        // A refused message leaves a movement under way.
        let next = || self.state.messages.fetch_add(1, Relaxed).wrapping_add(1);
        if let Some(movements) = movements {
            return self.run(movements, next());
        }
        if let Some(request) = payload::of_some_joints(payload, spec, &options, dialect)? {
            next();
            let bytes = request.encode(dialect).map_or(0, |bytes| bytes.len());
            return Ok(self.request(request, bytes));
        }
        let mut messages = Vec::new();
        for (readers, files) in [(objects, false), (pictures, true)] {
            if readers > 0 {
                let other = (options.sends_files() != files).then(|| options.sending_files(files));
                let options = other.as_ref().unwrap_or(&options);
                messages.push(payload::encode(payload, spec, options, dialect)?);
            }
        }
        let bytes = messages.iter().map(|message| message.payload.bytes.len()).max().unwrap_or(0);
        next();
        self.write(messages, &Sent::new(&self.counters, bytes))?;
        Ok(bytes)
    }

    fn link(&self) -> Link {
        let link = self.state.link_state.link();
        let why = self.shared.taken(&self.state.name).or_else(|| {
            let is_connected = link.waiting_for.is_none();
            self.state.device.awaited().filter(|_| is_connected)
        });
        match why {
            Some(why) => Link { waiting_for: Some(why), ..link },
            None => link,
        }
    }
}
