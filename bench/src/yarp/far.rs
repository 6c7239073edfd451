//! The end that answers, or takes images.

use std::io::{Read as _, Write as _};
use std::net::Ipv4Addr;

use anyhow::{Context as _, Result, ensure};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{mpsc, oneshot};
use wrapyfi_yarp::port::{Answer, Network, OutputOptions, PortOptions, Received};
use wrapyfi_yarp::sig::Image;

use super::{
    BATCH, Load, Place, Ready, SIZE, Way, bottle_bytes, image_bytes, network, reading, runtime,
    task,
};
use crate::worker::say;

/// Runs it until its stdin ends.
pub(crate) fn far(place: Place) -> Result<()> {
    std::thread::spawn(|| {
        let _end = std::io::stdin().read(&mut [0; 1]);
        std::process::exit(0);
    });
    serve(place, |peer| say(&serde_json::to_value(Ready { peer })?))?;
    // Near has gone; the port is closed by the end of the orders.
    loop {
        std::thread::park();
    }
}

/// Serves one near, until that is gone. `ready` is told where bare sockets connect.
pub(super) fn serve(
    place: Place,
    ready: impl FnOnce(u16) -> Result<()> + Send + 'static,
) -> Result<()> {
    if place.ride.way == Way::Blocking {
        return blocking(ready);
    }
    let runtime = runtime(2)?;
    task(&runtime, async move {
        let network = network(place.names);
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).await?;
        let peer = listener.local_addr()?.port();
        match (place.ride.load, place.ride.way) {
            (Load::VgaRgb, Way::Tokio) => {
                ready(peer)?;
                let (told, stream) = (accept(&listener).await?, accept(&listener).await?);
                bare_images(stream, told).await
            }
            (Load::VgaRgb, _) => images(&network, listener, || ready(peer)).await,
            (Load::Bottle1k, Way::Tokio) => {
                ready(peer)?;
                echo(accept(&listener).await?).await
            }
            (Load::Bottle1k, Way::Data) => data(&network, || ready(peer)).await,
            (Load::Bottle1k, Way::Queue) => queue(&network, || ready(peer)).await,
            (Load::Bottle1k, _) => {
                let options = PortOptions::default();
                let answer = network.serve("/far/in", &options, async |request, _| {
                    request.bottle().map_or(Answer::Nothing, Answer::Bottle)
                });
                let _server = answer.await?;
                ready(peer)?;
                std::future::pending().await
            }
        }
    })
}

async fn accept(listener: &TcpListener) -> Result<TcpStream> {
    let (stream, _) = listener.accept().await?;
    stream.set_nodelay(true)?;
    Ok(stream)
}

fn blocking(ready: impl FnOnce(u16) -> Result<()>) -> Result<()> {
    let listener = std::net::TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?;
    ready(listener.local_addr()?.port())?;
    let (mut stream, _) = listener.accept()?;
    stream.set_nodelay(true)?;
    let mut bytes = bottle_bytes()?;
    while stream.read_exact(&mut bytes).is_ok() {
        stream.write_all(&bytes)?;
    }
    Ok(())
}

async fn echo(mut stream: TcpStream) -> Result<()> {
    let mut bytes = bottle_bytes()?;
    while stream.read_exact(&mut bytes).await.is_ok() {
        stream.write_all(&bytes).await?;
    }
    Ok(())
}

async fn queue(network: &Network, ready: impl FnOnce() -> Result<()>) -> Result<()> {
    let (sender, mut requests) = mpsc::channel::<(Received, oneshot::Sender<Answer>)>(64);
    let handler = move |received, _| {
        let sender = sender.clone();
        async move {
            let (reply, answered) = oneshot::channel();
            sender.send((received, reply)).await.ok();
            answered.await.unwrap_or(Answer::Nothing)
        }
    };
    let _server = network.serve("/far/in", &PortOptions::default(), handler).await?;
    ready()?;
    while let Some((request, reply)) = requests.recv().await {
        reply.send(Answer::Bottle(request.bottle()?)).ok();
    }
    Ok(())
}

async fn data(network: &Network, ready: impl FnOnce() -> Result<()>) -> Result<()> {
    let input = network.open_input("/far/in", &reading()).await?;
    let out = network.open_output("/far/out", &OutputOptions::default()).await?;
    ready()?;
    while let Some(message) = input.recv().await {
        out.write_bottle(&message.bottle()?)?;
    }
    Ok(())
}

/// Reads images into one buffer.
async fn bare_images(mut stream: TcpStream, mut told: TcpStream) -> Result<()> {
    let mut image = image_bytes()?.to_vec();
    loop {
        for _ in 0..BATCH {
            if stream.read_exact(&mut image).await.is_err() {
                return Ok(());
            }
        }
        told.write_u8(1).await?;
    }
}

/// Takes images as a program does, which share the memory of what was received.
async fn images(
    network: &Network,
    listener: TcpListener,
    ready: impl FnOnce() -> Result<()>,
) -> Result<()> {
    let input = network.open_input("/far/in", &reading()).await?;
    ready()?;
    let mut told = accept(&listener).await?;
    loop {
        for _ in 0..BATCH {
            let message = input.recv().await.context("the port was closed")?;
            let image = Image::decode(&message.payload.bytes, network.limits())?;
            ensure!((image.width(), image.height()) == SIZE, "an image of another size");
        }
        told.write_u8(1).await?;
    }
}
