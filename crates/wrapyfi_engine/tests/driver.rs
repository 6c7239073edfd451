//! Routes on the threads of the engine: blocked ones, panics, plans that change.

use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::common::{Faulty, drain, listener, number, plan, publisher, registry};
use wrapyfi_conformance::until;
use wrapyfi_endpoint::DropReason;
use wrapyfi_engine::{Engine, RouteState, RouteStatus, Running};
use wrapyfi_interfaces::store::TypeStore;

const MS: Duration = Duration::from_millis(1);

/// Two buses and the routes between them.
struct Bench {
    a: Arc<Faulty>,
    b: Arc<Faulty>,
}

impl Bench {
    fn new() -> Self {
        Self { a: Faulty::new("a"), b: Faulty::new("b") }
    }

    fn engine(&self, routes: &[String]) -> Engine {
        let engine = Engine::new(plan(routes), &registry(&[&self.a, &self.b]));
        engine.with_types(TypeStore::generated())
    }

    fn start(&self, routes: &[String]) -> Running {
        self.engine(routes).start().unwrap()
    }
}

fn route(name: &str) -> String {
    format!("from: 'a:/{name}', to: 'b:/{name}', type: NativeObject, queue_depth: 1000")
}

fn state(running: &Running, name: &str) -> String {
    of(&running.status(), name).map_or_else(String::new, |route| route.state.to_string())
}

fn of(status: &[RouteStatus], name: &str) -> Option<RouteStatus> {
    let name = format!("a:/{name} -> b:/{name}");
    status.iter().find(|route| route.name == name).cloned()
}

fn threads() -> Vec<String> {
    let all = std::fs::read_dir("/proc/self/task").unwrap().flatten();
    let names = all.filter_map(|one| std::fs::read_to_string(one.path().join("comm")).ok());
    let ours = names.map(|name| name.trim().to_owned());
    ours.filter(|name| name.starts_with("route-") || name == "reconciler").collect()
}

#[test]
fn a_hundred_routes_that_carry_messages_share_a_few_threads() {
    let bench = Bench::new();
    let names: Vec<String> = (0..100).map(|n| format!("t{n}")).collect();
    let routes: Vec<String> = names.iter().map(|name| route(name)).collect();
    let running = bench.start(&routes);
    let mut sinks: Vec<_> =
        names.iter().map(|name| listener(&bench.b.bus, &format!("/{name}"), 1000)).collect();
    let mut sources: Vec<_> =
        names.iter().map(|name| publisher(&bench.a.bus, &format!("/{name}"))).collect();
    until("all to be active", || {
        running.status().iter().all(|route| route.state == RouteState::Active)
    });
    for n in 0..100 {
        sources.iter_mut().for_each(|source| _ = source.publish(&number(n)).unwrap());
    }
    for sink in &mut sinks {
        let mut heard = Vec::new();
        until("every message", || {
            heard.extend(drain(sink.as_mut()));
            heard.len() == 100
        });
        assert_eq!(heard, (0..100).collect::<Vec<_>>());
    }
    // As many workers as cores, at most eight, whatever a busy machine made it start meanwhile.
    until("few threads", || threads().len() <= 10);
}

/// The rate rises with the messages and ends with them, stepped and on threads.
#[test]
fn a_route_shows_the_rate_of_its_last_second() {
    let bench = Bench::new();
    let mut engine = bench.engine(&[route("x")]);
    let mut sink = listener(&bench.b.bus, "/x", 1000);
    let mut source = publisher(&bench.a.bus, "/x");
    let mut now = Instant::now();
    let rate_of = |routes: &[RouteStatus]| {
        let status = of(routes, "x").unwrap();
        (status.messages_per_s, status.bytes_per_s)
    };
    let mut rate = |messages: i64, engine: &mut Engine| {
        for _ in 0..20 {
            (0..messages).for_each(|n| _ = source.publish(&number(n)).unwrap());
            now += 100 * MS;
            engine.step(now);
        }
        drain(sink.as_mut());
        rate_of(&engine.status())
    };
    assert_eq!(rate(0, &mut engine), (0.0, 0));
    assert_eq!(rate(5, &mut engine).0, 50.0);
    assert_eq!(rate(0, &mut engine), (0.0, 0));
    let running = engine.start().unwrap();
    until("a rate", || {
        source.publish(&number(1)).unwrap();
        rate_of(&running.status()).0 > 0.0
    });
    until("none", || rate_of(&running.status()) == (0.0, 0));
}

