//! Written routes that lead in a circle.
//!
//! ```text
//!   A ─▶ route 1 ─▶ B ─▶ route 2 ─▶ A     one bridge ignores its own publications, and nothing goes round;
//!                                         in two bridges every message goes round for ever
//! ```

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::fmt;

use super::plan::Plan;
use super::route::{Kind, Route, Types};
use wrapyfi_data::types::MessageType;
use wrapyfi_endpoint::{EndpointAddress, Role};

/// Routes of a plan of which each goes on where the one before ends, and the last ends where the first
/// begins.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Circle {
    /// Places of the routes in the plan, from the first one on.
    pub places: Vec<usize>,
    /// Sources of the routes.
    pub ends: Vec<EndpointAddress>,
    /// True for services, each of which would be answered by the next.
    pub is_of_services: bool,
}

impl fmt::Display for Circle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the routes lead in a circle, ")?;
        for end in &self.ends {
            write!(f, "{end} -> ")?;
        }
        if let Some(first) = self.ends.first() {
            write!(f, "{first}")?;
        }
        f.write_str(match self.is_of_services {
            true => {
                ": each of these services calls the next, and none has a server; leave one of the \
                 routes out"
            }
            false => {
                ": this bridge ignores its own publications, but with another bridge that has one of \
                 these routes every message goes round for ever; run them in one bridge only, or \
                 leave one out"
            }
        })
    }
}

impl Plan {
    /// Circles of written routes, each once, with the fewest routes that close it. `resolve` gives an
    /// address the name that it has on its middleware.
    #[must_use]
    pub fn circles(&self, resolve: impl Fn(&EndpointAddress) -> EndpointAddress) -> Vec<Circle> {
        let ends: Vec<_> =
            self.routes.iter().map(|it| [resolve(&it.from), resolve(&it.to)]).collect();
        let mut leaving: BTreeMap<(Role, &EndpointAddress), Vec<usize>> = BTreeMap::new();
        for (place, (route, [from, _])) in self.routes.iter().zip(&ends).enumerate() {
            if may_go_round(route) {
                leaving.entry((route.role(), from)).or_default().push(place);
            }
        }
        let next = |place: usize| {
            let (route, [_, to]) = (self.routes.get(place)?, ends.get(place)?);
            leaving.get(&(route.role(), to))
        };
        let single = self.routes.iter().enumerate().filter(|(_, route)| may_go_round(route));
        let mut seen = BTreeSet::new();
        let ways = single.filter_map(|(first, _)| way_back(first, next));
        let new = ways.filter(|way| seen.insert(way.iter().copied().collect::<BTreeSet<_>>()));
        let circle = |places: Vec<usize>| {
            let routes: Vec<&Route> = places.iter().filter_map(|it| self.routes.get(*it)).collect();
            let is_of_services = routes.iter().any(|route| route.role() != Role::Publisher);
            let ends = routes.iter().map(|route| route.from.clone()).collect();
            Circle { places, ends, is_of_services }
        };
        new.map(circle).collect()
    }
}

/// True for a written route of messages or calls. Parameters of two nodes may follow each other: what is
/// the same already is not set again.
fn may_go_round(route: &Route) -> bool {
    let has_parameters = match route.kind {
        Kind::Topic(Types { from, to }) => [from, to].contains(&MessageType::Properties),
        Kind::Service(_) => false,
    };
    !route.is_many() && !has_parameters
}

/// Shortest way from a route back to its own beginning, where there is one.
fn way_back<'n>(
    first: usize,
    next: impl Fn(usize) -> Option<&'n Vec<usize>>,
) -> Option<Vec<usize>> {
    let mut before: BTreeMap<usize, usize> = BTreeMap::new();
    let mut queue = VecDeque::from([first]);
    while let Some(place) = queue.pop_front() {
        for &then in next(place).into_iter().flatten() {
            if then == first {
                let mut way = vec![place];
                while let Some(earlier) = way.last().and_then(|it| before.get(it)) {
                    way.push(*earlier);
                }
                way.reverse();
                return Some(way);
            }
            if let Entry::Vacant(unseen) = before.entry(then) {
                unseen.insert(place);
                queue.push_back(then);
            }
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use wrapyfi_interfaces::store::TypeStore;

    use super::super::config::Config;
    use super::super::plan::Available;
    use super::*;

    fn found(routes: &[&str]) -> Vec<Circle> {
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
        plan.circles(resolve)
    }

    #[test]
    fn a_circle_is_found_once_and_a_chain_is_none() {
        let route = |from: &str, to: &str| format!("from: '{from}', to: '{to}', type: Text");
        let [there, back] = [route("a:/x", "b:/x"), route("b:x", "a:/x")];
        let away = route("b:/x", "c:/y");
        let both = found(&[&there, &away, &back]);
        assert_eq!(both.len(), 1, "{both:?}");
        assert_eq!(both[0].places, [0, 2]);
        let text = both[0].to_string();
        assert!(text.contains("in a circle, a:/x -> b:x -> a:/x: this bridge ignores"), "{text}");
        assert_eq!(found(&[&there, &away]), []);
        let three = found(&[&there, &away, &route("c:/y", "a:/x")]);
        assert_eq!(three.len(), 1, "{three:?}");
        assert_eq!(three[0].places, [0, 1, 2]);
        let learned = "from: 'b:/x', to: 'a:/x'";
        assert_eq!(found(&[&there, learned]).len(), 1);
        assert_eq!(found(&[&there, "from: 'b:/(.*)', to: 'a:/$1'"]), [], "patterns have marks");
        let parameters = |from: &str, to: &str| route(from, to).replace("Text", "Properties");
        let both = [parameters("a:/x", "b:/x"), parameters("b:/x", "a:/x")];
        assert_eq!(found(&[&both[0], &both[1]]), [], "parameters may follow each other");
    }

    #[test]
    fn services_in_a_circle_have_no_server_and_topics_are_no_services() {
        let there = "service: 'a:/x', as: 'b:/x', type: NativeObject";
        let back = "service: 'b:/x', as: 'a:/x', type: NativeObject";
        let both = found(&[there, back]);
        assert_eq!((both.len(), both[0].is_of_services), (1, true));
        assert!(both[0].to_string().contains("none has a server"), "{}", both[0]);
        assert_eq!(found(&[there, "from: 'b:/x', to: 'a:/x', type: Text"]), []);
    }
}
