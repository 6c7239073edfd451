//! Levels of loggers from outside: the services `~/get_logger_levels` and `~/set_logger_levels`, as
//! rclcpp offers them with `enable_logger_service`.
//!
//! ```text
//!   names ─────────▶ Get ─┐
//!                         ├─▶ Loggers, the program's own
//!   names, levels ─▶ Set ─┘
//! ```

use bytes::Bytes;
use wrapyfi_interfaces::cdr::{CdrError, CdrParts};
use wrapyfi_interfaces::rcl_interfaces::msg::{LoggerLevel, SetLoggerLevelsResult};
use wrapyfi_interfaces::rcl_interfaces::srv::{
    GetLoggerLevels, GetLoggerLevels_Request, GetLoggerLevels_Response, SetLoggerLevels,
    SetLoggerLevels_Request, SetLoggerLevels_Response,
};
use wrapyfi_interfaces::{Message, Service, ServiceHashes};

use super::LogLevel;

/// The loggers of a process. An empty name stands for all that have no level of their own.
pub trait Loggers: Send + Sync {
    /// Level that the logger has of its own; [`LogLevel::Unset`] where it has none.
    fn level(&self, name: &str) -> LogLevel;

    /// Gives the logger a level of its own, or takes it away with [`LogLevel::Unset`].
    ///
    /// # Errors
    /// When the logger cannot have the level; the reason goes to the client.
    fn set_level(&self, name: &str, level: LogLevel) -> Result<(), String>;
}

node_services! {
    /// One of the services.
    LoggerService {
        Get: GetLoggerLevels = "get_logger_levels",
        Set: SetLoggerLevels = "set_logger_levels",
    }
}

impl LoggerService {
    /// Number of requests and replies that nodes keep of each service.
    pub const DEPTH: u32 = 10;

    /// Answers a request as it came from the wire.
    ///
    /// # Errors
    /// When the bytes are more than `max_bytes` or no request of this service; such a request gets
    /// no answer.
    pub fn answer(
        self,
        loggers: &dyn Loggers,
        request: &Bytes,
        max_bytes: usize,
    ) -> Result<CdrParts, CdrError> {
        Ok(match self {
            Self::Get => {
                let names = GetLoggerLevels_Request::decode(request, max_bytes)?.names;
                let level = |name: String| {
                    let level = loggers.level(&name).number().into();
                    LoggerLevel { name, level }
                };
                GetLoggerLevels_Response { levels: names.into_iter().map(level).collect() }.encode()
            }
            Self::Set => {
                let levels = SetLoggerLevels_Request::decode(request, max_bytes)?.levels;
                let set = |one: LoggerLevel| {
                    let set = set(loggers, &one);
                    let successful = set.is_ok();
                    SetLoggerLevelsResult { successful, reason: set.err().unwrap_or_default() }
                };
                SetLoggerLevels_Response { results: levels.into_iter().map(set).collect() }.encode()
            }
        })
    }
}

fn set(loggers: &dyn Loggers, wanted: &LoggerLevel) -> Result<(), String> {
    let LoggerLevel { name, level } = wanted;
    let level = LogLevel::from_number(*level).ok_or_else(|| {
        format!(
            "level {level} of logger {name} is none of 0 (unset), 10 (debug), 20 (info), 30 (warn), \
             40 (error), 50 (fatal)"
        )
    })?;
    loggers.set_level(name, level)?;
    tracing::debug!(logger = name, level = level.number(), "level set by a service call");
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use super::*;
    use crate::args::LogLevels;

    struct Own(Mutex<LogLevels>);

    impl Loggers for Own {
        fn level(&self, name: &str) -> LogLevel {
            self.0.lock().unwrap().of(name)
        }

        fn set_level(&self, name: &str, level: LogLevel) -> Result<(), String> {
            self.0.lock().unwrap().set(name, level);
            Ok(())
        }
    }

    fn asked(loggers: &Own, names: &[&str]) -> Vec<(String, u32)> {
        let names = names.iter().map(|&name| name.to_owned()).collect();
        let request = GetLoggerLevels_Request { names }.encode().to_bytes();
        let reply = LoggerService::Get.answer(loggers, &request, 1 << 16).unwrap().to_bytes();
        let levels = GetLoggerLevels_Response::decode(&reply, 1 << 16).unwrap().levels;
        levels.into_iter().map(|one| (one.name, one.level)).collect()
    }

    fn told(loggers: &Own, levels: &[(&str, u32)]) -> Vec<SetLoggerLevelsResult> {
        let levels = levels.iter().map(|&(name, level)| LoggerLevel { name: name.into(), level });
        let request = SetLoggerLevels_Request { levels: levels.collect() }.encode().to_bytes();
        let reply = LoggerService::Set.answer(loggers, &request, 1 << 20).unwrap().to_bytes();
        SetLoggerLevels_Response::decode(&reply, 1 << 20).unwrap().results
    }

    #[test]
    fn levels_are_set_and_told_each_for_itself() {
        let loggers = Own(Mutex::default());
        let results = told(&loggers, &[("bridge", 30), ("bridge.camera", 15), ("bridge.mic", 10)]);
        assert_eq!(
            results.iter().map(|one| one.successful).collect::<Vec<_>>(),
            [true, false, true]
        );
        assert!(results[1].reason.contains("level 15 of logger bridge.camera"), "{results:?}");
        let levels = asked(&loggers, &["bridge", "bridge.camera", "bridge.mic"]);
        assert_eq!(levels.iter().map(|(_, level)| *level).collect::<Vec<_>>(), [30, 0, 10]);
        assert!(told(&loggers, &[("bridge", 0)])[0].successful);
        assert_eq!(asked(&loggers, &["bridge"]), [("bridge".to_owned(), 0)]);
    }

    #[test]
    fn what_is_no_request_is_refused() {
        let loggers = Own(Mutex::default());
        let nonsense = Bytes::from_static(&[0, 1, 0, 0, 255, 255, 255, 255]);
        for service in LoggerService::ALL {
            assert!(service.answer(&loggers, &nonsense, 1 << 16).is_err());
        }
    }
}
