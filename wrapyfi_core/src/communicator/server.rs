//! The server of one value, which runs a method for clients.
//!
//! ```text
//!   client elsewhere ─▶ ServerEnd ─▶ ReceivedRequest: arguments, decoded one by one
//!                    ◀─ answer ◀──── what the body returned
//!                        └ kept while the client does not hear yet ◀─ flushed ─ the library's thread
//! ```
//!
//! The server of an action serves a function: see `goal_server`.

use std::sync::Arc;
use std::time::{Duration, Instant};

use serde::de::DeserializeOwned;

use super::context::Live;
use super::end::EndCommon;
use super::error::MethodError;
use super::feedback::Feedback;
use super::goal_server::{GoalServer, ServedGoals};
use super::notifier::LookResult;
use super::runtime::{Runtime, Watched};
use super::session::Session;
use super::wait::to_stderr;
use wrapyfi_data::codec::Conversion;
use wrapyfi_data::returned::{PayloadError, Returned};
use wrapyfi_data::types::{self, from_value};
use wrapyfi_endpoint::{
    self as endpoint, Call, Clock, GoalNumber, Link, Mutex, RequestId, Server, Throttle,
};

/// Time between two tries to send kept replies: no bell rings when their clients begin to hear.
const FLUSH_EVERY: Duration = Duration::from_millis(10);
/// Longest time for which a closed server goes on sending kept replies.
const LINGER: Duration = Duration::from_secs(1);

/// Server of one value.
pub(super) struct ServerEnd {
    pub(super) common: EndCommon,
    conversion: Option<Conversion>,
    clock: Clock,
    state: Mutex<Serving>,
    /// Goals of an action.
    goals: Option<Arc<ServedGoals>>,
}

struct Serving {
    server: Box<dyn Server>,
    /// Throttle of lines about requests that could not be served.
    said: Throttle,
}

impl ServerEnd {
    pub(super) fn new(
        common: EndCommon,
        server: Box<dyn Server>,
        conversion: Option<Conversion>,
        clock: Clock,
    ) -> Self {
        let state = Mutex::new(Serving { server, said: Throttle::default() });
        Self { common, conversion, clock, state, goals: None }
    }

    pub(super) fn of_action(common: EndCommon, goals: Arc<ServedGoals>, clock: Clock) -> Self {
        let server = Box::new(GoalServer(Arc::clone(&goals)));
        let mut end = Self::new(common, server, None, clock);
        end.goals = Some(goals);
        end
    }

    pub(super) fn link(&self) -> Link {
        self.state.lock().server.link()
    }

    /// Applies the rules of the value to a returned payload, and converts it to the type that the
    /// service carries.
    fn converted(&self, payload: types::Payload) -> Result<types::Payload, PayloadError> {
        let payload = self.common.rules.apply(payload)?;
        let Some(conversion) = self.conversion else { return Ok(payload) };
        Ok(conversion.convert(payload, types::Stamp::now)?)
    }

    fn waited_for(&self) -> String {
        format!("a request to {}", self.common.endpoint)
    }

    /// Leaves kept replies to the library's thread, because the method may never be called again.
    fn leave_kept_to(self: &Arc<Self>, runtime: &Runtime) {
        if self.state.lock().server.kept() > 0 {
            runtime.flush(Arc::downgrade(self) as _);
        }
    }

    /// Takes the next request that can be served.
    fn take(&self) -> LookResult<Option<endpoint::IncomingRequest>> {
        let mut state = self.state.lock();
        loop {
            match state.server.take() {
                Ok(Some(request)) => return LookResult::Found(Some(request)),
                Ok(None) if !self.common.should_wait => return LookResult::Found(None),
                Ok(None) => return LookResult::Again(state.server.deadline()),
                Err(error) => self.say(&mut state, &error),
            }
        }
    }

    fn say(&self, state: &mut Serving, error: &dyn std::fmt::Display) {
        if state.said.pass(self.clock.now()).is_some() {
            tracing::warn!("{}: {error}", self.common.endpoint);
        }
    }

    fn reply(
        &self,
        id: RequestId,
        answer: Result<types::Payload, endpoint::Refusal>,
    ) -> Result<(), endpoint::ServeError> {
        let mut state = self.state.lock();
        match state.server.reply(id, answer) {
            Ok(_) => Ok(()),
            Err(error @ endpoint::ServeError::Reply { .. }) => Err(error),
            // The client has gone or its time-out has passed, which is no fault of the method.
            Err(error) => {
                self.say(&mut state, &error);
                Ok(())
            }
        }
    }
}

