//! Policy of SROS 2 that lets a bridge do what its routes need, and nothing else: `wrapyfi check FILE
//! --print-sros2-policy`.
//!
//! ```text
//!   from ros2:/a     ─▶ subscribe /a          service at ros2:/s       ─▶ request /s
//!   to   ros2:/a     ─▶ publish   /a          service as ros2:/s       ─▶ reply   /s
//!   by pattern       ─▶ the part before the first group, then *
//!   the node itself  ─▶ its log, parameters, clock, diagnostics, and everything below its name
//! ```
//!
//! `ros2 security create_permission KEYSTORE ENCLAVE POLICY` makes permissions of it.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

use wrapyfi_data::types::MessageType;
use wrapyfi_endpoint::{EndpointAddress, Interaction};
use wrapyfi_engine::{Plan, Route, Types};

use crate::node::{GRAPH, Node};
use crate::on_graph::circles;

/// Kind of names, and what is allowed with them, in the words of a policy.
type Rule = (&'static str, &'static str);
const PUBLISH: Rule = ("topic", "publish");
const SUBSCRIBE: Rule = ("topic", "subscribe");
const REPLY: Rule = ("service", "reply");
const REQUEST: Rule = ("service", "request");
const CALL: Rule = ("action", "call");
const EXECUTE: Rule = ("action", "execute");

/// Writes the policy of the bridge `node` with the routes of `plan`.
pub fn policy(node: &Node, plan: &Plan) -> String {
    let own = format!("{}/*", node.name().fqn());
    let mut rules = BTreeMap::<Rule, BTreeSet<String>>::new();
    let mut allow = |rule: Rule, name: String| rules.entry(rule).or_default().insert(name);
    for (rule, name) in [
        (PUBLISH, "/rosout"),
        (PUBLISH, "/parameter_events"),
        (PUBLISH, "/diagnostics"),
        (PUBLISH, &own),
        // Marks of bridges, where the middleware of a ROS 2 carries them.
        (PUBLISH, "/_wrapyfi_marks"),
        (SUBSCRIBE, "/_wrapyfi_marks"),
        (PUBLISH, circles::TOPIC),
        (SUBSCRIBE, circles::TOPIC),
        (SUBSCRIBE, "/clock"),
        (REPLY, &own),
    ] {
        allow(rule, name.to_owned());
    }
    for route in &plan.routes {
        let ends = [(&route.from, true), (&route.to, false)];
        for (end, is_source) in ends.into_iter().filter(|(end, _)| end.middleware == GRAPH) {
            let name = name(node, route, end);
            let Types { from, to } = route.message_types();
            match route.interaction() {
                // Parameters are not a topic: they are asked for and set through the services of their node.
                _ if [from, to].contains(&MessageType::Properties) => {
                    allow(SUBSCRIBE, "/parameter_events".to_owned());
                    allow(REQUEST, format!("{name}/*"));
                }
                Interaction::Topic => {
                    _ = allow(if is_source { SUBSCRIBE } else { PUBLISH }, name);
                }
                Interaction::Service => {
                    _ = allow(if is_source { REQUEST } else { REPLY }, name);
                }
                Interaction::Action => {
                    _ = allow(if is_source { CALL } else { EXECUTE }, name);
                }
            }
        }
    }
    let (namespace, base) = (node.name().namespace(), node.name().name());
    let mut text = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<policy version=\"0.2.0\">\n  <enclaves>\n    <enclave path=\"{}\">\n      \
         <profiles>\n        <profile ns=\"{namespace}\" node=\"{base}\">\n",
        enclave(node)
    );
    for ((kind, action), names) in &rules {
        _ = writeln!(text, "          <{kind}s {action}=\"ALLOW\">");
        for name in names {
            _ = writeln!(text, "            <{kind}>{name}</{kind}>");
        }
        _ = writeln!(text, "          </{kind}s>");
    }
    text += "        </profile>\n      </profiles>\n    </enclave>\n  </enclaves>\n</policy>";
    text
}

/// Enclave that the node is told, else one of its name.
fn enclave(node: &Node) -> String {
    if node.args.enclave == "/" { node.name().fqn() } else { node.args.enclave.clone() }
}

/// Name on the graph; of a pattern, what all its names begin with, and a star. Only characters of names come
/// out, whatever an expression has.
fn name(node: &Node, route: &Route, end: &EndpointAddress) -> String {
    if !route.is_many() {
        return node.resolve(end).name;
    }
    let is_plain = |letter: &char| letter.is_ascii_alphanumeric() || "_/".contains(*letter);
    let begin: String = end.name.trim_start_matches('^').chars().take_while(is_plain).collect();
    format!("/{}*", begin.trim_start_matches('/'))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "in a test a panic is the right answer")]
mod tests {
    use super::*;
    use wrapyfi_data::types::ServiceKind;
    use wrapyfi_engine::RouteTypes;

    #[test]
    fn names_are_allowed_as_routes_use_them() {
        let address = |text: &str| text.parse::<EndpointAddress>().unwrap();
        let topic = |from, to, kind| Route::topic(address(from), address(to), kind);
        let routes = vec![
            topic("zeromq:/cam", "ros2:/cam/image_raw", MessageType::Image),
            topic("ros2:/chatter", "zeromq:/chatter", MessageType::Text),
            topic("ros2:/arm", "zeromq:/arm", MessageType::Properties),
            Route::service(
                address("zeromq:/light"),
                address("ros2:/light"),
                ServiceKind::NativeObject,
            ),
            Route::service(
                address("ros2:/lamp"),
                address("zeromq:/lamp"),
                ServiceKind::NativeObject,
            ),
        ];
        let mut routes = routes;
        for (from, to) in [("ros:/go", "ros2:/go"), ("ros2:/dock", "ros:/dock")] {
            let mut route = Route::topic(address(from), address(to), MessageType::Text);
            route.types = RouteTypes::Action(None);
            routes.push(route);
        }
        let text = policy(&Node::named("bridge").unwrap(), &Plan { routes });
        for (rule, name) in [
            ("<topics publish=\"ALLOW\">", "<topic>/cam/image_raw</topic>"),
            ("<topics publish=\"ALLOW\">", "<topic>/bridge/*</topic>"),
            ("<topics subscribe=\"ALLOW\">", "<topic>/chatter</topic>"),
            ("<topics subscribe=\"ALLOW\">", "<topic>/parameter_events</topic>"),
            ("<services reply=\"ALLOW\">", "<service>/light</service>"),
            ("<services request=\"ALLOW\">", "<service>/lamp</service>"),
            ("<services request=\"ALLOW\">", "<service>/arm/*</service>"),
            ("<actions execute=\"ALLOW\">", "<action>/go</action>"),
            ("<actions call=\"ALLOW\">", "<action>/dock</action>"),
        ] {
            let (_, after) = text.split_once(rule).unwrap_or_else(|| panic!("no {rule} in {text}"));
            let (block, _) = after.split_once("ALLOW\">").unwrap_or((after, ""));
            assert!(block.contains(name), "{name} is not in {rule}{block}");
        }
        assert!(text.contains("<enclave path=\"/bridge\">"), "{text}");
        assert_eq!(text.matches("<topic>/chatter</topic>").count(), 1, "{text}");
    }
}
