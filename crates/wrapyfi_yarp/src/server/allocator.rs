//! Resources that the name server gives away: port numbers, names and multicast groups.
//!
//! ```text
//!   numbers  10002 10003 … 19999   the last number of a name first, then new ones, then freed ones
//!   names    /tmp/port/1 …         freed ones first
//!   groups   224.1.1.3 224.1.1.4 … freed ones first
//! ```
//!
//! As in YARP, numbers count for the whole network, not for each machine, and freed ones are taken
//! in the order of their text: 10010 before 9999.

use std::collections::{BTreeMap, BTreeSet};

/// Everything the name server gives away.
#[derive(Debug, Default)]
pub(crate) struct Allocator {
    first: u16,
    last: u16,
    /// The number given last; one below `first` at the beginning.
    number: u16,
    numbers: Pool,
    /// The name that had a number last.
    held_by: BTreeMap<String, String>,
    /// The numbers that a name had last.
    held: BTreeMap<String, BTreeSet<String>>,
    name: u64,
    names: Pool,
    group: u32,
    groups: Pool,
}

/// Things given away and taken back, by their text.
#[derive(Debug, Default)]
struct Pool {
    used: BTreeSet<String>,
    free: BTreeSet<String>,
}

impl Pool {
    fn take(&mut self, item: &str) {
        self.free.remove(item);
        self.used.insert(item.to_owned());
    }

    fn give_back(&mut self, item: &str) {
        if self.used.remove(item) {
            self.free.insert(item.to_owned());
        }
    }

    fn first_free(&self, allowed: impl Fn(&str) -> bool) -> Option<String> {
        self.free.iter().find(|item| allowed(item)).cloned()
    }
}

/// The number at which groups start: the first is 224.1.1.3.
const FIRST_GROUP: u32 = 2;
/// Groups go up to 224.1.254.255, as YARP counts them.
const END_OF_GROUPS: u32 = 255 * 254;

impl Allocator {
    /// Gives numbers from `base` + 2 to `base` + 9999, as far as there are such ports.
    pub(crate) fn new(base: u16) -> Self {
        let first = base.saturating_add(2);
        Self {
            first,
            last: base.saturating_add(9999),
            number: first.saturating_sub(1),
            group: FIRST_GROUP - 1,
            ..Self::default()
        }
    }

    /// The first and the last number there is.
    pub(crate) fn range(&self) -> (u16, u16) {
        (self.first, self.last)
    }

    /// A port number for `name`; none that a program chose by itself, as `taken` says.
    pub(crate) fn number(&mut self, name: &str, taken: impl Fn(u16) -> bool) -> Option<u16> {
        let open = |text: &String| text.parse().ok().filter(|&number| !taken(number));
        let before = self.held.get(name).and_then(BTreeSet::first);
        let before = before.filter(|text| !self.numbers.used.contains(*text)).and_then(open);
        let number = before
            .or_else(|| self.next_number(&taken))
            .or_else(|| self.numbers.free.iter().find_map(open));
        let number: u16 = number?;
        let text = number.to_string();
        self.numbers.take(&text);
        self.remember(&text, name);
        Some(number)
    }

    fn next_number(&mut self, taken: impl Fn(u16) -> bool) -> Option<u16> {
        while self.number < self.last {
            self.number += 1;
            if !taken(self.number) {
                return Some(self.number);
            }
        }
        None
    }

    fn remember(&mut self, number: &str, name: &str) {
        if let Some(before) = self.held_by.insert(number.to_owned(), name.to_owned())
            && let Some(numbers) = self.held.get_mut(&before)
        {
            numbers.remove(number);
            if numbers.is_empty() {
                self.held.remove(&before);
            }
        }
        self.held.entry(name.to_owned()).or_default().insert(number.to_owned());
    }

    /// A name for a port that has none; none that `taken` says is registered.
    pub(crate) fn name(&mut self, taken: impl Fn(&str) -> bool) -> String {
        let name = self.names.first_free(|name| !taken(name)).unwrap_or_else(|| {
            loop {
                self.name += 1;
                let name = format!("/tmp/port/{}", self.name);
                if !taken(&name) {
                    break name;
                }
            }
        });
        self.names.take(&name);
        name
    }

    /// A multicast group.
    pub(crate) fn group(&mut self) -> Option<String> {
        let group = match self.groups.first_free(|_| true) {
            Some(group) => group,
            None if self.group + 1 >= END_OF_GROUPS => return None,
            None => {
                self.group += 1;
                format!("224.1.{}.{}", self.group / 255 + 1, self.group % 255 + 1)
            }
        };
        self.groups.take(&group);
        Some(group)
    }

    /// Takes back what a port had: only what was given away returns.
    pub(crate) fn give_back(&mut self, name: &str, host: &str, number: u16) {
        self.names.give_back(name);
        // `/tmp/port/1=tail`: the tail was not ours.
        if let Some((given, _)) = name.split_once('=') {
            self.names.give_back(given);
        }
        self.numbers.give_back(&number.to_string());
        self.groups.give_back(host);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn any(_: u16) -> bool {
        false
    }

    #[test]
    fn a_name_gets_its_number_again() {
        let mut given = Allocator::new(10_000);
        assert_eq!(given.number("/a", any), Some(10_002));
        assert_eq!(given.number("/b", any), Some(10_003));
        given.give_back("/a", "127.0.0.1", 10_002);
        assert_eq!(given.number("/c", any), Some(10_004), "freed numbers wait for their names");
        assert_eq!(given.number("/a", any), Some(10_002));
        assert_eq!(given.number("/d", |number| number == 10_005), Some(10_006));
    }

    #[test]
    fn freed_numbers_are_used_when_there_are_no_new_ones() {
        let mut given = Allocator::new(65_530);
        assert_eq!(given.range(), (65_532, 65_535));
        for number in 65_532..=65_535 {
            assert_eq!(given.number(&format!("/p{number}"), any), Some(number));
        }
        assert_eq!(given.number("/late", any), None);
        given.give_back("/p65534", "", 65_534);
        assert_eq!(given.number("/late", any), Some(65_534));
        assert_eq!(given.number("/p65534", any), None, "/late had it last");
    }

    #[test]
    fn names_and_groups_return_in_the_order_of_their_text() {
        let mut given = Allocator::new(10_000);
        let names: Vec<_> = (0..11).map(|_| given.name(|_| false)).collect();
        assert_eq!(names[0], "/tmp/port/1");
        for name in ["/tmp/port/2", "/tmp/port/10=tail"] {
            given.give_back(name, "", 0);
        }
        assert_eq!(given.name(|_| false), "/tmp/port/10");
        assert_eq!(given.name(|_| false), "/tmp/port/2");
        assert_eq!(given.name(|name| name == "/tmp/port/12"), "/tmp/port/13");
        assert_eq!(given.group().unwrap(), "224.1.1.3");
        assert_eq!(given.group().unwrap(), "224.1.1.4");
        given.give_back("", "224.1.1.3", 0);
        assert_eq!(given.group().unwrap(), "224.1.1.3");
        let all = std::iter::repeat_with(|| given.group()).take_while(Option::is_some).count();
        assert!(all > 60_000, "{all} groups");
    }
}
