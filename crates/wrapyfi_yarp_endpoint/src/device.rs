//! Properties of a device that its ports do not send, asked for once whenever one of the ports is
//! connected.
//!
//! ```text
//!   control board   /icub/head/state:o, stateExt:o, command:i    its joints          ([`super::board`])
//!   camera          /depthCamera/rgbImage:o, /icub/cam/left      its calibration     ([`super::intrinsics`])
//! ```
//!
//! The ports of a device are there before it can answer, so it is asked again for a while.

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::{Notify, watch};
use tokio::time::{Instant, timeout};
use wrapyfi_yarp::port::{Connected, Port, PortOptions};
use wrapyfi_yarp::{Bottle, Dialect};

use super::board::ANSWERS;
use super::intrinsics::{self, Intrinsics};
use super::opening::numbered;
use super::options::YarpOptions;
use super::shared::InstanceState;
use super::{board, name, payload};
use wrapyfi_data::types::MessageType;
use wrapyfi_endpoint::backoff::Backoff;
use wrapyfi_endpoint::{Cause, Mutex, Named};

/// Time to the second try.
const FIRST: Duration = Duration::from_millis(100);
/// Tries before a board is asked only when a program needs it, and a camera no more.
const TRIES: u32 = 8;
/// Longest time that the first messages wait for the device's answers.
const TIMEOUT: Duration = Duration::from_secs(1);
/// The same for movements, which cannot be written without: a board that has just started takes longer.
const MOVE_TIMEOUT: Duration = Duration::from_secs(5);

/// Properties that a device is asked for.
#[derive(Debug)]
enum Subject {
    /// The joints of a control board.
    Joints {
        /// Movements go to it: its limits count.
        is_moved: bool,
    },
    /// The calibration of the camera whose pictures this port sends.
    Calibration { picture: String },
}

/// The options of a topic, with what the device behind it tells.
#[derive(Debug)]
pub(super) struct Device {
    given: Arc<YarpOptions>,
    /// None where the topic is no device's.
    subject: Option<Subject>,
    /// The ports for requests that the device may have, and what it speaks there.
    rpc: Vec<(String, Dialect)>,
    current: Mutex<Arc<YarpOptions>>,
    /// Messages need not wait: it has told, or took too long, or there is no board to ask.
    settled: watch::Sender<bool>,
    /// Signal of messages that would wait.
    wanted: Notify,
    /// Held while a request is made of it.
    turn: tokio::sync::Mutex<()>,
}

impl Device {
    /// The device that messages of this type come from, or go to, at `port`.
    pub(super) fn new(message_type: MessageType, options: &YarpOptions, port: &str) -> Self {
        let (subject, rpc) = match message_type {
            _ if options.bottle.is_some() => (None, Vec::new()),
            joints if payload::is_of_joints(joints) => {
                let rpc = board::requests(port).map(Vec::from).unwrap_or_default();
                let is_moved = port.ends_with(payload::COMMAND_PORT);
                (Some(Subject::Joints { is_moved }).filter(|_| !rpc.is_empty()), rpc)
            }
            info if payload::is_of_camera(info) => {
                let picture = port.to_owned();
                let rpc = vec![(intrinsics::requests(port), Dialect::V3)];
                (Some(Subject::Calibration { picture }), rpc)
            }
            _ => (None, Vec::new()),
        };
        let given = Arc::new(options.clone());
        let settled = watch::Sender::new(subject.is_none());
        let current = Mutex::new(Arc::clone(&given));
        Self {
            current,
            given,
            subject,
            rpc,
            settled,
            wanted: Notify::new(),
            turn: tokio::sync::Mutex::default(),
        }
    }

    /// The options as they are now.
    pub(super) fn options(&self) -> Arc<YarpOptions> {
        let options = Arc::clone(&self.current.lock());
        if matches!(self.subject, Some(Subject::Joints { .. })) && options.axes.is_empty() {
            self.wanted.notify_one();
        }
        options
    }

    fn tell(&self, options: Arc<YarpOptions>) {
        *self.current.lock() = options;
    }

