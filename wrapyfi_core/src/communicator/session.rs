//! The endpoints of one method, open for one mode.
//!
//! ```text
//!   Session ─ Channel (one for each returned value) ─ publisher       publish, transceive, reemit
//!                                                   ─ listener        listen, receive, transceive, reemit
//!                                                   ─ client, server  request, reply
//!                                                   ─ nothing: its middleware is absent
//! ```

use std::sync::{Arc, Weak};
use std::time::Duration;

use super::client::ClientEnd;
use super::context::Live;
use super::end::{EndCommon, EndStatus};
use super::error::MethodError;
use super::listener::ListenerEnd;
use super::oneshot;
use super::publisher::PublisherEnd;
use super::server::ServerEnd;
use super::wait::{Stop, Wait};
use wrapyfi_data::returned::{PayloadError, Returned};
use wrapyfi_data::types;
use wrapyfi_endpoint::EndpointAddress;

/// The endpoints of one method; made by the library, used by the code that `#[communicator]`
/// writes. Functions that may wait are told whether a task waits: else they block the thread, and
/// are ready [at once](super::at_once).
#[derive(Debug)]
pub struct Session {
    pub(super) method: String,
    pub(super) channels: Vec<Channel>,
    pub(super) stop: Stop,
    pub(super) live: Weak<Live>,
}

/// The endpoints of one value; all `None` where its middleware is absent.
#[derive(Default)]
pub(super) struct Channel {
    pub(super) publisher: Option<Arc<PublisherEnd>>,
    pub(super) listener: Option<ListenerEnd>,
    pub(super) client: Option<ClientEnd>,
    pub(super) server: Option<Arc<ServerEnd>>,
    /// Middleware that is not here, where the value has no endpoints for that reason, and why it is not.
    pub(super) absent: Option<(String, String)>,
}

impl std::fmt::Debug for Channel {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_list().entries(self.ends().map(|end| &end.endpoint)).finish()
    }
}

/// Messages taken for one call, by place of the value.
#[derive(Debug, Default)]
pub struct GatheredMessages(pub(super) Vec<Option<types::Payload>>);

/// Status of the endpoints of one returned value.
///
/// ```
/// use std::sync::Arc;
/// use wrapyfi_core::communicator::{CommunicatorContext, Mode, communicator};
/// use wrapyfi_core::middleware::memory::Memory;
///
/// struct Mirror;
/// #[communicator]
/// impl Mirror {
///     #[register(NativeObject, "memory", "/msg", should_wait = false)]
///     fn read(&self) -> String { "hello".to_owned() }
/// }
///
/// # let context = CommunicatorContext::builder().only(Arc::new(Memory::new("memory"))).build();
/// let mut mirror = Mirror.communicator_in(&context);
/// mirror.activate(MirrorMethod::Read, Mode::Listen)?;
/// assert_eq!(mirror.read()?, None); // opens the listener; nothing was said yet
/// let status = mirror.status(MirrorMethod::Read);
/// let end = &status[0].ends[0];
/// assert_eq!((end.endpoint.to_string().as_str(), end.link.peers), ("memory:/msg", Some(0)));
/// assert_eq!(end.counters.received, 0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Default)]
pub struct ValueStatus {
    /// Endpoints of the value: none before the first call, two in `transceive` and `reemit`.
    pub ends: Vec<EndStatus>,
    /// Name of the middleware that is not here, where the value has no endpoints for that reason.
    pub absent: Option<String>,
}

impl Channel {
    fn ends(&self) -> impl Iterator<Item = &EndCommon> {
        let Self { publisher, listener, client, server, .. } = self;
        let publisher = publisher.iter().map(|end| &end.common);
        let listener = listener.iter().map(|end| &end.common);
        let client = client.iter().map(|end| &end.common);
        publisher.chain(listener).chain(client).chain(server.iter().map(|end| &end.common))
    }

