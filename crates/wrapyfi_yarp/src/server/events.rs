//! Readers of changes: those the name server connects to, and those that turned their connection
//! around.
//!
//! ```text
//!   tell([add] "/cam") ──▶ a queue each ──▶ one task each ──▶ message, acknowledgement
//!                          (full: dropped, counted)
//! ```

use std::sync::{Arc, MutexGuard};
use std::time::Duration;

use bytes::{Bytes, BytesMut};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::sync::mpsc;
use tokio::task::JoinSet;

use wrapyfi_retry::Mutex;

use super::shared::Shared;
use crate::name::{NameEvent, Target};
use crate::port::Counters;
use crate::wire::{Carrier, Command, Fault, Sender, Step, admin, header, message};
use crate::{Dialect, Limits};

/// The readers there are.
#[derive(Debug, Default)]
pub(super) struct Readers(Mutex<Inner>);

#[derive(Debug, Default)]
struct Inner {
    readers: Vec<Reader>,
    tasks: JoinSet<()>,
    ended: bool,
}

#[derive(Debug)]
struct Reader {
    name: String,
    carrier: String,
    queue: mpsc::Sender<NameEvent>,
}

impl Readers {
    fn inner(&self) -> MutexGuard<'_, Inner> {
        let mut inner = self.0.lock();
        while inner.tasks.try_join_next().is_some() {}
        inner.readers.retain(|reader| !reader.queue.is_closed());
        inner
    }

    /// Names and carriers of the readers.
    pub(super) fn names(&self) -> Vec<(String, String)> {
        let inner = self.inner();
        inner.readers.iter().map(|reader| (reader.name.clone(), reader.carrier.clone())).collect()
    }

    /// Tells a change to everybody, now or never.
    pub(super) fn tell(&self, event: &NameEvent, counters: &Counters) {
        for reader in &self.inner().readers {
            if reader.queue.try_send(event.clone()).is_err() {
                counters.add("event_dropped");
            }
        }
    }

    /// Says goodbye to a reader; false where there is none of that name.
    pub(super) fn remove(&self, name: &str) -> bool {
        let mut inner = self.inner();
        let before = inner.readers.len();
        // Its task ends when nobody can tell it anything.
        inner.readers.retain(|reader| reader.name != name);
        inner.readers.len() < before
    }

    /// Says goodbye to all.
    pub(super) fn end(&self) {
        let mut inner = self.inner();
        inner.ended = true;
        inner.readers.clear();
        inner.tasks.abort_all();
    }

    /// Says goodbye to all, and waits a moment for it to be heard.
    pub(super) async fn farewell(&self) {
        let mut tasks = {
            let mut inner = self.inner();
            inner.ended = true;
            inner.readers.clear();
            std::mem::take(&mut inner.tasks)
        };
        let all = async { while tasks.join_next().await.is_some() {} };
        if tokio::time::timeout(FAREWELL, all).await.is_err() {
            tracing::debug!(target: "wrapyfi_yarp::server", "readers that do not read are cut off");
        }
    }

    /// Serves a reader on a connection that is open.
    pub(super) fn add(
        &self,
        name: String,
        carrier: (Carrier, String),
        stream: TcpStream,
        shared: &Shared,
    ) -> bool {
        let limits = &shared.options.limits;
        let (queue, waiting) = mpsc::channel(limits.max_waiting_events);
        let (kind, carrier) = carrier;
        let mut inner = self.inner();
        // A second connection to the same port takes the place of the first. Readers that are no ports
        // may share a name, as all our clients do.
        inner.readers.retain(|reader| reader.name != name || !name.starts_with('/'));
        if inner.ended || inner.readers.len() >= limits.max_readers {
            shared.counters.add("too_many_readers");
            return false;
        }
        let dialect = shared.options.dialect;
        inner.tasks.spawn(async move {
            if let Err(error) = run(stream, kind, dialect, waiting).await {
                tracing::debug!(target: "wrapyfi_yarp::server", %error, "reader lost");
            }
        });
        inner.readers.push(Reader { name, carrier, queue });
        true
    }
}

/// Longest time that a goodbye may take.
const FAREWELL: Duration = Duration::from_secs(1);

