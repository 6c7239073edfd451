//! Answers of ports about themselves; each port is asked once.
//!
//! ```text
//!   names that somebody wants ─ ask ─▶ at most 8 at once: Network::inspect, one connection a port
//!        ▲                                │ told: never again until the name server enters it anew
//!        └────── Answers ◀────────────────┴ silent: again after 1 s, 2 s, … 5 min
//!   connected with us as what it is not ─▶ once more
//! ```
//!
//! All who look share the answers. A port is asked only when somebody wants to know, and never in
//! turns.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use tokio::sync::Semaphore;
use wrapyfi_yarp::port::Inspection;

use super::directory::Entry;
use super::role::role;
use wrapyfi_endpoint::{Mutex, Role};

/// Most ports that are asked at once. A port of YARP starts `lsb_release` before it says what it is, 12 to 45 ms
/// of a processor: more of them only wait for each other.
const AT_ONCE: usize = 8;
/// Time after which a port that did not answer is asked again; it doubles each time.
const FIRST_AGAIN: Duration = Duration::from_secs(1);
/// Longest such time.
const LAST_AGAIN: Duration = Duration::from_secs(300);

/// The answers of a network.
#[derive(Debug)]
pub(super) struct Survey {
    answers: Mutex<BTreeMap<String, Answer>>,
    /// Counts what was answered, or was not.
    changes: AtomicU64,
    pub(super) room: Arc<Semaphore>,
}

/// Answer of one port.
#[derive(Debug, Clone)]
struct Answer {
    /// The port that it is of.
    number: u64,
    state: State,
    failures: u32,
}

#[derive(Debug, Clone)]
enum State {
    /// Question under way, with the answer before.
    Asked(Option<Arc<Inspection>>),
    Told(Arc<Inspection>),
    /// Answer that the port's connections contradict.
    Stale(Arc<Inspection>),
    Silent(Instant),
}

impl Default for Survey {
    fn default() -> Self {
        Self {
            answers: Mutex::default(),
            changes: AtomicU64::default(),
            room: Arc::new(Semaphore::new(AT_ONCE)),
        }
    }
}

/// Time until a port is asked, or listened to, again that has failed to answer so often.
pub(super) fn pause(failures: u32) -> Duration {
    FIRST_AGAIN.saturating_mul(1 << failures.saturating_sub(1).min(16)).min(LAST_AGAIN)
}

impl Answer {
    /// True when the port has to be asked.
    fn is_due(&self, number: u64, now: Instant) -> bool {
        match self.state {
            _ if self.number != number => true,
            State::Asked(_) | State::Told(_) => false,
            State::Stale(_) => true,
            State::Silent(at) => now.saturating_duration_since(at) >= pause(self.failures),
        }
    }
}

impl Survey {
    /// Number of answers that have come or were given up.
    pub(super) fn changes(&self) -> u64 {
        self.changes.load(Ordering::Acquire)
    }

    /// Answer of a port, if it has given one.
    pub(super) fn answer_of(&self, name: &str) -> Option<Arc<Inspection>> {
        match &self.answers.lock().get(name)?.state {
            State::Told(told) | State::Stale(told) => Some(Arc::clone(told)),
            State::Asked(before) => before.clone(),
            State::Silent(_) => None,
        }
    }

    /// True while the answer of a port is awaited.
    pub(super) fn is_being_asked(&self, name: &str) -> bool {
        self.answers.lock().get(name).is_some_and(|answer| matches!(answer.state, State::Asked(_)))
    }

    /// Has a port asked again that is connected with `own`, a port of ours, and was taken for something
    /// else: it writes to ours where it `sends`, else it reads.
    pub(super) fn met(&self, name: &str, own: &str, sends: bool) {
        let mut answers = self.answers.lock();
        let Some(answer) = answers.get_mut(name) else { return };
        let State::Told(told) = &answer.state else { return };
        let is_sender = matches!(role(name, Some(told)).1, Role::Publisher | Role::Client);
        let known = if sends { &told.outputs } else { &told.inputs };
        if is_sender != sends && !known.iter().any(|one| one == own) {
            answer.state = State::Stale(Arc::clone(told));
        }
    }

    /// True when all of these ports have answered, or were given up for now.
    pub(super) fn is_over(&self, ports: &BTreeMap<String, Entry>) -> bool {
        let answers = self.answers.lock();
        ports.keys().all(|name| {
            answers.get(name).is_some_and(|answer| !matches!(answer.state, State::Asked(_)))
        })
    }

    /// Forgets the ports that `exists` does not know.
    pub(super) fn forget(&self, exists: impl Fn(&str) -> bool) {
        self.answers.lock().retain(|name, _| exists(name));
    }

