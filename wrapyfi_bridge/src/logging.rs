//! Log lines on stderr, in the form ROS 2 nodes print theirs, and on `/rosout`.
//!
//! ```text
//!   tracing event ─ filter ─ level of its logger ─ flood? ─┬─▶ stderr: [INFO] [1795214428.963405000] [bridge]: text key=value,
//!                                                          │   or what a program that is not ours does with it
//!                                                          ├─▶ the node, once there is one ─▶ /rosout
//!                                                          └─▶ the log port of YARP, where one is asked for
//! ```
//!
//! Lines hold what other programs send, names and texts, and come as often as they send it: length and number are bounded
//! here, once for all lines.
//!
//! The logger of a line is the program's; of a line about a route it is a child of that, called after
//! the route: `wrapyfi_bridge.camera`.

use std::collections::HashMap;
use std::fmt;
use std::io::Write as _;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, OnceLock, PoisonError, RwLock};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use tracing::callsite::Identifier;
use tracing::{Event, Level, Subscriber, field};
use tracing_subscriber::filter::LevelFilter;
use tracing_subscriber::layer::{Context, Layer, SubscriberExt as _};
use tracing_subscriber::util::SubscriberInitExt as _;
use tracing_subscriber::{EnvFilter, reload};
use wrapyfi_endpoint::LogSink;
use wrapyfi_endpoint::Mutex;
use wrapyfi_node::{LogLevel, LogLine, args::LogLevels, logger_services::Loggers};
use wrapyfi_ros2::NodeHandle;

use crate::lines::Lines;
use crate::visible::escaped_lines;

/// Most loggers that may have a level of their own.
const MAX_LOGGERS: usize = 4096;
/// Longest name of a logger whose level is set, in bytes.
const MAX_NAME_BYTES: usize = 1024;

/// Longest text of a line in bytes; a longer one is cut, and says so.
const MAX_TEXT_BYTES: usize = 4096;
/// Most lines that one place of the program logs in [`WINDOW`]: a thousand routes that start have room, each of which says
/// that it waits for its server and then for its peers.
const MAX_OF_A_KIND: u64 = 2500;
/// Time for which lines of a kind are counted.
const WINDOW: Duration = Duration::from_secs(5);

/// The node on whose `/rosout` lines go.
static NODE: RwLock<Option<NodeHandle>> = RwLock::new(None);
/// Most lines that wait for who reads stderr.
const MAX_LINES: usize = 4096;
/// Longest time that writing the last line may take.
const LAST_WORD: Duration = Duration::from_millis(500);
/// Lines to stderr; none where the system refused a thread.
static LINES: OnceLock<Option<Lines>> = OnceLock::new();
/// The log of a middleware that has the lines, too, with its name.
static SINK: RwLock<Option<(String, Box<dyn LogSink>)>> = RwLock::new(None);
/// Levels in force, once logging has started.
static LEVELS: OnceLock<Arc<Levels>> = OnceLock::new();
/// Panics since logging was started.
static PANICS: AtomicU64 = AtomicU64::new(0);

/// Starts logging to stderr. `RUST_LOG` overrides `level`, for one module or all.
///
/// # Errors
/// When `level` is none of error, warn, info, debug and trace.
pub fn start(logger: &str, level: &str) -> Result<(), String> {
    start_as(logger, self::level(level)?, &LogLevels::default(), true);
    Ok(())
}

/// Gives every line of at least the level "info", or what `RUST_LOG` says instead, to `take`, with its level and the name of its
/// logger. `take` runs on the thread that logs, and is not to wait.
pub fn start_to(logger: &str, take: impl Fn(Level, &str, &str) + Send + Sync + 'static) {
    begin(logger, LevelFilter::INFO, &LogLevels::default(), Some(Box::new(take)));
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
    begin(logger, level, levels, stdout.then(|| Box::new(print_line) as Box<Take>));
}

