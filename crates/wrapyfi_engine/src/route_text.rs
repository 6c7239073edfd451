//! Texts of a route: one line for people, and its entry in a configuration.

use std::fmt;

use serde::ser::{Serialize, SerializeMap as _, Serializer};

use super::config_qos::QosConfig;
use super::route::{Names, Route, RouteTypes, Typing};
use wrapyfi_data::types::Encoding;
use wrapyfi_endpoint::Overflow;
use wrapyfi_endpoint::pattern::NamePattern;

impl Route {
    /// Writes the settings of a route of messages that runs as it stands.
    fn show_settings(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let policy = &self.policy;
        write!(f, "  queue {} ", policy.queue.depth)?;
        match policy.queue.overflow {
            Overflow::DropOldest => write!(f, "drop_oldest")?,
            Overflow::DropNewest => write!(f, "drop_newest")?,
            Overflow::Block(deadline) => write!(f, "block {} ms", deadline.as_millis())?,
        }
        // Quality of service that follows the peers is the default, and not written.
        if let QosConfig::Fixed(qos) = policy.qos {
            write!(f, "  qos {qos}")?;
        }
        if let Some(hz) = policy.max_rate_hz {
            write!(f, "  at most {hz} Hz")?;
        }
        if !policy.loop_guard {
            f.write_str("  no loop guard")?;
        }
        if policy.color_order != Encoding::Bgr8 {
            write!(f, "  encoding {}", policy.color_order)?;
        }
        Ok(())
    }
}

impl fmt::Display for Route {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { types, typing, policy, .. } = self;
        write!(f, "{}  {}  ", self.ends(), self.interaction())?;
        match (typing, types) {
            (Typing::Learned | Typing::LearnedIfTold, _) => f.write_str("type learned")?,
            (_, RouteTypes::Topic(types)) if types.from != types.to => {
                write!(f, "{} as {}", types.from.label(), types.to.label())?;
            }
            _ => f.write_str(self.label())?,
        }
        match types {
            _ if !self.is_whole() => {}
            RouteTypes::Topic(_) => self.show_settings(f)?,
            RouteTypes::Service(_) => {
                write!(f, "  within {} ms", policy.answer_within().as_millis())?;
            }
            RouteTypes::Action(_) => {
                if let Some(timeout) = policy.timeout {
                    write!(f, "  within {} ms", timeout.as_millis())?;
                }
            }
        }
        if let Some(frame_id) = &policy.frame_id {
            write!(f, "  frame_id {frame_id}")?;
        }
        if let Some(stamp) = policy.stamp {
            write!(f, "  stamp {stamp}")?;
        }
        if self.is_whole() {
            if let Some(devices) = policy.plugins.devices() {
                write!(f, "  devices {devices}")?;
            }
            return if policy.lazy { f.write_str("  lazy") } else { Ok(()) };
        }
        let Some(Names { allow, deny, max_routes, .. }) = &self.names else { return Ok(()) };
        for (word, list) in [("allow", allow), ("deny", deny)] {
            if !list.is_empty() {
                write!(f, "  {word} {}", written(list).join(" "))?;
            }
        }
        write!(f, "  at most {max_routes} routes")
    }
}

fn written(list: &[NamePattern]) -> Vec<String> {
    list.iter().map(NamePattern::to_string).collect()
}

/// Serialises a route as its entry in a configuration, with the same keys for all routes of an interaction.
impl Serialize for Route {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Self { name, from, to, names, types, typing, policy, mark } = self;
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("name", name)?;
        let [from_key, to_key] = self.interaction().keys();
        map.serialize_entry(from_key, &from.to_string())?;
        map.serialize_entry(to_key, &to.to_string())?;
        match typing {
            Typing::Given => map.serialize_entry("type", self.label())?,
            Typing::Learned => {}
            Typing::LearnedIfTold => map.serialize_entry("type_if_unknown", self.label())?,
        }
        if let Some(Names { allow, deny, default_deny, max_routes, .. }) = names {
            map.serialize_entry("allow", &written(allow))?;
            map.serialize_entry("deny", &written(deny))?;
            map.serialize_entry("default_deny", &default_deny.is_some())?;
            map.serialize_entry("max_routes", max_routes)?;
        }
        match types {
            RouteTypes::Topic(types) => {
                map.serialize_entry("from_type", types.from.label())?;
                map.serialize_entry("qos", &policy.qos.qos())?;
                let is_matched = matches!(policy.qos, QosConfig::Match(_));
                map.serialize_entry("qos_match", &is_matched)?;
                map.serialize_entry("queue_depth", &policy.queue.depth)?;
                map.serialize_entry("overflow", &format!("{:?}", policy.queue.overflow))?;
                map.serialize_entry("max_rate_hz", &policy.max_rate_hz)?;
                map.serialize_entry("loop_guard", &policy.loop_guard)?;
                map.serialize_entry("encoding", &policy.color_order.to_string())?;
                map.serialize_entry("frame_id", &policy.frame_id)?;
                map.serialize_entry("stamp", &policy.stamp.map(|it| it.to_string()))?;
                let devices = policy.plugins.devices().map(ToString::to_string);
                map.serialize_entry("devices", &devices)?;
                map.serialize_entry("lazy", &policy.lazy)?;
            }
            RouteTypes::Service(_) => {
                map.serialize_entry("timeout_ms", &policy.answer_within().as_millis())?;
            }
            RouteTypes::Action(_) => {
                let timeout = policy.timeout.map(|timeout| timeout.as_millis());
                map.serialize_entry("timeout_ms", &timeout)?;
            }
        }
        map.serialize_entry("max_message_bytes", &policy.limits.message_bytes)?;
        let option = |(name, value): (&_, &_)| format!("{name:?}: {value:?}");
        map.serialize_entry("options", &policy.options.iter().map(option).collect::<Vec<_>>())?;
        map.serialize_entry("mark", mark)?;
        map.end()
    }
}
