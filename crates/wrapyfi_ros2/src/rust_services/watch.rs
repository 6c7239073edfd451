//! The thread that hears what happens to the services of a participant.
//!
//! ```text
//!   participant: matched, lost ─┐
//!   readers: data, status ──────┼─ mio poll ─▶ Pair ─▶ notify()
//!   writers: status ────────────┘     ▲ waker: stop
//! ```
//!
//! Matches are heard twice. The participant's events come from two threads of RustDDS, so that the
//! end of a match may be heard before its beginning; those of an endpoint are in order, but only
//! four of them are kept. So after news of matches each peer that discovery does not know any more is
//! forgotten: a peer that left leaves no ghost.
//!
//! RustDDS ends its loops where the system interrupts their wait, as Linux does where a stopped process goes on
//! (SIGSTOP and SIGCONT, Ctrl-Z and `fg`, a debugger). The thread sees it, tells every pair, and ends: their owners
//! open them on another participant.

use std::collections::BTreeMap;
use std::error::Error;
use std::io;
use std::net::SocketAddr;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Weak};
use std::thread::JoinHandle;
use std::time::Duration;

use rustdds::dds::CreateResult;
use rustdds::mio1::event::Source as _;
use rustdds::mio1::{Events, Interest, Poll, Registry, Token, Waker};
use rustdds::{
    DomainParticipant, DomainParticipantStatusEvent, DomainParticipantStatusListener, GUID,
    StatusEvented as _,
};

use super::greeting::Greeting;
use super::outgoing::Writer;
use super::pair::{Pair, Reader};
use super::settings::Settings;
use wrapyfi_endpoint::Mutex;

const WAKER: Token = Token(0);
const PARTICIPANT: Token = Token(1);
/// A pair's tokens are its number times this, and what follows.
const TOKENS_EACH: usize = 4;
const DATA: usize = 0;
const READER_STATUS: usize = 1;
const WRITER_STATUS: usize = 2;
/// Time between two looks at whether the loops of RustDDS go on.
const LOOK_EVERY: Duration = Duration::from_secs(2);

/// Runs the thread; dropping it ends the thread.
pub(super) struct Watch {
    routes: Arc<Mutex<Routes>>,
    registry: Registry,
    stop: Arc<AtomicBool>,
    has_ended: Arc<AtomicBool>,
    waker: Waker,
    thread: Option<JoinHandle<()>>,
}

/// The pairs, by number.
#[derive(Default)]
struct Routes {
    pairs: BTreeMap<usize, Weak<Pair>>,
    last: usize,
}

impl Watch {
    /// Starts to watch a participant.
    pub(super) fn new(participant: &DomainParticipant, settings: &Settings) -> io::Result<Self> {
        let poll = Poll::new()?;
        let registry = poll.registry().try_clone()?;
        let waker = Waker::new(&registry, WAKER)?;
        let mut listener = participant.status_listener();
        listener.register(&registry, PARTICIPANT, Interest::READABLE)?;
        let (stop, has_ended) = (Arc::<AtomicBool>::default(), Arc::<AtomicBool>::default());
        let routes = Arc::<Mutex<Routes>>::default();
        let watched = Watched {
            listener,
            participant: participant.clone(),
            greeting: Greeting::new(settings)?,
            routes: Arc::clone(&routes),
            stop: Arc::clone(&stop),
        };
        let ended = Arc::clone(&has_ended);
        let thread = std::thread::Builder::new().name("ros2 services".into()).spawn(move || {
            // A lock of RustDDS that a panic of its own poisoned would panic here too.
            let why = catch_unwind(AssertUnwindSafe(|| watched.run(poll)));
            let why = why.unwrap_or_else(|_| Some("RustDDS is broken".to_owned()));
            let Some(why) = why else { return };
            tracing::warn!("services of the Fast DDS mapping are opened anew: {why}");
            ended.store(true, Relaxed);
            for (_, pair) in alive(&watched.routes) {
                pair.ring();
            }
        })?;
        Ok(Self { routes, registry, stop, has_ended, waker, thread: Some(thread) })
    }

    /// True once nothing is heard any more, because RustDDS has ended beneath.
    pub(super) fn has_ended(&self) -> bool {
        self.has_ended.load(Relaxed)
    }

    /// Watches the pair that `create` makes, from before its first match on.
    ///
    /// Events of the participant are not looked at until it is made, so that none is missed.
    pub(super) fn add(
        &self,
        create: impl FnOnce() -> CreateResult<(Writer, Reader)>,
        join: impl FnOnce((Writer, Reader)) -> Pair,
    ) -> Result<Arc<Pair>, Box<dyn Error>> {
        let mut routes = self.routes.lock();
        let (mut writer, mut reader) = create()?;
        let number = routes.last.wrapping_add(1);
        let token = |what: usize| Token(number.wrapping_mul(TOKENS_EACH).wrapping_add(what));
        let register = |source: &mut dyn rustdds::mio1::event::Source, what: usize| {
            source.register(&self.registry, token(what), Interest::READABLE)
        };
        register(&mut reader, DATA)?;
        register(reader.as_status_source_mio1(), READER_STATUS)?;
        register(writer.as_status_source_mio1(), WRITER_STATUS)?;
        let pair = Arc::new(join((writer, reader)));
        routes.last = number;
        routes.pairs.retain(|_, pair| pair.strong_count() > 0);
        routes.pairs.insert(number, Arc::downgrade(&pair));
        Ok(pair)
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        self.stop.store(true, Relaxed);
        if let Err(error) = self.waker.wake() {
            // The thread sleeps on: waiting for it would be for ever.
            tracing::error!(%error, "the thread of the services cannot be woken");
            return;
        }
        // A callback that drops the last service runs on the thread itself, which then ends after.
        if let Some(thread) = self.thread.take()
            && thread.thread().id() != std::thread::current().id()
            && thread.join().is_err()
        {
            tracing::error!("the thread of the services panicked");
        }
    }
}

