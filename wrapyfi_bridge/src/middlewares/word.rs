//! The word `insecure` of a section.

use serde::Deserialize;
use wrapyfi_endpoint::network::{Insecure, Place};

/// `insecure` of a section: whether other machines may reach what listens at its address.
#[derive(Debug, Clone, Copy)]
pub struct Word(pub Insecure);

impl Default for Word {
    fn default() -> Self {
        Self(Insecure { is_allowed: false, place: Place::File })
    }
}

impl<'de> Deserialize<'de> for Word {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let is_allowed = bool::deserialize(deserializer)?;
        Ok(Self(Insecure { is_allowed, ..Self::default().0 }))
    }
}

impl Word {
    /// Adds what the section says to what the environment does.
    pub fn say(self, insecure: &mut Insecure, names_address: bool) {
        insecure.said(self.0.place, names_address, self.0.is_allowed);
    }
}
