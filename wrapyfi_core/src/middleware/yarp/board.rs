//! What a control board tells of its joints: asked once, whenever it is connected.
//!
//! ```text
//!   /icub/head/state:o, stateExt:o, command:i ─▶ /icub/head/rpc:i
//!      [get] [axes]      ─▶  [is] [axes] 6 …
//!      [get] [name] 0    ─▶  [is] [name] neck_pitch …
//!      [get] [type] 0    ─▶  [is] [type] 1987212385 …     the vocab [atrv] turns, [atpr] slides
//!      [get] [llim] 0    ─▶  [is] [llim] -30.0 22.0 …     of those that are moved
//!   of YARP 4: /icub/head/nws/rpc:i
//!      getAxesRPC        ─▶  ([ok]) 6
//!      getAxisNameRPC 0  ─▶  ([ok]) neck_pitch
//! ```
//!
//! Which of the two ports a board has also tells how it reads floats.
//!
//! Option `joints` goes before the names that are told. The ports of a board are there before it can
//! answer, so it is asked again for a while. One that never does leaves joints without names.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::sync::{Notify, watch};
use tokio::time::{Instant, timeout};
use wrapyfi_yarp::bottle::Vocab;
use wrapyfi_yarp::port::{Connected, PortOptions, RpcClient};
use wrapyfi_yarp::{Bottle, Dialect, Value};

use super::Shared;
use super::joint_limits::{JointLimits, Range};
use super::opening::numbered;
use super::options::{Axis, YarpOptions};
use super::payload;
use super::retry::Retry;
use crate::types::MessageType;

/// How ports of a control board end that have a port for requests beside them.
const PORTS: [&str; 3] = ["/state:o", "/stateExt:o", payload::COMMAND_PORT];
/// How the port for requests ends, by what the board speaks.
const REQUESTS: [(&str, Dialect); 2] = [("/rpc:i", Dialect::V3), ("/nws/rpc:i", Dialect::V4)];
/// Most joints of a board.
const MOST: i64 = 256;
/// How long a board may take for all its answers.
const ANSWERS: Duration = Duration::from_secs(2);
/// Time to the second try.
const FIRST: Duration = Duration::from_millis(100);
/// Tries before a board is asked only when somebody needs it.
const TRIES: u32 = 8;
/// How long the first messages wait for the names of their joints.
const PATIENCE: Duration = Duration::from_secs(1);
/// The same for movements, which cannot be written without: a board that has just started takes longer.
const MOVE_PATIENCE: Duration = Duration::from_secs(5);

/// The options of a topic, with what the control board behind it tells.
#[derive(Debug)]
pub(super) struct Board {
    given: Arc<YarpOptions>,
    /// Of requests to the board, as in [`REQUESTS`]; none where the topic is no board's.
    rpc: Option<[String; 2]>,
    /// Movements go to it: its limits count.
    is_moved: bool,
    told: Mutex<Arc<YarpOptions>>,
    /// Messages need not wait: it has told, or took too long, or there is nobody to ask.
    settled: watch::Sender<bool>,
    /// Rung by messages that would wait.
    wanted: Notify,
}

impl Board {
    /// The board that messages of this type come from, or go to, at `port`.
    pub(super) fn new(message_type: MessageType, options: &YarpOptions, port: &str) -> Self {
        let is_of_joints = payload::is_of_joints(message_type) && options.bottle.is_none();
        let prefix = PORTS.iter().find_map(|end| port.strip_suffix(end));
        let rpc = prefix
            .filter(|_| is_of_joints)
            .map(|prefix| REQUESTS.map(|(end, _)| format!("{prefix}{end}")));
        let given = Arc::new(options.clone());
        let settled = watch::Sender::new(rpc.is_none());
        let told = Mutex::new(Arc::clone(&given));
        let is_moved = port.ends_with(payload::COMMAND_PORT);
        Self { told, given, rpc, is_moved, settled, wanted: Notify::new() }
    }

    /// The options as they are now.
    pub(super) fn options(&self) -> Arc<YarpOptions> {
        let options = Arc::clone(&self.told.lock().unwrap_or_else(PoisonError::into_inner));
        if self.rpc.is_some() && options.axes.is_empty() {
            self.wanted.notify_one();
        }
        options
    }

    fn tell(&self, options: Arc<YarpOptions>) {
        *self.told.lock().unwrap_or_else(PoisonError::into_inner) = options;
    }

    /// Waits, for a short while, until the board has told.
    pub(super) async fn wait(&self) {
        if *self.settled.borrow() {
            return;
        }
        self.wanted.notify_one();
        let mut settled = self.settled.subscribe();
        if timeout(PATIENCE, settled.wait_for(|settled| *settled)).await.is_err() {
            // Once is enough.
            self.settled.send_replace(true);
        }
    }

    /// What movements wait for, if they do: the board is connected and has not told.
    pub(super) fn awaited(&self) -> Option<String> {
        let [rpc, _] = self.rpc.as_ref().filter(|_| !*self.settled.borrow())?;
        Some(format!("{rpc} to tell the joints of its board"))
    }

