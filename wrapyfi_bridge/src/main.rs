//! The wrapyfi command.
fn main() {}
