//! Wrapyfi's programming model: mark a method once, choose its role at run time.
//!
//! ```text
//!   #[register(NativeObject, "zeromq", "/read")]
//!   fn read(&self) -> Value                       one program, run several times
//!
//!   mode publish:  body ─▶ value ─▶ zeromq:/read ─┐        mode listen: ─▶ the same value
//!                    └────▶ caller                └──────────────────────▶ caller
//! ```
//!
//! [`communicator`] is written on an impl block and [`register`] on methods in it. For `impl Mirror`
//! it adds `Mirror::communicator`, whose result has the same methods; what they do says the
//! [`Mode`] that is active. docs/communicator.md is the guide, with every option.
//!
//! ```
//! use std::sync::Arc;
//! use wrapyfi_core::communicator::{Context, Mode, communicator};
//! use wrapyfi_core::middleware::memory::Memory;
//!
//! struct Mirror;
//!
//! #[communicator]
//! impl Mirror {
//!     #[register(NativeObject, "$mware", "/example/read_msg", should_wait = "$blocking")]
//!     fn read_msg(&self, mware: &str, msg: &str, blocking: bool) -> String {
//!         _ = (mware, blocking);
//!         format!("{msg}, typed here")
//!     }
//! }
//!
//! // Both ends in one process, on a bus of its own.
//! let context = Context::builder().only(Arc::new(Memory::new("memory"))).build();
//! let mut there = Mirror.communicator_in(&context);
//! let mut here = Mirror.communicator_in(&context);
//! there.activate(MirrorMethod::ReadMsg, Mode::Listen)?;
//! here.activate("read_msg", "publish")?;
//! assert_eq!(there.read_msg("memory", "", false)?, None); // nothing was said yet
//! let said = here.read_msg("memory", "hello", true)?;
//! assert_eq!(said.as_deref(), Some("hello, typed here"));
//! assert_eq!(there.read_msg("memory", "", false)?, said);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! | module | one idea |
//! | --- | --- |
//! | `mode`, `describe` | roles; what the macro tells about a type |
//! | `resolve`, `option`, `rules` | `$`, options, what they demand of images and sound |
//! | `payload` | what a method may return |
//! | `instance`, `opening`, `session` | modes of one instance; its endpoints |
//! | `inlet`, `outlet` | one value's way in, its way out |
//! | `client`, `server` | its requests, its replies |
//! | `bell`, `wait`, `answer`, `runtime` | waiting in threads and tasks; the library's thread |
//! | `context`, `source`, `builtin`, `config` | what instances share |

mod answer;
mod bell;
mod builtin;
mod client;
mod config;
mod context;
mod describe;
mod error;
mod inlet;
mod instance;
mod mode;
mod opening;
mod option;
mod outlet;
mod payload;
mod resolve;
mod rules;
mod runtime;
mod server;
mod session;
mod settings;
mod source;
mod wait;

pub use client::NamedArgument;
pub use config::Configuration;
pub use context::{Context, ContextBuilder};
pub use describe::{Class, Literal, Method, MethodSpec, NamesMethod, Register};
pub use error::{ActivateError, CallError};
pub use instance::{Call, Control, Instance};
pub use mode::{Mode, Modes, NamesMode, NamesOneMode, ParseModeError};
pub use option::{OptionError, OptionValue, Options};
pub use payload::{Payload, PayloadError, kind};
pub use resolve::{Given, Side, argument};
pub use server::Heard;
pub use session::{EndStatus, Gathered, Session, ValueStatus};
pub use source::{Planned, Source, StartError, Wanted};
pub use wrapyfi_macros::{communicator, register};

pub use crate::types::DataType;
