//! Cuts a rule (`talker:chatter:=/news`) into lexemes.
//!
//! ```text
//!   talker : chatter := / news <end>
//!   Token  │ Token   │  │ Token Eof
//!          Colon     │  Slash
//!                    Separator
//! ```
//!
//! Messages show lexemes as numbers and positions as byte indices, so both are those of ROS 2.

use super::error::RuleError;

/// One piece of a rule.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Lexeme {
    /// A character that no rule contains.
    None,
    /// End of the rule.
    Eof,
    /// `~/`
    TildeSlash,
    /// `rosservice://`
    ServiceUrl,
    /// `rostopic://`
    TopicUrl,
    /// `:` that is not `:=`
    Colon,
    /// `__node` or `__name`
    Node,
    /// `__ns`
    Namespace,
    /// `:=`
    Separator,
    /// `\1` to `\9`
    BackReference(u8),
    /// Letters, digits and single underscores.
    Token,
    /// `/`
    Slash,
    /// `*`
    WildOne,
    /// `**`
    WildMulti,
    /// `.`
    Dot,
}

impl Lexeme {
    /// The number that messages show.
    fn number(self) -> u8 {
        match self {
            Self::None => 0,
            Self::Eof => 1,
            Self::TildeSlash => 2,
            Self::ServiceUrl => 3,
            Self::TopicUrl => 4,
            Self::Colon => 5,
            Self::Node => 6,
            Self::Namespace => 7,
            Self::Separator => 8,
            Self::BackReference(digit) => 8 + digit,
            Self::Token => 18,
            Self::Slash => 19,
            Self::WildOne => 20,
            Self::WildMulti => 21,
            Self::Dot => 22,
        }
    }
}

/// Fixed words, tried in this order before anything else.
const WORDS: [(&str, Lexeme); 12] = [
    ("~/", Lexeme::TildeSlash),
    ("__node", Lexeme::Node),
    ("__name", Lexeme::Node),
    ("__ns", Lexeme::Namespace),
    ("rosservice://", Lexeme::ServiceUrl),
    ("rostopic://", Lexeme::TopicUrl),
    (":=", Lexeme::Separator),
    (":", Lexeme::Colon),
    ("**", Lexeme::WildMulti),
    ("*", Lexeme::WildOne),
    ("/", Lexeme::Slash),
    (".", Lexeme::Dot),
];

/// The first lexeme of `text` and its length in bytes.
fn lex(text: &str) -> (Lexeme, usize) {
    let Some(first) = text.chars().next() else {
        return (Lexeme::Eof, 0);
    };
    for (word, lexeme) in WORDS {
        if text.starts_with(word) {
            return (lexeme, word.len());
        }
    }
    let second = text.chars().nth(1);
    match (first, second) {
        ('\\', Some(digit @ '1'..='9')) => {
            let digit = u8::try_from(digit).map_or(0, |byte| byte - b'0');
            (Lexeme::BackReference(digit), 2)
        }
        // Two leading underscores are kept for the words above.
        ('_', Some('_')) => (Lexeme::None, 2),
        ('_' | 'a'..='z' | 'A'..='Z', _) => (Lexeme::Token, token_length(text)),
        _ => (Lexeme::None, first.len_utf8()),
    }
}

/// A token ends before a second underscore in a row.
fn token_length(text: &str) -> usize {
    let mut previous = 0_u8;
    text.bytes()
        .take_while(|&byte| {
            let inside = byte.is_ascii_alphanumeric() || (byte == b'_' && previous != b'_');
            previous = byte;
            inside
        })
        .count()
}

/// Reads a rule from left to right.
#[derive(Debug, Clone)]
pub(super) struct Cursor<'a> {
    rest: &'a str,
    position: usize,
}

impl<'a> Cursor<'a> {
    pub(super) fn new(text: &'a str) -> Self {
        Self { rest: text, position: 0 }
    }

    /// Text that has not been read.
    pub(super) fn rest(&self) -> &'a str {
        self.rest
    }

    pub(super) fn peek(&self) -> Lexeme {
        lex(self.rest).0
    }

    /// The lexeme behind the next one.
    pub(super) fn peek_second(&self) -> Lexeme {
        let mut ahead = self.clone();
        ahead.accept();
        ahead.peek()
    }

    /// Steps over the next lexeme; its text.
    pub(super) fn accept(&mut self) -> &'a str {
        let (_, length) = lex(self.rest);
        let (text, rest) = self.rest.split_at_checked(length).unwrap_or((self.rest, ""));
        self.rest = rest;
        self.position += text.len();
        text
    }

    /// Steps over the next lexeme if it is `wanted`.
    pub(super) fn expect(&mut self, wanted: Lexeme) -> Result<&'a str, RuleError> {
        let (wanted_number, got) = (wanted.number(), self.peek());
        match got {
            _ if got == wanted => Ok(self.accept()),
            Lexeme::None | Lexeme::Eof => {
                Err(RuleError::Missing { wanted: wanted_number, index: self.position })
            }
            _ => Err(RuleError::Unexpected {
                wanted: wanted_number,
                got: got.number(),
                index: self.position,
            }),
        }
    }

    /// The part of `start` that has been read since `start` was the rest.
    pub(super) fn since(&self, start: &'a str) -> &'a str {
        start.strip_suffix(self.rest).unwrap_or(start)
    }

    /// Reads `name:` if the rule starts with it.
    pub(super) fn node_prefix(&mut self) -> Option<&'a str> {
        if self.peek() != Lexeme::Token || self.peek_second() != Lexeme::Colon {
            return None;
        }
        let name = self.accept();
        self.accept();
        Some(name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lexemes(text: &str) -> Vec<(Lexeme, &str)> {
        let mut cursor = Cursor::new(text);
        let mut found = Vec::new();
        while cursor.peek() != Lexeme::Eof {
            found.push((cursor.peek(), cursor.accept()));
        }
        found
    }

    #[test]
    fn rules_fall_into_their_lexemes() {
        use Lexeme::{Colon, Dot, None, Separator, Slash, TildeSlash, Token, WildMulti};
        assert_eq!(
            lexemes("talker:~/a.b:=/c"),
            [
                (Token, "talker"),
                (Colon, ":"),
                (TildeSlash, "~/"),
                (Token, "a"),
                (Dot, "."),
                (Token, "b"),
                (Separator, ":="),
                (Slash, "/"),
                (Token, "c"),
            ]
        );
        assert_eq!(lexemes("a__b"), [(Token, "a_"), (Token, "_b")]);
        assert_eq!(lexemes("rostopic:/x").first(), Some(&(Token, "rostopic")));
        assert_eq!(lexemes("rostopic://x").first(), Some(&(Lexeme::TopicUrl, "rostopic://")));
        assert_eq!(lexemes("__nodes"), [(Lexeme::Node, "__node"), (Token, "s")]);
        assert_eq!(lexemes(r"\3**"), [(Lexeme::BackReference(3), r"\3"), (WildMulti, "**")]);
        assert_eq!(lexemes("é1"), [(None, "é"), (None, "1")]);
    }
}
