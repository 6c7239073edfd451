//! The ports that we publish and serve with: what comes from them to us is not received, and they are
//! not found.

use std::collections::BTreeSet;

use wrapyfi_yarp::port::Port;

use wrapyfi_endpoint::Mutex;

/// Names of our ports. A name belongs to one port of a network at a time.
#[derive(Debug, Default)]
pub(super) struct OwnPorts(Mutex<(BTreeSet<String>, u64)>);

impl OwnPorts {
    fn with<T>(&self, look: impl FnOnce(&mut BTreeSet<String>, &mut u64) -> T) -> T {
        let (names, changes) = &mut *self.0.lock();
        look(names, changes)
    }

    pub(super) fn insert(&self, name: &str) {
        self.with(|names, changes| *changes += u64::from(names.insert(name.to_owned())));
    }

    fn remove(&self, name: &str) {
        self.with(|names, changes| *changes += u64::from(names.remove(name)));
    }

    /// Closes a port, which others may have found.
    pub(super) async fn close(&self, port: Port) {
        let name = port.name().to_owned();
        port.close().await;
        self.remove(&name);
    }

    pub(super) fn contains(&self, name: &str) -> bool {
        self.with(|names, _| names.contains(name))
    }

    /// Number of ports opened and closed so far.
    pub(super) fn changes(&self) -> u64 {
        self.with(|_, changes| *changes)
    }
}
