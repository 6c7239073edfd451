//! Log lines on stderr, in the form ROS 2 nodes print theirs, and on `/rosout`.
//!
//! ```text
//!   tracing event ─ filter ─┬─▶ stderr: [INFO] [stamp] [logger]: text
//!                           └─▶ the node, once there is one ─▶ /rosout
//! ```

use std::fmt;
use std::sync::{OnceLock, PoisonError, RwLock};
use std::time::{SystemTime, UNIX_EPOCH};

use tracing::{Event, Level, Subscriber, field};
use tracing_subscriber::EnvFilter;
use tracing_subscriber::filter::LevelFilter;
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::{FmtContext, FormatEvent, FormatFields};
use tracing_subscriber::layer::{Context, Layer, SubscriberExt as _};
use tracing_subscriber::registry::LookupSpan;
use tracing_subscriber::util::SubscriberInitExt as _;
use wrapyfi_core::middleware::ros2::NodeHandle;
use wrapyfi_core::node::{LogLevel, LogLine};

/// The node on whose `/rosout` lines go.
static NODE: OnceLock<RwLock<Option<NodeHandle>>> = OnceLock::new();

/// Starts logging to stderr. `RUST_LOG` overrides `level`, for one module or all.
///
/// # Errors
/// When `level` is none of error, warn, info, debug and trace.
pub fn start(logger: &str, level: &str) -> Result<(), String> {
    start_as(logger, level, true)
}

/// As [`start`]; without `stdout` nothing is printed, and only `/rosout` has the lines.
///
/// # Errors
/// As [`start`].
pub fn start_as(logger: &str, level: &str, stdout: bool) -> Result<(), String> {
    let level: LevelFilter = level.parse().map_err(|_unparsed| {
        format!("log level {level:?} is not known; use error, warn, info, debug, trace or off")
    })?;
    let filter = filter(level, &std::env::var(EnvFilter::DEFAULT_ENV).unwrap_or_default());
    let format = RosFormat { logger: logger.to_owned() };
    let printed = tracing_subscriber::fmt::layer()
        .with_writer(std::io::stderr)
        .event_format(format)
        .with_filter(if stdout { LevelFilter::TRACE } else { LevelFilter::OFF });
    // Fails only where a subscriber is set already: then its owner decides, as it should.
    let _already_set = tracing_subscriber::registry()
        .with(filter)
        .with(printed)
        .with(Rosout { logger: logger.to_owned() })
        .try_init();
    Ok(())
}

/// Sends lines to the `/rosout` of this node from now on, or nowhere with `None`.
pub fn publish_to(node: Option<NodeHandle>) {
    let place = NODE.get_or_init(RwLock::default);
    *place.write().unwrap_or_else(PoisonError::into_inner) = node;
}

/// Lines to `/rosout`.
struct Rosout {
    logger: String,
}

impl<S: Subscriber> Layer<S> for Rosout {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let Some(place) = NODE.get() else { return };
        let node = place.read().unwrap_or_else(PoisonError::into_inner);
        let Some(node) = node.as_ref() else { return };
        let mut line = Line::default();
        event.record(&mut line);
        let metadata = event.metadata();
        node.log(LogLine {
            level: match *metadata.level() {
                Level::ERROR => LogLevel::Error,
                Level::WARN => LogLevel::Warn,
                Level::INFO => LogLevel::Info,
                Level::DEBUG | Level::TRACE => LogLevel::Debug,
            },
            logger: line.logger(&self.logger),
            text: format!("{}{}", line.message, line.fields),
            file: metadata.file().unwrap_or_default().to_owned(),
            function: metadata.target().to_owned(),
            line: metadata.line().unwrap_or_default(),
        });
    }
}

