//! A port that prints what comes, over any carrier.
//!
//! `cargo run -p wrapyfi_yarp --example yarp_read -- 127.0.0.1:10101`, then `yarp_write` with the
//! same address; or a terminal: `CONNECT me`, `d`, `1 2 hello`.
#![allow(clippy::print_stdout)]

use wrapyfi_yarp::port::{InputOptions, Network, PortOptions};

#[tokio::main(flavor = "current_thread")]
async fn main() -> Result<(), Box<dyn std::error::Error>> {
    let address = std::env::args().nth(1).ok_or("usage: yarp_read ADDRESS:PORT")?.parse()?;
    let network = Network::builder().build();
    let port = PortOptions { address: Some(address), ..PortOptions::default() };
    let options = InputOptions { port, ..InputOptions::default() };
    let reader = network.open_input("/example/reader", &options).await?;
    println!("{} listens at {}", reader.name(), reader.address());
    while let Some(message) = reader.recv().await {
        println!("{} {:?}: {}", message.from, message.stamp(), message.bottle()?.to_text());
    }
    Ok(())
}
