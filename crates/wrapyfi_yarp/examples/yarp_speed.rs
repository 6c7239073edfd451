//! Measures the time of a request and the number of images a second, beside bare sockets of tokio.
//!
//! `cargo run --release -p wrapyfi_yarp --example yarp_speed [ROUNDS]`
#![allow(clippy::print_stdout)]

use std::sync::Arc;
use std::time::{Duration, Instant};

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::mpsc;
use wrapyfi_yarp::port::{
    Answer, Message, Network, NetworkOptions, PortOptions, PortPayload, Received,
};
use wrapyfi_yarp::server::{NameServer, NameServerOptions};
use wrapyfi_yarp::{Bottle, Dialect};

type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

/// Bytes of an image of 640 by 480 in RGB, with its head.
const IMAGE: usize = 60 + 640 * 480 * 3;

fn median(mut times: Vec<Duration>) -> Duration {
    times.sort_unstable();
    times.get(times.len() / 2).copied().unwrap_or_default()
}

/// The same bytes there and back over a socket.
async fn bare_round_trip(rounds: usize, size: usize) -> Outcome<Duration> {
    let listener = TcpListener::bind("127.0.0.1:0").await?;
    let address = listener.local_addr()?;
    let echo = tokio::spawn(async move {
        let (mut stream, _) = listener.accept().await?;
        stream.set_nodelay(true)?;
        let mut bytes = vec![0; size];
        while stream.read_exact(&mut bytes).await.is_ok() {
            stream.write_all(&bytes).await?;
        }
        std::io::Result::Ok(())
    });
    let mut stream = TcpStream::connect(address).await?;
    stream.set_nodelay(true)?;
    let (mut bytes, mut times) = (vec![7; size], Vec::with_capacity(rounds));
    for _ in 0..rounds {
        let start = Instant::now();
        stream.write_all(&bytes).await?;
        stream.read_exact(&mut bytes).await?;
        times.push(start.elapsed());
    }
    drop(stream);
    echo.await??;
    Ok(median(times))
}

async fn round_trip(rounds: usize, carrier: &str) -> Outcome<(Duration, usize)> {
    let name_server =
        NameServer::start(NameServerOptions { port: 0, ..Default::default() }).await?;
    let names = Arc::new(name_server.client());
    let network = Network::new(NetworkOptions { names, ..NetworkOptions::default() });
    let options = PortOptions::default();
    let server = network
        .serve("/server", &options, async |request, _| Answer::Object(request.payload.bytes))
        .await?;
    let client = network.open_rpc_client("/client", &options).await?;
    client.connect(&format!("{carrier}://server")).await?;
    let request = Bottle::from(vec!["x".repeat(1024).into()]).encode(Dialect::V3)?;
    let (request, mut times) = (bytes::Bytes::from(request), Vec::with_capacity(rounds));
    for _ in 0..rounds {
        let start = Instant::now();
        client.call_bytes(&request, Duration::from_secs(10)).await?;
        times.push(start.elapsed());
    }
    client.close().await;
    server.close().await;
    Ok((median(times), request.len()))
}

/// Images a second, read into a buffer that is used again.
async fn bare_images(rounds: usize) -> Outcome<f64> {
    let listener = TcpListener::bind("127.0.0.1:0").await?;
    let address = listener.local_addr()?;
    let writer = tokio::spawn(async move {
        let mut stream = TcpStream::connect(address).await?;
        let image = vec![7; IMAGE];
        for _ in 0..rounds {
            stream.write_all(&image).await?;
        }
        std::io::Result::Ok(())
    });
    let (mut stream, _) = listener.accept().await?;
    let (mut image, start) = (vec![0; IMAGE], Instant::now());
    for _ in 0..rounds {
        stream.read_exact(&mut image).await?;
    }
    let seconds = start.elapsed().as_secs_f64();
    writer.await??;
    Ok(f64::from(u32::try_from(rounds)?) / seconds)
}

async fn images(rounds: usize, carrier: &str) -> Outcome<f64> {
    let name_server =
        NameServer::start(NameServerOptions { port: 0, ..Default::default() }).await?;
    let names = Arc::new(name_server.client());
    let network = Network::new(NetworkOptions { names, ..NetworkOptions::default() });
    let (sender, mut messages) = mpsc::channel(4);
    let handler = move |message: Received, _wants_reply| {
        let sender = sender.clone();
        async move {
            sender.send(message).await.ok();
            Answer::Nothing
        }
    };
    let _reader = network.serve("/view", &PortOptions::default(), handler).await?;
    let options = PortOptions { queue: rounds, ..PortOptions::default() };
    let writer = network.open_output("/cam", &options).await?;
    writer.connect(&format!("{carrier}://view")).await?;
    let writing = tokio::spawn(async move {
        let message = Message::new(PortPayload::object(vec![7; IMAGE]));
        for _ in 0..rounds {
            writer.write(message.clone());
        }
        writer.flush().await;
        writer.close().await;
    });
    let start = Instant::now();
    for _ in 0..rounds {
        let message = messages.recv().await.ok_or("closed")?;
        if message.payload.bytes.len() != IMAGE {
            return Err("an image is incomplete".into());
        }
    }
    let seconds = start.elapsed().as_secs_f64();
    writing.await?;
    Ok(f64::from(u32::try_from(rounds)?) / seconds)
}

#[tokio::main(flavor = "multi_thread", worker_threads = 2)]
async fn main() -> Outcome<()> {
    let rounds: usize = std::env::args().nth(1).map_or(Ok(10_000), |rounds| rounds.parse())?;
    for carrier in ["fast_tcp", "tcp"] {
        let (ours, size) = tokio::spawn(async move {
            round_trip(rounds, carrier).await.map_err(|error| error.to_string())
        })
        .await??;
        let bare = tokio::spawn(async move {
            bare_round_trip(rounds, size).await.map_err(|error| error.to_string())
        })
        .await??;
        let times = ours.as_secs_f64() / bare.as_secs_f64();
        println!("{carrier}: request of {size} bytes {ours:?}, bare {bare:?}: {times:.2} times");
    }
    for carrier in ["fast_tcp", "tcp"] {
        let rounds = rounds.div_ceil(10);
        let (ours, bare) = (images(rounds, carrier).await?, bare_images(rounds).await?);
        println!("{carrier}: {ours:.0} images a second, bare {bare:.0}: {:.2} times", ours / bare);
    }
    Ok(())
}
