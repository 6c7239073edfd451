//! Log lines on stderr, in the form ROS 2 nodes print theirs.

use std::fmt;
use std::time::{SystemTime, UNIX_EPOCH};

use tracing::{Event, Level, Subscriber, field};
use tracing_subscriber::EnvFilter;
use tracing_subscriber::filter::LevelFilter;
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::{FmtContext, FormatEvent, FormatFields};
use tracing_subscriber::registry::LookupSpan;

/// Starts logging to stderr. `RUST_LOG` overrides `level`, for one module or all.
///
/// # Errors
/// When `level` is none of error, warn, info, debug and trace.
pub fn start(logger: &str, level: &str) -> Result<(), String> {
    let level: LevelFilter = level.parse().map_err(|_unparsed| {
        format!("log level {level:?} is not known; use error, warn, info, debug, trace or off")
    })?;
    let filter = filter(level, &std::env::var(EnvFilter::DEFAULT_ENV).unwrap_or_default());
    let format = RosFormat { logger: logger.to_owned() };
    // Fails only where a subscriber is set already: then its owner decides, as it should.
    let _already_set = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .event_format(format)
        .try_init();
    Ok(())
}

/// What is logged at `level`, with what `RUST_LOG` says beside it.
///
/// RustDDS tells in hundreds of lines what it does, at levels where a node says what matters to its
/// user: of it only warnings are shown, unless `RUST_LOG` names it.
fn filter(level: LevelFilter, rust_log: &str) -> EnvFilter {
    const TALKATIVE: &str = "rustdds";
    let filter = EnvFilter::builder().with_default_directive(level.into()).parse_lossy(rust_log);
    if rust_log.contains(TALKATIVE) {
        return filter;
    }
    match format!("{TALKATIVE}={}", level.min(LevelFilter::WARN)).parse() {
        Ok(quiet) => filter.add_directive(quiet),
        Err(_) => filter,
    }
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
        write!(out, "[{level}] [{}.{:09}] [{}", now.as_secs(), now.subsec_nanos(), self.logger)?;
        if let Some(route) = &line.route {
            write!(out, ".{route}")?;
        }
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

impl field::Visit for Line {
    fn record_str(&mut self, field: &field::Field, value: &str) {
        self.record_debug(field, &format_args!("{value}"));
    }

    fn record_debug(&mut self, field: &field::Field, value: &dyn fmt::Debug) {
        match field.name() {
            "message" => self.message = format!("{value:?}"),
            // A child logger per route, as ROS 2 names them.
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
        assert_eq!(words(LevelFilter::INFO, ""), ["info", "rustdds=warn"]);
        assert_eq!(words(LevelFilter::TRACE, ""), ["rustdds=warn", "trace"]);
        assert_eq!(words(LevelFilter::ERROR, ""), ["error", "rustdds=error"]);
        assert_eq!(words(LevelFilter::OFF, ""), ["off", "rustdds=off"]);
        assert_eq!(words(LevelFilter::INFO, "debug"), ["debug", "rustdds=warn"]);
        assert_eq!(words(LevelFilter::INFO, "rustdds=info,warn"), ["rustdds=info", "warn"]);
    }
}
