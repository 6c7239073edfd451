//! The key `options` of a route: settings that only some middlewares have.
//!
//! ```text
//!   options: { carrier: fast_tcp, joints: [neck, eye] }  ──▶  Map of values, each known and right at one end at least
//! ```

use std::collections::BTreeMap;

use serde_saphyr::Spanned;
use wrapyfi_data::did_you_mean;

use wrapyfi_data::types::{Map, RosAction, Value, to_value};
use wrapyfi_endpoint::config::Problem;
use wrapyfi_endpoint::driver::Available;
use wrapyfi_endpoint::function_action::{FEEDBACK, UNTIL};
use wrapyfi_endpoint::{EndpointAddress, Interaction, Peers, function_action};

/// Reads the options of a route between `ends`, and notes their faults. `action` is the type of an action, where it is
/// written.
pub(super) fn read(
    written: &BTreeMap<String, Spanned<serde_json::Value>>,
    ends: [&EndpointAddress; 2],
    middlewares: &[Available<'_>],
    interaction: Interaction,
    action: Option<RosAction>,
    problems: &mut Vec<Problem>,
) -> Map {
    let is_end = |one: &&Available<'_>| ends.iter().any(|end| end.middleware == one.name);
    let at_ends: Vec<_> = middlewares.iter().filter(is_end).collect();
    let mut known: Vec<&str> = at_ends.iter().flat_map(|one| one.options).copied().collect();
    let [source, _] = ends;
    let is_function = |one: &&&Available<'_>| {
        one.name == source.middleware && !one.interactions.contains(&Interaction::Action)
    };
    let function = at_ends.iter().find(is_function);
    let function = function.filter(|_| interaction == Interaction::Action);
    if function.is_some() {
        known.extend(function_action::OPTIONS);
    }
    let mut options = Map::default();
    for (name, value) in written {
        let mut complain = |text| problems.push(Problem::at(value.referenced, text));
        let [from, to] = ends.map(|end| end.middleware.as_str());
        if let Some(text) = without_effect(name, ends, middlewares, interaction) {
            complain(text);
            continue;
        }
        if let Err(unknown) = known_option(name, &known, &format!("between {from} and {to}")) {
            complain(unknown);
            continue;
        }
        match to_value(&value.value) {
            Ok(read) => {
                let read = plain(read);
                let reads = |one: &&&Available<'_>| one.options.contains(&name.as_str());
                let checked = || at_ends.iter().filter(reads);
                let is_list = [Peers::FROM, Peers::TO].contains(&name.as_str());
                let of_peers = is_list.then(|| Peers::read(&read).err()).flatten();
                let of_peers = of_peers.map(|wanted| format!("option {name} must be {wanted}"));
                let of_function = |one: &&Available<'_>| {
                    let checked = function_action::check_option(name, &read);
                    let is_topic = || match read.as_str().filter(|_| name == FEEDBACK) {
                        Some(topic) => {
                            one.check_name(topic).map_err(|fault| format!("option {name}: {fault}"))
                        }
                        None => Ok(()),
                    };
                    checked.and_then(|()| is_topic()).err()
                };
                let fault = of_peers
                    .or_else(|| checked().find_map(|one| one.check_value(name, &read).err()))
                    .or_else(|| function.and_then(of_function));
                fault.into_iter().for_each(&mut complain);
                options.insert(name.as_str(), read);
            }
            Err(error) => complain(format!("option {name}: {error}")),
        }
    }
    if let (Some(kind), Some(until)) = (action, written.get(UNTIL))
        && let Err(fault) = function_action::check_until(&options, kind)
    {
        problems.push(Problem::at(until.referenced, fault));
    }
    options
}

