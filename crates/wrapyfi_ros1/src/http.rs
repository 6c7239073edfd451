//! XML-RPC over HTTP: one call to another node, and the server that answers theirs.
//!
//! ```text
//!   call ─▶ connect ─▶ POST ─▶ body ─▶ Reply        each step within one time limit
//!   Answers::answer(Call) ─▶ Reply ◀─ POST ◀─ accept    so many connections at once
//! ```

use std::convert::Infallible;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use http_body_util::{BodyExt as _, Full, Limited};
use hyper::body::Incoming;
use hyper::header::{CONNECTION, CONTENT_TYPE, HOST, USER_AGENT};
use hyper::service::service_fn;
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::{TokioIo, TokioTimer};
use tokio::net::TcpStream;
use tokio::time::timeout;

use super::config::NodeUri;
use super::tcpros::{self, Port, accepted, accepting};
use super::xmlrpc::{self, Call, Reply, Value, XmlRpcError};

/// Longest time a call takes, an unreachable host's included.
pub(super) const CALL: Duration = Duration::from_secs(5);
/// Longest time that a caller takes to send its request, and to begin another.
const REQUEST: Duration = Duration::from_secs(30);
/// Most that is buffered of a request's head.
const HEAD_BYTES: usize = 64 * 1024;

/// Error of a call to another node.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub(super) enum HttpError {
    /// The address refused the connection: nobody listens there.
    #[error("{uri} does not answer: {reason}")]
    Refused { uri: String, reason: String },
    /// The node was not reached, or did not answer in time.
    #[error("{uri} {reason}")]
    Unreachable { uri: String, reason: String },
    /// The node answered with something else than XML-RPC.
    #[error("{uri} answered: {fault}")]
    Answer { uri: String, fault: XmlRpcError },
}

impl HttpError {
    /// Address of the node that was called, and the failure in words that follow `it`.
    pub(super) fn parts(&self) -> (&str, String) {
        match self {
            Self::Refused { uri, reason } => (uri, format!("does not answer: {reason}")),
            Self::Unreachable { uri, reason } => (uri, reason.clone()),
            Self::Answer { uri, fault } => (uri, format!("answered: {fault}")),
        }
    }
}

/// Calls a method of the node at `uri`.
pub(super) async fn call(
    uri: &NodeUri,
    method: &str,
    params: Vec<Value>,
) -> Result<Reply, HttpError> {
    let answer = |fault| HttpError::Answer { uri: uri.to_string(), fault };
    let unreachable = |reason: String| HttpError::Unreachable { uri: uri.to_string(), reason };
    let body = xmlrpc::encode_call(method, params).map_err(answer)?;
    let bytes = match timeout(CALL, post(uri, body)).await {
        Err(_elapsed) => {
            let text = format!("did not answer {method} within {} s", CALL.as_secs());
            return Err(unreachable(text));
        }
        Ok(Err(Failed::Refused(reason))) => {
            return Err(HttpError::Refused { uri: uri.to_string(), reason });
        }
        Ok(Err(Failed::Other(reason))) => return Err(unreachable(reason)),
        Ok(Ok(bytes)) => bytes,
    };
    xmlrpc::decode_reply(&bytes).map_err(answer)
}

/// Error of an HTTP request.
enum Failed {
    Refused(String),
    Other(String),
}

impl From<String> for Failed {
    fn from(reason: String) -> Self {
        Self::Other(reason)
    }
}

