//! Admission of candidates as routes: loops, rivals, types.
//!
//! ```text
//!   left out   the configuration has a route for it; it would come back to where it is from
//!   rival      another bridge carries it, or another program offers the service
//!   made       its type is known: given, told by its source, by its destination, or `type_if_unknown`
//! ```

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use super::candidate::{Candidate, Misfit};
use super::config_qos::QosConfig;
use super::pattern::Pattern;
use super::reconciler::Reconciler;
use super::route::{Route, RouteTypes, Types, Typing};
use super::route_index::is_by_hand;
use super::route_status::RouteState;
use wrapyfi_interfaces::store::TypeStore;

use wrapyfi_data::types::{DataType, MessageType};
use wrapyfi_endpoint::{
    Absent, BridgeMark, Cause, Discovered, Durability, EndpointAddress, Interaction, LearnError,
    LearnResult, Middleware, Role, RoutingProperties,
};

/// Time after which a candidate whose route could not be made is tried again.
const RETRY: Duration = Duration::from_secs(2);

/// State of a candidate that has no route, with the reason, and the time until the next look.
type Refusal = Box<(RouteState, Duration)>;

fn waiting(cause: Cause) -> Refusal {
    Box::new((RouteState::Waiting(cause), Duration::ZERO))
}

impl Reconciler {
    /// True for a name that the pattern leaves out though it matches: all its endpoints came from
    /// the destination, or its route is not for patterns to make.
    pub(super) fn is_left_out(
        &self,
        spec: &Route,
        from: &EndpointAddress,
        to: &EndpointAddress,
    ) -> bool {
        let comes_back = self.sources(spec.interaction(), from, &to.middleware).next().is_none();
        comes_back || self.is_not_for_patterns(spec, from, to)
    }

    /// True where the configuration has a route of its own for these ends, or one of them is what the program has about
    /// itself: discovery does not list that, so a listener there would seem to wait for another program.
    pub(super) fn is_not_for_patterns(
        &self,
        spec: &Route,
        from: &EndpointAddress,
        to: &EndpointAddress,
    ) -> bool {
        let interaction = spec.interaction();
        let ends = [from, to];
        ends.iter().any(|end| self.own.contains(end))
            || (interaction == Interaction::Topic
                && ends.iter().any(|end| self.is_action_part(end)))
            || self
                .explicit
                .keys()
                .any(|it| it.interaction == interaction && is_by_hand([&it.from, &it.to], ends))
    }

    /// True for a topic that is a part of an action, where a pattern carries actions of its middleware.
    fn is_action_part(&self, end: &EndpointAddress) -> bool {
        let Some(side) = self.graph.get(&end.middleware) else { return false };
        let Some((action, word)) = end.name.rsplit_once('/') else { return false };
        let is_there = |role| !side.endpoints(role, action).is_empty();
        let carries_actions = |pattern: &Pattern| {
            let spec = &pattern.spec;
            let ends = [&spec.from.middleware, &spec.to.middleware];
            spec.interaction() == Interaction::Action && ends.contains(&&end.middleware)
        };
        // The middleware is asked last: it may panic, and no route that is not about actions ends with it.
        self.patterns.iter().any(carries_actions)
            && [Role::ActionServer, Role::ActionClient].into_iter().any(is_there)
            && side.routing_properties().action_topics.contains(&word)
    }

