//! Patterns: the names that match, and the names that they become at the destination.
//!
//! ```text
//!   "/camera/left"  ─ without its slash ─▶ camera/left
//!        │ from: (.*)/(left|right)     whole name, or no match
//!        │ allow, deny                 whole name; deny wins
//!        ▼ to: $2/$1
//!   "/left/camera"
//! ```

use std::borrow::Cow;

use regex::{Regex, RegexBuilder};
use regex_syntax::hir::{Hir, HirKind, Repetition};

pub use super::ros_name::{ros_name, with_leading_digits};

/// Memory that one compiled pattern may take, in bytes.
const MAX_COMPILED: usize = 1 << 20;
/// Longest pattern, in bytes.
const MAX_PATTERN: usize = 1024;
/// Longest name that is made, in bytes: that of every middleware is shorter.
const MAX_NAME: usize = 4096;

/// True for a name with letters that make it a pattern; no middleware has these letters in names.
pub fn is_pattern(name: &str) -> bool {
    name.contains(['*', '+', '?', '(', ')', '[', ']', '{', '}', '|', '^', '$', '\\'])
}

/// Name without its leading slash.
pub fn bare(name: &str) -> &str {
    name.strip_prefix('/').unwrap_or(name)
}

/// A regular expression for whole names, without their leading slash.
///
/// ```
/// use wrapyfi_endpoint::pattern::NamePattern;
/// let cameras = NamePattern::new("/camera/(.+)")?;
/// assert!(cameras.matches("/camera/left") && !cameras.matches("/arm"));
/// assert_eq!(cameras.expand("/camera/left", "/robot/$1/image").as_deref(), Some("/robot/left/image"));
/// assert!(NamePattern::new("/camera/*").is_err()); // a glob
/// # Ok::<(), String>(())
/// ```
#[derive(Debug, Clone)]
pub struct NamePattern {
    written: String,
    regex: Regex,
}

impl PartialEq for NamePattern {
    fn eq(&self, other: &Self) -> bool {
        self.written == other.written
    }
}

impl NamePattern {
    /// Compiles a pattern; a slash at its beginning, or at that of an alternative, is left out, as it is of names.
    ///
    /// # Errors
    /// When the pattern is no regular expression, a glob, or too large; the text goes on from the pattern
    /// and says what to change.
    pub fn new(written: &str) -> Result<Self, String> {
        if written.len() > MAX_PATTERN {
            let length = written.len();
            return Err(format!("is {length} bytes long, the limit is {MAX_PATTERN}"));
        }
        let last_line = |text: String| {
            let last = text.lines().last().unwrap_or_default();
            let fault = last.trim().trim_start_matches("error: ");
            format!("is no regular expression: {fault}")
        };
        if is_glob(bare(written)) {
            return Err(
                "is a glob; a pattern is a regular expression: write (.*) for any text".to_owned()
            );
        }
        // Parsed as written, so that an error shows the pattern as the user wrote it.
        let parsed = regex_syntax::parse(written).map_err(|error| last_line(error.to_string()))?;
        let whole = format!("^(?:{})$", without_slash(&parsed));
        let regex = RegexBuilder::new(&whole).size_limit(MAX_COMPILED).build();
        let regex = regex.map_err(|error| match error {
            regex::Error::CompiledTooBig(limit) => {
                format!("takes more than {limit} bytes; write a simpler one")
            }
            other => last_line(other.to_string()),
        })?;
        Ok(Self { written: written.to_owned(), regex })
    }

    /// True when the whole name matches.
    pub fn matches(&self, name: &str) -> bool {
        self.regex.is_match(bare(name))
    }

