//! Methods that are described while the program runs, by a front end in another language.

use std::ops::Deref;
use std::sync::Arc;

use super::context::{CommunicatorContext, Live};
use super::error::MethodError;
use super::mode::Mode;
use super::oneshot;
use super::opening::Opening;
use super::resolve::Resolved;
use super::session::Session;
use super::wait::ASK_EVERY;

/// The endpoints of a method, which keep their middlewares running.
#[derive(Debug)]
pub struct OpenMethod {
    // Declared before `_live`, so that endpoints are dropped before their middlewares.
    session: Session,
    _live: Arc<Live>,
}

impl Deref for OpenMethod {
    type Target = Session;

    fn deref(&self) -> &Session {
        &self.session
    }
}

impl OpenMethod {
    /// Ends the waits that have begun.
    pub fn cancel(&self) {
        self.session.cancel();
    }

    /// Ends every wait, now and later.
    pub fn end(&self) {
        self.session.end();
    }
}

impl CommunicatorContext {
    /// Opens the endpoints of `method` for `mode`.
    ///
    /// # Errors
    /// When an option cannot be used, an endpoint cannot be opened, or the wait is interrupted.
    #[doc(hidden)]
    pub fn open(
        &self,
        method: &str,
        mode: Mode,
        values: Vec<Resolved>,
    ) -> Result<OpenMethod, MethodError> {
        let (sender, opened) = oneshot::channel();
        let (context, live) = (self.clone(), self.live());
        let (name, there) = (method.to_owned(), Arc::clone(&live));
        live.runtime().submit(move || {
            let opening = Opening { method: name, mode, context: &context, live: &there };
            sender.send(opening.open(&values));
        });
        let is_over = || self.is_interrupted().is_some_and(|ask| ask());
        match opened.recv_until(ASK_EVERY, is_over) {
            Some(session) => Ok(OpenMethod { session: session?, _live: live }),
            None => Err(MethodError::Cancelled {
                method: method.to_owned(),
                waited_for: "its endpoints to open".to_owned(),
            }),
        }
    }
}
