//! Native objects with large arrays: our coder, base64 alone and memcpy by turns, and peak memory.
//!
//! ```text
//!   memcpy ─▶ base64 decode ─▶ our decode ─▶ base64 encode ─▶ our encode ┐
//!      └────────────────────── and backwards, again and again ◀─────────┘
//! ```
//!
//! All of them on the same message: one after the other within milliseconds, so that a change of
//! the processor's clock meets all alike. Memory is measured in a process of its own, which does
//! one thing and tells how far its resident memory ever rose.

use std::hint::black_box;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, ensure};
use base64_simd::STANDARD;
use bytes::Bytes;
use memchr::{memmem, memrchr};
use serde::{Deserialize, Serialize};
use wrapyfi_core::Limits;
use wrapyfi_core::codec::json;
use wrapyfi_core::types::{Dtype, Payload, Tensor, Value};

use crate::child::Child;
use crate::micro::Figure;
use crate::payload::{Kind, Maker};
use crate::proc;
use crate::stats::median;

/// Names of the figures.
pub(crate) const MEMCPY: &str = "native 1 MiB: memcpy of the text";
pub(crate) const DECODE_ALONE: &str = "native 1 MiB: base64-simd decode of the text";
pub(crate) const DECODE: &str = "native 1 MiB: decode";
pub(crate) const ENCODE_ALONE: &str = "native 1 MiB: base64-simd encode of the same";
pub(crate) const ENCODE: &str = "native 1 MiB: encode";
pub(crate) const ARRAY_TEXT: &str = "native 100 MiB: MiB of text";
pub(crate) const DECODE_MEMORY: &str = "native 100 MiB: peak MiB, decode";
pub(crate) const ENCODE_MEMORY: &str = "native 100 MiB: peak MiB, encode";

/// Time for all of them together, and sweeps at least.
const BUDGET: Duration = Duration::from_millis(120);
const SWEEPS: usize = 15;
/// Floats in the array whose memory is looked at: 100 MiB.
const LARGE: usize = 100 << 18;
/// `max_message_mib: 256`.
const LIMITS: usize = 256 * Limits::MIB;

/// Work that is timed: its name, the times so far, the work itself.
type Work<'a> = (&'static str, Vec<f64>, &'a mut dyn FnMut());

/// The message of 1 MiB in its two forms, and what base64 alone is given.
pub(crate) struct Native {
    value: Value,
    text: Bytes,
    /// The base64 in the text, and what it stands for: an array file.
    base64: (usize, usize),
    file: Vec<u8>,
}

impl Native {
    /// Makes it once.
    pub(crate) fn new() -> Result<Self> {
        let Payload::NativeObject(value) = Maker::new(Kind::F32Mib)?.payload(1) else {
            anyhow::bail!("a dict is no native object");
        };
        let text = Bytes::from(json::encode(&value)?);
        let to = memrchr(b'"', &text).context("the text does not end")?;
        let tag = b"\"numpy.ndarray\", \"";
        let from = memmem::find(&text, tag).context("no array in the text")? + tag.len();
        let file = STANDARD.decode_to_vec(text.get(from..to).unwrap_or_default())?;
        ensure!(file.len() > 1 << 20, "the array file has {} bytes only", file.len());
        Ok(Self { value: value.value, text, base64: (from, to), file })
    }

    /// Medians of one round, in microseconds.
    pub(crate) fn round(&self) -> Vec<Figure> {
        let (from, to) = self.base64;
        let limits = Limits::default();
        let mut copy = vec![0; self.text.len()];
        let mut works: [Work<'_>; 5] = [
            (MEMCPY, Vec::new(), &mut || {
                black_box(&mut copy).copy_from_slice(black_box(&self.text));
            }),
            (DECODE_ALONE, Vec::new(), &mut || {
                let base64 = black_box(&self.text).get(from..to).unwrap_or_default();
                drop(black_box(STANDARD.decode_to_vec(base64)));
            }),
            (DECODE, Vec::new(), &mut || {
                drop(black_box(json::decode(black_box(&self.text), &limits)));
            }),
            (ENCODE_ALONE, Vec::new(), &mut || {
                drop(black_box(STANDARD.encode_type::<Vec<u8>>(black_box(&self.file))));
            }),
            (ENCODE, Vec::new(), &mut || drop(black_box(json::encode(black_box(&self.value))))),
        ];
        works.iter_mut().for_each(|(_, _, work)| work());
        let begin = Instant::now();
        let mut sweeps = 0;
        while sweeps < SWEEPS || begin.elapsed() < BUDGET {
            for (_, times, work) in &mut works {
                let start = Instant::now();
                work();
                times.push(start.elapsed().as_secs_f64() * 1e6);
            }
            works.reverse();
            sweeps += 1;
        }
        works
            .iter()
            .map(|(name, times, _)| ((*name).to_owned(), median(times).unwrap_or(f64::NAN)))
            .collect()
    }
}

