//! Routes: configuration, state, and the relays that move messages.
//!
//! ```text
//!   bridge.yaml ─▶ Config ─▶ Plan ─▶ Engine ─ look(now): reconciler, Start, Stop ─▶ one member a route
//!                  lines     names     │                                                │
//!                                   status()                 step(now): reconcile, propagate, judge
//! ```
//!
//! One driver steps all routes: in turn where a test gives the time, on a pool of threads in
//! production. A plan may be replaced while they run (`apply` of [`Applier`]).
//!
//! A route is data: [`Route`] is the one that is wanted, [`RouteStatus`] its state. A pattern
//! matches many topics or services: its routes are made as these come, with the types that they
//! announce.
//!
//! ```
//! # mod wrapyfi_core {
//! #     pub use {wrapyfi_endpoint as endpoint, wrapyfi_engine as engine, wrapyfi_data::types};
//! #     pub mod middleware { pub use wrapyfi_endpoint::memory; }
//! # }
//! use std::{sync::Arc, time::Instant};
//! use wrapyfi_core::endpoint::{Context, Middleware, Registry, TopicSpec};
//! use wrapyfi_core::engine::{Engine, Plan, Route};
//! use wrapyfi_core::middleware::memory::Memory;
//! use wrapyfi_core::types::{MessageType, Payload, Value};
//!
//! let bus = Arc::new(Memory::new("memory"));
//! let mut registry = Registry::new();
//! registry.register(bus.clone());
//! let route = Route::topic("memory:/in".parse()?, "memory:/out".parse()?, MessageType::NativeObject);
//! let mut engine = Engine::new(Plan { routes: vec![route] }, &registry);
//!
//! let mut out = bus.open_listener(&TopicSpec::new("/out", MessageType::NativeObject), &Context::default())?;
//! let mut source = bus.open_publisher(&TopicSpec::new("/in", MessageType::NativeObject), &Context::default())?;
//! engine.step(Instant::now()); // opens both ends
//! source.publish(&Payload::from(Value::Int(7)))?;
//! engine.step(Instant::now()); // moves the message
//! assert_eq!(out.take()?.unwrap().payload, Payload::from(Value::Int(7)));
//! assert_eq!(engine.status()[0].counters.sent, 1);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod action_relay;
mod admission;
mod bridge_circle;
mod call_relay;
mod candidate;
mod circle;
mod config;
mod config_devices;
mod config_qos;
mod config_words;
mod destination;
mod discovered_graph;
mod driver;
mod end;
mod engine;
mod left_out;
mod losses;
mod member;
mod news;
mod pattern;
mod plan;
mod plan_address;
mod plan_diff;
mod plan_entry;
mod plan_options;
mod pool;
mod rate;
mod reconciler;
mod reconciler_status;
mod relay;
mod replacement;
mod route;
mod route_index;
mod route_status;
mod route_text;
mod running;
mod service_relay;
mod stamping;
mod tap;
mod unheard;
mod work;

pub use admission::may_be_read_as;
pub use bridge_circle::{BridgeRoutes, CarriedTopic, CarryingRoute, NetworkAddress};
pub use circle::Circle;
pub use config::{Config, Defaults, OverflowConfig, PageConfig, ProcessLimits, RouteConfig};
pub use config_devices::{DeviceWord, DevicesConfig};
pub use config_qos::{QosConfig, QosOverride};
pub use driver::Driver;
pub use engine::Engine;
pub use left_out::LeftOut;
pub use plan::Plan;
pub use plan_diff::PlanDiff;
pub use plan_options::{known_option, option_fits};
pub use reconciler::{GONE_AFTER, LOOK_EVERY};
pub use route::{Names, Policy, Route, RouteKey, RouteTypes, Types, Typing};
pub use route_index::RouteIndex;
pub use route_status::{PatternCounts, RouteState, RouteStatus};
pub use running::{Applier, Running};
pub use stamping::StampSource;
pub use tap::Tap;
pub use unheard::UnheardRoutes;
pub use work::Progress;
pub use wrapyfi_endpoint::config::{ConfigError, MAX_CONFIG_BYTES, Problem, Reading, Spanned};
pub use wrapyfi_endpoint::driver::Available;
pub use wrapyfi_endpoint::pattern::NamePattern;
