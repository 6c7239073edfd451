//! Changes of parameters that wait to be published on `/parameter_events`.

use std::collections::VecDeque;

use wrapyfi_interfaces::rcl_interfaces::msg::{self, ParameterEvent};

use super::{MAX_EVENTS, MAX_REPLY_BYTES, Parameter};
use crate::time;
use wrapyfi_data::types::Stamp;

/// Changes of one declaration or one accepted request.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Changes {
    pub(super) new: Vec<Parameter>,
    pub(super) changed: Vec<Parameter>,
    pub(super) deleted: Vec<Parameter>,
}

impl Changes {
    pub(super) fn all(&self) -> impl Iterator<Item = &Parameter> {
        self.new.iter().chain(&self.changed).chain(&self.deleted)
    }

    fn size(&self) -> usize {
        self.all().fold(0, |sum, parameter| sum.saturating_add(parameter.size()))
    }
}

/// Changes that have not been published.
#[derive(Debug, Default)]
pub(super) struct PendingEvents {
    changes: VecDeque<Changes>,
    size: usize,
    /// Number of changes that were dropped because they were not taken, since some were.
    lost: u64,
}

impl PendingEvents {
    pub(super) fn push(&mut self, changes: Changes) {
        self.size = self.size.saturating_add(changes.size());
        self.changes.push_back(changes);
        // The newest stays, however large.
        while self.changes.len() > MAX_EVENTS
            || self.size > MAX_REPLY_BYTES && self.changes.len() > 1
        {
            let Some(oldest) = self.changes.pop_front() else { break };
            self.size = self.size.saturating_sub(oldest.size());
            self.lost = self.lost.saturating_add(1);
        }
    }

    pub(super) fn take(&mut self, node: &str, stamp: Stamp) -> Vec<ParameterEvent> {
        self.size = 0;
        let lost = std::mem::take(&mut self.lost);
        if lost > 0 {
            tracing::warn!(lost, "changes of parameters were not told on /parameter_events");
        }
        let messages = |parameters: Vec<Parameter>| -> Vec<msg::Parameter> {
            parameters.into_iter().map(msg::Parameter::from).collect()
        };
        self.changes
            .drain(..)
            .map(|changes| ParameterEvent {
                stamp: time(stamp),
                node: node.to_owned(),
                new_parameters: messages(changes.new),
                changed_parameters: messages(changes.changed),
                deleted_parameters: messages(changes.deleted),
            })
            .collect()
    }
}
