//! A relay under an invented clock, on topics in memory.

use std::sync::Arc;

use super::super::route::{RouteTypes, Types};
use super::super::route_status::RouteStatus;
use super::super::work::{DEGRADED_FOR, REST_REVIEW_EVERY, REVIEW_EVERY};
use super::*;
use wrapyfi_data::types::{
    Encoding, Image, Map, MessageType, Payload, Pixels, Properties, RawPixels, Stamp, Tensor, Value,
};
use wrapyfi_endpoint::memory::Memory;
use wrapyfi_endpoint::{
    ForwardingListener, ForwardingPublisher, Middleware, Mutex, OpenError, Opened, Overflow,
    PublishError, Published, QosChange, QueueSpec, Review, SampleOrigin, SourceDurability,
    TopicSpec,
};

/// Context of a route by the clock of its registry.
fn context_of(registry: &Registry) -> Context {
    Context { clock: registry.clock().clone(), ..Context::default() }
}

impl Relay {
    pub(crate) fn status(&self) -> RouteStatus {
        let (spec, state) = (&self.spec, self.state.clone());
        RouteStatus {
            from_qos: self.source.qos,
            to_qos: self.sink.qos,
            counters: self.context.counters.snapshot(),
            ..RouteStatus::planned(spec, state)
        }
    }
}

/// The bus as a route sees it, which opens nothing and takes nothing where it is told so.
#[derive(Default)]
struct Cable {
    bus: Arc<Memory>,
    refusal: Mutex<Option<&'static str>>,
    fault: Arc<Mutex<Option<&'static str>>>,
}

impl Cable {
    fn check(&self, topic: &str) -> Result<(), OpenError> {
        let refused = |reason: &str| OpenError::transport("memory", topic, reason.to_owned());
        self.refusal.lock().map_or(Ok(()), |reason| Err(refused(reason)))
    }
}

impl Middleware for Cable {
    fn name(&self) -> &str {
        "memory"
    }

    fn open_listener(&self, spec: &TopicSpec, context: &Context) -> Opened<dyn Listener> {
        self.check(&spec.topic)?;
        self.bus.open_listener(spec, context)
    }

    fn open_publisher(&self, spec: &TopicSpec, context: &Context) -> Opened<dyn Publisher> {
        self.check(&spec.topic)?;
        let (end, fault) = (self.bus.open_publisher(spec, context)?, Arc::clone(&self.fault));
        Ok(Box::new(CableEnd { end, fault }))
    }
}

struct CableEnd {
    end: Box<dyn Publisher>,
    fault: Arc<Mutex<Option<&'static str>>>,
}

impl Publisher for CableEnd {
    fn publish(&mut self, payload: &Payload) -> Published {
        let fault = *self.fault.lock();
        fault.map_or(Ok(()), |reason| {
            let (topic, reason) = ("/out".to_owned(), reason.to_owned());
            Err(PublishError::Transport { topic, reason })
        })?;
        self.end.publish(payload)
    }

    fn link(&self) -> wrapyfi_endpoint::Link {
        self.end.link()
    }
}

struct Bench {
    bus: Arc<Memory>,
    cable: Arc<Cable>,
    relay: Relay,
    now: Instant,
}

impl Bench {
    fn new(adjust: impl FnOnce(&mut Route)) -> Self {
        let bus = Arc::new(Memory::new("memory"));
        let mut registry = Registry::new();
        let cable = Arc::new(Cable { bus: bus.clone(), ..Cable::default() });
        registry.register(cable.clone());
        let mut spec = Route::topic(
            "memory:/in".parse().unwrap(),
            "memory:/out".parse().unwrap(),
            MessageType::NativeObject,
        );
        adjust(&mut spec);
        Self {
            bus,
            cable,
            relay: Relay::new(spec, &registry, 1, context_of(&registry)),
            now: Instant::now(),
        }
    }

    fn step_after(&mut self, later: Duration) -> Progress {
        self.now += later;
        self.relay.step(self.now)
    }

    fn source(&self) -> Box<dyn Publisher> {
        self.bus.open_publisher(&spec("/in"), &Context::default()).unwrap()
    }

