//! The endpoints of one method, open for one mode.
//!
//! ```text
//!   Session ─ Channel (one for each returned value) ─ outlet   publish, transceive, reemit
//!                                                   ─ inlet    listen, receive, transceive, reemit
//!                                                   ─ client, server   request, reply
//!                                                   ─ nothing: its middleware is absent
//! ```

use std::sync::{Arc, Weak};
use std::time::Duration;

use super::client::ClientEnd;
use super::context::Live;
use super::error::CallError;
use super::inlet::Inlet;
use super::outlet::Outlet;
use super::payload::{Payload, PayloadError};
use super::server::ServerEnd;
use super::wait::{Patience, Stop};
use crate::endpoint::{CountersSnapshot, EndpointAddress, Link};
use crate::types;

/// The endpoints of one method; made by the library, used by what `#[communicator]` writes.
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
    pub(super) outlet: Option<Arc<Outlet>>,
    pub(super) inlet: Option<Inlet>,
    pub(super) client: Option<ClientEnd>,
    pub(super) server: Option<Arc<ServerEnd>>,
    /// Where it would be, for status.
    pub(super) absent: Option<String>,
}

impl std::fmt::Debug for Channel {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_list().entries(self.ends().map(|(endpoint, ..)| endpoint)).finish()
    }
}

/// Messages taken for one call, by place of the value.
#[derive(Debug, Default)]
pub struct Gathered(pub(super) Vec<Option<types::Payload>>);

/// One end of a value, for status tables.
#[derive(Debug, Clone)]
pub struct EndStatus {
    /// Where it is.
    pub endpoint: EndpointAddress,
    /// What it is connected to.
    pub link: Link,
    /// What went through it and what was dropped.
    pub counters: CountersSnapshot,
}

/// What one returned value is connected to.
#[derive(Debug, Clone, Default)]
pub struct ValueStatus {
    /// Its ends: none before the first call, two in `transceive` and `reemit`.
    pub ends: Vec<EndStatus>,
    /// Name of the middleware that is not here, where that is why there are none.
    pub absent: Option<String>,
}

impl Channel {
    fn ends(&self) -> impl Iterator<Item = (&EndpointAddress, Link, CountersSnapshot)> {
        let outlet =
            self.outlet.iter().map(|end| (&end.endpoint, end.link(), end.counters.snapshot()));
        let inlet =
            self.inlet.iter().map(|end| (&end.endpoint, end.link(), end.counters.snapshot()));
        let client = self.client.iter().map(ClientEnd::status);
        let server = self.server.iter().map(|server| server.status());
        outlet.chain(inlet).chain(client).chain(server)
    }

    pub(super) fn status(&self) -> ValueStatus {
        let ends = self.ends().map(|(endpoint, link, counters)| EndStatus {
            endpoint: endpoint.clone(),
            link,
            counters,
        });
        ValueStatus { ends: ends.collect(), absent: self.absent.clone() }
    }
}

impl Session {
    /// The next message of every value; waits where a value is to be waited for.
    ///
    /// # Errors
    /// When a wait ends without a message. What other values had is kept for the next call.
    pub fn gather(&self) -> Result<Gathered, CallError> {
        let mut kept = Kept { session: self, gathered: self.nothing() };
        // Those that are waited for first: the others are looked at when they are freshest.
        for waits in [true, false] {
            for (index, inlet) in self.inlets().filter(|(_, inlet)| inlet.should_wait == waits) {
                let payload = inlet.take(&mut self.patience(inlet.timeout))?;
                kept.gathered.set(index, payload);
            }
        }
        Ok(std::mem::take(&mut kept.gathered))
    }

    /// The same for a task.
    ///
    /// # Errors
    /// As [`Session::gather`].
    pub async fn gather_async(&self) -> Result<Gathered, CallError> {
        let Some(live) = self.live.upgrade() else { return self.gather() };
        // Kept also where the task is dropped while it waits.
        let mut kept = Kept { session: self, gathered: self.nothing() };
        for waits in [true, false] {
            for (index, inlet) in self.inlets().filter(|(_, inlet)| inlet.should_wait == waits) {
                let mut patience = self.patience(inlet.timeout);
                let payload = inlet.take_async(&mut patience, live.runtime()).await?;
                kept.gathered.set(index, payload);
            }
        }
        Ok(std::mem::take(&mut kept.gathered))
    }

    /// The value at `index` of what was gathered.
    ///
    /// # Errors
    /// When the message is not of this type, or not as an option says.
    pub fn taken<K, R: Payload<K>>(
        &self,
        gathered: &mut Gathered,
        index: usize,
    ) -> Result<Option<R>, CallError> {
        let Some(payload) = gathered.0.get_mut(index).and_then(Option::take) else {
            return Ok(None);
        };
        let Some(channel) = self.channels.get(index) else { return Ok(None) };
        let wrong = |source: PayloadError| CallError::WrongType {
            method: self.method.clone(),
            endpoint: channel.ends().next().map(|(end, ..)| end.to_string()).unwrap_or_default(),
            source: Box::new(source),
        };
        let rules = channel.inlet.as_ref().map(|inlet| &inlet.rules);
        let rules = rules.or(channel.client.as_ref().map(|client| &client.rules));
        if let Some(rules) = rules {
            rules.check(&payload).map_err(wrong)?;
        }
        R::from_payload(payload).map(Some).map_err(wrong)
    }

