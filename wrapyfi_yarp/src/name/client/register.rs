//! What a port asks for when it registers: as the program wants it, then as the environment does.

use std::net::{IpAddr, Ipv4Addr};

use super::{NameClient, NameError};
use crate::name::DISCOVERY_GROUP;
use crate::port::names::NameRequest;

impl NameClient {
    /// A request as the environment wants it.
    pub(super) fn adapted(&self, request: &NameRequest) -> Result<NameRequest, NameError> {
        let environment = &self.0.environment;
        let bad = |reason| NameError::BadName { name: request.name.clone(), reason };
        let naming =
            environment.port_naming(&request.name).map_err(|error| bad(error.to_string()))?;
        let mut host = request.host.clone();
        if host.is_none()
            && request.carrier.as_deref() != Some("mcast")
            && let Some(prefix) = environment.ip_prefix()
        {
            let found = own_address(prefix).ok_or_else(|| {
                bad(format!(
                    "cannot be advertised at YARP_IP={prefix:?}, which begins none of this \
                     machine's addresses that lead to the name server: write the whole address"
                ))
            });
            host = Some(found?.to_string());
        }
        Ok(NameRequest {
            name: naming.name,
            port: naming.port.or(request.port),
            host,
            ..request.clone()
        })
    }

    /// The line that asks for it.
    pub(super) fn register_command(&self, request: &NameRequest) -> Result<String, NameError> {
        let NameRequest { name, carrier, host, port, type_name } = request;
        // The name server completes these.
        self.checked(&match name.strip_prefix('=') {
            Some(tail) => format!("/{tail}"),
            None => name.clone(),
        })?;
        let mut command = format!("register {name}");
        let some = carrier.is_some() || host.is_some() || port.is_some() || type_name.is_some();
        if some {
            let word = |word: &Option<String>| word.clone().unwrap_or_else(|| "...".to_owned());
            // As YARP asks for any port, depending on whether a type follows.
            let any = if type_name.is_some() { "-1" } else { "..." };
            let port = port.map_or_else(|| any.to_owned(), |port| port.to_string());
            for word in [word(carrier), word(host), port].iter().chain(type_name) {
                if word.is_empty()
                    || word.contains(|letter: char| letter.is_whitespace() || letter == '"')
                {
                    let reason = format!("cannot be registered with {word:?}");
                    return Err(NameError::BadName { name: name.clone(), reason });
                }
                command.push(' ');
                command.push_str(word);
            }
        }
        Ok(command)
    }
}

/// An address of this machine that begins with `prefix`: the prefix itself where it is a whole one.
fn own_address(prefix: &str) -> Option<IpAddr> {
    if let Ok(whole) = prefix.parse() {
        return Some(whole);
    }
    // Nothing is sent: the system only says from which address it would be.
    let leads = |to: IpAddr| {
        let socket = std::net::UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).ok()?;
        socket.connect((to, 9)).ok()?;
        Some(socket.local_addr().ok()?.ip())
    };
    // Towards an address that would lie in the network meant, then towards everything else.
    let mut parts: Vec<&str> = prefix.trim_end_matches('.').split('.').collect();
    parts.resize(4, "1");
    let inside = parts.join(".").parse().ok().and_then(leads);
    let outside = leads(IpAddr::V4(DISCOVERY_GROUP));
    [inside, outside].into_iter().flatten().find(|address| address.to_string().starts_with(prefix))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::name::{Environment, NameServerConf};

    #[test]
    fn the_environment_names_and_places_ports() {
        let environment = Environment::from_pairs([
            ("YARP_PORT_PREFIX", "/left"),
            ("YARP_PORTNUMBER_cam", "10444"),
            ("YARP_IP", "127."),
        ]);
        let client = NameClient::new(NameServerConf::default()).with_environment(environment);
        let command = |request: &NameRequest| {
            client.adapted(request).and_then(|request| client.register_command(&request))
        };
        let named = |name: &str| NameRequest { name: name.to_owned(), ..NameRequest::default() };
        assert_eq!(command(&named("/cam")).unwrap(), "register /left/cam ... 127.0.0.1 10444");
        let typed = NameRequest { type_name: Some("yarp/image".into()), ..named("/x") };
        assert_eq!(command(&typed).unwrap(), "register /left/x ... 127.0.0.1 -1 yarp/image");
        let group = NameRequest { carrier: Some("mcast".into()), ..named("...") };
        assert_eq!(command(&group).unwrap(), "register ... mcast ... ...");
        let elsewhere =
            client.clone().with_environment(Environment::from_pairs([("YARP_IP", "9.9.9.")]));
        let error = elsewhere.adapted(&named("/cam")).unwrap_err().to_string();
        assert!(error.contains("YARP_IP=\"9.9.9.\""), "{error}");
        let plain = NameClient::new(NameServerConf::default());
        assert_eq!(plain.register_command(&named("/cam")).unwrap(), "register /cam");
    }
}