/// More destinations block than there are threads at the start, and one route goes on.
#[test]
fn a_blocked_destination_holds_up_its_own_route_and_says_so() {
    let bench = Bench::new();
    let blocked: Vec<String> = (0..12).map(|n| format!("stuck{n}")).collect();
    let mut routes: Vec<String> = blocked.iter().map(|name| route(name)).collect();
    routes.push(route("free"));
    let running = bench.start(&routes);
    let mut sources = Vec::new();
    let mut sinks = Vec::new();
    for name in blocked.iter().map(String::as_str).chain(["free"]) {
        sinks.push(listener(&bench.b.bus, &format!("/{name}"), 1000));
        sources.push(publisher(&bench.a.bus, &format!("/{name}")));
    }
    until("all to be active", || {
        running.status().iter().all(|route| route.state == RouteState::Active)
    });
    bench.b.change(|faults| faults.blocked = Some("/stuck".to_owned()));
    sources.iter_mut().for_each(|source| _ = source.publish(&number(1)).unwrap());
    let free = sinks.last_mut().unwrap();
    until("the message of the free route", || !drain(free.as_mut()).is_empty());
    until("the blocked to say so", || {
        blocked.iter().all(|name| state(&running, name).contains("has blocked for"))
    });
    let text = state(&running, "stuck3");
    assert!(text.starts_with("degraded: ") && text.contains("b:/stuck3"), "{text}");
    // Its routes end and others begin while it blocks.
    let next = plan(&[route("free"), route("new")]);
    running.apply(next, TypeStore::generated(), running.registry()).unwrap();
    until("the new route", || state(&running, "new").contains("waiting for a publisher"));
    until("the blocked to be off the table", || running.status().len() == 2);
    sources.last_mut().unwrap().publish(&number(2)).unwrap();
    let free = sinks.last_mut().unwrap();
    until("the second message", || !drain(free.as_mut()).is_empty());
    bench.b.heal();
    let last = running.stop();
    assert_eq!(of(&last, "free").unwrap().counters.sent, 2);
}

#[test]
fn a_stop_does_not_wait_for_a_blocked_step_for_long() {
    let bench = Bench::new();
    let running = bench.start(&[route("stuck")]);
    let (_sink, mut source) =
        (listener(&bench.b.bus, "/stuck", 10), publisher(&bench.a.bus, "/stuck"));
    until("it to be active", || state(&running, "stuck") == "active");
    bench.b.change(|faults| faults.blocked = Some("/stuck".to_owned()));
    source.publish(&number(1)).unwrap();
    until("it to block", || state(&running, "stuck").contains("has blocked"));
    let began = Instant::now();
    let last = running.stop();
    assert!(began.elapsed() < Duration::from_secs(60), "{:?}", began.elapsed());
    assert!(last[0].state.to_string().contains("has blocked"), "{}", last[0].state);
    bench.b.heal();
}

