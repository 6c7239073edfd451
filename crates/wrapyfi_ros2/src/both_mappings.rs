//! Services of one node under the mappings of both DDS vendors at once.
//!
//! ```text
//!   Client ─ servers of Cyclone's mapping are there? ─ yes ─▶ CycloneDDS       Server ◀─ CycloneDDS, RustDDS: requests of both
//!                                                     └ no ──▶ RustDDS                ─▶ reply: the stack of the request's mapping
//! ```
//!
//! Both stacks have the same topics, so that a client of Fast DDS takes the service for there as soon as one of them
//! has matched, and asks in that moment. A reader of CycloneDDS passes over what a writer of Fast DDS wrote before it knew
//! that writer, where RustDDS asks for it again. So a server on CycloneDDS is announced only, until a client of its own
//! mapping is there: with RustDDS alone no request is lost. After that a request may be in time for CycloneDDS alone, as one
//! of a client on CycloneDDS may be for RustDDS alone. It is given then, and what both have received is given once.

use std::any::Any;
use std::collections::VecDeque;
use std::time::Duration;

use super::graph::{
    CdrClient, CdrReply, CdrRequest, CdrServer, Created, DiscoveredEndpoint, GraphError, PeerWatch,
    Peers, RequestId, ServiceMapping,
};
use super::vendor::is_rustdds;

/// Requests by which the second copy is known.
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
        // What one stack has may change between the look that found it ready and this one, where a match comes or goes:
        // the other one may have no server at all.
        let is_fast_dds = match (self.cyclone.servers(), self.fast_dds.servers()) {
            (Peers::Ready(_), _) => false,
            (_, Peers::Ready(_)) => true,
            (cyclone, _) => cyclone != Peers::Half,
        };
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

    fn id_of(&self, sequence: i64) -> RequestId {
        let stack = if sequence & 1 == 0 { &self.cyclone } else { &self.fast_dds };
        stack.id_of(sequence >> 1)
    }

    fn servers(&self) -> Peers {
        of_either(self.cyclone.servers(), self.fast_dds.servers())
    }

    fn look_again(&self) -> Option<Duration> {
        sooner(self.cyclone.look_again(), self.fast_dds.look_again())
    }
}

/// A server on CycloneDDS that no client needs yet.
pub(super) struct Waiting {
    open: Box<dyn Fn() -> Created<dyn CdrServer> + Send>,
    /// Writers of requests, and the number of their changes at the last look.
    callers: Box<dyn PeerWatch>,
    seen: u64,
    /// Endpoints by which others know of the server.
    _announced: Box<dyn Any + Send>,
}

impl Waiting {
    /// A server that `open` creates when one of `callers` speaks its mapping; `announced` lives until then.
    pub(super) fn new(
        open: Box<dyn Fn() -> Created<dyn CdrServer> + Send>,
        callers: Box<dyn PeerWatch>,
        announced: Box<dyn Any + Send>,
    ) -> Self {
        Self { open, callers, seen: 0, _announced: announced }
    }

    fn is_needed(&mut self) -> bool {
        let changes = self.callers.changes();
        if std::mem::replace(&mut self.seen, changes) == changes {
            return false;
        }
        self.callers.peers().iter().any(speaks_cyclone)
    }
}

/// False for programs on Fast DDS. Those on RustDDS that do not tell are taken to speak its mapping.
fn speaks_cyclone(caller: &DiscoveredEndpoint) -> bool {
    caller.service_mapping != Some(ServiceMapping::FastDds) && !is_rustdds(&caller.gid)
}

/// Serves clients of both mappings.
pub(super) struct Server {
    cyclone: Option<Box<dyn CdrServer>>,
    waiting: Option<Waiting>,
    fast_dds: Box<dyn CdrServer>,
    /// Requests that were given last.
    seen: VecDeque<([u8; 16], i64)>,
}

impl Server {
    pub(super) fn new(waiting: Waiting, fast_dds: Box<dyn CdrServer>) -> Self {
        Self { cyclone: None, waiting: Some(waiting), fast_dds, seen: VecDeque::new() }
    }

    /// Opens the server on CycloneDDS where it is not open and `is_needed`, or a client of its mapping is there.
    fn open(&mut self, is_needed: bool) -> Result<(), GraphError> {
        if let Some(waiting) = &mut self.waiting
            && (is_needed || waiting.is_needed())
        {
            let opened = (waiting.open)();
            // Refused once, it would be refused again.
            self.waiting = None;
            self.cyclone = Some(opened?);
        }
        Ok(())
    }

    /// True for a request that the other stack has not given. One of CycloneDDS's mapping has its identity in itself; of
    /// the writer of one of Fast DDS's both stacks have the number.
    fn is_new(&mut self, request: &CdrRequest) -> bool {
        let identity = match is_fast_dds(&request.id) {
            true => request.sample,
            false => Some((request.id.client, request.id.sequence)),
        };
        let Some(identity) = identity else { return true };
        if self.seen.contains(&identity) {
            return false;
        }
        self.seen.truncate(MAX_SEEN - 1);
        self.seen.push_front(identity);
        true
    }
}

/// Identities of CycloneDDS's mapping have eight bytes, then zeros.
fn is_fast_dds(id: &RequestId) -> bool {
    !id.client.ends_with(&[0; 8])
}

