//! Requests and replies: what every middleware with services must do.

use std::time::{Duration, Instant};

use wrapyfi_data::types::{
    AudioChunk, DataType, Encoding, Image, Map, Payload, Pixels, SampleFormat, ServiceKind, Stamp,
    Value,
};
use wrapyfi_data::{DecodeError, EncodeError};
use wrapyfi_endpoint::{CallError, DropReason, Request, ServeError, ServiceSpec};

use crate::ends::unusable;
use crate::payloads::{frame, rich, sound};
use crate::service_ends::{ClientEnd, SOON, ServerEnd, call_and_serve};
use crate::{TIMEOUT, Testbed, WireEnd, wait_until};

fn native(name: &str) -> ServiceSpec {
    ServiceSpec::new(name, ServiceKind::NativeObject)
}

fn list(items: impl Into<Vec<Value>>) -> Payload {
    Value::List(items.into()).into()
}

/// The payload as it can be compared: without its time, where replies have none.
fn timed<R: Testbed>(payload: &Payload) -> Payload {
    match payload.clone() {
        reply if R::CAPABILITIES.reply_stamps => reply,
        Payload::Image(image) => Image { stamp: Stamp::default(), ..image }.into(),
        Payload::AudioChunk(sound) => AudioChunk { stamp: Stamp::default(), ..sound }.into(),
        other => other,
    }
}

/// A call is answered, whichever side serves, and whichever end came first.
pub fn a_call_is_answered<R: Testbed>() {
    for at in WireEnd::BOTH {
        for server_first in [true, false] {
            let testbed = R::start();
            let spec = native("/answered");
            let (mut client_end, mut server_end, ticket);
            if server_first {
                server_end = ServerEnd::open(testbed.side(at), &spec);
                client_end = ClientEnd::open(testbed.side(at.other()), &spec);
                ticket = client_end.ask([1.into(), "a".into()]);
            } else {
                client_end = ClientEnd::open(testbed.side(at.other()), &spec);
                ticket = client_end.ask([1.into(), "a".into()]);
                server_end = ServerEnd::open(testbed.side(at), &spec);
            }
            let reply = client_end.await_echo(ticket, &mut server_end);
            assert_eq!(reply, Ok(list([1.into(), "a".into()])));
            assert_eq!(client_end.ended(ticket), None, "a call ends once");
        }
    }
}

/// Arguments and keyword arguments arrive as they were given, whatever they are.
pub fn arguments_arrive_unchanged<R: Testbed>() {
    let testbed = R::start();
    let (mut client_end, mut server_end) =
        call_and_serve(&testbed, WireEnd::Far, &native("/arguments"));
    let Payload::NativeObject(everything) = rich() else { unreachable!() };
    for request in [
        Request::default(),
        Request::new([Value::Null, 1.into(), "text".into()]),
        Request::new([]).with(Map::from([("scale", Value::from(0.5)), ("on", true.into())])),
        Request::new([everything.value.clone(), Value::Tuple(vec![1.into()])])
            .with(Map::from([("rich", everything.value)])),
    ] {
        let ticket = client_end.client.send(&request, TIMEOUT).unwrap();
        let asked = server_end.receive();
        assert_eq!(asked.request, request);
        server_end.answer(asked.id, Value::from("done"));
        assert_eq!(client_end.await_echo(ticket, &mut server_end), Ok(Value::from("done").into()));
    }
}

/// Values that a function returns arrive as they were, for every kind of service.
pub fn every_kind_is_returned<R: Testbed>() {
    for kind in ServiceKind::ALL {
        let testbed = R::start();
        let spec = ServiceSpec::new("/kind", kind);
        let (mut client_end, mut server_end) = call_and_serve(&testbed, WireEnd::Near, &spec);
        let payloads = match kind.data_type() {
            DataType::Image => vec![
                frame(4, 3, Encoding::Bgr8),
                frame(640, 480, Encoding::Bgr8),
                frame(5, 4, Encoding::Mono8),
            ],
            DataType::AudioChunk => vec![sound(441, 2, SampleFormat::F32Le)],
            _ => vec![rich(), list([])],
        };
        let conversion = ServiceSpec::new("/kind", kind).conversion();
        let converted = |payload: Payload| match &conversion {
            Some(conversion) => conversion.convert(payload, Stamp::now).unwrap(),
            None => payload,
        };
        for payload in payloads.into_iter().map(converted) {
            let ticket = client_end.ask([7.into()]);
            let asked = server_end.receive();
            server_end.answer(asked.id, payload.clone());
            let reply = client_end.await_with(ticket, || _ = server_end.take());
            let Ok(reply) = reply else { panic!("{kind}: {reply:?}") };
            match reply {
                // A file that goes as pixels, because a wire has no other form, does not become the same bytes again.
                Payload::Image(Image { pixels: Pixels::Raw(raw), .. })
                    if kind == ServiceKind::CompressedImage && R::CAPABILITIES.wire =>
                {
                    assert!(raw.width > 0, "{kind}");
                }
                reply => assert!(timed::<R>(&reply) == timed::<R>(&payload), "{kind}: {reply:?}"),
            }
        }
    }
}

