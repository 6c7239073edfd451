//! Registered methods over the memory middleware: every mode, and what is said about mistakes.

mod actions;
mod mistakes;
mod modes;
mod requests;
mod robot;
