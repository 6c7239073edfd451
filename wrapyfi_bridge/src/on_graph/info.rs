//! Statuses and diagnoses as messages of `wrapyfi_msgs`, and back.

use wrapyfi_data::types::MessageType;
use wrapyfi_endpoint::{Cause, CauseCode, CountersSnapshot, DropReason, Role};
use wrapyfi_engine::RouteStatus;
use wrapyfi_interfaces::wrapyfi_msgs::msg::RouteInfo;
use wrapyfi_interfaces::wrapyfi_msgs::srv::Explain_Response;

use crate::node::Node;
use crate::why::Diagnosis;

/// State and counters of the routes of the bridge with this `node` as messages.
pub fn of_all(routes: &[RouteStatus], node: &Node) -> Vec<RouteInfo> {
    routes.iter().map(|status| of(status, node)).collect()
}

/// As [`of_all`], of one route.
fn of(status: &RouteStatus, node: &Node) -> RouteInfo {
    let CountersSnapshot { received, sent, sent_bytes, drops, goals, latency, refused, .. } =
        &status.counters;
    // What was lost before it arrived never arrived.
    let arrived = drops.iter().filter(|(reason, _)| *reason != DropReason::LostUpstream);
    let gone = arrived.map(|(_, count)| count).sum::<u64>().saturating_add(*sent);
    let resolved = |end: &String| match end.parse() {
        Ok(address) => node.resolve(&address).to_string(),
        Err(_) => end.clone(),
    };
    let info = RouteInfo {
        key: status.name.clone(),
        source: status.from.clone(),
        destination: status.to.clone(),
        resolved_source: resolved(&status.from),
        resolved_destination: resolved(&status.to),
        kind: status.interaction.to_string(),
        type_name: match status.message_type.parse::<MessageType>() {
            Ok(known) => known.ros_type().to_owned(),
            Err(_) => status.message_type.to_owned(),
        },
        state: status.state.word().to_owned(),
        has_source: status.has_source,
        received: *received,
        sent: *sent,
        sent_bytes: *sent_bytes,
        messages_per_s: status.messages_per_s,
        bytes_per_s: status.bytes_per_s,
        dropped: status.counters.dropped(),
        drop_reasons: drops.iter().map(|(reason, _)| reason.to_string()).collect(),
        drop_counts: drops.iter().map(|(_, count)| *count).collect(),
        goal_events: goals.iter().map(|(event, _)| event.to_string()).collect(),
        goal_counts: goals.iter().map(|(_, count)| *count).collect(),
        queued: received.saturating_sub(gone),
        latency_p50_us: latency.p50_us,
        latency_p99_us: latency.p99_us,
        refused: refused.as_ref().map(|it| it.who.clone()).unwrap_or_default(),
        refused_roles: refused.iter().flat_map(|it| &it.roles).map(Role::to_string).collect(),
        allow: refused.as_ref().map(|it| it.allow.clone()).unwrap_or_default(),
        ..RouteInfo::default()
    };
    caused(info, status.state.cause())
}

/// A route with the cause of its state.
pub(crate) fn caused(info: RouteInfo, cause: Option<&Cause>) -> RouteInfo {
    let Some(cause) = cause else { return info };
    RouteInfo {
        reason: cause.to_string(),
        cause: cause.code().to_string(),
        cause_subject: cause.subject(),
        cause_theirs: cause.theirs(),
        cause_ours: cause.ours(),
        ..info
    }
}

/// Kind of the cause for which a route is not active; `None` where it is.
pub(crate) fn cause(running: &RouteInfo) -> Option<CauseCode> {
    (!running.cause.is_empty()).then(|| running.cause.as_str().into())
}

/// True where an address is the one at which messages come in, or calls, as the file or as the bridge's node has it.
pub(crate) fn is_source(running: &RouteInfo, address: &str) -> bool {
    running.source == address || running.resolved_source == address
}

/// True where an address is the one at which messages go out, or calls, as the file or as the bridge's node has it.
pub(crate) fn is_destination(running: &RouteInfo, address: &str) -> bool {
    running.destination == address || running.resolved_destination == address
}

