//! Endpoints that exist are found, with their role, and those that went are gone.

use wrapyfi_endpoint::{Discovered, Discovery, Role, Wake};

use crate::payloads::{number, text};
use crate::{Testbed, WireEnd, connect, wait_until};

/// Endpoints of the other side are found while a discovery looks, and only while they exist. A
/// publisher sends meanwhile: a transport may know it by nothing else.
pub fn what_exists_is_found_and_what_went_is_not<R: Testbed>() {
    let testbed = R::start();
    let wake = Wake::new();
    for from in WireEnd::BOTH {
        let spec = text(&format!("/{from:?}"));
        let (mut source, sink) = connect(&testbed, from, &spec);
        let role_of_far = |far| if far == from { Role::Publisher } else { Role::Listener };
        let mut looks = WireEnd::BOTH.map(|side| {
            let discovery =
                testbed.side(side).discover().expect("a middleware that can be looked at");
            (discovery, role_of_far(side.other()))
        });
        wait_until(&wake, "both ends to be found", || {
            source.send(&number(0));
            looks.iter_mut().all(|(look, role)| {
                let found = endpoints(&mut **look);
                found
                    .iter()
                    .any(|one| one.name == spec.topic && one.role == *role && one.count == 1)
            })
        });
        wait_until(&wake, "the looks to be complete, where the transport knows", || {
            looks.iter_mut().all(|(look, _)| {
                endpoints(&mut **look);
                look.is_complete() != Some(false)
            })
        });
        drop(sink);
        let (look, _) = looks
            .iter_mut()
            .find(|(_, role)| *role == Role::Listener)
            .expect("one of the two looks for the listener");
        wait_until(&wake, "the listener to be gone", || {
            let found = endpoints(&mut **look);
            !found.iter().any(|one| one.name == spec.topic && one.role == Role::Listener)
        });
    }
}

fn endpoints(discovery: &mut dyn Discovery) -> Vec<Discovered> {
    discovery.endpoints().expect("a transport that answers")
}
