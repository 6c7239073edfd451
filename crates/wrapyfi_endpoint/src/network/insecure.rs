//! Permission to listen where other machines reach a socket: one rule for every middleware.
//!
//! ```text
//!   environment < file < node parameter < argument, keyword     a later place goes before
//!        an address needs the word `insecure` of its own place, or of one that goes before it
//! ```
//!
//! The rule is about listening only: connecting to another machine needs no permission.

use std::net::IpAddr;

/// Place at which a setting is given.
///
/// ```
/// use wrapyfi_endpoint::network::{Insecure, Place};
/// let mut insecure = Insecure::default();
/// insecure.said(Place::Keyword, true, false);
/// let error = insecure.check("zeromq", "the broker", "0.0.0.0".parse()?).unwrap_err();
/// assert_eq!(error.remedy, "pass insecure=true beside it"); // where the address was given
/// # Ok::<(), std::net::AddrParseError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Place {
    /// No place: the setting is a default, or follows from the address of the master or name
    /// server.
    #[default]
    Default,
    /// A variable of the environment.
    Environment,
    /// The configuration file.
    File,
    /// A parameter of the node.
    Parameter,
    /// An argument of the command line.
    Argument,
    /// A keyword of a registered method.
    Keyword,
}

/// Permission to listen on addresses that other machines reach, where nothing is authenticated or
/// encrypted.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_endpoint::network; }
/// use wrapyfi_core::network::Insecure;
/// assert!(!Insecure::default().is_allowed);
/// let in_the_lab: Insecure = true.into();
/// assert!(in_the_lab.is_allowed);
/// ```
#[derive(Debug, Clone, Copy, Default)]
pub struct Insecure {
    /// True when the word `insecure` was given at a place that counts.
    pub is_allowed: bool,
    /// Place at which the address was given.
    #[doc(hidden)]
    pub place: Place,
}

/// Equal where they permit the same: the place where a word was said makes no other setting of it.
impl PartialEq for Insecure {
    fn eq(&self, other: &Self) -> bool {
        self.is_allowed == other.is_allowed
    }
}

impl Eq for Insecure {}

impl From<bool> for Insecure {
    fn from(is_allowed: bool) -> Self {
        Self { is_allowed, place: Place::Default }
    }
}

/// A socket would be open to other machines, and no setting permits it.
///
/// ```
/// use wrapyfi_endpoint::network::Insecure;
/// let error = Insecure::default().check("zeromq", "the broker", "0.0.0.0".parse()?).unwrap_err();
/// assert!(error.to_string().starts_with("the broker on 0.0.0.0 can be reached by other machines"));
/// assert!(error.remedy.contains("WRAPYFI_ZEROMQ_INSECURE=1"));
/// # Ok::<(), std::net::AddrParseError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "{what} on {ip} can be reached by other machines, and nothing is authenticated or encrypted there: \
     use 127.0.0.1, or {remedy} where the network is trusted"
)]
pub struct ReachedByOthers {
    /// Socket that would listen, in words.
    pub what: &'static str,
    /// The address.
    pub ip: IpAddr,
    /// Setting that permits it, at the place where the address was given.
    pub remedy: String,
}

impl Insecure {
    /// Takes over the settings of one place. Call it in the order of the places, the one with
    /// precedence last.
    ///
    /// ```
    /// use wrapyfi_endpoint::network::{Insecure, Place};
    /// let open = "192.168.1.7".parse()?;
    /// let mut insecure = Insecure::default();
    /// insecure.said(Place::File, true, false); // the file names the address
    /// assert!(insecure.check("zeromq", "the broker", open).is_err());
    /// insecure.said(Place::Argument, false, true); // the command line permits it
    /// assert!(insecure.check("zeromq", "the broker", open).is_ok());
    /// # Ok::<(), std::net::AddrParseError>(())
    /// ```
    #[doc(hidden)]
    pub fn said(&mut self, place: Place, names_address: bool, is_insecure: bool) {
        if names_address {
            *self = Self { is_allowed: is_insecure, place };
        } else {
            self.is_allowed |= is_insecure;
        }
    }

    /// Applies the rule. `middleware` is the name of its section in the configuration, such as
    /// `zeromq`.
    ///
    /// # Errors
    /// When the address is open to others and no setting permits it; the error names the setting.
    #[doc(hidden)]
    pub fn check(
        self,
        middleware: &str,
        what: &'static str,
        ip: IpAddr,
    ) -> Result<(), ReachedByOthers> {
        if ip.is_loopback() || self.is_allowed {
            return Ok(());
        }
        let variable = format!("WRAPYFI_{}_INSECURE=1", middleware.to_ascii_uppercase());
        let in_file = format!("insecure: true under endpoints.{middleware}");
        let remedy = match self.place {
            Place::Default => {
                format!("write {in_file}, set {variable}, or give a command --insecure,")
            }
            Place::Environment => format!("set {variable}"),
            Place::File => format!("write {in_file}"),
            Place::Parameter => format!("give -p endpoints.{middleware}.insecure:=true"),
            Place::Argument => "give --insecure".to_owned(),
            Place::Keyword => "pass insecure=true beside it".to_owned(),
        };
        Err(ReachedByOthers { what, ip, remedy })
    }
}

/// Reads a switch of the environment; `None` for a value that is neither on nor off.
pub fn is_on(value: &str) -> Option<bool> {
    match value.trim().to_ascii_lowercase().as_str() {
        "true" | "1" => Some(true),
        "false" | "0" => Some(false),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const OPEN: IpAddr = IpAddr::V4(std::net::Ipv4Addr::new(192, 0, 2, 1));

    fn outcome(said: &[(Place, bool, bool)]) -> Result<(), String> {
        let mut insecure = Insecure::default();
        for (place, address, word) in said {
            insecure.said(*place, *address, *word);
        }
        insecure.check("yarp", "a port", OPEN).map_err(|error| error.to_string())
    }

    #[test]
    fn an_address_needs_the_word_of_its_own_place_or_of_one_that_goes_before_it() {
        let places = [
            (Place::Environment, "set WRAPYFI_YARP_INSECURE=1"),
            (Place::File, "write insecure: true under endpoints.yarp"),
            (Place::Parameter, "-p endpoints.yarp.insecure:=true"),
            (Place::Argument, "--insecure"),
            (Place::Keyword, "insecure=true"),
        ];
        for (place, remedy) in places {
            assert_eq!(outcome(&[(place, true, true)]), Ok(()));
            let refused = outcome(&[(place, true, false)]).unwrap_err();
            assert!(refused.contains(remedy) && refused.contains("192.0.2.1"), "{refused}");
        }
        let refused = outcome(&[(Place::Environment, false, true), (Place::File, true, false)]);
        assert!(refused.unwrap_err().contains("insecure: true"), "the file's own word is missing");
        assert_eq!(
            outcome(&[(Place::Environment, true, false), (Place::File, false, true)]),
            Ok(())
        );
        // An address that follows from another setting.
        assert_eq!(outcome(&[(Place::Environment, false, true)]), Ok(()));
        assert!(outcome(&[]).unwrap_err().contains("WRAPYFI_YARP_INSECURE=1"));
    }

    #[test]
    fn this_machine_alone_needs_no_word() {
        let local = Insecure::default().check("ros", "a node", [127, 0, 0, 2].into());
        assert_eq!(local, Ok(()));
    }
}