fn begin(logger: &str, level: LevelFilter, levels: &LogLevels, take: Option<Box<Take>>) {
    let level = match levels.default_level() {
        LogLevel::Unset => level,
        given => severity(given),
    };
    let rust_log = std::env::var(EnvFilter::DEFAULT_ENV).unwrap_or_default();
    let unknown: Vec<_> = unknown_words(&rust_log).map(str::to_owned).collect();
    let (by_target, reload) = reload::Layer::new(EnvFilter::default());
    let levels = Arc::new(Levels {
        own: RwLock::new((level, levels.clone())),
        reload: Box::new(move |level| {
            // Fails only when the subscriber is gone, and nothing is logged then.
            _ = reload.reload(filter(level, &rust_log));
        }),
    });
    levels.apply();
    let output = Output {
        logger: logger.to_owned(),
        levels: Arc::clone(&levels),
        take,
        floods: Mutex::default(),
    };
    // Fails only where a subscriber is set already: then its owner decides, as it should.
    let set = tracing_subscriber::registry().with(by_target).with(output).try_init();
    if set.is_ok() {
        _ = LEVELS.set(levels);
        std::panic::set_hook(Box::new(|panic| {
            PANICS.fetch_add(1, Relaxed);
            tracing::error!("{panic}");
        }));
        for word in unknown {
            tracing::warn!(
                "RUST_LOG: {word:?} is no level (off, error, warn, info, debug, trace), and is taken for a module's name"
            );
        }
    }
}

/// Number of panics in this process since its log was started, of routes and of tasks that began again.
pub fn panics() -> u64 {
    PANICS.load(Relaxed)
}

/// Prints a line to stderr, after those that were logged before, and waits until it is read, for a moment.
pub fn last_word(text: &str) {
    print(format!("{}\n", escaped_lines(text)));
    finish(LAST_WORD);
}

/// Waits until all that was logged is printed, at most `limit`.
pub fn finish(limit: Duration) {
    if let Some(Some(lines)) = LINES.get() {
        lines.finish(limit);
    }
}

/// Prints a line to stderr, without waiting for who reads it.
fn print(line: String) {
    let gap = |lost: u64| format!("[WARN] {lost} lines are left out: nobody read them\n");
    match LINES.get_or_init(|| Lines::start("log", std::io::stderr(), MAX_LINES, gap).ok()) {
        Some(lines) => lines.write(line.into_bytes()),
        // A failure of stderr has nowhere to be reported.
        None => _ = std::io::stderr().write_all(line.as_bytes()),
    }
}

/// The loggers of this process, for the program that reads and sets their levels from outside.
pub fn loggers() -> Option<Arc<dyn Loggers>> {
    LEVELS.get().map(|levels| Arc::clone(levels) as Arc<dyn Loggers>)
}

