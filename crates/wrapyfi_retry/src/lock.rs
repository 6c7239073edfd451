//! A lock that outlives the panic of a thread that holds it.

use std::sync::{MutexGuard, PoisonError, TryLockError};

/// Mutex whose value is still used after a thread has panicked while it held the lock: the panic is contained where it
/// happened, and the others go on.
#[derive(Debug, Default)]
pub struct Mutex<T>(std::sync::Mutex<T>);

impl<T> Mutex<T> {
    /// Mutex of `value`.
    pub const fn new(value: T) -> Self {
        Self(std::sync::Mutex::new(value))
    }

    /// Waits for the lock.
    pub fn lock(&self) -> MutexGuard<'_, T> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes the lock where it is free.
    pub fn try_lock(&self) -> Option<MutexGuard<'_, T>> {
        match self.0.try_lock() {
            Ok(value) => Some(value),
            Err(TryLockError::Poisoned(poisoned)) => Some(poisoned.into_inner()),
            Err(TryLockError::WouldBlock) => None,
        }
    }

    /// The value, locked for its holder alone.
    pub fn get_mut(&mut self) -> &mut T {
        self.0.get_mut().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_value_outlives_a_panic_under_the_lock() {
        let number = Mutex::new(1);
        let panicked = crate::contained(|| {
            let mut number = number.lock();
            *number = 2;
            panic!("on purpose");
        });
        assert_eq!(panicked.unwrap_err(), "on purpose");
        assert_eq!(*number.lock(), 2);
    }
}
