//! Endpoints that exist on each middleware that a pattern names, looked up once a round.
//!
//! ```text
//!   Middleware::discover_closely ─▶ Discovery ── look ──▶ (role, name) ─▶ [Discovered]
//!                                      └─ away: why nothing can be seen
//! ```

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::route::Route;
use wrapyfi_endpoint::backoff::Backoff;
use wrapyfi_endpoint::pattern::Inverse;
use wrapyfi_endpoint::{
    Cause, DiscoverError, Discovered, Discovery, Middleware, NameFilter, Registry, Role,
    RoutingProperties,
};
use wrapyfi_retry::contained;

/// Time for which a middleware must have been seen before routes are made of it, so that endpoints
/// that exist already have shown by then.
const SETTLED: Duration = Duration::from_millis(1000);
/// Silence after which a topic that shows by its messages only is held to be gone.
const SILENT: Duration = Duration::from_secs(60);

/// One middleware, with its discovery and the endpoints that it has found.
pub(super) struct DiscoveredMiddleware {
    pub(super) middleware: Option<Arc<dyn Middleware>>,
    /// Filter for the names that discovery has to look at, also where it is opened again.
    meant: Meant,
    /// True where topics are taken from it, so that those count, too, that show to listeners only.
    is_source: bool,
    discovery: Option<Box<dyn Discovery>>,
    /// Endpoints that discovery listed last.
    listed: Vec<Discovered>,
    found: BTreeMap<Role, BTreeMap<String, Vec<Discovered>>>,
    away: Option<Away>,
    /// Instant at which to look again after a panic, with the back-off.
    retry_at: Option<Instant>,
    backoff: Backoff,
    /// Number of panics of its discovery.
    pub(super) panics: u64,
    seen_since: Option<Instant>,
    /// Smallest number of the bridges whose marks it shows.
    oldest_bridge: Option<u64>,
    /// Number of messages of topics that show by their messages only, and the time of its last
    /// change.
    traffic: BTreeMap<String, (u64, Option<Instant>)>,
}

/// Filter for names, which each discovery that is opened gets anew.
type Meant = Arc<dyn Fn(&str) -> bool + Send + Sync>;

/// Reason that a middleware's endpoints cannot be seen.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Away {
    /// They cannot be seen now.
    Waiting(Cause),
    /// Discovery panicked; it is opened again.
    Failed(Cause),
    /// They can never be seen.
    Unable(Cause),
}

/// The middlewares by name.
#[derive(Default)]
pub(super) struct DiscoveredGraph(BTreeMap<String, DiscoveredMiddleware>);

impl DiscoveredGraph {
    /// Looks from now on at the middlewares that `patterns` name. The endpoints of a middleware
    /// that was looked at before stay known, unless it has started anew.
    pub(super) fn follow(&mut self, registry: &Registry, patterns: &[Arc<Route>]) {
        let mut known = std::mem::take(&mut self.0);
        let names = patterns
            .iter()
            .flat_map(|spec| [&spec.from, &spec.to])
            .map(|end| end.middleware.as_str());
        for name in names {
            if self.0.contains_key(name) {
                continue;
            }
            let is_same = |side: &DiscoveredMiddleware| match (&side.middleware, registry.get(name))
            {
                (Some(before), Ok(now)) => Arc::ptr_eq(before, now),
                _ => false,
            };
            let before = known.remove(name).filter(is_same);
            let mut side = before.unwrap_or_else(|| match registry.get(name) {
                Ok(middleware) => DiscoveredMiddleware::empty(Some(Arc::clone(middleware))),
                Err(unknown) => DiscoveredMiddleware {
                    away: Some(Away::Unable(unknown.into())),
                    ..DiscoveredMiddleware::empty(None)
                },
            });
            let is_source = patterns.iter().any(|spec| spec.from.middleware == name);
            side.mean(meant(name, patterns), is_source);
            self.0.insert(name.to_owned(), side);
        }
        if let Err(panic) = contained(|| drop(known)) {
            tracing::error!("a discovery that is not needed any more panicked: {panic}");
        }
    }

