//! The routes of a plan by the addresses that their ends have on their middlewares: where they meet.

use std::collections::BTreeMap;

use super::plan::Plan;
use super::route::{Route, Types};
use wrapyfi_data::types::MessageType;
use wrapyfi_endpoint::{EndpointAddress, Interaction};

/// A route of a plan.
pub(super) struct Placed<'p> {
    /// Place in the plan.
    pub(super) place: usize,
    pub(super) route: &'p Route,
    /// Source, with the name that it has on its middleware.
    pub(super) from: EndpointAddress,
    /// Destination, with the name that it has there.
    pub(super) to: EndpointAddress,
}

/// Index of a plan's routes.
pub struct RouteIndex<'p> {
    pub(super) all: Vec<Placed<'p>>,
    /// Places of the written routes that carry messages or calls, by their sources.
    pub(super) taking: BTreeMap<EndpointAddress, Vec<usize>>,
}

impl Plan {
    /// Indexes the routes. `resolve` gives an address the name that it has on its middleware.
    #[doc(hidden)]
    pub fn index(&self, resolve: impl Fn(&EndpointAddress) -> EndpointAddress) -> RouteIndex<'_> {
        let mut taking: BTreeMap<EndpointAddress, Vec<usize>> = BTreeMap::new();
        let mut all = Vec::with_capacity(self.routes.len());
        for (place, route) in self.routes.iter().enumerate() {
            let (from, to) = (resolve(&route.from), resolve(&route.to));
            if !route.is_many() && !has_parameters(route) {
                taking.entry(from.clone()).or_default().push(place);
            }
            all.push(Placed { place, route, from, to });
        }
        RouteIndex { all, taking }
    }
}

impl<'p> RouteIndex<'p> {
    /// Route with one name whose source is `address`, else one whose destination it is.
    pub fn written_at(&self, address: &EndpointAddress) -> Option<&'p Route> {
        let written = || self.all.iter().filter(|it| !it.route.is_many());
        let taking = written().find(|it| it.from == *address);
        taking.or_else(|| written().find(|it| it.to == *address)).map(|it| it.route)
    }

    /// Route that is written and has one of the ends of a route that a pattern would make: it goes first. None instead of
    /// a route that is written itself.
    pub fn instead_of(&self, made: &Route) -> Option<&'p Route> {
        let written = self.all.iter().map(|it| it.route).filter(|one| !one.is_many());
        let mut alike = written.filter(|one| one.interaction() == made.interaction());
        if alike.clone().any(|one| one.ends() == made.ends()) {
            return None;
        }
        alike.find(|one| is_by_hand([&one.from, &one.to], [&made.from, &made.to]))
    }

    /// Route at a place of the plan.
    #[must_use]
    pub fn at(&self, place: usize) -> Option<&'p Route> {
        self.all.get(place).map(|it| it.route)
    }

    /// Written routes that carry messages or calls from `address`.
    pub(super) fn taking_from(
        &self,
        interaction: Interaction,
        address: &EndpointAddress,
    ) -> impl Iterator<Item = &Placed<'p>> {
        let places = self.taking.get(address).into_iter().flatten();
        let placed = places.filter_map(|it| self.all.get(*it));
        placed.filter(move |it| it.route.interaction() == interaction)
    }
}

/// True where a written route from one address to another stands in the way of one between two addresses.
pub(super) fn is_by_hand(
    written: [&EndpointAddress; 2],
    [from, to]: [&EndpointAddress; 2],
) -> bool {
    let [source, destination] = written;
    (source == from && destination.middleware == to.middleware)
        || (destination == from && source.middleware == to.middleware)
        || destination == to
}

/// True for a route of parameters, which are their node's, whichever program set them, and are not set again where they
/// are the same already.
pub(super) fn has_parameters(route: &Route) -> bool {
    let Types { from, to } = route.message_types();
    [from, to].contains(&MessageType::Properties)
}

#[cfg(test)]
pub(super) mod testing {
    use wrapyfi_interfaces::store::TypeStore;

    use super::super::config::Config;
    use super::super::plan::Plan;
    use super::RouteIndex;
    use wrapyfi_endpoint::EndpointAddress;
    use wrapyfi_endpoint::driver::Available;

    /// Plan of routes between the middlewares a, b and c, each as an entry of `routes` has it.
    pub(in super::super) fn plan(routes: &[&str]) -> Plan {
        let lines = routes.iter().map(|route| format!("  - {{ {route} }}\n")).collect::<String>();
        let config: Config<()> = Config::from_yaml(&format!("routes:\n{lines}"), "x.yaml").unwrap();
        let available = ["a", "b", "c"].map(|name| Available { name, ..Available::default() });
        Plan::new(&config, &available, &mut TypeStore::generated(), "x.yaml").unwrap()
    }

    /// Index of it where relative names are what they are for a node.
    pub(in super::super) fn index(plan: &Plan) -> RouteIndex<'_> {
        plan.index(|address| {
            let name = format!("/{}", address.name.trim_start_matches('/'));
            EndpointAddress { name, ..address.clone() }
        })
    }
}
