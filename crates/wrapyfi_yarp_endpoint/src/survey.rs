//! Answers of ports about themselves; each port is asked once.
//!
//! ```text
//!   names that a program wants ─ ask ─▶ at most 8 at once: Network::inspect, one connection a port
//!        ▲                                │ told: never again until the name server enters it anew
//!        └────── Answers ◀────────────────┴ silent: again after 0.5 s, 1 s, … 5 min
//!   connected with us as what it is not ─▶ once more
//!   in the way of a route ─▶ one connection that stays; when it ends, once more: refused ─▶ gone
//! ```
//!
//! All who look share the answers. A port is asked only when a program wants to know, and never in
//! turns. A name server keeps the ports of programs that were killed.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use tokio::sync::Semaphore;
use wrapyfi_yarp::port::Inspection;

use super::registered_port::Entry;
use super::role::role;
use wrapyfi_endpoint::{Mutex, Role};

/// Most ports that are asked at once. A port of YARP starts `lsb_release` before it says what it is, 12 to 45 ms
/// of a processor: more of them only wait for each other.
const AT_ONCE: usize = 8;
/// Time after which a port that did not answer is asked again; it doubles each time.
const FIRST_AGAIN: Duration = Duration::from_millis(500);
/// Longest such time.
const LAST_AGAIN: Duration = Duration::from_secs(300);

/// The answers of a network.
#[derive(Debug)]
pub(super) struct Survey {
    answers: Mutex<BTreeMap<String, PortAnswer>>,
    /// Counts what was answered, or was not.
    changes: AtomicU64,
    pub(super) room: Arc<Semaphore>,
}

/// Answer of one port.
#[derive(Debug, Clone, Default)]
struct PortAnswer {
    /// The port that it is of.
    number: u64,
    state: QuestionState,
    inspection: Option<Arc<Inspection>>,
    /// True where no program is at the port's address any more.
    is_gone: bool,
    /// True where the port's address has refused once: its program was killed, or is about to listen.
    may_be_gone: bool,
    /// True while a connection tells when the port ends.
    is_watched: bool,
    failures: u32,
}

#[derive(Debug, Clone, Copy, Default)]
enum QuestionState {
    /// Question under way.
    #[default]
    Asked,
    Answered,
    /// Answer that the port's connections contradict.
    Stale,
    Silent(Instant),
}

/// Reason why a port does not answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Silence {
    /// No program is at its address.
    Refused,
    /// It may be there: a machine or network that is away proves nothing.
    NoAnswer,
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

impl PortAnswer {
    /// True when the port has to be asked.
    fn is_due(&self, number: u64, now: Instant) -> bool {
        match self.state {
            _ if self.number != number => true,
            QuestionState::Asked | QuestionState::Answered => false,
            QuestionState::Stale => true,
            QuestionState::Silent(at) => now.saturating_duration_since(at) >= pause(self.failures),
        }
    }
}

impl Survey {
    /// Number of answers that have come or were given up.
    pub(super) fn changes(&self) -> u64 {
        self.changes.load(Ordering::Acquire)
    }

    /// Last answer of a port, if it has given one.
    pub(super) fn answer_of(&self, name: &str) -> Option<Arc<Inspection>> {
        self.answers.lock().get(name)?.inspection.clone()
    }

    /// True while the answer of a port is awaited.
    pub(super) fn is_being_asked(&self, name: &str) -> bool {
        self.answers
            .lock()
            .get(name)
            .is_some_and(|answer| matches!(answer.state, QuestionState::Asked))
    }

    /// True for a port that is registered, and no program is at its address.
    pub(super) fn is_gone(&self, name: &str) -> bool {
        self.answers.lock().get(name).is_some_and(|answer| answer.is_gone)
    }

    /// True where a port has to be watched that was not.
    pub(super) fn begins_watch(&self, name: &str, number: u64) -> bool {
        let mut answers = self.answers.lock();
        let answer = answers.get_mut(name).filter(|answer| answer.number == number);
        answer.is_some_and(|answer| !std::mem::replace(&mut answer.is_watched, true))
    }

