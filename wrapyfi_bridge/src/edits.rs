//! Routes that a running bridge was told to add or to leave out, beside what its file says.
//!
//! ```text
//!   ~/add_route ────┐                 added: entries after those of the file
//!   ~/remove_route ─┴─▶ Edits ─▶ Plan removed: routes that are left out
//! ```

use std::collections::BTreeMap;

use wrapyfi_endpoint::EndpointAddress;
use wrapyfi_endpoint::config::in_no_file;
use wrapyfi_engine::{Config, Plan, Route, RouteConfig, Spanned};

use crate::exit::{Failure, Result};
use crate::middlewares::{Loaded, SectionNames};

/// Name of the text of an added route in errors.
pub(crate) const SOURCE: &str = "the added route";

/// Changes to the routes of a file, as long as a bridge runs.
#[derive(Debug, Clone, Default)]
pub struct Edits {
    added: Vec<Spanned<RouteConfig>>,
    /// Names by which routes were left out, each with its route.
    removed: BTreeMap<String, Option<Route>>,
}

impl Edits {
    /// Entries that stand after those of the file.
    pub fn added(&self) -> &[Spanned<RouteConfig>] {
        &self.added
    }

    /// Routes of the file that are left out.
    pub fn removed(&self) -> Plan {
        Plan { routes: self.removed.values().flatten().cloned().collect() }
    }

    /// Adds an entry of `routes`, given in YAML. A route of the file that was left out comes back as the file has it,
    /// where the entry has the same ends.
    ///
    /// # Errors
    /// When the text is no entry; lines count from the one before it.
    pub fn add(&mut self, text: &str) -> Result<()> {
        // Indented, no line of it can be another key of the configuration.
        let list = format!("routes:\n- {}", text.trim().replace('\n', "\n  "));
        let config: Config<SectionNames> =
            Config::from_yaml(&list, SOURCE).map_err(Failure::usage)?;
        let mut entries = config.routes.into_iter();
        match (entries.next(), entries.next()) {
            (Some(entry), None) if entry.value.from.is_some() || entry.value.service.is_some() => {
                let ends = ends(&entry.value);
                let before = self.removed.len();
                self.removed.retain(|_, it| it.as_ref().map(Route::ends).as_ref() != Some(&ends));
                if self.removed.len() == before {
                    self.added.push(in_no_file(entry.value));
                }
            }
            _ => {
                return Err(Failure::Usage(format!(
                    "{SOURCE}: it must be one entry of `routes`, such as \
                     {{from: \"zeromq:/a\", to: \"ros2:/a\", type: Text}}"
                )));
            }
        }
        Ok(())
    }

    /// Leaves out a route, which the plan must have.
    pub fn remove(&mut self, name: &str) {
        self.removed.insert(name.to_owned(), None);
    }

    /// Takes the routes that are left out from a plan that was made of the file's entries and those that were added.
    /// Names that mean nothing in it any more are forgotten.
    ///
    /// # Errors
    /// When `wanted` is none of its routes.
    pub fn leave_out(&mut self, wanted: Option<&str>, loaded: &mut Loaded) -> Result<()> {
        let Loaded { plan, lines, .. } = loaded;
        for name in std::mem::take(&mut self.removed).into_keys() {
            let of_file = plan.routes.len().saturating_sub(self.added.len());
            match place(plan, &name) {
                Some(at) if at >= of_file => drop(self.added.remove(at - of_file)),
                Some(at) => drop(self.removed.insert(name.clone(), plan.routes.get(at).cloned())),
                None if wanted == Some(name.as_str()) => {
                    if let Some(text) = of_pattern(plan, &name) {
                        return Err(Failure::Usage(text));
                    }
                    let names: Vec<_> =
                        plan.routes.iter().map(|route| route.name.as_str()).collect();
                    let text = format!("no route is called {name}: there are {}", names.join(", "));
                    return Err(Failure::Usage(text));
                }
                None => continue,
            }
            if let Some(at) = place(plan, &name) {
                plan.routes.remove(at);
                if at < lines.len() {
                    lines.remove(at);
                }
            }
        }
        Ok(())
    }
}

/// Ends of an entry, as those of its route are written.
fn ends(entry: &RouteConfig) -> String {
    let [source, destination] = entry.ends().map(|end| end.map_or("", |end| end.value.as_str()));
    let [from, to] = entry.interaction().in_direction(source, destination);
    format!("{from} -> {to}")
}