    /// Endpoints of a source whose messages did not come through the middleware of the destination.
    fn sources<'s>(
        &'s self,
        interaction: Interaction,
        from: &EndpointAddress,
        to: &'s str,
    ) -> impl Iterator<Item = &'s Discovered> {
        let side = self.graph.get(&from.middleware);
        let tells = side.is_some_and(|side| side.routing_properties().tells_own);
        let is_own = !tells && self.ours.contains_key(&(interaction, from.clone()));
        let all = side.map_or(&[][..], |side| side.endpoints(interaction.provider(), &from.name));
        let came_back =
            |one: &&Discovered| one.mark.as_ref().is_some_and(|mark| mark.came_through(to));
        all.iter().filter(move |one| !is_own && !came_back(one))
    }

    /// Cause that another program or bridge does what the candidate's route would do.
    pub(super) fn rival(&self, spec: &Route, candidate: &Candidate) -> Option<Cause> {
        let Candidate { from, to, .. } = candidate;
        let side = self.graph.get(&to.middleware)?;
        let interaction = spec.interaction();
        if !side.routing_properties().tells_own
            && self.ours.contains_key(&(interaction, to.clone()))
        {
            return None;
        }
        let who = |one: &Discovered| one.node.clone().unwrap_or_else(|| "another program".into());
        side.endpoints(interaction.provider(), &to.name).iter().find_map(|one| {
            match (interaction, &one.mark) {
                (_, Some(mark)) if mark.bridge >= self.number => None,
                (Interaction::Service | Interaction::Action, _) => {
                    Some(Cause::NameServed { to: to.to_string(), interaction, by: who(one) })
                }
                (_, Some(mark)) if mark.came_through(&from.middleware) => {
                    Some(Cause::Carried { bridge: who(one), to: to.to_string() })
                }
                _ => None,
            }
        })
    }

    /// Cause, other than its type, that a candidate has no route.
    pub(super) fn hindrance(&self, spec: &Route, candidate: &Candidate) -> Option<Cause> {
        let Candidate { from, to, .. } = candidate;
        let interaction = spec.interaction();
        if !spec.is_many() {
            return None;
        }
        if let Some(rival) = self.rival(spec, candidate) {
            return Some(rival);
        }
        if candidate.precedes_publisher && self.has_source(interaction, to) {
            return Some(Cause::OtherSource(to.to_string()));
        }
        if !spec.policy.merge
            && let Some(other) = self.taken(interaction, to)
        {
            let (to, by) = (to.to_string(), other.to_string());
            return Some(Cause::DestinationTaken { to, by });
        }
        self.is_on_both_sides(interaction, from, to).then(|| Cause::BothSides {
            from: from.to_string(),
            to: to.to_string(),
            unmarked: self.without_marks(from, to).to_owned(),
        })
    }

    /// Makes the route of a candidate, or says why there is none.
    pub(super) fn make(
        &mut self,
        spec: &Route,
        candidate: &mut Candidate,
    ) -> Result<Route, Refusal> {
        if let Some(why) = self.hindrance(spec, candidate) {
            if let Some(target) = self.middleware(&candidate.to) {
                target.verify(&candidate.to.name);
            }
            // Of two sources with one name only a user can tell which is meant.
            let is_taken = self.taken(spec.interaction(), &candidate.to).is_some();
            let again = if spec.is_many() && is_taken { RETRY } else { Duration::ZERO };
            return Err(Box::new((RouteState::Waiting(why), again)));
        }
        let types = self.types(spec, candidate)?;
        let Candidate { from, to, .. } = &*candidate;
        let interaction = spec.interaction();
        let mark = spec.is_many().then(|| {
            let sources = self.sources(interaction, from, &to.middleware);
            let marks = sources.filter_map(|one| one.mark.as_ref());
            BridgeMark::of(self.number, marks, &from.middleware)
        });
        let has_qos =
            || self.sources(interaction, from, &to.middleware).any(|one| one.qos.is_some());
        let keeps = interaction == Interaction::Topic
            && (spec.policy.lazy || has_qos())
            && self.keeps_last(spec, candidate);
        let name = if spec.is_many() { candidate.name(interaction) } else { spec.name.clone() };
        let ahead = self.middleware(from).filter(|_| candidate.precedes_publisher);
        let ahead = ahead.and_then(|source| source.ahead_options(&from.name)).unwrap_or_default();
        let (from, to, typing) = (from.clone(), to.clone(), Typing::Given);
        let mut route = Route { name, mark, from, to, names: None, types, typing, ..spec.clone() };
        if let QosConfig::Match(qos) = &mut route.policy.qos
            && keeps
        {
            // Publishers of the source keep their last message, so the destination does too.
            qos.durability = Durability::TransientLocal;
        }
        for (key, value) in ahead {
            if key.as_str().is_some_and(|key| route.policy.options.get(key).is_none()) {
                route.policy.options.insert(key, value);
            }
        }
        Ok(route)
    }

    /// Messages or requests of a candidate, with the type that its source shows or, where that shows none, another
    /// one. Notes what the source shows; asking it is the first step to a route.
    pub(super) fn types(
        &mut self,
        spec: &Route,
        candidate: &mut Candidate,
    ) -> Result<RouteTypes, Refusal> {
        if spec.typing == Typing::Given {
            return Ok(spec.types);
        }
        let Candidate { from, to, wished, .. } = &*candidate;
        let is_otherwise = spec.typing == Typing::LearnedIfTold;
        let sources: Vec<_> =
            self.sources(spec.interaction(), from, &to.middleware).cloned().collect();
        match spec.types {
            RouteTypes::Topic(types) => {
                if let Some(wished) = *wished {
                    return Ok(RouteTypes::Topic(wished.into()));
                }
                let (from, to) = (from.clone(), to.clone());
                let otherwise = is_otherwise.then_some(types.to);
                let (learned, is_shown) = self.learn_topic(&sources, &from, &to, otherwise)?;
                let (source, options) = (self.middleware(&from), &spec.policy.options);
                let learned = source.map_or(learned, |it| it.received_as(learned, options));
                candidate.announced_type = is_shown.then(|| learned.label());
                Ok(RouteTypes::Topic(learned.into()))
            }
            RouteTypes::Service(kind) => {
                let otherwise = is_otherwise.then_some(kind);
                let (sources, from) = ((Role::Server, &*sources), from.clone());
                let learn: Learn<_> = |middleware, one, types| middleware.learn_service(one, types);
                self.learn_called(sources, &from, otherwise, learn).map(RouteTypes::Service)
            }
            RouteTypes::Action(kind) => {
                let otherwise = kind.filter(|_| is_otherwise);
                let (sources, from) = ((Role::ActionServer, &*sources), from.clone());
                let learn: Learn<_> = |middleware, one, types| middleware.learn_action(one, types);
                let learned = self.learn_called(sources, &from, otherwise, learn)?;
                Ok(RouteTypes::Action(Some(learned)))
            }
        }
    }

    /// True when a publisher of the source is known to keep its last message. Every publisher is
    /// asked: no program can listen to kept messages of a destination that does not offer any, so a
    /// lazy route opens its source for them.
    pub(super) fn keeps_last(&self, spec: &Route, candidate: &Candidate) -> bool {
        let Candidate { from, to, .. } = candidate;
        let Some(middleware) = self.middleware(from) else { return false };
        let mut keeps = false;
        for one in self.sources(spec.interaction(), from, &to.middleware) {
            keeps |= middleware.keeps_last(one) == Some(true);
        }
        keeps
    }

    /// Type that all publishers of the source have now instead of the one that the route learned, in words: from those
    /// before, or from listeners where it was made ahead of what its source shows. Messages of a source whose messages
    /// show the type may be read as what its listeners want; another type is news there once the source has shown the
    /// first, or where they cannot. Those of ROS are read as objects, too.
    pub(super) fn other_type(&mut self, spec: &Route, candidate: &mut Candidate) -> Option<String> {
        let Candidate { from, to, made, .. } = &*candidate;
        let Some(RouteTypes::Topic(Types { to: carried, .. })) = *made else { return None };
        let between_ros = self.are_both_ros(from, to);
        let source = self.graph.get(&from.middleware)?;
        let untyped = source.routing_properties().untyped;
        let middleware = source.middleware.clone()?;
        let mut other = None;
        for publisher in source.endpoints(Role::Publisher, &from.name) {
            let learned = middleware.learn_topic(publisher, &mut self.types).ok()?;
            let told = learned.message_type(between_ros);
            let told = middleware.received_as(told, &spec.policy.options);
            other = Some(told);
            if is_same(told, carried) {
                break;
            }
        }
        let told = other?;
        let before = candidate.announced_type.replace(told.label());
        candidate.left_type.take_if(|left| *left == told.label());
        if is_same(told, carried) {
            return None;
        }
        if untyped && may_be_read_as(told.data_type(), carried.data_type()) {
            let is_object = carried.data_type() == DataType::NativeObject;
            if is_object || before.is_none_or(|before| before == told.label()) {
                return None;
            }
        }
        candidate.wished = None;
        let (told, carried) = (told.label(), carried.label());
        candidate.left_type = Some(carried);
        if told == carried {
            return Some(format!("its publishers have another definition of {told} now"));
        }
        Some(format!("its publishers have the type {told} now, not {carried}"))
    }

    /// Type that all servers of the source's service or action have now instead of the one that the route learned from
    /// those before, in words.
    pub(super) fn other_called(&mut self, spec: &Route, candidate: &Candidate) -> Option<String> {
        let Candidate { from, to, made, .. } = candidate;
        let called = made.filter(|made| !matches!(made, RouteTypes::Topic(_)))?;
        let middleware = Arc::clone(self.middleware(from)?);
        let servers: Vec<_> =
            self.sources(spec.interaction(), from, &to.middleware).cloned().collect();
        let mut other = None;
        for server in servers {
            let types = &mut self.types;
            let told = match called {
                RouteTypes::Action(_) => {
                    RouteTypes::Action(Some(middleware.learn_action(&server, types).ok()?))
                }
                _ => RouteTypes::Service(middleware.learn_service(&server, types).ok()?),
            };
            if told == called {
                return None;
            }
            other = Some(told);
        }
        let (told, called) = (other?.label(), called.label());
        Some(format!("its server has the type {told} now, not {called}"))
    }

    /// Listeners at the destination that want another type than the route's, and a type for them.
    pub(super) fn misfits(&mut self, spec: &Route, candidate: &Candidate) -> Misfits {
        let Candidate { from, to, .. } = candidate;
        let mut misfits = Misfits::default();
        let Some(RouteTypes::Topic(Types { to: carried, .. })) = candidate.made else {
            return misfits;
        };
        let is_given = spec.typing == Typing::Given;
        let between_ros = self.are_both_ros(from, to);
        let untyped = self.routing_properties(from).untyped;
        let Some(target) = self.graph.get(&to.middleware) else { return misfits };
        let Some(middleware) = target.middleware.clone() else { return misfits };
        let mut served = false;
        for listener in target.endpoints(Role::Listener, &to.name) {
            let Ok(learned) = middleware.learn_topic(listener, &mut self.types) else { continue };
            let wanted = learned.message_type(between_ros);
            if wanted.ros_type() == carried.ros_type() {
                served = true;
                continue;
            }
            let fits = || may_be_read_as(carried.data_type(), wanted.data_type());
            if untyped && !is_given && candidate.left_type != Some(wanted.label()) && fits() {
                misfits.instead = misfits.instead.or(Some(wanted));
            }
            misfits.named.get_or_insert_with(|| Misfit {
                peer: listener.node.clone().unwrap_or_else(|| "a listener".to_owned()),
                theirs: wanted.ros_type().to_owned(),
            });
        }
        if served {
            misfits.instead = None;
        }
        misfits
    }

    fn are_both_ros(&self, from: &EndpointAddress, to: &EndpointAddress) -> bool {
        [from, to].into_iter().all(|end| self.routing_properties(end).any_ros_type)
    }

    /// True when both ends have publishers of other programs and a middleware shows no marks, so
    /// that nothing tells which of them are a bridge's.
    fn is_on_both_sides(
        &self,
        interaction: Interaction,
        from: &EndpointAddress,
        to: &EndpointAddress,
    ) -> bool {
        let tells = |end| self.routing_properties(end).shows_marks;
        if interaction != Interaction::Topic || (tells(from) && tells(to)) {
            return false;
        }
        let Some(side) = self.graph.get(&to.middleware) else { return false };
        let is_ours = !side.routing_properties().tells_own
            && self.ours.contains_key(&(interaction, to.clone()));
        !is_ours && !side.endpoints(interaction.provider(), &to.name).is_empty()
    }

    fn middleware(&self, end: &EndpointAddress) -> Option<&Arc<dyn Middleware>> {
        self.graph.get(&end.middleware)?.middleware.as_ref()
    }

    fn routing_properties(&self, end: &EndpointAddress) -> RoutingProperties {
        self.middleware(end).map(|it| it.routing_properties()).unwrap_or_default()
    }

    fn without_marks<'a>(&self, from: &'a EndpointAddress, to: &'a EndpointAddress) -> &'a str {
        if self.routing_properties(from).shows_marks { &to.middleware } else { &from.middleware }
    }

    /// Type of a topic, and whether its source shows it: neither what the source is about to tell nor a type that it
    /// announces without a definition gives way to another one that listeners want.
    fn learn_topic(
        &mut self,
        sources: &[Discovered],
        from: &EndpointAddress,
        to: &EndpointAddress,
        otherwise: Option<MessageType>,
    ) -> Result<(MessageType, bool), Refusal> {
        let between_ros = self.are_both_ros(from, to);
        let (Some(source), Some(target)) =
            (self.graph.get(&from.middleware), self.graph.get(&to.middleware))
        else {
            return Err(waiting(Cause::Starting("its middlewares")));
        };
        let listeners = target.endpoints(Role::Listener, &to.name);
        let mut why = None;
        for (side, at, endpoints) in [(source, from, sources), (target, to, listeners)] {
            let Some(middleware) = &side.middleware else { continue };
            let announced = match &why {
                Some(LearnError::Asked(_)) => break,
                Some(LearnError::Undefined { type_name, .. }) => Some(type_name.clone()),
                _ => None,
            };
            let mut told: BTreeMap<&str, MessageType> = BTreeMap::new();
            for one in endpoints {
                match middleware.learn_topic(one, &mut self.types) {
                    Ok(learned) => {
                        let learned = learned.message_type(between_ros);
                        if announced.as_ref().is_none_or(|name| name == learned.ros_type()) {
                            told.insert(learned.label(), learned);
                        }
                    }
                    Err(error) => why = why.or(Some(error)),
                }
            }
            if told.len() > 1 {
                let types = told.into_keys().map(str::to_owned).collect();
                let cause = Cause::SeveralTypes { at: at.to_string(), types };
                return Err(Box::new((RouteState::Error(cause), RETRY)));
            }
            if let Some((_, learned)) = told.pop_first() {
                return Ok((learned, at == from));
            }
        }
        match (otherwise, why) {
            (Some(known), None | Some(LearnError::Untold(_))) if !sources.is_empty() => {
                Ok((known, false))
            }
            (_, Some(error)) => Err(refused(error)),
            (_, None) => Err(waiting(Cause::Untyped(Absent::at(Role::Publisher, from)))),
        }
    }

    fn learn_called<T>(
        &mut self,
        (role, sources): (Role, &[Discovered]),
        from: &EndpointAddress,
        otherwise: Option<T>,
        learn: Learn<T>,
    ) -> Result<T, Refusal> {
        let middleware = self.middleware(from).cloned();
        let (Some(middleware), Some(server)) = (middleware, sources.first()) else {
            return Err(waiting(Cause::Untyped(Absent::at(role, from))));
        };
        match (learn(&*middleware, server, &mut self.types), otherwise) {
            (Ok(kind), _) | (Err(LearnError::Untold(_)), Some(kind)) => Ok(kind),
            (Err(error), _) => Err(refused(error)),
        }
    }
}

