//! Parameters of a group.

use std::collections::BTreeSet;

use wrapyfi_interfaces::rcl_interfaces::msg::ListParametersResult;

/// Character between the names of groups and parameters.
const SEPARATOR: char = '.';

/// True when `name` is `group` or in it.
pub(super) fn is_below(name: &str, group: &str) -> bool {
    below(name, group).is_some()
}

/// Rest of `name` behind `group`; empty when it is `group` itself.
fn below<'n>(name: &'n str, group: &str) -> Option<&'n str> {
    let rest = name.strip_prefix(group)?;
    if rest.is_empty() { Some(rest) } else { rest.strip_prefix(SEPARATOR) }
}

/// The names at most `depth` names deep below one of `prefixes` (all, where there is none; any
/// depth, where it is 0), and the groups they are in, each once.
pub(super) fn list<'n>(
    names: impl Iterator<Item = &'n str>,
    prefixes: &[String],
    depth: u64,
) -> ListParametersResult {
    // A request may name one group many times, which must not cost a search each.
    let prefixes: BTreeSet<&str> = prefixes.iter().map(String::as_str).collect();
    let near = |rest: &str| {
        let deep = rest.matches(SEPARATOR).count();
        depth == 0 || u64::try_from(deep).is_ok_and(|deep| deep < depth)
    };
    let mut result = ListParametersResult::default();
    let mut groups = BTreeSet::new();
    for name in names {
        let found = if prefixes.is_empty() {
            near(name)
        } else {
            prefixes.iter().filter_map(|prefix| below(name, prefix)).any(near)
        };
        if !found {
            continue;
        }
        result.names.push(name.to_owned());
        if let Some((group, _)) = name.rsplit_once(SEPARATOR)
            && groups.insert(group)
        {
            result.prefixes.push(group.to_owned());
        }
    }
    result
}
