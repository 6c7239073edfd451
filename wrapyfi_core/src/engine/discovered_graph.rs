//! What exists on each middleware that a pattern names, looked up once a round.
//!
//! ```text
//!   Middleware::discover_closely ─▶ Discovery ── look ──▶ (role, name) ─▶ [Discovered]
//!                                      └─ away: why nothing can be seen
//! ```

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::pattern::Inverse;
use super::plan_pattern::PatternSpec;
use super::work::contained;
use crate::backoff::Backoff;
use crate::endpoint::{
    DiscoverError, Discovered, Discovery, Middleware, NameFilter, Registry, Role, Traits,
};

/// How long a side must have been seen before routes are made of it: what exists already shows by then.
const SETTLED: Duration = Duration::from_millis(1000);
/// Silence after which a topic that shows by its messages only is held to be gone.
const SILENT: Duration = Duration::from_secs(60);

/// One middleware.
pub(super) struct DiscoveredMiddleware {
    pub(super) middleware: Option<Arc<dyn Middleware>>,
    /// Names that its discovery has to look at, until it is told.
    meant: Option<NameFilter>,
    discovery: Option<Box<dyn Discovery>>,
    /// What was told last, and what of it is there.
    told: Vec<Discovered>,
    found: BTreeMap<Role, BTreeMap<String, Vec<Discovered>>>,
    away: Option<Away>,
    /// When to look again, and for how long not to, after a panic.
    retry_at: Option<Instant>,
    backoff: Backoff,
    /// Panics of its discovery.
    pub(super) panics: u64,
    seen_since: Option<Instant>,
    /// Messages of topics that show by them, and when that number changed.
    traffic: BTreeMap<String, (u64, Option<Instant>)>,
}

/// Why nothing can be seen.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Away {
    /// Not now.
    Waiting(String),
    /// Its discovery panicked; it is opened again.
    Failed(String),
    /// Never.
    Unable(String),
}

/// The middlewares by name.
#[derive(Default)]
pub(super) struct DiscoveredGraph(BTreeMap<String, DiscoveredMiddleware>);

impl DiscoveredGraph {
    /// Looks from now on at the middlewares that `patterns` name. What is known of one that was looked at
    /// before stays known.
    pub(super) fn follow(&mut self, registry: &Registry, patterns: &[Arc<PatternSpec>]) {
        let mut known = std::mem::take(&mut self.0);
        let names = patterns
            .iter()
            .flat_map(|spec| [spec.source_middleware(), spec.to.middleware.as_str()]);
        for name in names {
            if self.0.contains_key(name) {
                continue;
            }
            let mut side = known.remove(name).unwrap_or_else(|| match registry.get(name) {
                Ok(middleware) => DiscoveredMiddleware::empty(Some(Arc::clone(middleware))),
                Err(unknown) => DiscoveredMiddleware {
                    away: Some(Away::Unable(unknown.to_string())),
                    ..DiscoveredMiddleware::empty(None)
                },
            });
            match &mut side.discovery {
                Some(discovery) => discovery.only(meant(name, patterns)),
                None => side.meant = Some(meant(name, patterns)),
            }
            self.0.insert(name.to_owned(), side);
        }
        if let Err(panic) = contained(|| drop(known)) {
            tracing::error!("a discovery that is not needed any more panicked: {panic}");
        }
    }

    /// Looks; whether anything is other than before.
    pub(super) fn look(&mut self, now: Instant) -> bool {
        let looks = self.0.values_mut().map(|side| side.look(now));
        looks.filter(|changed| *changed).count() > 0
    }

    pub(super) fn get(&self, name: &str) -> Option<&DiscoveredMiddleware> {
        self.0.get(name)
    }
}

/// Tells the names of a middleware that patterns mean, as sources or as destinations.
fn meant(middleware: &str, patterns: &[Arc<PatternSpec>]) -> NameFilter {
    let of = |spec: &&Arc<PatternSpec>| spec.source_middleware() == middleware;
    let sources: Vec<_> = patterns.iter().filter(of).cloned().collect();
    let to = |spec: &&Arc<PatternSpec>| spec.to.middleware == middleware;
    let targets = patterns.iter().filter(to);
    let targets: Vec<_> = targets.map(|spec| (Arc::clone(spec), spec.inverse())).collect();
    Box::new(move |name| {
        let is_target = |(spec, inverse): &(Arc<PatternSpec>, Option<Inverse>)| match inverse {
            Some(inverse) => inverse.source(name).is_some_and(|it| spec.target(&it).is_some()),
            // Which names it makes cannot be told.
            None => spec.is_many() || spec.to.name == name,
        };
        sources.iter().any(|spec| spec.target(name).is_some()) || targets.iter().any(is_target)
    })
}

