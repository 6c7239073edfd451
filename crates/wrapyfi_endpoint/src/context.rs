//! Bell, counters and clock that an endpoint shares with its owner.

use std::sync::Arc;

use super::{Clock, Counters, Wake};

/// Bell and counters that an endpoint shares with its owner.
///
/// ```
/// # mod wrapyfi_core {
/// #     pub use {wrapyfi_endpoint as endpoint, wrapyfi_data::types};
/// #     pub mod middleware { pub use wrapyfi_endpoint::memory; }
/// # }
/// use wrapyfi_core::endpoint::{Context, Middleware, TopicSpec};
/// use wrapyfi_core::middleware::memory::Memory;
/// use wrapyfi_core::types::{MessageType, Value};
/// let bus = Memory::new("memory");
/// let spec = TopicSpec::new("/x", MessageType::NativeObject);
/// let context = Context::default();
/// let _listener = bus.open_listener(&spec, &context)?;
/// bus.open_publisher(&spec, &Context::default())?.publish(&Value::from(1).into())?;
/// assert_eq!(context.counters.snapshot().received, 1); // the listener shares the counters
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Default)]
pub struct Context {
    /// Bell that rings when a message arrives or the link changes.
    pub wake: Wake,
    /// Counters of messages received, sent and dropped. A listener counts the messages that it
    /// receives and that its queue drops; the owner counts everything after [`Listener::take`](super::Listener::take).
    pub counters: Arc<Counters>,
    /// The time that decides.
    pub clock: Clock,
}