    /// Waits for the first listener of every value that wants one.
    ///
    /// # Errors
    /// When a wait ends without one.
    pub fn await_listeners(&self) -> Result<(), CallError> {
        for outlet in self.outlets().filter(|outlet| !outlet.is_established()) {
            outlet.await_listener(&mut self.patience(outlet.timeout))?;
        }
        Ok(())
    }

    /// The same for a task.
    ///
    /// # Errors
    /// As [`Session::await_listeners`].
    pub async fn await_listeners_async(&self) -> Result<(), CallError> {
        for outlet in self.outlets().filter(|outlet| !outlet.is_established()) {
            let Some(live) = self.live.upgrade() else { return self.await_listeners() };
            let mut patience = self.patience(outlet.timeout);
            outlet.await_listener_async(&mut patience, live.runtime()).await?;
        }
        Ok(())
    }

    /// Publishes the value at `index`, if anybody listens.
    ///
    /// # Errors
    /// When it has no form as a message, or is not as an option says.
    pub fn send<K, R: Payload<K>>(&self, index: usize, value: &R) -> Result<(), CallError> {
        let Some((outlet, payload)) = self.outgoing(index, value)? else { return Ok(()) };
        self.published(outlet, outlet.send(&payload))
    }

    /// The same for a task: a transport that makes its sender wait stops the library's thread, and
    /// no executor's.
    ///
    /// # Errors
    /// As [`Session::send`].
    pub async fn send_async<K, R: Payload<K>>(
        &self,
        index: usize,
        value: &R,
    ) -> Result<(), CallError> {
        let Some((outlet, payload)) = self.outgoing(index, value)? else { return Ok(()) };
        let Some(live) = self.live.upgrade() else {
            return self.published(outlet, outlet.send(&payload));
        };
        let (asked, answer) = super::answer::answer();
        let sender = Arc::clone(outlet);
        live.runtime().submit(move || asked.give(sender.send(&payload)));
        drop(live);
        match answer.await {
            Some(result) => self.published(outlet, result),
            None => Ok(()),
        }
    }

    fn outgoing<K, R: Payload<K>>(
        &self,
        index: usize,
        value: &R,
    ) -> Result<Option<(&Arc<Outlet>, types::Payload)>, CallError> {
        let outlet = self.channels.get(index).and_then(|channel| channel.outlet.as_ref());
        let Some(outlet) = outlet else { return Ok(None) };
        if outlet.is_idle() {
            outlet.skip();
            return Ok(None);
        }
        let unfit = |source| CallError::Send {
            method: self.method.clone(),
            endpoint: outlet.endpoint.to_string(),
            source: Box::new(source),
        };
        let Some(mut payload) = value.to_payload().map_err(unfit)? else { return Ok(None) };
        if outlet.in_ros
            && let types::Payload::NativeObject(object) = &mut payload
        {
            object.stamp = types::Stamp::now();
        }
        let payload = outlet.rules.apply(payload).map_err(unfit)?;
        Ok(Some((outlet, payload)))
    }

    fn published(
        &self,
        outlet: &Outlet,
        result: Result<(), crate::endpoint::PublishError>,
    ) -> Result<(), CallError> {
        result.map_err(|source| CallError::Publish {
            method: self.method.clone(),
            endpoint: outlet.endpoint.to_string(),
            source: Box::new(source),
        })
    }

    /// Ends every wait, now and later.
    pub(super) fn end(&self) {
        self.stop.end();
        self.ring();
    }

    /// Ends every wait of now.
    pub(super) fn cancel(&self) {
        self.stop.cancel();
        self.ring();
    }

    fn ring(&self) {
        self.outlets().for_each(|outlet| outlet.ring());
        self.inlets().for_each(|(_, inlet)| inlet.ring());
        for channel in &self.channels {
            channel.client.iter().for_each(ClientEnd::ring);
            channel.server.iter().for_each(|server| server.ring());
        }
    }

    pub(super) fn nothing(&self) -> Gathered {
        Gathered(self.channels.iter().map(|_| None).collect())
    }

    pub(super) fn patience(&self, timeout: Option<Duration>) -> Patience<'_> {
        Patience::new(&self.method, &self.stop, timeout)
    }

    fn outlets(&self) -> impl Iterator<Item = &Arc<Outlet>> {
        self.channels.iter().filter_map(|channel| channel.outlet.as_ref())
    }

    fn inlets(&self) -> impl Iterator<Item = (usize, &Inlet)> {
        self.channels
            .iter()
            .enumerate()
            .filter_map(|(index, channel)| Some((index, channel.inlet.as_ref()?)))
    }
}

/// Messages that go back to their inlets unless they are taken out.
struct Kept<'a> {
    session: &'a Session,
    gathered: Gathered,
}

impl Drop for Kept<'_> {
    fn drop(&mut self) {
        for (channel, payload) in self.session.channels.iter().zip(self.gathered.0.drain(..)) {
            if let (Some(inlet), Some(payload)) = (&channel.inlet, payload) {
                inlet.put_back(payload);
            }
        }
    }
}

impl Gathered {
    pub(super) fn set(&mut self, index: usize, payload: Option<types::Payload>) {
        if let Some(place) = self.0.get_mut(index) {
            *place = payload;
        }
    }
}
