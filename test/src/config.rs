//! Bridge configurations as YAML text.

use std::fmt::Write as _;

use crate::TestEnv;

/// One route of a [`Config`].
#[derive(Debug, Clone)]
pub struct Route {
    pairs: Vec<(String, String)>,
}

impl Route {
    /// A route between two endpoints written as `middleware:/name`.
    pub fn new(from: &str, to: &str, message_type: &str) -> Self {
        Self::untyped(from, to).with("type", &quoted(message_type))
    }

    /// A route whose type its source has to tell.
    pub fn untyped(from: &str, to: &str) -> Self {
        Self { pairs: Vec::new() }.with("from", &quoted(from)).with("to", &quoted(to))
    }

    /// A route of a service with its server at one endpoint, offered at another.
    pub fn service(service: &str, offered: &str, kind: &str) -> Self {
        Self::untyped_service(service, offered).with("type", &quoted(kind))
    }

    /// A route of a service whose type its server has to tell.
    pub fn untyped_service(service: &str, offered: &str) -> Self {
        Self { pairs: Vec::new() }.with("service", &quoted(service)).with("as", &quoted(offered))
    }

    /// A route of an action with its server at one endpoint, offered at another; its type is learned.
    pub fn action(action: &str, offered: &str) -> Self {
        Self { pairs: Vec::new() }.with("action", &quoted(action)).with("as", &quoted(offered))
    }

    /// Adds a key; `value` is YAML.
    #[must_use]
    pub fn with(mut self, key: &str, value: &str) -> Self {
        self.pairs.push((key.to_owned(), value.to_owned()));
        self
    }
}

/// A configuration file in the making.
#[derive(Debug, Clone)]
pub struct Config {
    pub_port: u16,
    sub_port: u16,
    broker: &'static str,
    /// Ports of requests and replies, where services are routed.
    requests: Option<(u16, u16)>,
    /// Sections of other endpoints.
    endpoints: Vec<String>,
    more: Vec<String>,
    routes: Vec<Route>,
}

impl Config {
    /// ZeroMQ on these loopback ports, with our own broker.
    pub fn embedded(pub_port: u16, sub_port: u16) -> Self {
        Self {
            pub_port,
            sub_port,
            broker: "embedded",
            requests: None,
            endpoints: Vec::new(),
            more: Vec::new(),
            routes: Vec::new(),
        }
    }

    /// ZeroMQ on these loopback ports, where another program's broker runs.
    pub fn foreign(pub_port: u16, sub_port: u16) -> Self {
        Self { broker: "foreign", ..Self::embedded(pub_port, sub_port) }
    }

    /// Routes services on this test's ports of requests and replies too.
    #[must_use]
    pub fn requests(mut self, env: &TestEnv) -> Self {
        self.requests = Some((env.rep_port(), env.req_port()));
        self
    }

    /// YARP with a name server in the bridge, on this test's port.
    #[must_use]
    pub fn yarp(mut self, env: &TestEnv) -> Self {
        let address = format!("127.0.0.1:{}", env.yarp_port());
        self.endpoints.push(format!("  yarp: {{ name_server: \"{address}\", embedded: true }}\n"));
        self
    }

    /// Adds a section of another endpoint; `yaml` is whole lines, indented by two.
    #[must_use]
    pub fn endpoint(mut self, yaml: &str) -> Self {
        self.endpoints.push(yaml.to_owned());
        self
    }

    /// Adds a key of the file itself; `value` is YAML.
    #[must_use]
    pub fn with(mut self, key: &str, value: &str) -> Self {
        self.more.push(format!("{key}: {value}\n"));
        self
    }

    /// Adds a route.
    #[must_use]
    pub fn route(mut self, route: Route) -> Self {
        self.routes.push(route);
        self
    }

    /// The file's text.
    pub fn yaml(&self) -> String {
        let Self { pub_port, sub_port, broker, requests, endpoints, more, routes } = self;
        let endpoints = endpoints.concat();
        let requests = requests.map_or_else(String::new, |(rep_port, req_port)| {
            format!("    rep_port: {rep_port}\n    req_port: {req_port}\n")
        });
        let more = more.concat();
        let mut text = format!(
            "endpoints:\n  zeromq:\n    ip: 127.0.0.1\n    pub_port: {pub_port}\n    sub_port: {sub_port}\n    broker: {broker}\n{requests}{endpoints}{more}routes:\n"
        );
        for route in routes {
            for (index, (key, value)) in route.pairs.iter().enumerate() {
                let lead = if index == 0 { "  - " } else { "    " };
                // Writing to a String cannot fail.
                let _unfailing: std::fmt::Result = writeln!(text, "{lead}{key}: {value}");
            }
        }
        text
    }
}

fn quoted(text: &str) -> String {
    format!("\"{text}\"")
}