async fn post(uri: &NodeUri, body: String) -> Result<Bytes, Failed> {
    let stream = tcpros::reach(&uri.host, uri.port).await.map_err(|error| {
        if error.kind() == std::io::ErrorKind::ConnectionRefused {
            Failed::Refused(error.to_string())
        } else {
            Failed::Other(format!("does not answer: {error}"))
        }
    })?;
    // A second write that waits for the first one's acknowledgement takes 40 ms.
    stream.set_nodelay(true).map_err(|error| error.to_string())?;
    let failed = |error: hyper::Error| format!("did not answer as HTTP: {error}");
    let (mut sender, connection) =
        hyper::client::conn::http1::handshake(TokioIo::new(stream)).await.map_err(failed)?;
    let connection = Aborted(tokio::spawn(connection));
    let request = Request::builder()
        .method(Method::POST)
        .uri("/")
        .header(HOST, format!("{}:{}", uri.host, uri.port))
        .header(USER_AGENT, concat!("wrapyfi/", env!("CARGO_PKG_VERSION")))
        .header(CONTENT_TYPE, "text/xml")
        .header(CONNECTION, "close")
        .body(Full::new(Bytes::from(body)))
        .map_err(|error| error.to_string())?;
    let response = sender.send_request(request).await.map_err(failed)?;
    if response.status() != StatusCode::OK {
        return Err(format!("answered with HTTP status {}", response.status()).into());
    }
    let body = Limited::new(response.into_body(), xmlrpc::MAX_BYTES).collect().await;
    drop(connection);
    let body = body.map_err(|error| format!("broke off: {error}"))?;
    Ok(body.to_bytes())
}

/// A task that ends with its owner.
struct Aborted<T>(tokio::task::JoinHandle<T>);

impl<T> Drop for Aborted<T> {
    fn drop(&mut self) {
        self.0.abort();
    }
}

/// Source of the answers to calls on the XML-RPC server. Its function must not wait: it runs on the
/// server's task.
pub(super) trait Answers: Send + Sync + 'static {
    /// The answer; `None` where there is no such method.
    fn answer(&self, call: Call) -> Option<Reply>;
}

/// Answers whoever connects, until it is aborted.
pub(super) async fn serve(port: Arc<Port>, answers: Arc<dyn Answers>) {
    let Port { listener, places, .. } = &*port;
    let mut backoff = accepting();
    loop {
        let Ok(place) = Arc::clone(places).acquire_owned().await else { return };
        let (stream, peer) = accepted(listener, &mut backoff).await;
        let answers = Arc::clone(&answers);
        tokio::spawn(async move {
            serve_one(stream, peer, &answers).await;
            drop(place);
        });
    }
}

async fn serve_one(stream: TcpStream, peer: SocketAddr, answers: &Arc<dyn Answers>) {
    if stream.set_nodelay(true).is_err() {
        return;
    }
    let service = service_fn(|request| respond(request, peer, answers));
    let served = hyper::server::conn::http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(REQUEST)
        .max_buf_size(HEAD_BYTES)
        .serve_connection(TokioIo::new(stream), service)
        .await;
    if let Err(error) = served {
        tracing::debug!(%peer, "ROS 1: a connection to the XML-RPC port ended: {error}");
    }
}

async fn respond(
    request: Request<Incoming>,
    peer: SocketAddr,
    answers: &Arc<dyn Answers>,
) -> Result<Response<Full<Bytes>>, Infallible> {
    if request.method() != Method::POST {
        return Ok(status(StatusCode::METHOD_NOT_ALLOWED));
    }
    let body = Limited::new(request.into_body(), xmlrpc::MAX_BYTES).collect();
    let body = match timeout(REQUEST, body).await {
        Ok(Ok(body)) => body.to_bytes(),
        Ok(Err(_)) => return Ok(status(StatusCode::PAYLOAD_TOO_LARGE)),
        Err(_) => return Ok(status(StatusCode::REQUEST_TIMEOUT)),
    };
    let text = match xmlrpc::decode_call(&body) {
        Ok(call) => {
            let method = call.method.clone();
            tracing::trace!(%peer, method, "ROS 1: called");
            match answers.answer(call) {
                Some(reply) => xmlrpc::encode_reply(reply),
                None => xmlrpc::encode_fault(&format!("there is no method {method:?} here")),
            }
        }
        Err(fault) => {
            tracing::debug!(%peer, "ROS 1: a call was refused: {fault}");
            xmlrpc::encode_fault(&fault.to_string())
        }
    };
    let Ok(text) = text else { return Ok(status(StatusCode::INTERNAL_SERVER_ERROR)) };
    let mut response = Response::new(Full::new(Bytes::from(text)));
    response
        .headers_mut()
        .insert(CONTENT_TYPE, hyper::header::HeaderValue::from_static("text/xml"));
    Ok(response)
}

fn status(code: StatusCode) -> Response<Full<Bytes>> {
    let mut response = Response::new(Full::default());
    *response.status_mut() = code;
    response
}
