//! Target of what is said to and by a YARP name server.

use wrapyfi_yarp::Limits;
use wrapyfi_yarp::server::NameServerLimits;
use wrapyfi_yarp::server::offline::{Offline, read_answer};

use crate::{LIMITS, bounded};

/// Memory for each byte of commands: a word becomes a value, a name an entry with its maps, and
/// `list` tells every name there is.
const COMMANDS: usize = 4096;
/// Memory for each byte of an answer: an empty line is kept, too.
const ANSWER: usize = 256;

/// Commands, one a line, to a name server that keeps little; after a line `----`, the answer of a
/// name server to us.
pub fn yarp_name_lines(data: &[u8]) {
    const SEPARATOR: &[u8] = b"\n----\n";
    let cut = data.windows(SEPARATOR.len()).position(|part| part == SEPARATOR);
    let (commands, answer) = data.split_at(cut.unwrap_or(data.len()));
    let answer = answer.strip_prefix(SEPARATOR).unwrap_or_default();
    let limits = Limits {
        max_message_bytes: LIMITS.message_bytes,
        max_depth: LIMITS.depth,
        ..Limits::default()
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

fn serve(commands: &[u8], limits: &Limits) {
    let kept = NameServerLimits {
        max_names: 16,
        max_name_bytes: 64,
        max_properties: 4,
        max_values: 8,
        max_value_bytes: 128,
        max_subscriptions: 8,
        ..NameServerLimits::default()
    };
    let most = kept.max_names;
    let mut server = Offline::new(kept, limits.clone());
    // More lines than this cost time, and show nothing new.
    for line in commands.split(|&byte| byte == b'\n').take(256) {
        let answer = server.ask(line);
        let inner = answer.strip_suffix(b"\r\n").expect("an answer is lines");
        if !answer.ends_with(b"*** end of message\r\n") {
            assert!(!inner.contains(&b'\n'), "a bottle is one line");
        }
        // Whoever reads lines must not find ends that a name brought along.
        assert!(!inner.contains(&0), "a line has no NUL");
        assert!(server.names() <= most, "{} names", server.names());
    }
}
