//! The end that asks, or sends images.

use std::io::{BufRead as _, Read as _, Write as _};
use std::net::Ipv4Addr;

use anyhow::{Context as _, Result, bail, ensure};
use bytes::Bytes;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio::runtime::Runtime;
use tokio::time::timeout;
use wrapyfi_yarp::Bottle;
use wrapyfi_yarp::port::{
    InputPort, Message, OutputOptions, OutputPort, PortOptions, PortPayload, RpcClient,
};

use super::{
    BATCH, Load, Place, TIMEOUT, Way, bottle, bottle_bytes, image_bytes, network, reading, runtime,
    task,
};
use crate::clock;
use crate::worker::{Order, Report, micros, say};

/// End that does one exchange: a round trip, or a batch of images.
enum End {
    Blocking(std::net::TcpStream, Vec<u8>),
    Tokio(TcpStream, Vec<u8>),
    Client(RpcClient, Bottle),
    Data { out: OutputPort, back: InputPort, bottle: Bottle },
    BareImages { stream: TcpStream, told: TcpStream, image: Bytes },
    Images { out: OutputPort, told: TcpStream, image: Message },
}

impl End {
    async fn open(place: Place) -> Result<Self> {
        let (network, way) = (network(place.names), place.ride.way);
        let carrier = way.carrier();
        let peer = (Ipv4Addr::LOCALHOST, place.peer);
        let connect = async || {
            let stream = TcpStream::connect(peer).await?;
            stream.set_nodelay(true)?;
            anyhow::Ok(stream)
        };
        Ok(match (place.ride.load, way) {
            (Load::Bottle1k, Way::Blocking) => {
                let stream = std::net::TcpStream::connect(peer)?;
                stream.set_nodelay(true)?;
                stream.set_read_timeout(Some(TIMEOUT))?;
                Self::Blocking(stream, bottle_bytes()?)
            }
            (Load::Bottle1k, Way::Tokio) => Self::Tokio(connect().await?, bottle_bytes()?),
            (Load::Bottle1k, Way::Data) => {
                let out = network.open_output("/near/out", &OutputOptions::default()).await?;
                let back = network.open_input("/near/in", &reading()).await?;
                out.connect(&format!("{carrier}://far/in")).await?;
                network.connect("/far/out", "/near/in", Some(carrier)).await?;
                back.wait_for_inputs(1).await;
                Self::Data { out, back, bottle: bottle() }
            }
            (Load::Bottle1k, _) => {
                let client = network.open_rpc_client("/near", &PortOptions::default()).await?;
                client.connect(&format!("{carrier}://far/in")).await?;
                Self::Client(client, bottle())
            }
            (Load::VgaRgb, Way::Tokio) => {
                let (told, stream) = (connect().await?, connect().await?);
                Self::BareImages { stream, told, image: image_bytes()? }
            }
            (Load::VgaRgb, _) => {
                let told = connect().await?;
                let out = network.open_output("/near/out", &OutputOptions::default()).await?;
                out.connect(&format!("{carrier}://far/in")).await?;
                let image = Message::new(PortPayload::object(image_bytes()?));
                Self::Images { out, told, image }
            }
        })
    }

    /// Does it once; how many messages that were.
    async fn once(&mut self) -> Result<u32> {
        match self {
            Self::Blocking(stream, bytes) => {
                stream.write_all(bytes)?;
                stream.read_exact(bytes)?;
            }
            Self::Tokio(stream, bytes) => {
                stream.write_all(bytes).await?;
                stream.read_exact(bytes).await?;
            }
            Self::Client(client, bottle) => {
                let reply = client.call(bottle, TIMEOUT).await?;
                ensure!(reply.as_ref() == Some(bottle), "the reply is another bottle");
            }
            Self::Data { out, back, bottle } => {
                out.write_bottle(bottle)?;
                let reply = back.recv().await.context("the port was closed")?.bottle()?;
                ensure!(reply == *bottle, "another bottle came back");
            }
            Self::BareImages { stream, told, image } => {
                for _ in 0..BATCH {
                    stream.write_all(image).await?;
                }
                told.read_u8().await?;
                return Ok(BATCH);
            }
            Self::Images { out, told, image } => {
                for _ in 0..BATCH {
                    let written = out.send(image.clone()).await;
                    ensure!(written.targets == 1, "nobody is connected");
                }
                told.read_u8().await?;
                return Ok(BATCH);
            }
        }
        Ok(1)
    }

    /// Does it so often, one after the other. Times are those of one message.
    async fn exchange(&mut self, count: u32) -> Result<Report> {
        let mut report = Report::default();
        let begin = clock::now();
        for _ in 0..count {
            let start = clock::now();
            let messages = self.once().await?;
            let took = clock::now() - start;
            report.sent += messages;
            report.received += messages;
            report.latency_us.push(micros(took) / f64::from(messages));
        }
        report.span_ns = clock::now() - begin;
        Ok(report)
    }
}

/// The end, and the runtime that it lives on.
pub(super) struct Near {
    runtime: Runtime,
    end: Option<End>,
}

impl Near {
    pub(super) fn open(place: Place) -> Result<Self> {
        let runtime = runtime(2)?;
        let opened = task(&runtime, async move { Ok(timeout(TIMEOUT, End::open(place)).await?) })?;
        Ok(Self { runtime, end: Some(opened?) })
    }

    pub(super) fn exchange(&mut self, count: u32) -> Result<Report> {
        let Some(mut end) = self.end.take() else { bail!("an exchange failed before") };
        // Whatever hangs ends by this, also where the orders have ended.
        let all = TIMEOUT * 3;
        let (end, report) = task(&self.runtime, async move {
            let report = timeout(all, end.exchange(count)).await?;
            Ok((end, report))
        })?;
        self.end = Some(end);
        report
    }
}

/// Runs it: obeys orders as a source does, until they end.
pub(crate) fn near(place: Place) -> Result<()> {
    let start = clock::now();
    let mut near = Near::open(place)?;
    for line in std::io::stdin().lock().lines() {
        let report = match serde_json::from_str(&line?)? {
            Order::Warm => {
                let warm = near.exchange(place.ride.load.warm())?;
                Report { opening_ns: clock::now() - start, ..warm }
            }
            Order::Window { count, .. } | Order::Paced { count, .. } => near.exchange(count)?,
        };
        say(&serde_json::to_value(report)?)?;
    }
    Ok(())
}
