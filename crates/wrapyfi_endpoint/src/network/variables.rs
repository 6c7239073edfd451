//! Settings of a middleware from variables of the environment.

use super::is_on;

/// Error of a variable whose value means nothing.
///
/// ```
/// use wrapyfi_endpoint::network::Variables;
/// let settings = Variables(|_| Ok(Some("many".to_owned())));
/// let error = settings.port("WRAPYFI_ZEROMQ_SOCKET_PUB_PORT", 5555).unwrap_err();
/// assert!(error.to_string().ends_with("=\"many\" is not a port: write a number from 1 to 65535"));
/// ```
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct VariableError(String);

/// Value of a variable, where it is set.
///
/// # Errors
/// When it is not text.
pub fn variable(name: &'static str) -> Result<Option<String>, VariableError> {
    match std::env::var(name) {
        Ok(value) => Ok(Some(value)),
        Err(std::env::VarError::NotPresent) => Ok(None),
        Err(std::env::VarError::NotUnicode(_)) => {
            Err(VariableError(format!("{name} is not UTF-8 text")))
        }
    }
}

/// Variables as a function finds them, such as [`variable`].
///
/// ```
/// use wrapyfi_endpoint::network::Variables;
/// let settings = Variables(|name| Ok((name == "PORT").then(|| " 5560 ".to_owned())));
/// assert_eq!(settings.port("PORT", 5555)?, 5560);
/// assert_eq!(settings.port("OTHER_PORT", 5555)?, 5555);
/// assert!(settings.switch("VERBOSE", true)?);
/// # Ok::<(), wrapyfi_endpoint::network::VariableError>(())
/// ```
pub struct Variables<F>(pub F);

impl<F: Fn(&'static str) -> Result<Option<String>, VariableError>> Variables<F> {
    /// Value without blanks around it.
    ///
    /// # Errors
    /// When it is set to nothing, or not text.
    pub fn text(&self, name: &'static str) -> Result<Option<String>, VariableError> {
        match (self.0)(name)? {
            Some(value) if value.trim().is_empty() => {
                Err(VariableError(format!("{name} is set to nothing: give it a value or unset it")))
            }
            found => Ok(found.map(|value| value.trim().to_owned())),
        }
    }

    /// Number of a port.
    ///
    /// # Errors
    /// As [`Self::text`], and when it is no port.
    pub fn port(&self, name: &'static str, default: u16) -> Result<u16, VariableError> {
        let Some(value) = self.text(name)? else { return Ok(default) };
        let port = value.parse().ok().filter(|port| *port > 0);
        let fault = || format!("{name}={value:?} is not a port: write a number from 1 to 65535");
        port.ok_or_else(|| VariableError(fault()))
    }

    /// True where it is switched on.
    ///
    /// # Errors
    /// As [`Self::text`], and when it is neither `True` nor `False`.
    pub fn switch(&self, name: &'static str, default: bool) -> Result<bool, VariableError> {
        let Some(value) = self.text(name)? else { return Ok(default) };
        let fault = || format!("{name}={value:?} is neither True nor False");
        is_on(&value).ok_or_else(|| VariableError(fault()))
    }
}
