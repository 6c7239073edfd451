//! Calls of a node to its master: publishers, services and parameters.
//!
//! Every method of the master's API that a node uses, with its values read into ours. Source: the pages
//! `Master API` and `Parameter Server API` of the ROS 1 documentation.

use std::sync::Arc;

use bytes::Bytes;
use dxr::TryFromValue;
use wrapyfi_endpoint::{Cause, Named};

use super::config::NodeUri;
use super::http::{self, HttpError, HttpResult, KeptConnection};
use super::whereabouts::Whereabouts;
use super::xmlrpc::{Reply, SUCCESS, Value, shortened, text};

/// Error of a call to the master.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MasterError {
    /// The master does not answer, or not as a master.
    #[error("master {uri} (it {what})")]
    Unreachable {
        /// Address of the master.
        uri: String,
        /// Fault of the connection, after "it".
        what: String,
    },
    /// The master refused the call.
    #[error("the master refused {method}: {reason}")]
    Refused {
        /// Method of the master's API that was called.
        method: &'static str,
        /// Reason in the master's words.
        reason: String,
    },
    /// The master's answer has another shape than the method's.
    #[error("the master answered {method} with {actual}")]
    Odd {
        /// Method of the master's API that was called.
        method: &'static str,
        /// Answer that came, shortened.
        actual: String,
    },
}

/// Methods that are asked again and again.
pub(super) const SYSTEM_STATE: &str = "getSystemState";
pub(super) const TOPIC_TYPES: &str = "getTopicTypes";
pub(super) const PARAMETER: &str = "getParam";
pub(super) const PARAMETER_NAMES: &str = "getParamNames";

/// Last answer to a question that is asked again and again, and what was read from it.
pub(super) type Repeated<T> = Option<(Bytes, T)>;

/// Result of asking the master.
pub(super) type MasterResult<T> = Result<T, MasterError>;

impl MasterError {
    /// Cause for which nothing can be found through the master at `uri`.
    pub(super) fn cause(&self, uri: &NodeUri) -> Cause {
        let (server, detail) = match self {
            Self::Unreachable { uri, what } => {
                (Named::server("master", uri), format!(" (it {what})"))
            }
            other => {
                let (words, address) = ("the master".to_owned(), uri.to_string());
                (Named { words, address }, format!(" to answer otherwise: {other}"))
            }
        };
        Cause::ServerAway { server, detail }
    }
}

impl From<HttpError> for MasterError {
    fn from(HttpError { uri, what, .. }: HttpError) -> Self {
        Self::Unreachable { uri, what }
    }
}

/// Names, and who stands behind each.
pub(super) type Owners = Vec<(String, Vec<String>)>;

/// Everything that is registered.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct SystemState {
    pub(super) publishers: Owners,
    pub(super) subscribers: Owners,
    pub(super) services: Owners,
}

/// The master, as one node sees it.
#[derive(Debug, Clone)]
pub(super) struct Master {
    pub(super) uri: NodeUri,
    /// Name of the node.
    caller: String,
    /// Address of the node's own XML-RPC server.
    pub(super) api: String,
    /// Machines that the addresses mean which the master tells.
    pub(super) whereabouts: Arc<Whereabouts>,
}

impl Master {
    pub(super) fn new(uri: NodeUri, caller: &str, api: &str, whereabouts: Whereabouts) -> Self {
        let whereabouts = Arc::new(whereabouts);
        Self { uri, caller: caller.to_owned(), api: api.to_owned(), whereabouts }
    }

    /// Calls a method of the master with this node's name and `params`.
    pub(super) async fn ask(
        &self,
        method: &'static str,
        params: impl IntoIterator<Item = Value>,
    ) -> MasterResult<Value> {
        granted(method, self.raw(method, params).await?)
    }

    /// [`Self::ask`] for a value of the shape `T`.
    pub(super) async fn ask_for<T: TryFromValue>(
        &self,
        method: &'static str,
        params: impl IntoIterator<Item = Value>,
    ) -> MasterResult<T> {
        shaped(method, self.raw(method, params).await?)
    }

    /// Calls a method whose answer is the same as `last` nearly every time, over a connection that stays. True where it is another
    /// one, which is read by `read` and kept: the lists of a large system are not taken apart to learn that nothing has changed.
    pub(super) async fn ask_again<T>(
        &self,
        kept: &mut KeptConnection,
        last: &mut Repeated<T>,
        method: &'static str,
        params: impl IntoIterator<Item = Value>,
        read: impl FnOnce(Reply) -> MasterResult<T>,
    ) -> MasterResult<bool> {
        let answer = http::call_kept(kept, &self.uri, method, self.named(params)).await?;
        if last.as_ref().is_some_and(|(before, _)| *before == answer) {
            return Ok(false);
        }
        let value = read(http::decode(&self.uri, &answer)?)?;
        *last = Some((answer, value));
        Ok(true)
    }

