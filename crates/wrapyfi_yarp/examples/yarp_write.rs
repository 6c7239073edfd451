//! A port that sends a bottle every second to a reader at a fixed address.
//!
//! `cargo run -p wrapyfi_yarp --example yarp_write -- 127.0.0.1:10101 [CARRIER]`, once `yarp_read`
//! listens there. With a name server, a name takes the place of the address.
#![allow(clippy::print_stdout)]

use std::sync::Arc;
use std::time::Duration;

use wrapyfi_yarp::Bottle;
use wrapyfi_yarp::port::names::NameRequest;
use wrapyfi_yarp::port::{Message, Network, NetworkOptions, PortOptions, PortPayload};
use wrapyfi_yarp::server::{NameServer, NameServerOptions};
use wrapyfi_yarp::sig::Stamp;

#[tokio::main(flavor = "current_thread")]
async fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let address: std::net::SocketAddr =
        arguments.next().ok_or("usage: yarp_write ADDRESS:PORT [CARRIER]")?.parse()?;
    let carrier = arguments.next().unwrap_or_else(|| "tcp".to_owned());
    let name_server =
        NameServer::start(NameServerOptions { port: 0, ..Default::default() }).await?;
    let names = Arc::new(name_server.client());
    let reader = NameRequest {
        name: "/example/reader".to_owned(),
        host: Some(address.ip().to_string()),
        port: Some(address.port()),
        ..NameRequest::default()
    };
    names.register(&reader).await?;
    let network = Network::new(NetworkOptions { names, ..NetworkOptions::default() });
    let writer = network.open_output("/example/writer", &PortOptions::default()).await?;
    writer.connect(&format!("{carrier}://example/reader")).await?;
    let mut connected = writer.connected();
    for count in 0.. {
        if connected.borrow_and_update().outputs == 0 {
            break; // the reader is gone
        }
        let bottle = Bottle::from(vec!["count".into(), count.into()]);
        let payload = PortPayload::bottle(&bottle, network.dialect())?;
        let time_s = f64::from(count);
        writer.write(Message::new(payload).stamped(Stamp { count, time_s }));
        println!("{}", bottle.to_text());
        tokio::time::sleep(Duration::from_secs(1)).await;
    }
    writer.close().await;
    Ok(())
}
