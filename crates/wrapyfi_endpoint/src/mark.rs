//! Marks that bridges put on the endpoints they make by pattern, so that bridges recognise each
//! other's endpoints and no message goes round in a circle.
//!
//! ```text
//!   ROS 1 /chatter ─▶ bridge A ─▶ ROS 2 /chatter   mark: 0196…a7:ros
//!                                      │
//!                      bridge B, ros2 ─▶ ros: came through ros, is not sent back
//! ```
//!
//! A mark names the bridge that made the endpoint, and the middlewares that its messages came
//! through. It is in the USER_DATA of endpoints on ROS 2, and in connection headers and parameters
//! on ROS 1.

use std::fmt;
use std::str::FromStr;
use std::time::{SystemTime, UNIX_EPOCH};

use serde::{Serialize, Serializer};

/// Largest number of middlewares that a mark names.
const MAX_HOPS: usize = 8;
/// Longest mark as text, in bytes.
const MAX_BYTES: usize = 256;

/// Number of the bridge that made an endpoint by pattern, and the middlewares its messages came
/// through.
///
/// ```
/// use wrapyfi_endpoint::BridgeMark;
/// let mark: BridgeMark = "0196a3b2c4d5e6f7:ros,yarp".parse()?;
/// assert!(mark.came_through("yarp") && !mark.came_through("ros2"));
/// assert_eq!(mark.to_string(), "0196a3b2c4d5e6f7:ros,yarp");
/// # Ok::<(), wrapyfi_endpoint::ParseMarkError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct BridgeMark {
    /// Number of the bridge. Of two bridges the one that began earlier has the smaller number.
    pub bridge: u64,
    /// Names of the middlewares, the first source first.
    pub path: Vec<String>,
}

/// Error of reading a mark.
///
/// ```
/// use wrapyfi_endpoint::BridgeMark;
/// let error = "ros,yarp".parse::<BridgeMark>().unwrap_err();
/// assert!(error.to_string().starts_with("\"ros,yarp\" is no mark of a bridge: it is 16 "));
/// ```
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "{text:?} is no mark of a bridge: it is 16 hexadecimal digits, a colon and up to {MAX_HOPS} names"
)]
pub struct ParseMarkError {
    text: String,
}

impl BridgeMark {
    /// Number for a bridge that begins now: milliseconds since 1970, and 16 random bits.
    pub fn number() -> u64 {
        use std::hash::{BuildHasher as _, RandomState};
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let ms = u64::try_from(since.as_millis()).unwrap_or(u64::MAX);
        (ms << 16) | (RandomState::new().hash_one(ms) & 0xFFFF)
    }

    /// True when the messages came through this middleware.
    pub fn came_through(&self, middleware: &str) -> bool {
        self.path.iter().any(|hop| hop == middleware)
    }

    /// Mark for messages that bridge `bridge` takes from `middleware`, from endpoints with these
    /// marks.
    pub fn of<'m>(
        bridge: u64,
        sources: impl IntoIterator<Item = &'m Self>,
        middleware: &str,
    ) -> Self {
        let mut path: Vec<String> = Vec::new();
        let hops = sources.into_iter().flat_map(|mark| mark.path.iter().map(String::as_str));
        for hop in hops.chain([middleware]) {
            if path.len() < MAX_HOPS && !path.iter().any(|known| known == hop) {
                path.push(hop.to_owned());
            }
        }
        Self { bridge, path }
    }
}

impl fmt::Display for BridgeMark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:016x}:{}", self.bridge, self.path.join(","))
    }
}

impl FromStr for BridgeMark {
    type Err = ParseMarkError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let wrong = || ParseMarkError { text: text.chars().take(80).collect() };
        let (number, path) = text.split_once(':').ok_or_else(wrong)?;
        let is_number = number.len() == 16 && number.bytes().all(|byte| byte.is_ascii_hexdigit());
        if text.len() > MAX_BYTES || !is_number {
            return Err(wrong());
        }
        let bridge = u64::from_str_radix(number, 16).map_err(|_e| wrong())?;
        let path: Vec<String> = path.split(',').map(str::to_owned).collect();
        let is_name = |hop: &String| {
            !hop.is_empty() && hop.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_')
        };
        if path.len() > MAX_HOPS || !path.iter().all(is_name) {
            return Err(wrong());
        }
        Ok(Self { bridge, path })
    }
}

impl Serialize for BridgeMark {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_path_grows_by_one_name_a_hop() {
        let first = BridgeMark::of(7, [], "ros");
        assert_eq!(first.to_string(), "0000000000000007:ros");
        let second = BridgeMark::of(8, [&first], "ros2");
        assert_eq!(second.path, ["ros", "ros2"]);
        assert_eq!(BridgeMark::of(9, [&first, &second], "ros").path, ["ros", "ros2"]);
    }

    #[test]
    fn an_earlier_bridge_has_the_smaller_number() {
        let first = BridgeMark::number();
        std::thread::sleep(std::time::Duration::from_millis(2));
        assert!(first < BridgeMark::number());
    }

    #[test]
    fn what_is_no_mark_is_refused() {
        let long = format!("0000000000000007:{}", "a".repeat(MAX_BYTES));
        let many = format!("0000000000000007:{}", ["a"; MAX_HOPS + 1].join(","));
        for text in [
            "",
            "7:ros",
            "000000000000000x:ros",
            "+00000000000007f:ros",
            "0000000000000007",
            "0000000000000007:a;b",
            &long,
            &many,
        ] {
            let error = text.parse::<BridgeMark>().unwrap_err().to_string();
            assert!(error.contains("no mark of a bridge"), "{error}");
        }
    }
}
