//! Wrapyfi in Rust: native objects, arrays, images and sound between ZeroMQ, YARP, ROS 1 and ROS 2.
//!
//! # Layout
//!
//! ```text
//!   engine        routes: discover -> reconcile -> propagate, counters, reasons
//!   communicator  methods that publish, listen, request or reply, by their mode
//!     │
//!   endpoint      Publisher, Listener, Middleware, Registry: the seam
//!     │
//!   middleware    zeromq, yarp, ros1, ros2, memory: one module each, the rest never names one
//!     │
//!   wrapyfi_plugins   what stands behind Wrapyfi's plug-in keys
//!     │
//!   wrapyfi_data  codec: bytes <-> values; plugin: the trait of plug-ins;
//!                 types: Value, Tensor, Image, AudioChunk. No sockets, no clocks
//! ```
//!
//! * [`types`]: the data model. [`codec`]: Wrapyfi's JSON, image files.
//! * [`plugin`]: pandas, torch, Pillow, … and objects of your own.
//! * [`endpoint`]: the traits every middleware implements, queues, counters, quality of service.
//! * [`middleware`]: the transports. [`network`]: names of machines, and who may reach our sockets.
//! * `engine`, with the feature of that name: configuration, routes and the loop that moves messages.
//! * [`communicator`]: registered methods, Wrapyfi's programming model.
//! * `rosidl`, with the feature of that name: structs of the crates that `rosidl_generator_rs` writes.
//! * [`start`]: one builder for each middleware. `stream`, with the feature of that name: listeners as streams.
//! * `node`, with `ros1` or `ros2`: what makes a process a ROS 2 node: names, `--ros-args`.
//!
//! These modules have all that a program names; the crates below this one are not for programs. Definitions of ROS (`TypeStore`)
//! are in `wrapyfi_interfaces`, a crate that programs use beside this one.
//!
//! The way of one image through these modules, and the threads: ARCHITECTURE.md in the repository.
//!
//! # Example
//!
//! A listener of a Wrapyfi script, on the broker that `wrapyfi broker` or the script runs:
//!
//! ```no_run
//! use std::time::Duration;
//! use wrapyfi_core::endpoint::{Context, Middleware, TopicSpec};
//! use wrapyfi_core::middleware::zeromq::BrokerMode;
//! use wrapyfi_core::types::{MessageType, Payload};
//!
//! let zeromq =
//!     wrapyfi_core::zeromq().with(|settings| settings.broker = BrokerMode::Foreign).start()?;
//! let context = Context::default();
//! let mut listener =
//!     zeromq.open_listener(&TopicSpec::new("/camera", MessageType::Image), &context)?;
//! loop {
//!     match listener.take()? {
//!         Some(sample) => {
//!             if let Payload::Image(image) = sample.payload {
//!                 println!("{:?} at {:?}", image.pixels, image.stamp);
//!             }
//!         }
//!         None => _ = context.wake.wait(Duration::from_secs(1)),
//!     }
//! }
//! # #[allow(unreachable_code)]
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#[allow(unused_extern_crates, reason = "the macros name the crate as seen from outside")]
extern crate self as wrapyfi_core;

pub mod communicator;
pub mod middleware;
pub mod start;
#[cfg(feature = "stream")]
pub mod stream;

#[cfg(feature = "ros1")]
pub use start::ros1;
#[cfg(feature = "ros2")]
pub use start::ros2;
#[cfg(feature = "yarp")]
pub use start::yarp;
#[cfg(feature = "zeromq")]
pub use start::zeromq;

pub use wrapyfi_data::{DecodeError, EncodeError, Limits};
#[cfg(feature = "rosidl")]
#[doc(inline)]
pub use wrapyfi_ros2::rosidl;

/// Plug-ins, which read and write the objects of Python's libraries: those of Wrapyfi, and what it takes to write more.
pub mod plugin {
    #[doc(inline)]
    pub use wrapyfi_data::plugin::{
        Body, DeviceError, DeviceMaps, DeviceOption, Part, Plugin, PluginError, Plugins, Unpacking,
    };
    #[cfg(feature = "zarr")]
    #[doc(inline)]
    pub use wrapyfi_plugins::ZarrGroup;
    #[doc(inline)]
    pub use wrapyfi_plugins::standard;
}

