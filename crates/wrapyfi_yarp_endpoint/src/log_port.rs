//! The log of this program on a port, where `yarplogger` reads it.
//!
//! ```text
//!   YARP_FORWARD_LOG_ENABLE=1      lines ─▶ /log/MACHINE/PROGRAM/PID ══ fast_tcp ══▶ /yarplogger
//! ```
//!
//! As YARP's own programs do it, in the form of theirs. The connection is kept for as long as a logger is there.

use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};

use tokio::sync::{Mutex, mpsc};
use wrapyfi_yarp::port::PortOptions;
use wrapyfi_yarp::{Bottle, Value};

use super::link_state::LinkState;
use super::opening::until_open;
use super::options::YarpOptions;
use super::port_connection::PortConnection;
use super::shared::InstanceState;
use wrapyfi_endpoint::restart::restarted;
use wrapyfi_endpoint::{Cause, LogSink, Wake};

/// The port that YARP's programs send their log to.
const LOGGER: &str = "/yarplogger";
/// Most lines that wait until the port is open; the others are on stderr only.
const MOST: usize = 256;

/// Takes the lines of a program's log.
#[derive(Debug)]
pub(super) struct LogPort(mpsc::Sender<Bottle>);

impl LogPort {
    /// The port of this program, where the environment asks for one.
    pub(super) fn open(shared: &Arc<InstanceState>) -> Option<Self> {
        if !shared.environment.is_on("YARP_FORWARD_LOG_ENABLE") {
            return None;
        }
        let (sender, lines) = mpsc::channel(MOST);
        let (lines, kept) = (Arc::new(Mutex::new(lines)), Arc::clone(shared));
        shared.tasks.spawn_aside(restarted(
            "the log port".to_owned(),
            |_why| {},
            move || run(Arc::clone(&kept), name(), Arc::clone(&lines)),
        ));
        Some(Self(sender))
    }
}

impl LogSink for LogPort {
    fn write(&self, level: &str, component: &str, text: &str) {
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs_f64();
        let pair = |key: &str, value: Value| Value::List(Bottle::from(vec![key.into(), value]));
        let line = vec![
            pair("message", text.into()),
            pair("component", component.into()),
            pair("level", level.into()),
            pair("systemtime", now.into()),
            pair("networktime", now.into()),
        ];
        // A logger is not waited for.
        _ = self.0.try_send(Bottle::from(line));
    }
}

/// `/log/MACHINE/PROGRAM/PID`.
fn name() -> String {
    let machine = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let program = std::env::args_os().next().map(std::path::PathBuf::from).unwrap_or_default();
    let program = program.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let part = |text: &str| wrapyfi_yarp::name::environment::safe_name(text.trim());
    format!("/log/{}/{}/{}", part(&machine), part(&program), std::process::id())
}

/// Has the port open, and sends what comes.
async fn run(shared: Arc<InstanceState>, name: String, lines: Arc<Mutex<mpsc::Receiver<Bottle>>>) {
    let mut lines = lines.lock().await;
    let link_state = LinkState::new(Wake::new(), Cause::Starting("the port of the log"));
    let options = PortOptions { queue: MOST, ..PortOptions::default() };
    let open = || shared.network.open_output(&name, &options);
    let port = until_open(&shared, &name, &link_state, open).await;
    shared.own.insert(port.name());
    let wish = YarpOptions {
        carrier: Some("fast_tcp".to_owned()),
        persistent: false,
        ..YarpOptions::default()
    };
    let connection = PortConnection::to(LOGGER, port.name(), &wish);
    let changes = port.connected();
    let is_connected = || port.status().iter().any(|one| !one.incoming && one.name == LOGGER);
    let sent = async {
        let from: Value = format!("[{}]", port.name()).as_str().into();
        while let Some(line) = lines.recv().await {
            let message = Bottle::from(vec![from.clone(), line.to_text().as_str().into()]);
            if port.write_bottle(&message).is_err() {
                // Text has a form in every dialect.
                return;
            }
        }
    };
    tokio::select! {
        () = connection.keep(&shared, changes, &is_connected, &|_why| {}) => {}
        () = sent => {}
    }
    port.close().await;
}
