//! Clients of the Fast DDS mapping.
//!
//! ```text
//!   Client ─ send ─┐                 request, { reply reader, unknown } ─▶ rq/…      its number n
//!   Client ─ send ─┴─ Endpoints ───  n ─▶ whose
//!   Client ◀─ take ─┬─ its queue ◀── reply { reply reader, n } ── rr/…               others' replies are passed over
//!   Client ◀─ take ─┘
//! ```
//!
//! The clients of one service in a node share a writer and a reader. RustDDS's readers of one topic share one mark up
//! to which a writer was heard: where each client had its own, a reply that came just when another joined was lost.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use super::adapter::Received;
use super::end::ReopenedEndpoints;
use super::outgoing::Identity;
use super::participant::{ServicesState, Topics};
use super::{identity, remotes};
use crate::discovery_info::Gid;
use crate::graph::{CdrClient, CdrReply, GraphError, GraphResult, Notify, Peers, RequestId};
use wrapyfi_endpoint::Mutex;

/// Requests whose clients are remembered; the oldest were given up long ago.
const MAX_SENT: usize = 4096;

/// Clients that are told of news, by their numbers.
type Notifiers = Mutex<BTreeMap<u64, Notify>>;

/// Endpoints that the clients of one service have in common.
pub(super) struct Endpoints {
    notifiers: Arc<Notifiers>,
    state: Mutex<ClientState>,
}

struct ClientState {
    end: ReopenedEndpoints,
    /// GUIDs by which servers name the clients: the reader that their requests carry, or their writer
    /// where a request carries none.
    names: [Gid; 2],
    /// Number of the last request, and of the last one of the endpoints before: those that follow count from 1 again.
    last: i64,
    before: i64,
    /// Clients by the numbers of their requests that have no reply.
    sent: BTreeMap<i64, u64>,
    /// Replies that another client has taken, for each client.
    waiting: BTreeMap<u64, VecDeque<GraphResult<CdrReply>>>,
}

impl Endpoints {
    /// Creates the endpoints and announces them.
    pub(super) fn open(shared: &Arc<ServicesState>, topics: Topics) -> GraphResult<Self> {
        let notifiers = Arc::<Notifiers>::default();
        let all = Arc::clone(&notifiers);
        let ring: Notify = Arc::new(move || {
            let notifiers: Vec<Notify> = all.lock().values().cloned().collect();
            notifiers.iter().for_each(|notify| notify());
        });
        let end = ReopenedEndpoints::open(shared, "creating a client", topics, ring)?;
        let (sent, waiting) = (BTreeMap::new(), BTreeMap::new());
        let state = ClientState { names: names(&end), end, last: 0, before: 0, sent, waiting };
        Ok(Self { notifiers, state: Mutex::new(state) })
    }
}

impl ClientState {
    fn renew(&mut self) -> GraphResult<()> {
        if self.end.renew()? {
            (self.names, self.before) = (names(&self.end), self.last);
        }
        Ok(())
    }

    /// The next reply to any of the clients, with the number of the request.
    fn take(&mut self) -> GraphResult<Option<(i64, GraphResult<CdrReply>)>> {
        self.renew()?;
        let pair = self.end.pair();
        while let Some(taken) = pair.take()? {
            let source_timestamp_ns = taken.source_timestamp_ns;
            let size = match &taken.received {
                Received::Message(cdr) => cdr.len(),
                Received::TooLarge(actual) => *actual,
            };
            let Some((client, sequence)) = identity::reply_to(taken.related) else {
                // A server of Cyclone's answers its own clients.
                if remotes::is_cyclone(&taken.writer) {
                    continue;
                }
                return Err(GraphError::NoIdentity {
                    what: "reply",
                    service: pair.service.clone(),
                    actual: size,
                    least: identity::BYTES,
                });
            };
            if !self.names.contains(&client) {
                continue;
            }
            let sequence = self.before.saturating_add(sequence);
            let reply = match taken.received {
                Received::Message(cdr) => Ok(CdrReply { sequence, cdr, source_timestamp_ns }),
                Received::TooLarge(actual) => Err(GraphError::TooLarge {
                    topic: pair.service.clone(),
                    actual,
                    limit: pair.max_bytes,
                }),
            };
            return Ok(Some((sequence, reply)));
        }
        Ok(None)
    }
}

fn names(end: &ReopenedEndpoints) -> [Gid; 2] {
    [end.pair().reader_guid().to_bytes(), end.pair().writer_guid().to_bytes()]
}

/// Sends requests, takes replies.
pub(super) struct Client {
    endpoints: Arc<Endpoints>,
    number: u64,
}

impl Client {
    /// One more client of a service; `on_event` is called when replies or matches change.
    pub(super) fn new(endpoints: Arc<Endpoints>, on_event: Notify) -> Self {
        let mut notifiers = endpoints.notifiers.lock();
        let number = notifiers.last_key_value().map_or(0, |(last, _)| last + 1);
        notifiers.insert(number, on_event);
        drop(notifiers);
        Self { endpoints, number }
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        let mut state = self.endpoints.state.lock();
        state.sent.retain(|_, client| *client != self.number);
        state.waiting.remove(&self.number);
        drop(state);
        self.endpoints.notifiers.lock().remove(&self.number);
    }
}

impl CdrClient for Client {
    fn send(&mut self, parts: &[&[u8]]) -> Result<i64, GraphError> {
        let mut state = self.endpoints.state.lock();
        state.renew()?;
        let pair = state.end.pair();
        let number =
            pair.write(parts, Identity::IfWhole(identity::of_request(pair.reader_guid())))?;
        state.last = state.before.saturating_add(number);
        if state.sent.len() >= MAX_SENT {
            state.sent.pop_first();
        }
        let last = state.last;
        state.sent.insert(last, self.number);
        Ok(last)
    }

    fn take(&mut self) -> Result<Option<CdrReply>, GraphError> {
        let mut state = self.endpoints.state.lock();
        if let Some(reply) = state.waiting.get_mut(&self.number).and_then(VecDeque::pop_front) {
            return reply.map(Some);
        }
        while let Some((sequence, reply)) = state.take()? {
            // All clients are told of each reply: the one that it is for looks into its queue.
            match state.sent.remove(&sequence) {
                Some(client) if client == self.number => return reply.map(Some),
                Some(client) => state.waiting.entry(client).or_default().push_back(reply),
                None => {}
            }
        }
        Ok(None)
    }

    fn id_of(&self, sequence: i64) -> RequestId {
        let state = self.endpoints.state.lock();
        let [client, _] = state.names;
        RequestId { client, sequence: sequence.saturating_sub(state.before) }
    }

    fn servers(&self) -> Peers {
        self.endpoints.state.lock().end.pair().remotes.lock().peers()
    }
}
