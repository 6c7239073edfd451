//! A look at the endpoints of one middleware that goes on until it has told what it has.

use std::time::{Duration, Instant};

use wrapyfi_endpoint::{DiscoverError, Discovered, Discovery};

/// Time without news after which a middleware that never says that it has told all is taken to have: nodes on
/// DDS answer a new one at once, and tell of themselves in a few rounds.
const SILENCE: Duration = Duration::from_millis(500);

/// Endpoints of one middleware, as its discovery tells them.
pub struct DiscoveryWatch {
    /// Discovery of the middleware.
    pub discovery: Box<dyn Discovery>,
    /// Endpoints that the last look found.
    pub found: Vec<Discovered>,
    /// Instant since which `found` is the same.
    unchanged_since: Instant,
}

impl DiscoveryWatch {
    /// Begins to watch; nothing is found before the first look.
    pub fn new(discovery: Box<dyn Discovery>) -> Self {
        Self { discovery, found: Vec::new(), unchanged_since: Instant::now() }
    }

    /// Looks.
    ///
    /// # Errors
    /// When the middleware tells no endpoints.
    pub fn look(&mut self) -> Result<(), DiscoverError> {
        let found = self.discovery.endpoints()?;
        if found != self.found {
            self.unchanged_since = Instant::now();
        }
        self.found = found;
        Ok(())
    }

    /// True when nothing more is to be expected.
    pub fn has_told_all(&self) -> bool {
        has_told_all(self.discovery.is_complete(), self.unchanged_since.elapsed())
    }

    /// The same for a whole list, for which programs that are slow to tell are waited for.
    pub fn has_everybody_told(&self) -> bool {
        self.discovery.has_everybody_told().unwrap_or_else(|| self.has_told_all())
    }
}

fn has_told_all(complete: Option<bool>, unchanged: Duration) -> bool {
    complete.unwrap_or(unchanged >= SILENCE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_middleware_is_believed_or_else_its_silence() {
        assert!(has_told_all(Some(true), Duration::ZERO));
        assert!(!has_told_all(Some(false), 10 * SILENCE));
        assert!(has_told_all(None, SILENCE));
        assert!(!has_told_all(None, SILENCE / 2));
    }
}
