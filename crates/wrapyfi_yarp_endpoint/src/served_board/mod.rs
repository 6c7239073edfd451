//! A robot of ROS 2 as a control board of YARP, which `remote_controlboard`, `yarpmotorgui` and the modules of a robot
//! read and move.
//!
//! ```text
//!   JointState ─▶ Publisher ─▶ Axes ─▶ /arm/state:o, /arm/stateExt:o ══▶ clients
//!                               ▲ │
//!                               │ └──▶ answers ◀══ /arm/rpc:i, /arm/command:i ◀══ clients
//!                               └──────────── movements ─▶ Listener ─▶ JointTrajectory or JointState
//! ```
//!
//! Both ends have the name of the board and option `board`; they share the board, which closes its four ports with the
//! last of them. The ports open once a state has told where the joints are: a client asks for their number first.
//!
//! | module | one idea |
//! | --- | --- |
//! | `axes` | what the axes do and shall do |
//! | `requests` | the protocol of `rpc:i` and `command:i` |
//! | `state` | messages of the ports and of ROS |
//! | `ends` | the two endpoints |

mod axes;
mod ends;
mod requests;
mod state;

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicI32, Ordering::Relaxed};
use std::sync::{Arc, Weak};
use std::time::{Duration, Instant};

use tokio::sync::watch;
use wrapyfi_yarp::port::{
    Answer, Fate, Message, OutputPort, Overflow, PortOptions, PortPayload, Received, RpcServer,
    Written,
};
use wrapyfi_yarp::sig::Stamp;
use wrapyfi_yarp::{Bottle, Dialect, Limits};

use self::axes::{Axes, Joints, Movement};
use self::requests::Carries;
use super::link_state::LinkState;
use super::losses::Sent;
use super::opening::until_open;
use super::options::YarpOptions;
use super::payload;
use super::shared::Shared;
use super::tasks::{Stop, Stopped};
pub(super) use ends::{BoardListener, BoardPublisher};
use wrapyfi_endpoint::{Context, Mutex, Sender};

/// Ends of the names of a board's ports: requests, commands, states, states in full.
pub const PORTS: [&str; 4] = ["/rpc:i", payload::COMMAND_PORT, "/state:o", payload::EXTENDED_PORT];

/// Begin of the reason for which a board waits whose ports are open, and to which nobody is connected.
pub const NO_CLIENT: &str = "a client of the board ";
/// Ages of the last state that are told, in seconds: a reason that changes is logged.
const AGES_S: [u64; 5] = [2, 10, 60, 600, 3600];
/// Time between two looks at the age of the last state.
const LOOK: Duration = Duration::from_secs(1);

/// Boards that are served, by name.
#[derive(Debug, Default)]
pub(super) struct ServedBoards(Mutex<BTreeMap<String, Weak<ServedBoard>>>);

/// A board, for as long as one of its ends is open.
#[derive(Debug)]
pub(super) struct ServedBoard {
    core: Arc<Core>,
    _stop: Stop,
}

/// State that a board shares with its ports.
#[derive(Debug)]
struct Core {
    name: String,
    options: YarpOptions,
    dialect: Dialect,
    axes: Mutex<Axes>,
    /// True once the axes are known.
    known: watch::Sender<bool>,
    ports: Mutex<Option<Ports>>,
    /// Receiver of movements, where that end is open, and the quantities that its messages carry.
    movements: Mutex<Option<(Arc<Sender<Moved>>, Carries)>>,
    link_state: LinkState,
    count: AtomicI32,
}

/// Ports that are open.
#[derive(Debug)]
struct Ports {
    inputs: [RpcServer; 2],
    outputs: [OutputPort; 2],
}

/// A movement that a client asked for.
#[derive(Debug)]
struct Moved {
    movement: Movement,
    names: Arc<[String]>,
    received_at: Instant,
    bytes: usize,
}

impl wrapyfi_endpoint::Waits for Moved {
    fn bytes(&self) -> usize {
        self.bytes
    }
}

impl ServedBoards {
    /// The board of this name, begun where it is not there.
    fn board(
        &self,
        shared: &Arc<Shared>,
        name: &str,
        options: &YarpOptions,
        context: &Context,
    ) -> Arc<ServedBoard> {
        let mut boards = self.0.lock();
        boards.retain(|_, board| board.strong_count() > 0);
        if let Some(board) = boards.get(name).and_then(Weak::upgrade) {
            return board;
        }
        let board = Arc::new(ServedBoard::begin(shared, name, options, context));
        boards.insert(name.to_owned(), Arc::downgrade(&board));
        board
    }
}

