//! Parts of an action on ROS 2: their names and types, and the states of goals.
//!
//! ```text
//!   /fibonacci ─┬─ services  /fibonacci/_action/{send_goal, cancel_goal, get_result}
//!               └─ topics    /fibonacci/_action/{feedback, status}
//!
//!   unknown ─▶ accepted ─▶ executing ─┬──────────────▶ succeeded, aborted
//!                  └───────────┬──────┴▶ canceling ──▶ canceled, succeeded, aborted
//! ```
//!
//! A goal and its feedback are the same bytes inside the message that carries them: the id before them is as long as the
//! widest alignment of CDR asks for.

use std::time::Duration;

use wrapyfi_interfaces::action_msgs::msg::{GoalStatus, GoalStatusArray};
use wrapyfi_interfaces::action_msgs::srv::CancelGoal;

use super::ros2::NAME;
use wrapyfi_data::DecodeResult;
use wrapyfi_data::types::{
    MessageType, RosMessage, RosService, RosType, RosTypeError, ServiceKind,
};
use wrapyfi_endpoint::codec::ros;
use wrapyfi_endpoint::{
    ActionSpec, Context, History, OpenError, OpenResult, Overflow, Qos, QosPreset, QueueSpec,
    ServiceSpec, TopicSpec,
};

/// Between the name of an action and those of its parts.
pub(super) const INFIX: &str = "/_action/";
/// Names of the parts, the services first.
pub(super) const PARTS: [&str; 5] =
    ["send_goal", "cancel_goal", "get_result", "feedback", "status"];
/// Number of the services among the parts.
pub(super) const SERVICES: usize = 3;
/// Length of the encapsulation header of CDR.
const HEADER: usize = 4;
/// Messages of feedback and of status that wait for the owner of a client.
const WAITING: usize = 1000;
/// Feedback that the middleware keeps while a reader is behind. Nodes of ROS 2 keep 10, and lose what comes while a thread
/// waits for a core; ends of different depths fit each other.
const FEEDBACK_KEPT: u32 = 1000;

/// Identity of a goal, a UUID.
pub(super) type GoalId = [u8; 16];

/// Specifications of the five parts of an action.
pub(super) struct Parts {
    pub(super) send_goal: ServiceSpec,
    pub(super) cancel_goal: ServiceSpec,
    pub(super) get_result: ServiceSpec,
    pub(super) feedback: TopicSpec,
    pub(super) status: TopicSpec,
    /// Type of `cancel_goal`.
    pub(super) cancel: RosService,
    /// Type of `status`.
    pub(super) states: RosType,
}

impl Parts {
    /// The parts of an action. No request to a server ends by its time: a goal may last for hours.
    ///
    /// # Errors
    /// When the types that all actions have in common cannot be used.
    pub(super) fn of(spec: &ActionSpec) -> OpenResult<Self> {
        let unusable =
            |error: RosTypeError| OpenError::transport(NAME, &spec.action, error.to_string());
        let cancel = RosService::of::<CancelGoal>().map_err(unusable)?;
        let states = RosType::of::<GoalStatusArray>().map_err(unusable)?;
        let [send_goal, cancel_goal, get_result, feedback, status] = PARTS;
        let name = |part: &str| format!("{}{INFIX}{part}", spec.action);
        let service = |part: &str, service: RosService, pending: usize| ServiceSpec {
            timeout: Duration::MAX,
            pending,
            limits: spec.limits,
            plugins: spec.plugins.clone(),
            options: spec.options.clone(),
            mark: spec.mark.clone(),
            ..ServiceSpec::new(name(part), ServiceKind::Ros(service))
        };
        let topic = |part: &str, ros_type: RosType, qos: Qos| TopicSpec {
            qos,
            queue: QueueSpec { depth: WAITING, overflow: Overflow::DropOldest },
            limits: spec.limits,
            plugins: spec.plugins.clone(),
            mark: spec.mark.clone(),
            ..TopicSpec::new(name(part), MessageType::Ros(ros_type))
        };
        let kept = Qos { history: History::KeepLast(FEEDBACK_KEPT), ..Qos::default() };
        // Results of goals that have ended are asked for beside those of goals that go on.
        let results = spec.goals.saturating_mul(2);
        Ok(Self {
            send_goal: service(send_goal, spec.kind.send_goal(), spec.goals),
            cancel_goal: service(cancel_goal, cancel, spec.goals),
            get_result: service(get_result, spec.kind.get_result(), results),
            feedback: topic(feedback, spec.kind.feedback_message(), kept),
            status: topic(status, states, QosPreset::Latched.into()),
            cancel,
            states,
        })
    }
}

