//! Default values in the words of Python: type descriptions of ROS 2 hold them so, for instance
//! `True`, `-2.25`, `('x', 'y z')`.

use super::{DefaultValue, Literal};

impl DefaultValue {
    /// The text in `type_description_interfaces/msg/Field.default_value`.
    ///
    /// ```
    /// use wrapyfi_interfaces::parser::{DefaultValue, Literal};
    /// let flags = DefaultValue::Many(vec![Literal::Bool(true), Literal::Bool(false)]);
    /// assert_eq!(flags.to_python(), "(True, False)");
    /// ```
    pub fn to_python(&self) -> String {
        match self {
            // Alone, a text has no quotes.
            Self::One(Literal::Text(text)) => text.clone(),
            Self::One(value) => python(value),
            Self::Many(values) => match values.as_slice() {
                // Without the comma it would not be a tuple.
                [only] => format!("({},)", python(only)),
                values => format!("({})", values.iter().map(python).collect::<Vec<_>>().join(", ")),
            },
        }
    }
}

fn python(value: &Literal) -> String {
    match value {
        Literal::Bool(true) => "True".to_owned(),
        Literal::Bool(false) => "False".to_owned(),
        Literal::Integer(value) => value.to_string(),
        Literal::Float(value) if value.is_nan() => "nan".to_owned(),
        Literal::Float(value) => exponent(&format!("{value:?}")),
        Literal::Text(text) => quoted(text),
    }
}

/// `1e16` to `1e+16`, `5e-5` to `5e-05`; the rest is alike in both languages.
fn exponent(rust: &str) -> String {
    let Some((digits, exponent)) = rust.split_once('e') else { return rust.to_owned() };
    match exponent.strip_prefix('-') {
        Some(exponent) => format!("{digits}e-{exponent:0>2}"),
        None => format!("{digits}e+{exponent:0>2}"),
    }
}

fn quoted(text: &str) -> String {
    let quote = if text.contains('\'') && !text.contains('"') { '"' } else { '\'' };
    let mut quoted = String::from(quote);
    for c in text.chars() {
        match c {
            c if c == quote || c == '\\' => quoted.extend(['\\', c]),
            '\t' => quoted.push_str("\\t"),
            c => quoted.push(c),
        }
    }
    quoted.push(quote);
    quoted
}