/// Connects to a port that wants to hear of changes; the sentence that says how it went.
pub(super) async fn connect(destination: &str, shared: &Arc<Shared>) -> Result<String, String> {
    let target = Target::parse(destination);
    let unknown = || admin::unknown_destination(destination);
    if !target.name.starts_with('/') {
        return Err(unknown());
    }
    let found = shared.state.lock().registry.find(&target.name, &target.network);
    let found = found.ok_or_else(unknown)?;
    let mut sender = Sender::new(&*shared.own.name);
    let carrier = match sender.qualify(&target.carrier) {
        "" => Carrier::Tcp,
        name => name.parse().map_err(|_unknown| unknown())?,
    };
    let text = sender.carrier_text(carrier);
    let opened = open(carrier, &sender, &found.host, found.port, &shared.options.wire);
    let stream = match tokio::time::timeout(shared.options.link_timeout, opened).await {
        Ok(Some(stream)) => stream,
        Ok(None) | Err(_) => return Err(admin::unreachable_destination(destination)),
    };
    if !shared.readers.add(target.name, (carrier, text), stream, shared) {
        return Err(admin::NO_OUTPUTS.to_owned());
    }
    Ok(admin::added(&shared.own.name, destination))
}

/// Opens a connection and hears the welcome.
async fn open(
    carrier: Carrier,
    sender: &Sender,
    host: &str,
    port: u16,
    limits: &Limits,
) -> Option<TcpStream> {
    if carrier.is_connectionless() || carrier.is_unix() || !carrier.is_push() {
        return None;
    }
    let head = header::encode(carrier, sender, limits).ok()?;
    let mut stream = TcpStream::connect((host, port)).await.ok()?;
    wrapyfi_retry::liveness::set_reader(&stream);
    stream.set_nodelay(true).ok()?;
    stream.write_all(&head).await.ok()?;
    let mut buffer = BytesMut::new();
    while let Step::Need(_) = header::read_answer(carrier, &mut buffer, limits).ok()? {
        if stream.read_buf(&mut buffer).await.ok()? == 0 {
            return None;
        }
    }
    Some(stream)
}

/// Sends changes until nobody tells any more, or the reader is gone.
async fn run(
    mut stream: TcpStream,
    carrier: Carrier,
    dialect: Dialect,
    mut waiting: mpsc::Receiver<NameEvent>,
) -> std::io::Result<()> {
    let mut buffer = BytesMut::new();
    let mut owed = 0_u64;
    loop {
        tokio::select! {
            // A reader that does not acknowledge gets no more: its queue fills, and then it misses
            // changes.
            event = waiting.recv(), if owed == 0 => {
                let Some(event) = event else {
                    return goodbye(stream, carrier).await;
                };
                stream.write_all(&encode(&event, carrier, dialect)?).await?;
                owed = u64::from(carrier.acknowledges());
            }
            read = stream.read_buf(&mut buffer) => {
                if read? == 0 {
                    return Ok(());
                }
                owed = owed.saturating_sub(acknowledged(&mut buffer, carrier)?);
            }
        }
    }
}

/// Number of acknowledgements; anything else that a reader says is left out.
fn acknowledged(buffer: &mut BytesMut, carrier: Carrier) -> std::io::Result<u64> {
    let mut count = 0;
    match carrier {
        Carrier::Tcp => {
            while let Step::Event(()) = message::read_ack(buffer).map_err(invalid)? {
                count += 1;
            }
        }
        Carrier::TextAck => {
            while let Some(end) = buffer.iter().position(|&byte| byte == b'\n') {
                count += u64::from(buffer.split_to(end + 1).starts_with(b"<ACK>"));
            }
            if buffer.len() > MAX_ANSWER {
                return Err(invalid(Fault::LineTooLong(MAX_ANSWER)));
            }
        }
        _ => buffer.clear(),
    }
    Ok(count)
}

/// Longest line of a reader; an acknowledgement has five letters.
const MAX_ANSWER: usize = 1024;

fn invalid(fault: Fault) -> std::io::Error {
    std::io::Error::new(std::io::ErrorKind::InvalidData, fault)
}

fn encode(event: &NameEvent, carrier: Carrier, dialect: Dialect) -> std::io::Result<Vec<u8>> {
    let (bottle, command) = (event.to_bottle(), Command::Data { reply: false, envelope: None });
    if carrier.is_text() {
        return Ok([b"D\r\n", &*bottle.to_text_bytes(), b"\r\n"].concat());
    }
    let payload = bottle.encode(dialect).map_err(std::io::Error::other)?;
    message::whole(&command, &Bytes::from(payload)).map_err(invalid)
}

async fn goodbye(mut stream: TcpStream, carrier: Carrier) -> std::io::Result<()> {
    let words = if carrier.is_text() { b"q\r\n".to_vec() } else { message::quit() };
    stream.write_all(&words).await?;
    stream.shutdown().await?;
    // The reader closes when it has read all: until then nothing of it may be lost.
    let mut rest = [0; 64];
    let end = async { while stream.read(&mut rest).await.is_ok_and(|read| read > 0) {} };
    if tokio::time::timeout(FAREWELL, end).await.is_err() {
        tracing::debug!(target: "wrapyfi_yarp::server", "a reader did not close: cut off");
    }
    Ok(())
}
