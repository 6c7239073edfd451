//! Routes that listen where other routes of the same bridge publish, and hear nothing of it.
//!
//! ```text
//!   A ─▶ route 1 ─▶ B      B ─▶ route 2 ─▶ C      a bridge ignores its own publications:
//!                                                 what comes from A never reaches C
//! ```

use std::collections::BTreeMap;
use std::fmt;

use super::plan::Plan;
use super::route::{Kind, Route, Types};
use wrapyfi_data::types::MessageType;
use wrapyfi_endpoint::EndpointAddress;
use wrapyfi_endpoint::pattern::{filled_template, fits_template};

/// A route, and its place in the plan.
type Placed<'p> = (usize, &'p Route);

/// Two routes of one bridge, of which the second does not hear what the first publishes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Unheard {
    /// Name of the route that publishes.
    pub publishing: String,
    /// Name of the route that listens.
    pub listening: String,
    /// Address at which they meet.
    pub at: EndpointAddress,
    /// Source of the first, as it is written.
    pub from: String,
    /// Destination of the second.
    pub to: EndpointAddress,
    /// Places of the two in the plan.
    pub places: [usize; 2],
}

impl fmt::Display for Unheard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { publishing, listening, at, from, to, .. } = self;
        write!(
            f,
            "route {listening:?} does not hear what route {publishing:?} publishes on {at}: a bridge \
             ignores its own publications; write a route from {from} to {to}, or run one of the two in \
             a bridge of its own"
        )
    }
}

impl Plan {
    /// Pairs of routes of which the second listens where the first publishes, and hears nothing of it.
    /// The way back, from B to A, is not among them, because it is not meant to hear. `resolve`
    /// gives an address the name that it has on its middleware.
    #[must_use]
    pub fn unheard(&self, resolve: impl Fn(&EndpointAddress) -> EndpointAddress) -> Vec<Unheard> {
        // Parameters are their node's, whoever set them.
        let has_messages = |route: &&Route| match (route.kind, route.is_whole()) {
            (Kind::Topic(Types { from, to }), true) => {
                ![from, to].contains(&MessageType::Properties)
            }
            (kind, _) => matches!(kind, Kind::Topic(_)),
        };
        let routes: Vec<Placed<'_>> =
            self.routes.iter().enumerate().filter(|(_, route)| has_messages(route)).collect();
        let (many, single): (Vec<Placed<'_>>, Vec<Placed<'_>>) =
            routes.iter().copied().partition(|(_, route)| route.is_many());
        let mut listening: BTreeMap<EndpointAddress, Vec<Placed<'_>>> = BTreeMap::new();
        for (place, route) in single {
            listening.entry(resolve(&route.from)).or_default().push((place, route));
        }
        let mut found = Vec::new();
        let mut note = |publishing: Placed<'_>, listener: Placed<'_>, at: &EndpointAddress| {
            let places = [publishing.0, listener.0];
            let (publishing, listener) = (publishing.1, listener.1);
            found.push(Unheard {
                publishing: publishing.name.clone(),
                listening: listener.name.clone(),
                at: at.clone(),
                from: publishing.from.to_string(),
                to: listener.to.clone(),
                places,
            });
        };
        for placed @ (_, publishing) in routes {
            let to = resolve(&publishing.to);
            let source = &publishing.from.middleware;
            if publishing.is_many() {
                let others = listening.iter().filter(|(address, _)| {
                    address.middleware == to.middleware && fits_template(&to.name, &address.name)
                });
                for (address, others) in others {
                    let others = others.iter().filter(|(_, it)| it.to.middleware != *source);
                    others.for_each(|other| note(placed, *other, address));
                }
            } else {
                let back = resolve(&publishing.from);
                let others = listening.get(&to).into_iter().flatten();
                let others = others.filter(|(_, other)| resolve(&other.to) != back);
                others.for_each(|other| note(placed, *other, &to));
            }
            // What a pattern publishes has many names: one stands for all.
            let name = filled_template(&to.name);
            for other in many.iter().filter(|(_, it)| it.from.middleware == to.middleware) {
                if other.1.target(&name).is_some_and(|target| target.middleware != *source) {
                    note(placed, *other, &to);
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
            places: [0, 1],
        };
        let text = unheard.to_string();
        assert!(text.contains("route \"on\" does not hear what route \"in\" publishes on ros2:/x"));
        assert!(text.contains("write a route from ros:/x to zeromq:/x"), "{text}");
    }
}
