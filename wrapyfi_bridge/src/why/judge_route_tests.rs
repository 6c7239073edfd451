//! Findings about the state of a route in a bridge: what it drops, refuses and waits for.

use wrapyfi_endpoint::DropReason;

use super::super::super::Limited;
use super::*;

#[test]
fn a_limit_that_leaves_out_most_messages_is_named_with_both_rates() {
    let limited = |dropped| {
        let way = of_route(|it| {
            it.limited = Some(Limited { max_rate_hz: 1.0, came_hz: Some(49.6), dropped });
        });
        judge(&way)
    };
    let found = limited(0.98).finding.unwrap();
    assert_eq!(found.cause, CauseCode::RateLimit);
    for words in ["max_rate_hz is 1", "49.6 messages a second", "98 %"] {
        assert!(found.what.contains(words), "{found:?}");
    }
    assert!(found.remedy.contains("max_rate_hz: 50"), "{found:?}");
    let halved = limited(0.5);
    assert_eq!(halved.finding, None);
    assert!(halved.passed.iter().any(|step| step.contains("max_rate_hz is 1")), "{halved}");
}

/// State of the route in a bridge, its losses, the cause, words of what is said and of the remedy.
#[test]
fn a_route_that_is_not_well_lacks_something_whatever_is_there() {
    let of = |state: &str, cause: Option<Cause>, lost: &[(&str, u64)]| {
        let (drop_reasons, drop_counts) =
            lost.iter().map(|(reason, count)| ((*reason).to_owned(), *count)).unzip();
        let state = state.to_owned();
        let running =
            RouteInfo { state, received: 100, drop_reasons, drop_counts, ..RouteInfo::default() };
        judge(&Way { running: Some(caused(running, cause.as_ref())), ..whole() })
    };
    let [to, by, bridge] = ["ros2:/x", "ros:/y", "/a"].map(str::to_owned);
    let taken = Cause::DestinationTaken { to: to.clone(), by };
    let reader = Some("/eye".to_owned());
    let stands_still = Cause::Unacknowledged { reader, bytes: 9, remedy: "raise it".to_owned() };
    let lost = |reason, error: &str| Some(Cause::Lost { reason, error: error.to_owned() });
    let listener = Absent::new(Role::Listener, "a listener of", "ros2", "b/C");
    let type_of = |peer: &str| Cause::Type {
        absent: listener.clone(),
        peer: Some(peer.to_owned()),
        theirs: "b/D".to_owned(),
        ours: "b/C".to_owned(),
    };
    for (diagnosis, cause, words) in [
        (
            of("error", Some(Cause::Transport("bad key".to_owned())), &[]),
            CauseCode::State,
            ["state error: bad key", "changed file"],
        ),
        (
            of("waiting", away("the broker"), &[]),
            CauseCode::State,
            ["waits for the broker", "begins"],
        ),
        (
            of("waiting", Some(type_of("/eye")), &[]),
            CauseCode::State,
            ["/eye wants b/D", "write `type: b/D` on the route, or have /eye use b/C"],
        ),
        (
            of("waiting", Some(taken), &[]),
            CauseCode::State,
            ["to which ros:/y goes", "give it a route with another name: {from: \"\", to: \"_2\"}"],
        ),
        (
            of("waiting", Some(Cause::Carried { bridge, to }), &[]),
            CauseCode::State,
            ["the bridge /a, which carries it", "nothing: where that one ends"],
        ),
        (
            of("degraded", Some(Cause::Transport("its step blocks".to_owned())), &[]),
            CauseCode::State,
            ["degraded: its step blocks", "names"],
        ),
        (
            of(
                "degraded",
                lost(DropReason::Malformed, "no such field"),
                &[("malformed", 9), ("no_consumer", 50)],
            ),
            CauseCode::Drops,
            [
                "9 of 100 that came (9 malformed); mostly because their bytes",
                "the type of the route",
            ],
        ),
        (
            of("degraded", Some(stands_still), &[("send_queue_full", 60)]),
            CauseCode::State,
            ["acknowledges nothing: it has ended", "end /eye or start it again"],
        ),
        (
            of("degraded", None, &[("oversize", 108)]),
            CauseCode::Drops,
            ["are dropped: 108, and 100 came (108 oversize)", "a greater `max_message_mib`"],
        ),
        (
            of("active", None, &[("mismatch", 95)]),
            CauseCode::Drops,
            ["95 of 100", "`type` or `encoding`"],
        ),
    ] {
        let found = diagnosis.finding.clone().unwrap_or_else(|| panic!("{words:?} is not found"));
        assert_eq!(found.cause, cause, "{diagnosis}");
        for word in words {
            assert!(diagnosis.to_string().contains(word), "{word:?} is not in {diagnosis}");
        }
    }
    let few = of("active", None, &[("queue_full", 3)]);
    assert_eq!(few.finding, None, "{few}");
    assert!(
        few.passed.iter().any(|step| step.contains("3 of 100 that came (3 queue_full)")),
        "{few}"
    );
    assert_eq!(of("active", None, &[("no_consumer", 100)]).finding, None);
    // Whether that is too few, only its publisher knows.
    let topic = RouteInfo { kind: "topic".to_owned(), ..running("active", None, 9, 9).unwrap() };
    let quiet = judge(&Way { running: Some(topic), ..whole() }).passed;
    assert!(quiet.iter().any(|it| it.contains("9 in, 9 out, 0.0 a second now")), "{quiet:?}");
}

#[test]
fn a_refused_program_is_named_with_its_line_also_where_others_were_served() {
    let of = |received: u64, heard: u64| {
        let mut way = of_source(|it| it.heard = heard);
        way.running = Some(RouteInfo {
            state: "active".to_owned(),
            received,
            sent: received - 7,
            refused: "127.0.0.1:48420: its CURVE key K is not among the clients".to_owned(),
            allow: "- { key: \"K\", publish: [\"/in\"] }".to_owned(),
            drop_reasons: vec!["refused_peer".to_owned()],
            drop_counts: vec![7],
            ..RouteInfo::default()
        });
        judge(&way)
    };
    for alone in [of(7, 0), of(17, 0)] {
        let found = alone.finding.clone().unwrap();
        assert_eq!(found.cause, CauseCode::Refused, "{alone}");
        assert!(found.what.contains("refused 7 times") && found.what.contains("key K"), "{alone}");
        assert!(found.remedy.contains("publish: [\"/in\"]"), "{alone}");
    }
    // Who came before has left: the refusals at that end are told, and at that end alone.
    for (role, is_told) in [(Role::Listener, true), (Role::Publisher, false)] {
        let mut left = of_destination(|it| it.found.clear());
        left.running = running("waiting", absent(Role::Listener, "ros:/out"), 17, 10);
        let status = left.running.as_mut().unwrap();
        (status.refused, status.refused_roles) =
            ("its CURVE key K".to_owned(), vec![role.to_string()]);
        let found = judge(&left).finding.unwrap();
        assert_eq!(found.what.contains("its CURVE key K"), is_told, "{found:?}");
        assert_eq!(found.cause == CauseCode::Refused, is_told, "{found:?}");
        assert!(found.what.contains("nobody listens"), "{found:?}");
    }
    let served = of(17, 4);
    assert_eq!(served.finding, None, "{served}");
    let said = served.passed.join("\n");
    for words in ["10 in, 10 out", "refused 7 times", "publish: [\"/in\"]"] {
        assert!(said.contains(words), "{words:?} is not in {said}");
    }
}
