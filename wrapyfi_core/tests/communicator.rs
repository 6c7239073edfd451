//! Registered methods over the memory middleware: every mode, and what is said about mistakes.
#![allow(
    clippy::unwrap_used,
    clippy::indexing_slicing,
    reason = "in a test a panic is the right answer"
)]

use std::sync::Arc;
use std::time::Duration;

use wrapyfi_core::communicator::{
    ActivateError, CallError, Configuration, Context, Method, Mode, communicator,
};
use wrapyfi_core::endpoint::DropReason;
use wrapyfi_core::middleware::memory::Memory;
use wrapyfi_core::types::{
    AudioChunk, Encoding, Image, Properties, RawPixels, SampleFormat, Stamp, Tensor, Value,
};

fn context() -> Context {
    Context::builder().only(Arc::new(Memory::new("memory"))).default_middleware("memory").build()
}

fn image(width: u32) -> Image {
    let length = width as usize * 3;
    let pixels = RawPixels::dense(width, 1, Encoding::Bgr8, vec![7; length]).unwrap();
    Image::new(Stamp { sec: 5, nanosec: 6 }, pixels)
}

fn sound() -> AudioChunk {
    AudioChunk::new(Stamp::default(), 2, 1, 8000, SampleFormat::F32Le, vec![1; 8]).unwrap()
}

struct Robot {
    runs: u32,
}

#[communicator]
impl Robot {
    #[register(NativeObject, "$mware", "/say", should_wait = "$wait", timeout_ms = 30000)]
    fn say(&mut self, mware: &str, text: &str, wait: bool) -> String {
        _ = (mware, wait);
        self.runs += 1;
        format!("{text} {}", self.runs)
    }

    /// Three returned values, one of them a list, one on a middleware that is not here.
    #[register(NativeObject, "memory", "/object", should_wait = false)]
    #[register([Image, "memory", "/image", should_wait = false, width = "$width"],
               [AudioChunk, "yarp", "/sound"])]
    #[register(AudioChunk, topic = "/sound", should_wait = false, rate = 8000)]
    fn sense(&mut self, width: u32) -> (Value, (Image, AudioChunk), AudioChunk) {
        self.runs += 1;
        let tensor = Tensor::from_elements(&[2], vec![1.0_f32, f32::from_bits(self.runs)]).unwrap();
        (Value::Tensor(tensor), (image(width), sound()), sound())
    }

    #[register(
        NativeObject,
        "memory",
        "$way_in",
        should_wait = false,
        listener_kwargs(in_topic = "$way_in"),
        publisher_kwargs(out_topic = "$way_out")
    )]
    fn chat(
        &mut self,
        way_in: &str,
        way_out: &str,
        #[received] prev: Option<Vec<String>>,
        word: &[u8],
    ) -> Vec<String> {
        _ = (way_in, way_out);
        let mut all = prev.unwrap_or_default();
        all.push(String::from_utf8_lossy(word).into_owned());
        all
    }

    #[register(NativeObject, "memory", "/add", timeout_ms = 30000)]
    fn add(&self, a: i64, b: &Option<i64>, name: &str, rest: &[f64]) -> (i64, String) {
        #[allow(clippy::cast_possible_truncation)]
        (a + b.unwrap_or(100) + rest.iter().sum::<f64>() as i64, name.to_owned())
    }

    #[register(Image, "memory", "/picture", should_wait = false, rgb = true)]
    fn picture(&self, there: bool) -> Option<Image> {
        there.then(|| image(1))
    }

    #[register(NativeObject, "memory", "/slow", timeout_ms = 30000)]
    async fn slow(&self, number: u32) -> u32 {
        std::future::ready(number + 1).await
    }

    /// Not registered: stays as it is.
    fn runs(&self) -> u32 {
        self.runs
    }
}

fn robot(context: &Context) -> RobotCommunicator {
    Robot { runs: 0 }.communicator_in(context)
}

#[test]
fn without_a_mode_the_method_is_itself() {
    let mut robot = robot(&context());
    assert_eq!(robot.say("nonsense", "hi", true).unwrap().as_deref(), Some("hi 1"));
    assert_eq!(robot.inner().runs(), 1);
    robot.activate(RobotMethod::Say, Mode::Disable).unwrap();
    assert_eq!(robot.say("nonsense", "hi", true).unwrap(), None);
    let (object, (image, sound), other) = {
        robot.activate("sense", "disable").unwrap();
        robot.sense(1).unwrap()
    };
    assert!(object.is_none() && image.is_none() && sound.is_none() && other.is_none());
    assert_eq!(robot.into_inner().runs(), 1);
}

