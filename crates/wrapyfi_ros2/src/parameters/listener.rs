//! An endpoint that yields the parameters of a node: all of them as it first finds them, then each
//! change.

use std::time::Instant;

use super::ServiceOptions;
use super::{ParameterClientError, ParameterResult, RemoteParameters};
use crate::graph::Peers;
use crate::ros2::{NAME, Ros2};
use wrapyfi_endpoint::{
    Absent, Cause, Context, DropReason, Link, Listener, Review, Role, Sample, TakeError, TopicSpec,
};

/// Listens to the parameters of one node.
pub(crate) struct PropertiesListener {
    remote: RemoteParameters,
    context: Context,
    /// The next message is all that is known: the listener has not had what led there.
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
        // The program that comes later begins with all of them.
        self.whole = true;
        let Some(changes) = self.next() else { return false };
        self.context.counters.received(changes.size());
        true
    }

    fn link(&self) -> Link {
        let trouble = self.trouble.as_ref().map(|(text, _)| Cause::Transport(text.clone()));
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
pub(super) fn link(node: &str, servers: &Peers, trouble: Option<Cause>) -> Link {
    let (peers, waiting_for) = match servers {
        Peers::Ready(servers) => (*servers, trouble),
        Peers::Foreign(theirs) => {
            let (theirs, ours) = (theirs.rmw(), theirs.other().rmw());
            (0, Some(Cause::NodeMapping { node: node.to_owned(), theirs, ours }))
        }
        Peers::None | Peers::Half => {
            (0, Some(Absent::new(Role::Server, "node", NAME, node).into()))
        }
    };
    Link { peers: Some(peers), waiting_for, keeps_last: false }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::graph::ServiceMapping;

    #[test]
    fn what_is_waited_for_is_said() {
        let waits = |peers, trouble| link("/camera", &peers, trouble).waiting_for;
        assert_eq!(waits(Peers::Ready(1), None), None);
        let answer = Some(Cause::Transport("an answer".to_owned()));
        assert_eq!(waits(Peers::Ready(1), answer.clone()), answer);
        let node = Absent::new(Role::Server, "node", NAME, "/camera");
        assert_eq!(waits(Peers::Half, None), Some(node.into()));
        let [theirs, ours] = ["rmw_fastrtps_cpp", "rmw_cyclonedds_cpp"];
        let foreign = Cause::NodeMapping { node: "/camera".to_owned(), theirs, ours };
        assert_eq!(waits(Peers::Foreign(ServiceMapping::FastDds), None), Some(foreign));
    }
}
