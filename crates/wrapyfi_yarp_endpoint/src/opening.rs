//! Opens a port, however long its name is taken or the name server is away.

use super::name;
use std::time::Duration;

use wrapyfi_yarp::port::OpenError;

use super::link_state::LinkState;
use super::shared::InstanceState;
use wrapyfi_endpoint::Cause;
use wrapyfi_endpoint::backoff::Backoff;

/// Pause before a port's name is tried again whose program has closed its connection.
const ENDED: Duration = Duration::from_millis(50);

/// Opens a port with `open`, again and again until it succeeds; `link_state` is told why not yet.
/// `name` is what it depends on.
pub(super) async fn until_open<P, F: Future<Output = Result<P, OpenError>>>(
    shared: &InstanceState,
    name: &str,
    link_state: &LinkState,
    mut open: impl FnMut() -> F,
) -> P {
    let bell = shared.directory.watch(name);
    let mut backoff = Backoff::of_name(name);
    loop {
        let mut taken = None;
        let say = |what: Cause| link_state.waiting(what);
        match shared.directory.answers("to register a port of ours", open(), say).await {
            Ok(port) => return port,
            Err(OpenError::Taken(name)) => {
                link_state
                    .waiting(Cause::NameTaken { port: name::address(&name), was_ours: false });
                taken = shared.located(&name).await.and_then(|entry| entry.contact());
            }
            Err(error) => {
                let away = shared.directory.waiting_for();
                link_state.waiting(away.unwrap_or_else(|| Cause::Transport(error.to_string())));
            }
        }
        // A name server does not tell that the program of a port was killed.
        let ended = async {
            match &taken {
                Some(contact) if shared.network.until_closed(contact).await.is_ok() => {}
                _ => std::future::pending().await,
            }
        };
        tokio::select! {
            () = bell.notified() => {}
            () = backoff.pause() => {}
            () = ended => tokio::time::sleep(ENDED).await,
        }
    }
}

/// A name for a port that no program has to know: that of what it reads, with a number, as Wrapyfi's.
pub(super) fn numbered(topic: &str) -> String {
    format!("{topic}:in{}", number())
}

/// A random number of five digits at most.
pub(super) fn number() -> u64 {
    use std::hash::{BuildHasher, Hasher};
    // Keys of a map that is not used otherwise: what the standard library has for random numbers.
    std::hash::RandomState::new().build_hasher().finish() % 100_000
}