    /// Checks the references of a destination: `$1`, `${name}`.
    ///
    /// # Errors
    /// When the destination refers to no group, or to one that the pattern lacks; the text says
    /// what to write.
    pub fn check_template(&self, template: &str) -> Result<(), String> {
        let mut rest = template;
        let mut refers = false;
        while let Some(at) = rest.find('$') {
            rest = rest.get(at + 1..).unwrap_or_default();
            let (group, after) = reference(rest);
            if group.is_empty() {
                return Err("$ stands for a group: write $1 or ${name} behind it".to_owned());
            }
            let exists = match group.parse::<usize>() {
                Ok(number) => number < self.regex.captures_len(),
                Err(_) => self.regex.capture_names().flatten().any(|name| name == group),
            };
            if !exists {
                let digits =
                    group.len() - group.trim_start_matches(|c: char| c.is_ascii_digit()).len();
                let groups = self.regex.captures_len() - 1;
                let hint = match (group.get(..digits), group.get(digits..)) {
                    (Some(number), Some(more)) if !number.is_empty() && !more.is_empty() => {
                        format!("; write ${{{number}}}{more} for group {number}")
                    }
                    _ if groups == 0 => {
                        let text = self.written.strip_suffix(".*").unwrap_or("…/");
                        format!("; put what shall be kept in parentheses: \"{text}(.*)\"")
                    }
                    _ => String::new(),
                };
                return Err(format!(
                    "${group} is no group of {:?}, which has {groups} in parentheses{hint}",
                    self.written
                ));
            }
            refers = true;
            rest = after;
        }
        if refers {
            return Ok(());
        }
        Err("it has no $1: all that the pattern means would go to one name; put what shall be kept \
             in parentheses, and refer to it"
            .to_owned())
    }

    /// Fills `template` in for a name; `None` where the name does not match.
    pub fn expand(&self, name: &str, template: &str) -> Option<String> {
        let captures = self.regex.captures(bare(name))?;
        let mut out = String::new();
        captures.expand(template, &mut out);
        (out.len() <= MAX_NAME).then_some(out)
    }
}

/// Expression for names without their leading slash: the one that stands at the beginning, also of a group or an
/// alternative, is left out.
fn without_slash(pattern: &Hir) -> Hir {
    match pattern.kind() {
        HirKind::Literal(text) => {
            Hir::literal(text.0.strip_prefix(b"/").unwrap_or(&text.0).to_vec())
        }
        HirKind::Capture(group) => {
            let mut group = group.clone();
            *group.sub = without_slash(&group.sub);
            Hir::capture(group)
        }
        HirKind::Alternation(all) => Hir::alternation(all.iter().map(without_slash).collect()),
        HirKind::Concat(parts) => {
            let mut parts = parts.clone();
            let first = parts.iter_mut().find(|part| !matches!(part.kind(), HirKind::Look(_)));
            if let Some(first) = first {
                *first = without_slash(first);
            }
            Hir::concat(parts)
        }
        HirKind::Repetition(repeated) => {
            let mut repeated: Repetition = repeated.clone();
            let is_slash = matches!(repeated.sub.kind(), HirKind::Literal(it) if &*it.0 == b"/");
            if is_slash {
                repeated.min = repeated.min.saturating_sub(1);
                repeated.max = repeated.max.map(|most| most.saturating_sub(1));
            } else if repeated.max == Some(1) {
                *repeated.sub = without_slash(&repeated.sub);
            }
            Hir::repetition(repeated)
        }
        HirKind::Empty | HirKind::Class(_) | HirKind::Look(_) => pattern.clone(),
    }
}

/// True where `*` follows `/`, `(` or the beginning, as in a shell's `/camera/*`. As a regular expression,
/// that repeats a slash or nothing, and matches no name that is meant.
fn is_glob(pattern: &str) -> bool {
    let (mut before, mut is_class) = ('(', false);
    let mut letters = pattern.chars();
    while let Some(letter) = letters.next() {
        match letter {
            '\\' => {
                letters.next();
            }
            '[' => is_class = true,
            ']' => is_class = false,
            '*' if !is_class && matches!(before, '/' | '(') => return true,
            _ => {}
        }
        before = letter;
    }
    false
}

