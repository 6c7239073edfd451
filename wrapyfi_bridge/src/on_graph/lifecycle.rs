//! Services of a managed node, and its topic `~/transition_event`, as `rclcpp_lifecycle` has them.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use wrapyfi_data::types::{Map, Value};
use wrapyfi_endpoint::Qos;
use wrapyfi_interfaces::lifecycle_msgs::msg::{
    State as StateMessage, Transition as TransitionMessage, TransitionDescription, TransitionEvent,
};
use wrapyfi_interfaces::lifecycle_msgs::srv::{
    ChangeState, ChangeState_Response, GetAvailableStates, GetAvailableStates_Response,
    GetAvailableTransitions, GetAvailableTransitions_Response, GetState, GetState_Response,
};

use super::{Advertise, Offered, Topic};
use crate::lifecycle::{Lifecycle, Outcome, State, TRANSITIONS, Transition};

/// Longest time that an event waits for a subscription. A caller may reach the service before its subscription is
/// found, where different participants find the two, and the event of its own call would be lost to it.
const WAIT_FOR_SUBSCRIPTION: Duration = Duration::from_secs(3);

/// Endpoints through which others look at the state of a node, and change it.
#[derive(Default)]
pub(crate) struct Managed {
    lifecycle: Lifecycle,
    events: Option<Topic>,
    /// Events that have no listener yet, the oldest first, each with its instant.
    unheard: VecDeque<(Instant, TransitionEvent)>,
    change: Option<Offered>,
    state: Option<Offered>,
    states: Option<Offered>,
    available: Option<Offered>,
    graph: Option<Offered>,
}

impl Managed {
    /// A node whose state no other program sees.
    pub(crate) fn new(lifecycle: Lifecycle) -> Self {
        Self { lifecycle, ..Self::default() }
    }

    /// Opens the endpoints. One that the middleware refuses is missing, which is logged.
    pub(crate) fn open(&mut self, own: &Advertise<'_>) {
        self.events = own.open::<TransitionEvent>("~/transition_event", Qos::default());
        self.change = own.offer::<ChangeState>("change_state");
        self.state = own.offer::<GetState>("get_state");
        self.states = own.offer::<GetAvailableStates>("get_available_states");
        let transitions = |name| own.offer::<GetAvailableTransitions>(name);
        self.available = transitions("get_available_transitions");
        self.graph = transitions("get_transition_graph");
    }

    /// Goes through a transition by itself; true where `work` was a success.
    pub(crate) fn go(
        &mut self,
        transition: Transition,
        work: impl FnMut(State) -> Outcome,
    ) -> bool {
        let success = self.steps(transition, work);
        self.publish_older_than(Duration::ZERO);
        success
    }

    fn steps(&mut self, transition: Transition, work: impl FnMut(State) -> Outcome) -> bool {
        let Self { lifecycle, unheard, .. } = self;
        lifecycle.go(transition, work, |step| {
            tracing::debug!("{} -> {}", step.start.label(), step.goal.label());
            // Time and transition stay empty, as rclcpp_lifecycle leaves them.
            let event = TransitionEvent {
                start_state: state(step.start),
                goal_state: state(step.goal),
                ..TransitionEvent::default()
            };
            unheard.push_back((Instant::now(), event));
        })
    }

    /// Publishes the events that have a listener, or that have waited for that long.
    fn publish_older_than(&mut self, limit: Duration) {
        let Some(events) = &mut self.events else { return self.unheard.clear() };
        let is_heard = events.publisher.link().peers != Some(0);
        while let Some((at, event)) = self.unheard.front() {
            if !is_heard && at.elapsed() < limit {
                break;
            }
            events.publish(event);
            self.unheard.pop_front();
        }
    }

    /// Answers those who asked. `work` does what an intermediate state is for.
    pub(crate) fn answer(&mut self, mut work: impl FnMut(State) -> Outcome) {
        // Apart while the transition is under way.
        let mut change = self.change.take();
        if let Some(change) = &mut change {
            while let Some(asked) = change.next() {
                let call = asked.request.into_call().unwrap_or_default();
                let success = match self.wanted(&call.kwargs) {
                    Ok(transition) => self.steps(transition, &mut work),
                    Err(why) => {
                        tracing::warn!("{why}");
                        false
                    }
                };
                change.tell(asked.id, &ChangeState_Response { success });
            }
        }
        self.change = change;
        self.publish_older_than(WAIT_FOR_SUBSCRIPTION);
        let current_state = state(self.lifecycle.state());
        each(&mut self.state, || GetState_Response { current_state: current_state.clone() });
        each(&mut self.states, || GetAvailableStates_Response {
            available_states: State::ALL.into_iter().map(state).collect(),
        });
        let available = self.lifecycle.available();
        let available: Vec<_> = available.map(described).collect();
        each(&mut self.available, || GetAvailableTransitions_Response {
            available_transitions: available.clone(),
        });
        each(&mut self.graph, || GetAvailableTransitions_Response {
            available_transitions: TRANSITIONS.into_iter().map(described).collect(),
        });
    }

    /// The transition that a request means.
    fn wanted(&self, fields: &Map) -> Result<Transition, String> {
        let asked = fields.get("transition").and_then(Value::as_map);
        let field = |name| asked.and_then(|asked| asked.get(name));
        let id = field("id").and_then(Value::as_i64).and_then(|id| u8::try_from(id).ok());
        let (id, label) = (id.unwrap_or_default(), field("label").and_then(Value::as_str));
        let label = label.unwrap_or_default();
        self.lifecycle.asked(id, label).ok_or_else(|| {
            let asked = if label.is_empty() { id.to_string() } else { label.to_owned() };
            let all: Vec<_> =
                self.lifecycle.available().map(|it| format!("{} [{}]", it.label, it.id)).collect();
            let state = self.lifecycle.state().label();
            format!("no transition {asked} from state {state}; there are: {}", all.join(", "))
        })
    }
}

/// Gives all who asked the same reply.
fn each<R: wrapyfi_interfaces::Message>(offered: &mut Option<Offered>, reply: impl Fn() -> R) {
    let Some(offered) = offered else { return };
    while let Some(asked) = offered.next() {
        offered.tell(asked.id, &reply());
    }
}

fn state(state: State) -> StateMessage {
    StateMessage { id: state.id(), label: state.label().to_owned() }
}

fn described(one: Transition) -> TransitionDescription {
    TransitionDescription {
        transition: TransitionMessage { id: one.id, label: one.label.to_owned() },
        start_state: state(one.start),
        goal_state: state(one.goal),
    }
}
