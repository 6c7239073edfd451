//! The client of one value, which calls a method of another program.
//!
//! ```text
//!   arguments ─▶ ClientEnd ─▶ server elsewhere
//!   returns   ◀─────┘
//! ```
//!
//! The client of an action calls its server's function: see `goal_client`.

use std::sync::Arc;
use std::time::Duration;

use super::context::Live;
use super::end::EndCommon;
use super::error::MethodError;
use super::feedback::Feedback;
use super::goal_client::{GoalCalls, GoalClient};
use super::notifier::LookResult;
use super::session::{GatheredMessages, Session};
use super::wait::with_reason;
use wrapyfi_data::codec::Conversion;
use wrapyfi_data::types::{self, TypedError, Value};
use wrapyfi_endpoint::{self as endpoint, Client, Link, Mutex, Request};

/// An argument of a request: its name and value.
pub type NamedArgument = (&'static str, Result<Value, TypedError>);

/// Client of one value.
pub(super) struct ClientEnd {
    pub(super) common: EndCommon,
    conversion: Option<Conversion>,
    client: Mutex<Box<dyn Client>>,
    /// Goals of an action.
    goals: Option<Arc<GoalCalls>>,
}

impl ClientEnd {
    pub(super) fn new(
        common: EndCommon,
        client: Box<dyn Client>,
        conversion: Option<Conversion>,
    ) -> Self {
        Self { common, conversion, client: Mutex::new(client), goals: None }
    }

    pub(super) fn of_action(common: EndCommon, goals: Arc<GoalCalls>, to: Conversion) -> Self {
        let client = Box::new(GoalClient(Arc::clone(&goals)));
        Self { goals: Some(goals), ..Self::new(common, client, Some(to)) }
    }

    /// Value of a result that has one field, and of one that has none: what a method may return in place of a dict.
    pub(super) fn only_field(&self, result: &types::Payload) -> Option<types::Payload> {
        let types::Payload::NativeObject(object) = result else { return None };
        let (Some(_), Value::Map(fields)) = (&self.goals, &object.value) else { return None };
        let mut values = fields.iter().map(|(_, value)| value);
        let first = values.next().cloned().unwrap_or_default();
        values.next().is_none().then(|| first.into())
    }

    pub(super) fn link(&self) -> Link {
        self.client.lock().link()
    }

    fn waited_for(&self) -> String {
        with_reason(format!("a reply from {}", self.common.endpoint), self.link())
    }
}

/// A call under way. Dropping it makes the client forget the call.
struct Call<'a> {
    end: &'a ClientEnd,
    ticket: endpoint::Ticket,
    has_ended: bool,
}

impl Call<'_> {
    fn look(&mut self) -> LookResult<Result<endpoint::Reply, endpoint::CallError>> {
        let mut client = self.end.client.lock();
        match client.take_only(self.ticket) {
            Some(result) => {
                self.has_ended = true;
                LookResult::Found(result)
            }
            None => LookResult::Again(client.deadline()),
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
    /// Calls the method of the other program, once for each value, as Wrapyfi's clients do. The feedback of an action
    /// goes to `feedback`.
    ///
    /// # Errors
    /// When an argument has no form, or a reply does not come.
    pub async fn ask(
        &self,
        in_task: bool,
        arguments: Vec<NamedArgument>,
        feedback: Option<&Feedback>,
    ) -> Result<GatheredMessages, MethodError> {
        let request = self.request(arguments)?;
        self.call(in_task, &request, feedback).await
    }

    /// As [`Session::ask`], with arguments in a request.
    ///
    /// # Errors
    /// When a reply does not come.
    pub async fn call(
        &self,
        in_task: bool,
        request: &Request,
        feedback: Option<&Feedback>,
    ) -> Result<GatheredMessages, MethodError> {
        let live = self.live(in_task);
        let runtime = live.as_deref().map(Live::runtime);
        let mut gathered = self.nothing();
        for (index, client) in self.clients() {
            // Begun first, so that the end of a call that a server has heard of is not missed.
            let mut wait = self.begin_wait(None);
            let mut call = match self.begin(client, request, feedback) {
                Err(_) if client.common.is_given_up() => continue,
                begun => begun?,
            };
            let waited_for = || client.waited_for();
            let look = || match call.look() {
                LookResult::Found(result) => LookResult::Found(Some(result)),
                LookResult::Again(_) if client.common.is_given_up() => LookResult::Found(None),
                LookResult::Again(at) => LookResult::Again(at),
            };
            if let Some(result) =
                client.common.notifier.wait(&mut wait, runtime, waited_for, look).await?
            {
                gathered.set(index, Some(self.replied(client, result)?));
            }
        }
        Ok(gathered)
    }

    fn begin<'a>(
        &self,
        end: &'a ClientEnd,
        request: &Request,
        feedback: Option<&Feedback>,
    ) -> Result<Call<'a>, MethodError> {
        let mut client = end.client.lock();
        let default = match &end.goals {
            None => endpoint::ServiceSpec::TIMEOUT,
            Some(goals) => {
                goals.set_feedback(feedback);
                Duration::MAX
            }
        };
        let ticket = client.send(request, end.common.timeout.unwrap_or(default));
        let ticket = ticket.map_err(|source| self.unanswered(source))?;
        Ok(Call { end, ticket, has_ended: false })
    }

    fn replied(
        &self,
        client: &ClientEnd,
        result: Result<endpoint::Reply, endpoint::CallError>,
    ) -> Result<types::Payload, MethodError> {
        let payload = result.map_err(|source| self.unanswered(source))?.payload;
        let Some(conversion) = client.conversion else { return Ok(payload) };
        let converted = conversion.convert(payload, types::Stamp::now);
        converted.map_err(|error| MethodError::WrongType {
            method: self.method.clone(),
            endpoint: client.common.endpoint.to_string(),
            source: Box::new(error.into()),
        })
    }

    fn unanswered(&self, source: endpoint::CallError) -> MethodError {
        MethodError::Unanswered { method: self.method.clone(), source: Box::new(source) }
    }

    fn request(&self, arguments: Vec<NamedArgument>) -> Result<Request, MethodError> {
        let named = arguments.into_iter().map(|(name, value)| match value {
            Ok(value) => Ok((name, value)),
            Err(error) => Err(MethodError::Argument {
                method: self.method.clone(),
                argument: name.to_owned(),
                reason: error.to_string(),
            }),
        });
        let named = named.collect::<Result<Vec<_>, _>>()?;
        Ok(match self.clients().any(|(_, client)| client.goals.is_some()) {
            true => Request::default().with(named.into_iter().collect()),
            false => Request::new(named.into_iter().map(|(_, value)| value).collect::<Vec<_>>()),
        })
    }

    fn clients(&self) -> impl Iterator<Item = (usize, &ClientEnd)> {
        let channels = self.channels.iter().enumerate();
        channels.filter_map(|(index, channel)| Some((index, channel.client.as_ref()?)))
    }
}
