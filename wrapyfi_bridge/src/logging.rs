//! Log lines on stderr, in the form ROS 2 nodes print theirs, and on `/rosout`.
//!
//! ```text
//!   tracing event ─ filter ─ level of its logger ─┬─▶ stderr: [INFO] [stamp] [logger]: text
//!                                                 ├─▶ the node, once there is one ─▶ /rosout
//!                                                 └─▶ the log port of YARP, where one is asked for
//! ```
//!
//! The logger of a line is the program's; of a line about a route it is a child of that, called after
//! the route: `wrapyfi_bridge.camera`.

use std::fmt;
use std::io::Write;
use std::sync::{Arc, OnceLock, PoisonError, RwLock};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use tracing::{Event, Level, Subscriber, field};
use tracing_subscriber::filter::{FilterFn, LevelFilter};
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::{FmtContext, FormatEvent, FormatFields};
use tracing_subscriber::layer::{Context, Layer, SubscriberExt as _};
use tracing_subscriber::registry::LookupSpan;
use tracing_subscriber::util::SubscriberInitExt as _;
use tracing_subscriber::{EnvFilter, reload};
use wrapyfi_core::middleware::ros2::NodeHandle;
use wrapyfi_core::middleware::yarp::LogPort;
use wrapyfi_core::node::args::LogLevels;
use wrapyfi_core::node::logger_services::Loggers;
use wrapyfi_core::node::{LogLevel, LogLine};

use crate::lines::Lines;

/// Most loggers that may have a level of their own.
const MAX_LOGGERS: usize = 4096;
/// Longest name of a logger whose level is set, in bytes.
const MAX_NAME_BYTES: usize = 1024;

/// The node on whose `/rosout` lines go.
static NODE: OnceLock<RwLock<Option<NodeHandle>>> = OnceLock::new();
/// Most lines that wait for who reads stderr.
const MAX_LINES: usize = 4096;
/// How long the last line may take.
const LAST_WORD: Duration = Duration::from_millis(500);
/// Lines to stderr; none where the system refused a thread.
static LINES: OnceLock<Option<Lines>> = OnceLock::new();
/// The port of YARP that has the lines, too.
static LOG_PORT: RwLock<Option<LogPort>> = RwLock::new(None);
/// Levels in force, once logging has started.
static LEVELS: OnceLock<Arc<Levels>> = OnceLock::new();

/// Starts logging to stderr. `RUST_LOG` overrides `level`, for one module or all.
///
/// # Errors
/// When `level` is none of error, warn, info, debug and trace.
pub fn start(logger: &str, level: &str) -> Result<(), String> {
    start_as(logger, self::level(level)?, &LogLevels::default(), true);
    Ok(())
}

/// The level of this name.
///
/// # Errors
/// When it is none of error, warn, info, debug, trace and off.
pub fn level(name: &str) -> Result<LevelFilter, String> {
    name.parse().map_err(|_unparsed| {
        format!("log level {name:?} is not known; use error, warn, info, debug, trace or off")
    })
}

/// As [`start`], where loggers named in `levels` have the level given there, and its level for all
/// others goes before `level`. Without `stdout` nothing is printed, and only `/rosout` has the lines.
pub fn start_as(logger: &str, level: LevelFilter, levels: &LogLevels, stdout: bool) {
    let level = match levels.default_level() {
        LogLevel::Unset => level,
        given => severity(given),
    };
    let rust_log = std::env::var(EnvFilter::DEFAULT_ENV).unwrap_or_default();
    let (by_target, reload) = reload::Layer::new(EnvFilter::default());
    let levels = Arc::new(Levels {
        own: RwLock::new((level, levels.clone())),
        reload: Box::new(move |level| {
            // Fails only when the subscriber is gone, and nothing is logged then.
            _ = reload.reload(filter(level, &rust_log));
        }),
    });
    levels.apply();
    let format = RosFormat { logger: logger.to_owned() };
    let printed = tracing_subscriber::fmt::layer()
        .with_writer(|| Printed)
        .event_format(format)
        .with_filter(if stdout { LevelFilter::TRACE } else { LevelFilter::OFF });
    let by_logger = ByLogger { logger: logger.to_owned(), levels: Arc::clone(&levels) };
    // Fails only where a subscriber is set already: then its owner decides, as it should.
    let set =
        tracing_subscriber::registry()
            .with(by_target)
            .with(by_logger)
            .with(printed)
            .with(Rosout { logger: logger.to_owned() })
            // What ports do with a line is no line for them.
            .with(YarpLog { logger: logger.to_owned() }.with_filter(FilterFn::new(|metadata| {
                !metadata.target().starts_with("wrapyfi_yarp")
            })))
            .try_init();
    if set.is_ok() {
        _ = LEVELS.set(levels);
        std::panic::set_hook(Box::new(|panic| tracing::error!("{panic}")));
    }
}

