//! Watches, by which a part of the program learns which parameters changed.

use std::collections::BTreeMap;
use std::sync::{Arc, Weak};

use super::Parameter;
use super::event::Changes;
use super::list::is_below;
use crate::ParameterValue;
use wrapyfi_endpoint::{Mutex, Wake};

/// Parameters that changed since the last [`ParameterWatch::take`]. Only the newest value of each
/// is kept, so that a watch that is never taken holds no more than the parameters it watches.
///
/// See [`ParameterStore`](super::ParameterStore).
#[derive(Debug)]
pub struct ParameterWatch(Arc<Inbox>);

#[derive(Debug)]
struct Inbox {
    /// Names and groups that are watched; empty for all.
    names: Vec<String>,
    changed: Mutex<BTreeMap<String, ParameterValue>>,
    wake: Wake,
}

impl ParameterWatch {
    /// Parameters that were declared, set or deleted since the last call, by name. A deleted one
    /// has no value.
    #[must_use]
    pub fn take(&self) -> Vec<Parameter> {
        let changed = std::mem::take(&mut *self.0.changed.lock());
        changed.into_iter().map(|(name, value)| Parameter { name, value }).collect()
    }
}

/// The watches of a store. A watch that was dropped is forgotten at the next change.
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
            let mut changed = inbox.changed.lock();
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
