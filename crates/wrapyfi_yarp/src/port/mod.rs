//! Ports over tokio: what sends, receives, asks and answers.
//!
//! ```text
//!   Network ── names, dialect, limits
//!      ├─ open_output ─▶ Port ══ tcp, fast_tcp, text, text_ack, udp, mcast ══▶ Port ◀─ serve
//!      ├─ open_rpc_client ─▶ Port ◀══ requests and replies ══▶ Port ◀─ serve
//!      └─ connect, exists, admin: what `yarp connect` and its kin do
//! ```
//!
//! ```no_run
//! use wrapyfi_yarp::Bottle;
//! use wrapyfi_yarp::port::{Answer, Network, NetworkOptions, PortOptions, Received};
//!
//! # async fn f() -> Result<(), Box<dyn std::error::Error>> {
//! let network = Network::new(NetworkOptions::default());
//! let (sender, mut messages) = tokio::sync::mpsc::channel(16);
//! let handler = move |message: Received, _wants_reply| {
//!     let sender = sender.clone();
//!     async move {
//!         sender.send(message).await.ok(); // full: the writer's acknowledgement waits
//!         Answer::Nothing
//!     }
//! };
//! let _reader = network.serve("/reader", &PortOptions::default(), handler).await?;
//! let writer = network.open_output("/writer", &PortOptions::default()).await?;
//! writer.connect("fast_tcp://reader").await?;
//! writer.write_bottle(&Bottle::from(vec!["hello".into(), 42.into()]))?;
//! let message = messages.recv().await.ok_or("closed")?;
//! assert_eq!(message.bottle()?.to_text(), "hello 42");
//! # Ok(())
//! # }
//! ```
//!
//! Ports run on the tokio runtime that they are opened on: a task for each connection, none that
//! wakes without a reason. Any program may connect and disconnect them at any time, as YARP's tools do.
//!
//! [`names`] is the seam to name servers. A name server's own port ([`crate::server`]) is one of these, too.
//!
//! # Requests
//!
//! One request at a time on a connection, since YARP's replies have no number. A client whose call ran
//! out of time closes the connection, so that a late reply is never taken for the next one; the next call
//! connects again. An acknowledgement in place of a reply is `None`: the other end reads and does not
//! answer. A server answers a request that its program dropped with an empty bottle, because a client of
//! YARP waits for ever otherwise. `Network::serve` answers by a function on the connection's own task,
//! which is the fastest way.
//!
//! # Refusals
//!
//! Sizes are checked before anything is kept (`WireLimits`), and every refusal has a counter:
//!
//! | counter | what happened | then |
//! | --- | --- | --- |
//! | `unknown_header` | the first eight bytes begin no carrier | YARP's help text, closed |
//! | `unsupported_carrier`, `missing_modifier` | a carrier or modifier that only YARP's own process has; the first one of a port is said in the log | closed |
//! | `no_pictures` | mjpeg at a port that has none | HTTP status 406, closed |
//! | `name_length`, `negative_length`, `message_too_large`, `line_too_long` | a length that cannot be, or exceeds a limit | closed |
//! | `handshake_timeout` | no complete header in time | closed |
//! | `too_many_connections` | more than `WireLimits::max_connections` | closed |
//! | `replaced` | a second connection of a name | the first is closed |
//! | `bad_command` | a message without a port command | left out, not acknowledged |
//! | `no_index` | bytes where a message must begin | left out, eight at a time; closed after 1 MiB |
//! | `truncated` | the connection ended inside a message | the message is lost |
//! | `bad_datagram`, `lost_datagram` | a checksum, or a gap | the message is lost |
//! | `bad_payload` | a text or a request that cannot be read | acknowledged, not delivered |
//!
//! Messages whose declared length and payload disagree are read by their length here, and by their
//! payload in YARP. Both find the next message; after a payload that does not decode, only ours
//! does.

mod accept;
pub(crate) mod administration;
mod connection;
pub(crate) mod core;
pub(crate) mod datagrams;
mod entered;
mod fault_counts;
mod inspect;
pub(crate) mod life;
pub(crate) mod link;
mod message;
pub mod names;
mod network;
pub(crate) mod open;
mod outbox;
mod output;
mod outputs;
mod pace;
mod pictures;
mod ports;
mod room;
mod rpc_link;
pub(crate) mod session;
mod spare;
mod stream;
mod target;
pub(crate) mod tools;
mod unix;

pub use core::Connected;
pub use fault_counts::FaultCounts;
pub use inspect::{Inspection, Modes};
pub use link::LinkError;
pub use message::{Fate, Loss, Message, PayloadKind, PortPayload, Received};
pub use network::{Network, NetworkOptions, Timeouts};
pub use open::{Admission, OpenError, PortOptions};
pub use outbox::Overflow;
pub use output::ConnectionStatus;
pub use outputs::{ConnectError, Written};
pub use ports::{Port, RpcError};
pub use room::{Room, Rooms};
pub use session::Answer;
pub use tools::AdminError;
