//! Reason that a pattern has no route for a name.

use wrapyfi_endpoint::pattern::bare;
use wrapyfi_endpoint::{Conventions, Interaction};

use super::route::{Names, Route};

/// Reason that a pattern leaves out a name which it matches.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum LeftOut {
    /// The name is hidden, or every node has one like it: `default_deny` is on.
    ByDefault,
    /// `allow` has entries, and none matches.
    NotAllowed,
    /// This entry of `deny` matches.
    Denied(String),
    /// A route that is written has one of its ends: the name of that route.
    Written(String),
}

/// Topics that every node has, and those that two programs would feed each other for ever.
const NODE_TOPICS: [&str; 4] = ["rosout", "rosout_agg", "clock", "parameter_events"];

impl Route {
    /// Reason that the pattern leaves out a name which its `from` (or `service`) matches; `None` where
    /// the name has a route, or is none of the pattern's.
    #[doc(hidden)]
    pub fn left_out(&self, name: &str) -> Option<LeftOut> {
        let Names { pattern, allow, deny, default_deny, .. } = self.names.as_ref()?;
        if !pattern.matches(name) {
            return None;
        }
        if let Some(entry) = deny.iter().find(|one| one.matches(name)) {
            return Some(LeftOut::Denied(entry.to_string()));
        }
        if !allow.is_empty() && !allow.iter().any(|one| one.matches(name)) {
            return Some(LeftOut::NotAllowed);
        }
        default_deny.filter(|usual| self.is_usual(usual, name)).map(|_| LeftOut::ByDefault)
    }

    /// As [`Route::left_out`], for a name at the destination: with the name at the source that leads there.
    #[doc(hidden)]
    pub fn left_out_to(&self, name: &str) -> Option<(String, LeftOut)> {
        let inverse = self.inverse()?;
        if self.source(&inverse, name).is_some() {
            return None;
        }
        let source = inverse.source(name)?;
        let why = self.left_out(&source)?;
        Some((format!("{}:{source}", self.from.middleware), why))
    }

    /// True for hidden names, of which a part begins with `_`, and for those that every program has about itself. A digit
    /// behind the `_` is what has become of a name that begins with it.
    fn is_usual(&self, usual: &Conventions, name: &str) -> bool {
        let bare = bare(name);
        let is_hidden = |part: &str| {
            let rest = part.strip_prefix('_');
            rest.is_some_and(|rest| !rest.starts_with(|first: char| first.is_ascii_digit()))
        };
        bare.split('/').any(is_hidden)
            || match self.interaction() {
                Interaction::Topic => {
                    NODE_TOPICS.contains(&bare)
                        || usual.program_topics.iter().any(|prefix| bare.starts_with(prefix))
                }
                Interaction::Service => bare.rsplit('/').next().is_some_and(|last| {
                    usual.node_services.iter().any(|services| services.contains(&last))
                }),
                Interaction::Action => false,
            }
    }
}

#[cfg(test)]
mod tests {
    use wrapyfi_interfaces::store::TypeStore;

    use super::super::config::Config;
    use super::super::plan::Plan;
    use super::*;
    use wrapyfi_endpoint::driver::Available;

    #[test]
    fn the_entry_that_leaves_a_name_out_is_named() {
        let route =
            "from: 'a:/(.*)', to: 'b:/$1', allow: ['cam/.*', '_x', 'rosout'], deny: ['cam/raw']";
        let yaml = format!("routes:\n  - {{ {route} }}\n");
        let config: Config<()> = Config::from_yaml(&yaml, "x.yaml").unwrap();
        let available = ["a", "b"].map(|name| Available { name, ..Available::default() });
        let plan = Plan::new(&config, &available, &mut TypeStore::generated(), "x.yaml").unwrap();
        let pattern = &plan.routes[0];
        for (name, reason) in [
            ("/cam/left", None),
            ("/cam/raw", Some(LeftOut::Denied("cam/raw".to_owned()))),
            ("/mic", Some(LeftOut::NotAllowed)),
            ("/rosout", Some(LeftOut::ByDefault)),
        ] {
            assert_eq!(pattern.left_out(name), reason, "{name}");
            assert_eq!(pattern.target(name).is_none(), reason.is_some(), "{name}");
            let told = reason.map(|reason| (format!("a:{name}"), reason));
            assert_eq!(pattern.left_out_to(name), told, "{name}");
        }
    }

    /// True where routes for all topics, or services, of a middleware with these conventions have one for the name.
    fn has_route(usual: Conventions, ends: &str, name: &str) -> bool {
        let config: Config<()> =
            Config::from_yaml(&format!("routes:\n  - {{ {ends} }}\n"), "x.yaml").unwrap();
        let available =
            ["a", "b"].map(|name| Available { name, conventions: usual, ..Available::default() });
        let plan = Plan::new(&config, &available, &mut TypeStore::generated(), "x.yaml").unwrap();
        plan.routes[0].target(name).is_some()
    }

    #[test]
    fn some_are_left_out_by_default() {
        const TOPICS: &str = "from: 'a:/(.*)', to: 'b:/$1'";
        const SERVICES: &str = "service: 'a:/(.*)', as: 'b:/$1'";
        let usual = Conventions::NONE;
        for name in ["/rosout", "/rosout_agg", "/clock", "/parameter_events", "/_x", "/a/_action/b"]
        {
            assert!(!has_route(usual, TOPICS, name), "{name}");
        }
        for name in ["/tf", "/tf2", "/robot/clock", "/a_b", "/rosout2", "/camera/_1st"] {
            assert!(has_route(usual, TOPICS, name), "{name}");
        }
        let log = "/log/robot/yarpdev/4711";
        let with_logs = Conventions { program_topics: &["log/", "tmp/port/"], ..usual };
        for name in [log, "/tmp/port/1"] {
            assert!(!has_route(with_logs, TOPICS, name) && has_route(usual, TOPICS, name));
        }
        let node_services: &[&[&str]] = &[&["get_parameters", "change_state"], &["reload"]];
        let of_nodes = Conventions { node_services, ..usual };
        for name in ["/talker/get_parameters", "/bridge/change_state", "/bridge/reload"] {
            assert!(!has_route(of_nodes, SERVICES, name) && has_route(usual, SERVICES, name));
        }
        for name in ["/add", "/get_parameters/of"] {
            assert!(has_route(of_nodes, SERVICES, name), "{name}");
        }
        assert!(!has_route(usual, SERVICES, "/x/_action/send_goal"));
    }
}