    /// Waits, for a short while, until the device has told.
    pub(super) async fn wait(&self) {
        if *self.settled.borrow() {
            return;
        }
        self.wanted.notify_one();
        let mut settled = self.settled.subscribe();
        if timeout(TIMEOUT, settled.wait_for(|settled| *settled)).await.is_err() {
            // Once is enough.
            self.settled.send_replace(true);
        }
    }

    /// Makes a request of the device, one after the other.
    ///
    /// # Errors
    /// Reason that it was not carried out.
    pub(super) async fn request(
        &self,
        shared: &InstanceState,
        request: &Bottle,
    ) -> Result<(), String> {
        let _turn = self.turn.lock().await;
        let known = self.rpc.iter().find(|(name, _)| shared.directory.knows(name));
        let (rpc, _) = known.ok_or_else(|| "its port for requests is not there".to_owned())?;
        let answer = on_port(shared, rpc, async |client| {
            client.call(request, ANSWERS).await.map_err(|error| error.to_string())
        });
        let answer = answer.await?.unwrap_or_default();
        match answer.values.last() {
            Some(last) if last.is_word("ok") => Ok(()),
            _ => Err(format!("{rpc} answered {}", answer.to_text())),
        }
    }

    /// Port whose answer movements wait for, while the board is connected and has not told.
    pub(super) fn awaited(&self) -> Option<Cause> {
        let Some(Subject::Joints { .. }) =
            self.subject.as_ref().filter(|_| !*self.settled.borrow())
        else {
            return None;
        };
        let (rpc, _) = self.rpc.first()?;
        Some(Cause::peer(
            Named { words: rpc.clone(), ..name::port(rpc) },
            " to tell the joints of its board",
            None,
            "",
        ))
    }

