//! Panics on the engine's own threads, and of middlewares where a plan changes: the thread begins again, and the
//! routes go on.

use std::sync::atomic::{AtomicUsize, Ordering::SeqCst};
use std::sync::{Arc, Mutex};
use std::time::Instant;

use crate::common::seeds::quiet_about_injected;
use crate::common::{Faulty, drain, listener, number, plan, publisher, registry};
use wrapyfi_conformance::until;
use wrapyfi_endpoint::{Clock, Registry};
use wrapyfi_engine::{Engine, RouteState, RouteStatus, Running};
use wrapyfi_interfaces::store::TypeStore;

/// A clock that panics on the threads of one name.
#[derive(Clone, Default)]
struct Moody {
    on: Arc<Mutex<Option<&'static str>>>,
    panics: Arc<AtomicUsize>,
}

impl Moody {
    fn clock(&self) -> Clock {
        let moody = self.clone();
        Clock::new(move || {
            let is_on = {
                let on = moody.on.lock().unwrap();
                on.is_some_and(|name| std::thread::current().name() == Some(name))
            };
            if is_on {
                moody.panics.fetch_add(1, SeqCst);
                panic!("injected: the clock");
            }
            Instant::now()
        })
    }

    fn panics_on(&self, thread: Option<&'static str>) {
        *self.on.lock().unwrap() = thread;
    }
}

fn find(running: &Running, name: &str) -> Option<RouteStatus> {
    let name = format!("a:/{name} -> b:/{name}");
    running.status().into_iter().find(|route| route.name == name)
}

fn is_active(running: &Running, name: &str) -> bool {
    find(running, name).is_some_and(|route| route.state == RouteState::Active)
}

const WRITTEN: &str = "from: 'a:/w', to: 'b:/w', type: NativeObject, queue_depth: 1000";

/// After a thread has panicked again and again, everything that needs it goes on: routes that a pattern makes
/// (reconciler), those that are tried again after a while (timer), and messages (workers).
#[test]
fn a_thread_of_the_engine_that_panics_begins_again() {
    quiet_about_injected();
    for thread in ["reconciler", "route-timer", "route-worker"] {
        let (a, b, moody) = (Faulty::new("a"), Faulty::new("b"), Moody::default());
        let mut with: Registry = registry(&[&a, &b]);
        with.set_clock(moody.clock());
        let routes = plan(&[
            WRITTEN.to_owned(),
            "from: 'a:/late', to: 'b:/late', type: NativeObject".to_owned(),
            "from: 'a:/(p.*)', to: 'b:/$1'".to_owned(),
        ]);
        b.change(|faults| faults.refused = Some("/late".to_owned()));
        let engine = Engine::new(routes, &with).with_types(TypeStore::generated());
        let running = engine.start().unwrap();
        let mut sinks = ["w", "late", "p0"].map(|it| listener(&b.bus, &format!("/{it}"), 1000));
        let mut sources = ["w", "late"].map(|it| publisher(&a.bus, &format!("/{it}")));
        until("the written route", || is_active(&running, "w"));
        until("the refused one to wait", || {
            find(&running, "late").is_some_and(|it| it.state.to_string().contains("refuses"))
        });
        moody.panics_on(Some(thread));
        until("it to panic, and again", || {
            sources[0].publish(&number(0)).unwrap();
            moody.panics.load(SeqCst) >= 3
        });
        if thread == "route-worker" {
            until("the route to say so", || {
                let route = find(&running, "w").unwrap();
                route.panics > 0 && route.state.to_string().contains("injected: the clock")
            });
        }
        moody.panics_on(None);
        b.heal();
        let mut found = publisher(&a.bus, "/p0");
        for name in ["w", "late", "p0"] {
            until(&format!("{name} after {thread} has panicked"), || is_active(&running, name));
        }
        until("what was under way", || {
            running
                .status()
                .iter()
                .all(|it| it.counters.received == it.counters.sent + it.counters.dropped())
        });
        sinks.iter_mut().for_each(|sink| _ = drain(sink.as_mut()));
        let [written, late] = &mut sources;
        for (source, sink) in [written, late, &mut found].into_iter().zip(&mut sinks) {
            source.publish(&number(7)).unwrap();
            until("its message", || drain(sink.as_mut()) == [7]);
        }
        let began = Instant::now();
        drop(running.stop());
        assert!(began.elapsed().as_secs() < 30, "{thread} keeps it from its end");
    }
}

/// A middleware that panics while a plan is replaced takes none of the routes along that are the same in both.
#[test]
fn a_panic_while_a_plan_is_replaced_ends_no_route_that_stays() {
    quiet_about_injected();
    for place in ["only", "traits"] {
        let (a, b) = (Faulty::new("a"), Faulty::new("b"));
        let pattern = "from: 'a:/(p.*)', to: 'b:/$1', lazy: false";
        let before = plan(&[WRITTEN.to_owned(), pattern.to_owned()]);
        let engine = Engine::new(before, &registry(&[&a, &b]));
        let running = engine.with_types(TypeStore::generated()).start().unwrap();
        let mut sinks = ["w", "p0"].map(|it| listener(&b.bus, &format!("/{it}"), 1000));
        let mut sources = ["w", "p0"].map(|it| publisher(&a.bus, &format!("/{it}")));
        until("both", || ["w", "p0"].iter().all(|name| is_active(&running, name)));
        a.change(|faults| faults.panics_in = Some(place));
        let after = plan(&[
            WRITTEN.to_owned(),
            format!("{pattern}, deny: ['p9']"),
            "from: 'a:/new', to: 'b:/new', type: NativeObject".to_owned(),
        ]);
        running.apply(after, TypeStore::generated(), running.registry()).unwrap();
        until("the new route", || find(&running, "new").is_some());
        if place == "only" {
            until("the pattern to say so", || {
                running.status().iter().any(|it| {
                    it.pattern.is_some() && it.state.to_string().contains("injected: only")
                })
            });
        } else {
            until("the new route to say so", || {
                let told = find(&running, "new").unwrap().state.to_string();
                told.starts_with("error: a panicked") && told.contains("injected: traits")
            });
        }
        a.heal();
        until("both, untouched", || ["w", "p0"].iter().all(|name| is_active(&running, name)));
        let mut later = publisher(&a.bus, "/p1");
        until("a name that comes later", || find(&running, "p1").is_some());
        later.publish(&number(1)).unwrap();
        for (source, sink) in sources.iter_mut().zip(&mut sinks) {
            source.publish(&number(7)).unwrap();
            until("its message", || drain(sink.as_mut()) == [7]);
        }
        for name in ["/w", "/p0"] {
            assert_eq!((a.history(name).opened, b.history(name).opened), (1, 1), "{place} {name}");
        }
    }
}
