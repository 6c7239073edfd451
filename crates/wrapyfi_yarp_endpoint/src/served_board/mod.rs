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

use crate::name::NAME;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicI32, Ordering::Relaxed};
use std::sync::{Arc, Weak};
use std::time::{Duration, Instant};

use tokio::sync::watch;
use wrapyfi_yarp::port::{Answer, Overflow, Port, PortOptions, PortPayload, Received, Written};
use wrapyfi_yarp::sig::Stamp;
use wrapyfi_yarp::{Bottle, Dialect, WireLimits};

use self::axes::{Axes, Joints, Movement};
use self::requests::Carries;
use super::link_state::LinkState;
use super::losses::Sent;
use super::opening::until_open;
use super::options::YarpOptions;
use super::payload;
use super::shared::InstanceState;
use super::tasks::Stop;
pub(super) use ends::{BoardListener, BoardPublisher};
use wrapyfi_endpoint::{Absent, Cause, Context, Mutex, PeerFault, Role, Sender};

/// Ends of the names of a board's ports: requests, commands, states, states in full.
pub const PORTS: [&str; 4] = ["/rpc:i", payload::COMMAND_PORT, "/state:o", payload::EXTENDED_PORT];

/// Ends of the names of those of the ports that take requests or commands.
pub const INPUTS: [&str; 2] = ["/rpc:i", payload::COMMAND_PORT];
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
    /// Ports that are open: states, states in full, requests, commands.
    ports: Mutex<Vec<Port>>,
    /// Receiver of movements, where that end is open, and the quantities that its messages carry.
    movements: Mutex<Option<(Arc<Sender<Moved>>, Carries)>>,
    link_state: Arc<LinkState>,
    count: AtomicI32,
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
        shared: &Arc<InstanceState>,
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
    fn begin(
        shared: &Arc<InstanceState>,
        name: &str,
        options: &YarpOptions,
        context: &Context,
    ) -> Self {
        let core = Arc::new(Core {
            name: name.to_owned(),
            options: options.clone(),
            dialect: shared.network(options).dialect(),
            axes: Mutex::new(Axes::new(options)),
            known: watch::Sender::new(false),
            ports: Mutex::default(),
            movements: Mutex::default(),
            link_state: Arc::new(LinkState::new(context.wake.clone(), awaited(name).into())),
            count: AtomicI32::new(0),
        });
        let kept = (Arc::clone(shared), Arc::clone(&core));
        let stop = shared.tasks.spawn(name, &core.link_state, kept, serve, close);
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
                    let fault = PeerFault::Transport(why.clone());
                    self.link_state.waiting(Cause::peer(self.awaited().named, "", Some(fault), ""));
                }
                return Err(why);
            }
            self.known.send_replace(axes.is_known());
            [state::plain(&axes, self.dialect), state::extended(&axes, self.dialect)]
        };
        let stamp = Stamp { count: self.count.fetch_add(1, Relaxed), time_s };
        let ports = self.ports.lock();
        let mut written = (!ports.is_empty()).then(Written::default);
        for (port, bytes) in ports.iter().zip(messages) {
            let payload = PortPayload::object(bytes.map_err(|error| error.to_string())?);
            sent.write(port, payload, Some(stamp), written.get_or_insert_default());
        }
        Ok(written)
    }

    fn awaited(&self) -> Absent {
        awaited(&self.name)
    }

    /// Tells what the open board waits for: a state, where the last is old, else a client.
    fn tell(&self) {
        let age_s = self.axes.lock().silent_for().map_or(0, |age| age.as_secs());
        let old = AGES_S.iter().rev().find(|most| age_s >= **most);
        match (old, self.clients()) {
            (Some(age_s), _) => {
                self.link_state.waiting(Cause::Stale { absent: self.awaited(), age_s: *age_s });
            }
            (None, 0) => {
                let client = Absent::new(Role::Client, "a client of the board", NAME, &self.name);
                self.link_state.waiting(client);
            }
            (None, clients) => self.link_state.connected(clients),
        }
    }

    /// Number of connections of the four ports.
    fn clients(&self) -> usize {
        let ports = self.ports.lock();
        let connected = ports.iter().map(|port| *port.connected().borrow()).enumerate();
        connected.map(|(place, now)| if place < 2 { now.outputs } else { now.inputs }).sum()
    }

    /// Reads the bottle of a client, and tells in which dialect it writes floats.
    fn bottle(&self, received: &Received) -> Option<(Bottle, Dialect)> {
        Bottle::decode_either(&received.payload.bytes, self.dialect, &WireLimits::default()).ok()
    }

    /// Quantities that the messages of ROS carry; none where no program takes movements.
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

/// The life of a board: its ports open once its axes are known.
async fn serve((shared, core): (Arc<InstanceState>, Arc<Core>)) {
    // The sender lives as long as the core.
    core.known.subscribe().wait_for(|known| *known).await.ok();
    let (network, link_state) = (shared.network(&core.options), &core.link_state);
    let latest = PortOptions {
        queue: shared.send_queue,
        overflow: Overflow::DropOldest,
        readers: YarpOptions::admission(core.options.to_peers.as_ref()),
        ..PortOptions::default()
    };
    let rpc = PortOptions { rpc: true, ..PortOptions::default() };
    let mut changes = Vec::new();
    // The state is there before the requests: a client connects all of them at once.
    for end in [PORTS[2], PORTS[3], PORTS[0], PORTS[1]] {
        let name = format!("{}{end}", core.name);
        let port = until_open(&shared, &name, link_state, || async {
            let is_command = end == payload::COMMAND_PORT;
            if end != PORTS[0] && !is_command {
                return network.open_output(&name, &latest).await;
            }
            let core = Arc::clone(&core);
            let take = move |received, wants_reply| {
                let core = Arc::clone(&core);
                async move {
                    if is_command {
                        core.command(received).await;
                        return Answer::Nothing;
                    }
                    core.ask(received, wants_reply).await
                }
            };
            let options = if is_command { &PortOptions::default() } else { &rpc };
            network.serve(&name, options, take).await
        })
        .await;
        shared.own.insert(port.name());
        changes.push(port.connected());
        core.ports.lock().push(port);
    }
    let Ok([mut state, mut extended, mut rpc, mut command]) = <[_; 4]>::try_from(changes) else {
        return;
    };
    loop {
        core.tell();
        tokio::select! {
            _ = state.changed() => {}
            _ = extended.changed() => {}
            _ = rpc.changed() => {}
            _ = command.changed() => {}
            () = tokio::time::sleep(LOOK) => {}
        }
    }
}

fn awaited(board: &str) -> Absent {
    Absent::new(Role::Publisher, "a state of the joints of", NAME, board)
}

/// Closes the ports that are open, if any.
async fn close((shared, core): (Arc<InstanceState>, Arc<Core>)) {
    let ports = std::mem::take(&mut *core.ports.lock());
    for port in ports {
        shared.own.close(port).await;
    }
}
