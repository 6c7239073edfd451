//! Text from outside as it may be shown: names come from the network, and a terminal obeys some of what they may hold.

use std::borrow::Cow;
use std::fmt::Write as _;

/// True for letters that a terminal obeys, and for those that are not seen and reorder what stands beside them.
pub fn is_obeyed(letter: char) -> bool {
    letter.is_control()
        || matches!(
            letter,
            '\u{61c}'
                | '\u{200e}'
                | '\u{200f}'
                | '\u{2028}'..='\u{202e}'
                | '\u{2060}'..='\u{206f}'
                | '\u{feff}'
                | '\u{fff9}'..='\u{fffb}'
                | '\u{e0000}'..='\u{e007f}'
        )
}

/// The text with `\u001b` for each such letter, as JSON has it: a string of JSON stays the same one.
pub fn escaped(text: &str) -> Cow<'_, str> {
    without(text, is_obeyed)
}

/// [`escaped`] for a text of several lines: breaks and tabs stay.
pub fn escaped_lines(text: &str) -> Cow<'_, str> {
    without(text, |letter| is_obeyed(letter) && letter != '\n' && letter != '\t')
}

fn without(text: &str, is_hidden: impl Fn(char) -> bool) -> Cow<'_, str> {
    // Most text is plain, and a look at its bytes takes a tenth of the time.
    if text.bytes().all(|byte| matches!(byte, b' '..=b'~')) || !text.contains(&is_hidden) {
        return Cow::Borrowed(text);
    }
    let mut shown = String::with_capacity(text.len() + 16);
    for letter in text.chars() {
        if !is_hidden(letter) {
            shown.push(letter);
            continue;
        }
        for unit in letter.encode_utf16(&mut [0; 2]) {
            // Writing to a String cannot fail.
            let _infallible = write!(shown, "\\u{unit:04x}");
        }
    }
    Cow::Owned(shown)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_terminal_obeys_is_shown_by_its_number() {
        let name = "/a\x1b\x07\0\u{9b}\u{202e}\u{e0041}é\u{200d}";
        let shown = "/a\\u001b\\u0007\\u0000\\u009b\\u202e\\udb40\\udc41é\u{200d}";
        assert_eq!(escaped(name), shown);
        assert_eq!(escaped_lines("a\n\tb\r"), "a\n\tb\\u000d");
        assert!(matches!(escaped("/camera"), Cow::Borrowed(_)));
        let json = serde_json::to_string(name).unwrap();
        assert_eq!(serde_json::from_str::<String>(&escaped(&json)).unwrap(), name);
        assert!(!escaped(&json).contains(is_obeyed));
    }
}
