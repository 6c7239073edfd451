//! A topic received: opens the socket, hands it to the I/O thread, decodes what arrives.

use std::sync::Arc;
use std::task::{Wake, Waker};

use super::codec;
use super::io::{Command, Handle};
use super::link::{self, BrokerLink, Watch};
use super::own_messages::Listening;
use super::reception::{Arrival, Reception};
use super::shared::ZeroMqState;
use super::traffic::DENIED;
use super::zmtp::Kind;
use super::{contexts, options};
use wrapyfi_endpoint::{
    Context, Link, Listener, OpenResult, Overflow, QueueSpec, Receiver, Sample, TakeError,
    TopicSpec, inbox,
};

/// Receives one topic through the broker.
pub(super) struct ZeroMqListener {
    id: u64,
    spec: TopicSpec,
    inbox: Receiver<Arrival>,
    link: Arc<BrokerLink>,
    io: Arc<Handle>,
}

/// Messages libzmq holds for one listener at most.
const SOCKET_DEPTH: usize = 1000;

/// Messages libzmq may hold for this listener. Under policy `block` they add to a full inbox, so
/// there it is no more than the inbox holds; under the others the socket is emptied at once.
fn socket_depth(queue: QueueSpec) -> i32 {
    let depth = match queue.overflow {
        Overflow::Block(_) => queue.depth.clamp(1, SOCKET_DEPTH),
        _ => SOCKET_DEPTH,
    };
    i32::try_from(depth).unwrap_or(i32::MAX)
}

impl ZeroMqListener {
    pub(super) fn open(
        shared: &ZeroMqState,
        spec: &TopicSpec,
        context: &Context,
    ) -> OpenResult<Self> {
        let link = shared.link(&shared.pub_endpoint, &spec.topic);
        let (socket, watch) = shared
            .contexts
            .open(|context| open_socket(context, shared, spec, &link))
            .map_err(|error| contexts::refused(&spec.topic, error))?;
        let id = shared.io.handle.next_id();
        let (sender, receiver) = inbox(spec.queue, context);
        let io = Arc::clone(&shared.io.handle);
        let reception = Reception {
            socket,
            watch,
            topic: spec.topic.as_bytes().to_vec(),
            limit: spec.limits.message_bytes,
            inbox: sender,
            listening: Listening::new(shared.own_messages.of(&spec.topic)),
            room: Waker::from(Arc::new(LookWaker(id, Arc::clone(&io)))),
            held: None,
            is_closed: false,
        };
        io.send(Command::Open(id, Box::new(reception)));
        shared.ledger.enter(Kind::Xsub, &spec.topic, &context.counters);
        Ok(Self { id, spec: spec.clone(), inbox: receiver, link, io })
    }
}

fn open_socket(
    context: &zmq::Context,
    shared: &ZeroMqState,
    spec: &TopicSpec,
    link: &Arc<BrokerLink>,
) -> zmq::Result<(zmq::Socket, Watch)> {
    let socket = context.socket(zmq::SUB)?;
    options::set_common(&socket, shared.ip)?;
    socket.set_rcvhwm(socket_depth(spec.queue))?;
    // What a broker of ours passes on never cuts the connection, however small the limit of this topic: messages are
    // lost uncounted until it is made anew.
    options::set_message_limit(&socket, spec.limits.message_bytes.max(shared.max_frame_bytes))?;
    socket.set_subscribe(spec.topic.as_bytes())?;
    if shared.keys.is_some() {
        socket.set_subscribe(format!("{DENIED}{}", spec.topic).as_bytes())?;
    }
    link::connect(context, socket, link, shared.keys.as_ref())
}

/// Has the I/O thread look at an endpoint.
struct LookWaker(u64, Arc<Handle>);

impl Wake for LookWaker {
    fn wake(self: Arc<Self>) {
        self.1.send(Command::Look(self.0));
    }
}

impl Listener for ZeroMqListener {
    fn take(&mut self) -> Result<Option<Sample>, TakeError> {
        let Some(arrival) = self.inbox.pop() else { return Ok(None) };
        let payload = codec::decode(&arrival.frames, &self.spec, arrival.stamp)?;
        let Arrival { wire_bytes, received_at, .. } = arrival;
        Ok(Some(Sample { payload, wire_bytes, received_at, origin: None }))
    }

    fn discard(&mut self) -> bool {
        self.inbox.pop().is_some()
    }

    fn link(&self) -> Link {
        // A broker does not tell listeners who publishes.
        Link { peers: None, waiting_for: self.link.waiting_for(), keeps_last: false }
    }
}

impl Drop for ZeroMqListener {
    fn drop(&mut self) {
        self.io.send(Command::Close(self.id));
    }
}
