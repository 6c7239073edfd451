//! The client of one value, which calls a method of another program.
//!
//! ```text
//!   arguments ─▶ ClientEnd ─▶ server elsewhere
//!   returns   ◀─────┘
//! ```

use std::sync::Arc;
use std::time::Duration;

use super::context::Live;
use super::error::MethodError;
use super::listener::EndOptions;
use super::missing::Missing;
use super::notifier::{Look, Notifier};
use super::rules::Rules;
use super::session::{GatheredMessages, Session};
use super::wait::with_reason;
use wrapyfi_data::types::{self, TypedError, Value};
use wrapyfi_endpoint::{
    self as endpoint, Client, Counters, CountersSnapshot, EndpointAddress, Link, Mutex, Request,
};

/// An argument of a request: its name and value.
pub type NamedArgument = (&'static str, Result<Value, TypedError>);

/// Client of one value.
pub(super) struct ClientEnd {
    pub(super) endpoint: EndpointAddress,
    pub(super) rules: Rules,
    counters: Arc<Counters>,
    timeout: Duration,
    pub(super) notifier: Notifier,
    missing: Missing,
    client: Mutex<Box<dyn Client>>,
}

impl ClientEnd {
    pub(super) fn new(
        endpoint: EndpointAddress,
        client: Box<dyn Client>,
        counters: Arc<Counters>,
        options: EndOptions,
    ) -> Self {
        Self {
            endpoint,
            rules: options.rules,
            counters,
            timeout: options.timeout.unwrap_or(endpoint::ServiceSpec::TIMEOUT),
            notifier: Notifier::new(client.wake().clone()),
            missing: options.missing,
            client: Mutex::new(client),
        }
    }

    pub(super) fn status(&self) -> (&EndpointAddress, Link, CountersSnapshot) {
        (&self.endpoint, self.client.lock().link(), self.counters.snapshot())
    }

    fn waited_for(&self) -> String {
        with_reason(format!("a reply from {}", self.endpoint), self.client.lock().link())
    }
}

/// A call under way. Dropping it makes the client forget the call.
struct Call<'a> {
    end: &'a ClientEnd,
    ticket: endpoint::Ticket,
    has_ended: bool,
}

impl Call<'_> {
    fn look(&mut self) -> Look<Result<endpoint::Reply, endpoint::CallError>> {
        let mut client = self.end.client.lock();
        match client.take_only(self.ticket) {
            Some(result) => {
                self.has_ended = true;
                Look::Found(result)
            }
            None => Look::Again(client.deadline()),
        }
    }
}

impl Drop for Call<'_> {
    fn drop(&mut self) {
        if !self.has_ended {
            self.end.client.lock().cancel(self.ticket);
        }
    }
}

impl Session {
    /// Calls the method of the other program, once for each value, as Wrapyfi's clients do.
    ///
    /// # Errors
    /// When an argument has no form, or a reply does not come.
    pub async fn ask(
        &self,
        in_task: bool,
        arguments: Vec<NamedArgument>,
    ) -> Result<GatheredMessages, MethodError> {
        let live = self.live(in_task);
        let runtime = live.as_deref().map(Live::runtime);
        let request = self.request(arguments)?;
        let mut gathered = self.nothing();
        for (index, client) in self.clients() {
            let mut call = match self.begin(client, &request) {
                Err(_) if client.missing.is_given_up(&client.endpoint) => continue,
                begun => begun?,
            };
            let mut wait = self.begin_wait(None);
            let waited_for = || client.waited_for();
            let look = || match call.look() {
                Look::Found(result) => Look::Found(Some(result)),
                Look::Again(_) if client.missing.is_given_up(&client.endpoint) => Look::Found(None),
                Look::Again(at) => Look::Again(at),
            };
            if let Some(result) = client.notifier.wait(&mut wait, runtime, waited_for, look).await?
            {
                gathered.set(index, Some(self.replied(result)?));
            }
        }
        Ok(gathered)
    }

    fn begin<'a>(&self, end: &'a ClientEnd, request: &Request) -> Result<Call<'a>, MethodError> {
        let ticket = end.client.lock().send(request, end.timeout);
        let ticket = ticket.map_err(|source| self.unanswered(source))?;
        Ok(Call { end, ticket, has_ended: false })
    }

    fn replied(
        &self,
        result: Result<endpoint::Reply, endpoint::CallError>,
    ) -> Result<types::Payload, MethodError> {
        result.map(|reply| reply.payload).map_err(|source| self.unanswered(source))
    }

    fn unanswered(&self, source: endpoint::CallError) -> MethodError {
        MethodError::Unanswered { method: self.method.clone(), source: Box::new(source) }
    }

    fn request(&self, arguments: Vec<NamedArgument>) -> Result<Request, MethodError> {
        let args = arguments.into_iter().map(|(name, value)| {
            value.map_err(|error| MethodError::Argument {
                method: self.method.clone(),
                argument: name.to_owned(),
                reason: error.to_string(),
            })
        });
        Ok(Request::new(args.collect::<Result<Vec<_>, _>>()?))
    }

    fn clients(&self) -> impl Iterator<Item = (usize, &ClientEnd)> {
        let channels = self.channels.iter().enumerate();
        channels.filter_map(|(index, channel)| Some((index, channel.client.as_ref()?)))
    }
}