/// The thread's own.
struct Watched {
    listener: DomainParticipantStatusListener,
    participant: DomainParticipant,
    greeting: Greeting,
    routes: Arc<Mutex<Routes>>,
    stop: Arc<AtomicBool>,
}

impl Watched {
    /// Hears events until the watch is dropped; the reason where it cannot go on before.
    fn run(&self, mut poll: Poll) -> Option<String> {
        let mut events = Events::with_capacity(64);
        while !self.stop.load(Relaxed) {
            match poll.poll(&mut events, Some(LOOK_EVERY)) {
                Ok(()) => {}
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Some(format!("waiting for their events failed: {error}")),
            }
            let (mut changed, mut matches) = (BTreeMap::new(), false);
            if events.is_empty() && self.has_rustdds_ended() {
                let why =
                    "the loops of RustDDS have ended, as where a process is stopped and goes on";
                return Some(why.to_owned());
            }
            for event in &events {
                match event.token() {
                    WAKER => {}
                    PARTICIPANT => matches |= self.participant_events(&mut changed),
                    token => matches |= self.pair_event(token, &mut changed),
                }
            }
            if matches {
                self.forget_ghosts(&mut changed);
            }
            // Outside the lock: a callback may create and drop services.
            for pair in changed.values() {
                pair.ring();
            }
        }
        None
    }

    /// True where the loop of discovery takes no more orders, or that of the endpoints has dropped a writer.
    fn has_rustdds_ended(&self) -> bool {
        let of_writers = |(_, pair): (usize, Arc<Pair>)| !pair.on_writer_status();
        self.participant.assert_liveliness().is_err() || alive(&self.routes).any(of_writers)
    }

    /// True when it is about matches.
    fn pair_event(&self, token: Token, changed: &mut BTreeMap<usize, Arc<Pair>>) -> bool {
        let number = token.0 / TOKENS_EACH;
        let Some(pair) = self.routes.lock().pairs.get(&number).and_then(Weak::upgrade) else {
            return false;
        };
        let what = token.0 % TOKENS_EACH;
        match what {
            DATA => pair.on_data(),
            READER_STATUS => pair.on_reader_status(),
            _ => _ = pair.on_writer_status(),
        }
        changed.insert(number, pair);
        what != DATA
    }

    fn forget_ghosts(&self, changed: &mut BTreeMap<usize, Arc<Pair>>) {
        let mut discovered = None;
        self.each(changed, |pair| {
            // The same for all pairs, as they are on one participant.
            if discovered.is_none() {
                discovered = pair.discovered();
            }
            discovered.as_ref().is_some_and(|discovered| pair.forget_ghosts(discovered))
        });
    }

    /// True when one is about matches.
    fn participant_events(&self, changed: &mut BTreeMap<usize, Arc<Pair>>) -> bool {
        let mut matches = false;
        while let Some(event) = self.listener.try_recv_status() {
            match event {
                DomainParticipantStatusEvent::RemoteReaderMatched {
                    local_writer,
                    remote_reader,
                } => self.each(changed, |pair| {
                    let own = pair.writer_guid() == local_writer;
                    if own {
                        pair.reader_matched(remote_reader.to_bytes());
                    }
                    own
                }),
                DomainParticipantStatusEvent::RemoteWriterMatched {
                    local_reader,
                    remote_writer,
                } => self.each(changed, |pair| {
                    let own = pair.reader_guid() == local_reader;
                    if own {
                        pair.writer_matched(remote_writer.to_bytes());
                        self.greet(local_reader, remote_writer);
                    }
                    own
                }),
                DomainParticipantStatusEvent::ReaderLost { guid, .. }
                | DomainParticipantStatusEvent::WriterLost { guid, .. } => {
                    self.each(changed, |pair| pair.remote_lost(&guid.to_bytes()));
                }
                DomainParticipantStatusEvent::ParticipantLost { id, .. } => {
                    self.each(changed, |pair| pair.participant_lost(id.as_ref()));
                }
                _ => continue,
            }
            matches = true;
        }
        matches
    }

    /// Asks a writer of Fast DDS what it has for our reader.
    fn greet(&self, reader: GUID, writer: GUID) {
        let gid = writer.to_bytes();
        if !Greeting::is_for(&gid) {
            return;
        }
        let known = self.participant.discovered_writers();
        let found = known.iter().find(|known| known.writer_proxy.remote_writer_guid == writer);
        let locators = found.into_iter().flat_map(|found| &found.writer_proxy.unicast_locator_list);
        let udp = locators.filter(|locator| locator.is_udp());
        let addresses: Vec<_> = udp.map(|locator| SocketAddr::from(*locator)).collect();
        self.greeting.ask(&reader.to_bytes(), &gid, &addresses);
    }

    /// Shows every pair to `look`, which says whether anything changed there.
    fn each(&self, changed: &mut BTreeMap<usize, Arc<Pair>>, mut look: impl FnMut(&Pair) -> bool) {
        for (number, pair) in alive(&self.routes) {
            if look(&pair) {
                changed.insert(number, pair);
            }
        }
    }
}

/// The pairs that are held, by number.
fn alive(routes: &Mutex<Routes>) -> impl Iterator<Item = (usize, Arc<Pair>)> {
    let routes = routes.lock();
    let pairs = routes.pairs.iter().filter_map(|(number, pair)| Some((*number, pair.upgrade()?)));
    pairs.collect::<Vec<_>>().into_iter()
}
