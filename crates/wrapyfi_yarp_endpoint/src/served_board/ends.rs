//! The two ends of a served board: states go in, movements come out.

use std::sync::Arc;

use wrapyfi_data::types::{Header, MessageType, Payload, RosMessage, Stamp};
use wrapyfi_endpoint::codec::EncodeError;
use wrapyfi_endpoint::{
    Context, Counters, Link, Listener, OpenError, OpenResult, PublishError, Publisher, Receiver,
    Sample, TakeError, TopicSpec, inbox,
};

use super::super::losses::Sent;
use super::super::name::check_name;
use super::super::options::YarpOptions;
use super::super::payload;
use super::super::shared::InstanceState;
use super::requests::Carries;
use super::{Moved, PORTS, ServedBoard, ServedBoards, state};

/// Takes states of the robot for the clients of the board.
pub(in super::super) struct BoardPublisher {
    board: Arc<ServedBoard>,
    spec: TopicSpec,
    counters: Arc<Counters>,
}

/// Gives the movements that clients ask for.
pub(in super::super) struct BoardListener {
    board: Arc<ServedBoard>,
    spec: TopicSpec,
    inbox: Receiver<Moved>,
}

impl BoardPublisher {
    /// Opens the end of `spec`, whose name is the board's.
    ///
    /// # Errors
    /// The name or the type that a board cannot have.
    pub(in super::super) fn open(
        boards: &ServedBoards,
        shared: &Arc<InstanceState>,
        spec: &TopicSpec,
        options: &YarpOptions,
        context: &Context,
    ) -> OpenResult<Self> {
        check(spec, |carries| carries == Carries::All, payload::JOINTS)?;
        let board = boards.board(shared, &spec.topic, options, context);
        Ok(Self { board, spec: spec.clone(), counters: Arc::clone(&context.counters) })
    }
}

impl BoardListener {
    /// As [`BoardPublisher::open`].
    ///
    /// # Errors
    /// As [`BoardPublisher::open`].
    pub(in super::super) fn open(
        boards: &ServedBoards,
        shared: &Arc<InstanceState>,
        spec: &TopicSpec,
        options: &YarpOptions,
        context: &Context,
    ) -> OpenResult<Self> {
        let wanted = format!("{} or {}", payload::TRAJECTORY, payload::JOINTS);
        let carries = check(spec, |_| true, &wanted)?;
        let board = boards.board(shared, &spec.topic, options, context);
        let (sender, inbox) = inbox(spec.queue, context);
        *board.core.movements.lock() = Some((Arc::new(sender), carries));
        Ok(Self { board, spec: spec.clone(), inbox })
    }
}

impl Drop for BoardListener {
    fn drop(&mut self) {
        *self.board.core.movements.lock() = None;
    }
}

/// Checks name and type of an end; the quantities that its messages carry.
fn check(spec: &TopicSpec, accepts: impl Fn(Carries) -> bool, wanted: &str) -> OpenResult<Carries> {
    for end in PORTS {
        check_name(&format!("{}{end}", spec.topic))?;
    }
    let carries = match spec.message_type {
        MessageType::Ros(ros_type) => state::carries(ros_type),
        _ => None,
    };
    carries.filter(|it| accepts(*it)).ok_or_else(|| OpenError::InvalidOption {
        middleware: "yarp",
        topic: spec.topic.clone(),
        option: "board".to_owned(),
        found: format!("true for {}", spec.message_type.label()),
        wanted: format!("for {wanted}"),
    })
}

impl Publisher for BoardPublisher {
    /// A state is taken also while no client reads it: the next request is answered by it.
    fn publish(&mut self, payload: &Payload) -> Result<usize, PublishError> {
        let Payload::RosMessage(message) = payload else {
            return Err(
                EncodeError::mismatch(payload::JOINTS, payload.data_type().to_string()).into()
            );
        };
        let fields = payload::fields(message, &self.spec)?;
        let stamp = Header::of_fields(&fields).map(|header| header.stamp);
        let stamp = stamp.filter(|it| *it != Stamp::default()).unwrap_or_else(Stamp::now);
        let bytes = message.cdr.len();
        let sent = Sent::new(&self.counters, bytes);
        let core = &self.board.core;
        match core.publish(&state::joints(&fields), stamp.as_secs_f64(), &sent) {
            Ok(written) => {
                sent.queued(written.unwrap_or_default());
                Ok(bytes)
            }
            Err(why) => {
                Err(EncodeError::mismatch(format!("states of the joints of {}", core.name), why)
                    .into())
            }
        }
    }

    fn link(&self) -> Link {
        // One reader at least, the board itself, so that states come before the first client.
        let link = self.board.core.link_state.link();
        Link { peers: Some(link.peers.unwrap_or(0).max(1)), ..link }
    }
}

impl Listener for BoardListener {
    fn take(&mut self) -> Result<Option<Sample>, TakeError> {
        let Some(Moved { movement, names, received_at, bytes }) = self.inbox.pop() else {
            return Ok(None);
        };
        let MessageType::Ros(ros_type) = self.spec.message_type else { return Ok(None) };
        let place = (Stamp::now(), self.board.core.options.frame_id.as_str());
        let limit = self.spec.limits.message_bytes;
        let message: RosMessage = state::message(&movement, &names, ros_type, place, limit)?;
        let payload = Payload::RosMessage(message);
        Ok(Some(Sample { payload, wire_bytes: bytes, received_at, origin: None }))
    }

    fn discard(&mut self) -> bool {
        self.inbox.pop().is_some()
    }

    fn link(&self) -> Link {
        self.board.core.link_state.link()
    }
}
