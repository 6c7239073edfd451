//! Output ports by name: publishers of one name share one port, which closes with the last of them.
//!
//! The name server keeps the last registration of a name only. Were there two ports, no program would ever
//! connect the first.

use std::collections::BTreeMap;
use std::sync::atomic::AtomicI32;
use std::sync::{Arc, Weak};

use tokio::sync::Mutex as AsyncMutex;
use wrapyfi_yarp::port::Port;

use super::own::OwnPorts;
use wrapyfi_endpoint::{Mutex, Peers};

/// Place of one name: held while its port is opened or closed, so that the registration of a port never
/// meets the farewell of the one before.
type Place = Arc<AsyncMutex<Weak<SharedOutput>>>;

/// Settings of a port that all its publishers need alike.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct PortSettings {
    /// The port takes connections of carrier mjpeg.
    pub(super) pictures: bool,
    /// Readers that the port sends to.
    pub(super) to_peers: Option<Peers>,
    /// Port that it connects to by itself, the carrier, and the keeping by the name server.
    pub(super) connects: Option<(String, Option<String>, bool)>,
}

/// A port that is open.
#[derive(Debug)]
pub(super) struct SharedOutput {
    pub(super) port: Port,
    /// Number of the next message with a time.
    pub(super) count: AtomicI32,
    settings: PortSettings,
    /// Keeps the place known for as long as the port is open.
    place: Place,
}

/// The output ports of a YARP instance.
#[derive(Debug, Default)]
pub(super) struct SharedOutputs(Mutex<BTreeMap<String, Place>>);

impl SharedOutputs {
    /// The port of this name, opened by `open` where it is not; `None` where a publisher has it open with
    /// other settings.
    pub(super) async fn open<F: Future<Output = Port>>(
        &self,
        name: &str,
        settings: &PortSettings,
        open: impl FnOnce() -> F,
    ) -> Option<Arc<SharedOutput>> {
        let place = {
            let mut places = self.0.lock();
            places.retain(|_, place| Arc::strong_count(place) > 1);
            Arc::clone(places.entry(name.to_owned()).or_default())
        };
        let mut held = place.lock().await;
        if let Some(output) = held.upgrade() {
            return (output.settings == *settings).then_some(output);
        }
        let output = Arc::new(SharedOutput {
            port: open().await,
            count: AtomicI32::new(0),
            settings: settings.clone(),
            place: Arc::clone(&place),
        });
        *held = Arc::downgrade(&output);
        Some(output)
    }
}

impl SharedOutput {
    /// Gives the port up; the last publisher closes it, and runs `farewell` before.
    pub(super) async fn close(self: Arc<Self>, own: &OwnPorts, farewell: impl Future<Output = ()>) {
        let place = Arc::clone(&self.place);
        // No other program can take the port up, or open one of its name, until it is closed.
        let _held = place.lock().await;
        if let Some(output) = Arc::into_inner(self) {
            farewell.await;
            own.close(output.port).await;
        }
    }
}
