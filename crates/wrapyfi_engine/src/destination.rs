//! Destination of a source that a pattern matches, where names of the two sides are not spelt alike.
//!
//! ```text
//!   yarp:/a/b:o beside yarp:/a/b/o              ─▶ ros2:/a/b/o_        another source has the name
//!   ros2:/robot_1/cmd, awaited on ros:/robot-1/cmd ─▶ ros:/robot-1/cmd   no name of ROS 2, so this one is meant
//! ```

use std::collections::BTreeMap;

use super::reconciler::Reconciler;
use super::route::{Route, may_be_meant};
use wrapyfi_endpoint::pattern::ros_name;
use wrapyfi_endpoint::{EndpointAddress, Interaction, Role};

/// Names that listeners at a destination have, by what ROS 2 has instead; `None` where two have the same replacement.
pub(super) type Awaited = BTreeMap<String, Option<String>>;

impl Reconciler {
    /// Destination of the source called `name`, which by itself would go to `to`.
    pub(super) fn destination(
        &self,
        index: usize,
        name: &str,
        to: EndpointAddress,
        awaited: &Awaited,
    ) -> EndpointAddress {
        let to = self.without_collision(index, name, to);
        // Who listens to the very name is meant; so is the listener that was meant before, while no program does.
        if self.is_awaited(&to) {
            return to;
        }
        let known = self.candidates.get(&(index, name.to_owned())).map(|it| &it.to);
        let known = known.filter(|it| may_be_meant(&to, it)).map(|it| &it.name);
        let meant = awaited.get(&to.name).and_then(Option::as_ref).or(known);
        EndpointAddress { name: meant.unwrap_or(&to.name).clone(), ..to }
    }

    /// Names at the destination of a pattern that are awaited there and are none of ROS 2. Nothing tells who calls a
    /// service, and a colon alone is the business of the middleware, which knows its ports.
    pub(super) fn awaited_otherwise(&self, spec: &Route) -> Awaited {
        let side =
            self.graph.get(&spec.to.middleware).filter(|side| side.routing_properties().tells_own);
        let is_asked = spec.interaction() == Interaction::Topic && spec.has_names_of_ros();
        let mut awaited = Awaited::new();
        let names = side.filter(|_| is_asked).into_iter().flat_map(|it| it.names(Role::Listener));
        for name in names {
            let replaced = ros_name(name);
            let is_odd = replaced != name.replace(':', "/");
            let at = EndpointAddress { name: name.clone(), ..spec.to.clone() };
            if is_odd && self.is_awaited(&at) {
                let one = awaited.entry(replaced);
                one.and_modify(|other| *other = None).or_insert_with(|| Some(name.clone()));
            }
        }
        awaited
    }

    /// True where a program that is no bridge listens to the name.
    fn is_awaited(&self, to: &EndpointAddress) -> bool {
        let side = self.graph.get(&to.middleware);
        let all = side.map_or(&[][..], |side| side.endpoints(Role::Listener, &to.name));
        all.iter().any(|one| one.mark.is_none())
    }

    /// Destination of the source called `name`, which by itself would go to `to`. Names of YARP may
    /// differ by a colon alone, which no name of ROS has: where `/a/b:o` and `/a/b/o` would become
    /// one name, the one with the colon becomes `/a/b/o_`.
    fn without_collision(
        &self,
        index: usize,
        name: &str,
        mut to: EndpointAddress,
    ) -> EndpointAddress {
        let (Some((before, last)), Some(pattern)) =
            (name.rsplit_once(':'), self.patterns.get(index))
        else {
            return to;
        };
        let (spec, plain) = (&pattern.spec, format!("{before}/{last}"));
        let Some(side) = self.graph.get(&spec.from.middleware) else { return to };
        let others = self.patterns.iter().map(|other| &other.spec);
        let mut others = others.filter(|other| {
            other.interaction() == spec.interaction()
                && other.from.middleware == spec.from.middleware
        });
        if !side.endpoints(spec.interaction().provider(), &plain).is_empty()
            && others.any(|other| other.target(&plain).as_ref() == Some(&to))
        {
            to.name.push('_');
        }
        to
    }
}
