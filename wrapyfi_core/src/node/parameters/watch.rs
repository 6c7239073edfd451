//! Tells a part of the program which parameters changed.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError, Weak};

use super::Parameter;
use super::event::Changes;
use super::list::is_below;
use crate::endpoint::Wake;
use crate::node::ParameterValue;

/// Parameters that changed since the last look. Of one that changed several times the newest value
/// is told, so a watcher that never looks costs no more than the parameters it watches.
#[derive(Debug)]
pub struct ParameterWatch(Arc<Inbox>);

#[derive(Debug)]
struct Inbox {
    /// Names and groups; empty for all.
    names: Vec<String>,
    changed: Mutex<BTreeMap<String, ParameterValue>>,
    wake: Wake,
}

impl ParameterWatch {
    /// What was declared, set or deleted since the last call, by name. Without a value: deleted.
    #[must_use]
    pub fn take(&self) -> Vec<Parameter> {
        let mut changed = self.0.changed.lock().unwrap_or_else(PoisonError::into_inner);
        std::mem::take(&mut *changed)
            .into_iter()
            .map(|(name, value)| Parameter { name, value })
            .collect()
    }
}

/// The watches of a store. One that was dropped is forgotten at the next change.
#[derive(Debug, Default)]
pub(super) struct Watches(Vec<Weak<Inbox>>);

impl Watches {
    pub(super) fn add(&mut self, names: &[&str], wake: &Wake) -> ParameterWatch {
        let inbox = Arc::new(Inbox {
            names: names.iter().map(|&name| name.to_owned()).collect(),
            changed: Mutex::default(),
            wake: wake.clone(),
        });
        self.0.retain(|watch| watch.strong_count() > 0);
        self.0.push(Arc::downgrade(&inbox));
        ParameterWatch(inbox)
    }

    pub(super) fn tell(&mut self, changes: &Changes) {
        self.0.retain(|watch| {
            let Some(inbox) = watch.upgrade() else { return false };
            let mut any = false;
            let mut changed = inbox.changed.lock().unwrap_or_else(PoisonError::into_inner);
            for Parameter { name, value } in changes.all() {
                if inbox.names.is_empty() || inbox.names.iter().any(|group| is_below(name, group)) {
                    changed.insert(name.clone(), value.clone());
                    any = true;
                }
            }
            drop(changed);
            if any {
                inbox.wake.ring();
            }
            true
        });
    }
}
