//! What every middleware must do, written once.
//!
//! ```text
//!   conformance_tests!(MyRig) ── one #[test] a case ──▶ cases ──▶ Rig ──▶ the middleware
//!                                                       generic    two sides that share a wire
//! ```
//!
//! A middleware is done when the suite passes. Instantiating it takes a [`Rig`] and one line; the
//! smallest rig is this:
//!
//! ```
//! use wrapyfi_conformance::{Capabilities, Rig, Side};
//! use wrapyfi_core::endpoint::Middleware;
//! use wrapyfi_core::middleware::memory::Memory;
//!
//! struct OneProcess(Memory);
//!
//! impl Rig for OneProcess {
//!     const CAPABILITIES: Capabilities = Capabilities { wire: false, ..Capabilities::FULL };
//!
//!     fn start() -> Self {
//!         Self(Memory::new("memory"))
//!     }
//!
//!     fn side(&self, _side: Side) -> &dyn Middleware {
//!         &self.0
//!     }
//!
//!     fn restart(&mut self, _side: Side) {}
//! }
//!
//! wrapyfi_conformance::conformance_tests!(OneProcess);
//! ```
//!
//! `docs/conformance.md` is the guide.

// The whole crate is tests: here a panic is the right answer, with the reason in its text, and
// what a case does not apply to is said on standard error.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::indexing_slicing)]
#![allow(clippy::missing_panics_doc, clippy::print_stderr)]

mod alone;
pub mod cases;
mod ends;
pub mod payloads;
mod reserve;
mod rig;
mod service_ends;

pub use ends::{PATIENCE, Sink, Source, connect, wait_until};
pub use reserve::{Domain, reserve_domain};
pub use rig::{Capabilities, Rig, Side, TypeCheck, known_fault};
pub use service_ends::{Caller, Clerk, call_and_serve};

/// One `#[test]` for every case of the suite, run against a [`Rig`].
///
/// Every test starts a rig of its own, so they may run side by side. `services of Rig` leaves out
/// what is about topics.
#[macro_export]
macro_rules! conformance_tests {
    ($rig:ty) => {
        $crate::conformance_tests! { @cases $rig:
            // content
            native_objects_arrive_unchanged,
            text_objects_arrive_unchanged,
            raw_images_arrive_unchanged,
            image_files_arrive_unchanged,
            sound_arrives_unchanged,
            upstream_sound_arrives_unchanged,
            // delivery
            order_is_kept,
            either_end_may_come_first,
            every_listener_gets_its_copy,
            late_listeners_hear_what_is_new,
            the_kept_message_is_replayed_once,
            topics_do_not_disturb_each_other,
            own_publications_are_not_received,
            // restart
            a_publisher_that_restarts_flows_again,
            a_listener_that_restarts_flows_again,
            endpoints_may_close_under_traffic,
            shutdown_is_quick_and_leaves_no_thread,
            // queue
            drop_oldest_keeps_the_newest,
            drop_newest_keeps_the_oldest,
            block_waits_for_the_reader,
            block_gives_up_at_its_deadline,
            discarding_takes_one_message,
            // faults
            what_is_too_large_is_counted_and_passed_over,
            what_is_malformed_is_counted_and_passed_over,
            other_types_are_never_delivered,
            a_payload_of_another_kind_is_refused,
            names_that_cannot_work_are_refused,
            // link
            publishers_know_who_listens,
            listeners_know_who_publishes,
            an_arrival_rings,
            // discovery
            what_exists_is_found_and_what_went_is_not,
        }
        $crate::conformance_tests!(services of $rig);
    };
    (services of $rig:ty) => {
        $crate::conformance_tests! { @cases $rig:
            a_call_is_answered,
            arguments_arrive_unchanged,
            every_kind_is_returned,
            calls_are_answered_in_any_order,
            a_blocking_call_returns,
            an_error_is_told,
            an_answer_of_another_kind_is_refused,
            a_client_of_another_kind_is_told,
            without_a_server_a_call_times_out,
            late_replies_are_counted,
            an_unanswered_request_ends,
            more_than_the_limit_is_refused,
            a_server_that_restarts_is_asked_again,
            several_clients_get_their_own_replies,
            what_is_too_large_to_return_is_told,
            requests_that_are_none_are_told,
            a_cancelled_call_is_forgotten,
        }
    };
    (@cases $rig:ty: $($case:ident,)*) => {
        $(
            #[test]
            fn $case() {
                if !$crate::known_fault::<$rig>(stringify!($case)) {
                    $crate::cases::$case::<$rig>();
                }
            }
        )*
    };
}