impl CdrServer for Server {
    fn take(&mut self) -> Result<Option<CdrRequest>, GraphError> {
        self.open(false)?;
        while let Some(cyclone) = &mut self.cyclone
            && let Some(request) = cyclone.take()?
        {
            if self.is_new(&request) {
                return Ok(Some(request));
            }
        }
        while let Some(request) = self.fast_dds.take()? {
            if !self.is_new(&request) {
                continue;
            }
            if let Some((writer, _)) = request.sample.filter(|_| !is_fast_dds(&request.id)) {
                self.open(true)?;
                // Without it the server could not answer.
                let Some(cyclone) = &mut self.cyclone else { continue };
                cyclone.note_client(&request.id, &writer);
            }
            return Ok(Some(request));
        }
        Ok(None)
    }

    fn hears(&self, id: &RequestId) -> bool {
        match &self.cyclone {
            Some(cyclone) if !is_fast_dds(id) => cyclone.hears(id),
            _ => self.fast_dds.hears(id),
        }
    }

    fn look_again(&self) -> Option<Duration> {
        let cyclone = self.cyclone.as_ref().and_then(|it| it.look_again());
        sooner(cyclone, self.fast_dds.look_again())
    }

    fn reply(&mut self, id: &RequestId, parts: &[&[u8]]) -> Result<(), GraphError> {
        match &mut self.cyclone {
            Some(cyclone) if !is_fast_dds(id) => cyclone.reply(id, parts),
            _ => self.fast_dds.reply(id, parts),
        }
    }

    fn clients(&self) -> Peers {
        let cyclone = self.cyclone.as_ref().map_or(Peers::None, |it| it.clients());
        of_either(cyclone, self.fast_dds.clients())
    }

    fn lost(&mut self) -> u64 {
        let cyclone = self.cyclone.as_mut().map_or(0, |it| it.lost());
        cyclone.max(self.fast_dds.lost())
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
    use wrapyfi_endpoint::{Mutex, Qos};

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

        fn id_of(&self, sequence: i64) -> RequestId {
            RequestId { client: [0; 16], sequence }
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
            assert_eq!(client.id_of(number).sequence, 1);
            assert_eq!(
                (on_one.lock().len() + 2, on_other.lock().len()),
                if number == 2 { (3, 0) } else { (2, 1) }
            );
            assert_eq!(client.take().unwrap().unwrap().sequence, 3);
            assert_eq!(client.take(), Ok(None));
        }
        // A match has come since the look that found it ready: the server is there.
        let (cyclone, fast_dds) =
            (stack::<CdrReply>(Peers::Half, vec![]).0, stack(Peers::None, vec![]).0);
        assert_eq!(Client::new(cyclone, fast_dds).send(&[]), Ok(2));
        assert_eq!(of_either(fast, Peers::None), Peers::Half, "the other stack will find it");
        assert_eq!(of_either(Peers::None, Peers::None), Peers::None);
    }

    /// Writers of requests as discovery finds them.
    struct Callers(Arc<Mutex<(u64, Vec<DiscoveredEndpoint>)>>);

    impl PeerWatch for Callers {
        fn peers(&self) -> Vec<DiscoveredEndpoint> {
            self.0.lock().1.clone()
        }

        fn changes(&self) -> u64 {
            self.0.lock().0
        }
    }

    fn caller(mapping: ServiceMapping) -> DiscoveredEndpoint {
        DiscoveredEndpoint {
            is_publisher: true,
            topic: String::new(),
            dds_topic: "rq/sRequest".to_owned(),
            type_name: String::new(),
            dds_type: String::new(),
            type_hash: None,
            gid: [0; 16],
            qos: Qos::default().into(),
            is_own: false,
            mark: None,
            service_mapping: Some(mapping),
        }
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
        let (cyclone, on_cyclone) = stack(
            Peers::Half,
            vec![
                // Its writer is gone already.
                request(of_cyclone, 10, None),
                request(writer, 1, Some((writer, 1))),
            ],
        );
        let none = GraphError::stack("taking", "/s", &"nothing");
        let (fast_dds, on_fast_dds) = stack(
            Peers::None,
            vec![
                Err(none.clone()),
                Err(none.clone()),
                request(of_cyclone, 9, Some((of_cyclone, 1))),
                request(of_cyclone, 10, Some((of_cyclone, 2))),
                request(reader, 1, Some((writer, 1))),
                request(reader, 2, Some((writer, 2))),
            ],
        );
        let there = Arc::new(Mutex::new((1, Vec::new())));
        let cyclone = Mutex::new(Some(cyclone));
        let open = move || Ok(cyclone.lock().take().unwrap() as Box<dyn CdrServer>);
        let callers = Box::new(Callers(Arc::clone(&there)));
        let waiting = Waiting::new(Box::new(open), callers, Box::new(()));
        let mut server = Server::new(waiting, fast_dds);
        assert_eq!(server.take(), Err(none.clone()), "no client, no server on CycloneDDS");
        *there.lock() = (2, vec![caller(ServiceMapping::FastDds)]);
        assert_eq!(server.take(), Err(none));
        assert_eq!(server.clients(), Peers::None);
        *there.lock() = (3, vec![caller(ServiceMapping::FastDds), caller(ServiceMapping::Cyclone)]);
        let mut taken = Vec::new();
        while let Some(request) = server.take().unwrap() {
            server.reply(&request.id, &[]).unwrap();
            taken.push((request.id.client, request.id.sequence));
        }
        assert_eq!(taken, [(of_cyclone, 10), (writer, 1), (of_cyclone, 9), (reader, 2)]);
        assert_eq!((&**on_cyclone.lock(), &**on_fast_dds.lock()), (&[10, 9][..], &[1, 2][..]));
    }
}
