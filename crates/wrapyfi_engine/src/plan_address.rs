//! Addresses in a configuration, checked against the middlewares that exist.

use serde_saphyr::Spanned;
use wrapyfi_data::did_you_mean;
use wrapyfi_data::types::Value;

use super::config_error::Problem;
use wrapyfi_endpoint::pattern::is_pattern;
use wrapyfi_endpoint::{Conventions, EndpointAddress, ParseAddressError};

/// A middleware that routes may name.
///
/// See [`Plan`](super::Plan).
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_engine as engine; }
/// use wrapyfi_core::engine::Available;
/// let must_be_absolute = |topic: &str| match topic.starts_with('/') {
///     true => Ok(()),
///     false => Err("a name begins with /".to_owned()),
/// };
/// let mine = Available { name: "mine", check_topic: &must_be_absolute, ..Available::default() };
/// assert!((mine.check_topic)("camera").is_err());
/// ```
#[derive(Clone, Copy)]
pub struct Available<'a> {
    /// Name in addresses.
    pub name: &'a str,
    /// Rule of the middleware for topic names; the error names the fault.
    pub check_topic: &'a dyn Fn(&str) -> Result<(), String>,
    /// Settings that only this middleware and few others have, as `options` of a route names them.
    pub options: &'a [&'a str],
    /// Rule of the middleware for the value of one of them; the error names the fault.
    pub check_option: &'a dyn Fn(&str, &Value) -> Result<(), String>,
    /// Those of them that only the source of a route has, because they are about what is received.
    pub source_options: &'a [&'a str],
    /// Those of them that only the destination of a route has, because they are about what is sent.
    pub destination_options: &'a [&'a str],
    /// Conventions of the middleware for types and names.
    #[doc(hidden)]
    pub conventions: Conventions,
}

impl Default for Available<'_> {
    fn default() -> Self {
        Self {
            name: "",
            check_topic: &|_| Ok(()),
            options: &[],
            check_option: &|_, _| Ok(()),
            source_options: &[],
            destination_options: &[],
            conventions: Conventions::NONE,
        }
    }
}

/// Reads the address of one topic or service.
pub(super) fn address(
    text: &Spanned<String>,
    middlewares: &[Available<'_>],
) -> Result<EndpointAddress, Problem> {
    let (address, middleware) = known(text, middlewares)?;
    let problem = |message| Problem::at(text.referenced, message);
    if is_pattern(&address.name) {
        let what = format!(
            "{:?} is a pattern, which only `from` or `service` may be; where `from` is one, this \
             refers to its groups by $1",
            text.value
        );
        return Err(problem(what));
    }
    (middleware.check_topic)(&address.name)
        .map_err(|fault| problem(format!("{:?} is no topic name: {fault}", text.value)))?;
    Ok(address)
}

/// Reads an address whose name may be a pattern, or refer to one.
pub(super) fn middleware_of(
    text: &Spanned<String>,
    middlewares: &[Available<'_>],
) -> Result<EndpointAddress, Problem> {
    known(text, middlewares).map(|(address, _)| address)
}

fn known<'m, 'a>(
    text: &Spanned<String>,
    middlewares: &'m [Available<'a>],
) -> Result<(EndpointAddress, &'m Available<'a>), Problem> {
    let problem = |message| Problem::at(text.referenced, message);
    let address: EndpointAddress =
        text.value.parse().map_err(|error: ParseAddressError| problem(error.to_string()))?;
    let Some(middleware) = middlewares.iter().find(|known| known.name == address.middleware) else {
        let names: Vec<&str> = middlewares.iter().map(|known| known.name).collect();
        let hint = did_you_mean(&address.middleware, &names);
        return Err(problem(format!(
            "{:?}: middleware {:?} is not available; {hint}available: {}",
            text.value,
            address.middleware,
            names.join(", ")
        )));
    };
    Ok((address, middleware))
}
