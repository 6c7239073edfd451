//! Sources and destinations of sound for the sensor examples.
//!
//! ```text
//!   voice.wav ─────▶ chunks, at the pace of the sound  (works everywhere, tested)
//!   alsa:default ──▶ arecord, a pipe ─▶ chunks
//!   chunks ──┬─▶ heard.wav
//!            └─▶ a pipe, aplay ─▶ alsa:default
//! ```
//!
//! ALSA is spoken to by `arecord` and `aplay` of alsa-utils: programs that link its library need its
//! headers on every machine that builds them, and an example should not.

use std::fs::File;
use std::io::{BufReader, BufWriter, ErrorKind, Read, Write as _};
use std::path::Path;
use std::process::{Child, Command, Stdio};

use anyhow::{Context as _, bail, ensure};
use wrapyfi_core::types::{AudioChunk, SampleFormat, Stamp};

/// Prefix of the name of an ALSA device.
const ALSA: &str = "alsa:";

/// Samples per second, channels, and frames of a chunk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sound {
    /// Samples per second and channel, in Hz.
    pub rate: u32,
    /// Channels.
    pub channels: u8,
    /// Samples per channel in each chunk.
    pub chunk: u32,
}

/// A source of chunks of 32-bit floats.
#[derive(Debug)]
pub struct Microphone {
    source: Source,
    sound: Sound,
}

#[derive(Debug)]
enum Source {
    /// Samples of the whole file, and how many bytes of them are used up.
    Wav {
        samples: Vec<u8>,
        used: usize,
        is_repeated: bool,
    },
    Recorder(Ended),
}

impl Microphone {
    /// Opens a WAV file, whose rate and channels count instead of those given, or a device such as
    /// `alsa:default`.
    ///
    /// # Errors
    /// When there is no such file or program.
    pub fn open(name: &str, is_repeated: bool, wanted: Sound) -> anyhow::Result<Self> {
        ensure!(wanted.chunk > 0, "a chunk of 0 frames has no sound: --chunk 1 or more");
        if let Some(device) = name.strip_prefix(ALSA) {
            let source = Source::Recorder(Ended(alsa("arecord", device, wanted, false)?));
            return Ok(Self { source, sound: wanted });
        }
        let path = Path::new(name);
        let reader = hound::WavReader::open(path)
            .with_context(|| format!("cannot read the WAV file {name}"))?;
        let spec = reader.spec();
        let channels = u8::try_from(spec.channels)
            .with_context(|| format!("{name} has {} channels, the limit is 255", spec.channels))?;
        let sound = Sound { rate: spec.sample_rate, channels, ..wanted };
        let samples = floats(reader).with_context(|| name.to_owned())?;
        ensure!(!samples.is_empty(), "{name} is empty: give a file with sound");
        Ok(Self { source: Source::Wav { samples, used: 0, is_repeated }, sound })
    }

    /// Rate, channels and size of the chunks.
    #[must_use]
    pub fn sound(&self) -> Sound {
        self.sound
    }

    /// True where the program that reads has to keep the pace, because the source does not.
    #[must_use]
    pub fn is_file(&self) -> bool {
        matches!(self.source, Source::Wav { .. })
    }

    /// The next chunk, the last of a file filled up with silence; `None` after it.
    ///
    /// # Errors
    /// When the recorder ended.
    pub fn chunk(&mut self) -> anyhow::Result<Option<AudioChunk>> {
        let Sound { rate, channels, chunk } = self.sound;
        let frame = usize::from(channels) * SampleFormat::F32Le.bytes_per_sample();
        let size = usize::try_from(chunk)?.checked_mul(frame).context("the chunk is too long")?;
        let bytes = match &mut self.source {
            Source::Wav { samples, used, is_repeated } => {
                if *used >= samples.len() && *is_repeated {
                    *used = 0;
                }
                let rest = samples.get(*used..).unwrap_or_default();
                if rest.is_empty() {
                    return Ok(None);
                }
                let mut bytes = rest.get(..size.min(rest.len())).unwrap_or_default().to_vec();
                *used += bytes.len();
                bytes.resize(size, 0);
                bytes
            }
            Source::Recorder(Ended(recorder)) => {
                let pipe = recorder.stdout.as_mut().context("arecord has no output")?;
                let mut bytes = vec![0; size];
                pipe.read_exact(&mut bytes).context("arecord ended; see what it said above")?;
                bytes
            }
        };
        let sound =
            AudioChunk::new(Stamp::now(), chunk, channels, rate, SampleFormat::F32Le, bytes)?;
        Ok(Some(sound))
    }
}

/// The samples of a file as little-endian floats.
fn floats(reader: hound::WavReader<BufReader<File>>) -> anyhow::Result<Vec<u8>> {
    let hound::WavSpec { bits_per_sample, sample_format, .. } = reader.spec();
    match (sample_format, bits_per_sample) {
        (hound::SampleFormat::Float, 32) => {
            let samples: Result<Vec<f32>, _> = reader.into_samples().collect();
            Ok(samples?.into_iter().flat_map(f32::to_le_bytes).collect())
        }
        (hound::SampleFormat::Int, 16) => {
            let samples: Result<Vec<i16>, _> = reader.into_samples().collect();
            let floats = samples?.into_iter().map(|sample| f32::from(sample) / 32768.0);
            Ok(floats.flat_map(f32::to_le_bytes).collect())
        }
        (format, bits) => {
            bail!("{bits}-bit {format:?} samples: use 16-bit integer or 32-bit float")
        }
    }
}

