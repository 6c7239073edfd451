//! The name server in a browser.
//!
//! ```text
//!   GET /            connections          GET /data=list    ports
//!   GET /data=help   commands             POST /form        a command typed in
//! ```
//!
//! Only commands that change nothing are done for a browser: any page it shows could send the
//! others, too. YARP's server does them all.

use std::net::IpAddr;

use bytes::Bytes;

use super::reply::Reply;
use super::shared::ServerState;
use crate::name::registration;
use crate::port::administration::describe;
use crate::wire::http::{HttpRequest, escape};
use crate::{Bottle, WireLimits};

/// Commands that change nothing.
const READS: [&str; 7] = ["list", "query", "help", "get", "check", "route", "runners"];

/// Width of a name in the list of ports.
const NAME_COLUMN: usize = 30;

/// The whole answer to a request.
pub(super) fn answer(request: &HttpRequest, shared: &ServerState, peer: IpAddr) -> Bytes {
    if request.path.starts_with("/web/") {
        return page("text/css", STYLE);
    }
    let form = String::from_utf8_lossy(&request.body).into_owned();
    let asked = field(request.path.trim_start_matches(['/', '?'])).or_else(|| field(&form));
    let shown = match &asked {
        Some(command) => run(command, shared, peer),
        None => connections(shared),
    };
    page("text/html", &html(shared, &asked.unwrap_or_default(), &shown))
}

fn page(kind: &str, body: &str) -> Bytes {
    // The end of the page is the end of the connection, as YARP's.
    format!("HTTP/1.1 200 OK\r\nContent-Type: {kind}\r\n\r\n{body}").into()
}

fn html(shared: &ServerState, command: &str, shown: &str) -> String {
    let own = &shared.own;
    let (name, command) = (escape(&own.name), escape(command));
    let base = format!("http://{}:{}", escape(&own.host), own.port);
    let mut page = format!(
        "<html><head><link href=\"{base}/web/main.css\" rel=\"stylesheet\" type=\"text/css\"/></head>\
         <body bgcolor='#ffffcc'><h1>yarp port {name}</h1>\n<p>"
    );
    for (path, text) in
        [("data=list", "All ports"), ("", "connections"), ("data=help", "help"), ("r", "read")]
    {
        page += &format!("(<a href=\"{base}/{path}\">{text}</a>)&nbsp;&nbsp;\n");
    }
    page += &format!(
        "</p>\n<p>\n<form method=\"post\" action=\"{base}/form\"><input type=text name=data \
         value=\"{command}\"><input type=submit value=\"send data\"></form></p>\n<pre>\n\r\n{shown}\n\n"
    );
    page
}

fn connections(shared: &ServerState) -> String {
    describe(&shared.core).lines().fold(String::new(), |page, line| page + &escape(line) + "\n")
}

fn run(command: &str, shared: &ServerState, peer: IpAddr) -> String {
    let limits = WireLimits { max_message_bytes: 64 * 1024, ..WireLimits::default() };
    let Ok(bottle) = Bottle::from_text(command.as_bytes(), &limits) else {
        return "this command cannot be read\n".to_owned();
    };
    let mut words = bottle.values.iter().skip_while(|word| word.is_word("bot"));
    if !words.next().is_some_and(|verb| READS.iter().any(|known| verb.is_word(known))) {
        return format!("only these commands are done here: {}\n", READS.join(", "));
    }
    let lines = match shared.apply(&bottle, Some(peer)).reply {
        Reply::Lines(lines) => lines,
        Reply::Bottle(bottle) => vec![bottle.to_text_bytes()],
    };
    lines.iter().fold(String::new(), |page, line| page + &row(line))
}

/// A line of an answer; where it names a port, a link to that port's own page.
fn row(line: &[u8]) -> String {
    match registration(line) {
        Some(port) if port.carrier == "tcp" => {
            let (name, host) = (escape(&port.name), escape(&port.host));
            let gap = " ".repeat(NAME_COLUMN.saturating_sub(port.name.len()));
            format!("<a href=\"http://{host}:{}\">{name}</A> {gap}(tcp:/{name})\n", port.port)
        }
        Some(_) => String::new(), // no browser can open a multicast group
        None => escape(&String::from_utf8_lossy(line)) + "\n",
    }
}

/// The value of `data=` in a path or a form.
fn field(text: &str) -> Option<String> {
    let value = text.split('&').find_map(|pair| pair.strip_prefix("data="))?;
    let mut bytes = value.bytes();
    let mut decoded = Vec::with_capacity(value.len());
    while let Some(byte) = bytes.next() {
        decoded.push(match byte {
            b'+' => b' ',
            b'%' => {
                let digit = |byte: Option<u8>| char::from(byte?).to_digit(16);
                let (high, low) = (digit(bytes.next())?, digit(bytes.next())?);
                u8::try_from(high * 16 + low).ok()?
            }
            other => other,
        });
    }
    Some(String::from_utf8_lossy(&decoded).into_owned())
}

const STYLE: &str = "body { background: white; color: black; }\n\
    h1 { font-family: sans-serif; color: #339966; }\n\
    a { color: #114499; text-decoration: none; }\n";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_decoded_and_text_is_escaped() {
        assert_eq!(field("data=list+%2Fcam").as_deref(), Some("list /cam"));
        assert_eq!(field("x=1&data=help").as_deref(), Some("help"));
        assert_eq!(field("data=%zz"), None);
        assert_eq!(field("web/main.css"), None);
        assert_eq!(escape("<a b=\"c\">'&"), "&lt;a b=&quot;c&quot;&gt;&#39;&amp;");
        let line = b"registration name /<b> ip 1.2.3.4 port 5 type tcp";
        assert!(row(line).contains("&lt;b&gt;</A>"), "{}", row(line));
        assert_eq!(row(b"registration name /m ip 224.1.1.3 port 5 type mcast"), "");
    }
}
