//! A master of ROS 1 for tests, and raw peers: as small as they can be.
//!
//! It answers as `rosmaster` 1.15 does where a node can tell the difference. The end-to-end tests run
//! against that one; here every test has its own, in its own process, at no cost.

use std::collections::BTreeMap;
use std::io::{Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering::SeqCst};
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use wrapyfi_data::types::{MessageType, Payload, Value as Object};
use wrapyfi_endpoint::TopicSpec;
use wrapyfi_ros1::header::Header;
use wrapyfi_ros1::xmlrpc::{self, Reply, Value, XmlRpcCall, text, texts};
use wrapyfi_ros1::{Ros1, Ros1Config};

/// A node of ours at a master.
pub(crate) fn node(master: &Master, name: &str) -> Ros1 {
    let config = Ros1Config {
        master_uri: master.uri(),
        hostname: Some("127.0.0.1".to_owned()),
        node: Some(name.to_owned()),
        ..Ros1Config::default()
    };
    Ros1::start(&config).unwrap()
}

/// A topic of texts.
pub(crate) fn plain(topic: &str) -> TopicSpec {
    TopicSpec::new(topic, MessageType::Text)
}

/// A text as a message.
pub(crate) fn said(text: &str) -> Payload {
    Object::from(text).into()
}

/// Registrations under each name: nodes and their addresses.
type Providers = BTreeMap<String, Vec<(String, String)>>;

#[derive(Default)]
struct Graph {
    publishers: Providers,
    subscribers: Providers,
    /// Nodes and addresses of services, each with the address of the service itself.
    services: BTreeMap<String, (String, String)>,
    types: BTreeMap<String, String>,
    nodes: BTreeMap<String, String>,
}

/// A master at a free port, until it is dropped.
pub(crate) struct Master {
    port: u16,
    ends: Arc<AtomicBool>,
}

impl Master {
    pub(crate) fn start() -> Self {
        Self::on(TcpListener::bind("127.0.0.1:0").unwrap())
    }

    /// Takes the place of one that ended.
    pub(crate) fn at(port: u16) -> Self {
        let deadline = Instant::now() + wrapyfi_conformance::TIMEOUT;
        loop {
            match TcpListener::bind(("127.0.0.1", port)) {
                Ok(listener) => return Self::on(listener),
                Err(error) => assert!(Instant::now() < deadline, "{error}"),
            }
            std::thread::yield_now();
        }
    }

    pub(crate) fn port(&self) -> u16 {
        self.port
    }

    fn on(listener: TcpListener) -> Self {
        let port = listener.local_addr().unwrap().port();
        let ends = Arc::new(AtomicBool::new(false));
        let graph = Arc::new(Mutex::new(Graph::default()));
        let updates = tell();
        let stop = Arc::clone(&ends);
        std::thread::spawn(move || {
            for stream in listener.incoming() {
                if stop.load(SeqCst) {
                    return;
                }
                let (graph, updates) = (Arc::clone(&graph), updates.clone());
                let Ok(stream) = stream else { continue };
                std::thread::spawn(move || serve(stream, &graph, &updates));
            }
        });
        Self { port, ends }
    }

    pub(crate) fn uri(&self) -> String {
        format!("http://127.0.0.1:{}", self.port)
    }

    pub(crate) fn ask(&self, method: &str, params: Vec<Value>) -> Reply {
        call(&self.uri(), method, params).unwrap()
    }
}

impl Drop for Master {
    fn drop(&mut self) {
        self.ends.store(true, SeqCst);
        // Wakes the thread that accepts.
        _ = TcpStream::connect(("127.0.0.1", self.port));
    }
}

/// A thread that tells nodes who publishes, in order: a slow node must not hold the master up.
fn tell() -> Sender<(String, String, Value)> {
    let (sender, updates) = channel::<(String, String, Value)>();
    std::thread::spawn(move || {
        for (node, topic, publishers) in updates {
            let params = vec![text("/master"), text(topic), publishers];
            // It may be gone.
            _ = call(&node, "publisherUpdate", params);
        }
    });
    sender
}

fn serve(mut stream: TcpStream, graph: &Mutex<Graph>, updates: &Sender<(String, String, Value)>) {
    let Some(body) = read_http(&mut stream) else { return };
    let XmlRpcCall { method, params } = xmlrpc::decode_call(&body).unwrap();
    let words: Vec<&str> = params
        .iter()
        .filter_map(|param| match param {
            Value::String(text) => Some(text.as_str()),
            _ => None,
        })
        .collect();
    let reply = answer(&method, &words, &mut graph.lock().unwrap(), updates);
    let body = xmlrpc::encode_reply(reply).unwrap();
    let head = format!("HTTP/1.1 200 OK\r\nContent-Length: {}\r\n\r\n", body.len());
    _ = stream.write_all(format!("{head}{body}").as_bytes());
}

