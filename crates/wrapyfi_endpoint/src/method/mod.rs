//! Middlewares of registered methods: started when the first value needs one, with the options of its method.

mod option;
mod source;

pub use option::{Literal, OptionError, OptionValue, Options};
pub use source::{EndpointNeeds, Source, queue_size};
