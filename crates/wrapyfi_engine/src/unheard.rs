//! Routes that listen where other routes of the same bridge publish, and hear nothing of it.
//!
//! ```text
//!   A ─▶ route 1 ─▶ B      B ─▶ route 2 ─▶ C      a bridge ignores its own publications:
//!                                                 what comes from A never reaches C
//! ```

use std::fmt;

use super::route::Route;
use super::route_index::{Placed, RouteIndex, has_parameters};
use wrapyfi_endpoint::pattern::{Inverse, filled_template, fits_template};
use wrapyfi_endpoint::{EndpointAddress, Interaction};

/// Two routes of one bridge, of which the second does not hear what the first publishes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UnheardRoutes {
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

impl fmt::Display for UnheardRoutes {
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

impl RouteIndex<'_> {
    /// Pairs of routes of which the second listens where the first publishes, and hears nothing of it.
    /// The way back, from B to A, is not among them, because it is not meant to hear.
    pub fn unheard(&self) -> Vec<UnheardRoutes> {
        let has_messages = |it: &&Placed<'_>| {
            it.route.interaction() == Interaction::Topic
                && !has_parameters(it.route)
                && !it.route.serves_board()
        };
        let many: Vec<_> =
            self.all.iter().filter(has_messages).filter(|it| it.route.is_many()).collect();
        let mut found = Vec::new();
        let mut note = |publishing: &Placed<'_>, listening: &Placed<'_>, at: &EndpointAddress| {
            found.push(UnheardRoutes {
                publishing: publishing.route.name.clone(),
                listening: listening.route.name.clone(),
                at: at.clone(),
                from: publishing.route.from.to_string(),
                to: listening.route.to.clone(),
                places: [publishing.place, listening.place],
            });
        };
        for publishing @ Placed { route, from, to, .. } in self.all.iter().filter(has_messages) {
            if route.is_many() {
                let met = self.taking.keys().filter(|address| {
                    address.middleware == to.middleware
                        && may_become(route, &to.name, &address.name)
                });
                for address in met {
                    let others = self.taking_from(Interaction::Topic, address);
                    let others = others.filter(|it| it.to.middleware != from.middleware);
                    others.for_each(|other| note(publishing, other, address));
                }
            } else {
                let others = self.taking_from(Interaction::Topic, to).filter(|it| it.to != *from);
                others.for_each(|other| note(publishing, other, to));
            }
            // What a pattern publishes has many names: one stands for all.
            let name = filled_template(&to.name);
            for other in many.iter().filter(|it| it.route.from.middleware == to.middleware) {
                let target = other.route.target(&name);
                if target.is_some_and(|target| target.middleware != from.middleware) {
                    note(publishing, other, to);
                }
            }
        }
        found
    }
}

/// True where a pattern whose destination is `template` may publish on `name`. Groups and filters of a
/// source that can be told from the destination decide, because a group need not take every text.
fn may_become(route: &Route, template: &str, name: &str) -> bool {
    let inverse = || Inverse::new(&route.names.as_ref()?.pattern, template);
    fits_template(template, name)
        && inverse().is_none_or(|inverse| {
            inverse.source(name).is_some_and(|source| route.target(&source).is_some())
        })
}

#[cfg(test)]
mod tests {
    use super::super::route_index::testing::{index, plan};
    use super::*;

    fn found(routes: &[&str]) -> Vec<String> {
        let unheard = index(&plan(routes)).unheard();
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
        let part = "name: part, from: 'a:/(pat/.*)', to: 'b:/$1'";
        assert_eq!(found(&[part, &on("b:/pat/x")]), ["part ~ on"]);
        assert_eq!(found(&[part, &on("b:/other/x")]), NONE);
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
        let unheard = UnheardRoutes {
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
