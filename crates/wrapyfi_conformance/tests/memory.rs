//! The suite against topics inside one process.

use wrapyfi_conformance::{Capabilities, Testbed, TypeCheck, WireEnd, conformance_tests};
use wrapyfi_endpoint::Middleware;
use wrapyfi_endpoint::memory::Memory;

/// One bus: there is no wire, so both sides are the same.
struct Bus(Memory);

impl Testbed for Bus {
    const CAPABILITIES: Capabilities = Capabilities {
        wire: false,
        waits_aloud: false,
        keeps_last: false,
        ignores_own: false,
        block_waits: false,
        refuses_names: false,
        types: TypeCheck::Unchecked,
        ..Capabilities::FULL
    };

    fn start() -> Self {
        Self(Memory::new("memory"))
    }

    fn side(&self, _side: WireEnd) -> &dyn Middleware {
        &self.0
    }

    fn restart(&mut self, _side: WireEnd) {}
}

conformance_tests! {
    Bus,
    lacks {
        wire: "messages on the bus are objects, and never bytes",
        keeps_last: "the bus keeps no message for later listeners",
        ignores_own: "both sides are one bus",
        block_waits: "a publisher on the bus cannot be made to wait",
        refuses_names: "the bus has no rule for names",
        types: "the bus does not look at types",
    },
}
