//! Actions inside one process.
//!
//! ```text
//!   client ── goal, cancel ──▶ the server of "/x" ── updates ──▶ the client that sent the goal
//! ```

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::Instant;

use super::Bus;
use crate::service_error::ServeResult;
use crate::{
    ActionClient, ActionServer, ActionSpec, CallError, Context, GoalNumber, GoalRequest,
    GoalUpdate, Link, Mutex, Request, Role, ServeError, Ticket, Wake,
};

/// Clients and the server of one action name.
#[derive(Debug, Default)]
pub(super) struct Action {
    /// Requests that the server has not taken, and its bell; `None` while there is no server.
    server: Option<(VecDeque<GoalRequest>, Wake)>,
    /// Updates that each client has not taken, and its bell.
    clients: BTreeMap<u64, (VecDeque<(Ticket, GoalUpdate)>, Wake)>,
    /// Client and its number of each goal under way.
    goals: BTreeMap<GoalNumber, (u64, Ticket)>,
    next: u64,
    type_name: Option<&'static str>,
}

impl Action {
    /// Number of endpoints in each role.
    pub(super) fn ends(&self) -> [(Role, usize); 2] {
        let servers = usize::from(self.server.is_some());
        [(Role::ActionClient, self.clients.len()), (Role::ActionServer, servers)]
    }

    pub(super) fn type_name(&self) -> Option<&'static str> {
        self.type_name
    }

    fn number(&mut self) -> u64 {
        self.next += 1;
        self.next
    }

    fn tell(&mut self, goal: GoalNumber, update: GoalUpdate) {
        let known =
            if update.is_end() { self.goals.remove(&goal) } else { self.goals.get(&goal).copied() };
        let Some((client, ticket)) = known else { return };
        if let Some((updates, wake)) = self.clients.get_mut(&client) {
            updates.push_back((ticket, update));
            wake.ring();
        }
    }

    fn ring(&self) {
        self.clients.values().for_each(|(_, wake)| wake.ring());
        self.server.iter().for_each(|(_, wake)| wake.ring());
    }
}

/// An end of an action, and its place on the bus.
struct End {
    bus: Arc<Mutex<Bus>>,
    spec: ActionSpec,
}

impl End {
    fn open(bus: &Arc<Mutex<Bus>>, spec: &ActionSpec) -> Self {
        let end = Self { bus: Arc::clone(bus), spec: spec.clone() };
        end.with(|action| action.type_name = Some(spec.kind.name()));
        end
    }

    fn with<T>(&self, with: impl FnOnce(&mut Action) -> T) -> T {
        with(self.bus.lock().actions.entry(self.spec.action.clone()).or_default())
    }

    fn link(&self, role: Role) -> Link {
        let ends = self.with(|action| action.ends());
        let peers = ends.into_iter().find_map(|(one, count)| (one == role).then_some(count));
        Link { peers, ..Link::default() }
    }
}

pub(super) struct MemoryActionClient {
    end: End,
    number: u64,
}

impl MemoryActionClient {
    pub(super) fn open(bus: &Arc<Mutex<Bus>>, spec: &ActionSpec, context: &Context) -> Self {
        let end = End::open(bus, spec);
        let number = end.with(|action| {
            let number = action.number();
            action.clients.insert(number, (VecDeque::new(), context.wake.clone()));
            action.ring();
            number
        });
        Self { end, number }
    }
}

impl ActionClient for MemoryActionClient {
    fn send(&mut self, goal: &Request) -> Result<Ticket, CallError> {
        let limit = self.end.spec.goals;
        let sent = self.end.with(|action| {
            if action.goals.values().filter(|(client, _)| *client == self.number).count() >= limit {
                return None;
            }
            let number = action.number();
            let ticket = Ticket::new(number);
            action.goals.insert(GoalNumber(number), (self.number, ticket));
            match &mut action.server {
                Some((requests, wake)) => {
                    let (number, goal) = (GoalNumber(number), goal.clone());
                    requests.push_back(GoalRequest::Goal { number, goal, wire_bytes: 0 });
                    wake.ring();
                }
                None => {
                    action.tell(GoalNumber(number), GoalUpdate::Rejected("no server".to_owned()));
                }
            }
            Some(ticket)
        });
        sent.ok_or_else(|| CallError::TooMany { service: self.end.spec.action.clone(), limit })
    }

    fn cancel(&mut self, ticket: Ticket) {
        self.end.with(|action| {
            let goal = action.goals.iter().find(|(_, one)| **one == (self.number, ticket));
            let goal = goal.map(|(goal, _)| *goal);
            if let (Some(goal), Some((requests, wake))) = (goal, &mut action.server) {
                requests.push_back(GoalRequest::Cancel(goal));
                wake.ring();
            }
        });
    }

    fn cancel_all(&mut self) -> Result<(), CallError> {
        self.end.with(|action| {
            let goals = action.goals.keys().copied().map(GoalRequest::Cancel);
            if let Some((requests, wake)) = &mut action.server {
                requests.extend(goals.chain([GoalRequest::CancelAll]));
                wake.ring();
            }
        });
        Ok(())
    }

    fn take(&mut self) -> Option<(Ticket, GoalUpdate)> {
        self.end.with(|action| action.clients.get_mut(&self.number)?.0.pop_front())
    }

    fn deadline(&self) -> Option<Instant> {
        None
    }

    fn link(&self) -> Link {
        self.end.link(Role::ActionServer)
    }
}

impl Drop for MemoryActionClient {
    fn drop(&mut self) {
        self.end.with(|action| {
            action.clients.remove(&self.number);
            action.ring();
        });
    }
}

pub(super) struct MemoryActionServer {
    end: End,
    context: Context,
}

impl MemoryActionServer {
    pub(super) fn open(bus: &Arc<Mutex<Bus>>, spec: &ActionSpec, context: &Context) -> Self {
        let end = End::open(bus, spec);
        end.with(|action| {
            action.server = Some((VecDeque::new(), context.wake.clone()));
            action.ring();
        });
        Self { end, context: context.clone() }
    }
}

impl ActionServer for MemoryActionServer {
    fn take(&mut self) -> ServeResult<Option<GoalRequest>> {
        let taken = self.end.with(|action| action.server.as_mut()?.0.pop_front());
        if matches!(taken, Some(GoalRequest::Goal { .. })) {
            self.context.counters.received(0);
        }
        Ok(taken)
    }

    fn update(&mut self, number: GoalNumber, update: GoalUpdate) -> Result<usize, ServeError> {
        self.end.with(|action| action.tell(number, update));
        Ok(0)
    }

    fn kept(&self) -> usize {
        self.end.with(|action| action.goals.len())
    }

    fn deadline(&self) -> Option<Instant> {
        None
    }

    fn link(&self) -> Link {
        self.end.link(Role::ActionClient)
    }
}

impl Drop for MemoryActionServer {
    fn drop(&mut self) {
        self.end.with(|action| {
            action.server = None;
            let goals: Vec<_> = action.goals.keys().copied().collect();
            for goal in goals {
                action.tell(goal, GoalUpdate::aborted("the server has gone"));
            }
            action.ring();
        });
    }
}