    fn sink(&self) -> Box<dyn Listener> {
        self.bus.open_listener(&spec("/out"), &Context::default()).unwrap()
    }
}

fn spec(topic: &str) -> TopicSpec {
    let queue = QueueSpec { depth: 100, overflow: Overflow::DropOldest };
    TopicSpec { queue, ..TopicSpec::new(topic, MessageType::NativeObject) }
}

fn number(n: i64) -> Payload {
    Payload::from(Value::Int(n))
}

fn drain(listener: &mut dyn Listener) -> Vec<Payload> {
    std::iter::from_fn(|| listener.take().unwrap().map(|sample| sample.payload)).collect()
}

/// Lets `in` carry native objects, and `out` images.
fn frames_out(spec: &mut Route) {
    spec.types =
        RouteTypes::Topic(Types { from: MessageType::NativeObject, to: MessageType::Image });
}

const MS: Duration = Duration::from_millis(1);

#[test]
fn a_picture_takes_the_form_of_the_destination() {
    let files = Types { from: MessageType::Image, to: MessageType::CompressedImage };
    let mut bench = Bench::new(|spec| spec.types = RouteTypes::Topic(files));
    bench.step_after(MS);
    let (mut source, mut sink) = (bench.source(), bench.sink());
    let raw = RawPixels::dense(16, 8, Encoding::Mono8, vec![50; 128]).unwrap();
    let stamp = Stamp { sec: 7, nanosec: 5 };
    source.publish(&Image::new(stamp, raw).into()).unwrap();
    bench.step_after(MS);
    let [Payload::Image(file)] = &drain(sink.as_mut())[..] else { panic!("an image") };
    assert!(matches!(file.pixels, Pixels::Compressed { .. }) && file.stamp == stamp);
}

#[test]
fn says_what_it_waits_for_and_then_carries_messages_in_order() {
    let mut bench = Bench::new(|_| ());
    bench.step_after(MS);
    assert_eq!(bench.relay.status().state.to_string(), "waiting for a publisher on memory:/in");
    let mut source = bench.source();
    bench.step_after(MS);
    assert_eq!(bench.relay.status().state.to_string(), "waiting for a listener on memory:/out");
    let mut sink = bench.sink();
    bench.step_after(MS);
    assert_eq!(bench.relay.status().state, RouteState::Active);
    for n in 0..5 {
        source.publish(&number(n)).unwrap();
    }
    assert_eq!(bench.step_after(MS).moved, 5);
    assert_eq!(drain(sink.as_mut()), (0..5).map(number).collect::<Vec<_>>());
    let counters = bench.relay.status().counters;
    assert_eq!((counters.received, counters.sent, counters.dropped()), (5, 5, 0));
}

#[test]
fn without_consumer_messages_are_counted_not_carried() {
    let mut bench = Bench::new(|_| ());
    bench.step_after(MS);
    let mut source = bench.source();
    source.publish(&number(1)).unwrap();
    bench.step_after(MS);
    let counters = bench.relay.status().counters;
    assert_eq!((counters.sent, counters.dropped_for(DropReason::NoConsumer)), (0, 1));
}

#[test]
fn a_flood_is_moved_in_batches_and_the_overflow_counted() {
    let mut bench = Bench::new(|spec| spec.policy.queue.depth = 20);
    bench.step_after(MS);
    let (mut source, mut sink) = (bench.source(), bench.sink());
    for n in 0..50 {
        source.publish(&number(n)).unwrap();
    }
    let step = bench.step_after(MS);
    assert_eq!((step.moved, step.next), (BATCH, bench.now));
    bench.step_after(MS);
    assert_eq!(drain(sink.as_mut()), (30..50).map(number).collect::<Vec<_>>());
    assert_eq!(bench.relay.status().counters.dropped_for(DropReason::QueueFull), 30);
}

#[test]
fn a_rate_limit_spaces_messages_and_counts_the_rest() {
    let mut bench = Bench::new(|spec| spec.policy.max_rate_hz = Some(10.0));
    bench.step_after(MS);
    let (mut source, mut sink) = (bench.source(), bench.sink());
    for n in 0..10 {
        source.publish(&number(n)).unwrap();
        bench.step_after(50 * MS);
    }
    assert_eq!(drain(sink.as_mut()).len(), 5);
    assert_eq!(bench.relay.status().counters.dropped_for(DropReason::RateLimit), 5);
}

