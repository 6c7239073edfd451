//! Servers of YARP that vanish and come back, also while the name server is away.

use super::*;

/// A server that ends without a word is found again at another address.
#[test]
fn a_server_that_vanishes_is_called_again() {
    let net = YarpNetwork::new();
    let yarp = net.yarp();
    let (here, there) = (Context::default(), Context::default());
    let spec = ServiceSpec::new("/answers", ServiceKind::NativeObject);
    let mut client = yarp.open_client(&spec, &here).unwrap();
    for round in 1..=3 {
        let far = net.yarp();
        let mut server = far.open_server(&spec, &there).unwrap();
        let asked = Request::new([round.into()]);
        let mut ticket = client.send(&asked, TIMEOUT).unwrap();
        wait_until(&here.wake, "an answer", || {
            while let Ok(Some(request)) = server.take() {
                let answer = Value::List(request.request.into_call().unwrap().args);
                server.reply(request.id, Ok(answer.into())).unwrap();
            }
            match client.take_only(ticket) {
                Some(Ok(reply)) => {
                    assert_eq!(reply.payload, Value::List(vec![round.into()]).into());
                    true
                }
                Some(Err(_)) => {
                    ticket = client.send(&asked, TIMEOUT).unwrap();
                    false
                }
                None => false,
            }
        });
    }
}

/// The connection by which a server is called goes on without a name server, also on connections that are new then.
#[test]
fn a_server_is_called_while_the_name_server_is_away_and_after() {
    let mut net = YarpNetwork::new();
    let (yarp, network, here) = (net.yarp(), net.network(), Context::default());
    let robot = Runtime::new().unwrap();
    let requests = PortOptions { rpc: true, ..PortOptions::default() };
    let rpc = network.serve("/rpc", &requests, async |received: Received, _| {
        Answer::Bottle(received.bottle().unwrap_or_default())
    });
    let _rpc = robot.block_on(rpc).unwrap();
    let client = |name: &str| {
        let options = Map::from([("bottle", Value::from(true))]);
        let spec = ServiceSpec { options, ..ServiceSpec::new(name, ServiceKind::NativeObject) };
        yarp.open_client(&spec, &here).unwrap()
    };
    let (mut called, nobody) = (client("/rpc"), client("/nobody"));
    let waits_for = |what: &str| {
        wait_until(&here.wake, what, || {
            let waiting = nobody.link().waiting_for;
            waiting.is_some_and(|waiting| waiting.to_string().starts_with(what))
        });
    };
    let mut call = |calls: i64| {
        // Several at once have a connection each.
        let send = |n: i64| called.send(&Request::new([n.into()]), TIMEOUT).unwrap();
        let mut sent: Vec<_> = (0..calls).map(send).collect();
        wait_until(&here.wake, "the replies", || {
            sent.retain(|ticket| called.take_only(*ticket).map(Result::unwrap).is_none());
            sent.is_empty()
        });
        assert_eq!(called.link().waiting_for, None);
    };
    call(1);
    for calls in [4, 8] {
        net.end();
        waits_for("name server");
        call(calls);
        net.begin();
        waits_for("port /nobody");
        call(calls);
    }
}

/// A program registers its name a moment before its port listens: it is tried again soon, however long it was
/// away.
#[test]
fn a_name_that_is_registered_again_is_tried_soon_and_often() {
    let net = YarpNetwork::new();
    let (yarp, names) = (net.yarp(), net.names());
    let port = std::net::TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let address = port.local_addr().unwrap();
    let request = NameRequest {
        name: "/rpc".to_owned(),
        host: Some(address.ip().to_string()),
        port: Some(address.port()),
        ..NameRequest::default()
    };
    let register = || net.runtime.block_on(names.register(&request)).unwrap();
    register();
    let spec = ServiceSpec::new("/rpc", ServiceKind::NativeObject);
    let _client = yarp.open_client(&spec, &Context::default()).unwrap();
    let next = || {
        drop(port.accept().unwrap());
        Instant::now()
    };
    // Waits grow to between 0.75 and 1.5 s, unless something happens.
    let mut last = next();
    loop {
        let now = next();
        if now - last > Duration::from_millis(750) {
            break;
        }
        last = now;
    }
    // From 0.1 s on, instead of four of the longest. A busy machine may make one of the tries as long.
    let four_waits = || {
        register();
        let times: [Instant; 5] = std::array::from_fn(|_| next());
        times[4] - times[0]
    };
    until("four short waits", || four_waits() < Duration::from_millis(2900));
}

/// Replies come without a length: who reads them has to know how floats are written.
#[test]
fn a_service_of_yarp_4_is_called_with_option_dialect() {
    let net = YarpNetwork::new();
    let (yarp, context) = (net.yarp(), Context::default());
    let other = {
        let host = net.address.ip().to_string();
        let names = NameClient::new(NameServerConf { host, port: net.address.port() });
        let (names, listen, dialect) = (Arc::new(names), net.address.ip(), Dialect::V4);
        Network::new(NetworkOptions { names, listen, dialect, ..NetworkOptions::default() })
    };
    let server = net.runtime.block_on(async {
        let wanted = PortOptions::default();
        let answer = |received: Received, _| async move {
            Answer::Bottle(received.bottle().unwrap_or_default())
        };
        other.serve("/four", &wanted, answer).await.unwrap()
    });
    let options = Map::from([("dialect", Value::from("v4")), ("bottle", true.into())]);
    let spec = ServiceSpec { options, ..ServiceSpec::new("/four", ServiceKind::NativeObject) };
    let mut client = yarp.open_client(&spec, &context).unwrap();
    let ticket =
        client.send(&Request::new([1.5.into(), "and".into(), 2.5.into()]), TIMEOUT).unwrap();
    let mut came = None;
    wait_until(&context.wake, "the reply", || {
        came = client.take_only(ticket);
        came.is_some()
    });
    let payload = came.unwrap().unwrap().payload;
    assert_eq!(payload, Value::List(vec![1.5.into(), "and".into(), 2.5.into()]).into());
    net.runtime.block_on(server.close());
}
