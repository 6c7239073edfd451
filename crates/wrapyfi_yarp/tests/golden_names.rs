//! Every recorded conversation with YARP's name server, held with ours: what clients sent then is
//! sent again, and the answers are compared byte for byte.
//!
//! Ours listens on any free port and says that it is port 10000, so that the numbers it gives away
//! are those of the recordings. The table below says why an answer differs.

use std::time::Duration;

use serde_json::Value as Json;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use wrapyfi_yarp::server::{NameServer, NameServerOptions};

/// A recording.
struct Recording {
    file: &'static str,
    /// Names that were registered before it began, so far as its answers tell.
    before: &'static [&'static str],
}

const fn plain(file: &'static str) -> Recording {
    Recording { file, before: &[] }
}

const OPENED: &str = "register /golden/opened";
/// `fill N` registers that many ports.
const RECORDINGS: &[Recording] = &[
    plain("ns_text_line_commands"),
    plain("ns_text_line_edge_cases"),
    Recording { file: "ns_text_line_pipelined", before: &[OPENED, "register ..."] },
    Recording {
        file: "ns_name_ser_two_commands",
        before: &[
            "register /golden/typed tcp 127.0.0.1 10126 yarp/image",
            "register /golden/part tcp ... ...",
            "register /golden/part2 ... ... 10200",
            "register =tail",
            "register /golden/x y z",
            "register",
        ],
    },
    Recording { file: "ns_binary_tcp_rpc", before: &[OPENED, "register ..."] },
    Recording { file: "ns_text_connect", before: &[OPENED, "register ..."] },
    Recording { file: "ns_text_ack_connect", before: &[OPENED, "register ..."] },
    plain("ns_port_open_sequence"),
    Recording { file: "ns_port_open_anonymous_dots", before: &[OPENED] },
    Recording { file: "ns_yarp_check", before: &[OPENED, "register ..."] },
    plain("ns_detect_where"),
    plain("ns_multicast_discovery"),
    plain("ns_http"),
    plain("scenario_mcast"),
    Recording { file: "scenario_connect_failures", before: &["fill 1"] },
    plain("scenario_yarp_disconnect"),
    plain("scenario_udp"),
    plain("scenario_reader_closes_first"),
    plain("scenario_yarp_connect_tcp"),
    plain("v4_scenario_yarp_connect_tcp"),
    Recording { file: "scenario_local", before: &["fill 2"] },
    Recording { file: "scenario_rpc", before: &["fill 2"] },
    plain("scenario_wrapyfi_native"),
    // Those below were taken from one server, whose names get their numbers again.
    Recording {
        file: "scenario_wrapyfi_native_nopersist",
        before: &["register /wf/native", "fill 2", "unregister /wf/native"],
    },
    Recording {
        file: "scenario_wrapyfi_native_rpc",
        before: &["register /wf/native", "fill 11", "unregister /wf/native"],
    },
    Recording { file: "scenario_wrapyfi_image_rgb", before: &["fill 4"] },
    Recording { file: "scenario_wrapyfi_audio", before: &["fill 10"] },
    Recording {
        file: "scenario_persistent_connection",
        before: &[
            "fill 1",
            "register /golden/src",
            "fill 2",
            "register /golden/dst",
            "unregister /golden/src",
            "unregister /golden/dst",
        ],
    },
    Recording {
        file: "scenario_exists_ping",
        before: &["fill 4", "register /golden/dst", "fill 1", "unregister /golden/dst"],
    },
];

/// Answers of ours that differ: the recording, the request, the answer, and the reason.
const DIFFERENCES: &[(&str, &str, &str, &str)] = &[
    (
        "ns_text_line_edge_cases",
        "NAME_SERVER\n",
        "*** end of message\r\n",
        "YARP takes the line's end for the blank after the word and waits for ever",
    ),
    (
        "ns_name_ser_two_commands",
        "query /root\r\n",
        "registration name /root ip 127.0.0.1 port 10000 type tcp\r\n*** end of message\r\n",
        "YARP takes twelve bytes off later lines unseen, whether they say NAME_SERVER or not",
    ),
];

