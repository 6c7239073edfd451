//! Middlewares that are not there: a method with values on several goes on with the others.
//!
//! ```text
//!   no master, name server or broker ── for a second ──▶ no caller waits for this value: None
//!                                      comes ──────────▶ waited for again
//! ```

use std::sync::{Arc, Weak};
use std::time::{Duration, Instant};

use super::wait::to_stderr;
use wrapyfi_endpoint::{EndpointAddress, Middleware, Mutex};

/// Time that a middleware has to find what it needs.
const GRACE: Duration = Duration::from_secs(1);

/// The middleware of an endpoint, where its value has others beside it; a value that is alone waits as long as it takes.
#[derive(Default)]
pub(super) struct Missing {
    middleware: Option<Weak<dyn Middleware>>,
    state: Mutex<Absence>,
}

#[derive(Default)]
struct Absence {
    since: Option<Instant>,
    is_told: bool,
}

impl Missing {
    pub(super) fn new(middleware: &Arc<dyn Middleware>) -> Self {
        Self { middleware: Some(Arc::downgrade(middleware)), state: Mutex::default() }
    }

    /// True when no call need wait for `endpoint`, because its middleware has not been there for a while. The log has it
    /// once.
    pub(super) fn is_given_up(&self, endpoint: &EndpointAddress) -> bool {
        let Some(middleware) = self.middleware.as_ref().and_then(Weak::upgrade) else {
            return false;
        };
        let why = middleware.waiting_for();
        let (now, mut state) = (Instant::now(), self.state.lock());
        let Some(why) = why else {
            *state = Absence::default();
            return false;
        };
        let since = *state.since.get_or_insert(now);
        if now.saturating_duration_since(since) < GRACE {
            return false;
        }
        let was_told = std::mem::replace(&mut state.is_told, true);
        drop(state);
        if !was_told {
            let told = format_args!(
                "{endpoint} waits for {why}; until then what would come from there is None, and what would go there is \
                 not sent"
            );
            if !to_stderr(told) {
                tracing::warn!("{told}");
            }
        }
        true
    }
}