#[test]
fn what_is_published_is_heard_and_the_body_runs_once() {
    let context = context();
    let (mut here, mut there) = (robot(&context), robot(&context));
    here.activate(RobotMethod::Say, Mode::Publish).unwrap();
    there.activate("say", "listen").unwrap();
    assert_eq!(there.say("memory", "", false).unwrap(), None);
    for turn in 1..=3 {
        let said = here.say("memory", "hello", true).unwrap();
        assert_eq!(said, Some(format!("hello {turn}")));
        assert_eq!(there.say("ignored after the first call", "", true).unwrap(), said);
    }
    assert_eq!(there.inner().runs(), 0);
    let status = here.status(RobotMethod::Say);
    assert_eq!(status[0].ends[0].counters.sent, 3);
    assert_eq!(status[0].ends[0].endpoint.to_string(), "memory:/say");
}

#[test]
fn a_listener_waits_and_is_woken_by_the_message() {
    let context = context();
    let mut there = robot(&context);
    there.activate(RobotMethod::Say, Mode::Listen).unwrap();
    let mut here = robot(&context);
    here.activate(RobotMethod::Say, Mode::Publish).unwrap();
    std::thread::scope(|scope| {
        let heard = scope.spawn(|| there.say("memory", "", true).unwrap());
        // Waits for the listener before the body runs, so nothing is said in vain.
        assert_eq!(here.say("memory", "hello", true).unwrap().as_deref(), Some("hello 1"));
        assert_eq!(heard.join().unwrap().as_deref(), Some("hello 1"));
    });
}

#[test]
fn values_travel_each_on_its_own_and_an_absent_middleware_is_none() {
    let context = context();
    let (mut here, mut there) = (robot(&context), robot(&context));
    here.activate(RobotMethod::Sense, Mode::Publish).unwrap();
    there.activate(RobotMethod::Sense, Mode::Listen).unwrap();
    assert_eq!(there.sense(2).unwrap(), (None, (None, None), None));
    let (object, (picture, absent), last) = here.sense(2).unwrap();
    assert!(absent.is_some(), "a publisher returns its own values");
    let heard = there.sense(2).unwrap();
    assert_eq!(heard, (object, (picture, None), last));
    let status = there.status(RobotMethod::Sense);
    assert_eq!(status[2].absent.as_deref(), Some("yarp"));
    assert_eq!(status.len(), 4);
}

#[test]
fn what_is_not_as_the_option_says_is_refused_on_both_sides() {
    let context = context();
    let (mut here, mut there) = (robot(&context), robot(&context));
    here.activate(RobotMethod::Sense, Mode::Publish).unwrap();
    there.activate(RobotMethod::Sense, Mode::Listen).unwrap();
    assert_eq!(there.sense(3).unwrap().0, None);
    here.sense(2).unwrap();
    let error = there.sense(3).unwrap_err();
    assert!(matches!(error, CallError::WrongType { .. }), "{error}");
    let text = error.to_string();
    assert!(text.contains("Robot::sense") && text.contains("memory:/image"), "{text}");
    assert!(text.contains("the image's width is 2, and the option says width = 3"), "{text}");
    // The option was fixed by the first call.
    let error = here.sense(3).unwrap_err();
    assert!(matches!(error, CallError::Send { .. }), "{error}");
}

#[test]
fn an_image_that_is_none_is_not_sent() {
    let context = context();
    let (mut here, mut there) = (robot(&context), robot(&context));
    here.activate(RobotMethod::Picture, Mode::Publish).unwrap();
    there.activate(RobotMethod::Picture, Mode::Listen).unwrap();
    assert_eq!(there.picture(true).unwrap(), None);
    assert_eq!(here.picture(false).unwrap(), Some(None));
    assert_eq!(there.picture(true).unwrap(), None);
    assert_eq!(here.picture(true).unwrap(), Some(Some(image(1))));
    assert_eq!(there.picture(true).unwrap(), Some(Some(image(1))));
}