fn answer(
    method: &str,
    words: &[&str],
    graph: &mut Graph,
    updates: &Sender<(String, String, Value)>,
) -> Reply {
    let one = Value::Integer(1);
    match (method, words) {
        ("getPid", _) => Reply::success("", Value::Integer(1)),
        ("registerSubscriber", [node, topic, kind, api]) => {
            enter(&mut graph.subscribers, topic, node, api);
            graph.nodes.insert((*node).to_owned(), (*api).to_owned());
            graph.types.entry((*topic).to_owned()).or_insert_with(|| (*kind).to_owned());
            Reply::success("", apis(&graph.publishers, topic))
        }
        ("registerPublisher", [node, topic, kind, api]) => {
            enter(&mut graph.publishers, topic, node, api);
            graph.nodes.insert((*node).to_owned(), (*api).to_owned());
            graph.types.insert((*topic).to_owned(), (*kind).to_owned());
            notify(graph, topic, updates);
            Reply::success("", apis(&graph.subscribers, topic))
        }
        ("unregisterSubscriber", [_, topic, api]) => {
            leave(&mut graph.subscribers, topic, api);
            Reply::success("", one)
        }
        ("unregisterPublisher", [_, topic, api]) => {
            leave(&mut graph.publishers, topic, api);
            notify(graph, topic, updates);
            Reply::success("", one)
        }
        ("registerService", [node, service, address, api]) => {
            graph
                .services
                .insert((*service).to_owned(), ((*node).to_owned(), (*address).to_owned()));
            graph.nodes.insert((*node).to_owned(), (*api).to_owned());
            Reply::success("", one)
        }
        ("unregisterService", [_, service, address]) => {
            if graph.services.get(*service).is_some_and(|(_, known)| known == address) {
                graph.services.remove(*service);
            }
            Reply::success("", one)
        }
        ("lookupService", [_, service]) => match graph.services.get(*service) {
            Some((_, address)) => Reply::success("", text(address)),
            None => Reply::error("no provider"),
        },
        ("lookupNode", [_, node]) => match graph.nodes.get(*node) {
            Some(api) => Reply::success("", text(api)),
            None => Reply::error("unknown node"),
        },
        ("getSystemState", _) => {
            let services = graph
                .services
                .iter()
                .map(|(name, (node, _))| Value::Array(vec![text(name), texts([node])]));
            let services = Value::Array(services.collect());
            let state = vec![owners(&graph.publishers), owners(&graph.subscribers), services];
            Reply::success("", Value::Array(state))
        }
        ("getTopicTypes", _) => {
            let types = graph.types.iter().map(|(topic, kind)| texts([topic, kind]));
            Reply::success("", Value::Array(types.collect()))
        }
        other => Reply::error(format!("the test's master has no {other:?}")),
    }
}

fn enter(providers: &mut Providers, topic: &str, node: &str, api: &str) {
    let all = providers.entry(topic.to_owned()).or_default();
    if !all.iter().any(|(_, known)| known == api) {
        all.push((node.to_owned(), api.to_owned()));
    }
}

fn leave(providers: &mut Providers, topic: &str, api: &str) {
    if let Some(all) = providers.get_mut(topic) {
        all.retain(|(_, known)| known != api);
        if all.is_empty() {
            providers.remove(topic);
        }
    }
}

fn apis(providers: &Providers, topic: &str) -> Value {
    texts(providers.get(topic).into_iter().flatten().map(|(_, api)| api))
}

fn owners(providers: &Providers) -> Value {
    let of = providers.iter().map(|(topic, all)| {
        Value::Array(vec![text(topic), texts(all.iter().map(|(node, _)| node))])
    });
    Value::Array(of.collect())
}

fn notify(graph: &Graph, topic: &str, updates: &Sender<(String, String, Value)>) {
    for (_, api) in graph.subscribers.get(topic).into_iter().flatten() {
        let publishers = apis(&graph.publishers, topic);
        updates.send((api.clone(), topic.to_owned(), publishers)).unwrap();
    }
}

/// The body of a request or of an answer.
fn read_http(stream: &mut TcpStream) -> Option<Vec<u8>> {
    stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    let mut head = Vec::new();
    while !head.ends_with(b"\r\n\r\n") {
        let mut byte = [0];
        stream.read_exact(&mut byte).ok()?;
        head.push(byte[0]);
    }
    let head = String::from_utf8(head).unwrap().to_ascii_lowercase();
    let length = head.lines().find_map(|line| line.strip_prefix("content-length:"))?;
    let mut body = vec![0; length.trim().parse().unwrap()];
    stream.read_exact(&mut body).ok()?;
    Some(body)
}

