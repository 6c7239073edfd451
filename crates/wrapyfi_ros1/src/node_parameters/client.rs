//! One of the six services of a node's parameters, answered here.
//!
//! ```text
//!   list, get, describe, types ─▶ store ─▶ reply
//!   set ─▶ check ─▶ task: the server, the master ─▶ reply
//! ```

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

use bytes::Bytes;
use tokio::runtime::Handle;
use wrapyfi_interfaces::Message;
use wrapyfi_interfaces::cdr::CdrError;
use wrapyfi_interfaces::rcl_interfaces::msg::{self, SetParametersResult};
use wrapyfi_interfaces::rcl_interfaces::srv::{
    SetParameters_Request, SetParameters_Response, SetParametersAtomically_Request,
    SetParametersAtomically_Response,
};

use super::found::service_of;
use super::source::{NodeParameters, SharedParameters};
use crate::node::Node;
use wrapyfi_data::types::{RosMessage, RosService, ServiceKind};
use wrapyfi_data::{EncodeResult, Limits};
use wrapyfi_endpoint::calls::{Calls, Stage};
use wrapyfi_endpoint::codec::requests;
use wrapyfi_endpoint::wire_client::{ClientWire, WireClient};
use wrapyfi_endpoint::{CallError, Context, Link, Mutex, Request, ServiceSpec, Wake};
use wrapyfi_node::parameters::{MAX_PARAMETERS, Parameter, ParameterService};

/// Time for the way of a reply, which its caller must still have when it comes.
const WAY: Duration = Duration::from_millis(200);

/// A request as it waits.
pub(crate) struct Asked {
    cdr: Bytes,
    deadline: Instant,
}

type Ended = (i64, Result<Bytes, String>);

/// Calls one of the services.
pub(crate) struct ParameterServiceClient {
    parameters: Arc<NodeParameters>,
    handle: Handle,
    service: RosService,
    which: ParameterService,
    limits: Limits,
    name: String,
    context: Context,
    ended: Arc<Mutex<VecDeque<Ended>>>,
    sequence: i64,
    /// Rings when the link has changed.
    _bell: Arc<Wake>,
}

impl ParameterServiceClient {
    /// A client, where name and type are those of such a service.
    pub(crate) fn open(
        shared: &SharedParameters,
        node: &Arc<Node>,
        service: &str,
        spec: &ServiceSpec,
        context: &Context,
    ) -> Option<WireClient<Self>> {
        let ServiceKind::Ros(of_type) = spec.kind else { return None };
        let (name, which) = service_of(service, of_type)?;
        let parameters = shared.of(node, name);
        let bell = parameters.ring(&context.wake);
        let wire = Self {
            parameters,
            handle: node.handle.clone(),
            service: of_type,
            which,
            limits: spec.limits,
            name: service.to_owned(),
            context: context.clone(),
            ended: Arc::default(),
            sequence: 0,
            _bell: bell,
        };
        Some(WireClient::new(wire, &spec.service, spec.pending, context))
    }

    /// Answers a request, or begins to.
    fn answer(&mut self, Asked { cdr, deadline }: Asked) {
        let (sequence, limit) = (self.sequence, self.limits.message_bytes);
        let is_set = matches!(self.which, ParameterService::Set | ParameterService::SetAtomically);
        if !is_set {
            let answer = self.parameters.state().store.answer(self.which, &cdr, limit);
            let answer = answer.map(|parts| parts.to_bytes()).map_err(|error| error.to_string());
            self.ended.lock().push_back((sequence, answer));
            return;
        }
        let (parameters, ended) = (Arc::clone(&self.parameters), Arc::clone(&self.ended));
        let (which, wake) = (self.which, self.context.wake.clone());
        self.handle.spawn(async move {
            let left = deadline.saturating_duration_since(Instant::now());
            let within = left.saturating_sub(WAY);
            let answer = match which {
                ParameterService::Set => set(&parameters, &cdr, limit, within).await,
                _ => set_atomically(&parameters, &cdr, limit, within).await,
            };
            ended.lock().push_back((sequence, answer.map_err(|error| error.to_string())));
            wake.ring();
        });
    }
}

