//! Reasons of drops in words, and what mends them.

use wrapyfi_endpoint::DropReason;
use wrapyfi_interfaces::wrapyfi_msgs::msg::RouteInfo;

/// Reasons for which a route has dropped messages, each with their number.
pub(super) fn drops(route: &RouteInfo) -> impl Iterator<Item = (DropReason, u64)> {
    let named = |word: &String| DropReason::ALL.iter().copied().find(|it| it.as_str() == word);
    let pairs = route.drop_reasons.iter().zip(&route.drop_counts);
    pairs.filter_map(move |(word, count)| Some((named(word)?, *count)))
}

/// Number of messages that a route has dropped for a reason.
pub(super) fn count(route: &RouteInfo, reason: DropReason) -> u64 {
    drops(route).find(|(other, _)| *other == reason).map_or(0, |(_, count)| count)
}

/// Meaning of a reason, to follow "because"; `None` where no user misses what is dropped for it, or it is no message.
pub(super) fn meaning(reason: DropReason) -> Option<&'static str> {
    use DropReason as R;
    Some(match reason {
        R::QueueFull | R::BlockDeadline => "the destination is slower than the source",
        R::SendQueueFull | R::SendFailed => "the transport did not take them",
        R::Stalled => "a program that was to get them reads too slowly",
        R::ConnectionLost => "a program that was to get them left before",
        R::Malformed => "their bytes are no message of the route's type",
        R::Mismatch => "they are of another kind, channel count or encoding than the route's",
        R::ServiceMapping => {
            "their clients map services to DDS as another RMW does, and understand no reply"
        }
        R::Oversize => "they are larger than max_message_mib",
        R::Nesting => "lists in them are nested too deep",
        R::Unencodable => "their values have no form at the destination",
        R::OverBudget => "as much waits in the process as may",
        R::Refused => "a node did not set a parameter, or a broker does not let our key publish",
        R::LostUpstream => "DDS lost them before they reached the bridge",
        R::Late | R::Expired => "calls were not answered in time",
        R::Overloaded => "too many calls are under way at once",
        _ => return None,
    })
}

/// Command or line that mends it.
pub(super) fn mends(reason: DropReason) -> &'static str {
    use DropReason as R;
    match reason {
        R::QueueFull | R::BlockDeadline => {
            "`queue_depth: 100` on the route, or `max_rate_hz`, or `overflow: { block_ms: 100 }`, which \
             slows the source down"
        }
        R::SendQueueFull | R::SendFailed => "a greater `depth` of `qos`, or a faster subscriber",
        R::Stalled | R::ConnectionLost => "look at that program",
        R::Malformed => "the type of the route; the log names the field",
        R::Mismatch => "`type` or `encoding` on the route",
        R::ServiceMapping => {
            "export RMW_IMPLEMENTATION where the bridge starts as its clients have it, or the other way round"
        }
        R::Oversize => {
            "a greater `max_message_mib` on the route, which is 64 where none is written: as many MiB as they have"
        }
        R::OverBudget => "`limits: { waiting_mib: 2048 }`, or shorter queues",
        R::LostUpstream => {
            "sysctl -w net.core.rmem_max=4194304, or a greater depth of the publisher"
        }
        R::Late | R::Expired => "`timeout_ms` on the route, or a faster server",
        R::Overloaded => "fewer calls at once",
        R::Refused => "do what the reason says, there",
        _ => "the log of the bridge names the message",
    }
}
