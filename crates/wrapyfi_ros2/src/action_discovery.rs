//! Actions among the endpoints that discovery finds.
//!
//! ```text
//!   /fibonacci/_action/{send_goal, cancel_goal, get_result}   servers of /robot  ─┐
//!   /fibonacci/_action/{feedback, status}                  publishers of /robot  ─┴─▶ /fibonacci, action server of /robot
//! ```
//!
//! Parts of which a node has not all stay what they are.

use std::collections::BTreeMap;

use super::action::{INFIX, PARTS, SERVICES};
use wrapyfi_endpoint::{Discovered, Interaction, Role};

/// Name, role and node of an action's endpoints, and the places of each of their parts in a list.
type Whole = BTreeMap<(String, Role, Option<String>), [Vec<usize>; PARTS.len()]>;

/// Endpoints with the five parts of an action as one.
pub(super) fn with_actions(found: Vec<Discovered>) -> Vec<Discovered> {
    let mut whole = Whole::new();
    for (place, one) in found.iter().enumerate() {
        if let Some((action, part, role)) = part_of(one)
            && let Some(places) =
                whole.entry((action.to_owned(), role, one.node.clone())).or_default().get_mut(part)
        {
            places.push(place);
        }
    }
    let mut found: Vec<Option<Discovered>> = found.into_iter().map(Some).collect();
    let mut actions = Vec::new();
    for ((name, role, node), places) in whole {
        let count = places.iter().map(Vec::len).min().unwrap_or(0);
        let mut taken = places.iter().flat_map(|places| places.iter().take(count));
        let first = taken.next().and_then(|place| found.get_mut(*place)?.take());
        let Some(first) = first else { continue };
        for place in taken {
            if let Some(part) = found.get_mut(*place) {
                *part = None;
            }
        }
        let type_name = first.type_name.as_deref().and_then(|name| name.strip_suffix("_SendGoal"));
        actions.push(Discovered {
            type_name: type_name.map(str::to_owned),
            type_hash: first.type_hash,
            node,
            count: count as u64,
            mark: first.mark,
            ..Discovered::new(name, role)
        });
    }
    found.into_iter().flatten().chain(actions).collect()
}

/// Name of the action of which an endpoint is a part, the place of the part among [`PARTS`], and the role of the whole.
fn part_of(one: &Discovered) -> Option<(&str, usize, Role)> {
    let (action, part) = one.name.rsplit_once(INFIX)?;
    let place = PARTS.iter().position(|known| *known == part)?;
    let interaction = if place < SERVICES { Interaction::Service } else { Interaction::Topic };
    let role = match one.role.is_provider() {
        true => Role::ActionServer,
        false => Role::ActionClient,
    };
    (one.role.interaction() == interaction).then_some((action, place, role))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parts(role: [Role; 2], node: &str) -> Vec<Discovered> {
        let one = |place: usize, part: &str| {
            let [of_service, of_topic] = role;
            let role = if place < SERVICES { of_service } else { of_topic };
            let hash = Some(format!("hash of {part}"));
            let type_name = Some("demo/action/Do_SendGoal".to_owned());
            let node = Some(node.to_owned());
            let name = format!("/do/_action/{part}");
            Discovered { type_name, type_hash: hash, node, ..Discovered::new(name, role) }
        };
        PARTS.iter().enumerate().map(|(place, part)| one(place, part)).collect()
    }

    fn roles(found: Vec<Discovered>) -> Vec<(String, Role, u64)> {
        found.into_iter().map(|one| (one.name, one.role, one.count)).collect()
    }

    #[test]
    fn five_parts_of_a_node_are_one_action() {
        let servers = [Role::Server, Role::Publisher];
        let clients = [Role::Client, Role::Listener];
        let mut all = parts(servers, "/a");
        all.extend(parts(clients, "/a"));
        all.extend(parts(clients, "/b"));
        all.extend(parts(clients, "/b"));
        let other = Discovered::new("/do", Role::Publisher);
        all.push(other.clone());
        let found = with_actions(all);
        let server = found.iter().find(|one| one.role == Role::ActionServer).unwrap();
        assert_eq!(server.type_name.as_deref(), Some("demo/action/Do"));
        assert_eq!(server.type_hash.as_deref(), Some("hash of send_goal"));
        let [client, server, name] = [Role::ActionClient, Role::ActionServer, Role::Publisher];
        let of = |role, count| ("/do".to_owned(), role, count);
        assert_eq!(roles(found), [of(name, 1), of(client, 1), of(client, 2), of(server, 1)]);
    }

    #[test]
    fn parts_of_which_one_is_missing_stay_parts() {
        for missing in 0..PARTS.len() {
            let mut some = parts([Role::Server, Role::Publisher], "/a");
            some.remove(missing);
            assert_eq!(with_actions(some.clone()), some);
        }
        // A program that only listens to what goes on.
        let listener = Discovered::new("/do/_action/status", Role::Listener);
        assert_eq!(with_actions(vec![listener.clone()]), [listener]);
    }
}