    /// Asks the board whenever it gets connected, for as long as it is run, and again while it cannot
    /// tell: its ports are there before it is. `changes` tells when to look at `connected`.
    pub(super) async fn follow(
        &self,
        shared: &Shared,
        mut changes: watch::Receiver<Connected>,
        connected: impl Fn() -> bool,
    ) {
        let Some(rpc) = &self.rpc else { return std::future::pending().await };
        let bell = shared.directory.watch_any(rpc);
        let known = || {
            let named = rpc.iter().zip(REQUESTS).find(|(name, _)| shared.directory.knows(name));
            named.map(|(name, (_, dialect))| (name, dialect))
        };
        let (mut retry, mut tries, mut has_told) = (Retry::new(FIRST), 0, false);
        let mut connected_at = None;
        loop {
            // Seen before the look, so that no change is missed.
            changes.mark_unchanged();
            if !connected() {
                retry.reset();
                (tries, has_told, connected_at) = (0, false, None);
                self.settled.send_replace(false);
                self.tell(Arc::clone(&self.given));
            } else if let Some((name, dialect)) = known().filter(|_| !has_told) {
                match ask(shared, name, dialect, self.is_moved).await {
                    Ok(joints) => {
                        has_told = true;
                        self.tell(Arc::new(joints.applied(&self.given, dialect)));
                        self.settled.send_replace(true);
                    }
                    Err(why) => {
                        tries += 1;
                        if tries == TRIES {
                            tracing::warn!(
                                "{name} did not tell the names of its joints: {why}; option joints \
                                 may name them"
                            );
                        }
                    }
                }
            }
            let again = async {
                if tries == 0 || has_told {
                    return std::future::pending().await;
                }
                if tries >= TRIES {
                    // Not before somebody needs it.
                    self.wanted.notified().await;
                }
                retry.wait().await;
            };
            if connected() {
                connected_at.get_or_insert_with(Instant::now);
            }
            let patience = if known().is_some() { MOVE_PATIENCE } else { PATIENCE };
            let over = connected_at.filter(|_| !*self.settled.borrow());
            let over = async {
                match over {
                    Some(at) => tokio::time::sleep_until(at + patience).await,
                    None => std::future::pending().await,
                }
            };
            tokio::select! {
                () = bell.notified() => {}
                () = again => {}
                () = over => {
                    self.settled.send_replace(true);
                }
                changed = changes.changed() => {
                    if changed.is_err() {
                        return std::future::pending().await;
                    }
                }
            }
        }
    }
}

/// The joints of a board, in its order.
#[derive(Debug, Default, Clone, PartialEq)]
struct Joints {
    /// None where the board has no name for one, or one name for two.
    names: Vec<String>,
    axes: Vec<Axis>,
    limits: Vec<Option<Range>>,
}

impl Joints {
    fn applied(self, given: &YarpOptions, dialect: Dialect) -> YarpOptions {
        let joints = if given.joints.is_empty() { self.names } else { given.joints.clone() };
        // Boards of YARP 4 alone are told by their port: those of YARP 3 have what is set.
        let dialect = given.dialect.or(Some(dialect).filter(|dialect| *dialect == Dialect::V4));
        let limits = Arc::new(JointLimits::new(self.limits));
        YarpOptions { joints, axes: self.axes, limits, dialect, ..given.clone() }
    }

    fn add(&mut self, name: Option<String>, axis: Axis) {
        let place = self.axes.len();
        self.axes.push(axis);
        // A name that is missing leaves the list too short for ever.
        if let Some(name) = name
            && self.names.len() == place
            && !name.is_empty()
            && !self.names.contains(&name)
        {
            self.names.push(name);
        }
    }

    fn finished(mut self) -> Self {
        if self.names.len() != self.axes.len() {
            self.names.clear();
        }
        self
    }
}

async fn ask(
    shared: &Shared,
    rpc: &str,
    dialect: Dialect,
    is_moved: bool,
) -> Result<Joints, String> {
    let unregistered = PortOptions { register: false, ..shared.asking() };
    let client = shared.network.open_rpc_client(&numbered(rpc), &unregistered).await;
    let client = client.map_err(|error| error.to_string())?;
    let told = async {
        client.connect(&format!("tcp:/{rpc}")).await.map_err(|error| error.to_string())?;
        joints(&client, dialect, is_moved).await
    };
    let told = timeout(ANSWERS, told).await;
    client.close().await;
    told.unwrap_or_else(|_| Err(format!("its answers took more than {ANSWERS:?}")))
}

