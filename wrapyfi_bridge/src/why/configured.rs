//! Findings that the configuration alone tells: a definition that no program has, names that a pattern leaves out, its
//! limit.

use wrapyfi_endpoint::CauseCode;
use wrapyfi_engine::LeftOut;

use super::state::{broken, has_rival};
use super::{Finding, RouteFacts, StepResult, Way};

/// Causes that the file alone tells.
pub(super) fn of_file(route: &RouteFacts) -> StepResult {
    defined(&route.undefined)?;
    let (name, file) = (&route.name, &route.file);
    if let Some((topic, why)) = &route.left_out {
        let (what, remedy) = match why {
            LeftOut::Denied(entry) => (
                format!("{topic} is left out by deny: {entry:?} of {name}"),
                format!("take {entry:?} out of `deny` in {file}, or write a route for {topic}"),
            ),
            LeftOut::NotAllowed => (
                format!("{topic} is left out of {name}: no entry of allow matches it"),
                format!("add it to `allow` in {file}"),
            ),
            LeftOut::Written(written) => (
                format!("no pattern makes {topic}: the route {written} has one of its ends"),
                format!("wrapyfi why {written:?} --config {file}; or take that route out of it"),
            ),
            LeftOut::ByDefault => (
                format!("{topic} is left out of {name} by default: hidden, or of every node"),
                format!(
                    "write `default_deny: false` on the pattern in {file}, or a route for {topic}"
                ),
            ),
        };
        return Err(Finding::new(CauseCode::LeftOut, what, "the pattern", remedy));
    }
    Ok(())
}

/// Limit of a pattern, where it leaves out the name that is asked for.
pub(super) fn limit(route: &RouteFacts) -> StepResult {
    let (name, file) = (&route.name, &route.file);
    match route.limit {
        Some((limit, names)) if names > limit => {
            let routes =
                if limit == 1 { "1 route is".to_owned() } else { format!("{limit} routes are") };
            let what = format!("{names} names match {name}, and {routes} its limit");
            let remedy = format!("write `max_routes: {names}` or more on the pattern in {file}");
            Err(Finding::new(CauseCode::Limit, what, "the pattern", remedy))
        }
        _ => Ok(()),
    }
}

/// A finding about the routes that parameters of the bridge's node made: these mend it, or a file instead of them.
pub(super) fn by_parameters(finding: Finding, way: &Way) -> Finding {
    let is_rivalled = way.running.as_ref().is_some_and(has_rival);
    let parameter = match finding.cause {
        _ if is_rivalled => return with_file(finding, way),
        CauseCode::LeftOut => "change `allow`, `deny` or `default_deny` of its parameters",
        CauseCode::NoRoute => {
            "correct the name, or change `prefix`, `allow` or `deny` of its parameters"
        }
        CauseCode::State if broken(way).is_err() => "take the name into `deny` of its parameters",
        CauseCode::Limit => "take fewer names by `allow` of its parameters",
        CauseCode::Type | CauseCode::Qos | CauseCode::Drops | CauseCode::RateLimit => {
            return with_file(finding, way);
        }
        _ => return finding,
    };
    let remedy = format!(
        "{parameter} (--ros-args -p 'deny:=[\"raw/.*\"]'), or name a file of routes (-p config_file:=FILE)"
    );
    Finding { who: format!("whoever starts {}", way.node), remedy, ..finding }
}

/// A finding whose remedy is a route, of a bridge whose routes its parameters make.
fn with_file(finding: Finding, way: &Way) -> Finding {
    let remedy = format!(
        "{}; the routes of {} are made by its parameters: one of its own needs a file (-p config_file:=FILE)",
        finding.remedy, way.node
    );
    Finding { remedy, ..finding }
}

/// Definition of a type: the one that is missing, and why.
pub(super) fn defined(undefined: &Option<(String, String)>) -> StepResult {
    let Some((type_name, reason)) = undefined else { return Ok(()) };
    let package = type_name.split('/').next().unwrap_or(type_name);
    let what = format!("nobody here has a definition of {type_name}: {reason}");
    let who = format!("the package {package}; a ROS 1 publisher shows its own");
    let remedy = format!(
        "source the ROS 2 workspace that has {package} before you start (AMENT_PREFIX_PATH), or name its \
         folder: `definitions: [DIR]` in the configuration, `--definitions DIR` of a command"
    );
    Err(Finding::new(CauseCode::Definition, what, who, remedy))
}