#[test]
fn a_loss_degrades_the_route_for_a_while_with_its_cause() {
    let mut bench = Bench::new(|_| ());
    bench.step_after(MS);
    let (mut source, sink) = (bench.source(), bench.sink());
    bench.step_after(MS);
    *bench.cable.fault.lock() = Some("cable pulled");
    source.publish(&number(1)).unwrap();
    bench.step_after(MS);
    assert_eq!(
        bench.relay.status().state.to_string(),
        r#"degraded: could not send to "/out": cable pulled"#
    );
    *bench.cable.fault.lock() = None;
    source.publish(&number(2)).unwrap();
    bench.step_after(DEGRADED_FOR + MS);
    assert_eq!(bench.relay.status().state, RouteState::Active);
    assert_eq!(bench.relay.status().counters.dropped_for(DropReason::SendFailed), 1);
    drop(sink);
}

#[test]
fn ends_at_rest_are_looked_at_less_often_until_something_happens() {
    let mut bench = Bench::new(|_| ());
    let (mut source, mut sink) = (bench.source(), bench.sink());
    let looks_after = |bench: &mut Bench, later| bench.step_after(later).next - bench.now;
    assert_eq!(looks_after(&mut bench, MS), REVIEW_EVERY);
    assert_eq!(looks_after(&mut bench, CALM_AFTER - MS), REVIEW_EVERY);
    assert_eq!(looks_after(&mut bench, MS), REST_REVIEW_EVERY);
    source.publish(&number(1)).unwrap();
    assert_eq!(looks_after(&mut bench, MS), REVIEW_EVERY);
    assert_eq!(drain(sink.as_mut()), [number(1)]);
    bench.step_after(CALM_AFTER);
    drop(source);
    assert_eq!(looks_after(&mut bench, MS), REVIEW_EVERY, "its state changes");
    drop(sink);
}

#[test]
fn an_end_that_cannot_open_is_tried_again_with_growing_waits() {
    let mut bench = Bench::new(|_| ());
    *bench.cable.refusal.lock() = Some("no route to host");
    let first = bench.step_after(MS);
    assert!(first.next > bench.now && first.next <= bench.now + wrapyfi_endpoint::backoff::FIRST);
    assert!(bench.relay.status().state.to_string().contains("no route to host"));
    *bench.cable.refusal.lock() = None;
    bench.step_after(MS);
    assert_eq!(bench.relay.status().state.word(), "waiting", "not before its back-off is over");
    bench.step_after(wrapyfi_endpoint::backoff::FIRST);
    assert_eq!(bench.relay.status().state.to_string(), "waiting for a publisher on memory:/in");
}

#[test]
fn an_unknown_middleware_is_an_error_that_lists_the_known() {
    let bench = Bench::new(|spec| spec.to = "yarp:/x".parse().unwrap());
    let mut relay = bench.relay;
    relay.step(bench.now);
    let state = relay.status().state;
    assert_eq!(state.word(), "error");
    assert!(matches!(state.cause(), Some(Cause::Unknown(_))), "{state}");
}

#[test]
fn an_array_arrives_as_an_image_and_what_is_none_is_counted() {
    let mut bench = Bench::new(frames_out);
    bench.step_after(MS);
    let images = TopicSpec { message_type: MessageType::Image, ..spec("/out") };
    let mut sink = bench.bus.open_listener(&images, &Context::default()).unwrap();
    let mut source = bench.source();
    bench.step_after(MS);
    let frame = Tensor::from_elements(&[2, 3], vec![0_u8, 1, 2, 3, 4, 5]).unwrap();
    for value in [Value::from(frame), "no frame".into()] {
        source.publish(&value.into()).unwrap();
    }
    bench.step_after(MS);
    let heard = drain(sink.as_mut());
    let [Payload::Image(image)] = &*heard else { panic!("one image: {heard:?}") };
    assert!(image.stamp > Stamp::default());
    let status = bench.relay.status();
    assert_eq!(status.counters.dropped_for(DropReason::Mismatch), 1);
    let state = &status.state;
    assert!(state.word() == "degraded" && state.to_string().contains("received str"), "{state}");
}

