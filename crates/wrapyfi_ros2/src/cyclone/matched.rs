//! Peers that an endpoint is matched with.
//!
//! ```text
//!   writer ── dds_get_matched_subscriptions ──▶ handles ── …_data ──▶ EndpointFound { guid, qos, user_data, … }
//!   reader ── dds_get_matched_publications ───▶ handles ── …_data ──▶ EndpointFound
//! ```
//!
//! Contract: what Cyclone allocates for a peer is freed here; what leaves this module is copied.
#![allow(unsafe_code)]

use super::builtin::EndpointFound;
use super::entity::{Entity, ReturnCode};

/// Side of a match that an endpoint is on.
#[derive(Debug, Clone, Copy)]
pub(super) enum Side {
    Writer,
    Reader,
}

/// Most peers that are looked at.
const MAX_PEERS: usize = 1 << 14;

/// All peers of an endpoint.
pub(super) fn peers(endpoint: &Entity, side: Side) -> Result<Vec<EndpointFound>, ReturnCode> {
    let handles = handles(endpoint, side)?;
    Ok(handles.into_iter().filter_map(|handle| peer(endpoint, side, handle)).collect())
}

/// Handles of the peers that an endpoint is matched with.
pub(super) fn handles(endpoint: &Entity, side: Side) -> Result<Vec<u64>, ReturnCode> {
    let mut handles = vec![0; 16];
    loop {
        let (room, count) = (handles.len(), endpoint.handle());
        // SAFETY: `room` handles fit; the call writes no more and returns how many there are.
        let found = ReturnCode::check(unsafe {
            match side {
                Side::Writer => {
                    cyclors::dds_get_matched_subscriptions(count, handles.as_mut_ptr(), room)
                }
                Side::Reader => {
                    cyclors::dds_get_matched_publications(count, handles.as_mut_ptr(), room)
                }
            }
        })?;
        let found = usize::try_from(found).unwrap_or(0);
        if found <= room || room >= MAX_PEERS {
            handles.truncate(found);
            return Ok(handles);
        }
        handles.resize(found.min(MAX_PEERS), 0);
    }
}

/// The peer with this handle, if it is still matched.
pub(super) fn peer(endpoint: &Entity, side: Side, handle: u64) -> Option<EndpointFound> {
    // SAFETY: plain numbers; the result is null or an object that is ours to free.
    let data = unsafe {
        match side {
            Side::Writer => cyclors::dds_get_matched_subscription_data(endpoint.handle(), handle),
            Side::Reader => cyclors::dds_get_matched_publication_data(endpoint.handle(), handle),
        }
    };
    let is_writer = matches!(side, Side::Reader);
    // SAFETY: null, or alive until freed below.
    let peer = unsafe { data.as_ref().map(|found| EndpointFound::copy(is_writer, found)) }?;
    // SAFETY: not null here, allocated by the call above, freed once.
    unsafe { cyclors::dds_builtintopic_free_endpoint(data) };
    Some(peer)
}
