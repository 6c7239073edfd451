//! A topic received: an input port of ours, connected to the port that has the topic's name.
//!
//! ```text
//!   /cam ══▶ /cam:in7 ── size? ── ours? ──▶ inbox ──▶ Listener::take ── payload::decode
//!                         │ oversize │ own_publication     each connection's task; block: it waits
//! ```

use std::sync::Arc;
use std::time::Instant;

use wrapyfi_yarp::Dialect;
use wrapyfi_yarp::port::{Answer, Port, PortOptions, Received};

use super::device::Device;
use super::found_format::SenderFormats;
use super::link_state::LinkState;
use super::losses::Losses;
use super::name::check_name;
use super::opening::{numbered, until_open};
use super::options::YarpOptions;
use super::port_connection::PortConnection;
use super::shared::InstanceState;
use super::tasks::Stop;
use super::{intrinsics, name, payload};
use wrapyfi_data::types::{DataType, Stamp};
use wrapyfi_endpoint::{
    Cause, Context, DropReason, Link, Listener, Mutex, OpenResult, Receiver, Sample, Sender,
    TakeError, TopicSpec, Waits, inbox,
};

/// Receives one topic.
pub(super) struct YarpListener {
    spec: TopicSpec,
    dialect: Dialect,
    inbox: Receiver<Arrival>,
    state: Arc<ListenerState>,
    _stop: Stop,
}

/// A message as it came.
struct Arrival {
    received: Received,
    received_at: Instant,
    stamp: Stamp,
    /// Options with the format in which its sender writes native objects, where they leave it to be found.
    options: Option<Arc<YarpOptions>>,
}

impl Waits for Arrival {
    fn bytes(&self) -> usize {
        self.received.payload.bytes.len()
    }
}

/// State that the listener shares with its port.
struct ListenerState {
    /// The port that sends the topic.
    source: String,
    options: YarpOptions,
    /// True where the messages are pictures.
    pictures: bool,
    /// A port that answers nothing: its function runs on the connection's own task.
    port: Mutex<Option<Port>>,
    device: Device,
    formats: SenderFormats,
    link_state: Arc<LinkState>,
    inbox: Sender<Arrival>,
    limit: usize,
    losses: Losses,
}

impl ListenerState {
    /// Names of the ports that send.
    fn sources(&self) -> Vec<String> {
        let port = self.port.lock();
        let status = port.as_ref().map(Port::status).unwrap_or_default();
        let sources = status.into_iter().filter(|one| one.incoming && one.name.starts_with('/'));
        sources.map(|one| one.name).collect()
    }

    /// Counts what never became a message.
    fn count_losses(&self) {
        if let Some(port) = &*self.port.lock() {
            self.losses.count(port.fault_counts(), self.inbox.counters());
        }
    }

    /// Takes a message in; under policy `block` its connection waits here.
    async fn put(&self, received: Received, shared: &InstanceState) {
        let counters = self.inbox.counters();
        let bytes = received.payload.bytes.len();
        counters.received(bytes);
        if shared.own.contains(&received.from) {
            return counters.dropped(DropReason::OwnPublication);
        }
        if bytes > self.limit {
            return counters.dropped(DropReason::Oversize);
        }
        self.device.wait().await;
        let received_at = self.inbox.context().clock.now();
        let stamp = Stamp::now();
        let options = self.formats.of(shared, &received.from).await;
        let arrival = Arrival { received, received_at, stamp, options };
        self.inbox.place(arrival, self.inbox.max_wait()).await;
    }
}