#[test]
fn a_dict_arrives_as_properties_and_what_is_none_is_counted() {
    let mut bench = Bench::new(|spec| {
        let (from, to) = (MessageType::NativeObject, MessageType::Properties);
        spec.types = RouteTypes::Topic(Types { from, to });
    });
    bench.step_after(MS);
    let properties = TopicSpec { message_type: MessageType::Properties, ..spec("/out") };
    let mut sink = bench.bus.open_listener(&properties, &Context::default()).unwrap();
    let mut source = bench.source();
    bench.step_after(MS);
    let nested = Map::from([("lens", Map::from([("label", "left")]))]);
    for value in [Value::from(nested), "no dict".into()] {
        source.publish(&value.into()).unwrap();
    }
    bench.step_after(MS);
    let expected = Properties::from([("lens.label", "left")]);
    assert_eq!(drain(sink.as_mut()), [Payload::from(expected)]);
    let status = bench.relay.status();
    assert_eq!(status.counters.dropped_for(DropReason::Mismatch), 1);
    let words = "properties are a dict of names and values, not str";
    let state = &status.state;
    assert!(state.word() == "degraded" && state.to_string().contains(words), "{state}");
}

/// A transport may find out that it lost a message after it took it.
#[test]
fn what_the_destination_took_and_lost_degrades_the_route() {
    let mut bench = Bench::new(|_| {});
    bench.step_after(MS);
    let _sink = bench.bus.open_listener(&spec("/out"), &Context::default()).unwrap();
    let _source = bench.source();
    bench.step_after(MS);
    assert_eq!(bench.relay.status().state, RouteState::Active);
    bench.relay.context.counters.undelivered(DropReason::Stalled, 1);
    bench.step_after(MS);
    let state = bench.relay.status().state;
    let undelivered = Cause::Undelivered { messages: 1, to: "memory:/out".to_owned() };
    assert_eq!(state, RouteState::Degraded(undelivered));
    bench.step_after(DEGRADED_FOR);
    assert_eq!(bench.relay.status().state, RouteState::Active);
    // Sources drop what is too large themselves.
    bench.relay.context.counters.dropped(DropReason::Oversize);
    bench.step_after(MS);
    let state = bench.relay.status().state;
    assert!(matches!(&state, RouteState::Degraded(Cause::Oversize { .. })), "{state}");
}

/// An object that a plug-in refused is carried unread: it is counted, and is no loss.
#[test]
fn objects_that_stay_unread_are_counted_and_carried() {
    let mut bench = Bench::new(|_| ());
    bench.step_after(MS);
    let (mut source, mut sink) = (bench.source(), bench.sink());
    let text = r#"[{"__wrapyfi__": ["PandasData", "cos\nsystem\n."]}, 1]"#;
    let value = wrapyfi_data::codec::json::decode(
        &text.into(),
        &wrapyfi_data::Limits::default(),
        &wrapyfi_plugins::standard(),
    )
    .unwrap();
    let payload = Payload::from(value);
    source.publish(&payload).unwrap();
    bench.step_after(MS);
    assert_eq!(drain(sink.as_mut()), [payload]);
    let counters = bench.relay.status().counters;
    assert_eq!((counters.sent, counters.dropped(), counters.unread), (1, 0, 1));
}

/// A source whose reviews the test has written.
struct Scripted(std::sync::Mutex<Vec<Review>>);

struct ScriptedListener(Vec<Review>);

impl Middleware for Scripted {
    fn name(&self) -> &str {
        "scripted"
    }

    fn open_listener(&self, _: &TopicSpec, _: &Context) -> Result<Box<dyn Listener>, OpenError> {
        Ok(Box::new(ScriptedListener(std::mem::take(&mut *self.0.lock().unwrap()))))
    }

    fn open_publisher(&self, _: &TopicSpec, _: &Context) -> Result<Box<dyn Publisher>, OpenError> {
        panic!("only a source")
    }
}

impl Listener for ScriptedListener {
    fn take(&mut self) -> Result<Option<Sample>, wrapyfi_endpoint::TakeError> {
        Ok(None)
    }

    fn link(&self) -> wrapyfi_endpoint::Link {
        wrapyfi_endpoint::Link::default()
    }

