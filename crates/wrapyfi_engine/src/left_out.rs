//! Reason that a pattern has no route for a name.

use super::denied::{is_denied_service, is_denied_topic};
use super::route::{Kind, Names, Route};

/// Reason that a pattern leaves out a name which it matches.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum LeftOut {
    /// The name is hidden, or every node has one like it: `default_deny` is on.
    ByDefault,
    /// `allow` has entries, and none matches.
    NotAllowed,
    /// This entry of `deny` matches.
    Denied(String),
}

impl Route {
    /// Reason that the pattern leaves out a name which its `from` (or `service`) matches; `None` where
    /// the name has a route, or is none of the pattern's.
    #[must_use]
    pub fn left_out(&self, name: &str) -> Option<LeftOut> {
        let Names { pattern, allow, deny, default_deny, .. } = self.names.as_ref()?;
        if !pattern.matches(name) {
            return None;
        }
        let is_denied = match self.kind {
            Kind::Topic(_) => is_denied_topic(&self.from.middleware, name),
            Kind::Service(_) => is_denied_service(&self.from.middleware, name),
        };
        if let Some(entry) = deny.iter().find(|one| one.matches(name)) {
            return Some(LeftOut::Denied(entry.to_string()));
        }
        if !allow.is_empty() && !allow.iter().any(|one| one.matches(name)) {
            return Some(LeftOut::NotAllowed);
        }
        (*default_deny && is_denied).then_some(LeftOut::ByDefault)
    }
}

#[cfg(test)]
mod tests {
    use wrapyfi_interfaces::store::TypeStore;

    use super::super::config::Config;
    use super::super::plan::Plan;
    use super::super::plan_address::Available;
    use super::*;

    #[test]
    fn the_entry_that_leaves_a_name_out_is_named() {
        let route =
            "from: 'a:/(.*)', to: 'b:/$1', allow: ['cam/.*', '_x', 'rosout'], deny: ['cam/raw']";
        let yaml = format!("routes:\n  - {{ {route} }}\n");
        let config: Config<()> = Config::from_yaml(&yaml, "x.yaml").unwrap();
        let available =
            ["a", "b"].map(|name| Available { name, check_topic: &|_| Ok(()), options: &[] });
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
        }
    }
}
