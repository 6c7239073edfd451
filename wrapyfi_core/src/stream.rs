//! A listener as a stream of messages, for programs that are async.
//!
//! The thread that receives a message wakes the task: no runtime and no thread stands between.

use std::pin::Pin;
use std::task::{Context as Task, Poll};

use wrapyfi_endpoint::{Context, Listener, Sample, TakeError, Wake};

/// The messages of a listener, without an end.
///
/// ```no_run
/// use wrapyfi_core::endpoint::{Context, Middleware, TopicSpec};
/// use wrapyfi_core::stream::Messages;
/// use wrapyfi_core::types::MessageType;
///
/// let zeromq = wrapyfi_core::zeromq().start()?;
/// let context = Context::default();
/// let camera = TopicSpec::new("/camera", MessageType::Image);
/// let messages = Messages::new(zeromq.open_listener(&camera, &context)?, &context);
/// // `while let Some(message) = messages.next().await` with the extensions of the crate `futures`.
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Messages {
    listener: Box<dyn Listener>,
    wake: Wake,
}

impl Messages {
    /// Messages of `listener`, which was opened with `context`.
    pub fn new(listener: Box<dyn Listener>, context: &Context) -> Self {
        Self { listener, wake: context.wake.clone() }
    }

    /// The listener, for its link and its review.
    pub fn listener(&mut self) -> &mut dyn Listener {
        &mut *self.listener
    }
}

impl futures_core::Stream for Messages {
    type Item = Result<Sample, TakeError>;

    fn poll_next(mut self: Pin<&mut Self>, task: &mut Task<'_>) -> Poll<Option<Self::Item>> {
        // Asked for before the look, so that a ring after the look is not lost.
        self.wake.notify(task.waker());
        match self.listener.take() {
            Ok(Some(sample)) => Poll::Ready(Some(Ok(sample))),
            Ok(None) => Poll::Pending,
            Err(fault) => Poll::Ready(Some(Err(fault))),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "in a test a panic is the right answer")]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicUsize, Ordering::SeqCst};

    use futures_core::Stream as _;

    use super::*;
    use wrapyfi_data::types::{MessageType, Value};
    use wrapyfi_endpoint::memory::Memory;
    use wrapyfi_endpoint::{Middleware, TopicSpec};

    struct Count(AtomicUsize);

    impl std::task::Wake for Count {
        fn wake(self: Arc<Self>) {
            self.0.fetch_add(1, SeqCst);
        }
    }

    #[test]
    fn a_message_wakes_the_task_that_found_none() {
        let (bus, context) = (Memory::new("memory"), Context::default());
        let spec = TopicSpec::new("/x", MessageType::NativeObject);
        let mut messages = Messages::new(bus.open_listener(&spec, &context).unwrap(), &context);
        let mut publisher = bus.open_publisher(&spec, &Context::default()).unwrap();
        let count = Arc::new(Count(AtomicUsize::new(0)));
        let waker = Arc::clone(&count).into();
        let mut task = Task::from_waker(&waker);
        assert!(Pin::new(&mut messages).poll_next(&mut task).is_pending());
        let before = count.0.load(SeqCst);
        publisher.publish(&Value::from(7).into()).unwrap();
        assert_eq!(count.0.load(SeqCst), before + 1);
        let Poll::Ready(Some(Ok(sample))) = Pin::new(&mut messages).poll_next(&mut task) else {
            panic!("no message")
        };
        assert_eq!(sample.payload, Value::from(7).into());
        assert!(Pin::new(&mut messages).poll_next(&mut task).is_pending());
    }
}
