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
//! [`communicator`] is written on an impl block and [`register`] on methods in it. For `impl
//! Mirror` it adds `Mirror::communicator`, whose result has the same methods; the active [`Mode`]
//! decides their effect. docs/reference/communicator.md is the guide, with every option.
//!
//! ```
//! use std::sync::Arc;
//! use wrapyfi_core::communicator::{CommunicatorContext, Mode, communicator};
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
//! let context = CommunicatorContext::builder().only(Arc::new(Memory::new("memory"))).build();
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
//! # The way of a call
//!
//! ```text
//!    caller's thread                                    the library's thread
//!    call ─ mode? ─ first call ─────── job ──────────▶ $ replaced, middleware started, endpoints opened
//!      │                                                publishers watched: does a program listen?
//!      ├─ publish: an atomic says no listener ─▶ done             │
//!      │           else the endpoint, directly                    └─▶ the atomic
//!      └─ listen:  the endpoint's queue, directly; woken by the I/O thread that fills it
//! ```
//!
//! A message passes through no thread beside those of the endpoint. Only async sends go through the
//! library's thread, because a reliable ROS 2 writer may make its sender wait, and no executor should. It also takes
//! goals and what becomes of them, so that they go on while a body runs and after a call was dropped.
//!
//! | module | one idea |
//! | --- | --- |
//! | `mode`, `describe` | roles; the macro's description of a type |
//! | `resolve`, `option`, `rules` | `$`, options, their checks of images and sound |
//! | `described` | methods that a front end in another language describes while it runs |
//! | `instance`, `opening`, `session` | modes of one instance; its endpoints |
//! | `listener`, `publisher` | the listener of one value, its publisher |
//! | `client`, `server` | the client of one value, its server |
//! | `goal_client`, `goal_server`, `feedback` | actions: goals and results as calls and replies; their feedback |
//! | `notifier`, `wait`, `oneshot`, `runtime` | waiting in threads and tasks; the library's thread |
//! | `context`, `source`, `builtin`, `config` | middlewares and configuration of instances |

mod builtin;
mod client;
mod config;
#[cfg(feature = "engine")]
mod config_file;
mod context;
mod describe;
mod described;
mod end;
mod error;
mod feedback;
mod goal_client;
mod goal_server;
mod instance;
mod listener;
mod missing;
mod mode;
mod notifier;
mod oneshot;
mod opening;
mod publisher;
mod resolve;
mod rules;
mod runtime;
mod server;
mod session;
mod settings;
mod wait;

pub use config::Configuration;
pub use context::{CommunicatorContext, ContextBuilder};
pub use describe::Method;
pub use error::{ActivateError, MethodError};
pub use feedback::{Feedback, FeedbackError, FeedbackReceiver};
pub use instance::Control;
pub use mode::{Mode, Modes, ParseModeError};
pub use wrapyfi_endpoint::StartError;
pub use wrapyfi_macros::{communicator, register};
pub use {end::EndStatus, session::ValueStatus};
#[doc(inline)]
pub use {wrapyfi_data::returned::PayloadError, wrapyfi_data::types::DataType};

// What the code of the macros names and what that returns; middlewares that are started when a method needs them.
#[doc(hidden)]
pub use {
    client::NamedArgument,
    describe::{Class, MethodSpec, NamesMethod, Register},
    described::OpenMethod,
    instance::{Instance, RunningCall},
    mode::{NamesMode, NamesOneMode},
    notifier::at_once,
    resolve::{Given, Resolved, argument},
    server::ReceivedRequest,
    session::{GatheredMessages, Session},
    wait::IsInterrupted,
    wrapyfi_data::returned::{Returned, kind},
    wrapyfi_endpoint::Planned,
    wrapyfi_endpoint::method::{EndpointNeeds, Literal, OptionError, OptionValue, Options, Source},
};
