//! Calls a service of any type.
//!
//! ```text
//!   call ─ DynamicMessage ─▶ Plan ─ CDR ─▶ Calls ─ a server is there ─▶ CdrClient
//!   poll ◀─ Ticket, reply or why not ◀─ Plan ◀─ CDR ─────────────────── CdrClient
//! ```
//!
//! A call made before a server is found waits for it: no request is sent before both halves of the
//! match are there, because neither would be repeated.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use bytes::Bytes;
use wrapyfi_interfaces::dynamic::{DynamicMessage, Plan};

use super::error::CallError;
use super::{LOOK_AGAIN, ServiceOptions, ServiceType, encode};
use crate::endpoint::Wake;
use crate::endpoint::calls::{Calls, Stage, Ticket};
use crate::middleware::ros2::any::ringing;
use crate::middleware::ros2::graph::{CdrClient, GraphError, Peers, ServiceMapping};
use crate::middleware::ros2::{AnyError, Ros2};

/// Calls one service.
///
/// ```no_run
/// use wrapyfi_core::endpoint::Wake;
/// use wrapyfi_core::middleware::ros2::{AnyClient, Ros2, ServiceOptions, ServiceType};
/// # fn example(ros2: &Ros2, resolved: &wrapyfi_interfaces::store::ResolvedType)
/// # -> Result<(), Box<dyn std::error::Error>> {
/// let add = ServiceType::new(resolved)?; // example_interfaces/srv/AddTwoInts
/// let mut client = AnyClient::open(ros2, "add", add, &ServiceOptions::default(), &Wake::new())?;
/// let mut request = client.request();
/// request.set("a", 2_i64)?;
/// request.set("b", 3_i64)?;
/// let reply = client.call_and_wait(&request)?;
/// assert_eq!(reply.get("sum").and_then(|sum| sum.as_integer()), Some(5));
/// # Ok(())
/// # }
/// ```
pub struct AnyClient {
    cdr: Box<dyn CdrClient>,
    name: String,
    service: ServiceType,
    mapping: ServiceMapping,
    options: ServiceOptions,
    calls: Calls<Bytes>,
    done: VecDeque<(Ticket, Result<DynamicMessage, CallError>)>,
    wake: Wake,
}

impl AnyClient {
    /// A client of `name`, which is expanded and remapped as the node's names are. `wake` is rung
    /// when a reply arrives or a server comes or goes.
    ///
    /// # Errors
    /// When the name cannot be used, or DDS refuses.
    pub fn open(
        ros2: &Ros2,
        name: &str,
        service: ServiceType,
        options: &ServiceOptions,
        wake: &Wake,
    ) -> Result<Self, AnyError> {
        let description = service.describe(ros2, name, options)?;
        let cdr = ros2.graph().client(&description, ringing(wake))?;
        Ok(Self {
            cdr,
            name: description.name,
            service,
            mapping: ros2.graph().service_mapping(),
            options: options.clone(),
            calls: Calls::new(options.pending),
            done: VecDeque::new(),
            wake: wake.clone(),
        })
    }

    /// Absolute name of the service.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// A request with the default values of its definition.
    #[must_use]
    pub fn request(&self) -> DynamicMessage {
        self.service.request().default_message()
    }

    /// How requests are read and written, for instance from JSON.
    #[must_use]
    pub fn request_plan(&self) -> &Plan {
        self.service.request()
    }

    /// Servers there are now.
    #[must_use]
    pub fn servers(&self) -> Peers {
        self.cdr.servers()
    }

    /// Replies that came after their time, and were dropped, so far.
    #[must_use]
    pub fn late(&self) -> u64 {
        self.calls.late()
    }

    /// Begins a call, which [`AnyClient::poll`] will end: with its reply, or with why there is none.
    ///
    /// # Errors
    /// When the request is none of this service, or too many calls are under way.
    pub fn call(&mut self, request: &DynamicMessage) -> Result<Ticket, CallError> {
        self.call_within(request, self.options.timeout)
    }

    /// [`AnyClient::call`] with a time of its own.
    ///
    /// # Errors
    /// As [`AnyClient::call`].
    pub fn call_within(
        &mut self,
        request: &DynamicMessage,
        timeout: Duration,
    ) -> Result<Ticket, CallError> {
        let cdr = encode(self.service.request(), request).map_err(|fault| CallError::Request {
            service: self.name.clone(),
            fault: Box::new(fault),
        })?;
        let now = Instant::now();
        let ticket = self.calls.begin(cdr, now, timeout).ok_or_else(|| CallError::TooMany {
            service: self.name.clone(),
            limit: self.options.pending,
        })?;
        self.send_waiting();
        Ok(ticket)
    }

    /// Forgets a call. Its reply, if it comes, is counted as late.
    pub fn cancel(&mut self, ticket: Ticket) {
        if !self.calls.forget(ticket) {
            self.done.retain(|(done, _)| *done != ticket);
        }
    }

