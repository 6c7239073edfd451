//! Ports that are sent to, whose messages wait until a test reads them.

use std::ops::Deref;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use tokio::sync::{Mutex, mpsc};
use wrapyfi_yarp::port::{AdminError, Answer, Network, OpenError, Port, PortOptions, Received};

/// Messages of a port: acknowledged as soon as there is room for them.
pub(crate) struct Messages {
    queue: Mutex<mpsc::Receiver<Received>>,
    count: Arc<AtomicU64>,
}

/// A port of either kind with what it receives.
pub(crate) struct Reading<P> {
    port: P,
    messages: Messages,
}

pub(crate) type InputPort = Reading<Port>;

impl<P> Deref for Reading<P> {
    type Target = P;

    fn deref(&self) -> &P {
        &self.port
    }
}

type Answering = std::pin::Pin<Box<dyn Future<Output = Answer> + Send>>;

/// A function that puts messages into a queue with so many places.
fn queue(places: usize) -> (impl Fn(Received, bool) -> Answering + Send + Sync, Messages) {
    let (sender, queue) = mpsc::channel(places);
    let count = Arc::new(AtomicU64::new(0));
    let counted = Arc::clone(&count);
    let handler = move |message, _wants_reply| -> Answering {
        let (sender, counted) = (sender.clone(), Arc::clone(&counted));
        Box::pin(async move {
            if sender.send(message).await.is_ok() {
                counted.fetch_add(1, Ordering::Relaxed);
            }
            Answer::Nothing
        })
    };
    (handler, Messages { queue: Mutex::new(queue), count })
}

/// Opens a port that is sent to.
pub(crate) async fn open_input(
    network: &Network,
    name: &str,
    options: &PortOptions,
    places: usize,
) -> Result<InputPort, OpenError> {
    let (handler, messages) = queue(places);
    Ok(Reading { port: network.serve(name, options, handler).await?, messages })
}

/// Opens a port of the usual options.
pub(crate) async fn input(network: &Network, name: &str, places: usize) -> InputPort {
    open_input(network, name, &PortOptions::default(), places).await.unwrap()
}

/// Opens a port for both directions.
pub(crate) async fn both_ways(network: &Network, name: &str, places: usize) -> Reading<Port> {
    let (handler, messages) = queue(places);
    let port = network.open_port(name, &PortOptions::default(), handler).await.unwrap();
    Reading { port, messages }
}

impl<P> Reading<P> {
    pub(crate) async fn recv(&self) -> Option<Received> {
        self.messages.queue.lock().await.recv().await
    }

    /// A message that is here already.
    pub(crate) fn try_recv(&self) -> Option<Received> {
        self.messages.queue.try_lock().ok()?.try_recv().ok()
    }

    pub(crate) fn received(&self) -> u64 {
        self.messages.count.load(Ordering::Relaxed)
    }
}

impl InputPort {
    pub(crate) async fn close(self) {
        self.port.close().await;
    }

    /// Asks a port to send here.
    pub(crate) async fn subscribe(
        &self,
        network: &Network,
        source: &str,
        carrier: &str,
    ) -> Result<(), AdminError> {
        network.connect(source, self.name(), Some(carrier)).await
    }
}

/// A port whose connections are waited for.
pub(crate) trait Connections {
    async fn wait_for_inputs(&self, count: usize);
    async fn wait_for_outputs(&self, count: usize);
}

impl Connections for Port {
    async fn wait_for_inputs(&self, count: usize) {
        self.connected().wait_for(|now| now.inputs >= count).await.unwrap();
    }

    async fn wait_for_outputs(&self, count: usize) {
        self.connected().wait_for(|now| now.outputs >= count).await.unwrap();
    }
}
