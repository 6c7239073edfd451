//! A node on rclrs and one of ours, in two processes, which exchange every message and call every service of `wrapyfi_msgs` both
//! ways.
//!
//! ```text
//!   ours ── /to_rclrs/Tensor ──▶ rclrs      ours calls  /of_rclrs/Explain, which rclrs serves
//!        ◀─ /to_ours/Tensor ──── (echoes)   rclrs calls /of_ours/Explain, which ours serves
//! ```

use std::any::Any;
use std::fmt::Debug;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::mpsc::{Receiver, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail, ensure};
use rclrs::{Context as Rcl, CreateBasicExecutor, Node, SpinOptions};
use wrapyfi_core::endpoint::{Context, Middleware, Request, ServiceSpec, TopicSpec};
use wrapyfi_core::rosidl::{self, Message, Service};
use wrapyfi_core::types::{MessageType, Payload, RosMessage, ServiceKind};
use wrapyfi_msgs::msg::{AudioChunk, BridgeStatus, NativeObject, RouteInfo, Tensor};
use wrapyfi_msgs::srv::{
    self, AddRoute, AudioService, Explain, ImageService, ListRoutes, NativeObjectService,
    RemoveRoute,
};

/// Longest wait for any one step.
const PATIENCE: Duration = Duration::from_secs(60);

/// One of the two nodes; what it opens lives until its end.
trait End {
    /// Exchanges a message with the other one.
    fn message<M: Message + PartialEq>(&mut self, message: &M) -> anyhow::Result<()>;

    /// Serves a service to the other one, and calls the other one's.
    fn service<S: Service>(
        &mut self,
        request: &S::Request,
        response: &S::Response,
    ) -> anyhow::Result<()>
    where
        S::Request: PartialEq,
        S::Response: PartialEq;
}

