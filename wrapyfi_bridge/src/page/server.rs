//! HTTP on a port of this machine: who is answered, and how much of it at once.

use std::convert::Infallible;
use std::net::TcpListener;
use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use http_body_util::Full;
use hyper::body::Incoming;
use hyper::header::{CONNECTION, HOST, HeaderMap, HeaderName, HeaderValue};
use hyper::service::service_fn;
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::{TokioIo, TokioTimer};
use tokio::net::TcpStream;
use tokio::sync::oneshot;
use tokio::time::{interval, sleep, timeout};
use wrapyfi_retry::NewestTasks;

use super::answers::{Answers, PageResponse};

/// Most connections at once. One more closes the oldest: half a request keeps no other out.
const MAX_CONNECTIONS: usize = 32;
/// Longest time that a request may take to come, and a connection stay idle.
const REQUEST: Duration = Duration::from_secs(5);
/// Longest life of a connection, for readers that stand still. A browser opens another.
const CONNECTION_FOR: Duration = Duration::from_secs(60);
/// Most that is buffered of a request.
const HEAD_BYTES: usize = 16 * 1024;
/// Most headers of a request.
const MAX_HEADERS: usize = 64;
/// Time between two looks whether a page still shows it.
const SWEEP_EVERY: Duration = Duration::from_secs(1);
/// Pause after a connection that could not be accepted.
const REFUSED_FOR: Duration = Duration::from_millis(200);

/// Answers until `stopped`.
pub(super) async fn serve(
    listener: TcpListener,
    answers: Arc<Answers>,
    mut stopped: oneshot::Receiver<()>,
) {
    let listener = match tokio::net::TcpListener::from_std(listener) {
        Ok(listener) => listener,
        Err(error) => return tracing::error!("the live page has ended: {error}"),
    };
    let mut open = NewestTasks::default();
    let mut sweep = interval(SWEEP_EVERY);
    loop {
        let accepted = tokio::select! {
            _ = &mut stopped => return,
            _ = sweep.tick() => {
                answers.sweep();
                continue;
            }
            accepted = listener.accept() => accepted,
        };
        let Ok((stream, _)) = accepted else {
            sleep(REFUSED_FOR).await;
            continue;
        };
        let answers = Arc::clone(&answers);
        open.enter(tokio::spawn(serve_one(stream, answers)).abort_handle(), MAX_CONNECTIONS);
    }
}

async fn serve_one(stream: TcpStream, answers: Arc<Answers>) {
    if stream.set_nodelay(true).is_err() {
        return;
    }
    let service = service_fn(|request| respond(request, &answers));
    let served = hyper::server::conn::http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(REQUEST)
        .max_buf_size(HEAD_BYTES)
        .max_headers(MAX_HEADERS)
        .serve_connection(TokioIo::new(stream), service);
    if let Ok(Err(error)) = timeout(CONNECTION_FOR, served).await {
        tracing::debug!("a connection to the live page ended: {error}");
    }
}

async fn respond(
    request: Request<Incoming>,
    answers: &Answers,
) -> Result<Response<Full<Bytes>>, Infallible> {
    let answer = match refusal(&request) {
        Some((status, text)) => PageResponse { status, ..PageResponse::text(text) },
        None => {
            answers.answer(request.uri().path(), request.uri().query().unwrap_or_default()).await
        }
    };
    let PageResponse { status, content_type, body } = answer;
    let mut response = Response::new(Full::new(body));
    *response.status_mut() = status;
    let headers = response.headers_mut();
    let mut say = |name: &'static str, value: &str| {
        if let Ok(value) = HeaderValue::from_str(value) {
            headers.insert(HeaderName::from_static(name), value);
        }
    };
    say("content-type", content_type);
    say("content-security-policy", &answers.document.policy);
    say("cache-control", "no-store");
    say("cross-origin-opener-policy", "same-origin");
    say("cross-origin-resource-policy", "same-origin");
    say("referrer-policy", "no-referrer");
    say("x-content-type-options", "nosniff");
    if status == StatusCode::METHOD_NOT_ALLOWED {
        say("allow", "GET");
        // Whatever comes behind it is not read.
        headers.insert(CONNECTION, HeaderValue::from_static("close"));
    }
    Ok(response)
}