#[test]
fn transceive_and_reemit_meet_on_swapped_topics() {
    let context = context();
    let (mut first, mut second) = (robot(&context), robot(&context));
    first.activate(RobotMethod::Chat, Mode::Transceive).unwrap();
    second.activate(RobotMethod::Chat, Mode::Reemit).unwrap();
    // Opens its ends; nothing is there yet.
    assert_eq!(second.chat("/b", "/a", None, b"second").unwrap(), Some(vec!["second".to_owned()]));
    assert_eq!(first.chat("/a", "/b", None, b"first").unwrap(), None);
    until_heard(&second);
    let own = second.chat("", "", None, b"second").unwrap().unwrap();
    assert_eq!(own, ["first", "second"]);
    let back = first.chat("", "", None, b"again").unwrap().unwrap();
    assert_eq!(back, ["first", "second"]);
    // A receiver gets the same without sending anything on.
    second.activate(RobotMethod::Chat, Mode::Receive).unwrap();
    assert_eq!(second.chat("", "", None, b"x").unwrap().unwrap(), ["x"]);
    first.chat("", "", None, b"third").unwrap();
    assert_eq!(second.chat("", "", None, b"x").unwrap().unwrap(), ["third", "x"]);
}

/// Waits until what `robot` says in its chat has a listener.
fn until_heard(robot: &RobotCommunicator) {
    let is_heard = || {
        let status = robot.status(RobotMethod::Chat);
        status[0].ends[0].link.peers == Some(1)
    };
    while !is_heard() {
        std::thread::yield_now();
    }
}

#[test]
fn one_topic_for_both_ways_is_refused() {
    let mut robot = robot(&context());
    robot.activate(RobotMethod::Chat, Mode::Transceive).unwrap();
    let error = robot.chat("/a", "/a", None, b"").unwrap_err();
    assert!(matches!(error, CallError::SameTopic { .. }));
    assert!(error.to_string().contains("listener_kwargs(in_topic = \"…\")"), "{error}");
    // A first call that failed leaves nothing behind.
    assert!(robot.chat("/a", "/b", None, b"").is_ok());
}

#[test]
fn a_request_runs_the_body_elsewhere() {
    let context = context();
    let mut server = robot(&context);
    server.activate(RobotMethod::Add, Mode::Reply).unwrap();
    let mut client = robot(&context);
    client.activate(RobotMethod::Add, Mode::Request).unwrap();
    std::thread::scope(|scope| {
        let served = scope.spawn(|| server.add(0, &None, "", &[]).unwrap());
        let reply = client.add(1, &Some(2), "sum", &[3.0, 4.0]).unwrap();
        assert_eq!(reply, Some((10, "sum".to_owned())));
        assert_eq!(served.join().unwrap(), reply);
    });
}

struct Wrong;

#[communicator]
impl Wrong {
    #[register(NativeObject, "memory", "/add", timeout_ms = 30000)]
    fn add(&self, a: &str) -> String {
        a.to_owned()
    }
}

#[test]
fn a_request_with_wrong_arguments_is_told_so_and_the_server_lives() {
    let context = context();
    let mut server = robot(&context);
    server.activate(RobotMethod::Add, Mode::Reply).unwrap();
    let (mut wrong, mut right) = (Wrong.communicator_in(&context), robot(&context));
    wrong.activate(WrongMethod::Add, Mode::Request).unwrap();
    right.activate(RobotMethod::Add, Mode::Request).unwrap();
    std::thread::scope(|scope| {
        let served = scope.spawn(|| server.add(0, &None, "", &[]).unwrap());
        let error = wrong.add("one").unwrap_err();
        assert!(matches!(error, CallError::Unanswered { .. }), "{error:?}");
        assert!(error.to_string().contains("argument a cannot be used"), "{error}");
        assert_eq!(right.add(1, &None, "n", &[]).unwrap(), Some((101, "n".to_owned())));
        served.join().unwrap();
        // A reply of another type is an error of the caller.
        let served = scope.spawn(|| server.add(0, &None, "", &[]));
        let mut other = Other.communicator_in(&context);
        other.activate(OtherMethod::Add, Mode::Request).unwrap();
        let error = other.add(1, 2, "x", vec![]).unwrap_err();
        assert!(matches!(error, CallError::WrongType { .. }), "{error:?}");
        served.join().unwrap().unwrap();
    });
}

struct Other;

#[communicator]
impl Other {
    #[register(NativeObject, "memory", "/add", timeout_ms = 30000)]
    fn add(&self, a: i64, b: i64, name: &str, rest: Vec<f64>) -> i64 {
        _ = (name, rest);
        a + b
    }
}

