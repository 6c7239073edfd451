//! Properties on ROS 1: a namespace of the parameter server.
//!
//! ```text
//!   publish { gain: 2.5, camera.rate: 30 } ─▶ task ─▶ setParam /x/gain 2.5, /x/camera/rate 30
//!   take ◀─ { gain: 2.5, … } ◀─ inbox ◀─ subscribeParam /x, and again at every paramUpdate
//! ```
//!
//! Python Wrapyfi sets and reads the same names. Each message holds all parameters of the namespace.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::Instant;

use tokio::sync::Notify;

use super::core::{Core, Lingers};
use super::xmlrpc;
use crate::endpoint::{
    Context, Counters, DropReason, Link, Listener, PublishError, Publisher, Receiver, Sample,
    Sender, TakeError, TopicSpec, Wake, inbox,
};
use crate::types::{DataType, Map, ParameterValue, Payload, Properties, Value};
use crate::{DecodeError, EncodeError};

/// A listener's part in the node.
pub(super) struct Watched {
    inbox: Sender<Given>,
    wake: Wake,
    /// What was given last: the master tells also what is no news.
    last: Mutex<Option<xmlrpc::Value>>,
}

/// A value of the namespace, and when it came.
struct Given(xmlrpc::Value, Instant);

impl Watched {
    pub(super) fn wake(&self) -> &Wake {
        &self.wake
    }

    fn give(&self, value: &xmlrpc::Value) {
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        if last.as_ref() == Some(value) {
            return;
        }
        *last = Some(value.clone());
        drop(last);
        self.inbox.counters().received(size(value));
        if let Err(given) = self.inbox.push(Given(value.clone(), Instant::now())) {
            // The master does not wait.
            self.inbox.give_up(given);
        }
    }
}

/// The namespace `key` has this value, as the master says.
pub(super) fn arrived(core: &Core, key: &str, value: &xmlrpc::Value) {
    let watched = core.state().parameters.get(key).cloned().unwrap_or_default();
    watched.iter().for_each(|one| one.give(value));
}

/// Something changed at `key`: every namespace that it touches is asked for anew.
pub(super) fn changed(core: &Core, key: &str) {
    let key = key.trim_end_matches('/');
    let within = |inner: &str, outer: &str| {
        inner.strip_prefix(outer).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
    };
    core.rewatch(|watched| within(key, watched) || within(watched, key));
}

/// Listens to one namespace.
pub(super) struct ParameterListener {
    core: Arc<Core>,
    key: String,
    watched: Arc<Watched>,
    inbox: Receiver<Given>,
}

impl ParameterListener {
    pub(super) fn open(core: &Arc<Core>, key: &str, spec: &TopicSpec, context: &Context) -> Self {
        let (sender, inbox) =
            inbox(spec.queue, Arc::clone(&context.counters), context.wake.clone());
        let last = Mutex::default();
        let watched = Arc::new(Watched { inbox: sender, wake: context.wake.clone(), last });
        core.watch(key, &watched);
        Self { core: Arc::clone(core), key: key.to_owned(), watched, inbox }
    }
}

impl Listener for ParameterListener {
    fn take(&mut self) -> Result<Option<Sample>, TakeError> {
        let Some(Given(value, received_at)) = self.inbox.pop() else { return Ok(None) };
        let wire_bytes = size(&value);
        let properties = Properties::from_value(&to_value(value)).map_err(|error| {
            let expected = "a namespace of parameters".to_owned();
            DecodeError::Mismatch { expected, actual: error.to_string() }
        })?;
        Ok(Some(Sample { payload: properties.into(), wire_bytes, received_at, origin: None }))
    }

    fn discard(&mut self) -> bool {
        self.inbox.pop().is_some()
    }

    fn link(&self) -> Link {
        Link { peers: None, waiting_for: self.core.fault(), keeps_last: false }
    }
}

impl Drop for ParameterListener {
    fn drop(&mut self) {
        self.core.unwatch(&self.key, &self.watched);
    }
}

/// Sets one namespace.
pub(super) struct ParameterPublisher {
    core: Arc<Core>,
    key: String,
    max_bytes: usize,
    outbox: Arc<Outbox>,
}

#[derive(Default)]
struct Outbox {
    queue: Mutex<Queue>,
    work: Notify,
}

#[derive(Default)]
struct Queue {
    /// `None` deletes.
    parameters: VecDeque<(String, Option<xmlrpc::Value>)>,
    /// The publisher is gone.
    closed: bool,
    /// Held while something waits.
    lingers: Option<Lingers>,
}

impl Outbox {
    /// Parameters that may wait for the master.
    const LIMIT: usize = 10_000;

    fn queue(&self) -> MutexGuard<'_, Queue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl ParameterPublisher {
    pub(super) fn open(core: &Arc<Core>, key: &str, spec: &TopicSpec, context: &Context) -> Self {
        let outbox = Arc::<Outbox>::default();
        core.handle.spawn(send(
            Arc::downgrade(core),
            Arc::clone(&outbox),
            Arc::clone(&context.counters),
        ));
        let max_bytes = spec.limits.message_bytes;
        Self { core: Arc::clone(core), key: key.to_owned(), max_bytes, outbox }
    }
}

/// Tells the master what waits, in order.
async fn send(core: Weak<Core>, outbox: Arc<Outbox>, counters: Arc<Counters>) {
    loop {
        let (next, closed) = {
            let mut queue = outbox.queue();
            let next = queue.parameters.pop_front();
            if next.is_none() {
                queue.lingers = None;
            }
            (next, queue.closed)
        };
        let Some((key, value)) = next else {
            if closed {
                return;
            }
            outbox.work.notified().await;
            continue;
        };
        let Some(core) = core.upgrade() else { return };
        let done = match value {
            Some(value) => core.master.set_param(&key, value).await,
            None => core.master.delete_param(&key).await,
        };
        if let Err(error) = done {
            counters.dropped(DropReason::SendFailed);
            tracing::warn!(key, "ROS 1: a parameter was not set: {error}");
        }
    }
}