/// A step that panics: taking, sending, opening, and closing after it.
#[test]
fn a_panic_in_a_step_is_told_counted_and_the_route_opened_again() {
    for place in ["take", "publish", "open"] {
        let bench = Bench::new();
        let mut engine = bench.engine(&[route("x"), route("other")]);
        let mut now = Instant::now();
        let mut run = |engine: &mut Engine, time: Duration| {
            for _ in 0..time.as_millis() / 50 {
                now += 50 * MS;
                engine.step(now);
            }
        };
        let (mut sink, mut other) =
            (listener(&bench.b.bus, "/x", 100), listener(&bench.b.bus, "/other", 100));
        let mut source = publisher(&bench.a.bus, "/x");
        if place != "open" {
            run(&mut engine, 200 * MS);
        }
        bench.a.change(|faults| faults.panics_in = Some(place));
        bench.b.change(|faults| faults.panics_in = Some(place));
        source.publish(&number(1)).unwrap();
        if place != "open" {
            source.publish(&number(2)).unwrap();
        }
        run(&mut engine, 50 * MS);
        let told = of(&engine.status(), "x").unwrap();
        let state = told.state.to_string();
        assert!(state.starts_with("error: ") && state.contains("injected"), "{place}: {state}");
        run(&mut engine, 20_000 * MS);
        let told = of(&engine.status(), "x").unwrap();
        if place == "open" {
            assert!((3..=40).contains(&told.panics), "{place}: {} panics", told.panics);
        } else {
            assert_eq!(told.panics, 1, "{place}: it was opened again, and nothing came");
            assert_eq!(told.counters.dropped_for(DropReason::Closed), 2, "{place}");
        }
        bench.a.heal();
        bench.b.heal();
        run(&mut engine, 10_000 * MS);
        let _other_source = publisher(&bench.a.bus, "/other");
        source.publish(&number(3)).unwrap();
        run(&mut engine, 200 * MS);
        assert_eq!(drain(sink.as_mut()), [3], "{place}");
        let told = of(&engine.status(), "x").unwrap();
        assert_eq!(told.state, RouteState::Active, "{place}");
        assert_eq!(told.counters.received, told.counters.sent + told.counters.dropped(), "{place}");
        drain(other.as_mut());
    }
}

/// A panic while the reconciler looks at discovery, or decides on a route, ends no route.
#[test]
fn a_panic_in_a_look_is_told_and_looked_again() {
    for (place, which) in [("look", 0), ("look", 1), ("learn", 0)] {
        let bench = Bench::new();
        let pattern = "from: 'a:/(.*)', to: 'b:/$1', name: all".to_owned();
        let mut engine = bench.engine(&[pattern, "from: 'a:/w', to: 'b:/w', type: Text".into()]);
        let mut now = Instant::now();
        let mut run = |engine: &mut Engine, time: Duration| {
            for _ in 0..time.as_millis() / 100 {
                now += 100 * MS;
                engine.step(now);
            }
        };
        let mut first = publisher(&bench.a.bus, "/first");
        let mut sink = listener(&bench.b.bus, "/first", 100);
        run(&mut engine, 3000 * MS);
        let faulty = [&bench.a, &bench.b][which];
        faulty.change(|faults| faults.panics_in = Some(place));
        let mut second = publisher(&bench.a.bus, "/second");
        let mut second_sink = listener(&bench.b.bus, "/second", 100);
        run(&mut engine, 4000 * MS);
        let status = engine.status();
        let all = status.iter().find(|route| route.name == "all").unwrap();
        assert!(all.panics > 0, "{place}");
        let told = if place == "look" {
            all.state.to_string()
        } else {
            of(&status, "second").unwrap().state.to_string()
        };
        assert!(told.starts_with("error: ") && told.contains("injected"), "{place}: {told}");
        // What runs goes on.
        first.publish(&number(1)).unwrap();
        run(&mut engine, 200 * MS);
        assert_eq!(drain(sink.as_mut()), [1], "{place}");
        faulty.heal();
        run(&mut engine, 12_000 * MS);
        second.publish(&number(2)).unwrap();
        run(&mut engine, 200 * MS);
        assert_eq!(drain(second_sink.as_mut()), [2], "{place}");
    }
}

