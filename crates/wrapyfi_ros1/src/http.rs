//! XML-RPC over HTTP: one call to another node, and the server that answers theirs.
//!
//! ```text
//!   call ─▶ connect ─▶ POST ─▶ body ─▶ Reply        all of it within one time limit
//!   call_kept ─▶ the last connection, or a new one ─▶ POST ─▶ body
//!   Answers: XmlRpcCall ─▶ Reply ◀─ POST ◀─ accept    so many connections at once
//! ```
//!
//! Bodies count in the budget of waiting bytes as they come: many that are begun and held are no way around it.

use std::convert::Infallible;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use bytes::{Bytes, BytesMut};
use http_body_util::{BodyExt as _, Full, Limited};
use hyper::body::Incoming;
use hyper::client::conn::http1::{SendRequest, handshake};
use hyper::header::{CONNECTION, CONTENT_TYPE, HOST, USER_AGENT};
use hyper::service::service_fn;
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::{TokioIo, TokioTimer};
use tokio::net::TcpStream;
use tokio::sync::OwnedSemaphorePermit;
use tokio::task::JoinSet;
use tokio::time::timeout;
use wrapyfi_retry::NewestTasks;

use super::config::NodeUri;
use super::tcpros::{self, Port, accepted, accepting};
use super::xmlrpc::{self, Reply, Value, XmlRpcCall, XmlRpcError};
use wrapyfi_endpoint::Share;

/// Longest time a call takes, an unreachable host's included.
pub(super) const CALL: Duration = Duration::from_secs(5);
/// Longest time that a caller takes to send its request, and to begin another.
const REQUEST: Duration = Duration::from_secs(30);
/// Most that is buffered of a request's head.
const HEAD_BYTES: usize = 64 * 1024;

/// Error of a call to another node.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{uri} {what}")]
pub(super) struct HttpError {
    /// Address of the node.
    pub(super) uri: String,
    /// The failure, in words that follow `it`.
    pub(super) what: String,
    /// True where the address refused the connection: no program listens there.
    pub(super) is_refused: bool,
}

/// Result of a request over HTTP.
pub(super) type HttpResult<T> = Result<T, HttpError>;

/// Calls a method of the node at `uri`.
pub(super) async fn call(uri: &NodeUri, method: &str, params: Vec<Value>) -> HttpResult<Reply> {
    decode(uri, &call_once(uri, method, params).await?)
}

/// Reads the answer of a call of the node at `uri`.
pub(super) fn decode(uri: &NodeUri, answer: &[u8]) -> HttpResult<Reply> {
    xmlrpc::decode_reply(answer).map_err(|fault| of_fault(uri, &fault))
}

fn of_fault(uri: &NodeUri, fault: &XmlRpcError) -> HttpError {
    failed(uri, format!("answered: {fault}"))
}

/// Calls a method of the node at `uri` over a connection that stays open for the next call: to open one for each costs
/// more than the call. The answer is returned as it came.
///
/// A node may have ended a connection since its last answer, and a machine that is gone ends none. So a call that fails on a kept
/// connection, or is not answered in half of the time, is made once more on a new one: the method must change nothing.
pub(super) async fn call_kept(
    kept: &mut KeptConnection,
    uri: &NodeUri,
    method: &str,
    params: Vec<Value>,
) -> HttpResult<Bytes> {
    let body = body(uri, method, params)?;
    let answered = within(uri, method, async {
        // A call that is given up takes its connection along, whose answer may still come.
        if let Some(mut open) = kept.0.take()
            && let Ok(Ok(answer)) = timeout(CALL / 2, open.post(uri, &body, true)).await
        {
            return Ok((answer, open));
        }
        let mut open = HttpConnection::open(uri).await?;
        let answer = open.post(uri, &body, true).await?;
        Ok((answer, open))
    });
    let (answer, open) = answered.await?;
    kept.0 = Some(open);
    Ok(answer)
}