impl YarpListener {
    pub(super) fn open(
        shared: &Arc<InstanceState>,
        spec: &TopicSpec,
        options: YarpOptions,
        context: &Context,
    ) -> OpenResult<Self> {
        check_name(&spec.topic)?;
        if let Some(port) = &options.port {
            check_name(port)?;
        }
        let (sender, receiver) = inbox(spec.queue, context);
        // Calibrations belong to pictures.
        let is_calibration = payload::is_of_camera(spec.message_type);
        let picture = intrinsics::picture_of(&spec.topic).filter(|_| is_calibration);
        let topic = picture.unwrap_or_else(|| spec.topic.clone());
        let waiting = Cause::peer(name::port(&topic), " to send", None, "");
        let state = Arc::new(ListenerState {
            source: topic.clone(),
            pictures: spec.message_type.data_type() == DataType::Image,
            port: Mutex::default(),
            device: Device::new(spec.message_type, &options, &topic),
            formats: SenderFormats::new(spec.message_type, &options, shared),
            link_state: Arc::new(LinkState::new(context.wake.clone(), waiting)),
            inbox: sender,
            limit: spec.limits.message_bytes,
            losses: Losses::default(),
            options,
        });
        let dialect = shared.network(&state.options).dialect();
        let kept = (Arc::clone(shared), Arc::clone(&state));
        let stop = shared.tasks.spawn(&topic, &state.link_state, kept, serve, close);
        Ok(Self { spec: spec.clone(), dialect, inbox: receiver, state, _stop: stop })
    }
}

/// Has the port open.
async fn serve((shared, state): (Arc<InstanceState>, Arc<ListenerState>)) {
    let (topic, options) = (&state.source, &state.options);
    let network = shared.network(options);
    let senders = YarpOptions::admission(options.from_peers.as_ref());
    let wanted = PortOptions { pictures: state.pictures, senders, ..PortOptions::default() };
    let port = until_open(&shared, topic, &state.link_state, || async {
        let name = options.port.clone().unwrap_or_else(|| numbered(topic));
        let (shared, state) = (Arc::clone(&shared), Arc::clone(&state));
        let take = move |received, _| {
            let (shared, state) = (Arc::clone(&shared), Arc::clone(&state));
            async move {
                state.put(received, &shared).await;
                Answer::Nothing
            }
        };
        network.serve(&name, &wanted, take).await
    })
    .await;
    let own = port.name().to_owned();
    let (connection, changes) = (PortConnection::from(topic, &own, options), port.connected());
    *state.port.lock() = Some(port);
    let counted = async {
        let mut changes = changes.clone();
        loop {
            changes.mark_unchanged();
            state.count_losses();
            let sources = state.sources();
            sources.iter().for_each(|source| shared.survey.met(source, &own, true));
            match sources.len() {
                0 => {}
                senders => state.link_state.connected(senders),
            }
            if changes.changed().await.is_err() {
                return;
            }
        }
    };
    let is_connected = || state.sources().iter().any(|source| source == connection.other());
    let say = |why: Cause| {
        // Another program may have made the connection.
        if state.sources().is_empty() {
            state.link_state.waiting(why);
        }
    };
    let has_sources = || !state.sources().is_empty();
    tokio::select! {
        () = counted => {}
        () = connection.keep(&shared, changes.clone(), &is_connected, &say) => {}
        () = state.device.follow(&shared, changes.clone(), &has_sources) => {}
    }
}

/// Closes the port that is open, if any.
async fn close((shared, state): (Arc<InstanceState>, Arc<ListenerState>)) {
    let port = state.port.lock().take();
    if let Some(port) = port {
        PortConnection::from(&state.source, port.name(), &state.options).forget(&shared).await;
        port.close().await;
    }
}

impl Listener for YarpListener {
    fn take(&mut self) -> Result<Option<Sample>, TakeError> {
        let Some(Arrival { received, received_at, stamp, options }) = self.inbox.pop() else {
            return Ok(None);
        };
        let (spec, options) = (&self.spec, options.unwrap_or_else(|| self.state.device.options()));
        let sent_at = received.stamp();
        let payload =
            payload::decode(&received.payload, sent_at, spec, &options, self.dialect, stamp)?;
        let wire_bytes = received.payload.bytes.len();
        Ok(Some(Sample { payload, wire_bytes, received_at, origin: None }))
    }

    fn discard(&mut self) -> bool {
        self.inbox.pop().is_some()
    }

    fn link(&self) -> Link {
        self.state.count_losses();
        self.state.link_state.link()
    }
}