/// Calls a method of the node or master at `uri`.
pub(crate) fn call(uri: &str, method: &str, params: Vec<Value>) -> Option<Reply> {
    let address = uri.trim_start_matches("http://").trim_end_matches('/');
    let mut stream = TcpStream::connect(address).ok()?;
    let body = xmlrpc::encode_call(method, params).unwrap();
    let head = format!(
        "POST / HTTP/1.1\r\nHost: {address}\r\nContent-Type: text/xml\r\nContent-Length: {}\r\n\r\n",
        body.len()
    );
    stream.write_all(format!("{head}{body}").as_bytes()).ok()?;
    xmlrpc::decode_reply(&read_http(&mut stream)?).ok()
}

/// A TCPROS message or header, with its size.
pub(crate) fn framed(body: &[u8]) -> Vec<u8> {
    [&u32::try_from(body.len()).unwrap().to_le_bytes()[..], body].concat()
}

/// Reads what [`framed`] writes.
pub(crate) fn read_framed(stream: &mut TcpStream) -> std::io::Result<Vec<u8>> {
    let mut size = [0; 4];
    stream.read_exact(&mut size)?;
    let mut body = vec![0; u32::from_le_bytes(size) as usize];
    stream.read_exact(&mut body)?;
    Ok(body)
}

/// Opens a connection and exchanges headers.
pub(crate) fn greet(address: &str, own: &Header) -> (TcpStream, Header) {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.write_all(&own.encode().unwrap()).unwrap();
    let header = Header::decode(&read_framed(&mut stream).unwrap()).unwrap();
    (stream, header)
}

/// Address of the node's TCPROS port, as a subscriber asks for it.
pub(crate) fn data_port(node: &Ros1, topic: &str) -> String {
    let tcpros = Value::Array(vec![Value::Array(vec![text("TCPROS")])]);
    let params = vec![text("/raw"), text(topic), tcpros];
    let reply = call(&node.api_uri(), "requestTopic", params).unwrap();
    match reply.value {
        Value::Array(parts) => match parts.as_slice() {
            [_, Value::String(host), Value::Integer(port)] => format!("{host}:{port}"),
            other => panic!("{other:?}"),
        },
        other => panic!("{other:?}"),
    }
}

/// A raw publisher: a node whose only skill is to send bytes to the program that subscribes.
pub(crate) struct RawPublisher {
    subscribers: Arc<Mutex<Vec<TcpStream>>>,
}

impl RawPublisher {
    /// Publishes `topic` with these fields in its header.
    pub(crate) fn start(master: &Master, node: &str, topic: &str, fields: &Header) -> Self {
        let data = TcpListener::bind("127.0.0.1:0").unwrap();
        let data_port = data.local_addr().unwrap().port();
        let api = TcpListener::bind("127.0.0.1:0").unwrap();
        let uri = format!("http://127.0.0.1:{}/", api.local_addr().unwrap().port());
        std::thread::spawn(move || {
            for mut stream in api.incoming().map_while(Result::ok) {
                // Whatever is asked, it is where the topic is.
                if read_http(&mut stream).is_none() {
                    continue;
                }
                let port = Value::Integer(data_port.into());
                let way = Value::Array(vec![text("TCPROS"), text("127.0.0.1"), port]);
                let body = xmlrpc::encode_reply(Reply::success("", way)).unwrap();
                let head = format!("HTTP/1.1 200 OK\r\nContent-Length: {}\r\n\r\n", body.len());
                _ = stream.write_all(format!("{head}{body}").as_bytes());
            }
        });
        let subscribers = Arc::<Mutex<Vec<TcpStream>>>::default();
        let all = Arc::clone(&subscribers);
        let own = fields.encode().unwrap();
        std::thread::spawn(move || {
            for mut stream in data.incoming().map_while(Result::ok) {
                if read_framed(&mut stream).is_ok() && stream.write_all(&own).is_ok() {
                    all.lock().unwrap().push(stream);
                }
            }
        });
        let kind = fields.get("type").unwrap_or("*").to_owned();
        master.ask("registerPublisher", vec![text(node), text(topic), text(kind), text(&uri)]);
        Self { subscribers }
    }

    /// Subscribers so far.
    pub(crate) fn subscribers(&self) -> usize {
        self.subscribers.lock().unwrap().len()
    }

    /// Sends bytes as they are.
    pub(crate) fn send(&self, bytes: &[u8]) {
        for stream in &mut *self.subscribers.lock().unwrap() {
            // It may be gone.
            _ = stream.write_all(bytes);
        }
    }

    /// Closes all connections.
    pub(crate) fn hang_up(&self) {
        self.subscribers.lock().unwrap().clear();
    }
}
