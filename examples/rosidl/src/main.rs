//! `tensors publish|listen|serve|call`: a message and a service of the crate that `rosidl_generator_rs` writes for `wrapyfi_msgs`.
//!
//! ```text
//!   wrapyfi_msgs/{msg,srv} ─ colcon ─▶ crate wrapyfi_msgs ─▶ wrapyfi_core::rosidl ─▶ ROS 2
//! ```

use std::time::Duration;

use anyhow::bail;
use wrapyfi_core::communicator::communicator;
use wrapyfi_core::endpoint::{Context, Middleware, Request, ServiceSpec};
use wrapyfi_core::rosidl::{self, Rosidl};
use wrapyfi_core::types::{Payload, ServiceKind};
use wrapyfi_msgs::msg::Tensor;
use wrapyfi_msgs::srv::{Explain, Explain_Request, Explain_Response};

struct Arm;

#[communicator]
impl Arm {
    #[register(RosMessage, "ros2", "/arm/joints")]
    fn joints(&self) -> Rosidl<Tensor> {
        std::thread::sleep(Duration::from_millis(100));
        let radians = [0.5_f64, -1.25, 0.0];
        let data = radians.iter().flat_map(|angle| angle.to_le_bytes()).collect();
        Rosidl(Tensor { dtype: "float64".to_owned(), shape: vec![3], device: String::new(), data })
    }
}

fn main() -> anyhow::Result<()> {
    match std::env::args().nth(1).as_deref() {
        Some(mode @ ("publish" | "listen")) => joints(mode),
        Some("serve") => serve(),
        Some("call") => call(),
        _ => bail!("usage: tensors publish|listen|serve|call"),
    }
}

fn joints(mode: &str) -> anyhow::Result<()> {
    let mut arm = Arm.communicator();
    arm.activate(ArmMethod::Joints, mode)?;
    while let Some(joints) = arm.joints()? {
        println!("{} {:?}, {} bytes", joints.dtype, joints.shape, joints.data.len());
    }
    Ok(())
}

fn explain() -> anyhow::Result<ServiceSpec> {
    Ok(ServiceSpec::new("/arm/explain", ServiceKind::Ros(rosidl::service::<Explain>()?)))
}

fn serve() -> anyhow::Result<()> {
    let (ros2, context) = (wrapyfi_core::ros2("arm_server").start()?, Context::default());
    let mut server = ros2.open_server(&explain()?, &context)?;
    loop {
        let Some(asked) = server.take()? else {
            _ = context.wake.wait(Duration::from_secs(1));
            continue;
        };
        let Request::Message(request) = asked.request else { bail!("no message of ROS") };
        let request: Explain_Request = rosidl::read(&request)?;
        let what = format!("{} has three joints", request.name);
        let response = Explain_Response { known: true, what, ..Explain_Response::default() };
        server.reply(asked.id, Ok(rosidl::message(&response)?.into()))?;
    }
}

fn call() -> anyhow::Result<()> {
    let ros2 = wrapyfi_core::ros2("arm_client").start()?;
    let mut client = ros2.open_client(&explain()?, &Context::default())?;
    let request = rosidl::message(&Explain_Request { name: "left_arm".to_owned() })?;
    let reply = client.call(&Request::Message(request), Duration::from_secs(30))?;
    let Payload::RosMessage(reply) = reply.payload else { bail!("no message of ROS") };
    println!("{}", rosidl::read::<Explain_Response>(&reply)?.what);
    Ok(())
}