/// Several calls under way are answered in any order, each with its own reply.
pub fn calls_are_answered_in_any_order<R: Testbed>() {
    let testbed = R::start();
    let (mut client_end, mut server_end) =
        call_and_serve(&testbed, WireEnd::Far, &native("/order"));
    let tickets: Vec<_> = (0..8).map(|n| client_end.ask([n.into()])).collect();
    let mut asked: Vec<_> = (0..8).map(|_| server_end.receive()).collect();
    asked.reverse();
    for request in asked {
        server_end.answer(request.id, Value::List(request.request.into_call().unwrap().args));
    }
    for (n, ticket) in tickets.into_iter().enumerate() {
        let n = i64::try_from(n).unwrap();
        assert_eq!(client_end.await_echo(ticket, &mut server_end), Ok(list([n.into()])));
    }
}

/// The blocking call, and the bell that wakes it.
pub fn a_blocking_call_returns<R: Testbed>() {
    let testbed = R::start();
    let (mut client_end, mut server_end) =
        call_and_serve(&testbed, WireEnd::Far, &native("/blocking"));
    let server = std::thread::spawn(move || {
        for _ in 0..3 {
            let asked = server_end.receive();
            server_end.answer(asked.id, Value::List(asked.request.into_call().unwrap().args));
        }
        server_end
    });
    for n in 0..3 {
        let reply = client_end.client.call(&Request::new([n.into()]), TIMEOUT).unwrap();
        assert_eq!(reply.payload, list([n.into()]));
    }
    // Nothing was sent that its client may not have heard: the server may end.
    drop(server.join().unwrap());
}

/// An error of the server arrives as an error, in its words.
pub fn an_error_is_told<R: Testbed>() {
    for kind in [ServiceKind::NativeObject, ServiceKind::Image, ServiceKind::AudioChunk] {
        let testbed = R::start();
        let spec = ServiceSpec::new("/error", kind);
        let (mut client_end, mut server_end) = call_and_serve(&testbed, WireEnd::Near, &spec);
        let ticket = client_end.ask([]);
        let asked = server_end.receive();
        server_end.server.reply(asked.id, Err("no \"camera\" is open".into())).unwrap();
        let told = client_end.await_with(ticket, || _ = server_end.take()).unwrap_err();
        let CallError::Refused { reason, .. } = &told else { panic!("{told:?}") };
        assert_eq!(reason, "no \"camera\" is open");
    }
}

/// An answer of another kind than the service returns is refused, and the client is told.
pub fn an_answer_of_another_kind_is_refused<R: Testbed>() {
    let testbed = R::start();
    let spec = ServiceSpec::new("/other_kind", ServiceKind::Image);
    let (mut client_end, mut server_end) = call_and_serve(&testbed, WireEnd::Near, &spec);
    let ticket = client_end.ask([]);
    let asked = server_end.receive();
    let refused = server_end.server.reply(asked.id, Ok(list([]))).unwrap_err();
    let ServeError::Reply { fault: EncodeError::Mismatch { .. }, .. } = &refused else {
        panic!("{refused:?}")
    };
    assert_eq!(server_end.dropped_for(DropReason::Unencodable), 1);
    let told = client_end.await_with(ticket, || _ = server_end.take()).unwrap_err();
    assert!(matches!(told, CallError::Refused { .. }), "{told:?}");
    let twice = server_end.server.reply(asked.id, Ok(frame(1, 1, Encoding::Bgr8)));
    assert!(matches!(twice, Err(ServeError::NotWaiting { .. })), "{twice:?}");
}

