//! Rules by which bytes of YARP become values, and values become bytes.

use wrapyfi_yarp::Dialect;

use super::super::options::YarpOptions;
use super::element::Writer;
use wrapyfi_data::Limits;

/// Options of the endpoint, dialect of the bytes, and bounds on them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rules<'a> {
    pub(super) options: &'a YarpOptions,
    pub(super) dialect: Dialect,
    pub(super) limits: &'a Limits,
}

impl<'a> Rules<'a> {
    pub(super) fn new(options: &'a YarpOptions, dialect: Dialect, limits: &'a Limits) -> Self {
        Self { options, dialect, limits }
    }

    /// Writer of the elements of a bottle.
    pub(super) fn writer(self) -> Writer<'a> {
        Writer { dialect: self.dialect, limits: self.limits }
    }
}