#[test]
fn nobody_who_serves_is_an_error_within_the_time() {
    let context = context();
    let mut nobody = Nobody.communicator_in(&context);
    nobody.activate(NobodyMethod::Ask, Mode::Request).unwrap();
    let error = nobody.ask().unwrap_err();
    assert!(matches!(error, CallError::Unanswered { .. }), "{error:?}");
    let text = error.to_string();
    assert!(text.starts_with("Nobody::ask: \"/nobody\" was not answered within 20 ms"), "{text}");
    nobody.activate(NobodyMethod::Ask, Mode::Listen).unwrap();
    let error = nobody.ask().unwrap_err();
    assert!(matches!(error, CallError::TimedOut { .. }), "{error:?}");
    assert!(error.to_string().contains("for a message on memory:/nobody"), "{error}");
    nobody.activate(NobodyMethod::Ask, Mode::Publish).unwrap();
    let error = nobody.ask().unwrap_err();
    assert!(error.to_string().contains("for a listener of memory:/nobody"), "{error}");
    // A server that need not wait goes on.
    nobody.activate(NobodyMethod::Poll, Mode::Reply).unwrap();
    assert_eq!(nobody.poll().unwrap(), None);
}

struct Nobody;

#[communicator]
impl Nobody {
    #[register(NativeObject, "memory", "/nobody", timeout_ms = 20)]
    fn ask(&self) {}

    #[register(NativeObject, "memory", "/poll", should_wait = false)]
    fn poll(&self) {}

    #[register(NativeObject, "$0", "/x", timeout_ms = 20, should_wait = false)]
    fn elsewhere(&self, mware: Option<String>) {
        drop(mware);
    }
}

#[test]
fn a_middleware_nobody_knows_is_a_mistake_and_none_is_no_middleware() {
    let mut nobody = Nobody.communicator_in(&context());
    nobody.activate(NobodyMethod::Elsewhere, Mode::Listen).unwrap();
    let error = nobody.elsewhere(Some("memroy".into())).unwrap_err();
    assert_eq!(
        error.to_string(),
        "Nobody::elsewhere: \"memroy\" is no middleware; did you mean `memory`? available: memory"
    );
    assert_eq!(nobody.elsewhere(None).unwrap(), None);
    nobody.close();
    assert_eq!(nobody.elsewhere(Some("zenoh".into())).unwrap(), None);
}

#[test]
fn a_middleware_without_services_says_so() {
    let refused = Arc::new(Memory::new("memory"));
    refused.refuse_to_open(Some("closed today"));
    let context = Context::builder().only(refused).build();
    let mut nobody = Nobody.communicator_in(&context);
    nobody.activate(NobodyMethod::Ask, Mode::Request).unwrap();
    let error = nobody.ask().unwrap_err();
    assert!(matches!(error, CallError::Open { .. }), "{error:?}");
    assert!(error.to_string().contains("closed today"), "{error}");
}

#[test]
fn modes_change_at_run_time_and_end_what_waits() {
    let context = context();
    let mut robot = robot(&context);
    robot.activate(RobotMethod::Say, Mode::Listen).unwrap();
    let control = robot.control();
    std::thread::scope(|scope| {
        let waiting = scope.spawn(|| robot.say("memory", "", true).unwrap_err());
        while control.status(RobotMethod::Say)[0].ends.is_empty() {
            std::thread::yield_now();
        }
        // Repeated, because the call may not wait yet.
        while !waiting.is_finished() {
            control.cancel(RobotMethod::Say);
            std::thread::yield_now();
        }
        let error = waiting.join().unwrap();
        assert!(matches!(error, CallError::Cancelled { .. }), "{error:?}");
        assert!(error.to_string().contains("a message on memory:/say"), "{error}");
    });
    std::thread::scope(|scope| {
        let waiting = scope.spawn(|| {
            // The last one is called in the new mode.
            std::iter::from_fn(|| robot.say("memory", "x", true).err()).collect::<Vec<_>>()
        });
        control.activate("say", "none").unwrap();
        let errors = waiting.join().unwrap();
        assert!(errors.iter().all(|error| matches!(error, CallError::Ended { .. })), "{errors:?}");
    });
    assert_eq!(robot.say("memory", "x", true).unwrap().as_deref(), Some("x 2"));
}