    /// Asks the device whenever it gets connected, for as long as it is run, and again while it cannot
    /// tell: its ports are there before it is. `changes` tells when to look at `connected`.
    pub(super) async fn follow(
        &self,
        shared: &InstanceState,
        mut changes: watch::Receiver<Connected>,
        connected: &(dyn Fn() -> bool + Sync),
    ) {
        let Some(subject) = &self.subject else { return std::future::pending().await };
        let names: Vec<String> = self.rpc.iter().map(|(name, _)| name.clone()).collect();
        let bell = shared.directory.watch_any(&names);
        let name = names.first().map_or("", String::as_str);
        let known = || self.rpc.iter().find(|(name, _)| shared.directory.knows(name));
        let (mut backoff, mut tries, mut has_told) =
            (Backoff::of_name(name).starting_at(FIRST), 0, false);
        let mut connected_at = None;
        loop {
            // Seen before the look, so that no change is missed.
            changes.mark_unchanged();
            if !connected() {
                backoff.reset();
                (tries, has_told, connected_at) = (0, false, None);
                self.settled.send_replace(false);
                self.tell(Arc::clone(&self.given));
            } else if let Some((name, dialect)) = known().filter(|_| !has_told) {
                match ask(shared, name, *dialect, subject, &self.given).await {
                    Ok(options) => {
                        has_told = true;
                        self.tell(Arc::new(options));
                        self.settled.send_replace(true);
                    }
                    Err(why) => {
                        tries += 1;
                        if tries == TRIES {
                            let (what, remedy) = subject.missing();
                            tracing::warn!("{name} did not tell {what}: {why}; {remedy}");
                        }
                    }
                }
            }
            let again = async {
                if tries == 0 || has_told {
                    return std::future::pending().await;
                }
                if tries >= TRIES {
                    // Not before a program needs it.
                    self.wanted.notified().await;
                } else if matches!(subject, Subject::Calibration { .. }) {
                    // A camera that sends can tell: its first picture waits for that.
                    tokio::select! { () = self.wanted.notified() => return, () = backoff.pause() => return }
                }
                backoff.pause().await;
            };
            if connected() {
                connected_at.get_or_insert_with(Instant::now);
            }
            let wait = if known().is_some() { MOVE_TIMEOUT } else { TIMEOUT };
            let over = connected_at.filter(|_| !*self.settled.borrow());
            let over = async {
                match over {
                    Some(at) => tokio::time::sleep_until(at + wait).await,
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

impl Subject {
    /// Name of the properties that the device has not told, and the consequence, for a warning.
    fn missing(&self) -> (&'static str, &'static str) {
        match self {
            Self::Joints { .. } => ("the names of its joints", "option joints may name them"),
            Self::Calibration { .. } => {
                ("its calibration", "the CameraInfo of its pictures has zeros, which is none")
            }
        }
    }
}

/// Asks the device behind the port `rpc` for its properties and returns `given` with them.
async fn ask(
    shared: &InstanceState,
    rpc: &str,
    dialect: Dialect,
    subject: &Subject,
    given: &YarpOptions,
) -> Result<YarpOptions, String> {
    on_port(shared, rpc, async |client| match subject {
        Subject::Joints { is_moved } => {
            let joints = board::joints(client, dialect, *is_moved).await?;
            Ok(joints.applied(given, dialect))
        }
        Subject::Calibration { picture } => {
            let intrinsics = Some(calibration(client, picture).await?);
            Ok(YarpOptions { intrinsics, ..given.clone() })
        }
    })
    .await
}

/// Does `work` with a client that is connected to the port `rpc`.
async fn on_port<T>(
    shared: &InstanceState,
    rpc: &str,
    work: impl AsyncFnOnce(&Port) -> Result<T, String>,
) -> Result<T, String> {
    let unregistered = PortOptions { register: false, ..shared.asking() };
    let client = shared.network.open_rpc_client(&numbered(rpc), &unregistered).await;
    let client = client.map_err(|error| error.to_string())?;
    let told = async {
        client.connect(&format!("tcp:/{rpc}")).await.map_err(|error| error.to_string())?;
        work(&client).await
    };
    let told = timeout(ANSWERS, told).await;
    client.close().await;
    told.unwrap_or_else(|_| Err(format!("its answers took more than {ANSWERS:?}")))
}

/// The calibration of a camera. Those of YARP 3 and of YARP 4 have the same port: who does not know the one question
/// is asked the other.
async fn calibration(client: &Port, picture: &str) -> Result<Intrinsics, String> {
    let ask = async |dialect| {
        let question = intrinsics::question(picture, dialect);
        let answer = client.call(&question, ANSWERS).await.map_err(|error| error.to_string())?;
        Intrinsics::of(&answer.unwrap_or_default())
    };
    match ask(Dialect::V3).await {
        Ok(told) => Ok(told),
        // Both dialects failed: the answer in the usual one tells more.
        Err(why) => ask(Dialect::V4).await.or(Err(why)),
    }
}

#[cfg(test)]
mod tests {
    use wrapyfi_interfaces::store::TypeStore;

    use super::*;

    fn ros(name: &str) -> MessageType {
        MessageType::resolve(name, &mut TypeStore::generated()).unwrap()
    }

    #[test]
    fn only_devices_are_asked() {
        let rpc = |kind: MessageType, port: &str, options: &YarpOptions| {
            let device = Device::new(kind, options, port);
            assert_eq!(device.subject.is_some(), !device.rpc.is_empty());
            device.rpc.into_iter().map(|(name, _)| name).collect::<Vec<_>>()
        };
        let (joints, info) = (ros("sensor_msgs/msg/JointState"), ros(intrinsics::CAMERA_INFO));
        let usual = YarpOptions::default();
        for port in ["/icub/head/state:o", "/icub/head/stateExt:o", "/icub/head/command:i"] {
            assert_eq!(rpc(joints, port, &usual), ["/icub/head/rpc:i", "/icub/head/nws/rpc:i"]);
        }
        let camera = "/depthCamera/rgbImage:o";
        assert_eq!(rpc(info, camera, &usual), ["/depthCamera/rpc:i"]);
        let other = YarpOptions { bottle: Some(Default::default()), ..usual.clone() };
        for (kind, port, options) in [
            (joints, "/icub/head/encoders:o", &usual),
            (joints, "/icub/head/state:o", &other),
            (MessageType::Image, "/icub/head/state:o", &usual),
            (MessageType::Image, camera, &usual),
            (info, camera, &other),
        ] {
            assert!(rpc(kind, port, options).is_empty(), "{kind} {port}");
        }
    }
}
