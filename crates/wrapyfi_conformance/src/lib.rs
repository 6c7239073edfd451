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
//! use wrapyfi_conformance::{Capabilities, Testbed, WireEnd};
//! use wrapyfi_endpoint::Middleware;
//! use wrapyfi_endpoint::memory::Memory;
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
//!     fn side(&self, _side: WireEnd) -> &dyn Middleware {
//!         &self.0
//!     }
//!
//!     fn restart(&mut self, _side: WireEnd) {}
//! }
//!
//! wrapyfi_conformance::conformance_tests! {
//!     OneProcess,
//!     lacks { wire: "messages are objects, and never bytes" },
//! }
//! ```
//!
//! ```sh
//! cargo nextest run --workspace conformance::          # on every middleware
//! cargo nextest run -p wrapyfi_zeromq conformance::    # on one
//! ```
//!
//! `conformance_tests!(services of MyTestbed)` takes only the cases about services.
//!
//! # A real transport
//!
//! `tests/conformance.rs` of `wrapyfi_zeromq` and `wrapyfi_ros2` have what it needs beyond the smallest testbed:
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
//! A case about something that is not promised is ignored, with the reason that stands in `lacks`. A case that
//! should pass and does not stands in `known_faults`: it runs, is expected to fail as it is written there, and fails
//! the day it passes, to be taken out again. nextest shows them at the end of a run.
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
//! Every case starts a testbed of its own, so they run side by side. Nothing sleeps for a fixed time: a case
//! waits for its condition, and half a minute is what a failure takes. DDS domains come from
//! `reserve_domain`, which no other test program on the machine gets at the same time.

// The whole crate is tests: here a panic is the right answer, with the reason in its text.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::indexing_slicing)]

mod alone;
pub mod cases;
mod ends;
pub mod payloads;
mod reserve;
mod service_ends;
mod testbed;

pub use ends::{Sink, Source, TIMEOUT, connect, until, wait_for, wait_until};
pub use reserve::{Reserved, reserve_domain, reserve_port};
pub use service_ends::{ClientEnd, ServerEnd, call_and_serve};
pub use testbed::{Capabilities, Testbed, TypeCheck, WireEnd};

