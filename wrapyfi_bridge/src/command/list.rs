//! `wrapyfi list`: the endpoints that exist now, on every side.
//!
//! ```text
//!   every middleware ─ discover ─▶ looks until all is told, or for --wait seconds ─▶ one table, or JSON lines
//! ```

use std::fmt::Write as _;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use wrapyfi_endpoint::pattern::bare;
use wrapyfi_endpoint::{Cause, Discovered, Interaction, Middleware, Wake};

use super::WAIT_SLICE;
use crate::cli::ListArgs;
use crate::columns::aligned;
use crate::discovery_watch::DiscoveryWatch;
use crate::exit::{Failure, Result};
use crate::middlewares;
use crate::output;
use crate::own_address::OwnAddress;
use crate::shutdown::Shutdown;

/// Longest look where the command line has no time.
const LONGEST: Duration = Duration::from_secs(3);

/// One side that is looked at.
struct Side {
    name: &'static str,
    // Before what it came from.
    watch: DiscoveryWatch,
    _middleware: Arc<dyn Middleware>,
}

/// Looks for as long as `--wait` says, else until all sides have told what they have, then prints what
/// was found.
///
/// # Errors
/// Exit code 2 for a middleware that there is not; 1 or 3 when the only one asked for, or all of
/// them, cannot be reached.
pub fn run(args: &ListArgs, shutdown: &Shutdown) -> Result<()> {
    of(args, None, None, shutdown)
}

/// Endpoints that exist now: of one middleware, or of all that are expected here. Looks as [`run`] does.
///
/// # Errors
/// As [`run`].
pub fn endpoints(args: &ListArgs, shutdown: &Shutdown) -> Result<Vec<(&'static str, Discovered)>> {
    let (sides, mut failures) = looked(args, None, shutdown)?;
    let mut all = Vec::new();
    for side in sides {
        match side.watch.discovery.waiting_for() {
            Some(what) => failures.push((side.name, unanswered(&what))),
            None => all.extend(side.watch.found.into_iter().map(|one| (side.name, one))),
        }
    }
    match failures.pop() {
        Some((name, failure)) if args.middleware.is_some() => Err(named(name, failure)),
        last => {
            failures
                .iter()
                .chain(&last)
                .for_each(|(name, failure)| tracing::warn!("{name}: {failure}"));
            Ok(all)
        }
    }
}

/// Sides that could not be looked at, each with the reason.
type Unseen = Vec<(&'static str, Failure)>;

/// Looks at the sides that are asked for, of those that have an interaction.
fn looked(
    args: &ListArgs,
    interaction: Option<Interaction>,
    shutdown: &Shutdown,
) -> Result<(Vec<Side>, Unseen)> {
    if let Some(middleware) = &args.middleware {
        args.own.check(middleware)?;
    }
    let has = |name: &str| interaction.is_none_or(|one| middlewares::carries(name, one));
    let wanted: Vec<_> = match &args.middleware {
        None => middlewares::expected().into_iter().filter(|name| has(name)).collect(),
        Some(name) => match middlewares::names().iter().find(|known| *known == name) {
            Some(known) if has(known) => vec![*known],
            Some(known) => {
                let text = format!(
                    "{known} has no actions: a function there is one by a route with `action`, or with \
                     `wrapyfi action send {known}:/NAME --type`; see `wrapyfi list {known}`"
                );
                return Err(Failure::Usage(text));
            }
            None => return Err(middlewares::unknown(name)),
        },
    };
    let (mut sides, mut failures) = (Vec::new(), Vec::new());
    for name in wanted {
        match open(name, args.own) {
            Ok(side) => sides.push(side),
            Err(failure) => failures.push((name, failure)),
        }
    }
    let deadline = Instant::now() + args.wait.unwrap_or(LONGEST);
    let wake = Wake::new();
    loop {
        for side in &mut sides {
            side.watch.look().context(side.name)?;
        }
        let told = args.wait.is_none() && sides.iter().all(|side| side.watch.has_everybody_told());
        if told || shutdown.requested() || Instant::now() >= deadline {
            break;
        }
        wake.wait(deadline.saturating_duration_since(Instant::now()).min(WAIT_SLICE));
    }
    Ok((sides, failures))
}

fn unanswered(what: &Cause) -> Failure {
    Failure::TimedOut(format!("no answer from {what}"))
}

fn named(name: &str, failure: Failure) -> Failure {
    match failure {
        Failure::TimedOut(text) => Failure::TimedOut(format!("{name}: {text}")),
        other => other,
    }
}

/// As [`run`]: the endpoints of one interaction, or of one name, alone.
pub(super) fn of(
    args: &ListArgs,
    interaction: Option<Interaction>,
    name: Option<&str>,
    shutdown: &Shutdown,
) -> Result<()> {
    let (sides, mut failures) = looked(args, interaction, shutdown)?;
    let mut out = String::new();
    let mut told = 0;
    for side in &sides {
        let DiscoveryWatch { discovery, found, .. } = &side.watch;
        let is_meant = |one: &&Discovered| {
            interaction.is_none_or(|it| one.role.interaction() == it)
                && name.is_none_or(|name| bare(&one.name) == bare(name))
        };
        let found: Vec<_> = found.iter().filter(is_meant).collect();
        match discovery.waiting_for() {
            Some(what) => {
                failures.push((side.name, unanswered(&what)));
                continue;
            }
            None => told += 1,
        }
        if args.json {
            lines(&mut out, side.name, &found)?;
        } else {
            table(&mut out, side.name, discovery.carried_by(), &found);
        }
    }
    if let Some(text) = out.strip_suffix('\n') {
        output::line(text)?;
    }
    match failures.pop() {
        // Nothing to show at all: that is the command's failure.
        Some((name, failure)) if told == 0 => Err(named(name, failure)),
        last => {
            for (name, failure) in failures.iter().chain(&last) {
                tracing::warn!("{name}: {failure}");
            }
            Ok(())
        }
    }
}

fn open(name: &'static str, own: OwnAddress) -> Result<Side> {
    let middleware = middlewares::for_look(name, own)?;
    let watch = DiscoveryWatch::new(middleware.discover().context(name)?);
    Ok(Side { name, watch, _middleware: middleware })
}

fn lines(out: &mut String, middleware: &str, found: &[&Discovered]) -> Result<()> {
    #[derive(serde::Serialize)]
    struct EndpointRecord<'a> {
        middleware: &'a str,
        #[serde(flatten)]
        endpoint: &'a Discovered,
    }
    for endpoint in found {
        let line = serde_json::to_string(&EndpointRecord { middleware, endpoint })
            .context("cannot print")?;
        out.push_str(&line);
        out.push('\n');
    }
    Ok(())
}

