//! Routes of a running bridge on a terminal: `wrapyfi top`.
//!
//! ```text
//!   ~/list_routes ─ reply a second ─▶ routes: rates, history, order, filter ─▶ screen ─▶ terminal
//!                                        └─▶ one table on stdout (--once)
//! ```

pub mod routes;
pub mod screen;
