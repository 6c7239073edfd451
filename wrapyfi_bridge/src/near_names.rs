//! Names that are nearly the same.

use strsim::damerau_levenshtein;
use wrapyfi_endpoint::pattern::ros_name;
use wrapyfi_interfaces::named;

/// Most letters by which two names may differ and still count as one misspelt.
const MOST_LETTERS: usize = 2;
/// Letters of a name for each by which it may differ: shorter ones are all alike.
const SHORTEST: usize = 5;

named! {
    /// Difference between two names that are perhaps meant to be one, nearest first.
    #[derive(PartialOrd, Ord)]
    pub enum NameDifference {
        /// Only slashes at the beginning, at the end or in a row differ.
        Slash => "a slash",
        /// Both have the same name in ROS 2, which lacks characters of one.
        Replaced => "characters that names of ROS 2 lack",
        /// Only capital letters differ.
        Case => "capital letters",
        /// One of them has a namespace that the other lacks.
        Namespace => "its namespace",
        /// A letter or two differ.
        Letters => "a letter or two",
    }
    /// Difference in words, to follow "differs by".
    pub fn words;
}

/// Difference between `one` and `other`, where they are perhaps meant to be the same; `None` where
/// they are the same, or have nothing in common.
pub fn name_difference(one: &str, other: &str) -> Option<NameDifference> {
    if one == other {
        return None;
    }
    let (a, b) = (parts(one), parts(other));
    if a == b {
        return Some(NameDifference::Slash);
    }
    if ros_name(one) == ros_name(other) {
        return Some(NameDifference::Replaced);
    }
    let lower = |name: &[&str]| name.iter().map(|part| part.to_lowercase()).collect::<Vec<_>>();
    if lower(&a) == lower(&b) {
        return Some(NameDifference::Case);
    }
    if !a.is_empty() && !b.is_empty() && (a.ends_with(&b) || b.ends_with(&a)) {
        return Some(NameDifference::Namespace);
    }
    // One letter instead of another in a name of one or two is another name.
    let same = a.iter().zip(&b).take_while(|(one, other)| one == other).count();
    let rest =
        |name: &[&str]| name.iter().skip(same).map(|part| part.chars().count()).sum::<usize>();
    if rest(&a).min(rest(&b)) < 3 {
        return None;
    }
    let digits =
        |name: &str| name.matches(|letter: char| letter.is_ascii_digit()).collect::<String>();
    let (a, b) = (one.chars().count(), other.chars().count());
    let most = MOST_LETTERS.min(a.min(b) / SHORTEST);
    // Long names that differ by more in length are not compared; what is numbered is meant to be several.
    let may_be = most > 0 && a.abs_diff(b) <= most && digits(one) == digits(other);
    (may_be && damerau_levenshtein(one, other) <= most).then_some(NameDifference::Letters)
}

/// The nearest of `names` to `wanted`, with the difference.
pub fn nearest<'n>(
    wanted: &str,
    names: impl Iterator<Item = &'n str>,
) -> Option<(&'n str, NameDifference)> {
    let near = names.filter_map(|name| Some((name, name_difference(wanted, name)?)));
    near.min_by_key(|&(name, name_difference)| (name_difference, name))
}

/// True for a name that begins with a slash.
pub fn is_absolute(name: &str) -> bool {
    name.starts_with('/')
}

/// The name with a slash more or less at its beginning.
pub fn beside(name: &str) -> String {
    name.strip_prefix('/').map_or_else(|| format!("/{name}"), str::to_owned)
}

fn parts(name: &str) -> Vec<&str> {
    name.split('/').filter(|part| !part.is_empty()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_were_perhaps_meant() {
        for (one, other, wanted) in [
            ("/chatter", "chatter", Some(NameDifference::Slash)),
            ("/a/b/", "/a//b", Some(NameDifference::Slash)),
            ("/robot-1/1st", "/robot_1/_1st", Some(NameDifference::Replaced)),
            ("/Chatter", "/chatter", Some(NameDifference::Case)),
            ("/chatter", "/robot/chatter", Some(NameDifference::Namespace)),
            ("/lab/robot/odom", "/robot/odom", Some(NameDifference::Namespace)),
            ("/chatter", "/chater", Some(NameDifference::Letters)),
            ("/camera/left", "/camera/lfet", Some(NameDifference::Letters)),
            ("/chatter", "/chatter", None),
            ("/cat", "/car", None),
            ("/lamp", "/cam", None),
            ("/map1", "/map2", None),
            ("/chat", "/chat1", None),
            ("/chatter", "/camera", None),
            ("/", "/chatter", None),
            ("/robot/a", "/robot/b", None),
        ] {
            assert_eq!(name_difference(one, other), wanted, "{one} {other}");
            assert_eq!(name_difference(other, one), wanted, "{other} {one}");
        }
        let names = ["/x/chatter", "/Chatter", "/chattel"];
        assert_eq!(
            nearest("/chatter", names.into_iter()),
            Some(("/Chatter", NameDifference::Case))
        );
        assert_eq!(nearest("/none", names.into_iter()), None);
    }
}
