//! `zones publish|listen|serve|call|patrol|send`: messages, a service and an action of types of your own on ROS 2.
//!
//! ```text
//!   interfaces/…/*.{msg,srv,action} ─ build.rs ─▶ ros::fleet_msgs::srv::Clear_Request { zone, … }
//! ```

#![allow(clippy::print_stdout, reason = "a program for the terminal")]

use std::time::Duration;

use anyhow::bail;
use wrapyfi_core::communicator::communicator;
use wrapyfi_core::endpoint::{
    ActionSpec, Context, GoalOutcome, GoalRequest, GoalUpdate, Middleware, Request, ServiceSpec,
};
use wrapyfi_core::types::{Payload, RosAction, RosMessage, RosService, ServiceKind};
use wrapyfi_interfaces::Message;

use ros::fleet_msgs::action::{Patrol, Patrol_Feedback, Patrol_Goal, Patrol_Result};
use ros::fleet_msgs::srv::{Clear, Clear_Request, Clear_Response};
use ros::geometry_msgs::msg::{Point32, Polygon, PolygonStamped};

/// Structs of the types that `build.rs` names.
mod ros {
    wrapyfi_interfaces::include_generated!();
}

struct Zones;

#[communicator]
impl Zones {
    #[register(RosMessage, "ros2", "/zones/keep_out")]
    fn keep_out(&self) -> PolygonStamped {
        std::thread::sleep(Duration::from_millis(100));
        let mut zone = PolygonStamped { polygon: square(), ..PolygonStamped::default() };
        zone.header.frame_id = "map".to_owned();
        zone
    }
}

/// A square of two metres.
fn square() -> Polygon {
    let corner = |x, y| Point32 { x, y, z: 0.0 };
    Polygon { points: vec![corner(0.0, 0.0), corner(2.0, 0.0), corner(2.0, 2.0), corner(0.0, 2.0)] }
}

fn main() -> anyhow::Result<()> {
    match std::env::args().nth(1).as_deref() {
        Some(mode @ ("publish" | "listen")) => zones(mode),
        Some("serve") => serve(),
        Some("call") => call(),
        Some("patrol") => patrol(),
        Some("send") => send(),
        _ => bail!("usage: zones publish|listen|serve|call|patrol|send"),
    }
}

fn zones(mode: &str) -> anyhow::Result<()> {
    let mut zones = Zones.communicator();
    zones.activate(ZonesMethod::KeepOut, mode)?;
    while let Some(zone) = zones.keep_out()? {
        println!("{} {:?}", zone.header.frame_id, zone.polygon.points.last());
    }
    Ok(())
}

/// Message of a payload of ROS.
fn read<M: Message>(payload: Payload) -> anyhow::Result<M> {
    let Payload::RosMessage(message) = payload else { bail!("{payload:?} is no message of ROS") };
    Ok(message.read()?)
}

fn clear() -> anyhow::Result<ServiceSpec> {
    Ok(ServiceSpec::new("/zones/clear", ServiceKind::Ros(RosService::of::<Clear>()?)))
}

fn serve() -> anyhow::Result<()> {
    let (ros2, context) = (wrapyfi_core::ros2("zones_server").start()?, Context::default());
    let mut server = ros2.open_server(&clear()?, &context)?;
    loop {
        let Some(asked) = server.take()? else {
            _ = context.wake.wait(Duration::from_secs(1));
            continue;
        };
        let Request::Message(request) = asked.request else { bail!("no message of ROS") };
        let request: Clear_Request = request.read()?;
        println!("{request:?}");
        let because = format!("{} was empty", request.zone);
        let response = Clear_Response { left: 3, because: because.as_str().into() };
        server.reply(asked.id, Ok(RosMessage::of(&response)?.into()))?;
    }
}

fn call() -> anyhow::Result<()> {
    let ros2 = wrapyfi_core::ros2("zones_client").start()?;
    let mut client = ros2.open_client(&clear()?, &Context::default())?;
    let request = Clear_Request { zone: "kitchen".to_owned(), ..Clear_Request::default() };
    let request = Request::Message(RosMessage::of(&request)?);
    let response: Clear_Response = read(client.call(&request, Duration::from_secs(30))?.payload)?;
    println!("{} left: {}", response.left, response.because.0);
    Ok(())
}

fn patrol_spec() -> anyhow::Result<ActionSpec> {
    Ok(ActionSpec::new("/zones/patrol", RosAction::of::<Patrol>()?))
}

fn patrol() -> anyhow::Result<()> {
    let (ros2, context) = (wrapyfi_core::ros2("patrol_server").start()?, Context::default());
    let mut server = ros2.open_action_server(&patrol_spec()?, &context)?;
    loop {
        let (number, goal) = match server.take()? {
            Some(GoalRequest::Goal { number, goal: Request::Message(goal), .. }) => (number, goal),
            Some(_) => continue,
            None => {
                _ = context.wake.wait(Duration::from_secs(1));
                continue;
            }
        };
        let Patrol_Goal { zone } = goal.read()?;
        server.update(number, GoalUpdate::Accepted)?;
        for corner in 0..u32::try_from(zone.points.len())? {
            let feedback = RosMessage::of(&Patrol_Feedback { corner })?;
            server.update(number, GoalUpdate::Feedback(feedback.into()))?;
        }
        let result = RosMessage::of(&Patrol_Result { metres: length(&zone.points) })?;
        let (outcome, result) = (GoalOutcome::Succeeded, Some(result.into()));
        server.update(number, GoalUpdate::Ended { outcome, result, text: String::new() })?;
    }
}

/// Length of an outline in metres.
fn length(points: &[Point32]) -> f64 {
    let next = points.iter().cycle().skip(1);
    points.iter().zip(next).map(|(a, b)| f64::from((b.x - a.x).hypot(b.y - a.y))).sum()
}

fn send() -> anyhow::Result<()> {
    let (ros2, context) = (wrapyfi_core::ros2("patrol_client").start()?, Context::default());
    let mut client = ros2.open_action_client(&patrol_spec()?, &context)?;
    while client.link().peers == Some(0) {
        _ = context.wake.wait(Duration::from_millis(50));
        _ = client.take();
    }
    client.send(&Request::Message(RosMessage::of(&Patrol_Goal { zone: square() })?))?;
    loop {
        match client.take() {
            Some((_, GoalUpdate::Feedback(feedback))) => {
                println!("corner {}", read::<Patrol_Feedback>(feedback)?.corner);
            }
            Some((_, GoalUpdate::Ended { outcome, result: Some(result), .. })) => {
                println!("{outcome}: {} m", read::<Patrol_Result>(result)?.metres);
                return Ok(());
            }
            Some((_, update)) if update.is_end() => bail!("the goal ended: {update:?}"),
            Some(_) => {}
            None => _ = context.wake.wait(Duration::from_millis(50)),
        }
    }
}
