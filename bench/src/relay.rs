//! The least that a bridge can be: one thread, one picture at a time, nothing checked.
//!
//! ```text
//!   SUB ─▶ base64 ─▶ [head][pixels] ─▶ CDR writer        CDR reader ─▶ base64 ─▶ PUB
//! ```
//!
//! It has no queue, no counters, no second route and no JSON parser: it knows where in the text of
//! this one picture the array stands. What our bridge takes more than this is the price of being a
//! bridge; what it shares with this belongs to the transports.

use std::time::Duration;

use anyhow::{Context as _, Result};
use base64_simd::STANDARD;
use memchr::{memmem, memrchr};

use crate::payload::{Kind, Maker, Numbered, number_in_cdr, number_in_frames};
use crate::wire::{self, Place};

/// Bytes of the header of an array file; not a multiple of three, so base64 runs across its end.
const ARRAY_HEADER: usize = 128;
/// Characters of base64 that hold only header: 126 bytes.
const WHOLE: usize = 168;

/// Layout of the picture in its two forms.
struct Form {
    kind: Kind,
    frames: Numbered,
    cdr: Numbered,
    /// Bytes of CDR before the pixels or the file.
    head: usize,
}

impl Form {
    fn new(kind: Kind) -> Result<Self> {
        let maker = Maker::new(kind)?;
        let (frames, cdr) = (maker.frames("/out")?, maker.cdr()?);
        let content = match kind {
            Kind::VgaRgb => 640 * 480 * 3,
            Kind::FullHdRgb => 1920 * 1080 * 3,
            _ => frames.len(),
        };
        Ok(Self { kind, head: cdr.len() - content, frames, cdr })
    }

    fn is_file(&self) -> bool {
        self.kind == Kind::VgaJpeg
    }

    /// The base64 in the text of an array: from, to.
    fn base64(text: &[u8]) -> Result<(usize, usize)> {
        let from = memmem::find(text.get(..200).unwrap_or(text), b"\", \"").context("no array")?;
        Ok((from + 4, memrchr(b'"', text).context("the text does not end")?))
    }
}

/// Runs until its process is ended.
pub(crate) fn run(to_ros: bool, place: &Place) -> Result<()> {
    let form = Form::new(place.payload)?;
    if to_ros { run_to_ros(form, place) } else { run_to_zmq(&form, place) }
}

fn run_to_ros(mut form: Form, place: &Place) -> Result<()> {
    let socket = wire::zmq::subscribe("/in", place.pub_port)?;
    let mut writer = wire::dds::writer("/out", place)?;
    loop {
        let frames = wire::zmq::receive(&socket)?;
        let frames: Vec<&[u8]> = frames.iter().map(|frame| &**frame).collect();
        form.cdr.number_cdr(number_in_frames(form.kind, &frames)?);
        let head = form.cdr.body.get(..form.head).unwrap_or_default();
        let body = frames.last().copied().unwrap_or_default();
        if form.is_file() {
            writer.write(&[head, body])?;
            continue;
        }
        let (from, to) = Form::base64(body)?;
        let file = STANDARD.decode_to_vec(body.get(from..to).unwrap_or_default())?;
        writer.write(&[head, file.get(ARRAY_HEADER..).unwrap_or_default()])?;
    }
}

fn run_to_zmq(form: &Form, place: &Place) -> Result<()> {
    let socket = wire::zmq::connect_publisher(place.sub_port)?;
    let (mut reader, wake) = wire::dds::reader("/in", place)?;
    let text = &form.frames.body;
    let (from, to) = if form.is_file() { (0, 0) } else { Form::base64(text)? };
    let start = text.get(..from + WHOLE).unwrap_or_default();
    let end = text.get(to..).unwrap_or_default();
    // The header's last two bytes go with the first of the pixels.
    let header = STANDARD.decode_to_vec(text.get(from..from + WHOLE + 4).unwrap_or_default());
    let header = header.unwrap_or_default();
    let rest = header.get(ARRAY_HEADER - 2..ARRAY_HEADER).unwrap_or_default();
    loop {
        let Some(sample) = reader.take()? else {
            wake.wait(Duration::from_secs(1));
            continue;
        };
        let seq = number_in_cdr(form.kind, &sample.cdr)?;
        let pixels = sample.cdr.get(form.head..).unwrap_or_default();
        let body = if form.is_file() {
            pixels.to_vec()
        } else {
            let mut body = Vec::with_capacity(text.len());
            body.extend_from_slice(start);
            let (first, others) = pixels.split_at_checked(1).unwrap_or_default();
            STANDARD.encode_append([rest, first].concat(), &mut body);
            STANDARD.encode_append(others, &mut body);
            body.extend_from_slice(end);
            body
        };
        socket.send("/out", zmq::SNDMORE)?;
        socket.send(Numbered::header(seq), zmq::SNDMORE)?;
        socket.send(body, 0)?;
    }
}
