//! Requests and replies, and methods that are async.

use std::sync::Arc;
use std::time::Duration;

use wrapyfi_core::communicator::{MethodError, Mode, communicator};

use super::robot::{Nobody, NobodyMethod, RobotMethod, context, robot};

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

struct Greeter;

#[communicator]
impl Greeter {
    #[register(NativeObject, "memory", "/greet", timeout_ms = 30000)]
    fn greet(
        &self,
        name: &str,
        #[default("!")] end: &str,
        #[default([1, 2])] numbers: &[i64],
        #[default(true)] loud: bool,
        #[default(Self::USUAL)] times: u8,
    ) -> String {
        format!("{name}{end} {numbers:?} {loud} {times}")
    }
}

impl Greeter {
    const USUAL: u8 = 3;
}

struct Brief;

#[communicator]
impl Brief {
    #[register(NativeObject, "memory", "/greet", timeout_ms = 30000)]
    fn greet(&self, name: &str) -> String {
        name.to_owned()
    }
    #[register(NativeObject, "memory", "/greet", timeout_ms = 30000)]
    fn nothing(&self) -> String {
        String::new()
    }
}

#[test]
fn a_server_takes_the_default_of_what_a_client_leaves_out() {
    let context = context();
    let mut server = Greeter.communicator_in(&context);
    server.activate(GreeterMethod::Greet, Mode::Reply).unwrap();
    let (mut brief, mut whole) =
        (Brief.communicator_in(&context), Greeter.communicator_in(&context));
    brief.activate(BriefMethod::Greet, Mode::Request).unwrap();
    brief.activate(BriefMethod::Nothing, Mode::Request).unwrap();
    whole.activate(GreeterMethod::Greet, Mode::Request).unwrap();
    std::thread::scope(|scope| {
        let served = scope.spawn(|| {
            server.greet("", "", &[], false, 0).unwrap();
            server.greet("", "", &[], false, 0).unwrap();
        });
        assert_eq!(brief.greet("Ada").unwrap().unwrap(), "Ada! [1, 2] true 3");
        // What has no default is named, and the server goes on.
        let error = brief.nothing().unwrap_err().to_string();
        assert!(error.contains("argument name is missing"), "{error}");
        let all = whole.greet("Ada", "?", &[5], false, 1).unwrap();
        assert_eq!(all.unwrap(), "Ada? [5] false 1");
        served.join().unwrap();
    });
}

struct Silent;

#[communicator]
impl Silent {
    #[register(NativeObject, "memory", "/silence", timeout_ms = 1500)]
    fn hear(&self) -> String {
        String::new()
    }
}

/// A program of its own for the test below.
#[test]
#[ignore = "waits in vain, for the test that runs it"]
fn a_program_that_waits() {
    let mut silent = Silent.communicator_in(&context());
    silent.activate(SilentMethod::Hear, Mode::Listen).unwrap();
    assert!(matches!(silent.hear(), Err(MethodError::TimedOut { .. })));
}

#[test]
fn a_program_without_a_log_says_on_stderr_what_it_waits_for() {
    let program = std::process::Command::new(std::env::current_exe().unwrap())
        .args([
            "--ignored",
            "--exact",
            "communicator::requests::a_program_that_waits",
            "--nocapture",
        ])
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&program.stderr);
    assert!(said.contains("hear waits for"), "{said}{}", String::from_utf8_lossy(&program.stdout));
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
        assert!(matches!(error, MethodError::Unanswered { .. }), "{error:?}");
        assert!(error.to_string().contains("argument a cannot be used"), "{error}");
        assert_eq!(right.add(1, &None, "n", &[]).unwrap(), Some((101, "n".to_owned())));
        served.join().unwrap();
        // A reply of another type is an error of the caller.
        let served = scope.spawn(|| server.add(0, &None, "", &[]));
        let mut other = Other.communicator_in(&context);
        other.activate(OtherMethod::Add, Mode::Request).unwrap();
        let error = other.add(1, 2, "x", vec![]).unwrap_err();
        assert!(matches!(error, MethodError::WrongType { .. }), "{error:?}");
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
    assert!(matches!(error, MethodError::Unanswered { .. }), "{error:?}");
    let text = error.to_string();
    assert!(text.starts_with("Nobody::ask: \"/nobody\" was not answered within 20 ms"), "{text}");
    nobody.activate(NobodyMethod::Ask, Mode::Listen).unwrap();
    let error = nobody.ask().unwrap_err();
    assert!(matches!(error, MethodError::TimedOut { .. }), "{error:?}");
    assert!(error.to_string().contains("for a message on memory:/nobody"), "{error}");
    nobody.activate(NobodyMethod::Ask, Mode::Publish).unwrap();
    let error = nobody.ask().unwrap_err();
    assert!(error.to_string().contains("for a listener of memory:/nobody"), "{error}");
    // A server that need not wait goes on.
    nobody.activate(NobodyMethod::Poll, Mode::Reply).unwrap();
    assert_eq!(nobody.poll().unwrap(), None);
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
pub(super) fn block_on<T>(future: impl Future<Output = T>) -> T {
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
