//! Routes: configuration, state, and the loop that moves messages.
//!
//! ```text
//!   bridge.yaml ─▶ Config ─▶ Plan ─▶ Engine ─▶ one Relay a route
//!                  lines     names     │          │
//!                                   status()   step(now): reconcile, propagate, judge
//! ```
//!
//! A route is data: [`RouteSpec`] says what is wanted, [`RouteStatus`] what is. Routes by pattern,
//! discovery, reload at run time and services will join here: a plan will then be computed from
//! what discovery finds, and the engine will compare it with what runs.
//!
//! ```
//! use std::{sync::Arc, time::Instant};
//! use wrapyfi_core::endpoint::{Context, Middleware, Registry, TopicSpec};
//! use wrapyfi_core::engine::{Engine, Plan, RouteSpec};
//! use wrapyfi_core::middleware::memory::Memory;
//! use wrapyfi_core::types::{MessageType, Payload, Value};
//!
//! let bus = Arc::new(Memory::new("memory"));
//! let mut registry = Registry::new();
//! registry.register(bus.clone());
//! let route = RouteSpec::new("memory:/in".parse()?, "memory:/out".parse()?, MessageType::NativeObject);
//! let mut engine = Engine::new(Plan { routes: vec![route], ..Plan::default() }, &registry);
//!
//! let mut out = bus.open_listener(&TopicSpec::new("/out", MessageType::NativeObject), &Context::default())?;
//! let mut source = bus.open_publisher(&TopicSpec::new("/in", MessageType::NativeObject), &Context::default())?;
//! engine.step(Instant::now()); // opens both ends
//! source.publish(&Payload::NativeObject(Box::new(Value::Int(7))))?;
//! engine.step(Instant::now()); // moves the message
//! assert_eq!(out.take()?.unwrap().payload, Payload::NativeObject(Box::new(Value::Int(7))));
//! assert_eq!(engine.status()[0].counters.sent, 1);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod config;
mod config_devices;
mod config_error;
mod config_qos;
mod conventions;
#[expect(clippy::module_inception, reason = "the engine is this module's one main type")]
mod engine;
mod plan;
mod plan_options;
mod plan_service;
mod relay;
mod route;
mod service_relay;

pub use config::{Config, Defaults, MAX_CONFIG_BYTES, OverflowConfig, RouteConfig, Spanned};
pub use config_devices::{DeviceWord, DevicesConfig};
pub(crate) use config_error::did_you_mean;
pub use config_error::{ConfigError, Problem};
pub use config_qos::{QosConfig, QosOverride};
pub use engine::{Engine, Running};
pub use plan::{Available, Plan, RouteSpec};
pub use plan_service::ServiceRouteSpec;
pub use relay::{Relay, Step};
pub use route::{RouteState, RouteStatus};
pub use service_relay::ServiceRelay;