/// One `#[test]` for every case of the suite, run against a [`Testbed`].
///
/// Every test starts a testbed of its own, so they may run side by side. `services of` leaves out what is about
/// topics.
///
/// ```ignore
/// conformance_tests! {
///     services of FastNodes,
///     lacks { reply_stamps: "replies of this middleware have no time" },
///     known_faults { every_kind_is_returned: "exceeds 128 KiB" },
/// }
/// ```
///
/// `lacks` names fields of [`Capabilities`] that are false, each with the reason: cases that need one are
/// ignored with it. A test does not compile that says other than the capabilities. `known_faults` names cases that
/// should pass and do not, each with a part of the message that it fails with: they become tests in a module
/// `known_fault`, which fail as soon as the case passes, or fails otherwise.
#[macro_export]
macro_rules! conformance_tests {
    // One test for each case, after the needs that it has are found promised.
    (@define ($d:tt) $cases:ident $testbed:ty
        $(, lacks { $($lacking:ident: $reason:literal),* $(,)? })?
        $(, known_faults { $($fault:ident: $message:literal),* $(,)? })?
        $(,)?
    ) => {
        macro_rules! conformance_test {
            $($(($fault [$d($d need:ident)*]) => {};)*)?
            $($(($d case:ident [$lacking $d($d need:ident)*]) => {
                #[test]
                #[ignore = $reason]
                fn $d case() {
                    $crate::cases::$d case::<$testbed>();
                }
            };)*)?
            ($d case:ident [$d need:ident $d($d more:ident)*]) => {
                const _: () = assert!($crate::conformance_tests!(@promised $testbed, $d need));
                conformance_test! { $d case [$d($d more)*] }
            };
            ($d case:ident []) => {
                #[test]
                fn $d case() {
                    $crate::cases::$d case::<$testbed>();
                }
            };
        }
        $($(const _: () = assert!(!$crate::conformance_tests!(@promised $testbed, $lacking));)*)?
        $crate::conformance_tests! { @$cases }
        $(mod known_fault {
            use super::*;

            $(#[test]
            #[should_panic(expected = $message)]
            fn $fault() {
                $crate::cases::$fault::<$testbed>();
            })*
        })?
    };
    (@promised $testbed:ty, types) => {
        <$testbed as $crate::Testbed>::CAPABILITIES.checks_types()
    };
    (@promised $testbed:ty, $capability:ident) => {
        <$testbed as $crate::Testbed>::CAPABILITIES.$capability
    };
    (@all) => {
        // content
        conformance_test! { native_objects_arrive_unchanged [] }
        conformance_test! { text_objects_arrive_unchanged [] }
        conformance_test! { raw_images_arrive_unchanged [] }
        conformance_test! { image_files_arrive_unchanged [] }
        conformance_test! { sound_arrives_unchanged [] }
        conformance_test! { upstream_sound_arrives_unchanged [float_sound] }
        // delivery
        conformance_test! { order_is_kept [] }
        conformance_test! { either_end_may_come_first [] }
        conformance_test! { every_listener_gets_its_copy [] }
        conformance_test! { late_listeners_hear_what_is_new [] }
        conformance_test! { the_kept_message_is_replayed_once [keeps_last] }
        conformance_test! { topics_do_not_disturb_each_other [] }
        conformance_test! { own_publications_are_not_received [ignores_own] }
        // restart
        conformance_test! { a_publisher_that_restarts_flows_again [] }
        conformance_test! { a_listener_that_restarts_flows_again [] }
        conformance_test! { endpoints_may_close_under_traffic [] }
        conformance_test! { shutdown_is_quick_and_leaves_no_thread [] }
        // queue
        conformance_test! { drop_oldest_keeps_the_newest [] }
        conformance_test! { drop_newest_keeps_the_oldest [] }
        conformance_test! { block_waits_for_the_reader [block_waits] }
        conformance_test! { block_gives_up_at_its_deadline [] }
        conformance_test! { discarding_takes_one_message [] }
        // faults
        conformance_test! { what_is_too_large_is_counted_and_passed_over [wire] }
        conformance_test! { what_is_malformed_is_counted_and_passed_over [wire] }
        conformance_test! { other_types_are_never_delivered [types] }
        conformance_test! { a_payload_of_another_kind_is_refused [types] }
        conformance_test! { names_that_cannot_work_are_refused [refuses_names] }
        // link
        conformance_test! { publishers_know_who_listens [] }
        conformance_test! { listeners_know_who_publishes [listener_knows_peers] }
        conformance_test! { an_arrival_rings [] }
        // discovery
        conformance_test! { what_exists_is_found_and_what_went_is_not [] }
        $crate::conformance_tests! { @services }
    };
    (@services) => {
        conformance_test! { a_call_is_answered [services] }
        conformance_test! { arguments_arrive_unchanged [services] }
        conformance_test! { every_kind_is_returned [services] }
        conformance_test! { calls_are_answered_in_any_order [services] }
        conformance_test! { a_blocking_call_returns [services] }
        conformance_test! { an_error_is_told [services] }
        conformance_test! { an_answer_of_another_kind_is_refused [services wire] }
        conformance_test! { a_client_of_another_kind_is_told [services wire] }
        conformance_test! { without_a_server_a_call_times_out [services] }
        conformance_test! { late_replies_are_counted [services] }
        conformance_test! { an_unanswered_request_ends [services] }
        conformance_test! { more_than_the_limit_is_refused [services] }
        conformance_test! { a_server_that_restarts_is_asked_again [services] }
        conformance_test! { several_clients_get_their_own_replies [services] }
        conformance_test! { what_is_too_large_to_return_is_told [services wire] }
        conformance_test! { requests_that_are_none_are_told [services wire] }
        conformance_test! { a_cancelled_call_is_forgotten [services] }
    };
    (services of $($testbed:tt)*) => {
        $crate::conformance_tests! { @define ($) services $($testbed)* }
    };
    ($($testbed:tt)*) => {
        $crate::conformance_tests! { @define ($) all $($testbed)* }
    };
}
