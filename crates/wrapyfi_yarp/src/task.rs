//! Tasks of one type, whatever they do.

use std::pin::Pin;

/// Work of a task, in a box.
pub type Task = Pin<Box<dyn Future<Output = ()> + Send>>;

/// Makes a task of a future. What tokio needs to run one is compiled for each type of future, and so once for all of these.
///
/// ```
/// let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
/// runtime.block_on(async { tokio::spawn(wrapyfi_yarp::task::erased(async {})).await }).unwrap();
/// ```
pub fn erased(task: impl Future<Output = ()> + Send + 'static) -> Task {
    Box::pin(task)
}