/// Context of the parts: the bell and the clock of the action, and counters of their own.
pub(super) fn context_of_parts(context: &Context) -> Context {
    Context { counters: Default::default(), ..context.clone() }
}

/// Puts the id of a goal before its goal or feedback, which gives a message of type `ros_type`.
pub(super) fn with_id(id: &GoalId, body: &RosMessage, ros_type: RosType) -> RosMessage {
    let (header, fields) = body.cdr.split_at_checked(HEADER).unwrap_or_default();
    RosMessage::new(ros_type, [header, id, fields].concat())
}

/// Takes the id of a goal from the front of a message; what follows is of type `ros_type`.
///
/// # Errors
/// When the bytes cannot be such a message.
pub(super) fn split_id(
    message: &RosMessage,
    ros_type: RosType,
    most: usize,
) -> DecodeResult<(GoalId, RosMessage)> {
    message.check(most).map_err(|error| ros::fault(&error))?;
    let (header, rest) = message.cdr.split_at_checked(HEADER).unwrap_or_default();
    let (id, fields) = rest.split_first_chunk().unwrap_or((&[0; 16], &[]));
    Ok((*id, RosMessage::new(ros_type, [header, fields].concat())))
}

/// State that follows `from` on the way to `to`; `None` where a goal is there, or cannot come there any more.
pub(super) fn next_state(from: i8, to: i8) -> Option<i8> {
    type S = GoalStatus;
    match (from, to) {
        (S::STATUS_UNKNOWN, S::STATUS_ACCEPTED..=S::STATUS_ABORTED) => Some(S::STATUS_ACCEPTED),
        (S::STATUS_ACCEPTED, S::STATUS_EXECUTING | S::STATUS_SUCCEEDED | S::STATUS_ABORTED) => {
            Some(S::STATUS_EXECUTING)
        }
        (S::STATUS_ACCEPTED | S::STATUS_EXECUTING, S::STATUS_CANCELING | S::STATUS_CANCELED) => {
            Some(S::STATUS_CANCELING)
        }
        (S::STATUS_EXECUTING, S::STATUS_SUCCEEDED | S::STATUS_ABORTED)
        | (S::STATUS_CANCELING, S::STATUS_SUCCEEDED | S::STATUS_CANCELED | S::STATUS_ABORTED) => {
            Some(to)
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn types_of_all_actions_have_the_hashes_of_ros() {
        let cancel_goal = RosService::of::<CancelGoal>().unwrap();
        let status = RosType::of::<GoalStatusArray>().unwrap();
        let cancel = "RIHS01_573d8b0a534451d7bc2ac8c5ffde8ac14b8593b7001175d0cd6516dcbeb8689a";
        let array = "RIHS01_6c1684b00f177d37438febe6e709fc4e2b0d4248dca4854946f9ed8b30cda83e";
        assert_eq!(cancel_goal.resolved().type_hash(), cancel);
        assert_eq!(status.type_hash(), array);
    }

    #[test]
    fn every_end_is_reached_over_the_states_before_it() {
        let way = |mut from, to| {
            let mut states = Vec::new();
            while let Some(next) = next_state(from, to) {
                states.push(next);
                from = next;
            }
            states
        };
        for (from, to, passed) in [
            (0, 4, &[1, 2, 4][..]),
            (0, 5, &[1, 3, 5]),
            (1, 6, &[2, 6]),
            (2, 3, &[3]),
            (3, 4, &[4]),
            (3, 2, &[]),
            (2, 1, &[]),
            (4, 6, &[]),
            (0, 7, &[]),
            (0, -1, &[]),
        ] {
            assert_eq!(way(from, to), passed, "{from} to {to}");
        }
    }
}