/// A client that expects another kind is never given what it cannot use.
pub fn a_client_of_another_kind_is_told<R: Testbed>() {
    let testbed = R::start();
    let mut server_end = ServerEnd::open(testbed.side(WireEnd::Near), &native("/contested"));
    let sound = ServiceSpec::new("/contested", ServiceKind::AudioChunk);
    let mut client_end = ClientEnd::open(testbed.side(WireEnd::Far), &sound);
    let ticket = client_end.ask_within([], Duration::from_secs(3));
    let told = client_end.await_with(ticket, || _ = server_end.echo()).unwrap_err();
    match told {
        // It was asked and said no, or the types never met.
        CallError::Refused { .. } => assert_eq!(server_end.dropped_for(DropReason::Mismatch), 1),
        CallError::TimedOut { .. } => assert!(server_end.counters().received == 0),
        // Types are not looked at: what came is refused where it is read.
        CallError::Reply { .. } => {}
        other => panic!("{other:?}"),
    }
    let mut right = ClientEnd::open(testbed.side(WireEnd::Far), &native("/contested"));
    let ticket = right.ask([1.into()]);
    assert_eq!(right.await_echo(ticket, &mut server_end), Ok(list([1.into()])));
}

/// With no server a call ends at its time, with the reason; what comes after works.
pub fn without_a_server_a_call_times_out<R: Testbed>() {
    let testbed = R::start();
    let spec = native("/nobody");
    let mut client_end = ClientEnd::open(testbed.side(WireEnd::Far), &spec);
    let begin = Instant::now();
    let error = client_end.client.call(&Request::default(), SOON).unwrap_err();
    let CallError::TimedOut { timeout_ms, why, .. } = &error else { panic!("{error:?}") };
    assert!(*timeout_ms == 200 && !why.is_empty(), "{error}");
    assert!(begin.elapsed() >= SOON);
    let ticket = client_end.ask([5.into()]);
    let mut server_end = ServerEnd::open(testbed.side(WireEnd::Near), &spec);
    // A request that its client has given up must not be done late.
    assert_eq!(client_end.await_echo(ticket, &mut server_end), Ok(list([5.into()])));
    assert_eq!(server_end.counters().sent, 1, "the request that timed out was served, too");
}

/// A reply after its time is dropped and counted, and does not disturb the next call.
pub fn late_replies_are_counted<R: Testbed>() {
    let testbed = R::start();
    let (mut client_end, mut server_end) =
        call_and_serve(&testbed, WireEnd::Near, &native("/late"));
    for round in 1..=3 {
        let ticket = client_end.ask_within([round.into()], Duration::from_millis(500));
        let asked = server_end.receive();
        let error = client_end.await_with(ticket, || ()).unwrap_err();
        assert!(matches!(error, CallError::TimedOut { .. }), "{error:?}");
        server_end.answer(asked.id, Value::from("late"));
        wait_until(client_end.context.wake.clone(), "the late reply", || {
            assert!(client_end.client.take().is_none());
            _ = server_end.take();
            client_end.counters().dropped_for(DropReason::Late) == round as u64
        });
        let ticket = client_end.ask(["next".into()]);
        assert_eq!(client_end.await_echo(ticket, &mut server_end), Ok(list(["next".into()])));
    }
}

/// A request that is never answered wedges neither side, and its client is told.
pub fn an_unanswered_request_ends<R: Testbed>() {
    let testbed = R::start();
    let spec = ServiceSpec { timeout: Duration::from_secs(1), ..native("/unanswered") };
    let (mut client_end, mut server_end) = call_and_serve(&testbed, WireEnd::Near, &spec);
    let ticket = client_end.ask([1.into()]);
    let forgotten = server_end.receive();
    let told = client_end.await_with(ticket, || _ = server_end.take()).unwrap_err();
    let CallError::Refused { reason, .. } = &told else { panic!("{told:?}") };
    assert!(reason.contains("1000 ms"), "{reason}");
    assert_eq!(server_end.dropped_for(DropReason::Expired), 1);
    let too_late = server_end.server.reply(forgotten.id, Ok(list([])));
    assert!(matches!(too_late, Err(ServeError::NotWaiting { .. })), "{too_late:?}");
    let ticket = client_end.ask([2.into()]);
    assert_eq!(client_end.await_echo(ticket, &mut server_end), Ok(list([2.into()])));
}

