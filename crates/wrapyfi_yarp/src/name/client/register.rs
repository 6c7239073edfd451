//! Registration of a port: the demands that it sends to the name server.

use super::{NameClient, NameError};
use crate::port::names::NameRequest;

impl NameClient {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::name::NameServerConf;

    #[test]
    fn what_is_not_wanted_is_left_to_the_name_server() {
        let client = NameClient::new(NameServerConf::default());
        let command = |request: &NameRequest| client.register_command(request).unwrap();
        let named = |name: &str| NameRequest { name: name.to_owned(), ..NameRequest::default() };
        assert_eq!(command(&named("/cam")), "register /cam");
        let placed =
            NameRequest { host: Some("127.0.0.1".into()), port: Some(10_444), ..named("/cam") };
        assert_eq!(command(&placed), "register /cam ... 127.0.0.1 10444");
        let typed = NameRequest { type_name: Some("yarp/image".into()), ..named("/x") };
        assert_eq!(command(&typed), "register /x ... ... -1 yarp/image");
        let group = NameRequest { carrier: Some("mcast".into()), ..named("...") };
        assert_eq!(command(&group), "register ... mcast ... ...");
    }
}
