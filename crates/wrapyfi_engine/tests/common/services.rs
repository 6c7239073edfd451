//! Ends of services that fail as told.

use std::time::{Duration, Instant};

use wrapyfi_data::types::Payload;
use wrapyfi_endpoint::{
    CallError, Client, Clock, IncomingRequest, Link, Refusal, Reply, Request, RequestId,
    ServeError, Server, Ticket, Wake,
};

use super::{FaultyEnd, lock};

impl<T: ?Sized> FaultyEnd<T> {
    fn may_send(&self, place: &str) -> Result<(), String> {
        self.shared.panic_in(place);
        match lock(&self.shared.faults).sends_fail {
            true => Err("injected: it does not send".to_owned()),
            false => Ok(()),
        }
    }
}

impl Client for FaultyEnd<dyn Client> {
    fn send(&mut self, request: &Request, timeout: Duration) -> Result<Ticket, CallError> {
        let service = self.topic.clone();
        self.may_send("send").map_err(|reason| CallError::Transport { service, reason })?;
        let ticket = self.inner.send(request, timeout)?;
        self.shared.note(&self.topic, |history| history.under_way += 1);
        Ok(ticket)
    }

    fn take(&mut self) -> Option<(Ticket, Result<Reply, CallError>)> {
        let taken = self.inner.take()?;
        self.shared.note(&self.topic, |history| history.under_way -= 1);
        self.shared.panic_in("take");
        Some(taken)
    }

    fn take_only(&mut self, ticket: Ticket) -> Option<Result<Reply, CallError>> {
        self.inner.take_only(ticket)
    }

    fn cancel(&mut self, ticket: Ticket) {
        self.inner.cancel(ticket);
    }

    fn deadline(&self) -> Option<Instant> {
        self.inner.deadline()
    }

    fn link(&self) -> Link {
        self.inner.link()
    }

    fn wake(&self) -> &Wake {
        self.inner.wake()
    }

    fn clock(&self) -> &Clock {
        self.inner.clock()
    }
}

impl Server for FaultyEnd<dyn Server> {
    fn take(&mut self) -> Result<Option<IncomingRequest>, ServeError> {
        let taken = self.inner.take()?;
        if taken.is_some() {
            self.shared.panic_in("take");
        }
        Ok(taken)
    }

    fn reply(
        &mut self,
        id: RequestId,
        answer: Result<Payload, Refusal>,
    ) -> Result<usize, ServeError> {
        self.shared.panic_in("reply");
        self.inner.reply(id, answer)
    }

    fn deadline(&self) -> Option<Instant> {
        self.inner.deadline()
    }

    fn link(&self) -> Link {
        self.inner.link()
    }
}