/// Filter of a logger with this level.
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
    /// Level of loggers that have none of their own, and the levels of those that have one.
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

    /// True when a line of this logger goes through.
    fn permits(&self, logger: &str, level: Level) -> bool {
        let own = self.own.read().unwrap_or_else(PoisonError::into_inner);
        // Without loggers that have a level of their own, the filter has decided.
        own.1.loggers().is_empty() || level <= own.1.nearest(logger).map(severity).unwrap_or(own.0)
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

/// Sends lines to the `/rosout` of this node from now on, or nowhere with `None`.
pub fn publish_to(node: Option<NodeHandle>) {
    *NODE.write().unwrap_or_else(PoisonError::into_inner) = node;
}

/// Sends lines to the log of a middleware from now on, or not to its own any more.
pub fn write_to(middleware: &str, sink: Option<Box<dyn LogSink>>) {
    let mut now = SINK.write().unwrap_or_else(PoisonError::into_inner);
    let is_of_another = now.as_ref().is_some_and(|(name, _)| name != middleware);
    if sink.is_some() || !is_of_another {
        *now = sink.map(|sink| (middleware.to_owned(), sink));
    }
}

/// Treatment of a line: its level, the name of its logger, and its text.
type Take = dyn Fn(Level, &str, &str) + Send + Sync;

/// Prints a line as nodes of ROS 2 do.
fn print_line(level: Level, logger: &str, text: &str) {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    let (seconds, rest) = (now.as_secs(), now.subsec_nanos());
    let level = if level == Level::TRACE { Level::DEBUG } else { level };
    print(format!("[{level}] [{seconds}.{rest:09}] [{logger}]: {text}\n"));
}

/// All places that have the lines. An event is read once for all of them.
struct Output {
    /// The program's.
    logger: String,
    levels: Arc<Levels>,
    /// Prints them, or hands them on; `None` where only `/rosout` has them.
    take: Option<Box<Take>>,
    /// Numbers of lines by the place that logs them.
    floods: Mutex<HashMap<Identifier, Flood>>,
}

/// Number of lines that one place of the program has logged since an instant.
struct Flood {
    since: Instant,
    lines: u64,
}

impl Flood {
    /// Counts a line: the words behind it, `None` where it is left out.
    fn pass(&mut self, now: Instant) -> Option<String> {
        let mut before = 0;
        if now.saturating_duration_since(self.since) >= WINDOW {
            before = self.lines.saturating_sub(MAX_OF_A_KIND);
            *self = Self { since: now, lines: 0 };
        }
        self.lines += 1;
        match self.lines {
            ..MAX_OF_A_KIND if before > 0 => {
                Some(format!(" (before it {before} lines like this were left out)"))
            }
            ..MAX_OF_A_KIND => Some(String::new()),
            MAX_OF_A_KIND => {
                Some(format!(" (more lines like this are left out for {} s)", WINDOW.as_secs()))
            }
            _ => None,
        }
    }
}

/// The text, at most [`MAX_TEXT_BYTES`] of it.
fn cut(mut text: String) -> String {
    let len = text.len();
    if len > MAX_TEXT_BYTES {
        let end = (0..=MAX_TEXT_BYTES).rev().find(|at| text.is_char_boundary(*at));
        text.truncate(end.unwrap_or(0));
        text.push_str(&format!(" … ({} more bytes)", len - text.len()));
    }
    text
}

impl<S: Subscriber> Layer<S> for Output {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let metadata = event.metadata();
        let mut line = LogRecord::default();
        event.record(&mut line);
        let logger = line.logger(&self.logger);
        if !self.levels.permits(&logger, *metadata.level()) {
            return;
        }
        let now = Instant::now();
        let mut floods = self.floods.lock();
        let flood = floods.entry(metadata.callsite()).or_insert(Flood { since: now, lines: 0 });
        let passed = flood.pass(now);
        drop(floods);
        let Some(behind) = passed else { return };
        let (of_yarp, of_ros) = match *metadata.level() {
            Level::ERROR => ("ERROR", LogLevel::Error),
            Level::WARN => ("WARNING", LogLevel::Warn),
            Level::INFO => ("INFO", LogLevel::Info),
            Level::DEBUG | Level::TRACE => ("DEBUG", LogLevel::Debug),
        };
        let text = escaped_lines(&cut(line.message + &line.fields)).into_owned() + &behind;
        if let Some(take) = &self.take {
            take(*metadata.level(), &logger, &text);
        }
        // Lines of the ports about their own work are not sent through a port.
        if !(metadata.target() == "wrapyfi_yarp" || metadata.target().starts_with("wrapyfi_yarp::"))
            && let Some((_, port)) = &*SINK.read().unwrap_or_else(PoisonError::into_inner)
        {
            port.write(of_yarp, &logger, &text);
        }
        if let Some(node) = &*NODE.read().unwrap_or_else(PoisonError::into_inner) {
            node.log(LogLine {
                level: of_ros,
                logger,
                text,
                file: metadata.file().unwrap_or_default().to_owned(),
                function: metadata.target().to_owned(),
                line: metadata.line().unwrap_or_default(),
            });
        }
    }
}

/// Filter of log lines at `level`, with the directives of `RUST_LOG` beside it.
///
/// RustDDS tells in hundreds of lines what it does, at levels where a node says what matters to its
/// user: of it only warnings are shown, unless `RUST_LOG` names it. Its sender of datagrams warns of
/// each that is over 1500 bytes, as several are for every node that comes, its writers, in a kilobyte each, of readers on
/// this machine until the way to them is known: of both only errors are.
fn filter(level: LevelFilter, rust_log: &str) -> EnvFilter {
    const TALKATIVE: &str = "rustdds";
    const WARY: [&str; 2] = ["rustdds::network::udp_sender", "rustdds::rtps::writer"];
    // A module alone would turn all others off, with their warnings.
    let has_level = words_of(rust_log).any(|word| word.parse::<LevelFilter>().is_ok());
    let filter = EnvFilter::builder().parse_lossy(if has_level {
        rust_log.to_owned()
    } else {
        format!("{level},{rust_log}")
    });
    if rust_log.contains(TALKATIVE) {
        return filter;
    }
    let quiet = |name: &str, most: LevelFilter| format!("{name}={}", level.min(most)).parse().ok();
    let wary = WARY.iter().filter_map(|name| quiet(name, LevelFilter::ERROR));
    let directives = quiet(TALKATIVE, LevelFilter::WARN).into_iter().chain(wary);
    directives.fold(filter, EnvFilter::add_directive)
}

