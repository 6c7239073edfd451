//! A route of the plan as the reconciler follows it: the names that it stands for, and what became of them.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::news::News;
use super::route::Route;
use wrapyfi_endpoint::EndpointAddress;
use wrapyfi_endpoint::pattern::Inverse;

/// A route of the plan; one that is written is a pattern with one name.
pub(super) struct Pattern {
    pub(super) spec: Arc<Route>,
    /// Way from the name of a listener at the destination back to the source that it waits for.
    pub(super) inverse: Option<Inverse>,
    /// Number of names beyond the limit, at the last look.
    pub(super) over: usize,
    pub(super) told_over: bool,
    pub(super) made: u64,
    pub(super) ended: u64,
    pub(super) panics: u64,
    /// Destination of each name; `None` where the pattern leaves the name out.
    pub(super) targets: BTreeMap<String, Option<EndpointAddress>>,
    pub(super) news: News,
}

impl Pattern {
    pub(super) fn new(spec: Route) -> Self {
        Self {
            inverse: spec.inverse(),
            spec: Arc::new(spec),
            over: 0,
            told_over: false,
            made: 0,
            ended: 0,
            panics: 0,
            targets: BTreeMap::new(),
            news: News::default(),
        }
    }
}
