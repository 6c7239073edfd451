//! Addresses of endpoints, `middleware:/name`, as routes and commands write them.

use std::fmt;
use std::str::FromStr;

/// An endpoint as routes and commands name it, for instance `zeromq:/camera`.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_endpoint as endpoint; }
/// use wrapyfi_core::endpoint::EndpointAddress;
/// let address: EndpointAddress = "ros2:/chatter".parse()?;
/// assert_eq!((address.middleware.as_str(), address.name.as_str()), ("ros2", "/chatter"));
/// # Ok::<(), wrapyfi_endpoint::ParseAddressError>(())
/// ```
#[derive(Debug, Clone, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct EndpointAddress {
    /// Name of the middleware: `zeromq`, `ros2`, …
    pub middleware: String,
    /// Name of the topic or service in that middleware.
    pub name: String,
}

/// Error of reading an endpoint address.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_endpoint as endpoint; }
/// use wrapyfi_core::endpoint::EndpointAddress;
/// let error = "camera".parse::<EndpointAddress>().unwrap_err();
/// assert!(error.to_string().starts_with("endpoint \"camera\" names no middleware: write the name"));
/// ```
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ParseAddressError {
    /// The text names no middleware before the name.
    #[error("endpoint {0:?} names no middleware: write the name of one before it, middleware:{0}")]
    NoMiddleware(String),
    /// The text has no name behind the middleware.
    #[error("endpoint {0:?} names no topic: write it as middleware:/name, for instance {0}/camera")]
    NoName(String),
}

impl FromStr for EndpointAddress {
    type Err = ParseAddressError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text.split_once(':') {
            Some((middleware, name)) if !middleware.is_empty() && !middleware.contains('/') => {
                if name.is_empty() {
                    return Err(ParseAddressError::NoName(text.to_owned()));
                }
                Ok(Self { middleware: middleware.to_owned(), name: name.to_owned() })
            }
            _ => Err(ParseAddressError::NoMiddleware(text.to_owned())),
        }
    }
}

impl fmt::Display for EndpointAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.middleware, self.name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_missing_is_named() {
        assert_eq!(
            "/camera".parse::<EndpointAddress>(),
            Err(ParseAddressError::NoMiddleware("/camera".into()))
        );
        assert_eq!(
            "ros2:".parse::<EndpointAddress>(),
            Err(ParseAddressError::NoName("ros2:".into()))
        );
        assert!("/a:b".parse::<EndpointAddress>().is_err());
        let relative: EndpointAddress = "ros2:chatter".parse().unwrap();
        assert_eq!(relative.to_string(), "ros2:chatter");
    }
}
