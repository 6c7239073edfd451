//! The suite against YARP: the near side runs the name server, the far side only asks it.

use std::collections::BTreeMap;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::time::Duration;

use tokio::runtime::Runtime;
use wrapyfi_conformance::{Capabilities, TIMEOUT, Testbed, TypeCheck, WireEnd, conformance_tests};
use wrapyfi_endpoint::{Middleware, ServiceSpec, TopicSpec};
use wrapyfi_yarp::name::{NameClient, NameServerConf};
use wrapyfi_yarp::port::{Message, Network, NetworkOptions, Port, PortOptions, PortPayload};
use wrapyfi_yarp_endpoint::{Yarp, YarpConfig};

struct Named {
    // Ends while there still is a name server.
    raw: Raw,
    far: Option<Yarp>,
    near: Option<Yarp>,
    address: SocketAddr,
}

/// Ports that send what no program should.
struct Raw {
    runtime: Runtime,
    names: NameClient,
    network: Network,
    ports: BTreeMap<String, Port>,
    asking: Vec<Port>,
}

fn side(name_server: SocketAddr, embedded: bool) -> Yarp {
    let name_server = Some(name_server.into());
    Yarp::start(&YarpConfig { name_server, embedded, ..YarpConfig::default() }).unwrap()
}

impl Testbed for Named {
    const CAPABILITIES: Capabilities = Capabilities {
        several_publishers: false,
        keeps_last: false,
        ignores_own: false,
        float_sound: false,
        reply_stamps: false,
        frame_id: false,
        types: TypeCheck::Arrival,
        ..Capabilities::FULL
    };

    fn start() -> Self {
        let near = side((Ipv4Addr::LOCALHOST, 0).into(), true);
        let address = near.embedded().unwrap();
        let server = NameServerConf { host: address.ip().to_string(), port: address.port() };
        let names = NameClient::new(server);
        let (of_network, listen) = (Arc::new(names.clone()), address.ip());
        let network = NetworkOptions { names: of_network, listen, ..NetworkOptions::default() };
        let mut threads = tokio::runtime::Builder::new_multi_thread();
        let runtime = threads.worker_threads(1).enable_all().build().unwrap();
        let (ports, asking) = (BTreeMap::new(), Vec::new());
        let raw = Raw { runtime, names, network: Network::new(network), ports, asking };
        Self { raw, far: Some(side(address, false)), near: Some(near), address }
    }

    fn side(&self, side: WireEnd) -> &dyn Middleware {
        match side {
            WireEnd::Near => self.near.as_ref().unwrap(),
            WireEnd::Far => self.far.as_ref().unwrap(),
        }
    }

    fn restart(&mut self, at: WireEnd) {
        match at {
            WireEnd::Near => {
                self.near = None;
                self.near = Some(side(self.address, true));
            }
            WireEnd::Far => {
                self.far = None;
                self.far = Some(side(self.address, false));
            }
        }
    }

    fn inject(&mut self, spec: &TopicSpec, body: &[u8]) {
        let Raw { runtime, names, network, ports, .. } = &mut self.raw;
        let port = ports.entry(spec.topic.clone()).or_insert_with(|| {
            runtime.block_on(async {
                let name = format!("/raw{}", spec.topic);
                let port = network.open_output(&name, &PortOptions::default()).await.unwrap();
                let (reader, mut readers) = (format!("{}:in", spec.topic), 0);
                let all = names.list("").await.unwrap();
                for found in all.iter().filter(|found| found.name.starts_with(&reader)) {
                    port.connect(&found.name).await.unwrap();
                    readers += 1;
                }
                assert!(readers > 0, "nobody reads {}", spec.topic);
                port
            })
        });
        port.write(Message::new(PortPayload::object(body.to_vec())));
        runtime.block_on(port.flush());
    }

    fn inject_request(&mut self, spec: &ServiceSpec, body: &[u8]) {
        let Raw { runtime, network, asking, .. } = &mut self.raw;
        let number = asking.len();
        let client = runtime.block_on(async {
            let name = format!("/raw{number}");
            let options = PortOptions { register: false, ..PortOptions::default() };
            let client = network.open_rpc_client(&name, &options).await.unwrap();
            client.connect(&spec.service).await.unwrap();
            // On its way: the server answers when it is looked at, later.
            let body = body.to_vec().into();
            _ = client.call_bytes(&body, Duration::from_millis(200)).await;
            client
        });
        asking.push(client);
    }

    fn invalid_names() -> Vec<String> {
        ["", "/", "camera", "/a/", "/a b", "/a\nb", "/a\0", "/a(b)", "/a\"", "/tcp://a"]
            .map(str::to_owned)
            .into_iter()
            .chain([format!("/{}", "x".repeat(1000))])
            .collect()
    }
}

impl Drop for Raw {
    fn drop(&mut self) {
        let (ports, asking) = (std::mem::take(&mut self.ports), std::mem::take(&mut self.asking));
        self.runtime.block_on(async {
            let closed = async {
                for port in ports.into_values() {
                    port.close().await;
                }
                for client in asking {
                    client.close().await;
                }
            };
            tokio::time::timeout(TIMEOUT, closed).await.unwrap();
        });
    }
}

conformance_tests! {
    Named,
    lacks {
        float_sound: "sound on YARP has 16-bit samples",
        keeps_last: "a YARP port keeps no message for later readers",
        ignores_own: "a YARP name connects every port that fits, our own too",
    },
}
