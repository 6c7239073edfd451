//! Speed of the machine, and cost of coding, in one thread of this process.

use std::hint::black_box;
use std::io::{Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::time::{Duration, Instant};

use anyhow::Result;
use base64_simd::STANDARD;
use bytes::Bytes;
use wrapyfi_core::Limits;
use wrapyfi_core::codec::{frames, ros};
use wrapyfi_core::types::Payload;

use crate::coding::Native;
use crate::dynamic::JointState;
use crate::payload::{Kind, Maker, compress, decode_frames, decompress};
use crate::ros1::Ros1;
use crate::stats::median;

/// One figure of a round, in microseconds unless its name says otherwise.
pub(crate) type Figure = (String, f64);

/// Time spent on each figure.
const BUDGET: Duration = Duration::from_millis(40);
/// Runs of each at least.
const RUNS: usize = 7;

/// Median time of `work`, in microseconds.
pub(crate) fn time(mut work: impl FnMut()) -> f64 {
    work();
    let begin = Instant::now();
    let mut times = Vec::new();
    while times.len() < RUNS || begin.elapsed() < BUDGET {
        let start = Instant::now();
        work();
        times.push(start.elapsed().as_secs_f64() * 1e6);
    }
    median(&times).unwrap_or_default()
}

/// Payloads that are coded again and again.
pub(crate) struct Bodies {
    vga: Vec<u8>,
    mib: Vec<u8>,
    full_hd: Vec<u8>,
    kinds: Vec<(Kind, Maker)>,
    native: Native,
    joint_state: JointState,
    ros1: Ros1,
}

impl Bodies {
    /// Makes them once.
    pub(crate) fn new() -> Result<Self> {
        let text = |bytes: usize| STANDARD.encode_type::<Vec<u8>>(&vec![0x5A_u8; bytes]);
        let kinds = [
            Kind::Small,
            Kind::Audio,
            Kind::U8Rgb200,
            Kind::VgaJpeg,
            Kind::F32Mib,
            Kind::VgaRgb,
            Kind::FullHdRgb,
        ];
        let makers = kinds.into_iter().map(|kind| Ok((kind, Maker::new(kind)?)));
        Ok(Self {
            // With the 128 bytes of the array's header, as Wrapyfi sends them.
            vga: text(640 * 480 * 3 + 128),
            mib: text((1 << 20) + 128),
            full_hd: text(1920 * 1080 * 3 + 128),
            kinds: makers.collect::<Result<_>>()?,
            native: Native::new()?,
            joint_state: JointState::new()?,
            ros1: Ros1::new()?,
        })
    }

    /// Messages of ROS 1 to CDR and back.
    pub(crate) fn ros1(&self) -> Vec<Figure> {
        self.ros1.round()
    }

    /// memcpy and base64 alone, which bridged ways are compared with.
    pub(crate) fn base64(&self) -> Result<Vec<Figure>> {
        let mut figures = Vec::new();
        for (name, size) in [("1 MiB", 1 << 20), ("640x480 RGB", 921_600), ("1080p RGB", 6_220_800)]
        {
            let from = vec![7_u8; size];
            let mut to = vec![0_u8; size];
            let took = time(|| black_box(&mut to).copy_from_slice(black_box(&from)));
            figures.push((format!("memcpy {name}"), took));
        }
        for (name, text) in
            [("640x480 RGB", &self.vga), ("1 MiB", &self.mib), ("1080p RGB", &self.full_hd)]
        {
            figures.push((
                format!("base64-simd decode {name}"),
                time(|| drop(black_box(STANDARD.decode_to_vec(black_box(text))))),
            ));
            let bytes = STANDARD.decode_to_vec(text)?;
            figures.push((
                format!("base64-simd encode {name}"),
                time(|| drop(black_box(STANDARD.encode_type::<Vec<u8>>(black_box(&bytes))))),
            ));
        }
        Ok(figures)
    }

    /// Our codecs, and TCP.
    pub(crate) fn coding(&self) -> Result<Vec<Figure>> {
        let mut figures = self.native.round();
        for (kind, maker) in &self.kinds {
            Self::codecs(*kind, maker, &mut figures)?;
        }
        figures.push(self.joint_state.round());
        figures.extend(self.ros1());
        figures.extend(tcp()?);
        Ok(figures)
    }

    /// Our codecs on one payload.
    fn codecs(kind: Kind, maker: &Maker, figures: &mut Vec<Figure>) -> Result<()> {
        let name = kind.name();
        let spec = maker.spec("/t");
        let payload = maker.payload(1);
        let encoded: Vec<Bytes> =
            frames::encode(&payload, &spec)?.into_iter().map(Bytes::from).collect();
        let cdr = cdr(&payload, kind)?;
        let limits = Limits::default();
        figures.push((
            format!("encode ZeroMQ {name}"),
            time(|| drop(black_box(frames::encode(black_box(&payload), &spec)))),
        ));
        figures.push((
            format!("decode ZeroMQ {name}"),
            time(|| drop(black_box(decode_frames(black_box(&encoded), &spec)))),
        ));
        figures.push((
            format!("encode CDR {name}"),
            time(|| drop(black_box(ros::encode(black_box(&payload), kind.message_type())))),
        ));
        figures.push((
            format!("decode CDR {name}"),
            time(|| drop(black_box(ros::decode(black_box(&cdr), kind.message_type(), &limits)))),
        ));
        if kind == Kind::VgaJpeg {
            let pixels = maker.uncoded(1)?;
            figures.push((
                format!("encode pixels {name}"),
                time(|| {
                    let file = compress(black_box(pixels.clone()));
                    drop(black_box(file.map(|file| frames::encode(&file, &spec))));
                }),
            ));
            figures.push((
                format!("decode pixels {name}"),
                time(|| {
                    let file = decode_frames(black_box(&encoded), &spec);
                    drop(black_box(file.map(decompress)));
                }),
            ));
        }
        Ok(())
    }
}

fn cdr(payload: &Payload, kind: Kind) -> Result<Bytes> {
    let parts = ros::encode(payload, kind.message_type())?;
    Ok(parts.pieces().iter().flat_map(|piece| piece.as_ref().to_vec()).collect::<Vec<u8>>().into())
}

/// Loopback TCP: one way and there and back, between two threads.
fn tcp() -> Result<Vec<Figure>> {
    let mut figures = Vec::new();
    for (name, size) in [("1 B", 1), ("640x480 RGB", 921_600), ("1080p RGB", 6_220_800)] {
        let (mut near, mut far) = pair()?;
        let echo = std::thread::spawn(move || -> std::io::Result<()> {
            let mut buffer = vec![0; size];
            while far.read_exact(&mut buffer).is_ok() {
                far.write_all(&buffer)?;
            }
            Ok(())
        });
        let mut buffer = vec![1; size];
        let took = time(|| {
            // A failure shows as a time of nothing.
            let _there_and_back =
                near.write_all(&buffer).and_then(|()| near.read_exact(&mut buffer));
        });
        figures.push((format!("TCP half round trip {name}"), took / 2.0));
        drop(near);
        drop(echo.join());
    }
    let (mut near, mut far) = pair()?;
    let total = 192 << 20;
    let sink = std::thread::spawn(move || {
        let mut buffer = vec![0; 1 << 20];
        while far.read(&mut buffer).is_ok_and(|read| read > 0) {}
    });
    let piece = vec![1; 1 << 20];
    let start = Instant::now();
    for _ in 0..total / piece.len() {
        near.write_all(&piece)?;
    }
    drop(near);
    drop(sink.join());
    #[allow(clippy::cast_precision_loss)]
    let rate = total as f64 / start.elapsed().as_secs_f64() / 1e6;
    figures.push(("TCP throughput in MB/s, 1 MiB writes".to_owned(), rate));
    Ok(figures)
}

fn pair() -> Result<(TcpStream, TcpStream)> {
    let listener = TcpListener::bind(("127.0.0.1", 0))?;
    let near = TcpStream::connect(listener.local_addr()?)?;
    let (far, _) = listener.accept()?;
    near.set_nodelay(true)?;
    far.set_nodelay(true)?;
    Ok((near, far))
}
