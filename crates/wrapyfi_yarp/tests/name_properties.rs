//! Properties that a name server keeps under any commands.

use std::collections::{BTreeMap, BTreeSet};

use proptest::prelude::*;
use wrapyfi_yarp::WireLimits;
use wrapyfi_yarp::name::Target;
use wrapyfi_yarp::server::NameServerLimits;
use wrapyfi_yarp::server::offline::{Offline, read_answer};

fn server() -> Offline {
    Offline::new(NameServerLimits::default(), WireLimits::default())
}

/// One of few names, so that things happen to the same ones.
fn name() -> impl Strategy<Value = String> {
    (0..6_u8).prop_map(|at| format!("/port/{at}"))
}

#[derive(Debug, Clone)]
enum Operation {
    Register(String),
    RegisterAt(String, u16),
    RegisterUnnamed,
    RegisterGroup(String),
    Unregister(String),
}

fn step() -> impl Strategy<Value = Operation> {
    prop_oneof![
        name().prop_map(Operation::Register),
        (name(), 1..=u16::MAX).prop_map(|(name, port)| Operation::RegisterAt(name, port)),
        Just(Operation::RegisterUnnamed),
        name().prop_map(Operation::RegisterGroup),
        name().prop_map(Operation::Unregister),
    ]
}

proptest! {
    /// Any bytes are answered with lines, and the answer to lines ends.
    #[test]
    fn any_line_is_answered(lines in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..80), 0..20)) {
        let mut server = server();
        for line in lines {
            let answer = server.ask(&line);
            prop_assert!(answer.ends_with(b"\r\n"));
            let ended = answer.ends_with(b"*** end of message\r\n");
            let one = answer.iter().filter(|&&byte| byte == b'\n').count() == 1;
            prop_assert!(ended || one, "{}", String::from_utf8_lossy(&answer));
        }
    }

    /// Commands and values that words make of names are answered, too.
    #[test]
    fn words_in_any_order_are_answered(
        words in prop::collection::vec(
            prop::sample::select(vec![
                "register", "unregister", "query", "list", "set", "get", "check", "bot", "...", "=x",
                "/a", "/a/b", "owns", "ips", "mcast", "tcp", "topic", "topic://t", "untopic", "announce",
                "subscribe", "unsubscribe", "type", "yarp", "runners", "gc", "help", "route", "-1", "0",
                "10002", "70000", "1.5", "(a b)", "[vocab]", "{1 2}", "\"\"", "\"\\n\"", "NAME_SERVER",
            ]),
            0..7,
        ),
        again in 1..4_usize,
    ) {
        let mut server = server();
        for _ in 0..again {
            let answer = server.ask(words.join(" ").as_bytes());
            prop_assert!(answer.ends_with(b"\r\n"));
        }
        prop_assert!(server.names() >= 2, "its own name and that of the group stay");
    }

    /// Numbers that the server chooses are no other program's, names keep theirs, and all returns.
    #[test]
    fn numbers_are_given_once(steps in prop::collection::vec(step(), 0..60)) {
        let mut server = server();
        let mut ports: BTreeMap<String, u16> = BTreeMap::new();
        for step in steps {
            let (line, chosen) = match &step {
                Operation::Register(name) => (format!("register {name}"), true),
                Operation::RegisterAt(name, port) => {
                    (format!("register {name} tcp 1.2.3.4 {port}"), false)
                }
                Operation::RegisterUnnamed => ("register ...".to_owned(), true),
                Operation::RegisterGroup(name) => (format!("register {name} mcast ... ..."), true),
                Operation::Unregister(name) => (format!("unregister {name}"), false),
            };
            let found = read_answer(&server.ask(line.as_bytes()), &WireLimits::default()).unwrap();
            if let Operation::Unregister(name) = &step {
                prop_assert!(found.is_empty());
                ports.remove(name);
                continue;
            }
            let found = found.into_iter().next().unwrap();
            ports.remove(&found.name);
            if chosen {
                prop_assert!((10_002..=19_999).contains(&found.port));
                prop_assert!(!ports.values().any(|&port| port == found.port), "{found:?}");
            }
            ports.insert(found.name, found.port);
        }
        let listed = read_answer(&server.ask(b"list"), &WireLimits::default()).unwrap();
        let listed: BTreeMap<_, _> = listed
            .into_iter()
            .filter(|port| port.name.starts_with("/port/") || port.name.starts_with("/tmp/"))
            .map(|port| (port.name, port.port))
            .collect();
        prop_assert_eq!(&listed, &ports);
        for name in ports.keys() {
            server.ask(format!("unregister {name}").as_bytes());
        }
        prop_assert_eq!(server.names(), 2);
        // Groups and unnamed ports begin again.
        let first = read_answer(&server.ask(b"register ..."), &WireLimits::default()).unwrap();
        prop_assert!(first[0].name.starts_with("/tmp/port/"));
    }

    /// Values come back in the order of their bytes, as often as they were set.
    #[test]
    fn properties_come_back_sorted(values in prop::collection::vec("[a-z]{1,6}", 0..12)) {
        let mut server = server();
        server.ask(b"register /a");
        let answer = server.ask(format!("set /a key {}", values.join(" ")).as_bytes());
        let mut sorted = values.clone();
        // Words that mean a truth value or nothing are stored by that name.
        sorted.sort_unstable();
        let line = ["port", "/a", "property", "key", "="].into_iter().map(str::to_owned);
        let line = line.chain(sorted).collect::<Vec<_>>().join(" ");
        prop_assert_eq!(
            String::from_utf8(answer).unwrap(),
            format!("{line}\r\n*** end of message\r\n")
        );
    }

    /// A name with a carrier and a network comes apart into what it was made of.
    #[test]
    fn targets_come_apart(carrier in "[a-z_]{0,8}(\\+[a-z]{1,4}\\.[a-z]{1,4})?", network in "[0-9.]{0,6}", name in "(/[a-z]{1,5}){1,3}") {
        let network_part = if network.is_empty() { String::new() } else { format!("/net={network}") };
        let text = match carrier.as_str() {
            "" => format!("{network_part}{name}"),
            carrier => format!("{carrier}:/{network_part}{name}"),
        };
        prop_assert_eq!(Target::parse(&text), Target { carrier, network, name });
    }

    /// Prefixes match whole components.
    #[test]
    fn prefixes_match_components(names in prop::collection::btree_set("(/[ab]{1,2}){1,3}", 1..12), prefix in "(/[ab]{1,2}){1,2}") {
        let mut server = server();
        for name in &names {
            server.ask(format!("register {name}").as_bytes());
        }
        let listed = read_answer(&server.ask(format!("list {prefix}").as_bytes()), &WireLimits::default());
        let listed: BTreeSet<_> = listed.unwrap().into_iter().map(|port| port.name).collect();
        let under = |name: &&String| {
            name.split('/').zip(prefix.split('/')).all(|(a, b)| a == b)
                && name.split('/').count() >= prefix.split('/').count()
        };
        let expected: BTreeSet<_> = names.iter().filter(under).cloned().collect();
        prop_assert_eq!(listed, expected);
    }
}
