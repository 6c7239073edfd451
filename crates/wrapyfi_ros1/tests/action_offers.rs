//! Choice of the one node that offers an action, and what becomes of goals where another gives way.

use std::time::Instant;

use crate::actions::{Scene, count, goal, status_header};
use crate::common::{Master, RawPublisher, framed, node};
use wrapyfi_conformance::TIMEOUT;
use wrapyfi_endpoint::{
    ActionServer, ActionSpec, Context, GoalOutcome, GoalRequest, GoalUpdate, Middleware as _,
};
use wrapyfi_ros1::xmlrpc::{Value, text};

/// Nodes that have a topic, as the master knows them: publishers where `of` is 0, subscribers where it is 1.
fn nodes_of(master: &Master, of: usize, topic: &str) -> Vec<String> {
    let Value::Array(kinds) = master.ask("getSystemState", vec![text("/test")]).value else {
        panic!()
    };
    let Value::Array(topics) = &kinds[of] else { panic!() };
    let named = topics.iter().find_map(|one| match one {
        Value::Array(pair) if pair[0] == text(topic) => Some(&pair[1]),
        _ => None,
    });
    let Some(Value::Array(nodes)) = named else { return Vec::new() };
    nodes.iter().map(|node| format!("{node:?}")).collect()
}

/// Bridges that begin at once see each other's status at once. Were both to give way, a goal sent in that time would be
/// lost; were both to go on, every goal would.
#[test]
fn of_two_that_begin_at_once_one_offers_the_action() {
    let master = Master::start();
    let nodes = [node(&master, "alpha"), node(&master, "beta")];
    for round in 0..20 {
        let spec = ActionSpec::new(format!("/count{round}"), count());
        let topic = format!("/count{round}/goal");
        let mut servers = nodes
            .each_ref()
            .map(|node| node.open_action_server(&spec, &Context::default()).unwrap());
        let deadline = Instant::now() + TIMEOUT;
        let mut offered = None;
        let waits = |server: &dyn ActionServer| server.link().waiting_for;
        loop {
            assert!(Instant::now() < deadline, "{:?}", servers.map(|it| it.link()));
            for server in &mut servers {
                assert_eq!(server.take(), Ok(None));
            }
            let open = nodes_of(&master, 1, &topic);
            assert!(open.len() <= 1, "{open:?} take its goals");
            if let Some(open) = open.into_iter().next() {
                assert_eq!(offered.get_or_insert_with(|| open.clone()), &open, "it stays");
            }
            // One waits for the other.
            if let Some(by) = &offered
                && let [None, Some(cause)] | [Some(cause), None] =
                    servers.each_ref().map(|it| waits(it.as_ref()))
                && nodes_of(&master, 0, &format!("/count{round}/status")).len() == 1
            {
                let named = ["/alpha", "/beta"].iter().find(|name| by.contains(**name)).unwrap();
                assert!(cause.to_string().contains(named), "{cause}");
                break;
            }
            std::thread::yield_now();
        }
    }
}

/// One that is about to offer the action is silent; what speaks first in the order of names goes on.
#[test]
fn a_bridge_gives_way_to_another_one_by_name_and_only_where_that_one_offers_the_action() {
    let mut scene = Scene::new();
    let offer = |node: &str| {
        let header = status_header().with("callerid", node).with("wrapyfi_action", "1");
        RawPublisher::start(&scene.master, node, "/count/status", &header)
    };
    let (silent, later) = (offer("/aaa"), offer("/zzz"));
    let ticket = scene.client.send(&goal(3)).unwrap();
    let (number, _) = scene.goal();
    scene.until("both are connected", |_| silent.subscribers() > 0 && later.subscribers() > 0);
    let empty = framed(&[0; 20]);
    later.send(&empty);
    let server = scene.server.as_mut().unwrap();
    for _ in 0..100 {
        assert_eq!(server.take(), Ok(None), "it stays");
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    assert_eq!(server.link().waiting_for, None);
    silent.send(&empty);
    assert_eq!(scene.request(), GoalRequest::Cancel(number));
    assert!(scene.server.as_ref().unwrap().link().waiting_for.is_some());
    let mut last = None;
    scene.until("the goal ends", |scene| {
        last = scene.client.take().or(last.take());
        last.as_ref().is_some_and(|(one, update)| *one == ticket && update.is_end())
    });
    let Some((_, GoalUpdate::Ended { text, .. })) = last else { panic!() };
    assert!(text.contains("/aaa"), "{text}");
}

#[test]
fn a_goal_that_nobody_has_read_is_answered_where_the_action_gives_way() {
    let mut scene = Scene::new();
    let ticket = scene.client.send(&goal(3)).unwrap();
    let deadline = Instant::now() + TIMEOUT;
    while scene.contexts[1].counters.snapshot().received == 0 {
        assert!(Instant::now() < deadline, "the goal does not come");
        std::thread::yield_now();
    }
    let rival = RawPublisher::start(&scene.master, "/real", "/count/status", &status_header());
    let server = scene.server.as_mut().unwrap();
    while server.link().waiting_for.is_none() {
        assert!(Instant::now() < deadline, "{} subscribers of the rival", rival.subscribers());
        std::thread::yield_now();
    }
    assert_eq!(server.take(), Ok(None), "neither the goal, which is over, nor its cancellation");
    let mut last = None;
    scene.until("the goal ends", |scene| {
        last = scene.client.take().or(last.take());
        last.as_ref().is_some_and(|(_, update)| update.is_end())
    });
    let (ended, GoalUpdate::Ended { outcome, text, .. }) = last.unwrap() else { panic!() };
    assert_eq!((ended, outcome), (ticket, GoalOutcome::Aborted));
    assert!(text.contains("/real"), "{text}");
}