    /// Notes that the connection has ended that told when a port ends, and whether no program is there.
    pub(super) fn ends_watch(&self, name: &str, number: u64, is_refused: bool, now: Instant) {
        let mut answers = self.answers.lock();
        if let Some(answer) = answers.get_mut(name).filter(|answer| answer.number == number) {
            answer.is_watched = false;
            if is_refused {
                (answer.is_gone, answer.state) = (true, QuestionState::Silent(now));
                answer.failures = answer.failures.saturating_add(1);
                self.changes.fetch_add(1, Ordering::Release);
            }
        }
    }

    /// Has a port asked again that is connected with `own`, a port of ours, and was taken for something
    /// else: it writes to ours where it `sends`, else it reads.
    pub(super) fn met(&self, name: &str, own: &str, sends: bool) {
        let mut answers = self.answers.lock();
        let Some(answer) = answers.get_mut(name) else { return };
        let (QuestionState::Answered, Some(inspection)) = (answer.state, &answer.inspection) else {
            return;
        };
        let is_sender = matches!(role(name, Some(inspection)).1, Role::Publisher | Role::Client);
        let known = if sends { &inspection.outputs } else { &inspection.inputs };
        if is_sender != sends && !known.iter().any(|one| one == own) {
            answer.state = QuestionState::Stale;
        }
    }

