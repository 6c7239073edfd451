//! Written routes that lead in a circle.
//!
//! ```text
//!   A ─▶ route 1 ─▶ B ─▶ route 2 ─▶ A     one bridge ignores its own publications, and nothing goes round;
//!                                         in two bridges every message goes round for ever
//! ```

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::fmt;

use super::route_index::{RouteIndex, has_parameters};
use wrapyfi_endpoint::{EndpointAddress, Interaction};

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

impl RouteIndex<'_> {
    /// Circles of written routes, each once, with the fewest routes that close it.
    pub fn circles(&self) -> Vec<Circle> {
        let goes_on = self.all.iter().filter(|it| !it.route.is_many() && !has_parameters(it.route));
        let mut seen = BTreeSet::new();
        let ways = goes_on.filter_map(|it| self.way_back(it.place));
        let new = ways.filter(|way| seen.insert(way.iter().copied().collect::<BTreeSet<_>>()));
        let circle = |places: Vec<usize>| {
            let routes = || places.iter().filter_map(|place| self.at(*place));
            let is_of_services = routes().any(|route| route.interaction() != Interaction::Topic);
            let ends = routes().map(|route| route.from.clone()).collect();
            Circle { ends, is_of_services, places }
        };
        new.map(circle).collect()
    }

    /// Shortest way from a route back to its own beginning, where there is one.
    fn way_back(&self, first: usize) -> Option<Vec<usize>> {
        let next = |place: usize| {
            let here = self.all.get(place).into_iter();
            here.flat_map(|it| self.taking_from(it.route.interaction(), &it.to)).map(|it| it.place)
        };
        let mut way = vec![first];
        way.extend(shortest_way_back(first, next)?);
        Some(way)
    }
}

/// Places after `first` on the shortest way over `next` that leads back to it.
pub(super) fn shortest_way_back<I: Iterator<Item = usize>>(
    first: usize,
    next: impl Fn(usize) -> I,
) -> Option<Vec<usize>> {
    let mut before: BTreeMap<usize, usize> = BTreeMap::new();
    let mut queue = VecDeque::from([first]);
    while let Some(place) = queue.pop_front() {
        for then in next(place) {
            if then == first {
                let earlier = |place: &usize| before.get(place).copied();
                let mut way: Vec<usize> = std::iter::successors(Some(place), earlier).collect();
                // The first one, which has none before it.
                way.pop();
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
    use super::super::route_index::testing::{index, plan};
    use super::*;

    fn found(routes: &[&str]) -> Vec<Circle> {
        index(&plan(routes)).circles()
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