#[test]
fn close_forgets_what_the_first_call_said() {
    let context = context();
    let mut robot = robot(&context);
    robot.activate(RobotMethod::Chat, Mode::Publish).unwrap();
    robot.chat("/a", "/one", None, b"").unwrap();
    let end =
        |robot: &RobotCommunicator| robot.status(RobotMethod::Chat)[0].ends[0].endpoint.to_string();
    assert_eq!(end(&robot), "memory:/one");
    robot.activate(RobotMethod::Chat, Mode::Listen).unwrap();
    robot.activate(RobotMethod::Chat, Mode::Publish).unwrap();
    robot.chat("/a", "/two", None, b"").unwrap();
    assert_eq!(end(&robot), "memory:/one", "kept until close");
    robot.close_method(RobotMethod::Chat);
    assert!(robot.status(RobotMethod::Chat)[0].ends.is_empty());
    robot.chat("/a", "/two", None, b"").unwrap();
    assert_eq!(end(&robot), "memory:/two");
}

#[test]
fn mistakes_of_activation_are_named() {
    let mut robot = robot(&context());
    let error = robot.activate("sya", Mode::Listen).unwrap_err().to_string();
    assert!(
        error.starts_with("Robot has no registered method \"sya\"; did you mean `say`?"),
        "{error}"
    );
    let error = robot.activate("say", "lisen").unwrap_err().to_string();
    assert!(error.contains("did you mean `listen`?"), "{error}");
    let error = robot.activate(RobotMethod::Say, Mode::Receive).unwrap_err();
    assert!(matches!(error, ActivateError::NothingReceived { .. }));
    assert!(error.to_string().contains("#[received] prev: Option<…>"), "{error}");
    assert_eq!(RobotMethod::Say.name(), "say");
    assert_eq!(RobotMethod::ALL.len(), 6);
}

#[test]
fn a_list_gives_each_instance_its_mode() {
    let context = context();
    let modes = [Mode::Publish, Mode::Listen];
    let (mut first, mut second, mut third) = (robot(&context), robot(&context), robot(&context));
    first.activate(RobotMethod::Say, modes).unwrap();
    second.activate(RobotMethod::Say, &modes[..]).unwrap();
    assert_eq!((first.mode(RobotMethod::Say), second.mode(RobotMethod::Say)), modes.into());
    let error = third.activate("say", ["publish", "listen"]).unwrap_err().to_string();
    assert!(error.contains("listed for 2 instances, and this is instance 3"), "{error}");
}

#[test]
fn a_configuration_gives_modes_and_its_mistakes_are_told_by_calls() {
    let text = "Robot:\n  say: [publish, listen]\n  add: null\nNobody:\n  nod: publish\n";
    let context = context();
    context.configure(Configuration::from_yaml(text, "modes.yml").unwrap());
    let (first, second, mut third) = (robot(&context), robot(&context), robot(&context));
    assert_eq!(first.mode(RobotMethod::Say), Mode::Publish);
    assert_eq!(second.mode(RobotMethod::Say), Mode::Listen);
    let error = third.say("memory", "", false).unwrap_err().to_string();
    assert!(error.starts_with("modes.yml:2: modes of Robot::say are listed for 2"), "{error}");
    assert!(third.sense(1).is_ok(), "other methods are not concerned");
    third.activate(RobotMethod::Say, Mode::None).unwrap();
    assert!(third.say("memory", "", false).is_ok());
    let nobody = Nobody.communicator_in(&context);
    let error = nobody.poll().unwrap_err().to_string();
    assert!(error.starts_with("modes.yml:5: Nobody has no registered method \"nod\""), "{error}");
}

#[test]
fn nobody_listens_and_nothing_is_made() {
    let mut robot = robot(&context());
    robot.activate(RobotMethod::Sense, Mode::Publish).unwrap();
    for _ in 0..3 {
        robot.sense(1).unwrap();
    }
    let status = robot.status(RobotMethod::Sense);
    assert_eq!(status[0].ends[0].counters.dropped_for(DropReason::NoConsumer), 3);
    assert_eq!(status[0].ends[0].counters.sent, 0);
}

