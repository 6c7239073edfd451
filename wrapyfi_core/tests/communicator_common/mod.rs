//! Tests of registered methods on any middleware, between two contexts that share a wire.

use std::sync::mpsc::RecvTimeoutError;
use std::time::Duration;

use wrapyfi_core::communicator::{CommunicatorContext, MethodError, Mode, communicator};
use wrapyfi_data::types::{AudioChunk, Encoding, Image, RawPixels, SampleFormat, Stamp, Tensor};

/// Long enough for the slowest machine; reached only by failures.
const TIMEOUT_MS: u64 = 30_000;
/// Pause before a message that no program has heard is said once more.
const AGAIN: Duration = Duration::from_millis(200);

pub struct Robot {
    turn: u8,
}

#[communicator]
impl Robot {
    #[register(NativeObject, "$mware", "/robot/state", timeout_ms = "$timeout_ms")]
    fn state(&mut self, mware: &str, timeout_ms: u64) -> (u8, Tensor) {
        _ = (mware, timeout_ms);
        self.turn += 1;
        let turn = f32::from(self.turn);
        (self.turn, Tensor::from_elements(&[2], vec![turn, -turn]).unwrap())
    }

    #[register(Image, "$mware", "/robot/camera", timeout_ms = 30000, encoding = "rgb8")]
    fn camera(&mut self, mware: &str) -> Image {
        _ = mware;
        self.turn += 1;
        let pixels = RawPixels::dense(2, 1, Encoding::Rgb8, vec![self.turn; 6]).unwrap();
        Image::new(Stamp { sec: 5, nanosec: 6000 }, pixels)
    }

    #[register(AudioChunk, "$mware", "/robot/ear", timeout_ms = 30000)]
    fn ear(&mut self, mware: &str) -> AudioChunk {
        _ = mware;
        self.turn += 1;
        let data: Vec<u8> =
            [0.5_f32, f32::from(self.turn)].iter().flat_map(|x| x.to_le_bytes()).collect();
        AudioChunk::new(Stamp { sec: 7, nanosec: 0 }, 1, 2, 8000, SampleFormat::F32Le, data)
            .unwrap()
    }

    #[register(
        NativeObject,
        "$mware",
        "$way_in",
        timeout_ms = 30000,
        listener_kwargs(in_topic = "$way_in"),
        publisher_kwargs(out_topic = "$way_out")
    )]
    fn chat(
        &mut self,
        mware: &str,
        way_in: &str,
        way_out: &str,
        word: &str,
        #[received] prev: Option<Vec<String>>,
    ) -> Vec<String> {
        _ = (mware, way_in, way_out);
        let mut words = prev.unwrap_or_default();
        words.push(word.to_owned());
        words
    }

    #[register(NativeObject, "$mware", "/robot/add", timeout_ms = 30000)]
    async fn add(&self, mware: &str, a: i64, numbers: &[i64]) -> i64 {
        _ = mware;
        a + numbers.iter().sum::<i64>()
    }
}

fn robot(context: &CommunicatorContext) -> RobotCommunicator {
    Robot { turn: 0 }.communicator_in(context)
}

/// Every data type arrives as it was returned.
pub fn what_is_published_is_heard(
    mware: &str,
    here: &CommunicatorContext,
    there: &CommunicatorContext,
) {
    let (mut ours, mut theirs) = (robot(here), robot(there));
    for method in [RobotMethod::State, RobotMethod::Camera, RobotMethod::Ear] {
        ours.activate(method, Mode::Publish).unwrap();
        theirs.activate(method, Mode::Listen).unwrap();
    }
    std::thread::scope(|scope| {
        let heard = scope.spawn(|| {
            let state = theirs.state(mware, TIMEOUT_MS).unwrap();
            (state, theirs.camera(mware).unwrap(), theirs.ear(mware).unwrap())
        });
        // Each waits for its listener, which is opened one after the other.
        let said = (
            ours.state(mware, TIMEOUT_MS).unwrap(),
            ours.camera(mware).unwrap(),
            ours.ear(mware).unwrap(),
        );
        assert_eq!(heard.join().unwrap(), said);
        assert_eq!(said.0.unwrap().0, 1);
    });
}