/// Prints a line to stderr, after those that were logged before, and waits until it is read, for a moment.
pub fn last_word(text: &str) {
    _ = Printed.write_all(format!("{text}\n").as_bytes());
    finish(LAST_WORD);
}

/// Waits until all that was logged is printed, at most `limit`.
pub fn finish(limit: Duration) {
    if let Some(Some(lines)) = LINES.get() {
        lines.finish(limit);
    }
}

/// Lines to stderr, without waiting for who reads them.
struct Printed;

impl Write for Printed {
    fn write(&mut self, line: &[u8]) -> std::io::Result<usize> {
        let gap = |lost: u64| format!("[WARN] {lost} lines are left out: nobody read them\n");
        let lines =
            LINES.get_or_init(|| Lines::start("log", std::io::stderr(), MAX_LINES, gap).ok());
        match lines {
            Some(lines) => lines.write(line.to_vec()),
            // Who does not read it is not told.
            None => _ = std::io::stderr().write_all(line),
        }
        Ok(line.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

/// The loggers of this process, for whoever reads and sets their levels from outside.
#[must_use]
pub fn loggers() -> Option<Arc<dyn Loggers>> {
    LEVELS.get().map(|levels| Arc::clone(levels) as Arc<dyn Loggers>)
}

/// What a logger with this level lets through.
fn severity(level: LogLevel) -> LevelFilter {
    match level {
        LogLevel::Debug => LevelFilter::DEBUG,
        LogLevel::Unset | LogLevel::Info => LevelFilter::INFO,
        LogLevel::Warn => LevelFilter::WARN,
        // Nothing that is logged here is fatal: what ends the program is its last word.
        LogLevel::Error | LogLevel::Fatal => LevelFilter::ERROR,
    }
}

/// Levels of the loggers of this process.
struct Levels {
    /// What loggers let through that have no level of their own, and those that have one.
    own: RwLock<(LevelFilter, LogLevels)>,
    /// Lets through what any logger lets through.
    reload: Box<dyn Fn(LevelFilter) + Send + Sync>,
}

impl Levels {
    /// Makes what was changed count.
    fn apply(&self) {
        let widest = {
            let own = self.own.read().unwrap_or_else(PoisonError::into_inner);
            own.1.loggers().values().map(|level| severity(*level)).fold(own.0, LevelFilter::max)
        };
        // Outside the lock: it asks every layer again.
        (self.reload)(widest);
    }

    /// Whether a line goes through whose logger is the route's, or the program's.
    fn permits(&self, event: &Event<'_>, program: &str) -> bool {
        let own = self.own.read().unwrap_or_else(PoisonError::into_inner);
        if own.1.loggers().is_empty() {
            return true;
        }
        let mut line = Line::default();
        event.record(&mut line);
        let level = own.1.nearest(&line.logger(program)).map(severity);
        *event.metadata().level() <= level.unwrap_or(own.0)
    }
}

impl Loggers for Levels {
    fn level(&self, name: &str) -> LogLevel {
        let own = self.own.read().unwrap_or_else(PoisonError::into_inner);
        match (name.is_empty(), own.0) {
            (false, _) => own.1.of(name),
            (true, LevelFilter::DEBUG | LevelFilter::TRACE) => LogLevel::Debug,
            (true, LevelFilter::INFO) => LogLevel::Info,
            (true, LevelFilter::WARN) => LogLevel::Warn,
            (true, LevelFilter::ERROR) => LogLevel::Error,
            (true, _) => LogLevel::Fatal,
        }
    }

    fn set_level(&self, name: &str, level: LogLevel) -> Result<(), String> {
        if name.len() > MAX_NAME_BYTES {
            return Err(format!(
                "the name of the logger has {} bytes, the limit is {MAX_NAME_BYTES}",
                name.len()
            ));
        }
        {
            let mut own = self.own.write().unwrap_or_else(PoisonError::into_inner);
            let is_new = level != LogLevel::Unset && own.1.of(name) == LogLevel::Unset;
            if name.is_empty() {
                own.0 = severity(level);
            } else if is_new && own.1.loggers().len() >= MAX_LOGGERS {
                return Err(format!(
                    "{MAX_LOGGERS} loggers have a level of their own, which is the limit: set one of \
                     them to 0 first"
                ));
            } else {
                own.1.set(name, level);
            }
        }
        self.apply();
        Ok(())
    }
}

/// Lets lines through by the level of their logger.
struct ByLogger {
    logger: String,
    levels: Arc<Levels>,
}

impl<S: Subscriber> Layer<S> for ByLogger {
    fn event_enabled(&self, event: &Event<'_>, _: Context<'_, S>) -> bool {
        self.levels.permits(event, &self.logger)
    }
}

/// Sends lines to the `/rosout` of this node from now on, or nowhere with `None`.
pub fn publish_to(node: Option<NodeHandle>) {
    let place = NODE.get_or_init(RwLock::default);
    *place.write().unwrap_or_else(PoisonError::into_inner) = node;
}

/// Sends lines to a port of YARP from now on.
pub fn write_to(port: LogPort) {
    *LOG_PORT.write().unwrap_or_else(PoisonError::into_inner) = Some(port);
}

/// Lines to a port of YARP.
struct YarpLog {
    logger: String,
}

impl<S: Subscriber> Layer<S> for YarpLog {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let port = LOG_PORT.read().unwrap_or_else(PoisonError::into_inner);
        let Some(port) = port.as_ref() else { return };
        let level = match *event.metadata().level() {
            Level::ERROR => "ERROR",
            Level::WARN => "WARNING",
            Level::INFO => "INFO",
            Level::DEBUG | Level::TRACE => "DEBUG",
        };
        let mut line = Line::default();
        event.record(&mut line);
        port.write(level, &line.logger(&self.logger), &format!("{}{}", line.message, line.fields));
    }
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
    /// Name of the logger: the program's, or a child of it for a route.
    fn logger(&self, program: &str) -> String {
        match &self.route {
            Some(route) => format!("{program}.{}", logger_part(route)),
            None => program.to_owned(),
        }
    }
}

/// A route's name as a part of a logger's: letters, digits and `_`, because tools of ROS 2 take a dot
/// for the next part, and a colon or a blank for the end. `ros:/a -> ros2:/b` is `ros_a_ros2_b`.
fn logger_part(route: &str) -> String {
    let words = route.split(|c: char| !(c.is_ascii_alphanumeric() || c == '_'));
    let words: Vec<&str> = words.filter(|word| !word.is_empty()).collect();
    if words.is_empty() { "route".to_owned() } else { words.join("_") }
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
    fn loggers_of_routes_are_names_that_tools_can_write() {
        let cases = [
            ("camera", "camera"),
            ("ros:/chatter -> ros2:/lab/chatter", "ros_chatter_ros2_lab_chatter"),
            ("left eye.raw", "left_eye_raw"),
            ("ros:/(.*)", "ros"),
            ("→", "route"),
        ];
        for (route, expected) in cases {
            assert_eq!(logger_part(route), expected);
        }
    }

    #[test]
    fn the_filter_is_as_wide_as_the_widest_logger() {
        let widest = Arc::new(RwLock::new(LevelFilter::OFF));
        let told = Arc::clone(&widest);
        let reload = move |level| *told.write().unwrap() = level;
        let own = RwLock::new((LevelFilter::INFO, LogLevels::default()));
        let levels = Levels { own, reload: Box::new(reload) };
        let set = |name: &str, level| {
            levels.set_level(name, level).unwrap();
            *widest.read().unwrap()
        };
        assert_eq!(set("bridge.mic", LogLevel::Warn), LevelFilter::INFO);
        assert_eq!(set("bridge.camera", LogLevel::Debug), LevelFilter::DEBUG);
        assert_eq!(set("bridge.camera", LogLevel::Unset), LevelFilter::INFO);
        assert_eq!(set("", LogLevel::Error), LevelFilter::WARN);
        assert_eq!(["", "bridge.mic", "x"].map(|name| levels.level(name).number()), [40, 30, 0]);
        let long = levels.set_level(&"x".repeat(1025), LogLevel::Info).unwrap_err();
        assert!(long.contains("1025 bytes, the limit is 1024"), "{long}");
    }

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
