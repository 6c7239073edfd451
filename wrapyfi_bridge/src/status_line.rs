//! Status of routes for programs, a line each time.

use std::borrow::Cow;

use serde::Serialize;
use wrapyfi_engine::RouteStatus;

use crate::visible::escaped;

/// Routes as one JSON object, `{"routes": [...]}`, on a line; with `"panics"` where this process had some.
pub fn json_line(routes: &[RouteStatus], panics: u64) -> Vec<u8> {
    #[derive(Serialize)]
    struct StatusRecord<'a> {
        routes: &'a [RouteStatus],
        #[serde(skip_serializing_if = "Option::is_none")]
        panics: Option<u64>,
    }
    let panics = (panics > 0).then_some(panics);
    // Names are text and counters are numbers: nothing in it can fail.
    let line = serde_json::to_string(&StatusRecord { routes, panics }).unwrap_or_default();
    let shown = match escaped(&line) {
        Cow::Owned(shown) => Some(shown),
        Cow::Borrowed(_) => None,
    };
    let mut line = shown.unwrap_or(line);
    line.push('\n');
    line.into_bytes()
}

#[cfg(test)]
mod tests {
    use wrapyfi_endpoint::{Interaction, Qos, QosPreset};
    use wrapyfi_engine::RouteState;

    use super::*;

    fn route() -> RouteStatus {
        RouteStatus {
            name: "chatter".to_owned(),
            from: "ros2:/chatter".to_owned(),
            to: "zeromq:/chatter".to_owned(),
            interaction: Interaction::Topic,
            message_type: "std_msgs/msg/String",
            state: RouteState::Active,
            has_source: false,
            from_qos: Some(Qos::from(QosPreset::SensorData)),
            to_qos: None,
            counters: Default::default(),
            messages_per_s: 30.0,
            bytes_per_s: 27_648_000,
            panics: 0,
            pattern: None,
        }
    }

    #[test]
    fn panics_are_told_where_there_were_some() {
        let text = |panics| String::from_utf8(json_line(&[], panics)).unwrap();
        assert_eq!(text(0), "{\"routes\":[]}\n");
        assert_eq!(text(2), "{\"routes\":[],\"panics\":2}\n");
    }

    #[test]
    fn a_name_holds_nothing_that_a_terminal_obeys() {
        let name = "/a\x1b\x07\0\u{9b}\u{202e}";
        let status = RouteStatus { name: name.to_owned(), ..route() };
        let line = String::from_utf8(json_line(&[status], 0)).unwrap();
        assert!(!line.trim_end().contains(crate::visible::is_obeyed), "{line:?}");
        let read: serde_json::Value = serde_json::from_str(&line).unwrap();
        assert_eq!(read["routes"][0]["name"], name);
    }

    #[test]
    fn a_route_has_its_rates() {
        let line: serde_json::Value = serde_json::from_slice(&json_line(&[route()], 0)).unwrap();
        let row = &line["routes"][0];
        let rates = (row["messages_per_s"].as_f64(), row["bytes_per_s"].as_u64());
        assert_eq!(rates, (Some(30.0), Some(27_648_000)));
    }
}