/// A value that goes out by transceive comes back by reemit.
pub fn transceive_meets_reemit(
    mware: &str,
    here: &CommunicatorContext,
    there: &CommunicatorContext,
) {
    let (mut ours, mut theirs) = (robot(here), robot(there));
    ours.activate(RobotMethod::Chat, Mode::Transceive).unwrap();
    theirs.activate(RobotMethod::Chat, Mode::Reemit).unwrap();
    std::thread::scope(|scope| {
        let reemitted =
            scope.spawn(|| theirs.chat(mware, "/robot/there", "/robot/back", "two", None).unwrap());
        let back = ours.chat(mware, "/robot/back", "/robot/there", "one", None).unwrap().unwrap();
        assert_eq!(back, ["one", "two"]);
        assert_eq!(reemitted.join().unwrap().unwrap(), back);
    });
}

/// One instance publishes, then listens, then publishes again.
pub fn modes_change(mware: &str, here: &CommunicatorContext, there: &CommunicatorContext) {
    let (mut ours, mut theirs) = (robot(here), robot(there));
    for (mode, other) in [
        (Mode::Publish, Mode::Listen),
        (Mode::Listen, Mode::Publish),
        (Mode::Publish, Mode::Listen),
    ] {
        ours.activate(RobotMethod::State, mode).unwrap();
        theirs.activate(RobotMethod::State, other).unwrap();
        let (speaker, hearer) = match mode {
            Mode::Publish => (&mut ours, &mut theirs),
            _ => (&mut theirs, &mut ours),
        };
        let (tell, told) = std::sync::mpsc::channel();
        std::thread::scope(|scope| {
            scope.spawn(move || tell.send(hearer.state(mware, TIMEOUT_MS).unwrap()).unwrap());
            // A publisher may see the listener of the mode before still, whose end travels through
            // the broker, and then its message reaches no listener: so it publishes until it is heard.
            let mut said = Vec::new();
            let heard = loop {
                said.push(speaker.state(mware, TIMEOUT_MS).unwrap());
                match told.recv_timeout(AGAIN) {
                    Ok(heard) => break heard,
                    Err(error) => assert_eq!(error, RecvTimeoutError::Timeout),
                }
            };
            assert!(heard.is_some() && said.contains(&heard), "{heard:?} is none of {said:?}");
        });
    }
}

/// A call runs elsewhere.
pub fn a_request_is_replied(mware: &str, here: &CommunicatorContext, there: &CommunicatorContext) {
    let (mut ours, mut theirs) = (robot(here), robot(there));
    ours.activate(RobotMethod::Add, Mode::Request).unwrap();
    theirs.activate(RobotMethod::Add, Mode::Reply).unwrap();
    std::thread::scope(|scope| {
        let served = scope.spawn(|| {
            (0..2).map(|_| block_on(theirs.add(mware, 0, &[])).unwrap()).collect::<Vec<_>>()
        });
        assert_eq!(block_on(ours.add(mware, 1, &[2, 3])).unwrap(), Some(6));
        assert_eq!(block_on(ours.add(mware, -1, &[])).unwrap(), Some(-1));
        assert_eq!(served.join().unwrap(), [Some(6), Some(-1)]);
    });
}

/// A wait ends in time where no program publishes.
pub fn a_wait_ends_in_time(mware: &str, here: &CommunicatorContext) {
    let mut ours = robot(here);
    ours.activate(RobotMethod::State, Mode::Listen).unwrap();
    let error = ours.state(mware, 20).unwrap_err().to_string();
    assert!(error.contains("Robot::state: waited"), "{error}");
    assert!(error.contains(&format!("a message on {mware}:/robot/state")), "{error}");
    ours.activate(RobotMethod::State, Mode::Request).unwrap();
    let error = ours.state(mware, 20).unwrap_err();
    assert!(matches!(error, MethodError::Unanswered { .. }), "{error:?}");
    let text = error.to_string();
    assert!(text.starts_with("Robot::state: ") && text.contains("within 20 ms"), "{text}");
}

/// Runs a future on this thread.
fn block_on<T>(future: impl Future<Output = T>) -> T {
    struct Unpark(std::thread::Thread);
    impl std::task::Wake for Unpark {
        fn wake(self: std::sync::Arc<Self>) {
            self.0.unpark();
        }
    }
    let waker = std::sync::Arc::new(Unpark(std::thread::current())).into();
    let mut task = std::task::Context::from_waker(&waker);
    let mut future = std::pin::pin!(future);
    loop {
        if let std::task::Poll::Ready(value) = future.as_mut().poll(&mut task) {
            return value;
        }
        std::thread::park();
    }
}