async fn call_once(uri: &NodeUri, method: &str, params: Vec<Value>) -> HttpResult<Bytes> {
    let body = body(uri, method, params)?;
    within(uri, method, async { HttpConnection::open(uri).await?.post(uri, &body, false).await })
        .await
}

fn body(uri: &NodeUri, method: &str, params: Vec<Value>) -> HttpResult<Bytes> {
    let text = xmlrpc::encode_call(method, params).map_err(|fault| of_fault(uri, &fault))?;
    Ok(text.into())
}

/// Waits for a call at most as long as calls may take.
async fn within<T>(
    uri: &NodeUri,
    method: &str,
    called: impl Future<Output = HttpResult<T>>,
) -> HttpResult<T> {
    let late = || failed(uri, format!("did not answer {method} within {} s", CALL.as_secs()));
    timeout(CALL, called).await.map_err(|_elapsed| late())?
}

fn failed(uri: &NodeUri, what: String) -> HttpError {
    HttpError { uri: uri.to_string(), what, is_refused: false }
}

/// Connection to one node that is kept between calls, none before the first and after one that failed.
#[derive(Default)]
pub(super) struct KeptConnection(Option<HttpConnection>);

/// An open connection to a node's server.
struct HttpConnection {
    requests: SendRequest<Full<Bytes>>,
    /// Place among the connections whose other side has not answered yet.
    place: Option<OwnedSemaphorePermit>,
    /// The task that reads and writes.
    _task: JoinSet<hyper::Result<()>>,
}

impl HttpConnection {
    async fn open(uri: &NodeUri) -> HttpResult<Self> {
        let place = tcpros::place_to_open(&uri.host, uri.port).await;
        let stream = tcpros::reach(&uri.host, uri.port).await.map_err(|error| {
            let is_refused = error.kind() == std::io::ErrorKind::ConnectionRefused;
            HttpError { is_refused, ..failed(uri, format!("does not answer: {error}")) }
        })?;
        // A second write that waits for the first one's acknowledgement takes 40 ms.
        stream.set_nodelay(true).map_err(|error| failed(uri, error.to_string()))?;
        let (requests, connection) =
            handshake(TokioIo::new(stream)).await.map_err(|error| no_http(uri, &error))?;
        let mut task = JoinSet::new();
        task.spawn(connection);
        Ok(Self { requests, place, _task: task })
    }

    async fn post(&mut self, uri: &NodeUri, body: &Bytes, is_kept: bool) -> HttpResult<Bytes> {
        let request = Request::builder()
            .method(Method::POST)
            .uri("/")
            .header(HOST, format!("{}:{}", uri.host, uri.port))
            .header(USER_AGENT, concat!("wrapyfi/", env!("CARGO_PKG_VERSION")))
            .header(CONTENT_TYPE, "text/xml")
            .header(CONNECTION, if is_kept { "keep-alive" } else { "close" })
            .body(Full::new(body.clone()))
            .map_err(|error| failed(uri, error.to_string()))?;
        self.requests.ready().await.map_err(|error| no_http(uri, &error))?;
        let response =
            self.requests.send_request(request).await.map_err(|error| no_http(uri, &error))?;
        if response.status() != StatusCode::OK {
            return Err(failed(uri, format!("answered with HTTP status {}", response.status())));
        }
        self.place = None;
        let body = collect(response.into_body(), &Share::default()).await;
        body.map_err(|error| failed(uri, format!("broke off: {error}")))
    }
}

fn no_http(uri: &NodeUri, error: &hyper::Error) -> HttpError {
    failed(uri, format!("did not answer as HTTP: {error}"))
}

/// Error of reading a body.
#[derive(Debug, thiserror::Error)]
enum BodyError {
    #[error("too much waits in this process (limits: waiting_mib)")]
    OverBudget,
    #[error("{0}")]
    Broken(String),
}