    async fn raw(
        &self,
        method: &str,
        params: impl IntoIterator<Item = Value>,
    ) -> HttpResult<Reply> {
        http::call(&self.uri, method, self.named(params)).await
    }

    /// The parameters of a call: the name of the node comes first.
    fn named(&self, params: impl IntoIterator<Item = Value>) -> Vec<Value> {
        [text(&self.caller)].into_iter().chain(params).collect()
    }

    /// Address of the node that offers a service; `None` where none does.
    pub(super) async fn lookup_service(&self, service: &str) -> MasterResult<Option<NodeUri>> {
        self.lookup("lookupService", service).await
    }

    /// Address of a node; `None` where the master does not know it.
    pub(super) async fn lookup_node(&self, node: &str) -> MasterResult<Option<NodeUri>> {
        self.lookup("lookupNode", node).await
    }

    async fn lookup(&self, method: &'static str, name: &str) -> MasterResult<Option<NodeUri>> {
        let reply = self.raw(method, [text(name)]).await?;
        match &reply.value {
            _ if reply.status != SUCCESS => Ok(None),
            Value::String(uri) => {
                NodeUri::parse(uri).map(|uri| Some(self.whereabouts.of(uri))).map_err(|reason| {
                    MasterError::Odd { method, actual: format!("{uri:?}: {reason}") }
                })
            }
            other => Err(odd(method, other)),
        }
    }

    /// The master's process: another one after a restart.
    pub(super) async fn pid(&self) -> MasterResult<i32> {
        self.ask_for("getPid", []).await
    }

    pub(super) async fn system_state(&self) -> MasterResult<SystemState> {
        SystemState::of(self.raw(SYSTEM_STATE, []).await?)
    }

    /// Types of the topics, as their publishers or subscribers named them.
    pub(super) async fn topic_types(&self) -> MasterResult<Vec<(String, String)>> {
        self.ask_for(TOPIC_TYPES, []).await
    }

    /// Names of all parameters.
    pub(super) async fn param_names(&self) -> MasterResult<Vec<String>> {
        self.ask_for(PARAMETER_NAMES, []).await
    }

    /// The value of a parameter, or of all below a name; `None` where there is none.
    pub(super) async fn get_param(&self, key: &str) -> MasterResult<Option<Value>> {
        Ok(if_granted(self.raw(PARAMETER, [text(key)]).await?))
    }
}

impl SystemState {
    /// Reads the answer of [`SYSTEM_STATE`].
    pub(super) fn of(reply: Reply) -> MasterResult<Self> {
        let (publishers, subscribers, services) = shaped(SYSTEM_STATE, reply)?;
        Ok(Self { publishers, subscribers, services })
    }
}

/// Value of a reply.
fn granted(method: &'static str, reply: Reply) -> MasterResult<Value> {
    let Reply { status, text: reason, value } = reply;
    if status == SUCCESS { Ok(value) } else { Err(MasterError::Refused { method, reason }) }
}

/// Value of a reply, `None` where the master has none.
pub(super) fn if_granted(reply: Reply) -> Option<Value> {
    (reply.status == SUCCESS).then_some(reply.value)
}

/// Value of a reply, of the shape `T`.
pub(super) fn shaped<T: TryFromValue>(method: &'static str, reply: Reply) -> MasterResult<T> {
    let value = granted(method, reply)?;
    T::try_from_value(&value).map_err(|_shape| odd(method, &value))
}

fn odd(method: &'static str, value: &Value) -> MasterError {
    MasterError::Odd { method, actual: shortened(&format!("{value:?}")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_waited_for_is_named_first() {
        let uri = "http://127.0.0.1:11311".to_owned();
        let what = "does not answer: refused".to_owned();
        let at = NodeUri::parse(&uri).unwrap();
        let gone = HttpError { uri: uri.clone(), what, is_refused: true };
        let text = "master http://127.0.0.1:11311 (it does not answer: refused)";
        let gone = MasterError::from(gone).cause(&at);
        assert_eq!(
            (gone.to_string().as_str(), gone.subject().as_str()),
            (text, "http://127.0.0.1:11311")
        );
        let what = "did not answer x within 5 s".to_owned();
        let slow = HttpError { uri, what, is_refused: false };
        let text = "master http://127.0.0.1:11311 (it did not answer x within 5 s)";
        assert_eq!(MasterError::from(slow).cause(&at).to_string(), text);
        let no = MasterError::Refused { method: "x", reason: "no".to_owned() };
        assert!(no.cause(&at).to_string().starts_with("the master to answer otherwise: "));
        assert_eq!(no.cause(&at).subject(), at.to_string());
    }
}
