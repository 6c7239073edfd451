//! The classes that the tests register methods of.

use std::sync::Arc;

use wrapyfi_core::communicator::{CommunicatorContext, communicator};
use wrapyfi_data::types::{
    AudioChunk, Encoding, Image, RawPixels, SampleFormat, Stamp, Tensor, Value,
};
use wrapyfi_endpoint::memory::Memory;

pub(super) fn context() -> CommunicatorContext {
    CommunicatorContext::builder()
        .only(Arc::new(Memory::new("memory")))
        .default_middleware("memory")
        .build()
}

pub(super) fn image(width: u32) -> Image {
    let length = width as usize * 3;
    let pixels = RawPixels::dense(width, 1, Encoding::Bgr8, vec![7; length]).unwrap();
    Image::new(Stamp { sec: 5, nanosec: 6 }, pixels)
}

pub(super) fn sound() -> AudioChunk {
    AudioChunk::new(Stamp::default(), 2, 1, 8000, SampleFormat::F32Le, vec![1; 8]).unwrap()
}

pub(super) struct Robot {
    pub(super) runs: u32,
}

#[communicator]
impl Robot {
    #[register(NativeObject, "$mware", "/say", should_wait = "$wait", timeout_ms = 30000)]
    pub(super) fn say(&mut self, mware: &str, text: &str, wait: bool) -> String {
        _ = (mware, wait);
        self.runs += 1;
        format!("{text} {}", self.runs)
    }

    /// Three returned values, one of them a list, one on a middleware that is not here.
    #[register(NativeObject, "memory", "/object", should_wait = false)]
    #[register([Image, "memory", "/image", should_wait = false, width = "$width"],
               [AudioChunk, "yarp", "/sound"])]
    #[register(AudioChunk, topic = "/sound", should_wait = false, rate = 8000)]
    pub(super) fn sense(&mut self, width: u32) -> (Value, (Image, AudioChunk), AudioChunk) {
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
    pub(super) fn chat(
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
    pub(super) fn add(&self, a: i64, b: &Option<i64>, name: &str, rest: &[f64]) -> (i64, String) {
        (a + b.unwrap_or(100) + rest.iter().sum::<f64>() as i64, name.to_owned())
    }

    #[register(Image, "memory", "/picture", should_wait = false, rgb = true)]
    pub(super) fn picture(&self, there: bool) -> Option<Image> {
        there.then(|| image(1))
    }

    #[register(NativeObject, "memory", "/slow", timeout_ms = 30000)]
    pub(super) async fn slow(&self, number: u32) -> u32 {
        std::future::ready(number + 1).await
    }

    /// A method that is not registered, and stays as it is.
    pub(super) fn runs(&self) -> u32 {
        self.runs
    }
}

pub(super) fn robot(context: &CommunicatorContext) -> RobotCommunicator {
    Robot { runs: 0 }.communicator_in(context)
}

pub(super) struct Nobody;

#[communicator]
impl Nobody {
    #[register(NativeObject, "memory", "/nobody", timeout_ms = 20)]
    pub(super) fn ask(&self) {}

    #[register(NativeObject, "memory", "/poll", should_wait = false)]
    pub(super) fn poll(&self) {}

    #[register(NativeObject, "$0", "/x", timeout_ms = 20, should_wait = false)]
    pub(super) fn elsewhere(&self, mware: Option<String>) {
        drop(mware);
    }
}
