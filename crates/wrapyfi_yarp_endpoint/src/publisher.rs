//! A topic published: an output port that anybody may connect.
//!
//! ```text
//!   publish ── payload::encode ──▶ OutputPort ══▶ readers            the caller's thread, then tasks
//!   task: opens the port, counts its readers, keeps it tied to `out_topic_connect`
//!
//!   JointTrajectory ─▶ movements for a control board ─▶ a task writes each at its time, unless another
//!                                                       message comes before
//!
//!   /cam                  ─▶ port /cam                              anybody connects it
//!   /icub/head/command:i  ─▶ port /icub/head/command:i:out:417 ══▶ the robot's /icub/head/command:i
//! ```
//!
//! A topic whose name is that of an input port of another program ([`input`]) writes to that port,
//! now or whenever it comes. Our own port then has a name that nobody has to know, so the input's
//! name stays free for the program that opens it.

use std::sync::atomic::{AtomicBool, AtomicI32, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::watch;
use tokio::time::Instant;
use wrapyfi_yarp::Dialect;
use wrapyfi_yarp::port::{
    Connected, Fate, Message, OutputOptions, OutputPort, Overflow, PayloadKind, PortOptions,
    Written,
};

use super::device::Device;
use super::losses::Sent;
use super::opening::{number, until_open};
use super::options::{Form, YarpOptions};
use super::payload::{self, Outgoing};
use super::standing::Standing;
use super::tasks::{Stop, Stopped};
use super::tie::Tie;
use super::{Shared, input};
use wrapyfi_data::types::{DataType, MessageType, Payload, Stamp};
use wrapyfi_endpoint::{
    Context, Counters, DropReason, Link, OpenError, PublishError, Publisher, TopicSpec,
};

/// Sends one topic.
pub(super) struct YarpPublisher {
    spec: TopicSpec,
    /// The same under the name of the input port that it may mean, by which boards are known.
    command_spec: Option<TopicSpec>,
    dialect: Dialect,
    depth: usize,
    outlet: Arc<Outlet>,
    counters: Arc<Counters>,
    shared: Arc<Shared>,
    _stop: Stop,
}

/// State that the publisher shares with its task.
#[derive(Debug)]
struct Outlet {
    /// The port's name before the environment changes it.
    given: String,
    name: String,
    port: Mutex<Option<OutputPort>>,
    /// The port writes to an input of another program.
    commands: AtomicBool,
    /// A port is being opened: its name may be known already, and is not another program's.
    opening: watch::Sender<bool>,
    device: Device,
    standing: Arc<Standing>,
    /// Number of the next message with a time.
    count: AtomicI32,
    /// Counts messages: a movement that is under way ends when another one comes.
    messages: AtomicU64,
}

impl Outlet {
    fn port(&self) -> MutexGuard<'_, Option<OutputPort>> {
        self.port.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Writes the forms of a message to their readers, files to those of carrier mjpeg and objects to
    /// all others; none where the port is closed.
    fn write(
        &self,
        forms: impl IntoIterator<Item = Outgoing>,
        sent: &Arc<Sent>,
    ) -> Option<Written> {
        let (mut written, mut number) = (Written::default(), None);
        let port = self.port();
        let port = port.as_ref()?;
        for Outgoing { payload, stamp } in forms {
            let is_file = payload.kind == PayloadKind::Raw;
            let fate: Arc<dyn Fate> = sent.clone();
            let mut message = Message { fate: Some(fate), ..Message::new(payload) };
            if let Some(stamp) = stamp {
                let count = *number.get_or_insert_with(|| self.count.fetch_add(1, Relaxed));
                message = message.stamped(wrapyfi_yarp::sig::Stamp { count, ..stamp });
            }
            let more =
                if is_file { port.write_picture(message) } else { port.write_object(message) };
            written.targets += more.targets;
            written.dropped += more.dropped;
            written.over_budget += more.over_budget;
        }
        Some(written)
    }

    /// Names of the ports that read.
    fn readers(&self) -> Vec<String> {
        let port = self.port();
        let status = port.as_ref().map(OutputPort::status).unwrap_or_default();
        status.into_iter().filter(|one| !one.incoming).map(|one| one.name).collect()
    }
}

impl YarpPublisher {
    pub(super) fn open(
        shared: &Arc<Shared>,
        spec: &TopicSpec,
        context: &Context,
    ) -> Result<Self, OpenError> {
        let options = YarpOptions::of_topic(spec)?;
        let name = options.port.clone().unwrap_or_else(|| spec.topic.clone());
        super::check_name(&name)?;
        let given = name;
        let name = shared.own_name(&given);
        let waiting = format!("port {name} to open");
        let standing = Arc::new(Standing::new(context.wake.clone(), waiting));
        let with_colon = input::with_colon(&spec.topic).filter(|port| input::is_input(port));
        let destination = options.out_topic_connect.as_deref();
        let destination = destination.or(with_colon.as_deref()).unwrap_or(&spec.topic);
        let command_spec = with_colon.clone().map(|topic| TopicSpec { topic, ..spec.clone() });
        let outlet = Arc::new(Outlet {
            given,
            name,
            port: Mutex::default(),
            commands: AtomicBool::new(false),
            opening: watch::Sender::new(false),
            device: Device::new(spec.message_type, &options, destination),
            standing,
            count: AtomicI32::new(0),
            messages: AtomicU64::new(0),
        });
        let (stop, stopped) = shared.tasks.stop();
        let dialect = shared.network(&options).dialect();
        let pictures = spec.message_type.data_type() == DataType::Image;
        let (kept, told) = ((Arc::clone(shared), Arc::clone(&outlet)), Arc::clone(&outlet));
        shared.tasks.spawn(
            &outlet.name,
            move |what| told.standing.waiting(what),
            move || keep(kept.clone(), options.clone(), pictures, stopped.clone()),
        );
        Ok(Self {
            spec: spec.clone(),
            command_spec,
            dialect,
            depth: shared.send_queue,
            outlet,
            counters: Arc::clone(&context.counters),
            shared: Arc::clone(shared),
            _stop: stop,
        })
    }

    fn nobody(&self) -> PublishError {
        PublishError::NoConsumer { topic: self.spec.topic.clone() }
    }

    /// Writes a message; what readers miss of it is counted.
    fn write(
        &self,
        forms: impl IntoIterator<Item = Outgoing>,
        sent: &Arc<Sent>,
    ) -> Result<(), PublishError> {
        let written = self.outlet.write(forms, sent).unwrap_or_default();
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
        let outlet = Arc::clone(&self.outlet);
        self.shared.tasks.spawn_aside(async move {
            for (due, movement) in later {
                let Some(time) = begin.checked_add(due) else { break };
                tokio::time::sleep_until(time).await;
                if outlet.messages.load(Relaxed) != own {
                    break;
                }
                match outlet.write([movement], &sent) {
                    Some(written) if written.targets > 0 => sent.queued(written),
                    _ => return sent.missed(DropReason::ConnectionLost),
                }
            }
        });
        Ok(bytes)
    }
}

/// The life of a publisher: ports one after the other, as input ports of its name come.
async fn keep(
    (shared, outlet): (Arc<Shared>, Arc<Outlet>),
    options: YarpOptions,
    pictures: bool,
    mut stopped: Stopped,
) {
    // A task that panicked has left its port open.
    close(&shared, &outlet, &options).await;
    // Whoever names the port, or what it is connected to, means that.
    let is_fixed = options.port.is_some() || options.out_topic_connect.is_some();
    let is_free = !is_fixed && input::is_input(&outlet.given);
    let mut destination = is_free.then(|| outlet.given.clone());
    if !is_fixed && !input::may_mean(&outlet.given).is_empty() {
        // A port of ours that is closed again at once would only confuse.
        let known = shared.directory.was_asked_in_time();
        tokio::select! { () = stopped.wait() => return, () = known => {} }
    }
    loop {
        let found = async {
            if is_fixed {
                return std::future::pending().await;
            }
            new_input(&shared, &outlet, destination.as_deref()).await
        };
        let serve = serve(&shared, &outlet, &options, pictures, destination.as_deref());
        let next = tokio::select! {
            () = stopped.wait() => None,
            found = found => Some(found),
            () = serve => None,
        };
        close(&shared, &outlet, &options).await;
        let Some(found) = next else { break };
        tracing::info!("{} writes to the port {found}, which exists", outlet.name);
        destination = Some(found);
    }
    outlet.standing.waiting("YARP, which has ended");
}

/// Waits for an input port that the publisher's name means, other than `now`, which is written to.
async fn new_input(shared: &Shared, outlet: &Outlet, now: Option<&str>) -> String {
    let ports = input::may_mean(&outlet.given);
    if ports.is_empty() {
        return std::future::pending().await;
    }
    let bell = shared.directory.watch_any(&ports);
    let mut opening = outlet.opening.subscribe();
    loop {
        // One that is being opened is opened first: its registration would stay behind.
        if !*opening.borrow_and_update() {
            let is_others = |port: &str| shared.directory.knows(port) && !shared.own.contains(port);
            match input::meant(&outlet.given, is_others) {
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
async fn serve(
    shared: &Shared,
    outlet: &Outlet,
    options: &YarpOptions,
    pictures: bool,
    destination: Option<&str>,
) {
    let wanted = OutputOptions {
        port: PortOptions { pictures, ..PortOptions::default() },
        queue: shared.send_queue,
        // The publisher is told what finds no room, as on ZeroMQ.
        overflow: Overflow::DropNewest,
    };
    // Two colons: no other bridge takes it for an endpoint.
    let numbered = destination.map(|port| format!("{port}:out:{}", number()));
    let given = numbered.as_deref().unwrap_or(&outlet.given);
    let port = until_open(shared, &outlet.name, &outlet.standing, || {
        let (network, wanted) = (shared.network(options), wanted.clone());
        async move {
            outlet.opening.send_replace(true);
            let opened = network.open_output(given, &wanted).await;
            if opened.is_err() {
                outlet.opening.send_replace(false);
            }
            opened
        }
    })
    .await;
    let name = port.name().to_owned();
    let changes = port.connected();
    shared.own.insert(&name);
    outlet.commands.store(destination.is_some(), Relaxed);
    *outlet.port() = Some(port);
    outlet.opening.send_replace(false);
    let tie = tie(&name, options, destination);
    let kept = async {
        let Some(tie) = &tie else { return std::future::pending().await };
        let tied = || outlet.readers().iter().any(|reader| reader == tie.other());
        tie.keep(shared, changes.clone(), tied, |why| {
            if destination.is_some() {
                outlet.standing.waiting(why);
            }
        })
        .await;
    };
    tokio::select! {
        () = count_readers(shared, &name, changes.clone(), outlet, destination.is_some()) => {}
        () = kept => {}
        () = outlet.device.follow(shared, changes.clone(), || changes.borrow().outputs > 0) => {}
    }
}

/// The connection that the port `own` of the publisher makes by itself.
fn tie(own: &str, options: &YarpOptions, destination: Option<&str>) -> Option<Tie> {
    match destination {
        // The name server would keep the wish of a port whose name is never used again.
        Some(to) => Some(Tie::to(to, own, &YarpOptions { persistent: false, ..options.clone() })),
        None => options.out_topic_connect.as_deref().map(|to| Tie::to(to, own, options)),
    }
}

/// Closes the port that is open, if any.
async fn close(shared: &Shared, outlet: &Outlet, options: &YarpOptions) {
    outlet.opening.send_replace(false);
    let port = outlet.port().take();
    let Some(port) = port else { return };
    let name = port.name().to_owned();
    if !outlet.commands.load(Relaxed)
        && let Some(tie) = tie(&name, options, None)
    {
        tie.forget(shared).await;
    }
    port.close().await;
    shared.own.remove(&name);
}

/// Tells how many read, for as long as the port lives.
async fn count_readers(
    shared: &Shared,
    own: &str,
    mut changes: watch::Receiver<Connected>,
    outlet: &Outlet,
    commands: bool,
) {
    loop {
        match changes.borrow_and_update().outputs {
            // Whoever keeps the connection knows why it is not there.
            0 if commands => {}
            0 => outlet.standing.waiting(format!("a reader of {}", outlet.name)),
            readers => outlet.standing.connected(readers),
        }
        outlet.readers().iter().for_each(|reader| shared.survey.met(reader, own, false));
        if changes.changed().await.is_err() {
            return;
        }
    }
}

impl Publisher for YarpPublisher {
    /// While nobody is connected nothing is encoded: [`PublishError::NoConsumer`]. Where some readers
    /// are too slow, what they miss is counted as `send_queue_full`; what a connection takes with it that
    /// ends, as `connection_lost`. Readers of carrier mjpeg get a
    /// picture as a file, all others as an object.
    fn publish(&mut self, payload: &Payload) -> Result<usize, PublishError> {
        let (objects, pictures) = self.outlet.port().as_ref().map_or((0, 0), |port| {
            let pictures = port.picture_readers();
            (port.connected().borrow().outputs.saturating_sub(pictures), pictures)
        });
        if objects + pictures == 0 {
            return Err(self.nobody());
        }
        let mut options = self.outlet.device.options();
        let dialect = options.dialect.unwrap_or(self.dialect);
        let commands = self.outlet.commands.load(Relaxed);
        let spec = self.command_spec.as_ref().filter(|_| commands).unwrap_or(&self.spec);
        // Objects for an input port of another program are bottles; messages of ROS have forms of
        // their own.
        let is_object = !matches!(spec.message_type, MessageType::Ros(_));
        if is_object && options.bottle.is_none() && commands {
            options = Arc::new(YarpOptions { bottle: Some(Form::Bottle), ..(*options).clone() });
        }
        let now = Stamp::now();
        let movements = payload::trajectory(payload, spec, &options, dialect, now)?;
        // A refused message leaves a movement under way.
        let next = || self.outlet.messages.fetch_add(1, Relaxed).wrapping_add(1);
        if let Some(movements) = movements {
            return self.run(movements, next());
        }
        let mut forms = Vec::new();
        for (readers, files) in [(objects, false), (pictures, true)] {
            if readers > 0 {
                let other = (options.sends_files() != files).then(|| options.sending_files(files));
                let options = other.as_ref().unwrap_or(&options);
                forms.push(payload::encode(payload, spec, options, dialect)?);
            }
        }
        let bytes = forms.iter().map(|form| form.payload.bytes.len()).max().unwrap_or(0);
        next();
        self.write(forms, &Sent::new(&self.counters, bytes))?;
        Ok(bytes)
    }

    fn link(&self) -> Link {
        let link = self.outlet.standing.link();
        let why = self.shared.taken(&self.outlet.name).or_else(|| {
            let is_connected = link.waiting_for.is_none();
            self.outlet.device.awaited().filter(|_| is_connected)
        });
        match why {
            Some(why) => Link { waiting_for: Some(why), ..link },
            None => link,
        }
    }
}