impl Publisher for ParameterPublisher {
    fn publish(&mut self, payload: &Payload) -> Result<usize, PublishError> {
        let Payload::Properties(properties) = payload else {
            let (expected, actual) = (DataType::Properties, payload.data_type());
            let (expected, actual) = (expected.to_string(), actual.to_string());
            return Err(EncodeError::Mismatch { expected, actual }.into());
        };
        let size = properties.size();
        if size > self.max_bytes {
            let (actual, limit) = (size as u64, self.max_bytes as u64);
            return Err(EncodeError::TooLarge { actual, limit }.into());
        }
        if let Some(reason) = self.core.fault() {
            return Err(PublishError::Transport { topic: self.key.clone(), reason });
        }
        let mut queue = self.outbox.queue();
        if queue.parameters.len().saturating_add(properties.len()) > Outbox::LIMIT {
            let (topic, depth) = (self.key.clone(), Outbox::LIMIT);
            return Err(PublishError::QueueFull { topic, depth });
        }
        for (name, value) in properties.iter() {
            queue.parameters.push_back((under(&self.key, name), to_xml(value)));
        }
        if queue.lingers.is_none() {
            queue.lingers = Some(self.core.lingering.begin());
        }
        drop(queue);
        self.outbox.work.notify_one();
        Ok(size)
    }

    fn link(&self) -> Link {
        let fault = self.core.fault();
        Link { peers: Some(usize::from(fault.is_none())), waiting_for: fault, keeps_last: false }
    }
}

impl Drop for ParameterPublisher {
    fn drop(&mut self) {
        // What waits is still told, and then the task ends.
        self.outbox.queue().closed = true;
        self.outbox.work.notify_one();
    }
}

/// A parameter of a namespace as ROS 1 names it: `camera.rate` is `camera/rate`.
fn under(key: &str, name: &str) -> String {
    let parts = name.split(['.', '/']).filter(|part| !part.is_empty());
    parts.fold(key.trim_end_matches('/').to_owned(), |path, part| format!("{path}/{part}"))
}

/// `None` for one that is to be deleted.
fn to_xml(value: &ParameterValue) -> Option<xmlrpc::Value> {
    use xmlrpc::Value as Xml;
    fn list<T>(items: &[T], one: impl Fn(&T) -> Xml) -> Xml {
        Xml::Array(items.iter().map(one).collect())
    }
    let integer = |number: i64| i32::try_from(number).map_or(Xml::Long(number), Xml::Integer);
    Some(match value {
        ParameterValue::NotSet => return None,
        ParameterValue::Bool(value) => Xml::Boolean(*value),
        ParameterValue::Integer(value) => integer(*value),
        ParameterValue::Double(value) => Xml::Double(*value),
        ParameterValue::String(value) => Xml::String(value.clone()),
        ParameterValue::ByteArray(value) => Xml::Base64(value.clone()),
        ParameterValue::BoolArray(all) => list(all, |value| Xml::Boolean(*value)),
        ParameterValue::IntegerArray(all) => list(all, |value| integer(*value)),
        ParameterValue::DoubleArray(all) => list(all, |value| Xml::Double(*value)),
        ParameterValue::StringArray(all) => list(all, |value| Xml::String(value.clone())),
    })
}

fn to_value(value: xmlrpc::Value) -> Value {
    use xmlrpc::Value as Xml;
    match value {
        Xml::Integer(value) => Value::from(i64::from(value)),
        Xml::Long(value) => Value::from(value),
        Xml::Boolean(value) => value.into(),
        Xml::String(value) => Value::from(value),
        Xml::Double(value) => Value::from(value),
        Xml::Base64(value) => Value::Bytes(value.into()),
        Xml::Array(items) => Value::List(items.into_iter().map(to_value).collect()),
        Xml::Struct(members) => {
            let members =
                members.into_iter().map(|(name, value)| (Value::from(name), to_value(value)));
            Value::Map(members.collect::<Map>())
        }
        Xml::DateTime(value) => Value::from(value.to_string()),
        _ => Value::Null,
    }
}

/// About as many bytes as it takes on the wire.
fn size(value: &xmlrpc::Value) -> usize {
    use xmlrpc::Value as Xml;
    match value {
        Xml::String(text) => text.len(),
        Xml::Base64(bytes) => bytes.len(),
        Xml::Array(items) => items.iter().map(size).sum(),
        Xml::Struct(members) => members.iter().map(|(name, value)| name.len() + size(value)).sum(),
        _ => 8,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_become_paths() {
        assert_eq!(under("/x", "gain"), "/x/gain");
        assert_eq!(under("/x/", "camera.rate"), "/x/camera/rate");
        assert_eq!(under("/x", "a/b..c"), "/x/a/b/c");
    }

    #[test]
    fn values_return() {
        for value in [
            ParameterValue::Bool(true),
            ParameterValue::Integer(-5),
            ParameterValue::Integer(1 << 40),
            ParameterValue::Double(2.5),
            ParameterValue::String("text".into()),
            ParameterValue::IntegerArray(vec![1, 2]),
            ParameterValue::StringArray(vec!["a".into(), "b".into()]),
        ] {
            let members = [("p".to_owned(), to_xml(&value).unwrap())].into();
            let read = Properties::from_value(&to_value(xmlrpc::Value::Struct(members))).unwrap();
            assert_eq!(read.get("p"), Some(&value));
        }
        assert_eq!(to_xml(&ParameterValue::NotSet), None);
    }
}
