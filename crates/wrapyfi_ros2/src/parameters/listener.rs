//! An endpoint that yields the parameters of a node: all of them as it first finds them, then each
//! change.

use std::time::Instant;

use super::ServiceOptions;
use super::{ParameterClientError, ParameterResult, RemoteParameters};
use crate::graph::Peers;
use crate::ros2::Ros2;
use wrapyfi_endpoint::{Context, DropReason, Link, Listener, Review, Sample, TakeError, TopicSpec};

/// Listens to the parameters of one node.
pub(crate) struct PropertiesListener {
    remote: RemoteParameters,
    context: Context,
    /// The next message is all that is known: nobody was told what led there.
    whole: bool,
    /// Reason why the parameters are not known, and true once the caller was told.
    trouble: Option<(String, bool)>,
}

impl PropertiesListener {
    pub(crate) fn open(ros2: &Ros2, spec: &TopicSpec, context: &Context) -> ParameterResult<Self> {
        let options =
            ServiceOptions { max_bytes: spec.limits.message_bytes, ..ServiceOptions::default() };
        Ok(Self {
            remote: RemoteParameters::watch(ros2, &spec.topic, &options, &context.wake)?,
            context: context.clone(),
            whole: true,
            trouble: None,
        })
    }

    /// Takes the changes since the last call, if any.
    fn next(&mut self) -> Option<wrapyfi_data::types::Properties> {
        let taken = self.remote.take(self.context.clock.now());
        self.context.counters.dropped_many(DropReason::LostUpstream, self.remote.lost());
        match taken {
            Ok(changes) => {
                if self.remote.follows() {
                    self.trouble = None;
                }
                changes
            }
            Err(error) => {
                self.context.counters.dropped(match error {
                    ParameterClientError::TooMuch { .. } => DropReason::Oversize,
                    ParameterClientError::Reply { .. } => DropReason::Malformed,
                    _ => DropReason::LostUpstream,
                });
                self.trouble = Some((error.to_string(), false));
                // To be asked about it, and about when to look again.
                self.context.wake.ring();
                None
            }
        }
    }
}

impl Listener for PropertiesListener {
    fn take(&mut self) -> Result<Option<Sample>, TakeError> {
        let changes = self.next();
        let properties = match changes {
            Some(_) if self.whole => self.remote.known().clone(),
            Some(changes) => changes,
            None if self.whole && self.remote.follows() => self.remote.known().clone(),
            None => return Ok(None),
        };
        self.whole = false;
        let wire_bytes = properties.size();
        self.context.counters.received(wire_bytes);
        let (payload, received_at) = (properties.into(), self.context.clock.now());
        Ok(Some(Sample { payload, wire_bytes, received_at, origin: None }))
    }

    fn discard(&mut self) -> bool {
        // Whoever comes later begins with all of them.
        self.whole = true;
        let Some(changes) = self.next() else { return false };
        self.context.counters.received(changes.size());
        true
    }

    fn link(&self) -> Link {
        let trouble = self.trouble.as_ref().map(|(text, _)| text.clone());
        link(self.remote.node(), &self.remote.servers(), trouble)
    }

    fn review(&mut self, now: Instant) -> Review {
        let mut review = Review { next: self.remote.deadline(now), ..Review::default() };
        if let Some((text, told)) = &mut self.trouble
            && !std::mem::replace(told, true)
        {
            review.warnings.push(text.clone());
        }
        review
    }
}

/// The link to a node with so many servers of its parameters.
pub(super) fn link(node: &str, servers: &Peers, trouble: Option<String>) -> Link {
    let (peers, waiting_for) = match servers {
        Peers::Ready(servers) => (*servers, trouble),
        Peers::Foreign(theirs) => {
            let (theirs, ours) = (theirs.rmw(), theirs.other().rmw());
            let what = format!(
                "node {node} to speak {ours}: it runs {theirs}; set RMW_IMPLEMENTATION={theirs} \
                 here, or {ours} there"
            );
            (0, Some(what))
        }
        Peers::None | Peers::Half => (0, Some(format!("node {node}"))),
    };
    Link { peers: Some(peers), waiting_for, keeps_last: false }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::graph::ServiceMapping;

    #[test]
    fn what_is_waited_for_is_said() {
        let waits = |peers, trouble: Option<&str>| {
            link("/camera", &peers, trouble.map(str::to_owned)).waiting_for
        };
        assert_eq!(waits(Peers::Ready(1), None), None);
        assert_eq!(waits(Peers::Ready(1), Some("an answer")).as_deref(), Some("an answer"));
        assert_eq!(waits(Peers::Half, None).as_deref(), Some("node /camera"));
        let foreign = waits(Peers::Foreign(ServiceMapping::FastDds), None).unwrap();
        assert_eq!(
            foreign,
            "node /camera to speak rmw_cyclonedds_cpp: it runs rmw_fastrtps_cpp; set \
             RMW_IMPLEMENTATION=rmw_fastrtps_cpp here, or rmw_cyclonedds_cpp there"
        );
    }
}