/// Reads a body whose bytes `share` holds.
async fn collect(body: Incoming, share: &Share) -> Result<Bytes, BodyError> {
    let (mut body, mut whole) = (Limited::new(body, xmlrpc::MAX_BYTES), BytesMut::new());
    while let Some(frame) = body.frame().await {
        let frame = frame.map_err(|error| BodyError::Broken(error.to_string()))?;
        let Ok(data) = frame.into_data() else { continue };
        whole.extend_from_slice(&data);
        if !share.hold(whole.capacity()) {
            return Err(BodyError::OverBudget);
        }
    }
    Ok(whole.freeze())
}

/// Function that answers calls of a peer on the XML-RPC server, `None` where there is no such method. It must not wait:
/// it runs on the server's task.
pub(super) type Answers = dyn Fn(XmlRpcCall, SocketAddr) -> Option<Reply> + Send + Sync;

/// Answers the program that connects, until it is aborted. One connection more than may be open ends the oldest: those
/// that say nothing keep no other program out.
pub(super) async fn serve(port: Arc<Port>, answers: Arc<Answers>) {
    let Port { listener, connections, .. } = &*port;
    let (mut backoff, mut open) = (accepting(), NewestTasks::default());
    loop {
        let (stream, peer) = accepted(listener, &mut backoff).await;
        let answers = Arc::clone(&answers);
        let one = tokio::spawn(async move { serve_one(stream, peer, &*answers).await });
        open.enter(one.abort_handle(), *connections);
    }
}

