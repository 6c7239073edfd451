//! Output of commands on stdout.

use std::io::{self, Write};

use anyhow::Context as _;

use crate::exit::{Failure, Result};
use crate::visible::escaped_lines;

/// Prints a text and a line break, and hands it over at once: the program that reads a pipe sees each message
/// when it comes. What a terminal obeys is shown by its number, which is the same text where it is JSON.
///
/// # Errors
/// [`Failure::Unread`] when the reader has seen enough, as in `wrapyfi echo … | head`; else when it
/// cannot be printed.
pub fn line(text: &str) -> Result<()> {
    line_to(&mut io::stdout().lock(), text)
}

fn line_to(out: &mut impl Write, text: &str) -> Result<()> {
    match writeln!(out, "{}", escaped_lines(text)).and_then(|()| out.flush()) {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Err(Failure::Unread),
        printed => Ok(printed.context("cannot print")?),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exit::finish;

    /// A pipe whose reader went, or a disk that is full.
    struct Refusing(io::ErrorKind);

    impl Write for Refusing {
        fn write(&mut self, _: &[u8]) -> io::Result<usize> {
            Err(self.0.into())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn a_reader_that_went_is_no_fault() {
        let mut text = Vec::new();
        line_to(&mut text, "a").unwrap();
        assert_eq!(text, b"a\n");
        line_to(&mut text, "{\"b\":\"\u{9b}\u{202e}\"}").unwrap();
        assert_eq!(text, b"a\n{\"b\":\"\\u009b\\u202e\"}\n");
        let unread = line_to(&mut Refusing(io::ErrorKind::BrokenPipe), "a").unwrap_err();
        assert_eq!(unread.code(), 0);
        assert_eq!(finish(Err(unread)), std::process::ExitCode::SUCCESS);
        let full = line_to(&mut Refusing(io::ErrorKind::StorageFull), "a").unwrap_err();
        assert_eq!(full.code(), 1);
    }
}
