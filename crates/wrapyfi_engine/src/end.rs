//! One end of a route: its middleware, the open endpoint, and the reason that it is not open.

use std::sync::Arc;
use std::time::Instant;

use super::route::Route;
use super::route_status::RouteState;
use wrapyfi_endpoint::backoff::Backoff;
use wrapyfi_endpoint::{
    Cause, Middleware, OpenError, Qos, QosChange, Registry, Review, RoutingProperties,
};
use wrapyfi_retry::contained;

/// One end of a route: its middleware and the open endpoint.
pub(super) struct RouteEnd<T: ?Sized> {
    /// The endpoint. It is dropped before the middleware, which may start anew then.
    pub(super) open: Option<Box<T>>,
    pub(super) middleware: Option<Arc<dyn Middleware>>,
    /// Properties of the middleware, asked each time that the endpoint opens: one that has not started has none yet.
    pub(super) traits: RoutingProperties,
    pub(super) retry_at: Option<Instant>,
    /// Reason that the end is not open.
    pub(super) trouble: Option<RouteState>,
    /// Quality of service in use.
    pub(super) qos: Option<Qos>,
}

impl<T: ?Sized> RouteEnd<T> {
    pub(super) fn new(registry: &Registry, name: &str) -> Self {
        let (middleware, trouble) = match registry.get(name) {
            Ok(middleware) => (Some(Arc::clone(middleware)), None),
            Err(unknown) => (None, Some(RouteState::Error(unknown.into()))),
        };
        let traits = RoutingProperties::default();
        Self { middleware, traits, open: None, retry_at: None, trouble, qos: None }
    }

    /// Closes the endpoint; a panic in its destructor is caught and logged.
    pub(super) fn close(&mut self) {
        let open = self.open.take();
        (self.qos, self.retry_at) = (None, None);
        if let Err(panic) = contained(|| drop(open)) {
            tracing::error!("an end of a route panicked while it was closed: {panic}");
        }
    }

    /// Forgets the fault of the last try, except one that no further try can mend.
    pub(super) fn at_rest(&mut self) {
        if matches!(self.trouble, Some(RouteState::Waiting(_))) {
            (self.trouble, self.retry_at) = (None, None);
        }
    }

    /// Keeps the result of a review, and logs it.
    pub(super) fn note(&mut self, review: Review, spec: &Route) -> Option<Instant> {
        let Review { qos, changed, warnings, next, slowed: _ } = review;
        let route = &spec.name;
        match changed {
            // A pattern makes many routes, whose changes would flood the log at level info.
            Some(QosChange { from, to, why }) if spec.mark.is_some() => {
                tracing::debug!(route, %from, %to, "quality of service changed: {why}");
            }
            Some(QosChange { from, to, why }) => {
                tracing::info!(route, %from, %to, "quality of service changed: {why}");
            }
            None => {}
        }
        for warning in warnings {
            tracing::warn!(route, "{warning}");
        }
        self.qos = qos;
        next
    }

    pub(super) fn open_with(
        &mut self,
        now: Instant,
        backoff: &mut Backoff,
        open: impl FnOnce(&dyn Middleware) -> Result<Box<T>, OpenError>,
    ) {
        let Some(middleware) = &self.middleware else { return };
        let given_up = matches!(self.trouble, Some(RouteState::Error(_)));
        if self.open.is_some() || given_up || self.retry_at.is_some_and(|at| now < at) {
            return;
        }
        self.retry_at = None;
        match open(middleware.as_ref()) {
            Ok(opened) => match contained(|| middleware.routing_properties()) {
                Ok(traits) => {
                    (self.open, self.traits) = (Some(opened), traits);
                    self.trouble = None;
                }
                Err(panic) => {
                    let name = middleware.name();
                    let what = format!("{name} panicked when it was asked for its traits");
                    self.trouble = Some(RouteState::Error(Cause::Panic { what, panic }));
                }
            },
            Err(error) => self.refuse(now, backoff, error),
        }
    }

    /// Notes why the endpoint is not open, and when it is tried again.
    pub(super) fn refuse(&mut self, now: Instant, backoff: &mut Backoff, error: OpenError) {
        self.close();
        if error.is_transient() {
            self.retry_at = Some(now + backoff.wait());
            self.trouble = Some(RouteState::Waiting(error.into()));
        } else {
            self.trouble = Some(RouteState::Error(error.into()));
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::OnceLock;

    use super::*;
    use wrapyfi_data::types::MessageType;
    use wrapyfi_endpoint::memory::Memory;
    use wrapyfi_endpoint::{Context, Listener, Opened, Publisher, TopicSpec};

    /// A middleware of ROS that starts later.
    struct Late {
        bus: Memory,
        started: OnceLock<()>,
    }

    impl Middleware for Late {
        fn name(&self) -> &str {
            "late"
        }

        fn open_listener(&self, spec: &TopicSpec, context: &Context) -> Opened<dyn Listener> {
            self.bus.open_listener(spec, context)
        }

        fn open_publisher(&self, spec: &TopicSpec, context: &Context) -> Opened<dyn Publisher> {
            self.bus.open_publisher(spec, context)
        }

        fn routing_properties(&self) -> RoutingProperties {
            RoutingProperties {
                ros_time: self.started.get().is_some(),
                ..RoutingProperties::default()
            }
        }
    }

    #[test]
    fn properties_are_those_of_a_middleware_that_has_started() {
        let late = Arc::new(Late { bus: Memory::new("late"), started: OnceLock::new() });
        let mut registry = Registry::default();
        registry.register(Arc::clone(&late) as _);
        let mut end = RouteEnd::<dyn Publisher>::new(&registry, "late");
        late.started.set(()).unwrap();
        end.open_with(Instant::now(), &mut Backoff::new(1), |late| {
            late.open_publisher(&TopicSpec::new("/x", MessageType::Text), &Context::default())
        });
        assert!(end.open.is_some() && end.traits.ros_time);
    }
}