/// Destination of sound: a WAV file of 32-bit floats, or an ALSA device.
///
/// The file or device opens with the first chunk, which says rate and channels.
pub struct Loudspeaker {
    name: String,
    sink: Option<Sink>,
}

enum Sink {
    Wav(hound::WavWriter<BufWriter<File>>),
    Player(Ended),
}

impl Loudspeaker {
    /// A file, or a device such as `alsa:default`.
    #[must_use]
    pub fn new(name: &str) -> Self {
        Self { name: name.to_owned(), sink: None }
    }

    /// Lets a chunk be heard. A file is complete after each.
    ///
    /// # Errors
    /// When the file cannot be written, or the player ended.
    pub fn play(&mut self, chunk: &AudioChunk) -> anyhow::Result<()> {
        let chunk = chunk.to_format(SampleFormat::F32Le);
        let sink = match &mut self.sink {
            Some(sink) => sink,
            closed => closed.insert(open_sink(&self.name, &chunk)?),
        };
        match sink {
            Sink::Wav(writer) => {
                let (samples, _) = chunk.data.as_chunks::<4>();
                for &sample in samples {
                    writer.write_sample(f32::from_le_bytes(sample))?;
                }
                writer.flush().with_context(|| format!("cannot write {}", self.name))
            }
            Sink::Player(Ended(player)) => {
                let pipe = player.stdin.as_mut().context("aplay has no input")?;
                match pipe.write_all(&chunk.data) {
                    Err(error) if error.kind() == ErrorKind::BrokenPipe => {
                        bail!("aplay ended; see what it said above")
                    }
                    written => Ok(written?),
                }
            }
        }
    }
}

fn open_sink(name: &str, first: &AudioChunk) -> anyhow::Result<Sink> {
    let AudioChunk { channels, sample_rate, frames, .. } = *first;
    if let Some(device) = name.strip_prefix(ALSA) {
        let sound = Sound { rate: sample_rate, channels, chunk: frames };
        return Ok(Sink::Player(Ended(alsa("aplay", device, sound, true)?)));
    }
    let spec = hound::WavSpec {
        channels: channels.into(),
        sample_rate,
        bits_per_sample: 32,
        sample_format: hound::SampleFormat::Float,
    };
    let writer =
        hound::WavWriter::create(name, spec).with_context(|| format!("cannot write {name}"))?;
    Ok(Sink::Wav(writer))
}

/// Starts `arecord` or `aplay` with raw floats through a pipe.
fn alsa(program: &str, device: &str, sound: Sound, is_player: bool) -> anyhow::Result<Child> {
    let mut command = Command::new(program);
    command.args(["-q", "-t", "raw", "-f", "FLOAT_LE", "-D", device]);
    command.args(["-r", &sound.rate.to_string(), "-c", &sound.channels.to_string()]);
    if is_player {
        command.stdin(Stdio::piped());
    } else {
        command.stdin(Stdio::null()).stdout(Stdio::piped());
    }
    command.spawn().with_context(|| {
        format!("cannot start {program}: install alsa-utils, or use a WAV file instead of {ALSA}{device}")
    })
}

/// A program that ends with its owner: a player after it has played everything.
#[derive(Debug)]
struct Ended(Child);

impl Drop for Ended {
    fn drop(&mut self) {
        // Nothing is left to do about a failure here.
        if self.0.stdin.take().is_none() {
            let _killed: std::io::Result<()> = self.0.kill();
        }
        let _status: std::io::Result<_> = self.0.wait();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sound(chunk: u32) -> Sound {
        Sound { rate: 8000, channels: 2, chunk }
    }

    #[test]
    fn what_was_played_into_a_file_is_recorded_from_it() {
        let path = std::env::temp_dir().join(format!("wrapyfi_audio_{}.wav", std::process::id()));
        let name = path.to_str().unwrap();
        let samples: Vec<u8> = (0..6_u8).flat_map(|n| (f32::from(n) / 8.0).to_le_bytes()).collect();
        let played = |bytes: &[u8], frames| {
            AudioChunk::new(Stamp::now(), frames, 2, 8000, SampleFormat::F32Le, bytes.to_vec())
        };
        let mut loudspeaker = Loudspeaker::new(name);
        loudspeaker.play(&played(&samples[..16], 2).unwrap()).unwrap();
        loudspeaker.play(&played(&samples[16..], 1).unwrap()).unwrap();
        // The writer is still there: the file is complete after each chunk.
        let wanted = Sound { rate: 1, channels: 1, chunk: 2 };
        let mut microphone = Microphone::open(name, false, wanted).unwrap();
        assert_eq!(microphone.sound(), sound(2));
        let first = microphone.chunk().unwrap().unwrap();
        assert_eq!((&*first.data, first.frames, first.channels), (&samples[..16], 2, 2));
        let second = microphone.chunk().unwrap().unwrap();
        assert_eq!(*second.data, [&samples[16..], &[0; 8]].concat());
        assert_eq!(microphone.chunk().unwrap(), None);
        let mut again = Microphone::open(name, true, sound(3)).unwrap();
        assert_eq!(again.chunk().unwrap().unwrap().data, again.chunk().unwrap().unwrap().data);
        drop(loudspeaker);
        std::fs::remove_file(path).unwrap();
    }

    #[test]
    fn a_chunk_has_at_least_one_frame() {
        let refused = Microphone::open("x.wav", false, sound(0)).unwrap_err().to_string();
        assert!(refused.contains("--chunk 1"), "{refused}");
    }
}
