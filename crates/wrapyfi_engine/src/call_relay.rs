//! The frame of the relays of services and of actions: two ends that open and close, the calls or goals under
//! way between them, and the state of the route.
//!
//! ```text
//!   caller ──▶ offered end at `as` ── ask ──▶ called end ──▶ the real server
//!          ◀───────────────────── answer ◀──            ◀──
//! ```
//!
//! The frame has no threads, as [`super::Relay`].

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

use super::end::RouteEnd;
use super::losses::Losses;
use super::route::Route;
use super::route_status::RouteState;
use super::work::{Progress, UNWANTED_FOR, Work, not_begun};
use wrapyfi_data::codec::Conversion;
use wrapyfi_endpoint::backoff::Backoff;
use wrapyfi_endpoint::{
    Absent, Cause, Context, DropReason, Link, Middleware, OpenResult, Opened, Qos, Registry, Role,
    Ticket,
};

/// Largest number of requests and of answers moved in one step.
const BATCH: usize = 16;

/// The part of the frame that services and actions do each in their own way.
pub(super) trait Calls: Sized {
    type Server: ?Sized + Send;
    type Client: ?Sized + Send;
    /// Name that the offered end has for what is under way.
    type Id: Send;
    /// Role of the program that a route waits for.
    const REAL: Role;
    /// True where the offered end is open only while the real server is there.
    const FOLLOWS: bool;

    fn open_server(on: &dyn Middleware, at: &Route, with: &Context) -> Opened<Self::Server>;
    fn open_client(on: &dyn Middleware, at: &Route, with: &Context) -> Opened<Self::Client>;
    /// Connection of an end, and the time to look at it without a ring.
    fn look_at_server(server: &Self::Server) -> (Link, Option<Instant>);
    fn look_at_client(client: &Self::Client) -> (Link, Option<Instant>);
    /// Number of answers that the offered end has yet to send.
    fn kept(server: &Self::Server) -> usize;
    /// Hides the offered end while the real server is away; false where it has to be closed for that.
    fn hide(_: &mut Self::Server) -> bool {
        false
    }
    /// Shows an offered end that was hidden.
    fn show(_: &mut Self::Server, _: &dyn Middleware) -> OpenResult<()> {
        Ok(())
    }
    /// Hands a request on to the real server; false where there is none.
    fn ask(relay: &mut CallRelay<Self>, now: Instant) -> bool;
    /// Hands an answer back to its caller; false where there is none.
    fn answer(relay: &mut CallRelay<Self>, now: Instant) -> bool;
}

/// One route of a service or of an action at work.
pub(crate) struct CallRelay<I: Calls> {
    pub(super) spec: Route,
    /// Bell and counters of the offered end, which are the route's.
    pub(super) front: Context,
    back: Context,
    pub(super) offered: RouteEnd<I::Server>,
    pub(super) called: RouteEnd<I::Client>,
    backoff: Backoff,
    /// Conversion of what a function returns to the type that the offered service carries.
    pub(super) conversion: Option<Conversion>,
    /// Calls or goals under way, by the called end's name for them.
    pub(super) calls: BTreeMap<Ticket, I::Id>,
    pub(super) state: RouteState,
    /// Connection of the called end at the last step.
    link: Option<Link>,
    /// Instant of the last request or answer.
    moved_at: Option<Instant>,
    losses: Losses,
}

impl<I: Calls> CallRelay<I> {
    /// A route that has opened nothing yet. `seed` spreads its back-off; the counters of `front`, which count requests
    /// as received and answers as sent, may be those of an earlier route with these ends.
    pub(super) fn new(spec: Route, registry: &Registry, seed: u64, front: Context) -> Self {
        Self {
            offered: RouteEnd::new(registry, &spec.to.middleware),
            called: RouteEnd::new(registry, &spec.from.middleware),
            // One bell for both sides.
            back: Context { counters: Arc::default(), ..front.clone() },
            front,
            backoff: Backoff::new(seed),
            conversion: spec.service_spec(&spec.to).conversion(),
            calls: BTreeMap::new(),
            state: not_begun(),
            link: None,
            moved_at: None,
            losses: Losses::default(),
            spec,
        }
    }

