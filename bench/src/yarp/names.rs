//! Registrations at our name server, one after the other, each on a connection of its own as YARP
//! has it.

use std::time::Instant;

use anyhow::Result;
use wrapyfi_yarp::port::names::NameRequest;

use super::{Server, client, runtime};
use crate::micro::Figure;

/// Registrations of one round.
const NAMES: u32 = 300;
/// Name of the figure.
const PER_SECOND: &str = "YARP name server: registrations a second of one client";

/// Registers so many new names: how many a second.
pub(crate) fn registrations() -> Result<Figure> {
    let server = Server::start()?;
    let runtime = runtime(1)?;
    let rate = runtime.block_on(async {
        let client = client(server.port);
        let name =
            |number| NameRequest { name: format!("/bench/{number}"), ..NameRequest::default() };
        client.register(&name(0)).await?;
        let begin = Instant::now();
        for number in 1..=NAMES {
            client.register(&name(number)).await?;
        }
        anyhow::Ok(f64::from(NAMES) / begin.elapsed().as_secs_f64())
    })?;
    Ok((PER_SECOND.to_owned(), rate))
}