    pub(super) fn status(&self) -> ValueStatus {
        let Self { publisher, listener, client, server, absent } = self;
        let publisher = publisher.iter().map(|end| end.link());
        let links = publisher.chain(listener.iter().map(ListenerEnd::link));
        let links = links.chain(client.iter().map(ClientEnd::link));
        let links = links.chain(server.iter().map(|end| end.link()));
        let ends = self.ends().zip(links).map(|(end, link)| end.status(link)).collect();
        ValueStatus { ends, absent: absent.as_ref().map(|(name, _)| name.clone()) }
    }
}

impl Session {
    /// Takes the next message of every value; waits for values with the option `should_wait`.
    ///
    /// # Errors
    /// When a wait ends without a message. Messages of other values are kept for the next call.
    pub async fn gather(&self, in_task: bool) -> Result<GatheredMessages, MethodError> {
        let live = self.live(in_task);
        let runtime = live.as_deref().map(Live::runtime);
        // The guard also works where the task is dropped while it waits.
        let mut guard = GatherGuard { session: self, gathered: self.nothing() };
        // Values that are waited for come first, so that the others are taken when they are newest.
        for waits in [true, false] {
            for (index, listener) in
                self.listeners().filter(|(_, it)| it.common.should_wait == waits)
            {
                let mut wait = self.begin_wait(listener.common.timeout);
                let payload = listener.take(&mut wait, runtime).await?;
                guard.gathered.set(index, payload);
            }
        }
        Ok(std::mem::take(&mut guard.gathered))
    }

    /// Converts the gathered message at `index` to the returned type.
    ///
    /// # Errors
    /// When the message is not of this type, or not as an option says.
    pub fn taken<K, R: Returned<K>>(
        &self,
        gathered: &mut GatheredMessages,
        index: usize,
    ) -> Result<Option<R>, MethodError> {
        let Some(payload) = gathered.0.get_mut(index).and_then(Option::take) else {
            return Ok(None);
        };
        let Some(channel) = self.channels.get(index) else { return Ok(None) };
        let wrong = |source: PayloadError| MethodError::WrongType {
            method: self.method.clone(),
            endpoint: channel.ends().next().map(|end| end.endpoint.to_string()).unwrap_or_default(),
            source: Box::new(source),
        };
        let listener = channel.listener.as_ref().map(|listener| &listener.common);
        if let Some(end) = listener.or(channel.client.as_ref().map(|client| &client.common)) {
            end.rules.check(&payload).map_err(wrong)?;
        }
        let field = channel.client.as_ref().and_then(|client| client.only_field(&payload));
        let found = R::from_payload(payload);
        found.or_else(|error| field.map_or(Err(error), R::from_payload)).map(Some).map_err(wrong)
    }

    /// Waits for the first listener of every value with the option `should_wait`.
    ///
    /// # Errors
    /// When a wait ends without a listener.
    pub async fn await_listeners(&self, in_task: bool) -> Result<(), MethodError> {
        let live = self.live(in_task);
        let runtime = live.as_deref().map(Live::runtime);
        for publisher in self.publishers().filter(|publisher| !publisher.is_established()) {
            publisher
                .await_listener(&mut self.begin_wait(publisher.common.timeout), runtime)
                .await?;
        }
        Ok(())
    }

    /// Publishes the value at `index`, if a program listens. A transport that makes its sender wait
    /// stops the library's thread where a task sends, and no executor's.
    ///
    /// # Errors
    /// When the value cannot be encoded, or an option forbids it.
    pub async fn send<K, R: Returned<K>>(
        &self,
        in_task: bool,
        index: usize,
        value: &R,
    ) -> Result<(), MethodError> {
        let Some((publisher, payload)) = self.outgoing(index, value)? else { return Ok(()) };
        let Some(live) = self.live(in_task) else {
            return self.published(publisher, publisher.send(&payload));
        };
        let (result, sent) = oneshot::channel();
        let end = Arc::clone(publisher);
        live.runtime().submit(move || result.send(end.send(&payload)));
        drop(live);
        match sent.await {
            Some(result) => self.published(publisher, result),
            None => Ok(()),
        }
    }

    /// Reason that the middleware of the value at `index` is not here, where the value has no endpoints for that reason.
    pub fn absent(&self, index: usize) -> Option<&str> {
        self.channels.get(index)?.absent.as_ref().map(|(_, why)| &**why)
    }

