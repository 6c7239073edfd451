//! Routes that listen where other routes of the same bridge publish, and hear nothing of it.
//!
//! ```text
//!   A ─▶ route 1 ─▶ B      B ─▶ route 2 ─▶ C      a bridge ignores its own publications:
//!                                                 what comes from A never reaches C
//! ```

use std::collections::BTreeMap;
use std::fmt;

use super::pattern::{filled_template, fits_template};
use super::plan::{Plan, RouteSpec};
use super::plan_pattern::{Carried, PatternSpec, Source};
use crate::endpoint::EndpointAddress;
use crate::types::MessageType;

/// Two routes of one bridge, of which the second does not hear what the first publishes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Unheard {
    /// Name of the route that publishes.
    pub publishing: String,
    /// Name of the route that listens.
    pub listening: String,
    /// Where they meet.
    pub at: EndpointAddress,
    /// Source of the first, as it is written.
    pub from: String,
    /// Destination of the second.
    pub to: EndpointAddress,
}

impl fmt::Display for Unheard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { publishing, listening, at, from, to } = self;
        write!(
            f,
            "route {listening:?} does not hear what route {publishing:?} publishes on {at}: a bridge \
             ignores its own publications; write a route from {from} to {to}, or run one of the two in \
             a bridge of its own"
        )
    }
}

/// One route, or the routes of a pattern.
#[derive(Clone, Copy)]
enum Way<'a> {
    Route(&'a RouteSpec),
    Pattern(&'a PatternSpec),
}

impl<'a> Way<'a> {
    fn name(self) -> &'a str {
        match self {
            Self::Route(route) => &route.name,
            Self::Pattern(pattern) => &pattern.name,
        }
    }

    fn from(self) -> String {
        match self {
            Self::Route(route) => route.from.to_string(),
            Self::Pattern(pattern) => match &pattern.from {
                Source::One(address) => address.to_string(),
                Source::Names { middleware, pattern, .. } => format!("{middleware}:{pattern}"),
            },
        }
    }

    fn to(self) -> &'a EndpointAddress {
        match self {
            Self::Route(route) => &route.to,
            Self::Pattern(pattern) => &pattern.to,
        }
    }

    /// Its source, where that has one name.
    fn source(self) -> Option<&'a EndpointAddress> {
        match self {
            Self::Route(route) => Some(&route.from),
            Self::Pattern(pattern) => match &pattern.from {
                Source::One(address) => Some(address),
                Source::Names { .. } => None,
            },
        }
    }

    /// Whether it carries messages of a topic: parameters are their node's, whoever set them.
    fn is_of_topics(self) -> bool {
        match self {
            Self::Route(route) => {
                ![route.message_type, route.from_type].contains(&MessageType::Properties)
            }
            Self::Pattern(pattern) => matches!(pattern.carried, Carried::Topics { .. }),
        }
    }

    /// The pattern that takes many names.
    fn many(self) -> Option<&'a PatternSpec> {
        match self {
            Self::Pattern(pattern) if pattern.is_many() => Some(pattern),
            _ => None,
        }
    }
}

