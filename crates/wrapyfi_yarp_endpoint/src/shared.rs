//! State that all endpoints of one YARP instance share.

use super::name;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;

use wrapyfi_yarp::name::{Environment, Registrar};
use wrapyfi_yarp::port::{Network, PortOptions};

use super::directory::Directory;
use super::options::YarpOptions;
use super::own::OwnPorts;
use super::registered_port::Entry;
use super::shared_output::SharedOutputs;
use super::survey::Survey;
use super::tasks::Tasks;
use super::types::Types;
use wrapyfi_endpoint::Cause;
use wrapyfi_endpoint::network::ReachedByOthers;

/// State that all endpoints of one YARP instance share.
pub(super) struct InstanceState {
    pub(super) network: Network,
    pub(super) registrar: Registrar,
    pub(super) directory: Arc<Directory>,
    pub(super) own: OwnPorts,
    pub(super) outputs: SharedOutputs,
    pub(super) survey: Survey,
    pub(super) types: Types,
    pub(super) tasks: Tasks,
    pub(super) send_queue: usize,
    pub(super) environment: Environment,
    /// Strings of all senders are JSON, as in Wrapyfi's own programs.
    pub(super) is_wrapyfi: bool,
    /// The name server is on another machine.
    pub(super) is_afar: bool,
    /// Refusal of ports that others connect to; `None` where they may be opened.
    pub(super) refused: Option<ReachedByOthers>,
}

impl InstanceState {
    /// Refuses to open ports that others connect to where other machines would reach them without
    /// permission.
    pub(super) fn may_listen(&self) -> Result<(), ReachedByOthers> {
        self.refused.clone().map_or(Ok(()), Err)
    }

    /// A port that only asks. It listens on this machine alone if ports may not be open to others, and
    /// no program is told: its server answers on the connection that it is asked on.
    pub(super) fn asking(&self) -> PortOptions {
        match self.refused {
            None => PortOptions::default(),
            Some(_) => PortOptions {
                address: Some(SocketAddr::from((Ipv4Addr::LOCALHOST, 0))),
                register: false,
                ..PortOptions::default()
            },
        }
    }

    /// Numbers of changes of names, answers of ports, types, and own ports: while they stay the
    /// same, discovery finds the same.
    pub(super) fn changes(&self) -> [u64; 4] {
        let Self { directory, survey, types, own, .. } = self;
        [directory.changes(), survey.changes(), types.heard.learned(), own.changes()]
    }

    /// The name under which a port of ours is registered, as the environment wants it.
    pub(super) fn own_name(&self, name: &str) -> String {
        let naming = self.environment.port_naming(name);
        naming.map_or_else(|_| name.to_owned(), |naming| naming.name)
    }

    /// The port of this name and its address, for which the name server is asked where it is not known.
    pub(super) async fn located(&self, name: &str) -> Option<Entry> {
        let entry = self.directory.entry(name)?;
        if entry.at.is_some() {
            return Some(entry);
        }
        let found = self.network.query(name).await.ok().flatten()?;
        Some(self.directory.locate(name, entry.number, found))
    }

    /// Hint for the error about a port that does not answer: the likely reason and the remedy, else
    /// an empty text. A name server on this machine is not asked: loopback is the usual address
    /// there.
    pub(super) async fn hint(&self, name: &str) -> &'static str {
        if !self.is_afar {
            return "";
        }
        _ = self.located(name).await;
        if self.is_on_loopback(name) {
            "; it is registered at an address of its own machine alone: set YARP_IP there"
        } else {
            ""
        }
    }

    /// True for a port that is known to be registered at an address of its own machine alone.
    pub(super) fn is_on_loopback(&self, name: &str) -> bool {
        let contact = self.directory.entry(name).and_then(|entry| entry.contact());
        let at = contact.and_then(|contact| contact.parse::<SocketAddr>().ok());
        at.is_some_and(|at| at.ip().is_loopback())
    }

    /// The network in which an endpoint with these options opens its port.
    pub(super) fn network(&self, options: &YarpOptions) -> Network {
        options
            .dialect
            .map_or_else(|| self.network.clone(), |dialect| self.network.with_dialect(dialect))
    }

    /// Reason why a port of ours is not found under its name; `None` where it is.
    pub(super) fn taken(&self, name: &str) -> Option<Cause> {
        let status = self.registrar.status();
        let taken = status.borrow().taken.iter().any(|taken| taken == name);
        taken.then(|| Cause::NameTaken { port: name::address(name), was_ours: true })
    }
}