/// Task of the process that codes the large array.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Large {
    /// Makes the array, encodes it, and leaves the text in the file.
    Encode,
    /// Reads the text from the file and decodes it.
    Decode,
}

/// Figures of that process.
#[derive(Debug, Serialize, Deserialize)]
struct Told {
    /// Bytes of the text.
    text: usize,
    /// Growth of resident memory over that at the beginning, in KiB, at its peak.
    grown_kib: f64,
}

/// Measures peak memory of both once; `own` is this program, `folder` takes the text.
pub(crate) fn memory(own: &Path, folder: &Path) -> Result<Vec<Figure>> {
    let file = folder.join("large.json");
    let ask = |what: &str| -> Result<Told> {
        let mut command = Command::new(own);
        command.arg("large").arg("--what").arg(what).arg("--file").arg(&file);
        Child::start("large", command, folder)?.answer()
    };
    let (encode, decode) = (ask("encode")?, ask("decode")?);
    ensure!(encode.text == decode.text, "two texts of {} and {}", encode.text, decode.text);
    #[allow(clippy::cast_precision_loss)]
    let text = encode.text as f64 / f64::from(1 << 20);
    Ok(vec![
        (ARRAY_TEXT.to_owned(), text),
        (ENCODE_MEMORY.to_owned(), encode.grown_kib / 1024.0),
        (DECODE_MEMORY.to_owned(), decode.grown_kib / 1024.0),
    ])
}

/// Runs that process. What it works on counts too: it is in memory while it is coded.
pub(crate) fn large(what: Large, file: &PathBuf) -> Result<()> {
    let before = proc::peak_kib();
    let (grown_kib, text) = match what {
        Large::Encode => {
            #[allow(clippy::cast_precision_loss)]
            let floats = (0..LARGE).map(|n| (n as f32 / 1e4).sin());
            let mut bytes = Vec::with_capacity(LARGE * 4);
            floats.for_each(|float| bytes.extend_from_slice(&float.to_le_bytes()));
            let value = Value::from(Tensor::new(Dtype::F32, [LARGE], bytes)?);
            let text = json::encode(&value)?;
            let grown_kib = proc::peak_kib() - before;
            if !file.exists() {
                std::fs::write(file, &text)?;
            }
            (grown_kib, text.len())
        }
        Large::Decode => {
            let text = Bytes::from(std::fs::read(file)?);
            let limits = Limits { message_bytes: LIMITS, ..Limits::default() };
            let value = json::decode(&text, &limits)?;
            let grown_kib = proc::peak_kib() - before;
            let Value::Tensor(tensor) = &value else { anyhow::bail!("no array came out") };
            ensure!(tensor.data().len() == LARGE * 4, "an array of another size came out");
            (grown_kib, text.len())
        }
    };
    writeln!(std::io::stdout(), "{}", serde_json::to_string(&Told { text, grown_kib })?)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_alone_works_on_what_our_coder_works_on() {
        let native = Native::new().unwrap();
        let (from, to) = native.base64;
        assert_eq!(&native.file[..6], b"\x93NUMPY");
        assert_eq!(STANDARD.encode_to_string(&native.file).as_bytes(), &native.text[from..to]);
        assert!(native.text.len() - (to - from) < 100, "the text is nearly all base64");
        assert_eq!(json::decode(&native.text, &Limits::default()).unwrap(), native.value);
    }
}