/// Way from the name at the destination back to the one at the source, where the pattern is text
/// and groups.
///
/// ```
/// use wrapyfi_endpoint::pattern::{Inverse, NamePattern};
/// let cameras = NamePattern::new("/camera/(.+)")?;
/// let inverse = Inverse::new(&cameras, "/robot/$1/image").unwrap();
/// assert_eq!(inverse.source("/robot/left/image").as_deref(), Some("/camera/left"));
/// # Ok::<(), String>(())
/// ```
#[derive(Debug)]
pub struct Inverse {
    pattern: NamePattern,
    template: String,
    /// Expression for the names that the template makes, and the groups it refers to, in order.
    made: Regex,
    refers: Vec<String>,
    /// The source: text, and groups.
    parts: Vec<Part>,
}

#[derive(Debug)]
enum Part {
    Text(String),
    /// Number and name of the group.
    Group(String, Option<String>),
}

impl Inverse {
    /// Inverts a pattern; `None` where the source cannot be told from the destination.
    pub fn new(pattern: &NamePattern, template: &str) -> Option<Self> {
        let (mut made, mut refers, mut rest) = ("^".to_owned(), Vec::new(), bare(template));
        while let Some((text, after)) = rest.split_once('$') {
            let (group, after) = reference(after);
            made.push_str(&regex::escape(text));
            made.push_str("(.*)");
            refers.push(group.into_owned());
            rest = after;
        }
        made.push_str(&regex::escape(rest));
        made.push('$');
        let made = RegexBuilder::new(&made).size_limit(MAX_COMPILED).build().ok()?;
        let parts = parts(bare(&pattern.written))?;
        Some(Self { pattern: pattern.clone(), template: template.to_owned(), made, refers, parts })
    }

    /// Source that becomes `name`.
    pub fn source(&self, name: &str) -> Option<String> {
        let captures = self.made.captures(bare(name))?;
        let of = |group: &str| {
            let place = self.refers.iter().position(|one| one == group)?;
            captures.get(place + 1).map(|found| found.as_str())
        };
        let mut source = "/".to_owned();
        for part in &self.parts {
            source.push_str(match part {
                Part::Text(text) => text,
                Part::Group(number, name) => {
                    of(number).or_else(|| of(name.as_deref()?)).or_else(|| of("0"))?
                }
            });
        }
        // The source is a guess: the pattern must turn it into the name asked for.
        let becomes = self.pattern.expand(&source, &self.template)?;
        (bare(&becomes) == bare(name)).then_some(source)
    }
}

/// Splits a pattern of text and groups that are not nested; `None` for any other.
fn parts(pattern: &str) -> Option<Vec<Part>> {
    let (mut parts, mut rest, mut groups) = (Vec::new(), pattern, 0_usize);
    while !rest.is_empty() {
        if let Some(group) = rest.strip_prefix('(') {
            let (inner, after) = group.split_once(')')?;
            if inner.contains('(') || after.starts_with(['*', '+', '?', '{']) {
                return None;
            }
            let name = match inner.strip_prefix('?') {
                None => None,
                Some(named) => {
                    let named = named.strip_prefix('P').unwrap_or(named).strip_prefix('<')?;
                    Some(named.split_once('>')?.0.to_owned())
                }
            };
            groups += 1;
            parts.push(Part::Group(groups.to_string(), name));
            rest = after;
            continue;
        }
        let end = rest.find('(').unwrap_or(rest.len());
        let (text, after) = rest.split_at(end);
        if is_pattern(text) || text.contains('.') {
            return None;
        }
        parts.push(Part::Text(text.to_owned()));
        rest = after;
    }
    Some(parts)
}

impl std::fmt::Display for NamePattern {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.written)
    }
}