async fn serve_one(stream: TcpStream, peer: SocketAddr, answers: &Answers) {
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
    answers: &Answers,
) -> Result<Response<Full<Bytes>>, Infallible> {
    if request.method() != Method::POST {
        return Ok(status(StatusCode::METHOD_NOT_ALLOWED));
    }
    // A browser says which page asks, a node never does: so no page that a user opens here reaches the node.
    if request.headers().contains_key(hyper::header::ORIGIN) {
        tracing::debug!(%peer, "ROS 1: a call from a page in a browser was refused");
        return Ok(status(StatusCode::FORBIDDEN));
    }
    let share = Share::default();
    let body = match timeout(REQUEST, collect(request.into_body(), &share)).await {
        Ok(Ok(body)) => body,
        Ok(Err(refused @ BodyError::OverBudget)) => {
            tracing::debug!(%peer, "ROS 1: a call was refused: {refused}");
            return Ok(status(StatusCode::SERVICE_UNAVAILABLE));
        }
        Ok(Err(BodyError::Broken(_))) => return Ok(status(StatusCode::PAYLOAD_TOO_LARGE)),
        Err(_) => return Ok(status(StatusCode::REQUEST_TIMEOUT)),
    };
    let text = match xmlrpc::decode_call(&body) {
        Ok(call) => {
            let method = call.method.clone();
            tracing::trace!(%peer, method, "ROS 1: called");
            match answers(call, peer) {
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

#[cfg(test)]
mod tests {
    use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
    use wrapyfi_endpoint::WAITING;

    use super::*;

    #[tokio::test]
    async fn connections_that_say_nothing_keep_nobody_out() {
        let (port, number) = Port::bind([127, 0, 0, 1].into(), 3).await.unwrap();
        let answers: Arc<Answers> = Arc::new(|_, _| Some(Reply::success("", Value::Integer(7))));
        let _server = tokio::spawn(serve(port, answers));
        let mut idle = Vec::new();
        for _ in 0..5 {
            idle.push(TcpStream::connect(("127.0.0.1", number)).await.unwrap());
        }
        let uri = NodeUri { host: "127.0.0.1".to_owned(), port: number };
        assert_eq!(call(&uri, "getPid", Vec::new()).await.unwrap().value, Value::Integer(7));
        assert_eq!(idle[0].read(&mut [0; 1]).await.unwrap(), 0, "the oldest one has ended");
    }

    /// A connection serves call after call; one that the node ended in between is replaced.
    #[tokio::test]
    async fn a_kept_connection_is_opened_anew_when_its_node_has_ended_it() {
        let (port, number) = Port::bind([127, 0, 0, 1].into(), 1).await.unwrap();
        let uri = NodeUri { host: "127.0.0.1".to_owned(), port: number };
        let callers = Arc::new(wrapyfi_endpoint::Mutex::new(Vec::new()));
        let seen = Arc::clone(&callers);
        let answers: Arc<Answers> = Arc::new(move |_, peer| {
            seen.lock().push(peer.port());
            Some(Reply::success("", Value::Integer(7)))
        });
        let server = tokio::spawn(serve(port, answers));
        let mut kept = KeptConnection::default();
        let mut asked = async || call_kept(&mut kept, &uri, "getPid", Vec::new()).await;
        let first = asked().await.unwrap();
        assert_eq!(decode(&uri, &first).unwrap().value, Value::Integer(7));
        assert_eq!(asked().await.unwrap(), first);
        // Only one connection may be open: this one ends the kept one.
        assert_eq!(call(&uri, "getPid", Vec::new()).await.unwrap().value, Value::Integer(7));
        assert_eq!(asked().await.unwrap(), first);
        let [one, two, _other, three] = *callers.lock().as_slice() else { panic!("four calls") };
        assert!(one == two && two != three, "{one} {two} {three}");
        server.abort();
    }

    /// Each test is a process of its own.
    #[tokio::test]
    async fn bodies_that_are_begun_and_held_count_in_what_may_wait() {
        const CALLS: usize = 40;
        WAITING.set_limit(8 << 20);
        let (port, number) = Port::bind([127, 0, 0, 1].into(), 256).await.unwrap();
        let answers: Arc<Answers> = Arc::new(|_, _| Some(Reply::success("", Value::Integer(7))));
        let server = tokio::spawn(serve(port, answers));
        let mut held = Vec::new();
        for _ in 0..CALLS {
            let mut one = TcpStream::connect(("127.0.0.1", number)).await.unwrap();
            one.write_all(b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 1000001\r\n\r\n")
                .await
                .unwrap();
            // Those that are refused read no more.
            _ = one.write_all(&[b' '; 1_000_000]).await;
            held.push(one);
        }
        let mut refused = 0;
        for one in &mut held {
            let mut said = [0; 12];
            let wait = Duration::from_millis(if refused == 0 { 5000 } else { 100 });
            if let Ok(Ok(_)) = timeout(wait, one.read_exact(&mut said)).await {
                assert_eq!(&said, b"HTTP/1.1 503");
                refused += 1;
            }
        }
        assert!(refused > CALLS / 2 && WAITING.used() <= 12 << 20, "{refused} {}", WAITING.used());
        let uri = NodeUri { host: "127.0.0.1".to_owned(), port: number };
        assert_eq!(call(&uri, "getPid", Vec::new()).await.unwrap().value, Value::Integer(7));
        drop(held);
        server.abort();
    }

    #[tokio::test]
    async fn a_page_in_a_browser_calls_nothing() {
        let (port, number) = Port::bind([127, 0, 0, 1].into(), 3).await.unwrap();
        let called = Arc::new(std::sync::atomic::AtomicUsize::new(0));
        let calls = Arc::clone(&called);
        let answers: Arc<Answers> = Arc::new(move |_, _| {
            calls.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
            Some(Reply::success("", Value::Integer(7)))
        });
        let _server = tokio::spawn(serve(port, answers));
        let body = "<methodCall><methodName>shutdown</methodName><params></params></methodCall>";
        let mut page = TcpStream::connect(("127.0.0.1", number)).await.unwrap();
        let request = format!(
            "POST / HTTP/1.1\r\nHost: localhost\r\nOrigin: http://elsewhere.example\r\n\
             Content-Type: text/plain\r\nContent-Length: {}\r\nConnection: close\r\n\r\n{body}",
            body.len()
        );
        page.write_all(request.as_bytes()).await.unwrap();
        let mut said = String::new();
        page.read_to_string(&mut said).await.unwrap();
        assert!(said.starts_with("HTTP/1.1 403 "), "{said}");
        assert_eq!(called.load(std::sync::atomic::Ordering::Relaxed), 0);
    }
}
