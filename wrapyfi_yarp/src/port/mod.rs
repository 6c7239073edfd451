//! Ports over tokio: what sends, receives, asks and answers.
//!
//! ```text
//!   Network ── names, dialect, limits
//!      ├─ open_output ─▶ OutputPort ══ tcp, fast_tcp, text, text_ack, udp, mcast ══▶ InputPort
//!      ├─ open_rpc_client ─▶ RpcClient ◀══ requests and replies ══▶ RpcServer
//!      └─ connect, exists, admin: what `yarp connect` and its kin do
//! ```
//!
//! ```no_run
//! use wrapyfi_yarp::Bottle;
//! use wrapyfi_yarp::port::{InputOptions, Network, OutputOptions};
//!
//! # async fn f() -> Result<(), Box<dyn std::error::Error>> {
//! let network = Network::builder().build();
//! let reader = network.open_input("/reader", &InputOptions::default()).await?;
//! let writer = network.open_output("/writer", &OutputOptions::default()).await?;
//! writer.connect("fast_tcp://reader").await?;
//! writer.write_bottle(&Bottle::from(vec!["hello".into(), 42.into()]))?;
//! let message = reader.recv().await.ok_or("closed")?;
//! assert_eq!(message.bottle()?.to_text(), "hello 42");
//! # Ok(())
//! # }
//! ```
//!
//! Ports run on the tokio runtime that they are opened on: a task for each connection, none that
//! wakes without a reason. Anybody may connect and disconnect them at any time, as YARP's tools do.
//!
//! * [`session`]: connections that others open, also for a name server's own use.
//! * [`names`]: the seam to name servers, and [`names::NameTable`] for those who have none.

mod administration;
mod connection;
mod core;
mod counters;
mod datagrams;
mod inbox;
mod inspect;
mod link;
mod message;
pub mod names;
mod network;
mod open;
mod outbox;
mod outputs;
mod pace;
mod pictures;
mod ports;
mod rpc_client;
mod rpc_server;
pub mod session;
mod spare;
mod stream;
mod target;
mod tools;
mod unix;

pub use core::Connected;
pub use counters::Counters;
pub use inbox::{Acknowledge, Reading};
pub use inspect::{Inspection, Modes};
pub use link::LinkError;
pub use message::{Message, Payload, PayloadKind, Received};
pub use network::{Network, NetworkBuilder, Timeouts};
pub use open::{OpenError, PortOptions};
pub use outbox::Overflow;
pub use outputs::{ConnectError, ConnectionStatus, Written};
pub use ports::{InputOptions, InputPort, OutputOptions, OutputPort, Port};
pub use rpc_client::{CallError, RpcClient};
pub use rpc_server::{Request, RpcServer};
pub use session::Answer;
pub use tools::AdminError;