/// What is logged at `level`, with what `RUST_LOG` says beside it.
///
/// RustDDS tells in hundreds of lines what it does, at levels where a node says what matters to its
/// user: of it only warnings are shown, unless `RUST_LOG` names it. Its sender of datagrams warns of
/// each that is over 1500 bytes, as several are for every node that comes: of it only errors are.
fn filter(level: LevelFilter, rust_log: &str) -> EnvFilter {
    const TALKATIVE: &str = "rustdds";
    const SENDER: &str = "rustdds::network::udp_sender";
    let filter = EnvFilter::builder().with_default_directive(level.into()).parse_lossy(rust_log);
    if rust_log.contains(TALKATIVE) {
        return filter;
    }
    let quiet = |name: &str, most: LevelFilter| format!("{name}={}", level.min(most)).parse().ok();
    let directives = [quiet(TALKATIVE, LevelFilter::WARN), quiet(SENDER, LevelFilter::ERROR)];
    directives.into_iter().flatten().fold(filter, EnvFilter::add_directive)
}

/// `[INFO] [1795214428.963405000] [bridge]: text key=value`.
struct RosFormat {
    logger: String,
}

impl<S, N> FormatEvent<S, N> for RosFormat
where
    S: Subscriber + for<'a> LookupSpan<'a>,
    N: for<'a> FormatFields<'a> + 'static,
{
    fn format_event(
        &self,
        _: &FmtContext<'_, S, N>,
        mut out: Writer<'_>,
        event: &Event<'_>,
    ) -> fmt::Result {
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let level = match *event.metadata().level() {
            Level::ERROR => "ERROR",
            Level::WARN => "WARN",
            Level::INFO => "INFO",
            Level::DEBUG | Level::TRACE => "DEBUG",
        };
        let mut line = Line::default();
        event.record(&mut line);
        let logger = line.logger(&self.logger);
        write!(out, "[{level}] [{}.{:09}] [{logger}", now.as_secs(), now.subsec_nanos())?;
        writeln!(out, "]: {}{}", line.message, line.fields)
    }
}

/// The parts of an event in the order in which they are printed.
#[derive(Default)]
struct Line {
    route: Option<String>,
    message: String,
    fields: String,
}

impl Line {
    /// The logger: a child of the program's for a route, as ROS 2 names them.
    fn logger(&self, program: &str) -> String {
        match &self.route {
            Some(route) => format!("{program}.{route}"),
            None => program.to_owned(),
        }
    }
}

impl field::Visit for Line {
    fn record_str(&mut self, field: &field::Field, value: &str) {
        self.record_debug(field, &format_args!("{value}"));
    }

    fn record_debug(&mut self, field: &field::Field, value: &dyn fmt::Debug) {
        match field.name() {
            "message" => self.message = format!("{value:?}"),
            "route" => self.route = Some(format!("{value:?}")),
            // Files and lines of libraries that log by other means: nothing for a user.
            name if name.starts_with("log.") => {}
            name => self.fields.push_str(&format!(" {name}={value:?}")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rustdds_is_quiet_unless_it_is_asked_for() {
        let words = |level, rust_log: &str| {
            let filter = filter(level, rust_log).to_string();
            let mut words: Vec<_> = filter.split(',').map(ToOwned::to_owned).collect();
            words.sort();
            words
        };
        let sender = |level: &str| format!("rustdds::network::udp_sender={level}");
        assert_eq!(words(LevelFilter::INFO, ""), ["info", &sender("error"), "rustdds=warn"]);
        assert_eq!(words(LevelFilter::TRACE, ""), [&sender("error"), "rustdds=warn", "trace"]);
        assert_eq!(words(LevelFilter::ERROR, ""), ["error", &sender("error"), "rustdds=error"]);
        assert_eq!(words(LevelFilter::OFF, ""), ["off", &sender("off"), "rustdds=off"]);
        assert_eq!(words(LevelFilter::INFO, "debug"), ["debug", &sender("error"), "rustdds=warn"]);
        assert_eq!(words(LevelFilter::INFO, "rustdds=info,warn"), ["rustdds=info", "warn"]);
    }
}
