//! A port whose requests wait in a queue until the test answers them.

use tokio::sync::{mpsc, oneshot};
use wrapyfi_yarp::Bottle;
use wrapyfi_yarp::port::{Answer, Network, Port, PortOptions, Received};

/// A request that waits for its answer; an empty bottle where it is dropped.
pub(crate) struct Asked {
    pub(crate) received: Received,
    pub(crate) wants_reply: bool,
    pub(crate) reply: oneshot::Sender<Answer>,
}

pub(crate) async fn queued(network: &Network, name: &str) -> (Port, mpsc::Receiver<Asked>) {
    let (sender, queue) = mpsc::channel(64);
    let handler = move |received, wants_reply| {
        let sender = sender.clone();
        async move {
            let (reply, answered) = oneshot::channel();
            sender.send(Asked { received, wants_reply, reply }).await.ok();
            answered.await.unwrap_or_else(|_dropped| Answer::Bottle(Bottle::new()))
        }
    };
    (network.serve(name, &PortOptions::default(), handler).await.unwrap(), queue)
}
