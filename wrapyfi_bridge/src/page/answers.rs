//! Answers to the paths of the page.

use std::collections::BTreeMap;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::sync::Arc;
use std::time::{Duration, Instant};

use bytes::Bytes;
use hyper::StatusCode;
use serde::Serialize;
use serde_json::json;
use tokio::sync::Semaphore;
use wrapyfi_engine::RouteStatus;
use wrapyfi_retry::contained;

use super::document::Document;
use super::metrics;
use super::previews::Previews;
use crate::in_force::Running;
use crate::visible::escaped;
use crate::why::judge::judge;
use crate::{logging, middlewares};
use wrapyfi_endpoint::{Cause, Mutex};

/// Time for which statuses are the newest, however many ask.
const FRESH: Duration = Duration::from_millis(250);
/// Most messages that one request shows.
const MAX_PREVIEWS: usize = 16;

/// An answer to a request.
pub(super) struct PageResponse {
    pub(super) status: StatusCode,
    pub(super) content_type: &'static str,
    pub(super) body: Bytes,
}

impl PageResponse {
    fn new(content_type: &'static str, body: impl Into<Bytes>) -> Self {
        Self { status: StatusCode::OK, content_type, body: body.into() }
    }

    pub(super) fn text(text: &'static str) -> Self {
        Self::new("text/plain; charset=utf-8", text)
    }

    fn json(value: &impl Serialize) -> Self {
        Self::new("application/json", json_text(value))
    }
}

/// JSON in which names hold nothing that a terminal obeys.
fn json_text(value: &impl Serialize) -> String {
    // Names are text and counters are numbers: nothing in it can fail.
    escaped(&serde_json::to_string(value).unwrap_or_default()).into_owned()
}

/// Statuses of the routes at one moment, and what was made of them.
struct Now {
    at: Instant,
    routes: Vec<RouteStatus>,
    /// Places of the routes by their number.
    places: BTreeMap<String, usize>,
    json: Bytes,
}

/// Everything that the page tells.
pub(super) struct Answers {
    bridge: Running,
    pub(super) document: Document,
    now: Mutex<Option<Arc<Now>>>,
    previews: Mutex<Previews>,
    /// A question of `why` looks for a second or two: one at a time.
    asking: Arc<Semaphore>,
}

/// A route with the number that requests name it by.
#[derive(Serialize)]
struct Row<'a> {
    id: &'a str,
    #[serde(flatten)]
    status: &'a RouteStatus,
}

/// Content of `/routes.json`.
#[derive(Serialize)]
struct RoutesDocument<'a> {
    node: String,
    /// Middlewares, each with what it waits for.
    middlewares: BTreeMap<&'static str, Option<Cause>>,
    panics: u64,
    routes: Vec<Row<'a>>,
}

impl Answers {
    pub(super) fn new(bridge: Running) -> Self {
        Self {
            bridge,
            document: Document::new(),
            now: Mutex::default(),
            previews: Mutex::default(),
            asking: Arc::new(Semaphore::new(1)),
        }
    }

    /// Lets go of the messages of routes that no page shows any more.
    pub(super) fn sweep(&self) {
        self.previews.lock().sweep(Instant::now());
    }

    pub(super) async fn answer(&self, path: &str, query: &str) -> PageResponse {
        match path {
            "/" => PageResponse::new("text/html; charset=utf-8", self.document.html.clone()),
            "/routes.json" => PageResponse::new("application/json", self.now().json.clone()),
            "/previews.json" => self.previews(query),
            "/why.json" => self.why(query).await,
            "/metrics" => {
                let text =
                    metrics::text(&self.now().routes, &self.middlewares(), logging::panics());
                PageResponse::new("text/plain; version=0.0.4; charset=utf-8", text)
            }
            _ => PageResponse {
                status: StatusCode::NOT_FOUND,
                ..PageResponse::text("there is nothing here\n")
            },
        }
    }

    /// Middlewares, each with what it waits for.
    fn middlewares(&self) -> BTreeMap<&'static str, Option<Cause>> {
        middlewares::wait_causes(&self.bridge.routes.registry())
    }

    fn now(&self) -> Arc<Now> {
        let mut now = self.now.lock();
        if let Some(now) = &*now
            && now.at.elapsed() < FRESH
        {
            return Arc::clone(now);
        }
        let routes = self.bridge.routes.status();
        let ids: Vec<String> = routes.iter().map(id).collect();
        let rows = ids.iter().zip(&routes).map(|(id, status)| Row { id, status });
        let document = RoutesDocument {
            node: self.bridge.node.name().fqn(),
            middlewares: self.middlewares(),
            panics: logging::panics(),
            routes: rows.collect(),
        };
        let json = json_text(&document).into();
        let places = ids.into_iter().zip(0..).collect();
        let fresh = Arc::new(Now { at: Instant::now(), routes, places, json });
        *now = Some(Arc::clone(&fresh));
        fresh
    }

    fn previews(&self, query: &str) -> PageResponse {
        let now = self.now();
        let wanted = ids(query).filter_map(|id| Some((id, now.routes.get(*now.places.get(id)?)?)));
        let mut previews = self.previews.lock();
        let found: BTreeMap<_, _> = wanted
            .take(MAX_PREVIEWS)
            .filter_map(|(id, route)| {
                let tap = self.bridge.routes.tap(&route.name, &route.from, &route.to)?;
                Some((id, previews.look(id, tap, Instant::now())?))
            })
            .collect();
        PageResponse::json(&found)
    }

    async fn why(&self, query: &str) -> PageResponse {
        let fault = |text: &str| PageResponse::json(&json!({ "fault": text }));
        let now = self.now();
        let place = ids(query).next().and_then(|id| now.places.get(id));
        let Some(route) = place.and_then(|place| now.routes.get(*place)) else {
            return fault("there is no such route any more");
        };
        let Ok(turn) = Arc::clone(&self.asking).try_acquire_owned() else {
            return fault("another question is being answered: ask again in a moment");
        };
        let (bridge, name) = (self.bridge.clone(), route.name.clone());
        let asked = tokio::task::spawn_blocking(move || {
            let _turn = turn;
            let ask = || bridge.explain(&name).map_err(|fault| fault.to_string());
            contained(|| ask().map(|way| judge(&way))).flatten()
        });
        match asked.await {
            Ok(Ok(diagnosis)) => PageResponse::json(&diagnosis),
            Ok(Err(text)) => fault(&text),
            Err(error) => fault(&error.to_string()),
        }
    }
}

/// Number of a route as long as the program runs: sixteen digits, whatever its name is made of.
fn id(route: &RouteStatus) -> String {
    let mut hasher = DefaultHasher::new();
    (&route.name, &route.from, &route.to).hash(&mut hasher);
    format!("{:016x}", hasher.finish())
}

/// The numbers that a query names: `id=…&id=…`.
fn ids(query: &str) -> impl Iterator<Item = &str> {
    query.split('&').filter_map(|pair| pair.strip_prefix("id="))
}