/// Remedy for a route that a pattern of the plan makes, which is in no plan itself.
fn of_pattern(plan: &Plan, name: &str) -> Option<String> {
    let source: EndpointAddress = name.split(" -> ").next()?.parse().ok()?;
    let is_source = |pattern: &&Route| {
        pattern.is_many()
            && pattern.from.middleware == source.middleware
            && pattern.target(&source.name).is_some()
    };
    let pattern = plan.routes.iter().find(is_source)?;
    Some(format!(
        "{name} is made by the pattern {}: to leave {source} out, write `deny: [\"{}\"]` on it in the file; \
         removing {} removes all that it makes",
        pattern.name, source.name, pattern.name
    ))
}

/// Place in the plan of the route with this name or these ends.
fn place(plan: &Plan, name: &str) -> Option<usize> {
    plan.routes.iter().position(|route| route.name == name || route.ends() == name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::middlewares::load_text;

    const FILE: &str = "routes:\n- {name: a, from: 'zeromq:/a', to: 'ros2:/a', type: Text}\n";
    const ADDED: &str = "name: b\nfrom: 'zeromq:/b'\nto: 'ros2:/b'\ntype: Text\n";

    fn loaded() -> Loaded {
        let both = format!("{FILE}- {{name: b, from: 'zeromq:/b', to: 'ros2:/b', type: Text}}\n");
        load_text(&both, "file").unwrap()
    }

    fn names(loaded: &Loaded) -> Vec<String> {
        loaded.plan.routes.iter().map(|route| route.name.clone()).collect()
    }

    #[test]
    fn a_route_is_added_in_block_and_in_flow_style() {
        let mut edits = Edits::default();
        edits.add(ADDED).unwrap();
        edits.add("{from: 'zeromq:/c', to: 'ros2:/c', type: Text}").unwrap();
        assert_eq!(edits.added().len(), 2);
        for wrong in ["", "a", "{form: 'zeromq:/a'}", "endpoints: {}", "{}\n- {}"] {
            let refused = edits.add(wrong);
            assert!(refused.is_err_and(|error| error.to_string().contains(SOURCE)), "{wrong}");
        }
        assert_eq!(edits.added().len(), 2);
    }

    #[test]
    fn a_route_of_the_file_stays_away_and_an_added_one_is_forgotten() {
        let mut edits = Edits::default();
        edits.add(ADDED).unwrap();
        edits.remove("a");
        edits.remove("zeromq:/b -> ros2:/b");
        let mut plan = loaded();
        edits.leave_out(Some("a"), &mut plan).unwrap();
        assert_eq!((names(&plan).len(), plan.lines.len(), edits.added().len()), (0, 0, 0));
        let removed = edits.removed().routes;
        assert_eq!(removed.iter().map(|route| &route.name[..]).collect::<Vec<_>>(), ["a"]);
        // The file alone, read again.
        let mut plan = load_text(FILE, "file").unwrap();
        edits.leave_out(None, &mut plan).unwrap();
        assert_eq!(names(&plan).len(), 0);
    }

    #[test]
    fn a_route_of_the_file_that_was_left_out_comes_back() {
        for entry in [
            "name: a, from: 'zeromq:/a', to: 'ros2:/a', type: Text",
            "name: a, service: 'ros2:/a', as: 'yarp:/a', type: std_srvs/srv/Trigger",
        ] {
            let file = format!("routes:\n- {{{entry}}}\n");
            let mut edits = Edits::default();
            edits.remove("a");
            edits.leave_out(Some("a"), &mut load_text(&file, "file").unwrap()).unwrap();
            edits.add(&format!("{{{entry}}}")).unwrap();
            assert_eq!(edits.added().len(), 0, "{entry}");
            let mut plan = load_text(&file, "file").unwrap();
            edits.leave_out(None, &mut plan).unwrap();
            assert_eq!(names(&plan), ["a"]);
        }
    }

    #[test]
    fn a_route_that_a_pattern_makes_is_left_out_by_its_deny() {
        let file = "routes:\n- {name: all, from: 'ros:/(.*)', to: 'ros2:/$1'}\n";
        for name in ["ros:/scan", "ros:/scan -> ros2:/scan"] {
            let mut edits = Edits::default();
            edits.remove(name);
            let mut plan = load_text(file, "file").unwrap();
            let error = edits.leave_out(Some(name), &mut plan).unwrap_err().to_string();
            assert!(
                error.contains("pattern all") && error.contains("deny: [\"/scan\"]"),
                "{error}"
            );
        }
    }

    #[test]
    fn a_name_that_is_none_is_an_error_with_those_that_are() {
        let mut edits = Edits::default();
        edits.add(ADDED).unwrap();
        edits.remove("z");
        let error = edits.leave_out(Some("z"), &mut loaded()).unwrap_err().to_string();
        assert!(error.contains('z') && error.contains("a, b"), "{error}");
    }
}
