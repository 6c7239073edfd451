//! The text of `edit_method`: an enum as a literal of Python, which dynamic_reconfigure's own clients evaluate.
//!
//! ```text
//!   {'enum': [{'name': 'Small', 'value': 0, 'description': 'A small one', …}, …], …}  ─▶  [Choice]
//! ```

use wrapyfi_data::types::ParameterValue;

/// Deepest nesting of a literal.
const MAX_DEPTH: usize = 8;

/// A value that a parameter may have, with its name.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Choice {
    pub(super) name: String,
    pub(super) value: ParameterValue,
    pub(super) description: String,
}

/// A literal; what no enum needs is `Other`.
#[derive(Debug, Clone, PartialEq)]
enum Literal {
    Value(ParameterValue),
    List(Vec<Literal>),
    Map(Vec<(String, Literal)>),
    Other,
}

impl Literal {
    fn get(&self, key: &str) -> Option<&Self> {
        let Self::Map(entries) = self else { return None };
        entries.iter().find_map(|(known, value)| (known == key).then_some(value))
    }

    fn text(&self) -> Option<&str> {
        match self {
            Self::Value(ParameterValue::String(text)) => Some(text),
            _ => None,
        }
    }
}

/// Reads the choices of an enum.
///
/// # Errors
/// When the text is no such literal, or has no choices; in words.
pub(super) fn choices(text: &str) -> Result<Vec<Choice>, String> {
    let mut reader = Reader { rest: text };
    let literal = reader.literal(0)?;
    if let Some(more) = reader.peek() {
        return Err(format!("{more:?} follows its end"));
    }
    let Some(Literal::List(all)) = literal.get("enum") else {
        return Err("it has no list 'enum'".to_owned());
    };
    let choice = |one: &Literal| {
        let Literal::Value(value) = one.get("value")? else { return None };
        let text = |key| one.get(key).and_then(Literal::text).unwrap_or_default().to_owned();
        Some(Choice { name: text("name"), value: value.clone(), description: text("description") })
    };
    let choices: Option<Vec<Choice>> = all.iter().map(choice).collect();
    let choices = choices.ok_or("one of its constants has no value")?;
    if choices.is_empty() { Err("it has no constants".to_owned()) } else { Ok(choices) }
}

struct Reader<'t> {
    rest: &'t str,
}

impl<'t> Reader<'t> {
    fn peek(&mut self) -> Option<char> {
        self.rest = self.rest.trim_start();
        self.rest.chars().next()
    }

    fn take(&mut self, wanted: char) -> bool {
        self.peek();
        let rest = self.rest.strip_prefix(wanted);
        self.rest = rest.unwrap_or(self.rest);
        rest.is_some()
    }

    fn literal(&mut self, depth: usize) -> Result<Literal, String> {
        if depth >= MAX_DEPTH {
            return Err(format!("it nests deeper than {MAX_DEPTH}"));
        }
        Ok(match self.peek() {
            None => return Err("it ends too early".to_owned()),
            Some('{') => Literal::Map(self.items('{', '}', |reader| {
                let key = reader.literal(depth + 1)?;
                let key = key.text().ok_or("one of its keys is no text")?.to_owned();
                if !reader.take(':') {
                    return Err(format!("key {key:?} has no value"));
                }
                Ok((key, reader.literal(depth + 1)?))
            })?),
            Some('[') => Literal::List(self.items('[', ']', |it| it.literal(depth + 1))?),
            Some('(') => Literal::List(self.items('(', ')', |it| it.literal(depth + 1))?),
            Some(_) => match self.quoted()? {
                Some(text) => Literal::Value(ParameterValue::String(text)),
                None => self.word()?,
            },
        })
    }

    /// Items between two brackets, with commas between.
    fn items<T>(
        &mut self,
        begin: char,
        end: char,
        mut item: impl FnMut(&mut Self) -> Result<T, String>,
    ) -> Result<Vec<T>, String> {
        let mut items = Vec::new();
        self.take(begin);
        while !self.take(end) {
            items.push(item(self)?);
            if !self.take(',') && self.peek() != Some(end) {
                return Err(format!("a comma or {end:?} is missing"));
            }
        }
        Ok(items)
    }

    /// A text in quotes, before which Python 2 writes a `u`.
    fn quoted(&mut self) -> Result<Option<String>, String> {
        let body = self.rest.strip_prefix(['u', 'b', 'r']).unwrap_or(self.rest);
        let mut chars = body.chars();
        let Some(quote @ ('\'' | '"')) = chars.next() else { return Ok(None) };
        let mut text = String::new();
        loop {
            match chars.next() {
                None => return Err("a text has no end".to_owned()),
                Some(found) if found == quote => break,
                Some('\\') => match chars.next() {
                    Some('n') => text.push('\n'),
                    Some('t') => text.push('\t'),
                    Some(same @ ('\\' | '\'' | '"')) => text.push(same),
                    other => text.extend(['\\'].into_iter().chain(other)),
                },
                Some(other) => text.push(other),
            }
        }
        self.rest = chars.as_str();
        Ok(Some(text))
    }

    fn word(&mut self) -> Result<Literal, String> {
        let ends = |c: char| matches!(c, ',' | ':' | ']' | '}' | ')') || c.is_whitespace();
        let (word, rest) = self.rest.split_at(self.rest.find(ends).unwrap_or(self.rest.len()));
        self.rest = rest;
        let number = || word.parse().ok().map(ParameterValue::Integer);
        let number = number().or_else(|| word.parse().ok().map(ParameterValue::Double));
        Ok(match (word, number) {
            ("True", _) => Literal::Value(ParameterValue::Bool(true)),
            ("False", _) => Literal::Value(ParameterValue::Bool(false)),
            ("None", _) => Literal::Other,
            (_, Some(number)) => Literal::Value(number),
            _ => {
                return Err(format!("{:?} is no value", word.chars().take(40).collect::<String>()));
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn enums_of_the_generator_are_read() {
        let text = r#"{'enum_description': "An enum's size", 'enum': [{'srcline': 10, 'description': 'A small one',
            'srcfile': '/a\\b.cfg', 'cconsttype': 'const int', 'value': 0, 'ctype': 'int', 'type': 'int', 'name': 'Small'},
            {u'name': u'Half', u'value': -0.5, 'more': (None, True)}]}"#;
        let all = choices(text).unwrap();
        let short: Vec<_> =
            all.iter().map(|it| (it.name.as_str(), &it.value, it.description.as_str())).collect();
        assert_eq!(
            short,
            [
                ("Small", &ParameterValue::Integer(0), "A small one"),
                ("Half", &ParameterValue::Double(-0.5), "")
            ]
        );
    }

    #[test]
    fn what_is_none_is_refused_in_words() {
        let deep = "[".repeat(10_000);
        for (text, why) in [
            ("", "ends too early"),
            ("{'enum': 5}", "no list 'enum'"),
            ("{'enum': []}", "no constants"),
            ("{'enum': [{'name': 'a'}]}", "has no value"),
            ("{'enum' 5}", "has no value"),
            ("{'enum': [5, 6}", "missing"),
            ("{'enum': [__import__('os')]}", "is no value"),
            ("{'enum': 'a", "no end"),
            ("{5: 6}", "no text"),
            ("{} {}", "follows"),
            (deep.as_str(), "nests deeper"),
        ] {
            let said = choices(text).unwrap_err();
            assert!(said.contains(why), "{said}");
        }
    }

    proptest! {
        #[test]
        fn any_text_is_read_or_refused(text in "[\\[{('\"u:,a5 \\\\)}\\]é]{0,60}") {
            drop(choices(&text));
        }
    }
}
