//! Services of one node under the mappings of both DDS vendors at once.
//!
//! ```text
//!   Client ─ servers of Cyclone's mapping are there? ─ yes ─▶ CycloneDDS       Server ◀─ CycloneDDS: requests of both
//!                                                     └ no ──▶ RustDDS                ◀─ RustDDS: those of Fast DDS again
//!                                                                                     ─▶ reply where the request is from
//! ```
//!
//! Both stacks have the same topics, so that a client of Fast DDS takes the service for there as soon as one of them
//! has matched, and its request may be in time for CycloneDDS alone. That request is given then, and what RustDDS has
//! received as well is given once.

use std::collections::VecDeque;
use std::time::Duration;

use super::graph::{CdrClient, CdrReply, CdrRequest, CdrServer, GraphError, Peers, RequestId};

/// Requests of Fast DDS's mapping by which the second copy is known.
const MAX_SEEN: usize = 1024;

/// Calls a server under the mapping that it has.
pub(super) struct Client {
    cyclone: Box<dyn CdrClient>,
    fast_dds: Box<dyn CdrClient>,
}

impl Client {
    pub(super) fn new(cyclone: Box<dyn CdrClient>, fast_dds: Box<dyn CdrClient>) -> Self {
        Self { cyclone, fast_dds }
    }
}

/// Number of a request that has `sequence` on one of the stacks.
fn numbered(sequence: i64, is_fast_dds: bool) -> i64 {
    sequence.saturating_mul(2).saturating_add(i64::from(is_fast_dds))
}

impl CdrClient for Client {
    fn send(&mut self, parts: &[&[u8]]) -> Result<i64, GraphError> {
        let is_fast_dds = !matches!(self.cyclone.servers(), Peers::Ready(_));
        let stack = if is_fast_dds { &mut self.fast_dds } else { &mut self.cyclone };
        Ok(numbered(stack.send(parts)?, is_fast_dds))
    }

    fn take(&mut self) -> Result<Option<CdrReply>, GraphError> {
        for (stack, is_fast_dds) in [(&mut self.cyclone, false), (&mut self.fast_dds, true)] {
            if let Some(reply) = stack.take()? {
                let sequence = numbered(reply.sequence, is_fast_dds);
                return Ok(Some(CdrReply { sequence, ..reply }));
            }
        }
        Ok(None)
    }

    fn servers(&self) -> Peers {
        of_either(self.cyclone.servers(), self.fast_dds.servers())
    }

    fn look_again(&self) -> Option<Duration> {
        sooner(self.cyclone.look_again(), self.fast_dds.look_again())
    }

    fn lost(&mut self) -> u64 {
        self.cyclone.lost().max(self.fast_dds.lost())
    }
}

/// Serves clients of both mappings.
pub(super) struct Server {
    cyclone: Box<dyn CdrServer>,
    fast_dds: Box<dyn CdrServer>,
    /// Requests of Fast DDS's mapping that were given last.
    seen: VecDeque<([u8; 16], i64)>,
}

impl Server {
    pub(super) fn new(cyclone: Box<dyn CdrServer>, fast_dds: Box<dyn CdrServer>) -> Self {
        Self { cyclone, fast_dds, seen: VecDeque::new() }
    }

    /// True for a request that the other stack has not given.
    fn is_new(&mut self, request: &CdrRequest) -> bool {
        let Some(sample) = request.sample else { return true };
        if self.seen.contains(&sample) {
            return false;
        }
        self.seen.truncate(MAX_SEEN - 1);
        self.seen.push_front(sample);
        true
    }

    /// Stack of the client of a request. Identities of CycloneDDS's mapping have eight bytes, then zeros.
    fn stack(&self, id: &RequestId) -> &dyn CdrServer {
        if is_fast_dds(id) { self.fast_dds.as_ref() } else { self.cyclone.as_ref() }
    }
}

fn is_fast_dds(id: &RequestId) -> bool {
    !id.client.ends_with(&[0; 8])
}

impl CdrServer for Server {
    fn take(&mut self) -> Result<Option<CdrRequest>, GraphError> {
        while let Some(request) = self.cyclone.take()? {
            if self.is_new(&request) {
                return Ok(Some(request));
            }
        }
        loop {
            match self.fast_dds.take() {
                Ok(Some(request)) if !self.is_new(&request) => {}
                // Of a client of CycloneDDS, whose request the other stack has.
                Err(GraphError::ForeignMapping { .. }) => {}
                taken => return taken,
            }
        }
    }

    fn hears(&self, id: &RequestId) -> bool {
        self.stack(id).hears(id)
    }

    fn look_again(&self) -> Option<Duration> {
        sooner(self.cyclone.look_again(), self.fast_dds.look_again())
    }

    fn reply(&mut self, id: &RequestId, parts: &[&[u8]]) -> Result<(), GraphError> {
        let stack = if is_fast_dds(id) { &mut self.fast_dds } else { &mut self.cyclone };
        stack.reply(id, parts)
    }

    fn clients(&self) -> Peers {
        of_either(self.cyclone.clients(), self.fast_dds.clients())
    }

