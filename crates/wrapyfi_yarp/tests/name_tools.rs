//! Commands of YARP's tools, taken from their source where no recording has them.

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use wrapyfi_yarp::server::{NameServer, NameServerOptions};

async fn server() -> NameServer {
    let options = NameServerOptions {
        port: 0,
        advertised_port: Some(10_000),
        skip_busy_ports: false,
        make_connections: false,
        ..NameServerOptions::default()
    };
    NameServer::start(options).await.unwrap()
}

/// Text that the server sends until it closes.
async fn say(server: &NameServer, text: &str) -> String {
    let mut stream = TcpStream::connect(server.address()).await.unwrap();
    stream.write_all(text.as_bytes()).await.unwrap();
    stream.shutdown().await.unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).await.unwrap();
    answer
}

/// `yarp clean` asks the namespace's port for all names, tests each, and has the server tidy up.
#[tokio::test]
async fn yarp_clean_reads_the_names_and_takes_the_dead_away() {
    let server = server().await;
    say(&server, "NAME_SERVER register /dead tcp 127.0.0.1 19998\r\n").await;
    say(&server, "NAME_SERVER register /group mcast ... ...\r\n").await;
    let listed = say(&server, "CONNACK admin\r\nd\r\nbot list\r\n").await;
    assert_eq!(
        listed,
        "Welcome admin\r\n\
         ports (port (name \"/dead\") (ip \"127.0.0.1\") (port_number 19998) (carrier tcp)) \
         (port (name \"/group\") (ip \"224.1.1.3\") (port_number 10002) (carrier mcast)) \
         (port (name \"/root\") (ip \"127.0.0.1\") (port_number 10000) (carrier tcp)) \
         (port (name fallback) (ip \"224.2.1.1\") (port_number 10000) (carrier mcast))\r\n<ACK>\r\n"
    );
    assert_eq!(say(&server, "NAME_SERVER unregister /dead\n").await, "*** end of message\r\n");
    let tidied = say(&server, "CONNACK admin\r\nd\r\ngc\r\n").await;
    assert_eq!(
        tidied,
        "Welcome admin\r\ngarbage collection done.\r\n*** end of message\r\n<ACK>\r\n"
    );
    let left = say(&server, "NAME_SERVER query /dead\n").await;
    assert_eq!(left, "*** end of message\r\n");
    server.stop().await;
}

/// `yarp topic`, `yarp topic --list`, `yarp topic --remove`.
#[tokio::test]
async fn yarp_topic_makes_lists_and_removes_topics() {
    let server = server().await;
    let ask =
        async |command: &str| say(&server, &format!("CONNACK admin\r\nd\r\n{command}\r\n")).await;
    assert_eq!(ask("topic \"/t\"").await, "Welcome admin\r\n[ok]\r\n<ACK>\r\n");
    assert_eq!(ask("topic").await, "Welcome admin\r\n\"/t\"\r\n<ACK>\r\n");
    let listed = ask("subscribe \"/a\" \"topic://t\"").await;
    assert_eq!(listed, "Welcome admin\r\n[ok]\r\n<ACK>\r\n");
    assert_eq!(
        ask("subscribe").await,
        "Welcome admin\r\nsubscriptions (subscription (src \"/a\") (dest \"topic://t\") \
         (topic 0 1))\r\n<ACK>\r\n"
    );
    assert_eq!(ask("untopic \"/t\"").await, "Welcome admin\r\n[ok]\r\n<ACK>\r\n");
    assert_eq!(ask("topic").await, "Welcome admin\r\n\r\n<ACK>\r\n");
    assert_eq!(ask("type yarp \"/x\" \"int\"").await, "Welcome admin\r\n[ok]\r\n<ACK>\r\n");
    let told = ask("type yarp \"/x\"").await;
    assert_eq!(told, "Welcome admin\r\ntype yarp \"/x\" int\r\n<ACK>\r\n");
    assert_eq!(ask("type yarp \"/y\"").await, "Welcome admin\r\n[fail]\r\n<ACK>\r\n");
    server.stop().await;
}

/// Several networks on one machine: `yarp connect` chooses with `/net=`.
#[tokio::test]
async fn a_network_chooses_among_the_addresses_of_a_port() {
    let server = server().await;
    say(&server, "NAME_SERVER register /cam tcp 10.0.0.1 10500\r\n").await;
    say(&server, "NAME_SERVER set /cam ips 10.0.0.1 192.168.1.7 ::1\r\n").await;
    for (asked, host) in [("192.168", "192.168.1.7"), ("10.", "10.0.0.1"), ("172.", "10.0.0.1")] {
        let answer = say(&server, &format!("NAME_SERVER query /net={asked}/cam\n")).await;
        let expected = format!(
            "registration name /cam ip {host} port 10500 type tcp\r\n*** end of message\r\n"
        );
        assert_eq!(answer, expected);
    }
    server.stop().await;
}

/// A port that owns others takes them along, each with a line.
#[tokio::test]
async fn what_a_port_owns_goes_with_it() {
    let server = server().await;
    for name in ["/a", "/a/one", "/a/two"] {
        say(&server, &format!("NAME_SERVER register {name}\r\n")).await;
    }
    say(&server, "NAME_SERVER bot set /a owns /a/one /a/two\r\n").await;
    assert_eq!(
        say(&server, "NAME_SERVER unregister /a\n").await,
        "old\r\nold\r\n*** end of message\r\n"
    );
    assert_eq!(say(&server, "NAME_SERVER list /a\n").await, "*** end of message\r\n");
    // Registering again keeps what was asked for.
    say(&server, "NAME_SERVER register /b\r\n").await;
    say(&server, "NAME_SERVER register /b/one\r\n").await;
    say(&server, "NAME_SERVER bot set /b owns /b/one\r\n").await;
    assert_eq!(
        say(&server, "NAME_SERVER register /b tcp 10.0.0.9 10600\r\n").await,
        "registration name /b ip 10.0.0.9 port 10600 type tcp\r\n*** end of message\r\n"
    );
    server.stop().await;
}