    fn review(&mut self, _: Instant) -> Review {
        self.0.pop().unwrap_or_default()
    }
}

#[test]
fn ends_look_at_their_peers_when_they_want_to_and_the_status_shows_what_is_in_use() {
    let now = Instant::now();
    let soon = now + Duration::from_millis(20);
    let fitted = Qos { deadline: Some(Duration::from_millis(7)), ..Qos::default() };
    let change = QosChange { from: Qos::default(), to: fitted, why: "a test".to_owned() };
    let reviews = vec![
        Review { qos: Some(fitted), changed: Some(change), ..Review::default() },
        Review { qos: Some(Qos::default()), next: Some(soon), ..Review::default() },
    ];
    let mut registry = Registry::new();
    registry.register(Arc::new(Memory::new("memory")));
    registry.register(Arc::new(Scripted(reviews.into())));
    let ends = ("scripted:/in".parse().unwrap(), "memory:/out".parse().unwrap());
    let spec = Route::topic(ends.0, ends.1, MessageType::NativeObject);
    let mut relay = Relay::new(spec, &registry, 1, context_of(&registry));
    assert_eq!(relay.step(now).next, soon);
    let status = relay.status();
    assert_eq!((status.from_qos, status.to_qos), (Some(Qos::default()), None));
    relay.step(soon);
    let json = serde_json::to_value(relay.status()).unwrap();
    assert_eq!(json["from_qos"]["deadline_ms"], 7.0);
    assert_eq!(json["from_qos"]["lease_ms"], serde_json::Value::Null);
    assert_eq!(json["to_qos"], serde_json::Value::Null);
}

/// A source whose publisher keeps its last message for later listeners.
struct Latched(std::sync::Mutex<Vec<i64>>);

struct LatchedListener {
    waiting: Vec<i64>,
    aside: Option<i64>,
}

impl Middleware for Latched {
    fn name(&self) -> &str {
        "latched"
    }

    fn open_listener(&self, _: &TopicSpec, _: &Context) -> Result<Box<dyn Listener>, OpenError> {
        let waiting = std::mem::take(&mut *self.0.lock().unwrap());
        Ok(Box::new(LatchedListener { waiting, aside: None }))
    }

    fn open_publisher(&self, _: &TopicSpec, _: &Context) -> Result<Box<dyn Publisher>, OpenError> {
        panic!("only a source")
    }
}

impl Listener for LatchedListener {
    fn take(&mut self) -> Result<Option<Sample>, wrapyfi_endpoint::TakeError> {
        let next = self.aside.take().or_else(|| self.waiting.pop());
        Ok(next.map(|n| Sample {
            payload: number(n),
            wire_bytes: 0,
            received_at: Instant::now(),
            origin: None,
        }))
    }

    fn forwarding(&mut self) -> Option<&mut dyn ForwardingListener> {
        Some(self)
    }

    fn link(&self) -> wrapyfi_endpoint::Link {
        wrapyfi_endpoint::Link { peers: Some(1), ..Default::default() }
    }
}

impl ForwardingListener for LatchedListener {
    fn discard_except_latched(&mut self) -> Option<u64> {
        let next = self.waiting.pop()?;
        Some(self.aside.replace(next).into_iter().count() as u64)
    }

    fn ended_publisher(&mut self) -> Option<u64> {
        None
    }

    fn durability(&self) -> SourceDurability {
        SourceDurability::Unknown
    }
}

#[test]
fn what_a_publisher_keeps_waits_for_the_first_consumer() {
    let bus = Arc::new(Memory::new("memory"));
    let mut registry = Registry::new();
    registry.register(bus.clone());
    registry.register(Arc::new(Latched(vec![3, 2, 1].into())));
    let ends = ("latched:/map".parse().unwrap(), "memory:/out".parse().unwrap());
    let mut relay = Relay::new(
        Route::topic(ends.0, ends.1, MessageType::NativeObject),
        &registry,
        1,
        context_of(&registry),
    );
    let now = Instant::now();
    for _ in 0..3 {
        relay.step(now);
    }
    let dropped = |relay: &Relay| relay.status().counters.dropped_for(DropReason::NoConsumer);
    assert_eq!(dropped(&relay), 2, "the third is kept");
    assert_eq!(relay.status().state.to_string(), "waiting for a listener on memory:/out");
    let mut sink = bus.open_listener(&spec("/out"), &Context::default()).unwrap();
    relay.step(now);
    relay.step(now);
    assert_eq!(drain(sink.as_mut()), [number(3)]);
    let counters = relay.status().counters;
    assert_eq!((counters.sent, counters.dropped()), (1, 2));
}

