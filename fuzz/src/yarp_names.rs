//! Targets of what is said to and by a YARP name server, and of the file that says where it is.

use wrapyfi_yarp::WireLimits;
use wrapyfi_yarp::name::NameServerConf;
use wrapyfi_yarp::server::NameServerLimits;
use wrapyfi_yarp::server::offline::{Offline, read_answer, read_found};
use wrapyfi_yarp::wire::datagram;

use crate::{LIMITS, bounded};

/// Memory for each byte of commands: a word becomes a value, a name an entry with its maps, and
/// `list` tells every name there is.
const COMMANDS: usize = 4096;
/// Memory for each byte of an answer: an empty line is kept, too.
const ANSWER: usize = 256;
/// Line between the parts of an input.
const SEPARATOR: &[u8] = b"\n----\n";

/// Commands, one a line, to a name server that keeps little; after a line `----`, the answer of a
/// name server to us.
pub fn yarp_name_lines(data: &[u8]) {
    let cut = data.windows(SEPARATOR.len()).position(|part| part == SEPARATOR);
    let (commands, answer) = data.split_at(cut.unwrap_or(data.len()));
    let answer = answer.strip_prefix(SEPARATOR).unwrap_or_default();
    let limits = WireLimits {
        max_message_bytes: LIMITS.message_bytes,
        max_depth: LIMITS.depth,
        ..WireLimits::default()
    };
    bounded(commands.len(), COMMANDS, || serve(commands, &limits));
    let ports = bounded(answer.len(), ANSWER, || read_answer(answer, &limits));
    for port in ports.unwrap_or_default() {
        assert_ne!(port.port, 0);
        let line = format!(
            "registration name {} ip {} port {} type {}\n*** end\n",
            port.name, port.host, port.port, port.carrier
        );
        assert_eq!(read_answer(line.as_bytes(), &limits), Some(vec![port]), "{line}");
    }
}

/// A name server's configuration file, or the address of one as options have it.
pub fn yarp_conf(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    match bounded(data.len(), 16, || NameServerConf::parse(text)) {
        Ok(conf) => {
            assert!(conf.port != 0 && !conf.host.is_empty(), "{conf:?}");
            let written = conf.to_string();
            assert_eq!(NameServerConf::parse(&written), Ok(conf), "{written:?}");
        }
        Err(reason) => assert!(!reason.is_empty()),
    }
    if let Ok(conf) = text.parse::<NameServerConf>() {
        assert_eq!(NameServerConf::parse(&conf.to_string()), Ok(conf));
    }
}

/// Commands to a name server, one a line; after a line `----`, a datagram to its group. The first byte of that says
/// whether the rest is one already, or is put into one.
pub fn yarp_multicast(data: &[u8]) {
    let cut = data.windows(SEPARATOR.len()).position(|part| part == SEPARATOR);
    let (commands, datagram) = data.split_at(cut.unwrap_or(data.len()));
    let datagram = datagram.strip_prefix(SEPARATOR).unwrap_or_default();
    let [choice, datagram @ ..] = datagram else { return };
    let sealed = match choice {
        b'0' => datagram.to_vec(),
        b'1' => datagram::seal(1, datagram),
        _ => datagram::seal(0, datagram),
    };
    let mut server = Offline::new(kept(), WireLimits::default());
    for line in commands.split(|&byte| byte == b'\n').take(16) {
        server.ask(line);
    }
    let names = server.names();
    let answer = bounded(data.len(), 64, || server.hear(&sealed));
    assert_eq!(server.names(), names, "a datagram changes nothing");
    if let Some(answer) = answer {
        let (number, line) = datagram::open(&answer).expect("an answer is a datagram");
        assert_eq!(number, 0);
        assert_eq!(line.iter().position(|&byte| byte == b'\n'), Some(line.len() - 1), "one line");
        let found = read_found(&answer).expect("an answer says where the port is");
        assert!(
            String::from_utf8_lossy(datagram).contains(&found.name),
            "nobody asked for {found:?}"
        );
        assert_eq!(server.hear(&answer), None, "an answer is no question");
    }
    if let Some(found) = bounded(sealed.len(), 16, || read_found(&sealed)) {
        assert_ne!(found.port, 0);
    }
}

/// Little, so that a short input reaches each limit.
fn kept() -> NameServerLimits {
    NameServerLimits {
        max_names: 16,
        max_name_bytes: 64,
        max_properties: 4,
        max_values: 8,
        max_value_bytes: 128,
        max_subscriptions: 8,
        ..NameServerLimits::default()
    }
}

fn serve(commands: &[u8], limits: &WireLimits) {
    let kept = kept();
    let most = kept.max_names;
    let mut server = Offline::new(kept, limits.clone());
    // More lines than this cost time, and show nothing new.
    for line in commands.split(|&byte| byte == b'\n').take(256) {
        let answer = server.ask(line);
        let inner = answer.strip_suffix(b"\r\n").expect("an answer is lines");
        if !answer.ends_with(b"*** end of message\r\n") {
            assert!(!inner.contains(&b'\n'), "a bottle is one line");
        }
        // The program that reads lines must not find ends that a name brought along.
        assert!(!inner.contains(&0), "a line has no NUL");
        assert!(server.names() <= most, "{} names", server.names());
    }
}