impl ServedBoard {
    fn begin(shared: &Arc<Shared>, name: &str, options: &YarpOptions, context: &Context) -> Self {
        let core = Arc::new(Core {
            name: name.to_owned(),
            options: options.clone(),
            dialect: shared.network(options).dialect(),
            axes: Mutex::new(Axes::new(options)),
            known: watch::Sender::new(false),
            ports: Mutex::default(),
            movements: Mutex::default(),
            link_state: LinkState::new(context.wake.clone(), awaited(name)),
            count: AtomicI32::new(0),
        });
        let (stop, stopped) = shared.tasks.stop();
        let (kept, told) = ((Arc::clone(shared), Arc::clone(&core)), Arc::clone(&core));
        shared.tasks.spawn(
            name,
            move |what| told.link_state.waiting(what),
            move || keep(kept.clone(), stopped.clone()),
        );
        Self { core, _stop: stop }
    }
}

impl Core {
    /// Takes a state of the robot and sends it to the readers of both ports; `None` where the ports are closed.
    ///
    /// # Errors
    /// As [`Axes::take`]; what the dialect cannot write, in words.
    fn publish(
        &self,
        joints: &Joints<'_>,
        time_s: f64,
        sent: &Arc<Sent>,
    ) -> Result<Option<Written>, String> {
        let messages = {
            let mut axes = self.axes.lock();
            if let Err(why) = axes.take(joints, &self.options) {
                if !axes.is_known() {
                    self.link_state.waiting(format!("{}: {why}", self.awaited()));
                }
                return Err(why);
            }
            self.known.send_replace(axes.is_known());
            [state::plain(&axes, self.dialect), state::extended(&axes, self.dialect)]
        };
        let stamp = Stamp { count: self.count.fetch_add(1, Relaxed), time_s };
        let ports = self.ports.lock();
        let Some(Ports { outputs, .. }) = &*ports else { return Ok(None) };
        let mut written = Written::default();
        for (port, bytes) in outputs.iter().zip(messages) {
            let payload = PortPayload::object(bytes.map_err(|error| error.to_string())?);
            let fate: Arc<dyn Fate> = sent.clone();
            let message = Message { fate: Some(fate), ..Message::new(payload) }.stamped(stamp);
            let more = port.write_object(message);
            written.targets += more.targets;
            written.dropped += more.dropped;
            written.over_budget += more.over_budget;
        }
        Ok(Some(written))
    }

    fn awaited(&self) -> String {
        awaited(&self.name)
    }

    /// Tells what the open board waits for: a state, where the last is old, else a client.
    fn tell(&self) {
        let age_s = self.axes.lock().silent_for().map_or(0, |age| age.as_secs());
        let old = AGES_S.iter().rev().find(|most| age_s >= **most);
        match (old, self.clients()) {
            (Some(most), _) => self.link_state.waiting(format!(
                "{}: the last came more than {most} s ago, and movements are refused until one comes",
                self.awaited()
            )),
            (None, 0) => self.link_state.waiting(format!("{NO_CLIENT}{}", self.name)),
            (None, clients) => self.link_state.connected(clients),
        }
    }

    /// Number of connections of the four ports.
    fn clients(&self) -> usize {
        let ports = self.ports.lock();
        let Some(Ports { inputs, outputs }) = &*ports else { return 0 };
        let inputs = inputs.iter().map(|port| port.connected().borrow().inputs);
        inputs.chain(outputs.iter().map(|port| port.connected().borrow().outputs)).sum()
    }

    /// Reads the bottle of a client, and tells in which dialect it writes floats.
    fn bottle(&self, received: &Received) -> Option<(Bottle, Dialect)> {
        Bottle::decode_either(&received.payload.bytes, self.dialect, &Limits::default()).ok()
    }

    /// Quantities that the messages of ROS carry; none where nobody takes movements.
    fn carries(&self) -> Carries {
        self.movements.lock().as_ref().map_or(Carries::Positions, |(_, carries)| *carries)
    }

    /// Answers a request.
    async fn ask(&self, received: Received, wants_reply: bool) -> Answer {
        let Some((request, dialect)) = self.bottle(&received) else { return Answer::Nothing };
        let (answer, movement) = {
            let now = wrapyfi_data::types::Stamp::now().as_secs_f64();
            let now = Stamp { count: self.count.load(Relaxed), time_s: now };
            requests::answer(&mut self.axes.lock(), &request, self.carries(), now)
        };
        self.hand_over(movement, &received).await;
        match answer.encode(dialect) {
            Ok(bytes) if wants_reply => Answer::Object(bytes.into()),
            _ => Answer::Nothing,
        }
    }

    /// Takes a command, which is not answered.
    async fn command(&self, received: Received) {
        let Some((message, _)) = self.bottle(&received) else { return };
        let read = requests::command(&mut self.axes.lock(), &message, self.carries());
        match read {
            Ok(movement) => self.hand_over(Some(movement), &received).await,
            Err(why) => tracing::warn!("{} of {}: {why}", received.from, self.name),
        }
    }

