//! Connections are asked for as `scenario_persistent_connection.json` and YARP's rules say.

use super::*;

/// Registered ports.
struct Ports(&'static [&'static str]);

impl Known for Ports {
    fn is_port(&self, name: &str) -> bool {
        self.0.contains(&name)
    }
}

const NOW: Duration = Duration::from_secs(100);

fn connect(src: &str, dest: &str) -> Vec<Link> {
    vec![link(src, dest, true)]
}

#[test]
fn a_connection_is_made_when_both_ends_are_there() {
    let mut all = Subscriptions::new(10);
    // The receiver is open, the sender does not exist yet.
    assert_eq!(all.announce("/dst", NOW, &Ports(&["/dst"])), Ok(vec![]));
    assert_eq!(all.subscribe("/src", "tcp://dst", "", &Ports(&["/dst"])), Ok(vec![]));
    let both = Ports(&["/src", "/dst"]);
    assert_eq!(all.announce("/src", NOW, &both), Ok(connect("/src", "tcp://dst")));
    // It goes, and comes again.
    assert_eq!(all.depart("/src", &both), vec![]);
    assert_eq!(all.announce("/src", NOW, &both), Ok(connect("/src", "tcp://dst")));
    // The receiver goes: the sender is told.
    assert_eq!(all.depart("/dst", &both), vec![link("/src", "tcp://dst", false)]);
    all.unsubscribe("/src", "/dst");
    assert_eq!(all.announce("/dst", NOW, &both), Ok(vec![]));
}

#[test]
fn registered_ports_are_connected_at_once() {
    let both = Ports(&["/wf", "/wf:in"]);
    let mut all = Subscriptions::new(10);
    assert_eq!(
        all.subscribe("tcp://wf", "tcp://wf:in", "", &both),
        Ok(connect("tcp://wf", "tcp://wf:in"))
    );
}

#[test]
fn modes_end_subscriptions_with_one_of_their_ends() {
    let both = Ports(&["/a", "/b"]);
    let kept = |all: &Subscriptions| all.list("").count();
    for (mode, goes, stays) in [("from", "/a", "/b"), ("to", "/b", "/a")] {
        let mut all = Subscriptions::new(10);
        all.subscribe("/a", "/b", mode, &both).unwrap();
        all.depart(stays, &both);
        assert_eq!(kept(&all), 1, "{mode}");
        all.depart(goes, &both);
        assert_eq!(kept(&all), 0, "{mode}");
        // Without the port it should end with, it ends at once.
        all.subscribe("/a", "/b", mode, &Ports(&[])).unwrap();
        assert_eq!(kept(&all), 0, "{mode}");
    }
}

#[test]
fn silence_counts_only_of_ports_that_settled() {
    let both = Ports(&["/a", "/b"]);
    let mut all = Subscriptions::new(10);
    all.announce("/a", NOW, &both).unwrap();
    all.subscribe("/a", "/b", "", &Ports(&[])).unwrap();
    all.doubt("/a", NOW + Duration::from_secs(30));
    assert_eq!(all.announce("/b", NOW, &both), Ok(connect("/a", "/b")));
    all.doubt("/a", NOW + Duration::from_secs(31));
    assert_eq!(all.announce("/b", NOW, &both), Ok(vec![]));
}

#[test]
fn topics_connect_every_publisher_with_every_subscriber() {
    let ports = Ports(&["/p1", "/p2", "/s1"]);
    let mut all = Subscriptions::new(10);
    for name in ["/p1", "/p2", "/s1"] {
        all.announce(name, NOW, &ports).unwrap();
    }
    assert_eq!(all.subscribe("/p1", "topic://t", "", &ports), Ok(vec![]));
    assert_eq!(all.subscribe("topic://t", "/s1", "", &ports), Ok(connect("/p1", "/s1")));
    assert_eq!(all.subscribe("/p2", "topic://t", "", &ports), Ok(connect("/p2", "/s1")));
    assert_eq!(all.topics, ["/t"]);
    let flags: Vec<_> = all.list("").map(|(_, src, dest)| (src, dest)).collect();
    assert_eq!(flags, [(false, true), (false, true), (true, false)]);
    all.remove_topic("/t");
    assert_eq!(all.announce("/s1", NOW, &ports), Ok(vec![]));
}

#[test]
fn what_is_kept_is_bounded() {
    let none = Ports(&[]);
    let mut all = Subscriptions::new(2);
    for dest in ["/b", "/c"] {
        all.subscribe("/a", dest, "", &none).unwrap();
        all.announce(dest, NOW, &none).unwrap();
        all.add_topic(dest, &none).unwrap();
        all.set_type(dest, "").unwrap();
    }
    let full = Err(TooMany { limit: 2 });
    assert_eq!(all.subscribe("/a", "/d", "", &none), full);
    assert_eq!(all.announce("/d", NOW, &none), full);
    assert_eq!(all.add_topic("/d", &none), full);
    assert_eq!(all.set_type("/d", ""), Err(TooMany { limit: 2 }));
    // One that is there may change.
    all.subscribe("/a", "/b", "from", &Ports(&["/a"])).unwrap();
}