    fn lost(&mut self) -> u64 {
        self.cyclone.lost().max(self.fast_dds.lost())
    }
}

/// The other ends on either stack. One that has both mappings is on both.
fn of_either(cyclone: Peers, fast_dds: Peers) -> Peers {
    match (cyclone, fast_dds) {
        (Peers::Ready(one), Peers::Ready(other)) => Peers::Ready(one.max(other)),
        (ready @ Peers::Ready(_), _) | (_, ready @ Peers::Ready(_)) => ready,
        (Peers::None, Peers::None) => Peers::None,
        // Foreign on one stack: the other will find it.
        _ => Peers::Half,
    }
}

fn sooner(one: Option<Duration>, other: Option<Duration>) -> Option<Duration> {
    [one, other].into_iter().flatten().min()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use bytes::Bytes;
    use wrapyfi_endpoint::Mutex;

    use super::*;
    use crate::graph::{GraphResult, ServiceMapping};

    /// One stack: what it will give, whom it has found, what was sent.
    struct Stack<T> {
        given: VecDeque<GraphResult<T>>,
        peers: Peers,
        sent: Arc<Mutex<Vec<i64>>>,
    }

    impl CdrClient for Stack<CdrReply> {
        fn send(&mut self, _: &[&[u8]]) -> Result<i64, GraphError> {
            self.sent.lock().push(1);
            Ok(1)
        }

        fn take(&mut self) -> Result<Option<CdrReply>, GraphError> {
            self.given.pop_front().transpose()
        }

        fn servers(&self) -> Peers {
            self.peers.clone()
        }
    }

    impl CdrServer for Stack<CdrRequest> {
        fn take(&mut self) -> Result<Option<CdrRequest>, GraphError> {
            self.given.pop_front().transpose()
        }

        fn reply(&mut self, id: &RequestId, _: &[&[u8]]) -> Result<(), GraphError> {
            self.sent.lock().push(id.sequence);
            Ok(())
        }

        fn clients(&self) -> Peers {
            self.peers.clone()
        }
    }

    type Sent = Arc<Mutex<Vec<i64>>>;

    fn stack<T>(peers: Peers, given: Vec<GraphResult<T>>) -> (Box<Stack<T>>, Sent) {
        let sent = Sent::default();
        (Box::new(Stack { given: given.into(), peers, sent: Arc::clone(&sent) }), sent)
    }

    #[test]
    fn a_server_is_called_where_it_is() {
        let fast = Peers::Foreign(ServiceMapping::FastDds);
        let reply = CdrReply { sequence: 1, cdr: Bytes::new(), source_timestamp_ns: 0 };
        for (on_cyclone, number) in [(fast.clone(), 3), (Peers::Ready(1), 2)] {
            let (cyclone, on_one) = stack(on_cyclone, vec![]);
            let (fast_dds, on_other) = stack(Peers::Ready(1), vec![Ok(reply.clone())]);
            let mut client = Client::new(cyclone, fast_dds);
            assert_eq!(client.servers(), Peers::Ready(1));
            assert_eq!(client.send(&[]), Ok(number));
            assert_eq!(
                (on_one.lock().len() + 2, on_other.lock().len()),
                if number == 2 { (3, 0) } else { (2, 1) }
            );
            assert_eq!(client.take().unwrap().unwrap().sequence, 3);
            assert_eq!(client.take(), Ok(None));
        }
        assert_eq!(of_either(fast, Peers::None), Peers::Half, "the other stack will find it");
        assert_eq!(of_either(Peers::None, Peers::None), Peers::None);
    }

    #[test]
    fn a_request_is_given_once_and_answered_where_its_client_is() {
        let request = |client: [u8; 16], sequence, sample| {
            let id = RequestId { client, sequence };
            Ok(CdrRequest { id, cdr: Bytes::new(), source_timestamp_ns: 0, sample })
        };
        let (writer, reader) = ([7; 16], [8; 16]);
        let mut of_cyclone = [9; 16];
        of_cyclone[8..].fill(0);
        let service = "/s".to_owned();
        let (ours, theirs) = (ServiceMapping::FastDds, ServiceMapping::Cyclone);
        let foreign = GraphError::ForeignMapping { service, ours, theirs };
        let (cyclone, on_cyclone) = stack(
            Peers::Half,
            vec![request(of_cyclone, 10, None), request(writer, 1, Some((writer, 1)))],
        );
        let (fast_dds, on_fast_dds) = stack(
            Peers::None,
            vec![
                Err(foreign),
                request(reader, 1, Some((writer, 1))),
                request(reader, 2, Some((writer, 2))),
            ],
        );
        let mut server = Server::new(cyclone, fast_dds);
        let mut taken = Vec::new();
        while let Some(request) = server.take().unwrap() {
            server.reply(&request.id, &[]).unwrap();
            taken.push((request.id.client, request.id.sequence));
        }
        assert_eq!(taken, [(of_cyclone, 10), (writer, 1), (reader, 2)]);
        assert_eq!((&**on_cyclone.lock(), &**on_fast_dds.lock()), (&[10][..], &[1, 2][..]));
    }
}