async fn joints(client: &RpcClient, dialect: Dialect, is_moved: bool) -> Result<Joints, String> {
    let get = async |word, joint| get(client, dialect, word, joint).await;
    let axes = get(Word::Axes, None).await?;
    let count = axes.first().and_then(Value::as_i64).filter(|count| (1..=MOST).contains(count));
    let count =
        count.ok_or_else(|| format!("it said {:?} joints, up to {MOST} are read", axes.first()))?;
    let mut joints = Joints::default();
    for joint in 0..count {
        let name = get(Word::Name, Some(joint)).await?;
        let name = name.first().and_then(Value::as_str).map(str::to_owned);
        let kind = get(Word::Type, Some(joint)).await?;
        joints.add(name, kind.first().map_or(Axis::Revolute, axis));
        if is_moved {
            let limits = get(Word::Limits, Some(joint)).await?;
            let limit = |place: usize| limits.get(place).and_then(Value::as_f64);
            joints.limits.push(limit(0).zip(limit(1)));
        }
    }
    Ok(joints.finished())
}

/// The kind of a joint, a number that is a vocab.
fn axis(kind: &Value) -> Axis {
    let code = match kind {
        Value::Vocab32(code) => Some(*code),
        number => number.as_i64().and_then(|code| i32::try_from(code).ok()).map(Vocab),
    };
    if code == Some(Vocab::new("atpr")) { Axis::Prismatic } else { Axis::Revolute }
}

/// What a board is asked for.
#[derive(Debug, Clone, Copy)]
enum Word {
    Axes,
    Name,
    Type,
    Limits,
}

impl Word {
    /// The words of the question to a board of YARP 3, or the function of one of YARP 4.
    fn asked(self, dialect: Dialect) -> Vec<Value> {
        let (word, function) = match self {
            Self::Axes => ("axes", "getAxesRPC"),
            Self::Name => ("name", "getAxisNameRPC"),
            Self::Type => ("type", "getJointTypeRPC"),
            Self::Limits => ("llim", "getPosLimitsRPC"),
        };
        match dialect {
            Dialect::V3 => vec![Value::vocab("get"), Value::vocab(word)],
            Dialect::V4 => vec![function.into()],
        }
    }
}

/// The values that the board says of `word`, and of a joint; none where it says that it cannot.
async fn get(
    client: &RpcClient,
    dialect: Dialect,
    word: Word,
    joint: Option<i64>,
) -> Result<Vec<Value>, String> {
    let joint = joint.and_then(|joint| i32::try_from(joint).ok()).map(Value::Int32);
    let request = Bottle { values: word.asked(dialect).into_iter().chain(joint).collect() };
    let reply = client.call(&request, ANSWERS).await.map_err(|error| error.to_string())?;
    let reply = reply.unwrap_or_default();
    let head = match (dialect, reply.get(0)) {
        (Dialect::V3, Some(first)) if first.is_word("is") => 2,
        (Dialect::V4, Some(Value::List(done)))
            if done.get(0).is_some_and(|it| it.is_word("ok")) =>
        {
            1
        }
        _ => return Ok(Vec::new()),
    };
    Ok(reply.values.into_iter().skip(head).collect())
}

#[cfg(test)]
mod tests {
    use wrapyfi_interfaces::store::TypeStore;

    use super::*;

    fn joint_state() -> MessageType {
        MessageType::resolve("sensor_msgs/msg/JointState", &mut TypeStore::generated()).unwrap()
    }

    #[test]
    fn names_are_all_or_none_and_kinds_are_kept() {
        let joints = |told: &[(&str, &str)]| {
            let mut joints = Joints::default();
            for (name, kind) in told {
                let code = i64::from(Vocab::new(kind).0);
                joints.add(Some((*name).to_owned()), axis(&code.into()));
            }
            joints.finished()
        };
        let named = joints(&[("neck", "atrv"), ("heave", "atpr")]);
        assert_eq!(named.names, ["neck", "heave"]);
        assert_eq!(named.axes, [Axis::Revolute, Axis::Prismatic]);
        for odd in [&[("neck", "atrv"), ("neck", "atrv")], &[("", "atrv"), ("neck", "unkn")]] {
            let told = joints(odd);
            assert_eq!((told.names.len(), told.axes.len()), (0, 2));
        }
        let given = YarpOptions { joints: vec!["a".into(), "b".into()], ..YarpOptions::default() };
        let applied = named.clone().applied(&given, Dialect::V3);
        assert_eq!((applied.joints, applied.dialect), (given.joints.clone(), None));
        let applied = named.applied(&given, Dialect::V4);
        assert!(applied.has_degrees(0) && !applied.has_degrees(1));
        assert_eq!(applied.dialect, Some(Dialect::V4));
    }

    #[test]
    fn only_joints_of_a_board_have_one() {
        let joints = joint_state();
        let rpc = |port: &str, options: &YarpOptions| Board::new(joints, options, port).rpc;
        let usual = YarpOptions::default();
        for port in ["/icub/head/state:o", "/icub/head/stateExt:o", "/icub/head/command:i"] {
            assert_eq!(rpc(port, &usual).unwrap(), ["/icub/head/rpc:i", "/icub/head/nws/rpc:i"]);
        }
        assert_eq!(rpc("/icub/head/encoders:o", &usual), None);
        let other = YarpOptions { bottle: Some(Default::default()), ..usual.clone() };
        assert_eq!(rpc("/icub/head/state:o", &other), None);
        assert_eq!(Board::new(MessageType::Image, &usual, "/icub/head/state:o").rpc, None);
    }
}
