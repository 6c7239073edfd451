//! Validators, which are asked before parameters change and may refuse.
//!
//! ```text
//!   values that fit type and range ─▶ newest validator ─▶ … ─▶ oldest ─▶ set
//!                                        └─ refuses, panics ─▶ SetError::Refused, nothing is set
//! ```

use std::panic::{AssertUnwindSafe, catch_unwind};

use super::{Parameter, SetError};

/// Function that is given values before they are set; its error says why they may not be.
type Validator = Box<dyn FnMut(&[Parameter]) -> Result<(), String> + Send>;

/// The validators of one node.
#[derive(Default)]
pub(super) struct Validators(Vec<Validator>);

impl Validators {
    /// Adds a validator, which is asked before the others.
    pub(super) fn add(&mut self, validator: Validator) {
        self.0.push(validator);
    }

    /// Asks all validators until one refuses. They are foreign code: one that panics refuses, and
    /// is asked again the next time, because the program relies on it.
    pub(super) fn ask(&mut self, parameters: &[Parameter]) -> Result<(), SetError> {
        let name = || parameters.first().map(|one| one.name.clone()).unwrap_or_default();
        for validator in self.0.iter_mut().rev() {
            let answer = catch_unwind(AssertUnwindSafe(|| validator(parameters)));
            let answer = answer.unwrap_or_else(|_panic| {
                // The panic hook has written the message of the panic to standard error.
                tracing::error!(parameter = name(), "a validator of parameters panicked");
                Err("its validator panicked: nothing was set".to_owned())
            });
            answer.map_err(|reason| SetError::Refused { name: name(), reason })?;
        }
        Ok(())
    }
}
