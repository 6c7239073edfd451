//! Addresses in a configuration, checked against the middlewares that exist.

use serde_saphyr::Spanned;
use wrapyfi_data::did_you_mean;

use wrapyfi_endpoint::config::Problem;
use wrapyfi_endpoint::driver::Available;
use wrapyfi_endpoint::pattern::is_pattern;
use wrapyfi_endpoint::{EndpointAddress, ParseAddressError};

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
    middleware
        .check_name(&address.name)
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