/// Beyond the calls that may be under way a client is refused at once, a server refuses aloud.
pub fn more_than_the_limit_is_refused<R: Testbed>() {
    let testbed = R::start();
    let spec = ServiceSpec { pending: 3, ..native("/limit") };
    let (mut narrow, mut server_end) = call_and_serve(&testbed, WireEnd::Near, &spec);
    let mut wide = ClientEnd::open(testbed.side(WireEnd::Far), &native("/limit"));
    wide.ready();
    let tickets: Vec<_> = (0..4).map(|n| wide.ask([n.into()])).collect();
    let mut asked = Vec::new();
    let mut told = Vec::new();
    wait_until(wide.context.wake.clone(), "one refusal", || {
        asked.extend(server_end.take());
        told.extend(tickets.iter().filter_map(|&ticket| wide.ended(ticket)));
        asked.len() == 3 && !told.is_empty()
    });
    let Some(Err(CallError::Refused { reason, .. })) = told.first() else { panic!("{told:?}") };
    assert!(reason.contains("3 requests"), "{reason}");
    assert_eq!(server_end.dropped_for(DropReason::Overloaded), 1);
    for request in asked {
        server_end.answer(request.id, Value::Null);
    }

    for n in 0..3 {
        narrow.ask([n.into()]);
    }
    let refused = narrow.client.send(&Request::default(), TIMEOUT).unwrap_err();
    assert!(matches!(refused, CallError::TooMany { limit: 3, .. }), "{refused:?}");
    assert!(refused.to_string().contains("/limit"), "{refused}");
    let mut answered = 0;
    wait_until(narrow.context.wake.clone(), "the three", || {
        server_end.echo();
        while let Some((_, reply)) = narrow.client.take() {
            reply.unwrap();
            answered += 1;
        }
        answered == 3
    });
}

/// A server that ends and comes back is asked again, and so is a client's side.
pub fn a_server_that_restarts_is_asked_again<R: Testbed>() {
    for at in WireEnd::BOTH {
        let mut testbed = R::start();
        let spec = native("/restart");
        let (mut client_end, mut server_end) = call_and_serve(&testbed, at, &spec);
        for round in 1..=2 {
            drop(server_end);
            testbed.restart(at);
            server_end = ServerEnd::open(testbed.side(at), &spec);
            // A call that was lost with the old server ends by its time, the next one is answered.
            let mut ticket = client_end.ask_within([round.into()], Duration::from_secs(5));
            wait_until(client_end.context.wake.clone(), "an answer of the new server", || {
                server_end.echo();
                match client_end.ended(ticket) {
                    Some(Ok(reply)) => {
                        assert_eq!(reply, list([round.into()]));
                        return true;
                    }
                    Some(Err(_)) => {
                        ticket = client_end.ask_within([round.into()], Duration::from_secs(5));
                    }
                    None => {}
                }
                false
            });
        }
    }
}

/// Several clients at once each get their own replies.
pub fn several_clients_get_their_own_replies<R: Testbed>() {
    let testbed = R::start();
    let (first, mut server_end) = call_and_serve(&testbed, WireEnd::Near, &native("/several"));
    let mut callers = vec![first];
    callers
        .extend((0..3).map(|_| ClientEnd::open(testbed.side(WireEnd::Far), &native("/several"))));
    let tickets: Vec<Vec<_>> = callers
        .iter_mut()
        .enumerate()
        .map(|(who, client_end)| {
            let who = i64::try_from(who).unwrap();
            (0..5_i64).map(|n| client_end.ask([who.into(), n.into()])).collect()
        })
        .collect();
    for (who, (client_end, tickets)) in callers.iter_mut().zip(tickets).enumerate() {
        let who = i64::try_from(who).unwrap();
        for (n, ticket) in tickets.into_iter().enumerate() {
            let n = i64::try_from(n).unwrap();
            assert_eq!(
                client_end.await_echo(ticket, &mut server_end),
                Ok(list([who.into(), n.into()]))
            );
        }
    }
    assert_eq!(server_end.counters().sent, 21);
}