/// Way in which a middleware learns the type of a service or an action.
type Learn<T> = fn(&dyn Middleware, &Discovered, &mut TypeStore) -> LearnResult<T>;

/// Listeners of other types than a route's.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Misfits {
    /// The first of these listeners.
    pub(super) named: Option<Misfit>,
    /// Type that the route may carry instead, where no listener wants its own.
    pub(super) instead: Option<MessageType>,
}

/// True when messages without a type that look like `looks` may also be read as `wanted`.
pub fn may_be_read_as(looks: DataType, wanted: DataType) -> bool {
    let fields = [DataType::NativeObject, DataType::RosMessage];
    looks == wanted || (fields.contains(&looks) && fields.contains(&wanted))
}

/// True where messages of one type are those of the other. Two types of ROS with one name may be two definitions.
fn is_same(one: MessageType, other: MessageType) -> bool {
    let are_ros = matches!((one, other), (MessageType::Ros(_), MessageType::Ros(_)));
    one == other || (!are_ros && one.label() == other.label())
}

fn refused(error: LearnError) -> Refusal {
    // The middleware asks again by itself, and the answer may come before `RETRY`.
    let is_on_its_way = matches!(error, LearnError::Asked(_) | LearnError::Silent { .. });
    let again = if is_on_its_way { Duration::ZERO } else { RETRY };
    Box::new((RouteState::Waiting(error.into()), again))
}
