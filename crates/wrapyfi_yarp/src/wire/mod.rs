//! The bytes of a connection, without sockets: bytes in, events out.
//!
//! ```text
//!                        ┌ tcp, fast_tcp ─▶ message ─┐
//!                        ├ unix_stream ──▶ bare ─────┤
//!   first bytes ─ header ┼ text, text_ack ▶ text ────┼▶ Incoming: data, administration, command, quit
//!   of a connection      ├ udp, mcast ─ datagram ────┘      each with the command's envelope
//!                        ├ NAME_SER ─────▶ lines
//!                        └ GET, POST ────▶ http           mjpeg (we opened it) ─▶ JPEG files
//! ```
//!
//! Every reader has one method, `poll`, over a buffer: it takes off what it understood and yields an
//! event, or says how many bytes more it needs at least. Events are slices of that buffer, so that
//! the payload of a large message is read by the socket straight into the place where it stays.
//! Nothing here waits, allocates by a length that was not checked, or panics.
//!
//! * [`number`], [`header`], [`sender`]: the beginning of a connection.
//! * [`command`], [`message`], [`bare`], [`text`], [`datagram`]: messages.
//! * [`admin`]: administrative requests, and the sentences of the answers.
//! * [`http`], [`mjpeg`]: browsers, and cameras.

pub mod admin;
pub mod bare;
pub mod command;
pub mod datagram;
pub mod header;
pub mod http;
pub mod message;
pub mod mjpeg;
pub mod number;
pub mod sender;
pub mod text;

mod carrier;
mod fault;
mod step;

pub use carrier::{Carrier, UnknownCarrier};
pub use command::{Body, Command, Incoming};
pub use fault::Fault;
pub use header::Opening;
pub use sender::Sender;
pub use step::Progress;

use step::{i32_at, take};