/// Bytes of values: Wrapyfi's JSON, and files of pictures.
pub mod codec {
    #[doc(inline)]
    pub use wrapyfi_data::{DecodeResult, EncodeResult};

    /// Image files, with the feature `pictures`.
    #[cfg(feature = "pictures")]
    pub mod image_file {
        #[doc(inline)]
        pub use wrapyfi_data::codec::image_file::{decode, encode};
    }

    /// Native objects as the JSON that Wrapyfi writes, tags of arrays and plug-ins included.
    pub mod json {
        #[doc(inline)]
        pub use wrapyfi_data::codec::json::{
            decode, decode_or_text, decode_with_tensors, encode, encode_with_tensors,
        };
    }

    /// JPEG files, with the feature `jpeg`; without it they are refused by name.
    pub mod jpeg {
        #[doc(inline)]
        pub use wrapyfi_data::codec::jpeg::{WRAPYFI_QUALITY, decode, encode};
    }
}

/// Traits that every middleware implements, and what they take and return: topics, services, queues, counters, quality
/// of service.
pub mod endpoint {
    #[doc(inline)]
    pub use wrapyfi_endpoint::{
        ActionClient, ActionServer, ActionSpec, Call, CallError, Client, Clock, Context, Counters,
        CountersSnapshot, DiscoverError, Discovered, Discovery, DropReason, Durability,
        EndpointAddress, GoalEvent, GoalNumber, GoalOutcome, GoalRequest, GoalUpdate, History,
        IncomingRequest, LatencySummary, Link, Listener, Liveliness, Middleware, NameFilter,
        OpenError, OpenResult, Opened, Overflow, ParseAddressError, PublishError, Published,
        Publisher, Qos, QosEvent, QosPreset, QueueSpec, Refusal, Refused, Registry, Reliability,
        Reply, Request, RequestId, Role, RoutingProperties, Sample, SampleOrigin, ServeError,
        ServeResult, Server, ServiceSpec, TakeError, Ticket, TopicSpec, UnknownMiddleware, Wake,
    };
}

/// Routes: those that are wanted, the engine that runs them, and their state.
#[cfg(feature = "engine")]
pub mod engine {
    #[doc(inline)]
    pub use wrapyfi_engine::{
        Applier, Available, Config, ConfigError, Driver, Engine, Plan, PlanDiff, Policy, Problem,
        QosConfig, Route, RouteState, RouteStatus, Running, StampSource,
    };
}

/// Names of machines, and who may reach our sockets.
pub mod network {
    #[doc(inline)]
    pub use wrapyfi_endpoint::network::{Hosts, Insecure};
}

/// Names of nodes, and `--ros-args`, which make a process a ROS 2 node.
#[cfg(any(feature = "ros1", feature = "ros2"))]
pub mod node {
    #[doc(inline)]
    pub use wrapyfi_node::{
        NameError, NodeName,
        args::{RosArgs, RosArgsError},
        read_params_file,
    };
}

/// The data model: values of Python, tensors, pictures, sound and messages of ROS.
pub mod types {
    #[cfg(feature = "candle")]
    pub use wrapyfi_data::types::CandleError;
    #[cfg(feature = "ndarray")]
    pub use wrapyfi_data::types::as_tensor;
    #[doc(inline)]
    pub use wrapyfi_data::types::{
        AudioChunk, CompressedFormat, DataType, DateTime, Dtype, Element, Encoding, ForeignObject,
        Image, Labelled, LabelledContent, MAX_DEPTH, MAX_ROS_TYPES, Map, MessageType, NativeObject,
        NumpyArray, Origin, ParameterValue, ParseDateTimeError, ParseTypeError, Payload, Picture,
        Pixels, PluginObject, Properties, PropertiesError, Quantity, RawPixels, ReadError,
        RosAction, RosMessage, RosService, RosType, RosTypeError, RosValueError, SampleFormat,
        ServiceKind, ShapeError, Stamp, Table, Tagged, Tensor, TypedError, Value, Variable,
        fields_of, fields_of_call, fields_of_return, from_value, nested_list, to_value, value_of,
    };
}