    /// Looks at all middlewares; true when any has changed.
    pub(super) fn look(&mut self, now: Instant) -> bool {
        let looks = self.0.values_mut().map(|side| side.look(now));
        looks.filter(|changed| *changed).count() > 0
    }

    pub(super) fn get(&self, name: &str) -> Option<&DiscoveredMiddleware> {
        self.0.get(name)
    }

    /// Smallest number of the bridges that show somewhere.
    pub(super) fn oldest_bridge(&self) -> Option<u64> {
        self.0.values().filter_map(|side| side.oldest_bridge).min()
    }
}

/// Filter for the names of a middleware that patterns mean, as sources or as destinations.
fn meant(middleware: &str, patterns: &[Arc<Route>]) -> Meant {
    let of = |spec: &&Arc<Route>| spec.from.middleware == middleware;
    let sources: Vec<_> = patterns.iter().filter(of).cloned().collect();
    let to = |spec: &&Arc<Route>| spec.to.middleware == middleware;
    let targets = patterns.iter().filter(to);
    let targets: Vec<_> = targets.map(|spec| (Arc::clone(spec), spec.inverse())).collect();
    Arc::new(move |name| {
        let is_target = |(spec, inverse): &(Arc<Route>, Option<Inverse>)| match inverse {
            Some(inverse) => spec.may_go_to(inverse, name),
            // The names that the pattern makes cannot be told, so all are looked at.
            None => spec.is_many() || spec.to.name == name,
        };
        sources.iter().any(|spec| spec.target(name).is_some()) || targets.iter().any(is_target)
    })
}

fn filter(meant: &Meant) -> NameFilter {
    let meant = Arc::clone(meant);
    Box::new(move |name| meant(name))
}

impl DiscoveredMiddleware {
    fn empty(middleware: Option<Arc<dyn Middleware>>) -> Self {
        Self {
            middleware,
            meant: Arc::new(|_| true),
            is_source: false,
            discovery: None,
            listed: Vec::new(),
            found: BTreeMap::new(),
            away: Some(Away::Waiting(Cause::Starting("the first look at what exists"))),
            retry_at: None,
            backoff: Backoff::new(1),
            panics: 0,
            seen_since: None,
            oldest_bridge: None,
            traffic: BTreeMap::new(),
        }
    }

    /// Has discovery look at other names from now on. A panic is caught here, and discovery is opened
    /// again.
    fn mean(&mut self, meant: Meant, is_source: bool) {
        self.meant = meant;
        if std::mem::replace(&mut self.is_source, is_source) != is_source {
            self.close();
        }
        if let Some(discovery) = &mut self.discovery
            && let Err(panic) = contained(|| discovery.only(filter(&self.meant)))
        {
            self.failed(&panic);
        }
    }

    pub(super) fn routing_properties(&self) -> RoutingProperties {
        self.middleware.as_ref().map(|it| it.routing_properties()).unwrap_or_default()
    }

    /// Reason that nothing can be seen now.
    pub(super) fn away(&self) -> Option<&Away> {
        self.away.as_ref()
    }

    /// True when it has been seen for [`SETTLED`].
    pub(super) fn is_settled(&self, now: Instant) -> bool {
        self.seen_since.is_some_and(|since| now.saturating_duration_since(since) >= SETTLED)
    }

    /// Names that have endpoints in a role.
    pub(super) fn names(&self, role: Role) -> impl Iterator<Item = &String> {
        self.found.get(&role).into_iter().flat_map(BTreeMap::keys)
    }

    /// Endpoints of a name in a role.
    pub(super) fn endpoints(&self, role: Role, name: &str) -> &[Discovered] {
        self.found.get(&role).and_then(|names| names.get(name)).map_or(&[], Vec::as_slice)
    }