impl DiscoveredMiddleware {
    fn empty(middleware: Option<Arc<dyn Middleware>>) -> Self {
        Self {
            middleware,
            meant: None,
            discovery: None,
            told: Vec::new(),
            found: BTreeMap::new(),
            away: Some(Away::Waiting("the first look at what exists".to_owned())),
            retry_at: None,
            backoff: Backoff::new(1),
            panics: 0,
            seen_since: None,
            traffic: BTreeMap::new(),
        }
    }

    pub(super) fn traits(&self) -> Traits {
        self.middleware.as_ref().map(|it| it.traits()).unwrap_or_default()
    }

    /// Why nothing can be seen now.
    pub(super) fn away(&self) -> Option<&Away> {
        self.away.as_ref()
    }

    /// Whether it has been seen for long enough.
    pub(super) fn is_settled(&self, now: Instant) -> bool {
        self.seen_since.is_some_and(|since| now.saturating_duration_since(since) >= SETTLED)
    }

    /// Names that have endpoints in a role.
    pub(super) fn names(&self, role: Role) -> impl Iterator<Item = &String> {
        self.found.get(&role).into_iter().flat_map(BTreeMap::keys)
    }

    /// The endpoints of a name in a role.
    pub(super) fn endpoints(&self, role: Role, name: &str) -> &[Discovered] {
        self.found.get(&role).and_then(|names| names.get(name)).map_or(&[], Vec::as_slice)
    }

    /// Looks; whether anything is other than before. A panic ends here, and has the discovery opened again.
    fn look(&mut self, now: Instant) -> bool {
        if matches!(self.away, Some(Away::Unable(_))) || self.retry_at.is_some_and(|at| now < at) {
            return false;
        }
        self.retry_at = None;
        match contained(|| self.found()) {
            Ok(Some(Ok(found))) => {
                let was_away = self.away.take().is_some();
                self.seen_since.get_or_insert(now);
                // Topics that show by their messages go without a change of what is told.
                let same = self.told == found && found.iter().all(|one| one.traffic.is_none());
                if !same {
                    self.enter(&found, now);
                    self.told = found;
                }
                was_away || !same
            }
            Ok(Some(Err(away))) => self.lost(away),
            Ok(None) => false,
            Err(panic) => {
                let name = self.middleware.as_ref().map_or("", |it| it.name()).to_owned();
                tracing::error!("the discovery of {name} panicked, it is opened again: {panic}");
                let discovery = self.discovery.take();
                // One that panicked may do so again.
                _ = contained(|| drop(discovery));
                self.panics += 1;
                self.retry_at = Some(now + self.backoff.wait());
                self.lost(Away::Failed(format!("the discovery of {name} panicked: {panic}")))
            }
        }
    }

    /// What exists, or why that cannot be told; none where there is nothing to ask.
    fn found(&mut self) -> Option<Result<Vec<Discovered>, Away>> {
        let middleware = self.middleware.as_ref()?;
        let discovery = match &mut self.discovery {
            Some(discovery) => discovery,
            none => match middleware.discover_closely(None) {
                Ok(mut opened) => {
                    if let Some(meant) = self.meant.take() {
                        opened.only(meant);
                    }
                    none.insert(opened)
                }
                Err(
                    error @ (DiscoverError::Unsupported { .. } | DiscoverError::Refused { .. }),
                ) => return Some(Err(Away::Unable(error.to_string()))),
                Err(error) => return Some(Err(Away::Waiting(error.to_string()))),
            },
        };
        let found = discovery.endpoints();
        Some(match (discovery.waiting_for(), found) {
            (Some(what), _) => Err(Away::Waiting(what)),
            (None, Err(error)) => Err(Away::Waiting(error.to_string())),
            (None, Ok(found)) => Ok(found),
        })
    }

    /// What was seen last stays: that it cannot be looked at does not mean that it is gone.
    fn lost(&mut self, away: Away) -> bool {
        let before = self.away.replace(away);
        self.seen_since = None;
        before != self.away
    }

    fn enter(&mut self, all: &[Discovered], now: Instant) {
        self.found.clear();
        for one in all {
            if !self.passes(one, now) {
                continue;
            }
            let names = self.found.entry(one.role).or_default();
            names.entry(one.name.clone()).or_default().push(one.clone());
        }
    }

    /// A topic that shows by its messages only is there while there are new ones.
    fn passes(&mut self, one: &Discovered, now: Instant) -> bool {
        let Some(traffic) = one.traffic else { return true };
        let known = self.traffic.entry(one.name.clone()).or_insert((traffic.messages, None));
        if known.0 != traffic.messages {
            *known = (traffic.messages, Some(now));
        }
        known.1.is_some_and(|at| now.saturating_duration_since(at) < SILENT)
    }
}
