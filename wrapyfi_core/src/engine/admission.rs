//! Admission of candidates as routes: loops, rivals, types.
//!
//! ```text
//!   left out   the configuration has a route for it; it would come back to where it is from
//!   rival      another bridge carries it, or somebody else offers the service
//!   made       its type is known: given, told by its source, by its destination, or `type_if_unknown`
//! ```

use std::collections::BTreeMap;
use std::time::Duration;

use super::candidate::Candidate;
use super::config_qos::QosConfig;
use super::plan_pattern::{Carried, PatternSpec};
use super::reconciler::Reconciler;
use super::route::{Route, RouteState};
use crate::endpoint::{BridgeMark, Discovered, Durability, EndpointAddress, LearnError, Role};
use crate::types::{DataType, MessageType, ServiceKind};

/// How soon to try again what cannot be made now.
const RETRY: Duration = Duration::from_secs(2);

/// Why there is no route, and how soon to look again.
type Refusal = (RouteState, Duration);

fn waiting(what: String) -> Refusal {
    (RouteState::Waiting(what), Duration::ZERO)
}

impl Reconciler {
    /// Whether a name is none of the pattern's business, though it matches.
    pub(super) fn is_left_out(
        &self,
        spec: &PatternSpec,
        from: &EndpointAddress,
        to: &EndpointAddress,
    ) -> bool {
        let comes_back = self.sources(spec.role(), from, &to.middleware).next().is_none();
        comes_back || self.is_by_hand(spec, from, to)
    }

    /// Whether the configuration has a route of its own for it.
    pub(super) fn is_by_hand(
        &self,
        spec: &PatternSpec,
        from: &EndpointAddress,
        to: &EndpointAddress,
    ) -> bool {
        let role = spec.role();
        self.explicit.iter().any(|written| {
            written.role == role
                && ((written.from == *from && written.to.middleware == to.middleware)
                    || (written.to == *from && written.from.middleware == to.middleware)
                    || written.to == *to)
        })
    }

