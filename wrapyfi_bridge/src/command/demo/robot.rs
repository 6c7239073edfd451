//! The demo's robot: an rpc port that switches a light, as a YARP device serves it.
//!
//! ```text
//!   1          ─▶ light on    ─▶ [ok] "the light is on"       what `yarp rpc /robot/light/rpc` shows
//!   nonsense   ─▶             ─▶ [fail] and why
//! ```

use std::sync::atomic::{AtomicBool, Ordering};

use wrapyfi_data::types::{Map, Payload, Value};
use wrapyfi_endpoint::{Request, Server, Wake};

use crate::command::WAIT_SLICE;

/// Answers until `stop`.
pub(super) fn serve(mut server: Box<dyn Server>, wake: &Wake, stop: &AtomicBool) {
    while !stop.load(Ordering::Relaxed) {
        match server.take() {
            Ok(Some(asked)) => {
                if let Err(error) =
                    server.reply(asked.id, switch(&asked.request).map_err(Into::into))
                {
                    tracing::warn!("demo robot: {error}");
                }
            }
            Ok(None) => {
                wake.wait(WAIT_SLICE);
            }
            Err(error) => tracing::warn!("demo robot: {error}"),
        }
    }
}

/// Answer of the robot: the fields of `std_srvs/srv/SetBool`.
fn switch(request: &Request) -> Result<Payload, String> {
    let call = request.call().map_err(|error| error.to_string())?;
    let wanted = call.args.first().or_else(|| call.kwargs.get("data"));
    // On YARP a bool is a number.
    let on = wanted
        .and_then(|value| value.as_bool().or_else(|| value.as_i64().map(|number| number != 0)))
        .ok_or("the light takes 1 or 0")?;
    let message = format!("the light is {}", if on { "on" } else { "off" });
    let fields = Map::from([("success", Value::Bool(true)), ("message", message.into())]);
    Ok(Value::Map(fields).into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_light_takes_bools_numbers_and_fields_and_refuses_the_rest() {
        let told = |request: &Request| match switch(request) {
            Ok(Payload::NativeObject(object)) => match object.value {
                Value::Map(map) => map.get("message").and_then(Value::as_str).map(str::to_owned),
                _ => None,
            },
            Ok(_) => None,
            Err(reason) => Some(reason),
        };
        for (request, text) in [
            (Request::new([Value::Int(1)]), "the light is on"),
            (Request::new([Value::Bool(false)]), "the light is off"),
            (Request::default().with(Map::from([("data", true)])), "the light is on"),
            (Request::new([Value::from("green")]), "the light takes 1 or 0"),
            (Request::default(), "the light takes 1 or 0"),
        ] {
            assert_eq!(told(&request).as_deref(), Some(text));
        }
    }
}