#[test]
fn what_is_the_same_in_both_plans_goes_on_untouched() {
    let bench = Bench::new();
    let before = [
        route("same"),
        route("gone"),
        route("other"),
        "from: 'a:/p/(.*)', to: 'b:/p/$1', lazy: false".to_owned(),
    ];
    let running = bench.start(&before);
    let names = ["same", "gone", "other", "p/x", "p/y", "new"];
    let mut sinks = names.map(|name| listener(&bench.b.bus, &format!("/{name}"), 10_000));
    let mut sources = names.map(|name| publisher(&bench.a.bus, &format!("/{name}")));
    until("all to be active", || {
        let status = running.status();
        ["same", "gone", "other", "p/x", "p/y"]
            .iter()
            .all(|name| of(&status, name).is_some_and(|it| it.state == RouteState::Active))
    });
    // Messages flow all the while on one that is written, and on one that a pattern made.
    let stop = std::sync::atomic::AtomicBool::new(false);
    let sent = std::thread::scope(|scope| {
        let [same, _, _, x, ..] = &mut sources;
        let flow = scope.spawn(|| {
            let mut n = 0;
            while !stop.load(std::sync::atomic::Ordering::Relaxed) && n < 5000 {
                [&mut *same, &mut *x]
                    .into_iter()
                    .for_each(|it| _ = it.publish(&number(n)).unwrap());
                n += 1;
                std::thread::sleep(MS / 4);
            }
            n
        });
        let after = [
            route("new"),
            "from: 'a:/other', to: 'b:/other', type: NativeObject, queue_depth: 7".to_owned(),
            route("same"),
            "from: 'a:/p/(.*)', to: 'b:/p/$1', lazy: false, deny: ['p/y']".to_owned(),
        ];
        let diff = running.apply(plan(&after), TypeStore::generated(), running.registry()).unwrap();
        assert_eq!((diff.added.len(), diff.removed.len(), diff.changed.len()), (1, 1, 2), "{diff}");
        assert!(diff.to_string().contains("+ a:/new -> b:/new"), "{diff}");
        assert!(diff.to_string().contains("queue 7"), "{diff}");
        until("the new plan", || {
            let status = running.status();
            of(&status, "new").is_some_and(|it| it.state == RouteState::Active)
                && of(&status, "other").is_some_and(|it| it.state == RouteState::Active)
                && of(&status, "gone").is_none()
                && of(&status, "p/y").is_none()
        });
        until("the ends of what was changed", || bench.a.history("/other").opened == 2);
        stop.store(true, std::sync::atomic::Ordering::Relaxed);
        flow.join().unwrap()
    });
    for (sink, name) in [(0, "same"), (3, "p/x")] {
        let mut heard = Vec::new();
        until("every message", || {
            heard.extend(drain(sinks[sink].as_mut()));
            heard.len() as i64 == sent
        });
        assert!(heard.iter().copied().eq(0..sent), "{name}: each once, in order");
        for bus in [&bench.a, &bench.b] {
            assert_eq!(bus.history(&format!("/{name}")).opened, 1, "{name}");
        }
    }
    // And back: what was left out is made again.
    running.apply(plan(&before), TypeStore::generated(), running.registry()).unwrap();
    until("the plan before", || {
        let status = running.status();
        of(&status, "p/y").is_some_and(|it| it.state == RouteState::Active)
            && of(&status, "gone").is_some_and(|it| it.state == RouteState::Active)
            && of(&status, "new").is_none()
    });
    assert_eq!(bench.a.history("/same").opened, 1);
}

#[test]
fn a_plan_that_cannot_hold_is_refused_as_a_whole() {
    let bench = Bench::new();
    let running = bench.start(&[route("x")]);
    let wrong = plan(&[route("y"), "from: 'a:/z', to: 'c:/z', type: Text".to_owned()]);
    let error = running.apply(wrong, TypeStore::generated(), running.registry()).unwrap_err();
    let text = error.to_string();
    assert!(text.contains("\"c\" is not available here"), "{text}");
    let same =
        running.apply(plan(&[route("x")]), TypeStore::generated(), running.registry()).unwrap();
    assert!(same.is_empty() && same.kept == 1, "{same}");
    let status = running.status();
    assert_eq!(status.len(), 1, "{status:?}");
}

