//! A port that answers requests, and one that asks, in one process.
//!
//! `cargo run -p wrapyfi_yarp --example yarp_rpc`; with an address behind it, only the server runs
//! there, and `yarp rpc` or a terminal (`CONNECT me`, `d`, `add 1 2`) may ask it.
#![allow(clippy::print_stdout)]

use std::sync::Arc;
use std::time::Duration;

use wrapyfi_yarp::port::{Answer, Network, NetworkOptions, PortOptions};
use wrapyfi_yarp::server::{NameServer, NameServerOptions};
use wrapyfi_yarp::{Bottle, Value};

/// `add 1 2` is 3.
fn answer(request: &Bottle) -> Bottle {
    let numbers = request.values.iter().skip(1).filter_map(Value::as_i64);
    match request.get(0) {
        Some(word) if word.is_word("add") => {
            Bottle::from(vec![numbers.fold(0_i64, i64::saturating_add).into()])
        }
        _ => Bottle::from(vec![Value::vocab("fail"), "try add 1 2".into()]),
    }
}

#[tokio::main(flavor = "current_thread")]
async fn main() -> Result<(), Box<dyn std::error::Error>> {
    let address = std::env::args().nth(1).map(|address| address.parse()).transpose()?;
    let name_server =
        NameServer::start(NameServerOptions { port: 0, ..Default::default() }).await?;
    let names = Arc::new(name_server.client());
    let network = Network::new(NetworkOptions { names, ..NetworkOptions::default() });
    let options = PortOptions { address, ..PortOptions::default() };
    let server = network
        .serve("/example/server", &options, async |request, _wanted| {
            Answer::Bottle(answer(&request.bottle().unwrap_or_default()))
        })
        .await?;
    println!("{} listens at {}", server.name(), server.address());
    if address.is_some() {
        std::future::pending::<()>().await;
    }
    let client = network.open_rpc_client("/example/client", &PortOptions::default()).await?;
    client.connect("fast_tcp://example/server").await?;
    let request = Bottle::from(vec!["add".into(), 1.into(), 2.into()]);
    let reply = client.call(&request, Duration::from_secs(1)).await?;
    println!("{} = {:?}", request.to_text(), reply.map(|reply| reply.to_text()));
    client.close().await;
    server.close().await;
    Ok(())
}
