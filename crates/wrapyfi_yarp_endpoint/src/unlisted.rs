//! Ports that a new name server does not know, because their programs registered with the one before.
//!
//! ```text
//!   name server ends, a new one comes ─▶ its list lacks /cam, which the one before had at 127.0.0.1:10003
//!        │                                    registers again ─▶ the port that it was
//!        └─▶ a connection to 127.0.0.1:10003 ─┤
//!                                             ends, and no program is there ─▶ gone
//! ```
//!
//! Programs of YARP register once. Their ports, and the connections that these have, live on without a name
//! server: what is carried from them would end, and cannot come back, if they were taken for gone.

use std::sync::Arc;
use std::time::Duration;

use tokio::net::TcpStream;
use wrapyfi_yarp::port::LinkError;

use super::registered_port::Entry;
use super::shared::InstanceState;

/// Time between two tries to reach a port.
const PAUSE: Duration = Duration::from_secs(1);
/// Tries after which a port is gone that neither answers nor refuses.
const TRIES: u32 = 3;

/// Waits until no program is at the address of an unlisted port any more, and has the directory forget it then. Ends
/// earlier where the port is registered again.
pub(super) async fn until_gone(shared: Arc<InstanceState>, name: String, entry: Entry) {
    let bell = shared.directory.watch(&name);
    let Some(contact) = entry.contact() else { return };
    let mut failures = 0;
    while shared.directory.entry(&name).is_some_and(|now| now == entry) {
        let ended = async {
            if !entry.has_files() {
                return shared.network.until_closed(&contact).await;
            }
            // A server of files over HTTP may be no port of YARP.
            let connected = TcpStream::connect(&contact).await;
            connected
                .map(drop)
                .map_err(|error| LinkError::Connect { address: contact.clone(), error })
        };
        tokio::select! {
            () = bell.notified() => continue,
            ended = ended => match ended {
                Ok(()) => failures = 0,
                Err(error) => {
                    failures += 1;
                    if error.is_refused() || failures >= TRIES {
                        tracing::debug!(port = name, %error, "no name server knows it");
                        return shared.directory.forget_unlisted(&name, entry.number);
                    }
                }
            },
        }
        tokio::time::sleep(PAUSE).await;
    }
}
