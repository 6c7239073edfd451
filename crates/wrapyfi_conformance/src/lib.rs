//! Tests that every middleware must pass, written once.
//!
//! ```text
//!   conformance_tests!(MyTestbed) ── one #[test] a case ──▶ cases ──▶ Testbed ──▶ the middleware
//!                                                           generic    two sides that share a wire
//! ```
//!
//! A middleware is done when the suite passes. Instantiating it takes a [`Testbed`] and one line; the
//! smallest testbed is this:
//!
//! ```
//! use wrapyfi_conformance::{Capabilities, Testbed, Side};
//! use wrapyfi_core::endpoint::Middleware;
//! use wrapyfi_core::middleware::memory::Memory;
//!
//! struct OneProcess(Memory);
//!
//! impl Testbed for OneProcess {
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
//! ```sh
//! cargo nextest run -p wrapyfi_conformance             # all of them
//! cargo nextest run -p wrapyfi_conformance zeromq::    # one
//! ```
//!
//! `conformance_tests!(services of MyTestbed)` takes only what is about services.
//!
//! # A real transport
//!
//! `tests/zeromq.rs` and `tests/ros2.rs` have what it needs beyond the smallest testbed:
//!
//! * **Two sides that share a wire only.** Each side is an instance as another process would have it:
//!   for ZeroMQ one runs the broker and the other only connects, for ROS 2 each has a DDS stack of its
//!   own. A shortcut inside the process would hide what the bytes do.
//! * **`restart`** ends a side and starts it at the same address, as a process that was started again.
//! * **`inject`** sends bytes that are no message, as a foreign peer would: framed as the middleware
//!   frames the type, with any bytes where the content belongs. It needs a raw peer, not the
//!   middleware's own publisher.
//! * **`inject_request`** does the same for one request to a service.
//! * **`invalid_names`** lists names that no topic can have.
//!
//! A case about something that is not promised writes `SKIPPED` and passes. A case that should pass and
//! does not goes into `KNOWN_FAULTS` with the reason, writes `KNOWN FAULT`, and is to be taken out
//! again.
//!
//! # Cases
//!
//! | | |
//! | --- | --- |
//! | content | every message type arrives as it was sent, both ways: native objects with one of everything, images in every encoding, files byte for byte, sound |
//! | delivery | order; either end first; every listener its copy; late listeners hear what is new, or the kept message once; twenty topics side by side; no echo |
//! | restart | either side ends and comes back three times, then every message exactly once; endpoints close under traffic; shutdown within two seconds a side, no thread left |
//! | queue | each policy with a consumer that is slower, and `received = taken + dropped`; `discard` |
//! | faults | too large, malformed, another type: counted, and the next message arrives; bad names refused |
//! | services | calls and their arguments; every kind of reply; errors; any order, several clients; time-outs, late replies and cancelled calls; limits; a server that never answers, ends, comes back; too large, malformed, another type |
//! | discovery | what exists is found, and what went is not |
//! | link | who listens and who publishes, as they come and go; arrivals and changes ring |
//!
//!
//! Every case starts a testbed of its own, so they run side by side. Nothing sleeps for a fixed time: a case
//! waits for its condition, and half a minute is what a failure takes. DDS domains come from
//! `reserve_domain`, which no other test program on the machine gets at the same time.

// The whole crate is tests: here a panic is the right answer, with the reason in its text, and
// what a case does not apply to is said on standard error.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::indexing_slicing)]
#![allow(clippy::missing_panics_doc, clippy::print_stderr)]

mod alone;
pub mod cases;
mod ends;
pub mod payloads;
mod reserve;
mod service_ends;
mod testbed;

pub use ends::{Sink, Source, TIMEOUT, connect, wait_until};
pub use reserve::{Domain, reserve_domain};
pub use service_ends::{ClientEnd, ServerEnd, call_and_serve};
pub use testbed::{Capabilities, Side, Testbed, TypeCheck, known_fault};

/// One `#[test]` for every case of the suite, run against a [`Testbed`].
///
/// Every test starts a testbed of its own, so they may run side by side. `services of Testbed` leaves out
/// what is about topics.
#[macro_export]
macro_rules! conformance_tests {
    ($testbed:ty) => {
        $crate::conformance_tests! { @cases $testbed:
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
        $crate::conformance_tests!(services of $testbed);
    };
    (services of $testbed:ty) => {
        $crate::conformance_tests! { @cases $testbed:
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
    (@cases $testbed:ty: $($case:ident,)*) => {
        $(
            #[test]
            fn $case() {
                if !$crate::known_fault::<$testbed>(stringify!($case)) {
                    $crate::cases::$case::<$testbed>();
                }
            }
        )*
    };
}