impl Watched for ServerEnd {
    /// Sends kept replies whose clients hear now.
    fn look(&self, now: Instant) -> Option<Instant> {
        let mut state = self.state.lock();
        if state.server.kept() == 0 {
            return None;
        }
        state.server.flush();
        (state.server.kept() > 0).then(|| now + FLUSH_EVERY)
    }
}

impl Drop for ServerEnd {
    fn drop(&mut self) {
        let end = Instant::now() + LINGER;
        while self.look(Instant::now()).is_some() && Instant::now() < end {
            std::thread::sleep(FLUSH_EVERY);
        }
    }
}

/// A request for which the body is to run.
#[derive(Debug)]
pub struct ReceivedRequest<'a> {
    session: &'a Session,
    call: Call,
    /// Place of the value whose client asked, and the request; `None` once it is answered.
    asked: Option<(usize, RequestId)>,
    first: usize,
}

impl ReceivedRequest<'_> {
    /// Takes the argument at `index`, which may also be given by `name`.
    ///
    /// # Errors
    /// When the argument is missing or not of this type, in words.
    pub fn argument<T: DeserializeOwned>(&mut self, index: usize, name: &str) -> Result<T, String> {
        let given = self.given(index, name);
        let is_missing = given.is_none();
        from_value(given.unwrap_or_default()).map_err(|error| {
            if is_missing {
                format!("argument {name} is missing: pass it as argument {index} or by its name")
            } else {
                unusable(name, &error)
            }
        })
    }

    /// As [`ReceivedRequest::argument`], with `default` where the client left the argument out.
    ///
    /// # Errors
    /// When the argument is not of this type, in words.
    pub fn argument_or<T: DeserializeOwned>(
        &mut self,
        index: usize,
        name: &str,
        default: impl FnOnce() -> T,
    ) -> Result<T, String> {
        match self.given(index, name) {
            Some(given) => from_value(given).map_err(|error| unusable(name, &error)),
            None => Ok(default()),
        }
    }

    /// Takes the arguments as they came.
    pub fn take_call(&mut self) -> Call {
        std::mem::take(&mut self.call)
    }

    fn given(&mut self, index: usize, name: &str) -> Option<types::Value> {
        let by_place = self.call.args.get_mut(index).map(std::mem::take);
        by_place.or_else(|| self.call.kwargs.get(name).cloned())
    }

    /// Feedback of the goal that the request is.
    pub fn feedback(&self) -> Feedback {
        let goal = self.asked.and_then(|(index, id)| {
            let server = self.session.channels.get(index)?.server.as_ref()?;
            Some((server.goals.as_ref()?, GoalNumber(id.0)))
        });
        goal.map_or_else(Feedback::default, |(goals, number)| Feedback::of_goal(goals, number))
    }

    /// Tells the client why its request is not served.
    pub fn refuse(mut self, reason: &str) {
        let method = &self.session.method;
        if !to_stderr(format_args!("{method}: a request was refused: {reason}")) {
            tracing::warn!("{method}: a request was refused: {reason}");
        }
        self.tell(reason);
    }

    fn tell(&mut self, reason: &str) {
        let Some((index, id)) = self.asked.take() else { return };
        let server = self.session.channels.get(index).and_then(|channel| channel.server.as_ref());
        let Some(server) = server else { return };
        if let Err(error) = server.reply(id, Err(reason.into())) {
            tracing::debug!("{}: {error}", self.session.method);
        }
        self.session.leave_kept(server);
    }
}

fn unusable(name: &str, error: &types::TypedError) -> String {
    format!("argument {name} cannot be used: {error}")
}

impl Drop for ReceivedRequest<'_> {
    fn drop(&mut self) {
        self.tell("the method ended without an answer");
    }
}

impl Session {
    /// True when the method has a server; without one the body runs with its own arguments.
    pub fn serves(&self) -> bool {
        self.servers().next().is_some()
    }

