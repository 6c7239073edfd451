//! YAML events with their lines, and values made of them.
//!
//! ```text
//!   text ─▶ granit_parser ─▶ Events::next ─▶ value: scalar | [scalar, …]
//! ```

use granit_parser::{Event, Options, Parser, ScalarStyle, Span, StrInput, Tag, options};

use super::super::error::YamlError;
use super::scalar::{append, plain};
use wrapyfi_data::types::ParameterValue;

/// Deepest nesting of groups in a file.
pub(super) const MAX_DEPTH: usize = 64;

/// Origin of the YAML; errors about files name a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Origin {
    CommandLine,
    File,
}

/// Reads events in order.
pub(super) struct Events<'a> {
    parser: Parser<'a, StrInput<'a>>,
    text: &'a str,
    origin: Origin,
    /// Line of the latest event, for errors that have no place of their own.
    line: usize,
}

/// A scalar as written.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct RawScalar {
    text: String,
    /// True for a scalar that is quoted or tagged `!!str`, which is not read as a number.
    is_text: bool,
    quoted: bool,
    pub(super) line: usize,
}

/// Event of a parameter file's YAML.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Item {
    Scalar(RawScalar),
    SequenceStart(usize),
    SequenceEnd,
    MappingStart(usize),
    MappingEnd,
    Alias(usize),
    /// End of everything; ends of documents are skipped.
    End,
}

impl<'a> Events<'a> {
    pub(super) fn new(text: &'a str, origin: Origin) -> Self {
        let parser = Parser::new_from_str_with_options(text, parser_options());
        Self { parser, text, origin, line: 0 }
    }

    /// The next event. After [`Item::End`] there is only [`Item::End`].
    pub(super) fn next(&mut self) -> Result<Item, YamlError> {
        loop {
            let Some(event) = self.parser.next_event() else {
                return Ok(Item::End);
            };
            let (event, span) = event.map_err(|error| match self.origin {
                Origin::File => YamlError::FileSyntax { line: self.line, reason: Box::new(error) },
                Origin::CommandLine => YamlError::ValueSyntax(Box::new(error)),
            })?;
            let line = span.start.line();
            self.line = line;
            return Ok(match event {
                Event::Scalar(text, style, _, tag) => {
                    Item::Scalar(self.scalar(&text, style, tag.as_deref(), span))
                }
                Event::SequenceStart(..) => Item::SequenceStart(line),
                Event::SequenceEnd => Item::SequenceEnd,
                Event::MappingStart(..) => Item::MappingStart(line),
                Event::MappingEnd => Item::MappingEnd,
                Event::Alias(_) | Event::UnresolvedAlias(_) => Item::Alias(line),
                Event::StreamEnd => Item::End,
                _ => continue,
            });
        }
    }

    fn scalar(&self, text: &str, style: ScalarStyle, tag: Option<&Tag>, span: Span) -> RawScalar {
        let quoted = matches!(style, ScalarStyle::SingleQuoted | ScalarStyle::DoubleQuoted);
        // The parser gives `~` also for a value that is not there; only the source tells them
        // apart.
        let absent = text == "~"
            && !quoted
            && !span.slice(self.text).is_some_and(|source| source.contains('~'));
        RawScalar {
            text: if absent { String::new() } else { text.to_owned() },
            is_text: quoted || tag.and_then(Tag::core_suffix) == Some("str"),
            quoted,
            line: span.start.line(),
        }
    }

    /// The value that `first` starts.
    pub(super) fn value(&mut self, first: Item) -> Result<ParameterValue, YamlError> {
        match first {
            Item::Scalar(scalar) => scalar.typed(),
            Item::SequenceStart(_) => self.sequence(),
            other => Err(self.unknown(&other)),
        }
    }

    fn sequence(&mut self) -> Result<ParameterValue, YamlError> {
        let mut list = ParameterValue::NotSet;
        loop {
            match self.next()? {
                Item::Scalar(scalar) => {
                    let line = scalar.line;
                    append(&mut list, scalar.typed()?, line)?;
                }
                Item::SequenceEnd => return Ok(list),
                Item::SequenceStart(line) if self.origin == Origin::File => {
                    return Err(YamlError::SequenceAsKey(line));
                }
                other => return Err(self.unknown(&other)),
            }
        }
    }

    /// The value that is the whole text; of several documents the last.
    pub(super) fn whole_value(mut self) -> Result<ParameterValue, YamlError> {
        let mut value = ParameterValue::NotSet;
        loop {
            match self.next()? {
                Item::End => return Ok(value),
                first => value = self.value(first)?,
            }
        }
    }

    /// The error for an event that has no place here.
    pub(super) fn unknown(&self, item: &Item) -> YamlError {
        match (self.origin, item) {
            (Origin::CommandLine, _) => YamlError::ValueShape,
            (Origin::File, Item::Alias(line)) => YamlError::Alias(*line),
            (Origin::File, _) => YamlError::FileShape(self.line),
        }
    }
}

impl RawScalar {
    /// The text of a key.
    pub(super) fn key(&self) -> Result<&str, YamlError> {
        if self.text.is_empty() { Err(YamlError::NoKey(self.line)) } else { Ok(&self.text) }
    }

    fn typed(self) -> Result<ParameterValue, YamlError> {
        if self.text.is_empty() && !self.quoted {
            return Err(YamlError::NoValue(self.line));
        }
        Ok(if self.is_text { ParameterValue::String(self.text) } else { plain(&self.text) })
    }
}

fn parser_options() -> Options {
    options! {
        emit_comments: false,
        // Aliases are refused here, by name, whether or not their anchor exists.
        emit_unresolved_aliases: true,
        flow_nesting_limit: MAX_DEPTH,
        block_nesting_limit: MAX_DEPTH,
    }
}
