//! The trait by which the driver steps a route.

use std::time::Instant;

use super::relay::Step;
use super::route_status::RouteState;
use wrapyfi_endpoint::Qos;

/// A route at work: no threads, no clock of its own.
pub(super) trait Work: Send {
    /// Brings the route one step on.
    fn step(&mut self, now: Instant) -> Step;

    /// State of the route after its last step, and quality of service in use at source and destination.
    fn state(&self) -> (&RouteState, [Option<Qos>; 2]);

    /// True once the route has opened what it needs.
    fn is_open(&self) -> bool;

    /// Keeps the source open from now on, whether somebody listens or not.
    fn keep_open(&mut self) {}

    /// Names listeners of another type than the route's, for as long as nobody else listens.
    fn name_misfits(&mut self, named: Option<String>) {
        _ = named;
    }

    /// Closes both ends and counts the messages on their way; the next step opens the ends again.
    fn close(&mut self);
}