/// A source of two publishers, of which the second leaves, and a destination that records its
/// calls.
struct Noted(Arc<std::sync::Mutex<Vec<String>>>);

struct Two {
    waiting: Vec<u64>,
    gone: Option<u64>,
}

struct NotingPublisher(Arc<std::sync::Mutex<Vec<String>>>);

impl Middleware for Noted {
    fn name(&self) -> &str {
        "noted"
    }

    fn open_listener(&self, _: &TopicSpec, _: &Context) -> Result<Box<dyn Listener>, OpenError> {
        Ok(Box::new(Two { waiting: vec![2, 1], gone: Some(2) }))
    }

    fn open_publisher(&self, _: &TopicSpec, _: &Context) -> Result<Box<dyn Publisher>, OpenError> {
        Ok(Box::new(NotingPublisher(Arc::clone(&self.0))))
    }
}

impl Listener for Two {
    fn take(&mut self) -> Result<Option<Sample>, wrapyfi_endpoint::TakeError> {
        let next = self.waiting.pop();
        Ok(next.map(|publisher| Sample {
            payload: number(0),
            wire_bytes: 0,
            received_at: Instant::now(),
            origin: Some(SampleOrigin { publisher, keeps: 1 }),
        }))
    }

    fn forwarding(&mut self) -> Option<&mut dyn ForwardingListener> {
        Some(self)
    }

    fn link(&self) -> wrapyfi_endpoint::Link {
        wrapyfi_endpoint::Link { peers: Some(2), ..Default::default() }
    }
}

impl ForwardingListener for Two {
    fn discard_except_latched(&mut self) -> Option<u64> {
        panic!("somebody listens")
    }

    fn ended_publisher(&mut self) -> Option<u64> {
        self.gone.take()
    }

    fn durability(&self) -> SourceDurability {
        SourceDurability::All
    }
}

impl NotingPublisher {
    fn note(&self, what: String) {
        self.0.lock().unwrap().push(what);
    }
}

impl Publisher for NotingPublisher {
    fn publish(&mut self, _: &Payload) -> Result<usize, wrapyfi_endpoint::PublishError> {
        panic!("the origin is known")
    }

    fn forwarding(&mut self) -> Option<&mut dyn ForwardingPublisher> {
        Some(self)
    }

    fn link(&self) -> wrapyfi_endpoint::Link {
        wrapyfi_endpoint::Link { peers: Some(1), ..Default::default() }
    }
}

impl ForwardingPublisher for NotingPublisher {
    fn forward(
        &mut self,
        _: &Payload,
        origin: Option<SampleOrigin>,
    ) -> Result<usize, wrapyfi_endpoint::PublishError> {
        self.note(format!("message of {}", origin.unwrap().publisher));
        Ok(0)
    }

    fn forget(&mut self, publisher: u64) {
        self.note(format!("{publisher} is gone"));
    }

    fn forget_all(&mut self) {
        panic!("its source stays open")
    }

    fn follow_source(&mut self, source: SourceDurability) {
        self.note(format!("keeping: {source:?}"));
    }
}

#[test]
fn whose_message_it_is_goes_along_and_who_is_gone_is_told_after_it() {
    let notes = Arc::default();
    let mut registry = Registry::new();
    registry.register(Arc::new(Noted(Arc::clone(&notes))));
    let ends = ("noted:/in".parse().unwrap(), "noted:/out".parse().unwrap());
    let spec = Route::topic(ends.0, ends.1, MessageType::NativeObject);
    Relay::new(spec, &registry, 1, context_of(&registry)).step(Instant::now());
    let expected = ["keeping: All", "message of 1", "message of 2", "2 is gone"];
    assert_eq!(*notes.lock().unwrap(), expected);
}