    /// True when all of these ports have answered, or were given up for now. One that has refused once is not.
    pub(super) fn is_over(&self, ports: &BTreeMap<String, Entry>) -> bool {
        let answers = self.answers.lock();
        ports.keys().all(|name| {
            answers.get(name).is_some_and(|answer| {
                !matches!(answer.state, QuestionState::Asked) && !answer.may_be_gone
            })
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
        for (name, Entry { number, .. }) in &due {
            let answer = answers.entry(name.clone()).or_default();
            if answer.number != *number {
                *answer = PortAnswer { number: *number, ..PortAnswer::default() };
            }
            answer.state = QuestionState::Asked;
        }
        due
    }

    /// Enters the answer of a port, or that it gave none. Programs of YARP are registered before they listen: one that
    /// has never answered is gone when it refuses twice.
    pub(super) fn enter(
        &self,
        name: &str,
        number: u64,
        told: Result<Inspection, Silence>,
        now: Instant,
    ) {
        let mut answers = self.answers.lock();
        // Another port may have the name by now, or none.
        let Some(answer) = answers.get_mut(name).filter(|answer| answer.number == number) else {
            return;
        };
        match told {
            Ok(told) => {
                answer.state = QuestionState::Answered;
                (answer.is_gone, answer.may_be_gone) = (false, false);
                answer.inspection = Some(Arc::new(told));
            }
            Err(silence) => {
                answer.state = QuestionState::Silent(now);
                answer.failures = answer.failures.saturating_add(1);
                let has_begun = answer.inspection.is_some() || answer.failures > 1;
                let is_refused = silence == Silence::Refused;
                answer.is_gone |= is_refused && has_begun;
                answer.may_be_gone = is_refused && !answer.is_gone;
            }
        }
        self.changes.fetch_add(1, Ordering::Release);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ports(number: u64) -> BTreeMap<String, Entry> {
        BTreeMap::from([("/a".to_owned(), Entry::new(number, None))])
    }

    #[test]
    fn a_port_is_asked_once_and_one_that_is_silent_less_and_less_often() {
        let (survey, mut now) = (Survey::default(), Instant::now());
        assert_eq!(survey.due(&ports(1), now).len(), 1);
        assert!(!survey.is_over(&ports(1)));
        let mut pauses = Vec::new();
        for _ in 0..11 {
            survey.enter("/a", 1, Err(Silence::NoAnswer), now);
            assert!(survey.is_over(&ports(1)));
            let mut pause = Duration::ZERO;
            while survey.due(&ports(1), now + pause).is_empty() {
                pause += Duration::from_millis(500);
            }
            now += pause;
            pauses.push(pause.as_secs_f64());
        }
        assert_eq!(pauses, [0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0, 300.0]);
        survey.enter("/a", 1, Ok(Inspection::default()), now);
        let later = now + Duration::from_secs(1_000_000);
        assert!(survey.due(&ports(1), later).is_empty(), "it has said it");
        assert!(survey.answer_of("/a").is_some());
        assert_eq!(survey.due(&ports(2), now).len(), 1, "another port of that name");
        survey.enter("/a", 1, Ok(Inspection::default()), now);
        assert!(survey.answer_of("/a").is_none(), "the answer of the one before");
        survey.forget(|_| false);
        assert_eq!(survey.due(&ports(2), now).len(), 1);
    }

    #[test]
    fn a_port_is_gone_where_its_address_refuses_and_not_where_it_is_silent() {
        let (survey, now) = (Survey::default(), Instant::now());
        let later = now + Duration::from_secs(2);
        let said = |silence, now| {
            survey.enter("/a", 1, Err(silence), now);
            survey.is_gone("/a")
        };
        assert!(!survey.begins_watch("/a", 1), "nobody has asked it");
        survey.due(&ports(1), now);
        assert!(!said(Silence::Refused, now), "it may be about to listen");
        assert!(!survey.is_over(&ports(1)), "it is asked again, soon");
        assert_eq!(survey.due(&ports(1), later).len(), 1);
        assert!(!survey.is_gone("/a") && said(Silence::Refused, later));
        assert!(survey.is_over(&ports(1)));
        let later = later + Duration::from_secs(2);
        assert_eq!(survey.due(&ports(1), later).len(), 1);
        assert!(survey.is_gone("/a"), "until it has answered");
        survey.enter("/a", 1, Ok(Inspection::default()), later);
        assert!(!survey.is_gone("/a"));
        assert!(survey.begins_watch("/a", 1) && !survey.begins_watch("/a", 1), "once");
        survey.ends_watch("/a", 1, false, later);
        assert!(!survey.is_gone("/a") && survey.due(&ports(1), later).is_empty());
        assert!(survey.begins_watch("/a", 1));
        survey.ends_watch("/a", 1, true, later);
        assert!(survey.is_gone("/a"));
        assert_eq!(survey.due(&ports(2), later).len(), 1, "another port of that name");
        assert!(!survey.is_gone("/a"));
        survey.enter("/a", 2, Ok(Inspection::default()), later);
        assert!(!said(Silence::NoAnswer, later) && survey.answer_of("/a").is_some());
        survey.ends_watch("/a", 1, true, later);
        assert!(!survey.is_gone("/a"), "the connection to the one before");
    }

    #[test]
    fn a_port_that_is_connected_as_what_it_is_not_is_asked_again() {
        let (survey, now) = (Survey::default(), Instant::now());
        let is_due = |survey: &Survey| !survey.due(&ports(1), now).is_empty();
        let role_of = |survey: &Survey| role("/a", survey.answer_of("/a").as_deref()).1;
        assert!(is_due(&survey));
        survey.met("/a", "/ours", false);
        assert!(!is_due(&survey), "it is being asked");
        survey.enter("/a", 1, Ok(Inspection::default()), now);
        assert_eq!(role_of(&survey), Role::Publisher, "by its name");
        survey.met("/a", "/ours", true);
        assert!(!is_due(&survey), "publishers send");
        survey.met("/a", "/ours", false);
        assert!(is_due(&survey), "it reads");
        assert_eq!(role_of(&survey), Role::Publisher, "until it has answered");
        let inputs = vec!["/ours".to_owned()];
        let said = Inspection { inputs, ..Inspection::default() };
        survey.enter("/a", 1, Ok(said), now);
        assert_eq!(role_of(&survey), Role::Listener);
        survey.met("/a", "/ours", false);
        assert!(!is_due(&survey));
        let outputs = vec!["/ours".to_owned()];
        survey.met("/a", "/ours", true);
        assert!(is_due(&survey), "a listener that sends");
        survey.enter("/a", 1, Ok(Inspection { outputs, ..Inspection::default() }), now);
        assert_eq!(role_of(&survey), Role::Publisher);
        // A relay reads as well: what it said is true.
        let (inputs, outputs) = (vec!["/ours".to_owned()], vec!["/other".to_owned()]);
        assert!(!is_due(&survey));
        survey.met("/a", "/ours", false);
        assert!(is_due(&survey));
        let said = Inspection { inputs, outputs, ..Inspection::default() };
        survey.enter("/a", 1, Ok(said), now);
        survey.met("/a", "/ours", false);
        assert!(!is_due(&survey), "once");
    }
}