    /// Takes the next request; `None` when none is there and `should_wait` is off.
    ///
    /// # Errors
    /// When the wait is ended.
    pub async fn hear(&self, in_task: bool) -> Result<Option<ReceivedRequest<'_>>, MethodError> {
        let Some((index, server)) = self.servers().next() else { return Ok(None) };
        let request = self.next_request(in_task, server).await?;
        Ok(request.map(|endpoint::IncomingRequest { id, request, .. }| {
            // The server offers a function, so the request is always a call that can be read.
            let call = request.into_call().unwrap_or_default();
            ReceivedRequest { session: self, call, asked: Some((index, id)), first: index }
        }))
    }

    /// Answers with the value at `index`. The client of the first value is answered at once; those
    /// of further values are waited for, because clients ask for one value after the other.
    ///
    /// # Errors
    /// When the value has no form as a reply, or the wait is ended.
    pub async fn answer<K, R: Returned<K>>(
        &self,
        in_task: bool,
        heard: &mut ReceivedRequest<'_>,
        index: usize,
        value: &R,
    ) -> Result<(), MethodError> {
        let server = self.channels.get(index).and_then(|channel| channel.server.as_ref());
        let Some(server) = server else { return Ok(()) };
        if index != heard.first {
            let request = self.next_request(in_task, server).await?;
            heard.asked = request.map(|request| (index, request.id));
        }
        self.answered(server, heard, value)
    }

    fn answered<K, R: Returned<K>>(
        &self,
        server: &Arc<ServerEnd>,
        heard: &mut ReceivedRequest<'_>,
        value: &R,
    ) -> Result<(), MethodError> {
        let made = value
            .to_payload()
            .and_then(|payload| payload.map(|payload| server.converted(payload)).transpose());
        let payload = match made {
            Ok(Some(payload)) => payload,
            Ok(None) => {
                heard.tell("the method returned nothing");
                return Ok(());
            }
            Err(error) => {
                heard.tell(&format!("what the method returned cannot be sent: {error}"));
                return Err(self.unfit(&server.common.endpoint, error));
            }
        };
        let Some((_, id)) = heard.asked.take() else { return Ok(()) };
        let replied = server.reply(id, Ok(payload)).map_err(|source| MethodError::Reply {
            method: self.method.clone(),
            endpoint: server.common.endpoint.to_string(),
            source: Box::new(source),
        });
        self.leave_kept(server);
        replied
    }

    fn leave_kept(&self, server: &Arc<ServerEnd>) {
        if let Some(live) = self.live.upgrade() {
            server.leave_kept_to(live.runtime());
        }
    }

    async fn next_request(
        &self,
        in_task: bool,
        server: &ServerEnd,
    ) -> Result<Option<endpoint::IncomingRequest>, MethodError> {
        let live = self.live(in_task);
        let runtime = live.as_deref().map(Live::runtime);
        let mut wait = self.begin_wait(None);
        server
            .common
            .notifier
            .wait(&mut wait, runtime, || server.waited_for(), || server.take())
            .await
    }

    fn servers(&self) -> impl Iterator<Item = (usize, &Arc<ServerEnd>)> {
        let channels = self.channels.iter().enumerate();
        channels.filter_map(|(index, channel)| Some((index, channel.server.as_ref()?)))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering::SeqCst};

    use super::*;

    /// A server whose client hears at the fourth look.
    struct HardOfHearing {
        flushes: Arc<AtomicUsize>,
        sent: Option<super::super::oneshot::Sender<usize>>,
    }

    impl Server for HardOfHearing {
        fn take(&mut self) -> Result<Option<endpoint::IncomingRequest>, endpoint::ServeError> {
            Ok(None)
        }

        fn reply(
            &mut self,
            _: RequestId,
            _: Result<types::Payload, endpoint::Refusal>,
        ) -> Result<usize, endpoint::ServeError> {
            Ok(0)
        }

        fn deadline(&self) -> Option<Instant> {
            None
        }

        fn link(&self) -> Link {
            Link::default()
        }

        fn kept(&self) -> usize {
            self.sent.iter().count()
        }

        fn flush(&mut self) {
            if self.flushes.fetch_add(1, SeqCst) == 3
                && let Some(sent) = self.sent.take()
            {
                sent.send(4);
            }
        }
    }

    fn end() -> (ServerEnd, super::super::oneshot::Receiver<usize>, Arc<AtomicUsize>) {
        let (sender, sent) = super::super::oneshot::channel();
        let flushes = Arc::new(AtomicUsize::new(0));
        let server = HardOfHearing { flushes: Arc::clone(&flushes), sent: Some(sender) };
        let common = EndCommon::of_test("test:/x", true);
        (ServerEnd::new(common, Box::new(server), None, Clock::default()), sent, flushes)
    }

    #[test]
    fn a_kept_reply_is_sent_though_the_method_is_not_called_again() {
        let (runtime, (end, sent, flushes)) = (Runtime::start(), end());
        let end = Arc::new(end);
        end.leave_kept_to(&runtime);
        assert_eq!(sent.recv(), Some(4));
        drop((end, runtime));
        assert_eq!(flushes.load(SeqCst), 4, "nothing is kept any more");
    }

    #[test]
    fn a_server_that_is_closed_sends_what_it_kept() {
        let (end, sent, _) = end();
        drop(end);
        assert_eq!(sent.recv(), Some(4));
    }
}