    /// Marks those that have to be asked.
    pub(super) fn due(
        &self,
        ports: &BTreeMap<String, Entry>,
        now: Instant,
    ) -> Vec<(String, Entry)> {
        let mut answers = self.answers.lock();
        let is_due =
            |name: &str, number| answers.get(name).is_none_or(|answer| answer.is_due(number, now));
        let due = ports.iter().filter(|(name, entry)| is_due(name, entry.number));
        let due: Vec<_> = due.map(|(name, entry)| (name.clone(), entry.clone())).collect();
        for (name, entry) in &due {
            let number = entry.number;
            let before = answers.get(name).filter(|answer| answer.number == number);
            let failures = before.map_or(0, |answer| answer.failures);
            let told = before.and_then(|answer| match &answer.state {
                State::Stale(told) => Some(Arc::clone(told)),
                _ => None,
            });
            answers.insert(name.clone(), Answer { number, state: State::Asked(told), failures });
        }
        due
    }

    /// Enters the answer of a port, or that it gave none.
    pub(super) fn enter(&self, name: &str, number: u64, told: Option<Inspection>, now: Instant) {
        let mut answers = self.answers.lock();
        // Another port may have the name by now, or nobody.
        let Some(answer) = answers.get_mut(name).filter(|answer| answer.number == number) else {
            return;
        };
        answer.state = match told {
            Some(told) => State::Told(Arc::new(told)),
            None => {
                answer.failures = answer.failures.saturating_add(1);
                State::Silent(now)
            }
        };
        self.changes.fetch_add(1, Ordering::Release);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ports(number: u64) -> BTreeMap<String, Entry> {
        BTreeMap::from([("/a".to_owned(), Entry { number, contact: None, has_files: false })])
    }

    #[test]
    fn a_port_is_asked_once_and_one_that_is_silent_less_and_less_often() {
        let (survey, mut now) = (Survey::default(), Instant::now());
        assert_eq!(survey.due(&ports(1), now).len(), 1);
        assert!(!survey.is_over(&ports(1)));
        let mut pauses = Vec::new();
        for _ in 0..11 {
            survey.enter("/a", 1, None, now);
            assert!(survey.is_over(&ports(1)));
            let mut pause = Duration::ZERO;
            while survey.due(&ports(1), now + pause).is_empty() {
                pause += Duration::from_secs(1);
            }
            now += pause;
            pauses.push(pause.as_secs());
        }
        assert_eq!(pauses, [1, 2, 4, 8, 16, 32, 64, 128, 256, 300, 300]);
        survey.enter("/a", 1, Some(Inspection::default()), now);
        let later = now + Duration::from_secs(1_000_000);
        assert!(survey.due(&ports(1), later).is_empty(), "it has said it");
        assert!(survey.answer_of("/a").is_some());
        assert_eq!(survey.due(&ports(2), now).len(), 1, "another port of that name");
        survey.enter("/a", 1, Some(Inspection::default()), now);
        assert!(survey.answer_of("/a").is_none(), "the answer of the one before");
        survey.forget(|_| false);
        assert_eq!(survey.due(&ports(2), now).len(), 1);
    }

    #[test]
    fn a_port_that_is_connected_as_what_it_is_not_is_asked_again() {
        let (survey, now) = (Survey::default(), Instant::now());
        let is_due = |survey: &Survey| !survey.due(&ports(1), now).is_empty();
        let role_of = |survey: &Survey| role("/a", survey.answer_of("/a").as_deref()).1;
        assert!(is_due(&survey));
        survey.met("/a", "/ours", false);
        assert!(!is_due(&survey), "it is being asked");
        survey.enter("/a", 1, Some(Inspection::default()), now);
        assert_eq!(role_of(&survey), Role::Publisher, "by its name");
        survey.met("/a", "/ours", true);
        assert!(!is_due(&survey), "publishers send");
        survey.met("/a", "/ours", false);
        assert!(is_due(&survey), "it reads");
        assert_eq!(role_of(&survey), Role::Publisher, "until it has answered");
        let inputs = vec!["/ours".to_owned()];
        let said = Inspection { inputs, ..Inspection::default() };
        survey.enter("/a", 1, Some(said), now);
        assert_eq!(role_of(&survey), Role::Listener);
        survey.met("/a", "/ours", false);
        assert!(!is_due(&survey));
        let outputs = vec!["/ours".to_owned()];
        survey.met("/a", "/ours", true);
        assert!(is_due(&survey), "a listener that sends");
        survey.enter("/a", 1, Some(Inspection { outputs, ..Inspection::default() }), now);
        assert_eq!(role_of(&survey), Role::Publisher);
        // A relay reads as well: what it said is true.
        let (inputs, outputs) = (vec!["/ours".to_owned()], vec!["/other".to_owned()]);
        assert!(!is_due(&survey));
        survey.met("/a", "/ours", false);
        assert!(is_due(&survey));
        let said = Inspection { inputs, outputs, ..Inspection::default() };
        survey.enter("/a", 1, Some(said), now);
        survey.met("/a", "/ours", false);
        assert!(!is_due(&survey), "once");
    }
}
