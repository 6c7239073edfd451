//! Settings with which the middlewares of a bridge start: with other settings it is another middleware.
//!
//! ```text
//!   Endpoints + Plan ─ Settings::of ─▶ zeromq, yarp, ros: compared by meaning, each starts anew alone
//!                                      ros2: the bridge is a node there, and stays as it began
//! ```

use std::collections::BTreeMap;

use wrapyfi_endpoint::Planned;
use wrapyfi_endpoint::driver::Purpose;
use wrapyfi_engine::Plan;
use wrapyfi_ros2::{self as ros2, environment};

use super::drivers::names;
use super::endpoints::Endpoints;
use crate::exit::{Failure, Result};

/// Settings of all middlewares of a bridge.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Settings {
    /// Settings of the middlewares that start and end by themselves.
    pub(super) each: BTreeMap<&'static str, Planned>,
    /// Settings of the bridge's node on ROS 2, each by its key; `None` where there is no node.
    node: Option<BTreeMap<&'static str, String>>,
    /// The largest message on each, in bytes.
    pub(super) largest: BTreeMap<String, usize>,
}

impl Settings {
    /// Settings for the routes of a plan. A middleware that took larger messages `before` still does.
    ///
    /// # Errors
    /// Exit code 2 for settings that cannot work.
    pub fn of(endpoints: &Endpoints, plan: &Plan, before: &Self) -> Result<Self> {
        let mut largest = before.largest.clone();
        for name in names().iter().filter(|name| plan.uses(name)) {
            let most = largest.entry((*name).to_owned()).or_default();
            *most = plan.largest_message_on(name).max(*most);
        }
        let of = |name: &str| largest.get(name).copied().unwrap_or_default();
        let mut each = BTreeMap::new();
        // On ROS 2 the bridge is a node.
        for name in names().iter().filter(|name| **name != ros2::NAME && plan.uses(name)) {
            let has_services = plan.has_services_on(name);
            let purpose = Purpose::Routes { has_services, is_reached: plan.is_reached_on(name) };
            each.insert(*name, endpoints.plan(name, of(name), purpose)?);
        }
        let node = if plan.uses(ros2::NAME) {
            let ros2 = endpoints.ros2();
            let environment = environment::read(|name| std::env::var(name).ok());
            let environment = environment.map_err(Failure::usage)?;
            let domain_id = ros2.domain_id(environment.domain_id);
            let interface = ros2.interface.clone().unwrap_or("left out".to_owned());
            let graph = ros2.graph.map_or("left out".to_owned(), |graph| format!("{graph:?}"));
            Some(BTreeMap::from([
                ("endpoints.ros2.domain_id", domain_id.to_string()),
                ("endpoints.ros2.interface", interface),
                ("endpoints.ros2.graph", graph),
                ("max_message_mib", format!("enough for {} bytes", of(ros2::NAME))),
            ]))
        } else {
            before.node.clone()
        };
        Ok(Self { each, node, largest })
    }

    /// Settings of `new` that a bridge with these settings cannot change to, each with its key: the
    /// node on ROS 2, with its parameters, its log and its clock, is the program's own.
    pub fn refusals(&self, new: &Self) -> Vec<String> {
        match (&self.node, &new.node) {
            (None, Some(_)) => vec!["no route was on ros2 at the start".to_owned()],
            (Some(before), Some(now)) => {
                let both = before.iter().zip(now.values()).filter(|((_, was), is)| was != is);
                let tell = |((key, was), is): ((&&str, &String), &String)| {
                    format!("{key} was {was} at the start and is {is} now")
                };
                both.map(tell).collect()
            }
            (_, None) => Vec::new(),
        }
    }

    /// Middlewares that start or end where a bridge turns from these settings to `new`, in words.
    pub fn changes(&self, new: &Self) -> Vec<String> {
        let begins = new.each.iter().filter_map(|(name, settings)| match self.each.get(name) {
            None => Some(format!("{name} starts")),
            Some(before) => (before != settings).then(|| format!("{name} starts anew")),
        });
        let ends = self.each.keys().filter(|name| !new.each.contains_key(*name));
        begins.chain(ends.map(|name| format!("{name} ends"))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::load::{Loaded, load_text};
    use super::*;

    const ROUTES: &str = "routes:\n  - { from: 'zeromq:/a', to: 'ros2:/a', type: Text }\n";

    fn settings(text: &str, before: &Settings) -> Settings {
        let Loaded { plan, endpoints, .. } = load_text(text, "test").unwrap();
        Settings::of(&endpoints, &plan, before).unwrap()
    }

    #[test]
    fn settings_are_compared_by_meaning_and_each_middleware_by_itself() {
        let none = Settings::default();
        let before = settings(ROUTES, &none);
        let with = |more: &str| settings(&format!("{more}{ROUTES}"), &before);
        for same in [
            "endpoints: { yarp: { embedded: true } }\n",
            "endpoints: { zeromq: { ip: 127.0.0.1, pub_port: 5555, broker: embedded } }\n",
        ] {
            assert_eq!(with(same), before, "{same}");
        }
        let other = with("endpoints: { zeromq: { pub_port: 7000 } }\n");
        assert_eq!(before.changes(&other), ["zeromq starts anew"]);
        let more = "  - { from: 'ros:/b', to: 'zeromq:/b', type: Text, max_message_mib: 100 }\n";
        let more = settings(&format!("{ROUTES}{more}"), &before);
        assert_eq!(before.changes(&more), ["ros starts", "zeromq starts anew"]);
        assert_eq!(
            more.changes(&settings(ROUTES, &more)),
            ["ros ends"],
            "room for more is no fault"
        );
        assert_eq!(before.refusals(&more), [""; 0]);
    }

    #[test]
    fn what_needs_a_start_of_the_program_is_named_by_its_key() {
        let before = settings(ROUTES, &Settings::default());
        let now =
            settings(&format!("endpoints: {{ ros2: {{ domain_id: 77 }} }}\n{ROUTES}"), &before);
        let told = before.refusals(&now);
        assert_eq!(told.len(), 1, "{told:?}");
        assert!(told[0].starts_with("endpoints.ros2.domain_id was "), "{told:?}");
        assert!(told[0].ends_with(" at the start and is 77 now"), "{told:?}");
        let larger = "  - { from: 'zeromq:/b', to: 'ros2:/b', type: Text, max_message_mib: 100 }\n";
        let told = before.refusals(&settings(&format!("{ROUTES}{larger}"), &before));
        assert!(told.len() == 1 && told[0].starts_with("max_message_mib was enough"), "{told:?}");
        let other = "routes:\n  - { from: 'zeromq:/a', to: 'yarp:/a', type: Text }\n";
        let other = settings(other, &Settings::default());
        assert_eq!(other.refusals(&before), ["no route was on ros2 at the start"]);
    }
}