/// True when a destination that refers to groups may become this name.
pub fn fits_template(template: &str, name: &str) -> bool {
    let literals = literals(template);
    let [first, middle @ .., last] = literals.as_slice() else { return template == name };
    let rest = name.strip_prefix(first).and_then(|rest| rest.strip_suffix(last));
    let Some(mut rest) = rest else { return false };
    middle.iter().all(|literal| match rest.split_once(literal) {
        Some((_, after)) => {
            rest = after;
            true
        }
        None => false,
    })
}

/// Fills a word in for each group of a destination.
pub fn filled_template(template: &str) -> String {
    literals(template).join("x")
}

/// Texts between the groups that a destination refers to.
fn literals(template: &str) -> Vec<&str> {
    let mut found = Vec::new();
    let mut rest = template;
    while let Some((before, after)) = rest.split_once('$') {
        found.push(before);
        rest = reference(after).1;
    }
    found.push(rest);
    found
}

/// Splits the text behind a `$` into the group, as it is expanded, and the rest.
fn reference(text: &str) -> (Cow<'_, str>, &str) {
    if let Some(inner) = text.strip_prefix('{') {
        return match inner.split_once('}') {
            Some((name, rest)) => (name.into(), rest),
            None => ("".into(), text),
        };
    }
    let is_letter = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let end = text.find(|c| !is_letter(c)).unwrap_or(text.len());
    let (name, rest) = text.split_at(end);
    (name.into(), rest)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn pattern(text: &str) -> NamePattern {
        NamePattern::new(text).unwrap()
    }

    #[test]
    fn a_destination_fits_what_it_may_become() {
        for (template, name, fits) in [
            ("/x", "/x", true),
            ("/x", "/y", false),
            ("/lab/$1", "/lab/a/b", true),
            ("/lab/$1", "/other/a", false),
            ("/${1}/mid/$2/end", "/a/mid/b/end", true),
            ("/${1}/mid/$2/end", "/a/b/end", false),
            ("/ab$1", "/a", false),
        ] {
            assert_eq!(fits_template(template, name), fits, "{template} {name}");
        }
        assert_eq!(filled_template("/${1}/mid/$2"), "/x/mid/x");
    }

    #[test]
    fn a_pattern_means_whole_names_without_their_slash() {
        for written in ["/camera/(left|right)", "camera/(left|right)"] {
            let cameras = pattern(written);
            assert!(cameras.matches("/camera/left") && cameras.matches("camera/right"));
            assert!(!cameras.matches("/camera/left/raw") && !cameras.matches("/my/camera/left"));
            assert_eq!(cameras.expand("/camera/left", "/$1/raw").as_deref(), Some("/left/raw"));
        }
        assert!(pattern("a|b").matches("/b") && !pattern("a|b").matches("/ab"));
        let named = pattern("(?<robot>[a-z]+)/(?<rest>.*)");
        assert_eq!(named.expand("/r/x/y", "/${rest}/of_$robot").as_deref(), Some("/x/y/of_r"));
    }

    /// Users of ROS write names with and without their slash.
    #[test]
    fn a_slash_at_the_beginning_may_be_optional_and_in_each_alternative() {
        for (written, matches, others) in [
            ("/?x", ["/x", "x"], ["/y", "/a/x"]),
            ("/?(?:cam|arm)/.*", ["/cam/left", "/arm/state"], ["/cam", "/my/arm/state"]),
            ("/+x", ["/x", "x"], ["/y", "/a/x"]),
            ("/cam/.*|/arm", ["/cam/left", "/arm"], ["/armor", "/x/arm"]),
            ("(/left|/right)", ["/left", "/right"], ["/", "/left/x"]),
            ("(?:/cam/)?raw", ["/cam/raw", "/raw"], ["/cam/cam/raw", "/x/raw"]),
            ("^/x(?:/y)?$", ["/x", "/x/y"], ["/xy", "/x/y/z"]),
            ("[^c].*", ["/arm", "/x/cam"], ["/cam", "/c"]),
            (".am", ["/cam", "/ram"], ["/am", "/x/am"]),
        ] {
            let compiled = pattern(written);
            assert!(matches.iter().all(|name| compiled.matches(name)), "{written}");
            assert!(!others.iter().any(|name| compiled.matches(name)), "{written}");
        }
        let sides = pattern("(?<side>/left|/right)/(.*)");
        assert_eq!(sides.expand("/left/raw", "/$2/$side").as_deref(), Some("/raw/left"));
    }

    #[test]
    fn what_is_wrong_with_a_pattern_is_said() {
        let error = NamePattern::new("/camera/(left").unwrap_err();
        assert!(error.contains("unclosed group"), "{error}");
        for glob in ["/camera/*", "*", "/*", "/(*)", "/cam/*/raw", "**", "[/]/*"] {
            let error = NamePattern::new(glob).unwrap_err();
            assert!(error.contains("write (.*) for any text"), "{glob}: {error}");
        }
        for good in ["/camera/.*", "a[/*]", r"a/\*", r"a\/*b", "(?:a/)*b", "(.*)/raw"] {
            assert!(NamePattern::new(good).is_ok(), "{good}");
        }
        assert!(NamePattern::new(&"a".repeat(2000)).unwrap_err().contains("1024"));
        let error = NamePattern::new("(?:a{1000}){1000}").unwrap_err();
        assert!(error.contains("simpler"), "{error}");
    }

    #[test]
    fn a_destination_refers_to_groups_that_there_are() {
        let two = pattern("(.*)/(?<part>.*)");
        for good in ["/$1", "/${1}_raw", "/x/$part/$0", "/${part}"] {
            assert_eq!(two.check_template(good), Ok(()), "{good}");
        }
        for (wrong, why) in [
            ("/$3", "has 2"),
            ("/$1_raw", "write ${1}_raw"),
            ("/$other", "$other is no group"),
            ("/x", "no $1"),
            ("/a$", "write $1"),
            ("/${1", "write $1"),
        ] {
            let error = two.check_template(wrong).unwrap_err();
            assert!(error.contains(why), "{wrong}: {error}");
        }
        for (written, remedy) in [("/cam/.*", "\"/cam/(.*)\""), ("/cam/[a-z]+", "\"…/(.*)\"")] {
            let error = pattern(written).check_template("/$1").unwrap_err();
            assert!(error.contains("which has 0") && error.contains(remedy), "{error}");
        }
    }

    #[test]
    fn the_source_is_told_from_the_destination_where_the_pattern_is_text_and_groups() {
        for (written, template, name, source) in [
            ("/(.*)", "/$1", "/scan", Some("/scan")),
            ("(.*)", "/lab/${1}_raw", "/lab/cam/left_raw", Some("/cam/left")),
            ("(.*)", "/lab/$1", "/other", None),
            ("camera/(left|right)/(.*)", "/$2/$1", "/image/left", Some("/camera/left/image")),
            ("camera/(left|right)", "/$1", "/up", None),
            ("robot/(?<part>[a-z]+)", "/$part", "/arm", Some("/robot/arm")),
            (".*", "/$0", "/scan", None),
            ("a.(.*)", "/$1", "/scan", None),
            ("(a|(b))", "/$1", "/a", None),
            ("(x)(.*)", "/$2", "/scan", None),
        ] {
            let found =
                Inverse::new(&pattern(written), template).and_then(|inverse| inverse.source(name));
            assert_eq!(found.as_deref(), source, "{written} {template} {name}");
        }
    }

    proptest! {
        /// An accepted template expands with the text of its groups, for every name.
        #[test]
        fn an_accepted_template_keeps_what_its_groups_hold(name in "[a-z_/]{0,40}") {
            let all = pattern("(.*)");
            prop_assert_eq!(all.expand(&name, "/p/${1}").unwrap(), format!("/p/{}", bare(&name)));
        }
    }
}