/// A diagnosis as the reply of `~/explain`, with the routes that it is about.
pub fn explained(diagnosis: &Diagnosis, routes: Vec<RouteInfo>) -> Explain_Response {
    let mut reply = Explain_Response {
        known: true,
        way: diagnosis.way.clone(),
        passed: diagnosis.passed.clone(),
        routes,
        ..Explain_Response::default()
    };
    if let Some(finding) = &diagnosis.finding {
        reply.cause = finding.cause.to_string();
        reply.what.clone_from(&finding.what);
        reply.who.clone_from(&finding.who);
        reply.remedy.clone_from(&finding.remedy);
    }
    reply
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::sync::Arc;

    use wrapyfi_endpoint::Interaction;
    use wrapyfi_engine::RouteState;
    use wrapyfi_node::NodeName;
    use wrapyfi_node::args::RosArgs;

    use super::*;
    use crate::why::Finding;

    fn status() -> RouteStatus {
        RouteStatus {
            name: "talk".to_owned(),
            from: "ros2:/a".to_owned(),
            to: "zeromq:/a".to_owned(),
            interaction: Interaction::Topic,
            message_type: "Text",
            state: RouteState::Degraded(Cause::Limit {
                at: "ros2:/*".to_owned(),
                limit: 1,
                more: 2,
            }),
            has_source: false,
            from_qos: None,
            to_qos: None,
            counters: CountersSnapshot {
                received: 10,
                sent: 4,
                sent_bytes: 40,
                drops: vec![(DropReason::QueueFull, 3), (DropReason::LostUpstream, 7)],
                ..CountersSnapshot::default()
            },
            messages_per_s: 2.5,
            bytes_per_s: 25,
            panics: 0,
            pattern: None,
        }
    }

    #[test]
    fn what_is_neither_sent_nor_dropped_is_queued() {
        let info = of(&status(), &Node::bridge().unwrap());
        assert_eq!((info.dropped, info.queued), (10, 3));
        assert_eq!((info.messages_per_s, info.bytes_per_s), (2.5, 25));
        assert_eq!(info.type_name, "std_msgs/msg/String");
        assert_eq!(info.drop_reasons, ["queue_full", "lost_upstream"]);
        assert_eq!(info.drop_counts, [3, 7]);
        let reason = "1 is the limit of routes (max_routes), 2 more names match";
        assert_eq!((info.state.as_str(), info.reason.as_str()), ("degraded", reason));
        assert_eq!(cause(&info), Some(CauseCode::Limit));
        assert_eq!(
            [&*info.cause_subject, &*info.cause_theirs, &*info.cause_ours],
            ["ros2:/*", "2", "1"]
        );
    }

    #[test]
    fn ends_are_told_by_the_names_that_the_node_has_for_them() {
        let words = ["bridge", "--ros-args", "-r", "/a:=/b"].map(str::to_owned);
        let args = RosArgs::parse(words, |_path| Err(std::io::ErrorKind::NotFound.into())).unwrap();
        let name = NodeName::new("bridge", "/lab").unwrap();
        let node = Node { name, args: Arc::new(args), overrides: BTreeMap::new() };
        let info = of(&RouteStatus { to: "ros2:words".to_owned(), ..status() }, &node);
        assert_eq!((info.source.as_str(), info.resolved_source.as_str()), ("ros2:/a", "ros2:/b"));
        assert_eq!(info.resolved_destination, "ros2:/lab/words");
        assert!(is_source(&info, "ros2:/b") && !is_source(&info, "ros2:/lab/words"));
    }

    #[test]
    fn a_diagnosis_is_told_in_full() {
        let finding = Finding {
            cause: CauseCode::NobodyPublishes,
            what: "nobody publishes ros2:/a".to_owned(),
            who: "a node".to_owned(),
            remedy: "start it".to_owned(),
        };
        let diagnosis = Diagnosis {
            way: "talk".to_owned(),
            passed: vec!["x".to_owned()],
            finding: Some(finding),
        };
        let reply = explained(&diagnosis, vec![of(&status(), &Node::bridge().unwrap())]);
        assert!(reply.known);
        assert_eq!(reply.cause, "nobody_publishes");
        assert_eq!(reply.remedy, "start it");
        assert_eq!(reply.routes.len(), 1);
    }
}