#[derive(Default)]
struct Served {
    ended: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

struct Ours(Box<dyn Middleware>, Served);

struct OnRclrs {
    node: Node,
    open: Vec<Box<dyn Any>>,
}

/// Tries until there is a result.
fn until<T>(
    what: &str,
    mut attempt: impl FnMut() -> anyhow::Result<Option<T>>,
) -> anyhow::Result<T> {
    let begin = Instant::now();
    loop {
        if let Some(done) = attempt()? {
            return Ok(done);
        }
        ensure!(begin.elapsed() < PATIENCE, "{what}: nothing for {PATIENCE:?}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn of_ros(payload: Payload) -> anyhow::Result<RosMessage> {
    let Payload::RosMessage(message) = payload else { bail!("{payload:?} is no message of ROS") };
    Ok(message)
}

fn same<M: PartialEq + Debug>(name: &str, found: &M, wanted: &M) -> anyhow::Result<()> {
    ensure!(found == wanted, "{name}: {found:?} where {wanted:?} should be");
    Ok(())
}

/// Last part of the name of a type.
fn last(name: &'static str) -> anyhow::Result<&'static str> {
    Ok(name.rsplit_once('/').context("no name of a type")?.1)
}

impl End for Ours {
    fn message<M: Message + PartialEq>(&mut self, message: &M) -> anyhow::Result<()> {
        let kind = rosidl::ros_type::<M>()?;
        let (name, context) = (last(kind.name())?, Context::default());
        let spec = |way: &str| TopicSpec::new(format!("/{way}/{name}"), MessageType::Ros(kind));
        let mut listener = self.0.open_listener(&spec("to_ours"), &context)?;
        let mut publisher = self.0.open_publisher(&spec("to_rclrs"), &context)?;
        // A reader that is not matched yet misses it.
        let sample = until(name, || {
            publisher.publish(&rosidl::message(message)?.into())?;
            Ok(listener.take()?)
        })?;
        same(name, &rosidl::read::<M>(&of_ros(sample.payload)?)?, message)
    }

    fn service<S: Service>(
        &mut self,
        request: &S::Request,
        response: &S::Response,
    ) -> anyhow::Result<()>
    where
        S::Request: PartialEq,
        S::Response: PartialEq,
    {
        let kind = rosidl::service::<S>()?;
        let (name, context) = (last(kind.name())?, Context::default());
        let spec =
            |side: &str| ServiceSpec::new(format!("/of_{side}/{name}"), ServiceKind::Ros(kind));
        let mut server = self.0.open_server(&spec("ours"), &context)?;
        let mut client = self.0.open_client(&spec("rclrs"), &context)?;
        let reply = client.call(&Request::Message(rosidl::message(request)?), PATIENCE)?;
        same(name, &rosidl::read::<S::Response>(&of_ros(reply.payload)?)?, response)?;
        let asked = until(name, || Ok(server.take()?))?;
        let Request::Message(message) = asked.request else { bail!("no message of ROS") };
        same(name, &rosidl::read::<S::Request>(&message)?, request)?;
        server.reply(asked.id, Ok(rosidl::message(response)?.into()))?;
        // A reply waits for a client that does not hear yet, and is sent when the server is looked at.
        let ended = Arc::clone(&self.1.ended);
        self.1.threads.push(std::thread::spawn(move || {
            while !ended.load(Relaxed) && server.take().is_ok() {
                std::thread::sleep(Duration::from_millis(10));
            }
        }));
        Ok(())
    }
}

impl End for OnRclrs {
    fn message<M: Message + PartialEq>(&mut self, _: &M) -> anyhow::Result<()> {
        let name = last(rosidl::ros_type::<M>()?.name())?;
        let echo = self.node.create_publisher::<M>(format!("/to_ours/{name}").as_str())?;
        let echoes = move |message: M| echo.publish(message).expect("rclrs publishes");
        let heard = self.node.create_subscription(format!("/to_rclrs/{name}").as_str(), echoes)?;
        self.open.push(Box::new(heard));
        Ok(())
    }

    fn service<S: Service>(
        &mut self,
        request: &S::Request,
        response: &S::Response,
    ) -> anyhow::Result<()>
    where
        S::Request: PartialEq,
        S::Response: PartialEq,
    {
        let name = last(rosidl::service::<S>()?.name())?;
        let (asked, asks): (_, Receiver<S::Request>) = channel();
        let answer = response.clone();
        let serves = move |request: S::Request| {
            asked.send(request).expect("this program waits");
            answer.clone()
        };
        let server =
            self.node.create_service::<S, _>(format!("/of_rclrs/{name}").as_str(), serves)?;
        self.open.push(Box::new(server));
        same(name, &asks.recv_timeout(PATIENCE)?, request)?;

        let client = self.node.create_client::<S>(format!("/of_ours/{name}").as_str())?;
        until(name, || Ok(client.service_is_ready()?.then_some(())))?;
        let (answered, answers): (_, Receiver<S::Response>) = channel();
        let _call = client.call_then(request, move |response: S::Response| {
            answered.send(response).expect("this program waits");
        })?;
        same(name, &answers.recv_timeout(PATIENCE)?, response)
    }
}

fn tensor() -> Tensor {
    let data = (0..100_000_u32).flat_map(u32::to_le_bytes).collect();
    Tensor { dtype: "uint32".into(), shape: vec![100, 1000], device: "cpu".into(), data }
}

fn object() -> NativeObject {
    let mut object = NativeObject {
        json: r#"{"grüße": 0}"#.into(),
        tensors: vec![tensor(); 2],
        ..Default::default()
    };
    object.header.frame_id = "map".into();
    object.header.stamp.nanosec = 5;
    object
}

fn sound() -> AudioChunk {
    AudioChunk {
        sample_rate: 16_000,
        encoding: AudioChunk::ENCODING_S16LE.into(),
        data: vec![7; 3200],
        ..Default::default()
    }
}

fn route() -> RouteInfo {
    RouteInfo {
        key: "/a".into(),
        has_source: true,
        messages_per_s: 29.97,
        drop_reasons: vec!["full".into(), String::new()],
        drop_counts: vec![u64::MAX, 0],
        ..Default::default()
    }
}

fn exchange(end: &mut impl End) -> anyhow::Result<()> {
    end.message(&tensor())?;
    end.message(&object())?;
    end.message(&sound())?;
    end.message(&route())?;
    end.message(&BridgeStatus {
        state: "active".into(),
        routes: vec![route(); 3],
        ..Default::default()
    })?;

    let (success, message) = (true, "done".to_owned());
    let route_text = srv::AddRoute_Request { route: "yarp:/a".into() };
    end.service::<AddRoute>(
        &route_text,
        &srv::AddRoute_Response { success, message: message.clone() },
    )?;
    let response = sound();
    end.service::<AudioService>(
        &srv::AudioService_Request { request: object() },
        &srv::AudioService_Response { success, message: message.clone(), response },
    )?;
    end.service::<Explain>(
        &srv::Explain_Request { name: "/a".into() },
        &srv::Explain_Response {
            known: true,
            passed: vec!["/b".into()],
            routes: vec![route()],
            ..Default::default()
        },
    )?;
    let response = sensor_msgs::msg::Image {
        height: 2,
        width: 3,
        step: 9,
        data: vec![9; 18],
        ..Default::default()
    };
    end.service::<ImageService>(
        &srv::ImageService_Request { request: object() },
        &srv::ImageService_Response { success, message: message.clone(), response },
    )?;
    end.service::<ListRoutes>(
        &srv::ListRoutes_Request::default(),
        &srv::ListRoutes_Response { routes: vec![route(); 2] },
    )?;
    end.service::<NativeObjectService>(
        &srv::NativeObjectService_Request { request: object() },
        &srv::NativeObjectService_Response {
            success,
            message: message.clone(),
            response: object(),
        },
    )?;
    end.service::<RemoveRoute>(
        &srv::RemoveRoute_Request { name: "/a".into() },
        &srv::RemoveRoute_Response { success, message },
    )?;
    Ok(())
}

fn main() -> anyhow::Result<()> {
    if std::env::args().nth(1).as_deref() == Some("rclrs") {
        let mut executor = Rcl::default_from_env()?.create_basic_executor();
        let node = executor.create_node("on_rclrs")?;
        let commands = executor.commands().clone();
        let spins = std::thread::spawn(move || executor.spin(SpinOptions::default()));
        let mut end = OnRclrs { node, open: Vec::new() };
        let done = exchange(&mut end).context("rclrs");
        // What its thread still uses is taken apart behind it.
        commands.halt_spinning();
        _ = spins.join();
        return done;
    }
    let mut other = std::process::Command::new(std::env::current_exe()?).arg("rclrs").spawn()?;
    let mut end = Ours(Box::new(wrapyfi_core::ros2("ours").start()?), Served::default());
    let ours = exchange(&mut end).context("ours");
    if ours.is_err() {
        other.kill()?;
    }
    let status = other.wait()?;
    // The other one has its last reply: servers are closed before their node.
    end.1.ended.store(true, Relaxed);
    end.1.threads.into_iter().for_each(|thread| _ = thread.join());
    ours?;
    ensure!(status.success(), "the node on rclrs failed");
    println!("5 messages and 7 services went both ways");
    Ok(())
}
