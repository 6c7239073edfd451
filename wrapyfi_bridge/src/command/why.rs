//! `wrapyfi why`: the first thing that is missing on a way.

use std::time::{Duration, Instant};

use anyhow::Context as _;
use serde::Serialize;
use wrapyfi_data::types::{Map, Value};
use wrapyfi_interfaces::wrapyfi_msgs::srv::{Explain, Explain_Response};

use crate::cli::WhyArgs;
use crate::exit::{Failure, Result};
use crate::middlewares::{Endpoints, ros2_hidden};
use crate::on_graph::client::{Asker, the_bridge};
use crate::output;
use crate::why::judge::judge;
use crate::why::question::ask;
use crate::why::{Diagnosis, Finding, stopped};

/// Longest time that a bridge elsewhere may take.
const ELSEWHERE: Duration = Duration::from_secs(5);

/// Prints what is in place and the first thing that is missing.
///
/// # Errors
/// Exit code 1 where something is missing, 2 where the name means nothing or the configuration is wrong, 3
/// where the bridge that was asked does not answer.
pub fn run(args: &WhyArgs) -> Result<()> {
    let begin = Instant::now();
    show(&diagnosis(args)?, args.json, begin)
}

/// Diagnosis of a way: the things that are in place, and the first one that is missing.
///
/// # Errors
/// As [`run`], where nothing can be said.
pub fn diagnosis(args: &WhyArgs) -> Result<Diagnosis> {
    match &args.node {
        Some(node) => elsewhere(node, &args.name),
        None => Ok(judge(&ask(args)?)),
    }
}

/// Answer of a bridge that runs elsewhere on the graph.
fn elsewhere(node: &str, name: &str) -> Result<Diagnosis> {
    let ros2 = ros2_hidden(&Endpoints::default().ros2())?;
    let (node, _) = the_bridge(&ros2, Some(node), "why", &|| false)?;
    let mut asker = Asker::<Explain>::open(&ros2, &node, "explain")?;
    let reply = asker.ask(Map::from([("name", Value::from(name))]), ELSEWHERE);
    let reply = reply.map_err(stopped::or)?;
    let Explain_Response { known, way, passed, cause, what, who, remedy, .. } = reply;
    if !known {
        return Err(Failure::Usage(format!("{node}: {what}")));
    }
    let finding =
        (!cause.is_empty()).then_some(Finding { cause: cause.as_str().into(), what, who, remedy });
    Ok(Diagnosis { way, passed, finding })
}

fn show(diagnosis: &Diagnosis, json: bool, begin: Instant) -> Result<()> {
    #[derive(Serialize)]
    struct Line<'v> {
        #[serde(flatten)]
        diagnosis: &'v Diagnosis,
        took_ms: u128,
    }
    if json {
        let line = Line { diagnosis, took_ms: begin.elapsed().as_millis() };
        output::line(&serde_json::to_string(&line).context("cannot print")?)?;
    } else {
        output::line(&diagnosis.to_string())?;
    }
    match diagnosis.finding {
        None => Ok(()),
        Some(_) => Err(Failure::Found),
    }
}