    /// A call that has ended, if one has. Does not wait for it; where a request is to be sent and
    /// its readers do not keep up, DDS may hold it up for half a second.
    pub fn poll(&mut self) -> Option<(Ticket, Result<DynamicMessage, CallError>)> {
        self.send_waiting();
        if self.done.is_empty() {
            self.take_replies();
        }
        if self.done.is_empty() {
            let now = Instant::now();
            while let Some(expired) = self.calls.expire(now) {
                let error = self.timed_out(expired.stage, expired.timeout);
                self.done.push_back((expired.ticket, Err(error)));
            }
        }
        self.done.pop_front()
    }

    /// When [`AnyClient::poll`] should be called again though nothing rang: a call will have taken
    /// too long, or a server may have confirmed that it hears.
    #[must_use]
    pub fn deadline(&self) -> Option<Instant> {
        let deadline = self.calls.deadline();
        let waiting = self.calls.next_to_send().is_some();
        // Ready it may have become since the last poll.
        if waiting && matches!(self.cdr.servers(), Peers::Half | Peers::Ready(_)) {
            return deadline.map(|at| at.min(Instant::now() + LOOK_AGAIN));
        }
        deadline
    }

    /// Calls and waits for the end, at most as long as the time-out of the options.
    ///
    /// # Errors
    /// Why there is no reply.
    pub fn call_and_wait(&mut self, request: &DynamicMessage) -> Result<DynamicMessage, CallError> {
        let ticket = self.call(request)?;
        let mut others = VecDeque::new();
        let result = loop {
            match self.poll() {
                Some((done, result)) if done == ticket => break result,
                Some(other) => others.push_back(other),
                None => {
                    let now = Instant::now();
                    let until = self.deadline().unwrap_or(now);
                    self.wake.wait(until.saturating_duration_since(now));
                }
            }
        };
        others.append(&mut self.done);
        self.done = others;
        result
    }

    fn send_waiting(&mut self) {
        while let Some(request) = self.calls.next_to_send() {
            if !matches!(self.cdr.servers(), Peers::Ready(_)) {
                return;
            }
            match self.cdr.send(&[request]) {
                Ok(sequence) => drop(self.calls.sent(sequence)),
                // Its readers do not keep up: it stays first in the row.
                Err(GraphError::Timeout { .. }) => return,
                Err(error) => {
                    if let Some(ticket) = self.calls.refused() {
                        self.done.push_back((ticket, Err(error.into())));
                    }
                }
            }
        }
    }

    fn take_replies(&mut self) {
        loop {
            let (sequence, result) = match self.cdr.take() {
                Ok(Some(reply)) => (
                    reply.sequence,
                    self.service.response().decode_exact(&reply.cdr, self.options.max_bytes),
                ),
                Ok(None) => return,
                // A reply that cannot be read names no call: its call will say that it waited.
                Err(error) => {
                    tracing::warn!(service = self.name, %error, "dropped a reply");
                    if matches!(error, GraphError::Stack { .. }) {
                        return;
                    }
                    continue;
                }
            };
            let Some(ticket) = self.calls.reply(sequence) else {
                tracing::debug!(
                    service = self.name,
                    sequence,
                    "dropped a reply that came too late"
                );
                continue;
            };
            let result = result.map_err(|fault| CallError::Reply {
                service: self.name.clone(),
                fault: fault.to_string(),
            });
            self.done.push_back((ticket, result));
        }
    }

    fn timed_out(&self, stage: Stage, timeout: Duration) -> CallError {
        let why = match (stage, self.cdr.servers()) {
            (Stage::Sent, Peers::Ready(_)) => "its server has not answered".to_owned(),
            (Stage::Sent, _) => "its server is gone".to_owned(),
            (Stage::Waiting, Peers::None) => "no node offers it".to_owned(),
            (Stage::Waiting, Peers::Half) => {
                "its server is found by half only, or has not confirmed that it hears".to_owned()
            }
            (Stage::Waiting, Peers::Ready(_)) => "its server was found too late".to_owned(),
            (Stage::Waiting, Peers::Foreign(theirs)) => foreign(theirs, self.mapping),
        };
        let timeout_ms = u64::try_from(timeout.as_millis()).unwrap_or(u64::MAX);
        CallError::TimedOut { service: self.name.clone(), timeout_ms, why }
    }
}

/// What separates the two ends of a service, and what to do.
fn foreign(theirs: ServiceMapping, ours: ServiceMapping) -> String {
    format!(
        "the other end runs {}, whose services do not understand those of {}: set \
         RMW_IMPLEMENTATION={} here, or {} there",
        theirs.rmw(),
        ours.rmw(),
        theirs.rmw(),
        ours.rmw()
    )
}