/// ```text
/// ros2: 2 endpoints, on CycloneDDS inside (RMW_IMPLEMENTATION and ROS_DISTRO are not set)
///   /chatter  publisher  std_msgs/msg/String  reliable volatile  /talker
/// ```
fn table(out: &mut String, middleware: &str, carried_by: Option<&str>, found: &[&Discovered]) {
    let plural = if found.len() == 1 { "" } else { "s" };
    let on = carried_by.map(|carrier| format!(", on {carrier}")).unwrap_or_default();
    // Writing to a String cannot fail.
    let _infallible = writeln!(out, "{middleware}: {} endpoint{plural}{on}", found.len());
    let rows: Vec<[String; 5]> = found.iter().map(|one| row(one)).collect();
    for line in aligned(&rows, 5) {
        let _infallible = writeln!(out, "  {line}");
    }
}

fn row(endpoint: &Discovered) -> [String; 5] {
    let role = match endpoint.count {
        1 => endpoint.role.words(),
        count => format!("{} x{count}", endpoint.role.words()),
    };
    let detail = match (&endpoint.qos, &endpoint.traffic) {
        (Some(qos), _) => qos.to_string(),
        (None, Some(traffic)) => {
            format!("{} messages, {:.2} MB", traffic.messages, traffic.bytes as f64 / 1e6)
        }
        (None, None) => String::new(),
    };
    [
        endpoint.name.clone(),
        role,
        endpoint.type_name.clone().unwrap_or_else(|| "-".into()),
        detail,
        endpoint.node.clone().unwrap_or_default(),
    ]
}

#[cfg(test)]
mod tests {
    use wrapyfi_endpoint::{Role, Traffic};

    use super::*;

    fn found() -> Vec<Discovered> {
        let seen = Discovered {
            name: "/camera".into(),
            role: Role::Publisher,
            type_name: Some("Image".into()),
            type_hash: None,
            qos: None,
            node: None,
            count: 1,
            traffic: Some(Traffic { messages: 3, bytes: 1_500_000, not_taken: 0 }),
            mark: None,
        };
        let listener = Discovered {
            role: Role::Listener,
            type_name: None,
            count: 2,
            traffic: None,
            ..seen.clone()
        };
        vec![seen, listener]
    }

    #[test]
    fn columns_are_aligned() {
        let mut out = String::new();
        table(&mut out, "zeromq", None, &found().iter().collect::<Vec<_>>());
        assert_eq!(
            out,
            "zeromq: 2 endpoints\n\
             \x20 /camera  publisher    Image  3 messages, 1.50 MB\n\
             \x20 /camera  listener x2  -\n"
        );
    }

    #[test]
    fn json_is_one_object_a_line() {
        let mut out = String::new();
        lines(&mut out, "zeromq", &found().iter().collect::<Vec<_>>()).unwrap();
        let first: serde_json::Value = serde_json::from_str(out.lines().next().unwrap()).unwrap();
        assert_eq!(first["middleware"], "zeromq");
        assert_eq!(first["role"], "publisher");
        assert_eq!(first["type"], "Image");
        assert_eq!(first["traffic"]["messages"], 3);
    }
}