/// A reply that is too large is refused before it is sent, or reported, and the next call is
/// answered.
pub fn what_is_too_large_to_return_is_told<R: Testbed>() {
    let testbed = R::start();
    let mut spec = ServiceSpec::new("/large", ServiceKind::Image);
    spec.limits.message_bytes = 40_000;
    let (mut client_end, mut server_end) = call_and_serve(&testbed, WireEnd::Near, &spec);
    let much = Request::new([Value::from("x".repeat(50_000))]);
    let refused = client_end.client.send(&much, TIMEOUT).unwrap_err();
    let CallError::Request { fault, .. } = &refused else { panic!("{refused:?}") };
    assert!(matches!(fault, EncodeError::TooLarge { limit: 40_000, .. }), "{fault:?}");

    let ticket = client_end.ask([]);
    let asked = server_end.receive();
    let refused =
        server_end.server.reply(asked.id, Ok(frame(200, 200, Encoding::Bgr8))).unwrap_err();
    let ServeError::Reply { fault: EncodeError::TooLarge { .. }, .. } = &refused else {
        panic!("{refused:?}")
    };
    let told = client_end.await_with(ticket, || _ = server_end.take()).unwrap_err();
    assert!(matches!(&told, CallError::Refused { .. }), "{told:?}");

    let mut narrow = spec.clone();
    narrow.limits.message_bytes = 20_000;
    let mut small = ClientEnd::open(testbed.side(WireEnd::Far), &narrow);
    small.ready();
    let ticket = small.ask_within([], Duration::from_secs(3));
    let asked = server_end.receive();
    server_end.answer(asked.id, frame(90, 90, Encoding::Bgr8));
    let told = small.await_with(ticket, || _ = server_end.take()).unwrap_err();
    match &told {
        CallError::Reply { fault: DecodeError::TooLarge { limit, .. }, .. } => {
            assert_eq!(*limit, 20_000);
            assert_eq!(small.counters().dropped_for(DropReason::Oversize), 1);
        }
        // A middleware that cannot tell whose so large a reply is says that the call waited in
        // vain.
        CallError::TimedOut { .. } => assert!(R::CAPABILITIES.drops_large_replies_unread),
        other => panic!("{other:?}"),
    }
    let ticket = small.ask([]);
    let asked = server_end.receive();
    server_end.answer(asked.id, frame(5, 5, Encoding::Bgr8));
    let reply = small.await_with(ticket, || _ = server_end.take());
    let reply = reply.map(|reply| timed::<R>(&reply));
    assert_eq!(reply, Ok(timed::<R>(&frame(5, 5, Encoding::Bgr8))));
}

/// Requests that are none: each is counted and its client told, and the next one is served.
pub fn requests_that_are_none_are_told<R: Testbed>() {
    let mut testbed = R::start();
    let spec = native("/broken");
    let (mut client_end, mut server_end) = call_and_serve(&testbed, WireEnd::Near, &spec);
    let bodies: [&[u8]; 7] =
        [b"", b"{", b"[]", b"[1, 2]", b"\xff\xff\xff\xff", b"{\"args\": 5}", &[b'['; 1000]];
    for (sent, body) in bodies.into_iter().enumerate() {
        testbed.inject_request(&spec, body);
        wait_until(server_end.context.wake.clone(), "the broken request", || {
            assert!(server_end.take().is_none(), "a request out of {body:?}");
            unusable(&server_end.counters()) == sent as u64 + 1
        });
    }
    assert_eq!(server_end.refused.len(), bodies.len());
    let ticket = client_end.ask([1.into()]);
    assert_eq!(client_end.await_echo(ticket, &mut server_end), Ok(list([1.into()])));
}

/// A call that was cancelled never ends, and its reply is late.
pub fn a_cancelled_call_is_forgotten<R: Testbed>() {
    let testbed = R::start();
    let (mut client_end, mut server_end) =
        call_and_serve(&testbed, WireEnd::Near, &native("/cancelled"));
    let ticket = client_end.ask([1.into()]);
    let asked = server_end.receive();
    client_end.client.cancel(ticket);
    server_end.answer(asked.id, Value::Null);
    wait_until(client_end.context.wake.clone(), "the late reply", || {
        assert!(client_end.client.take().is_none());
        _ = server_end.take();
        client_end.counters().dropped_for(DropReason::Late) == 1
    });
}
