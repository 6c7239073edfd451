//! What a control board tells of its joints: asked once, whenever it is connected.
//!
//! ```text
//!   /icub/head/state:o, stateExt:o, command:i ─▶ /icub/head/rpc:i
//!      [get] [axes]      ─▶  [is] [axes] 6 …
//!      [get] [name] 0    ─▶  [is] [name] neck_pitch …
//!      [get] [type] 0    ─▶  [is] [type] 1987212385 …     the vocab [atrv] turns, [atpr] slides
//! ```
//!
//! Option `joints` goes before the names that are told. The ports of a board are there before it can
//! answer, so it is asked again for a while. One that never does leaves joints without names.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::sync::{Notify, watch};
use tokio::time::timeout;
use wrapyfi_yarp::bottle::Vocab;
use wrapyfi_yarp::port::{Connected, PortOptions, RpcClient};
use wrapyfi_yarp::{Bottle, Value};

use super::Shared;
use super::opening::numbered;
use super::options::{Axis, YarpOptions};
use super::payload;
use super::retry::Retry;
use crate::types::MessageType;

/// How ports of a control board end that have a port for requests beside them.
const PORTS: [&str; 3] = ["/state:o", "/stateExt:o", payload::COMMAND_PORT];
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

/// The options of a topic, with what the control board behind it tells.
#[derive(Debug)]
pub(super) struct Board {
    given: Arc<YarpOptions>,
    /// Of requests to the board; none where the topic is no board's.
    rpc: Option<String>,
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
        let rpc = prefix.filter(|_| is_of_joints).map(|prefix| format!("{prefix}/rpc:i"));
        let given = Arc::new(options.clone());
        let settled = watch::Sender::new(rpc.is_none());
        let told = Mutex::new(Arc::clone(&given));
        Self { told, given, rpc, settled, wanted: Notify::new() }
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

    /// Asks the board whenever it gets connected, for as long as it is run, and again while it cannot
    /// tell: its ports are there before it is. `changes` tells when to look at `connected`.
    pub(super) async fn follow(
        &self,
        shared: &Shared,
        mut changes: watch::Receiver<Connected>,
        connected: impl Fn() -> bool,
    ) {
        let Some(rpc) = &self.rpc else { return std::future::pending().await };
        let bell = shared.directory.watch(rpc);
        let (mut retry, mut tries, mut has_told) = (Retry::new(FIRST), 0, false);
        loop {
            // Seen before the look, so that no change is missed.
            changes.mark_unchanged();
            if !connected() {
                retry.reset();
                (tries, has_told) = (0, false);
                self.settled.send_replace(false);
                self.tell(Arc::clone(&self.given));
            } else if !has_told && shared.directory.knows(rpc) {
                match ask(shared, &self.given, rpc).await {
                    Ok(joints) => {
                        has_told = true;
                        self.tell(Arc::new(joints.applied(&self.given)));
                        self.settled.send_replace(true);
                    }
                    Err(why) => {
                        tries += 1;
                        if tries == TRIES {
                            tracing::warn!(
                                "{rpc} did not tell the names of its joints: {why}; option joints \
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
            tokio::select! {
                () = bell.notified() => {}
                () = again => {}
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
#[derive(Debug, Default, PartialEq, Eq)]
struct Joints {
    /// None where the board has no name for one, or one name for two.
    names: Vec<String>,
    axes: Vec<Axis>,
}

impl Joints {
    fn applied(self, given: &YarpOptions) -> YarpOptions {
        let joints = if given.joints.is_empty() { self.names } else { given.joints.clone() };
        YarpOptions { joints, axes: self.axes, ..given.clone() }
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

async fn ask(shared: &Shared, options: &YarpOptions, rpc: &str) -> Result<Joints, String> {
    let unregistered = PortOptions { register: false, ..shared.asking() };
    let client = shared.network(options).open_rpc_client(&numbered(rpc), &unregistered).await;
    let client = client.map_err(|error| error.to_string())?;
    let told = async {
        client.connect(&format!("tcp:/{rpc}")).await.map_err(|error| error.to_string())?;
        joints(&client).await
    };
    let told = timeout(ANSWERS, told).await;
    client.close().await;
    told.unwrap_or_else(|_| Err(format!("its answers took more than {ANSWERS:?}")))
}

async fn joints(client: &RpcClient) -> Result<Joints, String> {
    let axes = get(client, "axes", None).await?;
    let count = axes.as_ref().and_then(Value::as_i64).filter(|count| (1..=MOST).contains(count));
    let count = count.ok_or_else(|| format!("it said {axes:?} joints, up to {MOST} are read"))?;
    let mut joints = Joints::default();
    for joint in 0..count {
        let name = get(client, "name", Some(joint)).await?;
        let name = name.as_ref().and_then(Value::as_str).map(str::to_owned);
        let kind = get(client, "type", Some(joint)).await?;
        joints.add(name, kind.as_ref().map_or(Axis::Revolute, axis));
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

/// What the board says of `word`, and of a joint; nothing where it says that it cannot.
async fn get(client: &RpcClient, word: &str, joint: Option<i64>) -> Result<Option<Value>, String> {
    let words = [Value::vocab("get"), Value::vocab(word)];
    let joint = joint.and_then(|joint| i32::try_from(joint).ok()).map(Value::Int32);
    let request = Bottle { values: words.into_iter().chain(joint).collect() };
    let reply = client.call(&request, ANSWERS).await.map_err(|error| error.to_string())?;
    let reply = reply.unwrap_or_default();
    let says = reply.get(0).is_some_and(|first| first.is_word("is"));
    Ok(if says { reply.get(2).cloned() } else { None })
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
        let applied = named.applied(&given);
        assert_eq!(applied.joints, ["a", "b"]);
        assert!(applied.has_degrees(0) && !applied.has_degrees(1));
    }

    #[test]
    fn only_joints_of_a_board_have_one() {
        let joints = joint_state();
        let rpc = |port: &str, options: &YarpOptions| Board::new(joints, options, port).rpc;
        let usual = YarpOptions::default();
        for port in ["/icub/head/state:o", "/icub/head/stateExt:o", "/icub/head/command:i"] {
            assert_eq!(rpc(port, &usual).unwrap(), "/icub/head/rpc:i");
        }
        assert_eq!(rpc("/icub/head/encoders:o", &usual), None);
        let other = YarpOptions { bottle: Some(Default::default()), ..usual.clone() };
        assert_eq!(rpc("/icub/head/state:o", &other), None);
        assert_eq!(Board::new(MessageType::Image, &usual, "/icub/head/state:o").rpc, None);
    }
}
