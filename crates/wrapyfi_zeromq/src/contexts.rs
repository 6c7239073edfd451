//! Contexts of libzmq, as many as the sockets need.
//!
//! A context has room for 1023 sockets unless it is told otherwise before its first one, for which the crate `zmq`
//! has no call. Each endpoint takes three sockets, so 341 endpoints fill one.

use std::fs::File;

use super::config::NAME;
use wrapyfi_endpoint::{Mutex, OpenError};

/// Descriptors that must be free before a context is made: libzmq ends the process where its threads find none.
const SPARE_FILES: usize = 16;

/// The contexts of one instance.
#[derive(Default)]
pub(super) struct Contexts(Mutex<Vec<zmq::Context>>);

impl Contexts {
    /// Opens sockets that belong together in one context: the first with room, or a new one.
    ///
    /// # Errors
    /// The error of libzmq; `EMFILE` where the process may not open more files.
    pub(super) fn open<T>(&self, open: impl Fn(&zmq::Context) -> zmq::Result<T>) -> zmq::Result<T> {
        let mut contexts = self.0.lock();
        for context in contexts.iter() {
            match open(context) {
                Err(zmq::Error::EMFILE) => {}
                other => return other,
            }
        }
        let spare: Vec<_> = (0..SPARE_FILES).map_while(|_| File::open("/dev/null").ok()).collect();
        if spare.len() < SPARE_FILES {
            return Err(zmq::Error::EMFILE);
        }
        drop(spare);
        let context = zmq::Context::new();
        let opened = open(&context)?;
        contexts.push(context);
        Ok(opened)
    }
}

/// A refusal in words, with the remedy where there is one.
pub(super) fn reason(error: zmq::Error) -> String {
    match error {
        zmq::Error::EMFILE => {
            "the process is at its limit of open files: raise that (ulimit -n, LimitNOFILE)"
                .to_owned()
        }
        other => other.to_string(),
    }
}

/// Error of an endpoint of a topic or service `name` whose socket was refused.
pub(super) fn refused(name: &str, error: zmq::Error) -> OpenError {
    OpenError::transport(NAME, name, reason(error))
}
