//! Drivers of other crates that do what they should not: one program, because its list of drivers is set once.

#![allow(clippy::unwrap_used, clippy::panic, reason = "in a test a panic is the right answer")]

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

use serde::Deserialize;
use wrapyfi_bridge::BUNDLED;
use wrapyfi_bridge::exit::Failure;
use wrapyfi_bridge::middlewares::{Middlewares, for_look, load_text, set};
use wrapyfi_bridge::node::Node;
use wrapyfi_bridge::own_address::OwnAddress;
use wrapyfi_endpoint::config::{NamedSection, Problem, Reading};
use wrapyfi_endpoint::driver::{
    Available, Driver, FileSection, RouteFacts, Section, ServerAddress, StartNeeds, WholeBridge,
};
use wrapyfi_endpoint::memory::Memory;
use wrapyfi_endpoint::network::Hosts;
use wrapyfi_endpoint::{Interaction, Mutex, Planned, StartError};

/// True while drivers panic.
static ARMED: AtomicBool = AtomicBool::new(true);

/// A middleware inside the process that panics in one of its functions.
#[derive(Debug, Clone, Copy)]
struct Panics {
    name: &'static str,
    at: &'static str,
}

impl Panics {
    fn may(self, at: &str) {
        assert!(self.at != at || !ARMED.load(Relaxed), "on purpose");
    }
}

impl Driver for Panics {
    fn available(&self) -> Available<'static> {
        self.may("available");
        let mut available = Available { name: self.name, ..Available::default() };
        if self.at == "check_topic" {
            available.check_topic = &|_| {
                assert!(!ARMED.load(Relaxed), "on purpose");
                Ok(())
            };
        }
        available
    }

    fn section(&self) -> Box<dyn Section> {
        self.may("section");
        Box::new(*self)
    }

    fn is_expected(&self) -> bool {
        self.may("is_expected");
        true
    }

    fn whole_bridge(&self) -> Option<WholeBridge> {
        self.may("whole_bridge");
        None
    }

    fn check_routes(&self, _routes: &[RouteFacts<'_>]) -> Result<(), (usize, String)> {
        self.may("check_routes");
        Ok(())
    }
}

impl FileSection for Panics {
    fn boxed(&self) -> Box<dyn Section> {
        Box::new(*self)
    }

    fn read(&self, _text: &str) -> Reading<Box<dyn Section>> {
        self.may("read");
        Reading { value: Some(self.boxed()), problems: Vec::new(), wrong_items: Default::default() }
    }

    fn example(&self) -> &'static str {
        "{}"
    }
}

impl Section for Panics {
    fn check(&self) -> Result<(), Problem> {
        self.may("check");
        Ok(())
    }

    fn check_permitted(&self, _hosts: &Hosts) -> Result<(), Problem> {
        self.may("check_permitted");
        Ok(())
    }

    fn plan(&self, _needs: &StartNeeds<'_>) -> Result<Planned, StartError> {
        self.may("plan");
        let Self { name, .. } = *self;
        let this = *self;
        let start = move || {
            this.may("start");
            Ok(Arc::new(Memory::new(name)) as _)
        };
        Ok(Planned { key: String::new(), start: Arc::new(start) })
    }

    fn servers(
        &self,
        _hosts: &Hosts,
        _interaction: Interaction,
    ) -> Result<Vec<ServerAddress>, StartError> {
        self.may("servers");
        Ok(Vec::new())
    }
}

/// A middleware whose start takes until it is let go.
struct Slow;

static HELD: Mutex<Option<Receiver<()>>> = Mutex::new(None);

impl Driver for Slow {
    fn available(&self) -> Available<'static> {
        Available { name: "slow", ..Available::default() }
    }

    fn section(&self) -> Box<dyn Section> {
        Box::new(SlowSection {})
    }
}

#[derive(Debug, Clone, Default, Deserialize)]
struct SlowSection {}

impl NamedSection for SlowSection {
    const NAME: &'static str = "slow";
}

impl Section for SlowSection {
    fn plan(&self, _needs: &StartNeeds<'_>) -> Result<Planned, StartError> {
        let start = || {
            let held = HELD.lock().take();
            _ = held.map(|held| held.recv());
            Ok(Arc::new(Memory::new("slow")) as _)
        };
        Ok(Planned { key: String::new(), start: Arc::new(start) })
    }
}