impl Plan {
    /// Pairs of routes of which the second listens where the first publishes, and hears nothing of it.
    /// The way back, from B to A, is none of them: it is meant not to hear. `resolve` gives an address
    /// the name that it has on its middleware.
    #[must_use]
    pub fn unheard(&self, resolve: impl Fn(&EndpointAddress) -> EndpointAddress) -> Vec<Unheard> {
        let ways = self.routes.iter().map(Way::Route);
        let ways = ways.chain(self.patterns.iter().map(Way::Pattern));
        let ways: Vec<Way<'_>> = ways.filter(|way| way.is_of_topics()).collect();
        let mut listening: BTreeMap<EndpointAddress, Vec<Way<'_>>> = BTreeMap::new();
        for way in &ways {
            if let Some(source) = way.source() {
                listening.entry(resolve(source)).or_default().push(*way);
            }
        }
        let many: Vec<Way<'_>> = ways.iter().copied().filter(|way| way.many().is_some()).collect();
        let mut found = Vec::new();
        let mut note = |publishing: Way<'_>, listener: Way<'_>, at: EndpointAddress| {
            found.push(Unheard {
                publishing: publishing.name().to_owned(),
                listening: listener.name().to_owned(),
                at,
                from: publishing.from(),
                to: listener.to().clone(),
            });
        };
        for publishing in ways.iter().copied() {
            let to = resolve(publishing.to());
            match publishing.many() {
                None => {
                    let back = publishing.source().map(&resolve);
                    let others = listening.get(&to).into_iter().flatten();
                    others
                        .filter(|other| Some(resolve(other.to())) != back)
                        .for_each(|other| note(publishing, *other, to.clone()));
                }
                Some(pattern) => {
                    let others = listening.iter().filter(|(address, _)| {
                        address.middleware == to.middleware
                            && fits_template(&to.name, &address.name)
                    });
                    for (address, others) in others {
                        others
                            .iter()
                            .filter(|other| other.to().middleware != pattern.source_middleware())
                            .for_each(|other| note(publishing, *other, address.clone()));
                    }
                }
            }
            // What a pattern publishes has many names: one stands for all.
            let name = filled_template(&to.name);
            let source = publishing.source().map(|source| source.middleware.as_str());
            let source = source.or(publishing.many().map(PatternSpec::source_middleware));
            for other in &many {
                let takes = other.many().filter(|it| it.source_middleware() == to.middleware);
                let target = takes.and_then(|it| it.target(&name));
                if target.is_some_and(|target| Some(target.middleware.as_str()) != source) {
                    note(publishing, *other, to.clone());
                }
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use wrapyfi_interfaces::store::TypeStore;

    use super::super::config::Config;
    use super::super::plan::Available;
    use super::*;

    fn found(routes: &[&str]) -> Vec<String> {
        let lines = routes.iter().map(|route| format!("  - {{ {route} }}\n")).collect::<String>();
        let config: Config<()> = Config::from_yaml(&format!("routes:\n{lines}"), "x.yaml").unwrap();
        let available =
            ["a", "b", "c"].map(|name| Available { name, check_topic: &|_| Ok(()), options: &[] });
        let plan = Plan::new(&config, &available, &mut TypeStore::generated(), "x.yaml").unwrap();
        // As a node does with relative names.
        let resolve = |address: &EndpointAddress| {
            let name = format!("/{}", address.name.trim_start_matches('/'));
            EndpointAddress { name, ..address.clone() }
        };
        let unheard = plan.unheard(resolve);
        unheard.into_iter().map(|one| format!("{} ~ {}", one.publishing, one.listening)).collect()
    }

    const NONE: [String; 0] = [];

    #[test]
    fn a_chain_through_the_bridge_is_found_and_the_way_back_is_not() {
        let first = "name: first, from: 'a:/x', to: 'b:/y', type: Text";
        let second = "name: second, from: 'b:/y', to: 'c:/z', type: Text";
        assert_eq!(found(&[first, second]), ["first ~ second"]);
        let relative = "name: second, from: 'b:y', to: 'c:/z', type: Text";
        assert_eq!(found(&[first, relative]), ["first ~ second"]);
        let learned = "name: second, from: 'b:/y', to: 'c:/z'";
        assert_eq!(found(&[first, learned]), ["first ~ second"]);
        let back = "name: second, from: 'b:/y', to: 'a:/x', type: Text";
        assert_eq!(found(&[first, back]), NONE);
        let parameters = "from: 'b:/y', to: 'c:/z', type: Properties";
        assert_eq!(found(&["from: 'a:/x', to: 'b:/y', type: Properties", parameters]), NONE);
        let elsewhere = "name: second, from: 'c:/y', to: 'a:/z', type: Text";
        assert_eq!(found(&[first, elsewhere]), NONE);
    }

    #[test]
    fn patterns_meet_too() {
        let all = "name: all, from: 'a:/(.*)', to: 'b:/lab/$1'";
        let on = |from: &str| format!("name: on, from: '{from}', to: 'c:/z', type: Text");
        assert_eq!(found(&[all, &on("b:/lab/x")]), ["all ~ on"]);
        assert_eq!(found(&[all, &on("b:/x")]), NONE);
        assert_eq!(found(&[all, "name: on, from: 'b:/lab/x', to: 'a:/x', type: Text"]), NONE);
        let one = "name: one, from: 'a:/x', to: 'b:/x', type: Text";
        assert_eq!(found(&[one, "name: rest, from: 'b:/(.*)', to: 'c:/$1'"]), ["one ~ rest"]);
        assert_eq!(found(&[one, "name: rest, from: 'b:/(y.*)', to: 'c:/$1'"]), NONE);
        assert_eq!(found(&[all, "name: rest, from: 'b:/(.*)', to: 'c:/$1'"]), ["all ~ rest"]);
        assert_eq!(found(&[all, "name: back, from: 'b:/lab/(.*)', to: 'a:/$1'"]), NONE);
        assert_eq!(found(&["service: 'a:/(.*)', as: 'b:/$1'", &on("b:/x")]), NONE);
    }

    #[test]
    fn the_text_names_both_and_the_remedy() {
        let address = |text: &str| text.parse().unwrap();
        let unheard = Unheard {
            publishing: "in".into(),
            listening: "on".into(),
            at: address("ros2:/x"),
            from: "ros:/x".into(),
            to: address("zeromq:/x"),
        };
        let text = unheard.to_string();
        assert!(text.contains("route \"on\" does not hear what route \"in\" publishes on ros2:/x"));
        assert!(text.contains("write a route from ros:/x to zeromq:/x"), "{text}");
    }
}