#[test]
fn async_methods_work_without_any_executor_of_ours() {
    let context = context();
    let (mut here, mut there) = (robot(&context), robot(&context));
    here.activate(RobotMethod::Slow, Mode::Publish).unwrap();
    there.activate(RobotMethod::Slow, Mode::Listen).unwrap();
    std::thread::scope(|scope| {
        let heard = scope.spawn(|| block_on(there.slow(0)));
        assert_eq!(block_on(here.slow(1)).unwrap(), Some(2));
        assert_eq!(heard.join().unwrap().unwrap(), Some(2));
    });
    here.activate(RobotMethod::Slow, Mode::Request).unwrap();
    there.activate(RobotMethod::Slow, Mode::Reply).unwrap();
    std::thread::scope(|scope| {
        let served = scope.spawn(|| block_on(there.slow(0)));
        assert_eq!(block_on(here.slow(41)).unwrap(), Some(42));
        assert_eq!(served.join().unwrap().unwrap(), Some(42));
    });
    // A future that is dropped while it waits leaves the method as it was.
    there.activate(RobotMethod::Slow, Mode::Listen).unwrap();
    {
        let mut waiting = std::pin::pin!(there.slow(0));
        let mut task = std::task::Context::from_waker(std::task::Waker::noop());
        assert!(waiting.as_mut().poll(&mut task).is_pending());
    }
    assert_eq!(there.mode(RobotMethod::Slow), Mode::Listen);
    fn is_send<T: Send>(_: &T) {}
    is_send(&there.slow(0));
}

/// Runs a future on this thread.
fn block_on<T>(future: impl Future<Output = T>) -> T {
    struct Unpark(std::thread::Thread);
    impl std::task::Wake for Unpark {
        fn wake(self: Arc<Self>) {
            self.0.unpark();
        }
    }
    let waker = Arc::new(Unpark(std::thread::current())).into();
    let mut task = std::task::Context::from_waker(&waker);
    let mut future = std::pin::pin!(future);
    loop {
        if let std::task::Poll::Ready(value) = future.as_mut().poll(&mut task) {
            return value;
        }
        std::thread::park_timeout(Duration::from_secs(60));
    }
}

#[test]
fn a_listener_with_another_type_says_what_came() {
    let context = context();
    let mut here = robot(&context);
    here.activate(RobotMethod::Say, Mode::Publish).unwrap();
    let mut other = Numbers.communicator_in(&context);
    other.activate(NumbersMethod::Say, Mode::Listen).unwrap();
    assert_eq!(other.say().unwrap(), None);
    here.say("memory", "x", true).unwrap();
    let error = other.say().unwrap_err();
    assert!(matches!(error, CallError::WrongType { .. }), "{error:?}");
    assert!(error.to_string().contains("memory:/say"), "{error}");
    assert_eq!(other.say().unwrap(), None, "it is gone");
}

struct Numbers;

#[communicator]
impl Numbers {
    #[register("NativeObject", "memory", "Numbers", "/say", should_wait = false)]
    fn say(&self) -> u64 {
        0
    }
}

struct Choosy;

#[communicator]
impl Choosy {
    #[register(
        NativeObject,
        "memory",
        "/choosy",
        should_wait = false,
        message_type = "$message_type",
        queue_size = "$queue_size"
    )]
    fn pick(&self, message_type: Option<String>, queue_size: Option<String>) -> Value {
        _ = (message_type, queue_size);
        Value::Null
    }

    #[register(Properties, "memory", "/node", timeout_ms = 20)]
    fn settings(&self) -> Properties {
        Properties::new()
    }
}

#[test]
fn a_type_or_a_number_that_is_none_is_named_with_what_may_be_written() {
    let context = context();
    for mode in [Mode::Publish, Mode::Listen] {
        let mut choosy = Choosy.communicator_in(&context);
        choosy.activate(ChoosyMethod::Pick, mode).unwrap();
        for (message_type, queue_size, words) in [
            (Some("Imag"), None, "option message_type is \"Imag\", and should be another one"),
            (Some("Image"), None, "and should be a type that carries NativeObject"),
            (None, Some("many"), "option queue_size is \"many\", and should be a whole number"),
        ] {
            let error = choosy
                .pick(message_type.map(str::to_owned), queue_size.map(str::to_owned))
                .unwrap_err();
            assert!(matches!(error, CallError::Option { .. }), "{error:?}");
            let text = error.to_string();
            assert!(text.starts_with("Choosy::pick: ") && text.contains(words), "{text}");
        }
        // The same method with what can be is not harmed.
        assert!(choosy.pick(None, None).is_ok());
    }
    let mut choosy = Choosy.communicator_in(&context);
    for mode in [Mode::Request, Mode::Reply] {
        choosy.activate(ChoosyMethod::Settings, mode).unwrap();
        let error = choosy.settings().unwrap_err();
        assert!(matches!(error, CallError::Option { .. }), "{error:?}");
        assert!(error.to_string().contains("data type is Properties, and should be"), "{error}");
    }
}