    /// Queues a movement for ROS.
    async fn hand_over(&self, movement: Option<Movement>, received: &Received) {
        let Some(movement) = movement else { return };
        let names = self.axes.lock().all().iter().map(|axis| axis.name.clone()).collect();
        let Some(sender) = self.movements.lock().as_ref().map(|(sender, _)| Arc::clone(sender))
        else {
            return;
        };
        let bytes = received.payload.bytes.len();
        sender.counters().received(bytes);
        let received_at = sender.context().clock.now();
        let moved = Moved { movement, names, received_at, bytes };
        sender.place(moved, sender.max_wait()).await;
    }
}

/// The life of a board: its ports open once its axes are known, and close with it.
async fn keep((shared, core): (Arc<Shared>, Arc<Core>), mut stopped: Stopped) {
    // A task that panicked has left its ports open.
    close(&shared, &core).await;
    let mut known = core.known.subscribe();
    tokio::select! {
        () = stopped.wait() => return,
        _ = known.wait_for(|known| *known) => {}
    }
    let opened = open(&shared, &core);
    tokio::select! {
        () = stopped.wait() => {}
        ports = opened => {
            let (inputs, outputs) = (&ports.inputs, &ports.outputs);
            inputs.iter().for_each(|port| shared.own.insert(port.name()));
            outputs.iter().for_each(|port| shared.own.insert(port.name()));
            let changes = [inputs[0].connected(), inputs[1].connected(), outputs[0].connected(), outputs[1].connected()];
            *core.ports.lock() = Some(ports);
            tokio::select! {
                () = stopped.wait() => {}
                () = count(&core, changes) => {}
            }
        }
    }
    close(&shared, &core).await;
    core.link_state.waiting("YARP, which has ended");
}

/// Opens the four ports, however long a name is taken.
async fn open(shared: &Shared, core: &Arc<Core>) -> Ports {
    let network = shared.network(&core.options);
    let name = |end: &str| format!("{}{end}", core.name);
    let rpc = PortOptions { rpc: true, ..PortOptions::default() };
    let latest = PortOptions {
        queue: shared.send_queue,
        overflow: Overflow::DropOldest,
        readers: YarpOptions::admission(core.options.to_peers.as_ref()),
        ..PortOptions::default()
    };
    let asked = || {
        let (network, core, rpc, name) =
            (network.clone(), Arc::clone(core), rpc.clone(), name(PORTS[0]));
        async move {
            let answer = move |received, wants_reply| {
                let core = Arc::clone(&core);
                async move { core.ask(received, wants_reply).await }
            };
            network.serve(&name, &rpc, answer).await
        }
    };
    let commanded = || {
        let (network, core, name) = (network.clone(), Arc::clone(core), name(PORTS[1]));
        async move {
            let take = move |received, _| {
                let core = Arc::clone(&core);
                async move {
                    core.command(received).await;
                    Answer::Nothing
                }
            };
            network.serve(&name, &PortOptions::default(), take).await
        }
    };
    let told = |end: &'static str| {
        let (network, latest, name) = (network.clone(), latest.clone(), name(end));
        move || {
            let (network, latest, name) = (network.clone(), latest.clone(), name.clone());
            async move { network.open_output(&name, &latest).await }
        }
    };
    let link_state = &core.link_state;
    // The state is there before the requests: a client connects all of them at once.
    let outputs = [
        until_open(shared, &name(PORTS[2]), link_state, told(PORTS[2])).await,
        until_open(shared, &name(PORTS[3]), link_state, told(PORTS[3])).await,
    ];
    let inputs = [
        until_open(shared, &name(PORTS[0]), link_state, asked).await,
        until_open(shared, &name(PORTS[1]), link_state, commanded).await,
    ];
    Ports { inputs, outputs }
}

fn awaited(board: &str) -> String {
    format!("a state of the joints of {board}")
}

/// Tells what the board waits for, for as long as the ports live.
async fn count(core: &Core, mut changes: [watch::Receiver<wrapyfi_yarp::port::Connected>; 4]) {
    loop {
        changes.iter_mut().for_each(watch::Receiver::mark_unchanged);
        core.tell();
        let [rpc, command, state, extended] = &mut changes;
        let changed = tokio::select! {
            changed = rpc.changed() => changed,
            changed = command.changed() => changed,
            changed = state.changed() => changed,
            changed = extended.changed() => changed,
            () = tokio::time::sleep(LOOK) => Ok(()),
        };
        if changed.is_err() {
            return;
        }
    }
}

/// Closes the ports that are open, if any.
async fn close(shared: &Shared, core: &Core) {
    let ports = core.ports.lock().take();
    let Some(Ports { inputs, outputs }) = ports else { return };
    for port in inputs {
        let name = port.name().to_owned();
        port.close().await;
        shared.own.remove(&name);
    }
    for port in outputs {
        let name = port.name().to_owned();
        port.close().await;
        shared.own.remove(&name);
    }
}
