//! The topic that most cases use.

use wrapyfi_core::endpoint::TopicSpec;
use wrapyfi_core::types::MessageType;

/// A topic of numbered native objects.
pub(super) fn text(topic: &str) -> TopicSpec {
    TopicSpec::new(topic, MessageType::StringJson)
}