/// Routes of a middleware that starts anew begin again, by plan and by pattern; those of others go on.
#[test]
fn a_middleware_that_starts_anew_takes_only_its_own_routes_along() {
    let bench = Bench::new();
    let other = Faulty::new("c");
    let routes = [
        route("x"),
        "from: 'a:/p/(.*)', to: 'b:/p/$1', lazy: false".to_owned(),
        "from: 'a:/stays', to: 'c:/stays', type: NativeObject".to_owned(),
    ];
    let registry_with = |b: &Arc<Faulty>| registry(&[&bench.a, b, &other]);
    let engine = Engine::new(plan(&routes), &registry_with(&bench.b));
    let running = engine.with_types(TypeStore::generated()).start().unwrap();
    let _sources = ["/x", "/p/y", "/stays"].map(|name| publisher(&bench.a.bus, name));
    let _sinks = [
        listener(&bench.b.bus, "/x", 10),
        listener(&bench.b.bus, "/p/y", 10),
        listener(&other.bus, "/stays", 10),
    ];
    let are_active = || {
        let status = running.status();
        let active = status.iter().filter(|it| it.pattern.is_none());
        active.filter(|it| it.state == RouteState::Active).count() == 3
    };
    until("all routes", are_active);
    let anew = bench.b.seen_by_another();
    let types = TypeStore::generated();
    let diff = running.apply(plan(&routes), types, registry_with(&anew)).unwrap();
    assert!(diff.is_empty(), "{diff}");
    for topic in ["/x", "/p/y"] {
        until("its routes on the new one", || anew.history(topic).opened == 1);
        assert_eq!(bench.b.history(topic).opened, 1, "{topic}");
    }
    until("all routes again", are_active);
    assert_eq!([&bench.a, &other].map(|bus| bus.history("/stays").opened), [1, 1]);
}

/// A destination belongs to one route at a time: the next one waits until the one before has closed.
#[test]
fn a_destination_is_taken_over_once_it_is_free() {
    let bench = Bench::new();
    let to = |from: &str| format!("from: 'a:/{from}', to: 'b:/x', type: NativeObject");
    let running = bench.start(&[to("one")]);
    let (mut sink, mut one) = (listener(&bench.b.bus, "/x", 100), publisher(&bench.a.bus, "/one"));
    let mut two = publisher(&bench.a.bus, "/two");
    let active = || running.status().iter().all(|route| route.state == RouteState::Active);
    until("the first", active);
    bench.b.change(|faults| faults.blocked = Some("/x".to_owned()));
    one.publish(&number(1)).unwrap();
    until("it to block", || running.status()[0].state.to_string().contains("has blocked"));
    running.apply(plan(&[to("two")]), TypeStore::generated(), running.registry()).unwrap();
    until("the second to wait", || {
        running.status().iter().any(|route| route.state.to_string().contains("is leaving"))
    });
    bench.b.heal();
    until("the second", || running.status()[0].from == "a:/two" && active());
    two.publish(&number(2)).unwrap();
    let mut heard = Vec::new();
    until("both messages", || {
        heard.extend(drain(sink.as_mut()));
        heard == [1, 2]
    });
}

/// The last of many plans in a short time holds.
#[test]
fn a_thousand_plans_a_second_end_with_the_last() {
    let bench = Bench::new();
    let running = bench.start(&[route("stays"), route("x0")]);
    for n in 1..=1000 {
        let plan = plan(&[route("stays"), route(&format!("x{}", n % 7)), route(&format!("y{n}"))]);
        running.apply(plan, TypeStore::generated(), running.registry()).unwrap();
    }
    until("the last plan", || {
        let status = running.status();
        status.len() == 3 && of(&status, "y1000").is_some() && of(&status, "x6").is_some()
    });
    until("its ends", || bench.b.history("/y1000").opened == 1);
    assert_eq!(bench.a.history("/stays").opened, 1);
}