/// Cause for which a request is not answered.
fn refusal<B>(request: &Request<B>) -> Option<(StatusCode, &'static str)> {
    if request.method() != Method::GET {
        return Some((StatusCode::METHOD_NOT_ALLOWED, "only GET is answered here\n"));
    }
    let is_foreign = request.uri().authority().is_some_and(|it| !is_own_host(it.as_str()));
    if is_foreign || !names_this_machine(request.headers()) {
        let text = "this page is for the machine it runs on: ask 127.0.0.1 or localhost; from another machine, \
                    `ssh -L 8642:127.0.0.1:8642 HOST`\n";
        return Some((StatusCode::MISDIRECTED_REQUEST, text));
    }
    // Pages of others may link here, and load nothing from here.
    let site = request.headers().get("sec-fetch-site").map(HeaderValue::as_bytes);
    let is_others = matches!(site, Some(b"cross-site" | b"same-site"));
    (is_others && request.uri().path() != "/")
        .then_some((StatusCode::FORBIDDEN, "a page from elsewhere asks for this\n"))
}

/// True where the only `Host` is this machine. A name that was made to point here says another one.
fn names_this_machine(headers: &HeaderMap) -> bool {
    let mut hosts = headers.get_all(HOST).iter();
    match (hosts.next(), hosts.next()) {
        (Some(host), None) => host.to_str().is_ok_and(is_own_host),
        _ => false,
    }
}

/// Any port: a tunnel has another one.
fn is_own_host(host: &str) -> bool {
    let (name, port) = match host.rsplit_once(':') {
        Some((name, port)) if !host.ends_with(']') => (name, port),
        _ => (host, ""),
    };
    let is_port = port.len() <= 5 && port.bytes().all(|byte| byte.is_ascii_digit());
    is_port && ["127.0.0.1", "localhost", "[::1]"].iter().any(|own| name.eq_ignore_ascii_case(own))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_names_of_this_machine_are_hosts_of_the_page() {
        for own in
            ["127.0.0.1", "127.0.0.1:8642", "localhost:9", "LocalHost", "[::1]", "[::1]:8642"]
        {
            assert!(is_own_host(own), "{own}");
        }
        for other in [
            "",
            "evil.example",
            "evil.example:8642",
            "127.0.0.1.evil.example",
            "localhost.",
            "127.0.0.1:8642:1",
            "127.0.0.1:86421x",
            "evil@127.0.0.1",
            "[::1",
            "0.0.0.0:8642",
            "10.0.0.1",
        ] {
            assert!(!is_own_host(other), "{other}");
        }
    }

    #[test]
    fn other_methods_hosts_and_sites_are_refused() {
        let status = |method: &str, hosts: &[&str], site: Option<&str>, path: &str| {
            let mut request = Request::builder().method(method).uri(path);
            for host in hosts {
                request = request.header(HOST, *host);
            }
            if let Some(site) = site {
                request = request.header("sec-fetch-site", site);
            }
            refusal(&request.body(()).unwrap()).map(|(status, _)| status.as_u16())
        };
        let own = &["127.0.0.1:1"][..];
        assert_eq!(status("GET", own, None, "/routes.json"), None);
        assert_eq!(status("GET", own, Some("same-origin"), "/routes.json"), None);
        assert_eq!(status("GET", own, Some("cross-site"), "/"), None, "a link");
        assert_eq!(status("GET", own, Some("cross-site"), "/previews.json"), Some(403));
        assert_eq!(status("POST", own, None, "/"), Some(405));
        assert_eq!(status("GET", &[], None, "/"), Some(421));
        assert_eq!(status("GET", &["evil.example"], None, "/"), Some(421));
        assert_eq!(status("GET", &["127.0.0.1", "evil.example"], None, "/"), Some(421));
        assert_eq!(status("GET", own, None, "http://evil.example/"), Some(421));
    }
}