/// True where a route of this interaction between `ends` may have an option.
pub fn option_fits(
    name: &str,
    ends: [&EndpointAddress; 2],
    middlewares: &[Available<'_>],
    interaction: Interaction,
) -> bool {
    let is_end = |one: &&Available<'_>| ends.iter().any(|end| end.middleware == one.name);
    let is_known = middlewares.iter().filter(is_end).any(|one| one.options.contains(&name));
    is_known && without_effect(name, ends, middlewares, interaction).is_none()
}

/// Reason why an option has no effect between `ends`.
fn without_effect(
    name: &str,
    ends: [&EndpointAddress; 2],
    middlewares: &[Available<'_>],
    interaction: Interaction,
) -> Option<String> {
    let [from, to] = ends.map(|end| end.middleware.as_str());
    let mut lists = [(Peers::FROM, from), (Peers::TO, to)].into_iter();
    let list = lists.find(|(key, _)| *key == name);
    let unlisted = list.and_then(|end| cannot_list(end, middlewares, interaction));
    let is_topic = interaction == Interaction::Topic;
    unlisted.or_else(|| goes_the_other_way(name, ends, middlewares).filter(|_| is_topic))
}

/// Reason why an option can have no effect: each end that knows it is at the other end of the route.
fn goes_the_other_way(
    name: &str,
    [from, to]: [&EndpointAddress; 2],
    middlewares: &[Available<'_>],
) -> Option<String> {
    let at = |end: &EndpointAddress| middlewares.iter().find(|one| one.name == end.middleware);
    let (at_source, at_destination) = (at(from)?, at(to)?);
    let known = |one: &Available<'_>| one.options.contains(&name);
    let works = known(at_source) && !at_source.destination_options.contains(&name)
        || known(at_destination) && !at_destination.source_options.contains(&name);
    if works || !(known(at_source) || known(at_destination)) {
        return None;
    }
    let is_of_calls = |one: &Available<'_>| {
        one.source_options.contains(&name) && one.destination_options.contains(&name)
    };
    if is_of_calls(at_source) || is_of_calls(at_destination) {
        return Some(format!(
            "option {name} has no effect on a topic: services and actions have it; leave it out"
        ));
    }
    let (what, end) = if known(at_source) {
        ("sent to", &at_source.name)
    } else {
        ("received from", &at_destination.name)
    };
    let is = if known(at_source) { "the source" } else { "the destination" };
    Some(format!(
        "option {name} is about what is {what} {end}, which is {is} of this route: leave it out, or exchange \
         from and to"
    ))
}

/// Reason why the programs at an end of a route cannot be listed.
fn cannot_list(
    (key, middleware): (&str, &str),
    middlewares: &[Available<'_>],
    interaction: Interaction,
) -> Option<String> {
    if interaction != Interaction::Topic {
        return Some(format!(
            "option {key} has no effect on a {interaction}: topics alone have lists of peers"
        ));
    }
    let shows = |it: &&Available<'_>| it.options.contains(&key);
    let showing: Vec<_> = middlewares.iter().filter(shows).map(|it| it.name).collect();
    let cannot = !showing.contains(&middleware);
    cannot.then(|| {
        format!(
            "option {key} cannot be kept: connections of {middleware} do not show whose they are, as those of \
             {} do; leave it out (docs/security.md says what {middleware} has instead)",
            showing.join(", ")
        )
    })
}

/// Refuses an option whose name is not among those `known` at `place`, such as `on yarp`.
///
/// # Errors
/// When there is no such option; the text names those that exist, and the one that is probably
/// meant.
pub fn known_option(name: &str, known: &[&str], place: &str) -> Result<(), String> {
    if known.contains(&name) {
        return Ok(());
    }
    let hint = did_you_mean(name, known);
    let names = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
    Err(format!("option {name} is unknown {place}; {hint}options here: {names}"))
}

/// Keeps lists of numbers as lists, because options are written by hand and read one by one.
fn plain(value: Value) -> Value {
    match value {
        Value::Tensor(tensor) => {
            wrapyfi_data::types::nested_list(&tensor).unwrap_or(Value::Tensor(tensor))
        }
        other => other,
    }
}