    /// Looks at the middleware; true when it has changed. A panic is caught here, and discovery is
    /// opened again.
    fn look(&mut self, now: Instant) -> bool {
        if matches!(self.away, Some(Away::Unable(_))) || self.retry_at.is_some_and(|at| now < at) {
            return false;
        }
        self.retry_at = None;
        match contained(|| self.found()) {
            Ok(Some(Ok(found))) => {
                let was_away = self.away.take().is_some();
                self.seen_since.get_or_insert(now);
                // A topic that shows by its messages goes without any change in the list.
                let same = self.listed == found && found.iter().all(|one| one.traffic.is_none());
                if !same {
                    self.enter(&found, now);
                    self.listed = found;
                }
                was_away || !same
            }
            Ok(Some(Err(away))) => self.lost(away),
            Ok(None) => false,
            Err(panic) => {
                self.retry_at = Some(now + self.backoff.wait());
                self.failed(&panic)
            }
        }
    }

    /// Closes a discovery that panicked; true when the panic is new.
    fn failed(&mut self, panic: &str) -> bool {
        let name = self.middleware.as_ref().map_or("", |it| it.name()).to_owned();
        tracing::error!("the discovery of {name} panicked, it is opened again: {panic}");
        self.close();
        self.panics += 1;
        let what = format!("the discovery of {name} panicked");
        self.lost(Away::Failed(Cause::Panic { what, panic: panic.to_owned() }))
    }

    /// Closes the discovery, whose destructor may panic; the next look opens another one.
    fn close(&mut self) {
        let discovery = self.discovery.take();
        _ = contained(|| drop(discovery));
    }

    /// Endpoints that exist, or the reason that they cannot be seen; `None` where there is no
    /// middleware.
    fn found(&mut self) -> Option<Result<Vec<Discovered>, Away>> {
        let middleware = self.middleware.as_ref()?;
        let open = || match self.is_source {
            true => middleware.discover_closely(None),
            false => middleware.discover(),
        };
        let discovery = match &mut self.discovery {
            Some(discovery) => discovery,
            none => match open() {
                Ok(mut opened) => {
                    opened.only(filter(&self.meant));
                    none.insert(opened)
                }
                Err(
                    error @ (DiscoverError::Unsupported { .. } | DiscoverError::Refused { .. }),
                ) => return Some(Err(Away::Unable(error.into()))),
                Err(error) => return Some(Err(Away::Waiting(error.into()))),
            },
        };
        let found = discovery.endpoints();
        Some(match (discovery.waiting_for(), found) {
            (Some(what), _) => Err(Away::Waiting(what)),
            (None, Err(error)) => Err(Away::Waiting(error.into())),
            (None, Ok(found)) => Ok(found),
        })
    }

    /// Keeps the endpoints that were seen last: that they cannot be seen does not mean that they
    /// are gone. True when the reason is new.
    fn lost(&mut self, away: Away) -> bool {
        let before = self.away.replace(away);
        self.seen_since = None;
        before != self.away
    }

    fn enter(&mut self, all: &[Discovered], now: Instant) {
        self.found.clear();
        self.oldest_bridge = all.iter().filter_map(|one| Some(one.mark.as_ref()?.bridge)).min();
        for one in all {
            if !self.passes(one, now) {
                continue;
            }
            let names = self.found.entry(one.role).or_default();
            names.entry(one.name.clone()).or_default().push(one.clone());
        }
    }

    /// True for an endpoint that exists. A topic that shows by its messages only exists while new
    /// ones come.
    fn passes(&mut self, one: &Discovered, now: Instant) -> bool {
        let Some(traffic) = one.traffic else { return true };
        let known = self.traffic.entry(one.name.clone()).or_insert((traffic.messages, None));
        if known.0 != traffic.messages {
            *known = (traffic.messages, Some(now));
        }
        known.1.is_some_and(|at| now.saturating_duration_since(at) < SILENT)
    }
}