/// Sets each parameter for itself.
async fn set(
    parameters: &NodeParameters,
    cdr: &Bytes,
    limit: usize,
    within: Duration,
) -> Result<Bytes, CdrError> {
    let asked = SetParameters_Request::decode(cdr, limit)?.parameters;
    let checked = checked(parameters, asked);
    let fit: Vec<Parameter> = checked.iter().flatten().cloned().collect();
    let done = parameters.set(&fit, within).await;
    let result = |one: Result<Parameter, String>| {
        result(one.and_then(|one| done.get(&one.name).cloned().unwrap_or(Err(NO_NODE.to_owned()))))
    };
    let results = checked.into_iter().map(result).collect();
    Ok(SetParameters_Response { results }.encode().to_bytes())
}

/// Sets all parameters or, where one may not have its value, none. Those that a server describes are one request to it;
/// the master is told of the others one by one.
async fn set_atomically(
    parameters: &NodeParameters,
    cdr: &Bytes,
    limit: usize,
    within: Duration,
) -> Result<Bytes, CdrError> {
    let asked = SetParametersAtomically_Request::decode(cdr, limit)?.parameters;
    let checked: Result<Vec<Parameter>, String> = checked(parameters, asked).into_iter().collect();
    let outcome = match checked {
        Err(why) => Err(why),
        Ok(all) => {
            let done = parameters.set(&all, within).await;
            let remarks: Result<Vec<String>, String> = done.into_values().collect();
            remarks.map(|all| {
                all.into_iter().filter(|one| !one.is_empty()).collect::<Vec<_>>().join("; ")
            })
        }
    };
    Ok(SetParametersAtomically_Response { result: result(outcome) }.encode().to_bytes())
}

const NO_NODE: &str = "this program has ended its ROS 1 node";

fn checked(
    parameters: &NodeParameters,
    asked: Vec<msg::Parameter>,
) -> Vec<Result<Parameter, String>> {
    if asked.len() > MAX_PARAMETERS {
        let why =
            format!("{} parameters in one request, the limit is {MAX_PARAMETERS}", asked.len());
        return asked.iter().map(|_| Err(why.clone())).collect();
    }
    let state = parameters.state();
    let check = |one: msg::Parameter| {
        let one = Parameter::try_from(one).map_err(|error| error.reason())?;
        state.check(&one).map(|()| one)
    };
    asked.into_iter().map(check).collect()
}

fn result(outcome: Result<String, String>) -> SetParametersResult {
    let (successful, Ok(reason) | Err(reason)) = (outcome.is_ok(), outcome);
    SetParametersResult { successful, reason }
}

impl ClientWire for ParameterServiceClient {
    type Written = Asked;

    fn write(&self, request: &Request, deadline: Instant) -> EncodeResult<(Asked, usize)> {
        let limit = self.limits.message_bytes;
        let message = requests::asked_message(request, self.service.request(), limit)?;
        let bytes = message.cdr.len();
        Ok((Asked { cdr: message.cdr.to_bytes(), deadline }, bytes))
    }

    fn turn(&mut self, calls: &mut Calls<Asked>) {
        while calls.next_to_send().is_some() && self.parameters.waiting_for().is_none() {
            self.sequence += 1;
            let Some(asked) = calls.send(self.sequence) else { break };
            self.answer(asked);
        }
        let ended = std::mem::take(&mut *self.ended.lock());
        for (sequence, answer) in ended {
            let bytes = answer.as_ref().map_or(0, Bytes::len);
            let service = self.name.clone();
            calls.answered(sequence, bytes, self.context.clock.now(), || match answer {
                Ok(cdr) => Ok(RosMessage::new(self.service.response(), cdr).into()),
                Err(reason) => Err(CallError::Refused { service, reason }),
            });
        }
    }

    fn missing(&self, stage: Stage) -> String {
        match (stage, self.parameters.waiting_for()) {
            (Stage::Waiting, Some(cause)) => format!("still waiting for {cause}"),
            _ => "its server has not answered".to_owned(),
        }
    }

    fn link(&self) -> Link {
        let waiting_for = self.parameters.waiting_for();
        Link { peers: Some(usize::from(waiting_for.is_none())), waiting_for, keeps_last: false }
    }
}