    /// The endpoints of a source that do not come from where it would go.
    fn sources<'s>(
        &'s self,
        role: Role,
        from: &EndpointAddress,
        to: &'s str,
    ) -> impl Iterator<Item = &'s Discovered> {
        let side = self.graph.get(&from.middleware);
        let tells = side.is_some_and(|side| side.traits().tells_own);
        let is_own = !tells && self.ours.contains_key(&(role, from.clone()));
        let all = side.map_or(&[][..], |side| side.endpoints(role, &from.name));
        let came_back =
            |one: &&Discovered| one.mark.as_ref().is_some_and(|mark| mark.came_through(to));
        all.iter().filter(move |one| !is_own && !came_back(one))
    }

    /// Who else does what the candidate's route would do, in words.
    pub(super) fn rival(&self, spec: &PatternSpec, candidate: &Candidate) -> Option<String> {
        let Candidate { from, to, .. } = candidate;
        let side = self.graph.get(&to.middleware)?;
        let role = spec.role();
        if !side.traits().tells_own && self.ours.contains_key(&(role, to.clone())) {
            return None;
        }
        let who = |one: &Discovered| one.node.clone().unwrap_or_else(|| "another program".into());
        side.endpoints(role, &to.name).iter().find_map(|one| match (role, &one.mark) {
            (_, Some(mark)) if mark.bridge >= self.number => None,
            (Role::Server, _) => {
                Some(format!("the name {to}, under which {} offers a service", who(one)))
            }
            (_, Some(mark)) if mark.came_through(&from.middleware) => {
                Some(format!("the bridge {}, which carries it to {to} already", who(one)))
            }
            _ => None,
        })
    }

    /// The route, or why there is none.
    pub(super) fn make(
        &mut self,
        spec: &PatternSpec,
        candidate: &Candidate,
    ) -> Result<Route, Refusal> {
        let Candidate { from, to, .. } = candidate;
        let role = spec.role();
        if spec.is_many() {
            if let Some(rival) = self.rival(spec, candidate) {
                return Err(waiting(rival));
            }
            if let Some(other) = self.taken(role, to) {
                return Err(waiting(format!("the name {to}, to which {other} goes")));
            }
            if self.is_on_both_sides(role, from, to) {
                return Err(waiting(format!(
                    "a decision: {from} and {to} both have publishers, and {} does not tell which \
                     are bridges'; write a route for it",
                    self.without_marks(from, to)
                )));
            }
        }
        let sources: Vec<Discovered> = self.sources(role, from, &to.middleware).cloned().collect();
        let mark = spec.is_many().then(|| {
            let marks = sources.iter().filter_map(|one| one.mark.as_ref());
            BridgeMark::of(self.number, marks, &from.middleware)
        });
        let name = if spec.is_many() { candidate.name(role) } else { spec.name.clone() };
        match &spec.carried {
            Carried::Topics { template, typed, otherwise } => {
                let mut route = template.as_ref().clone();
                (route.name, route.mark) = (name, mark);
                (route.from, route.to) = (from.clone(), to.clone());
                if !typed {
                    let learned = match candidate.wished {
                        Some(wished) => wished,
                        None => {
                            let learned = self.learn_topic(&sources, from, to, *otherwise)?;
                            let source = self.graph.get(&from.middleware);
                            let source = source.and_then(|side| side.middleware.as_ref());
                            source.map_or(learned, |it| it.received_as(learned, &route.options))
                        }
                    };
                    (route.message_type, route.from_type) = (learned, learned);
                }
                let keeps = (route.lazy || sources.iter().any(|one| one.qos.is_some()))
                    && self.keeps_last(spec, candidate);
                if let QosConfig::Match(qos) = &mut route.qos
                    && keeps
                {
                    // What its publishers keep for those who come later is kept on the other side too.
                    qos.durability = Durability::TransientLocal;
                }
                Ok(Route::Topic(Box::new(route)))
            }
            Carried::Services { template, typed, otherwise } => {
                let mut route = template.as_ref().clone();
                (route.name, route.mark) = (name, mark);
                (route.service, route.offered) = (from.clone(), to.clone());
                if !typed {
                    route.kind = self.learn_service(&sources, from, *otherwise)?;
                }
                Ok(Route::Service(Box::new(route)))
            }
        }
    }

    /// Whether a publisher of the source has told that it keeps its last message. Every one is asked:
    /// nobody can listen to kept messages of a destination that does not offer any, so a lazy route
    /// opens its source for them.
    pub(super) fn keeps_last(&self, spec: &PatternSpec, candidate: &Candidate) -> bool {
        let Candidate { from, to, .. } = candidate;
        let side = self.graph.get(&from.middleware);
        let Some(middleware) = side.and_then(|side| side.middleware.as_ref()) else {
            return false;
        };
        let sources = self.sources(spec.role(), from, &to.middleware);
        let mut keeps = false;
        for one in sources {
            keeps |= middleware.keeps_last(one) == Some(true);
        }
        keeps
    }

    /// The type that publishers of the source tell, where they do.
    pub(super) fn told_by_sources(
        &mut self,
        spec: &PatternSpec,
        candidate: &Candidate,
    ) -> Option<&'static str> {
        let Candidate { from, to, .. } = candidate;
        if let Carried::Topics { typed: true, template, .. } = &spec.carried {
            return Some(template.message_type.label());
        }
        let sources: Vec<Discovered> =
            self.sources(spec.role(), from, &to.middleware).cloned().collect();
        let between_ros = self.are_both_ros(from, to);
        let middleware = self.graph.get(&from.middleware)?.middleware.clone()?;
        let mut told = sources.iter().filter_map(|one| {
            let learned = middleware.learn_topic(one, &mut self.types).ok()?;
            Some(learned.message_type(between_ros).label())
        });
        told.next()
    }

    /// What listeners at the destination of a route want that it does not give them.
    pub(super) fn misfits(&mut self, spec: &PatternSpec, candidate: &Candidate) -> Misfits {
        let Candidate { from, to, .. } = candidate;
        let mut misfits = Misfits::default();
        let (Carried::Topics { typed, .. }, Some(carried)) = (&spec.carried, candidate.carried)
        else {
            return misfits;
        };
        let between_ros = self.are_both_ros(from, to);
        let untyped = self.graph.get(&from.middleware).is_some_and(|side| side.traits().untyped);
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
            if untyped && !typed && may_be_read_as(carried, wanted) {
                misfits.instead = misfits.instead.or(Some(wanted));
            }
            let who = listener.node.as_deref().unwrap_or("a listener");
            let text = format!("{who} wants {}", wanted.ros_type());
            misfits.named.get_or_insert(text);
        }
        if served {
            misfits.instead = None;
        }
        misfits
    }

    fn are_both_ros(&self, from: &EndpointAddress, to: &EndpointAddress) -> bool {
        [from, to].into_iter().all(|end| {
            self.graph.get(&end.middleware).is_some_and(|side| side.traits().any_ros_type)
        })
    }

    /// Whether both ends have publishers of other programs, where a middleware shows no marks.
    fn is_on_both_sides(&self, role: Role, from: &EndpointAddress, to: &EndpointAddress) -> bool {
        let tells = |address: &EndpointAddress| {
            self.graph.get(&address.middleware).is_some_and(|side| side.traits().shows_marks)
        };
        if role != Role::Publisher || (tells(from) && tells(to)) {
            return false;
        }
        let Some(side) = self.graph.get(&to.middleware) else { return false };
        let is_ours = !side.traits().tells_own && self.ours.contains_key(&(role, to.clone()));
        !is_ours && !side.endpoints(role, &to.name).is_empty()
    }

    fn without_marks<'a>(&self, from: &'a EndpointAddress, to: &'a EndpointAddress) -> &'a str {
        let tells = self.graph.get(&from.middleware).is_some_and(|side| side.traits().shows_marks);
        if tells { &to.middleware } else { &from.middleware }
    }

    fn learn_topic(
        &mut self,
        sources: &[Discovered],
        from: &EndpointAddress,
        to: &EndpointAddress,
        otherwise: Option<MessageType>,
    ) -> Result<MessageType, Refusal> {
        let between_ros = self.are_both_ros(from, to);
        let (Some(source), Some(target)) =
            (self.graph.get(&from.middleware), self.graph.get(&to.middleware))
        else {
            return Err(waiting("its middlewares".to_owned()));
        };
        let listeners = target.endpoints(Role::Listener, &to.name);
        let mut why = None;
        for (side, endpoints) in [(source, sources), (target, listeners)] {
            let Some(middleware) = &side.middleware else { continue };
            let mut told: BTreeMap<&str, MessageType> = BTreeMap::new();
            for one in endpoints {
                match middleware.learn_topic(one, &mut self.types) {
                    Ok(learned) => {
                        let learned = learned.message_type(between_ros);
                        told.insert(learned.label(), learned);
                    }
                    Err(error) => why = why.or(Some(error)),
                }
            }
            if told.len() > 1 {
                let names: Vec<&str> = told.into_keys().collect();
                let text = format!("{} has several types: {}; give `type`", from, names.join(", "));
                return Err((RouteState::Error(text), RETRY));
            }
            if let Some((_, learned)) = told.pop_first() {
                return Ok(learned);
            }
        }
        match (otherwise, why) {
            (Some(known), None | Some(LearnError::Untold { .. })) if !sources.is_empty() => {
                Ok(known)
            }
            (_, Some(error)) => Err(refused(&error)),
            (_, None) => Err(waiting(format!("a publisher on {from}, which tells the type"))),
        }
    }

    fn learn_service(
        &mut self,
        sources: &[Discovered],
        from: &EndpointAddress,
        otherwise: Option<ServiceKind>,
    ) -> Result<ServiceKind, Refusal> {
        let side = self.graph.get(&from.middleware);
        let (Some(middleware), Some(server)) =
            (side.and_then(|side| side.middleware.as_ref()), sources.first())
        else {
            return Err(waiting(format!("a server of {from}, which tells the type")));
        };
        match (middleware.learn_service(server, &mut self.types), otherwise) {
            (Ok(kind), _) | (Err(LearnError::Untold { .. }), Some(kind)) => Ok(kind),
            (Err(error), _) => Err(refused(&error)),
        }
    }
}

/// Listeners of other types than a route's.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Misfits {
    /// The first one, in words.
    pub(super) named: Option<String>,
    /// The type that the route may carry instead: nobody wants its own.
    pub(super) instead: Option<MessageType>,
}

/// Whether messages that come without a type may be read as another one than they look like.
fn may_be_read_as(looks: MessageType, wanted: MessageType) -> bool {
    let fields = [DataType::NativeObject, DataType::RosMessage];
    let (looks, wanted) = (looks.data_type(), wanted.data_type());
    looks == wanted || (fields.contains(&looks) && fields.contains(&wanted))
}

fn refused(error: &LearnError) -> Refusal {
    // Middlewares ask the silent again when it is time; the answer may come meanwhile.
    let is_on_its_way = matches!(error, LearnError::Asked { .. } | LearnError::Silent { .. });
    let again = if is_on_its_way { Duration::ZERO } else { RETRY };
    (RouteState::Waiting(error.to_string()), again)
}