    /// Opens what is to be open, the client of the real server first, so that a request finds it open. An offered end
    /// that follows its server hides or closes when that has gone and its clients have heard of it.
    fn reconcile(&mut self, now: Instant) {
        let Self { spec, front, back, offered, called, backoff, .. } = self;
        called.open_with(now, backoff, |middleware| I::open_client(middleware, spec, back));
        self.link = called.open.as_deref().map(|client| I::look_at_client(client).0);
        if self.link.as_ref().is_some_and(|link| !I::FOLLOWS || link.has_peers()) {
            offered.open_with(now, backoff, |middleware| I::open_server(middleware, spec, front));
            let RouteEnd { open, middleware, .. } = &mut *offered;
            if let (Some(server), Some(middleware)) = (open, middleware) {
                match I::show(server, &**middleware) {
                    Ok(()) => backoff.reset(),
                    Err(error) => offered.refuse(now, backoff, error),
                }
            }
        } else if let Some(server) = offered.open.as_deref_mut()
            && I::kept(server) == 0
            && !I::hide(server)
        {
            offered.close();
        }
    }

    pub(super) fn note(&mut self, now: Instant, what: &str, reason: DropReason, error: String) {
        self.losses.note(now, &self.spec.name, format_args!("{what}"), reason, error);
    }

    /// The absence of the real server, where it is absent.
    pub(super) fn absent(&self) -> Option<Cause> {
        let is_there = self.link.as_ref().is_some_and(Link::has_peers);
        (!is_there).then(|| Absent::at(I::REAL, &self.spec.from).into())
    }

    fn judge(&mut self, now: Instant) -> RouteState {
        if let Some(trouble) = self.called.trouble.as_ref().or(self.offered.trouble.as_ref()) {
            return trouble.clone();
        }
        let Some(link) = &self.link else { return self.state.clone() };
        let offered = self.offered.open.as_deref().map(|server| I::look_at_server(server).0);
        let what = link.waiting_for.clone().or(offered.and_then(|link| link.waiting_for));
        if let Some(what) = what.or_else(|| self.absent()) {
            // What failed for want of it is over once it is there.
            self.losses.last = None;
            return RouteState::Waiting(what);
        }
        self.losses.state(now).unwrap_or(RouteState::Active)
    }
}

impl<I: Calls> Work for CallRelay<I> {
    fn step(&mut self, now: Instant) -> Progress {
        self.reconcile(now);
        for refused in self.back.counters.take_refused() {
            // The counters of the route are those of its other end.
            self.front.counters.refused_peer(refused);
        }
        let asked = (0..BATCH).take_while(|_| I::ask(self, now)).count();
        let moved = asked + (0..BATCH).take_while(|_| I::answer(self, now)).count();
        if moved > 0 {
            self.moved_at = Some(now);
        }
        self.state = self.judge(now);
        let is_quiet = |at: Instant| now.saturating_duration_since(at) >= UNWANTED_FOR;
        let at_rest = self.calls.is_empty() && self.moved_at.is_none_or(is_quiet);
        let server = self.offered.open.as_deref().and_then(|it| I::look_at_server(it).1);
        let client = self.called.open.as_deref().and_then(|it| I::look_at_client(it).1);
        let due = [self.offered.retry_at, self.called.retry_at, server, client];
        Progress::new(now, moved, moved >= BATCH, at_rest, due)
    }

    fn state(&self) -> (&RouteState, [Option<Qos>; 2], bool) {
        let has_source = self.link.as_ref().is_some_and(|link| link.peers > Some(0));
        (&self.state, [None, None], has_source)
    }

    fn is_open(&self) -> bool {
        self.called.open.is_some() && (I::FOLLOWS || self.offered.open.is_some())
    }

    fn close(&mut self) {
        self.calls.clear();
        self.link = None;
        self.offered.close();
        self.called.close();
    }
}