fn words_of(rust_log: &str) -> impl Iterator<Item = &str> {
    rust_log.split(',').map(str::trim).filter(|word| !word.is_empty())
}

/// Words of `RUST_LOG` that are neither a level nor look like the name of a module.
fn unknown_words(rust_log: &str) -> impl Iterator<Item = &str> {
    words_of(rust_log).filter(|word| {
        word.parse::<LevelFilter>().is_err()
            && !word.contains(['=', ':', '[', ']', '}'])
            && !["wrapyfi", "rustdds"].iter().any(|known| word.starts_with(known))
    })
}

/// The parts of an event in the order in which they are printed.
#[derive(Default)]
struct LogRecord {
    route: Option<String>,
    message: String,
    fields: String,
}

impl LogRecord {
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

impl field::Visit for LogRecord {
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
    fn panics_are_counted_that_somebody_contains() {
        start("test", "off").unwrap();
        let before = panics();
        std::thread::spawn(|| panic!("on purpose")).join().unwrap_err();
        assert_eq!(panics(), before + 1);
    }

    #[test]
    fn what_peers_make_lines_of_is_bounded_in_length_and_in_number() {
        let long = cut("é".repeat(MAX_TEXT_BYTES));
        assert!(long.len() < MAX_TEXT_BYTES + 40 && long.ends_with("é … (4096 more bytes)"));
        assert_eq!(cut("short".to_owned()), "short");
        let start = Instant::now();
        let mut flood = Flood { since: start, lines: 0 };
        let lines: Vec<_> = (0..5000).filter_map(|_| flood.pass(start)).collect();
        assert_eq!(lines.len() as u64, MAX_OF_A_KIND);
        assert!(lines.last().unwrap().contains("are left out for 5 s"), "{lines:?}");
        let next = flood.pass(start + WINDOW).unwrap();
        assert!(next.contains("2500 lines like this were left out"), "{next}");
        assert_eq!(flood.pass(start + WINDOW).unwrap(), "");
    }

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
            let mut words: Vec<_> = filter.split(',').collect();
            words.sort_unstable();
            words.join(",")
        };
        let wary = "rustdds::network::udp_sender=error,rustdds::rtps::writer=error";
        assert_eq!(words(LevelFilter::INFO, ""), format!("info,{wary},rustdds=warn"));
        assert_eq!(words(LevelFilter::TRACE, ""), format!("{wary},rustdds=warn,trace"));
        assert_eq!(words(LevelFilter::ERROR, ""), format!("error,{wary},rustdds=error"));
        let off = wary.replace("error", "off");
        assert_eq!(words(LevelFilter::OFF, ""), format!("off,{off},rustdds=off"));
        assert_eq!(words(LevelFilter::INFO, "debug"), format!("debug,{wary},rustdds=warn"));
        assert_eq!(words(LevelFilter::INFO, "rustdds=info,warn"), "rustdds=info,warn");
    }

    #[test]
    fn a_module_in_rust_log_leaves_the_level_of_the_others() {
        for (rust_log, level) in [
            ("wrapyfi_zeromq=debug", "info"),
            ("banana", "info"),
            ("wrapyfi_zeromq=debug,warn", "warn"),
            ("off", "off"),
        ] {
            let filter = filter(LevelFilter::INFO, rust_log).to_string();
            assert!(filter.split(',').any(|word| word == level), "{rust_log}: {filter}");
        }
        let unknown = |text| unknown_words(text).collect::<Vec<_>>();
        assert_eq!(unknown("banana, Warn,wrapyfi_ros2,hyper=info,3"), ["banana"]);
    }
}