    /// True where no program hears the value at `index`, which then counts as not sent.
    pub fn skips(&self, index: usize) -> bool {
        let publisher = self.channels.get(index).and_then(|channel| channel.publisher.as_ref());
        publisher.is_none_or(|publisher| {
            let is_idle = publisher.is_idle();
            if is_idle {
                publisher.skip();
            }
            is_idle
        })
    }

    fn outgoing<K, R: Returned<K>>(
        &self,
        index: usize,
        value: &R,
    ) -> Result<Option<(&Arc<PublisherEnd>, types::Payload)>, MethodError> {
        let publisher = self.channels.get(index).and_then(|channel| channel.publisher.as_ref());
        let Some(publisher) = publisher else { return Ok(None) };
        if self.skips(index) {
            return Ok(None);
        }
        let unfit = |source| self.unfit(&publisher.common.endpoint, source);
        let Some(mut payload) = value.to_payload().map_err(unfit)? else { return Ok(None) };
        if publisher.in_ros
            && let types::Payload::NativeObject(object) = &mut payload
        {
            object.stamp = types::Stamp::now();
        }
        let payload = publisher.common.rules.apply(payload).map_err(unfit)?;
        let converted = publisher.conversion.convert(payload, types::Stamp::now);
        Ok(Some((publisher, converted.map_err(|error| unfit(error.into()))?)))
    }

    /// Error for a value that has no form on the wire of `endpoint`.
    pub(super) fn unfit(&self, endpoint: &EndpointAddress, source: PayloadError) -> MethodError {
        let (method, endpoint) = (self.method.clone(), endpoint.to_string());
        MethodError::Send { method, endpoint, source: Box::new(source) }
    }

    fn published(
        &self,
        publisher: &PublisherEnd,
        result: Result<(), wrapyfi_endpoint::PublishError>,
    ) -> Result<(), MethodError> {
        result.map_err(|source| MethodError::Publish {
            method: self.method.clone(),
            endpoint: publisher.common.endpoint.to_string(),
            source: Box::new(source),
        })
    }

    /// Timer of a task; a thread that blocks needs nothing.
    pub(super) fn live(&self, in_task: bool) -> Option<Arc<Live>> {
        if in_task { self.live.upgrade() } else { None }
    }

    /// Ends every wait, now and later.
    pub(super) fn end(&self) {
        self.stop.end();
        self.ring();
    }

    /// Ends the waits that have begun.
    pub(super) fn cancel(&self) {
        self.stop.cancel();
        self.ring();
    }

    /// Makes all waiting calls look again.
    fn ring(&self) {
        let ends = self.channels.iter().flat_map(Channel::ends);
        ends.for_each(|end| end.notifier.ring());
    }

    pub(super) fn nothing(&self) -> GatheredMessages {
        GatheredMessages(self.channels.iter().map(|_| None).collect())
    }

    pub(super) fn begin_wait(&self, timeout: Option<Duration>) -> Wait<'_> {
        Wait::new(&self.method, &self.stop, timeout)
    }

    fn publishers(&self) -> impl Iterator<Item = &Arc<PublisherEnd>> {
        self.channels.iter().filter_map(|channel| channel.publisher.as_ref())
    }

    fn listeners(&self) -> impl Iterator<Item = (usize, &ListenerEnd)> {
        let channels = self.channels.iter().enumerate();
        channels.filter_map(|(index, channel)| Some((index, channel.listener.as_ref()?)))
    }
}

/// Messages gathered for a call, which go back to their listeners when a wait ends without a message.
struct GatherGuard<'a> {
    session: &'a Session,
    gathered: GatheredMessages,
}

impl Drop for GatherGuard<'_> {
    fn drop(&mut self) {
        for (channel, payload) in self.session.channels.iter().zip(self.gathered.0.drain(..)) {
            if let (Some(listener), Some(payload)) = (&channel.listener, payload) {
                listener.put_back(payload);
            }
        }
    }
}

impl GatheredMessages {
    pub(super) fn set(&mut self, index: usize, payload: Option<types::Payload>) {
        if let Some(place) = self.0.get_mut(index) {
            *place = payload;
        }
    }
}