fn golden(file: &str) -> Json {
    let path = format!("{}/tests/golden/{file}.json", env!("CARGO_MANIFEST_DIR"));
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn bytes(hex: &str) -> Vec<u8> {
    let pairs = hex.as_bytes().chunks(2).map(|pair| std::str::from_utf8(pair).unwrap());
    pairs.map(|pair| u8::from_str_radix(pair, 16).unwrap()).collect()
}

/// One connection: what the client sent, each time with what the server answered.
struct Talk {
    began: f64,
    turns: Vec<(Vec<Vec<u8>>, Vec<u8>)>,
    /// The client vanished without closing.
    hung_up: bool,
}

/// The connections to port 10000, in the order in which the clients spoke.
fn talks(recording: &Json) -> Vec<Talk> {
    let all = recording["connections"].as_array().cloned();
    let all = all.unwrap_or_else(|| vec![recording.clone()]);
    let server = |talk: &Json| {
        talk["server"].as_str().or(talk["peers"]["server"].as_str()).unwrap_or_default().to_owned()
    };
    let mut talks: Vec<Talk> =
        all.iter().filter(|talk| server(talk).ends_with(":10000")).map(talk).collect();
    talks.sort_by(|a, b| a.began.total_cmp(&b.began));
    talks
}

fn talk(recorded: &Json) -> Talk {
    let mut turns: Vec<(Vec<Vec<u8>>, Vec<u8>)> = vec![];
    let mut began = recorded["t_open"].as_f64().unwrap_or(0.0);
    let mut hung_up = false;
    for step in recorded["stream"].as_array().unwrap() {
        let from_client = step["dir"] == "c2s";
        let Some(hex) = step["hex"].as_str() else {
            hung_up |= from_client && step["event"] == "rst";
            continue;
        };
        if from_client {
            if turns.is_empty() {
                began = step["t"].as_f64().unwrap();
            }
            match turns.last_mut() {
                Some((sent, answer)) if answer.is_empty() => sent.push(bytes(hex)),
                _ => turns.push((vec![bytes(hex)], vec![])),
            }
        } else {
            turns.last_mut().unwrap().1.extend(bytes(hex));
        }
    }
    Talk { began, turns, hung_up }
}

async fn server() -> NameServer {
    NameServer::start(NameServerOptions {
        port: 0,
        advertised_port: Some(10_000),
        skip_busy_ports: false,
        make_connections: false, // the ports of the recordings are not there
        ..NameServerOptions::default()
    })
    .await
    .unwrap()
}

const TIMEOUT: Duration = Duration::from_secs(20);

async fn hold(talk: &Talk, file: &str, server: &NameServer, differed: &mut Vec<usize>) {
    let mut stream = TcpStream::connect(server.address()).await.unwrap();
    stream.set_nodelay(true).unwrap();
    for (sent, answer) in &talk.turns {
        let text = String::from_utf8_lossy(&sent.concat()).into_owned();
        for piece in sent {
            stream.write_all(piece).await.unwrap();
        }
        let difference = DIFFERENCES.iter().position(|other| other.0 == file && other.1 == text);
        let expected = match difference {
            Some(at) => {
                differed.push(at);
                DIFFERENCES[at].2.as_bytes()
            }
            None => answer,
        };
        let mut got = vec![0; expected.len()];
        let read = tokio::time::timeout(TIMEOUT, stream.read_exact(&mut got)).await;
        assert!(matches!(read, Ok(Ok(_))), "{file}: {text:?} was answered {read:?}");
        assert_eq!(
            String::from_utf8_lossy(&got),
            String::from_utf8_lossy(expected),
            "{file}: answer to {text:?}"
        );
        assert_eq!(got, expected, "{file}: answer to {text:?}");
    }
    if talk.hung_up {
        return;
    }
    // Nothing more comes, and our end is answered by theirs.
    stream.shutdown().await.unwrap_or_default();
    let mut rest = vec![];
    let end = tokio::time::timeout(TIMEOUT, stream.read_to_end(&mut rest)).await;
    assert!(end.is_ok(), "{file}: the connection stays open");
    assert_eq!(String::from_utf8_lossy(&rest), "", "{file}: more than was recorded");
}

async fn prime(server: &NameServer, steps: &[&str]) {
    let mut lines = vec![];
    for step in steps {
        match step.strip_prefix("fill ") {
            Some(count) => {
                let start = lines.len();
                let count: usize = count.parse().unwrap();
                lines.extend((start..start + count).map(|at| format!("register /before/{at}")));
            }
            None => lines.push((*step).to_owned()),
        }
    }
    for line in lines {
        let mut stream = TcpStream::connect(server.address()).await.unwrap();
        stream.write_all(format!("NAME_SERVER {line}\n").as_bytes()).await.unwrap();
        stream.shutdown().await.unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).await.unwrap();
        assert!(answer.ends_with("*** end of message\r\n"), "{line}: {answer}");
    }
}

#[tokio::test]
async fn recorded_clients_get_the_recorded_answers() {
    let mut differed = vec![];
    for Recording { file, before } in RECORDINGS {
        let server = server().await;
        prime(&server, before).await;
        let talks = talks(&golden(file));
        assert!(!talks.is_empty(), "{file} has no connection to the name server");
        for talk in &talks {
            hold(talk, file, &server, &mut differed).await;
        }
        server.stop().await;
    }
    differed.sort_unstable();
    differed.dedup();
    assert_eq!(differed.len(), DIFFERENCES.len(), "a difference that no longer is");
}

#[test]
fn every_recording_of_the_name_server_is_in_the_table() {
    let folder = format!("{}/tests/golden", env!("CARGO_MANIFEST_DIR"));
    for entry in std::fs::read_dir(folder).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        let Some(file) = name.strip_suffix(".json") else { continue };
        let ours = file.starts_with("ns_") || file.contains("scenario_");
        // The server is the client there: see golden_name_events.rs.
        if !ours || file == "ns_event_stream" || talks(&golden(file)).is_empty() {
            continue;
        }
        assert!(
            RECORDINGS.iter().any(|recording| recording.file == file),
            "{file} is not replayed"
        );
    }
}
