//! A port that prints what comes, over any carrier.
//!
//! `cargo run -p wrapyfi_yarp --example yarp_read -- 127.0.0.1:10101`, then `yarp_write` with the
//! same address; or a terminal: `CONNECT me`, `d`, `1 2 hello`.
#![allow(clippy::print_stdout)]

use std::sync::Arc;

use tokio::sync::mpsc;
use wrapyfi_yarp::port::{Answer, Network, NetworkOptions, PortOptions, Received};
use wrapyfi_yarp::server::{NameServer, NameServerOptions};

#[tokio::main(flavor = "current_thread")]
async fn main() -> Result<(), Box<dyn std::error::Error>> {
    let address = std::env::args().nth(1).ok_or("usage: yarp_read ADDRESS:PORT")?.parse()?;
    let name_server =
        NameServer::start(NameServerOptions { port: 0, ..Default::default() }).await?;
    let names = Arc::new(name_server.client());
    let network = Network::new(NetworkOptions { names, ..NetworkOptions::default() });
    let options = PortOptions { address: Some(address), ..PortOptions::default() };
    let (sender, mut messages) = mpsc::channel(16);
    let handler = move |message: Received, _wants_reply| {
        let sender = sender.clone();
        async move {
            sender.send(message).await.ok();
            Answer::Nothing
        }
    };
    let reader = network.serve("/example/reader", &options, handler).await?;
    println!("{} listens at {}", reader.name(), reader.address());
    while let Some(message) = messages.recv().await {
        println!("{} {:?}: {}", message.from, message.stamp(), message.bottle()?.to_text());
    }
    Ok(())
}