const fn panics(name: &'static str, at: &'static str) -> Panics {
    Panics { name, at }
}

static NAMELESS: Panics = panics("bad", "available");
static ODD: Panics = panics("a:b", "");
static TWIN: Panics = panics("zeromq", "");
static ALL: [Panics; 10] = [
    panics("good", ""),
    panics("a", "read"),
    panics("b", "check"),
    panics("c", "check_routes"),
    panics("d", "plan"),
    panics("e", "start"),
    panics("f", "is_expected"),
    panics("g", "whole_bridge"),
    panics("h", "servers"),
    panics("i", "check_topic"),
];

#[test]
fn a_driver_that_is_wrong_is_named_and_the_others_go_on() {
    let refused = |drivers: &[&'static dyn Driver]| match set(drivers) {
        Err(failure @ Failure::Usage(_)) => failure.to_string(),
        other => panic!("{other:?}"),
    };
    let [first, ..] = BUNDLED;
    let told = refused(&[first, &NAMELESS]);
    assert_eq!(told, "driver 2 of this program panicked: on purpose");
    let told = refused(&[&ODD]);
    assert!(told.contains("\"a:b\", which no address can have"), "{told}");
    let told = refused(&[first, &TWIN]);
    assert_eq!(
        told,
        "drivers 1 and 2 of this program are both called zeromq: leave one out of its list"
    );

    // YARP is left out.
    let [zeromq, ros2, ros1, _] = BUNDLED;
    let mut drivers: Vec<&'static dyn Driver> = vec![zeromq, ros2, ros1, &Slow];
    drivers.extend(ALL.iter().map(|driver| driver as &dyn Driver));
    set(&drivers).unwrap();
    let load = |endpoints: &str, end: &str| {
        let route = format!("{{ from: 'good:/a', to: '{end}:/a', type: Text }}");
        let text = format!("endpoints: {{ {endpoints} }}\nroutes: [{route}]\n");
        load_text(&text, "file").map_err(|failure| failure.to_string())
    };
    let told = load("a: {}", "zeromq").unwrap_err();
    for name in ["a", "b", "c"] {
        let expected = format!("middleware {name}: its driver panicked: on purpose");
        assert!(told.contains(&expected), "{name}: {told}");
    }
    let told = load("", "i").unwrap_err();
    assert!(told.contains("middleware i: its driver panicked: on purpose"), "{told}");
    for name in ["d", "e"] {
        let told = for_look(name, OwnAddress::default()).err().unwrap().to_string();
        let expected = format!("middleware {name}: its driver panicked: on purpose");
        assert!(told.contains(&expected), "{told}");
    }
    for_look("f", OwnAddress::default()).unwrap();
    ARMED.store(false, Relaxed);

    for (section, expected) in [
        ("yarp: {}", "file:1:14: this program has no middleware yarp: `wrapyfi` has it"),
        ("zermoq: {}", "file:1:14: unknown key `zermoq`; did you mean `zeromq`?"),
        ("zeromq: { socket_ip: 1 }", "file:1:24: unknown key `socket_ip`"),
    ] {
        let told = load(section, "zeromq").unwrap_err();
        assert!(told.starts_with(expected), "{told}");
    }

    // Routes of one that is slow wait for it; those of others run.
    let (let_go, held) = channel();
    *HELD.lock() = Some(held);
    let Ok(loaded) = load("", "slow") else { panic!("it is right") };
    let node = Node::bridge().unwrap();
    let running = Middlewares::of_bridge(&loaded.endpoints, &loaded.plan, &node, false).unwrap();
    let [slow, good] = ["slow", "good"].map(|name| running.registry().get(name).unwrap());
    assert_eq!(good.waiting_for(), None);
    assert!(
        slow.waiting_for()
            .is_some_and(|why| why.to_string().contains("has not started within 5 s"))
    );
    let_go.send(()).unwrap();
    while slow.waiting_for().is_some() {
        std::thread::sleep(Duration::from_millis(5));
    }
}
