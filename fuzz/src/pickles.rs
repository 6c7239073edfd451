//! Target of `wrapyfi_plugins::pickle`.

use std::collections::HashSet;

use bytes::Bytes;
use wrapyfi_plugins::pickle::{self as codec, Allowed, Node, Pickle, View};

use crate::{LIMITS, bounded};

/// Memory for each byte of a pickle: 64, and vectors grow by doubling.
const OPCODES: usize = 200;

/// A pickle, with four buffers beside it. The first byte chooses the list.
pub fn pickle(data: &[u8]) {
    let Some((&choice, body)) = data.split_first() else { return };
    let lists = [Allowed::PANDAS, Allowed::TORCH, Allowed::JAX, Allowed::BUILTINS];
    let allowed = lists.get(usize::from(choice & 3)).unwrap_or(&Allowed::PANDAS);
    let buffers: Vec<Bytes> = [0, 1, 8, 16].map(|size| Bytes::from(vec![7; size])).into();
    let body = Bytes::copy_from_slice(body);

    let read = bounded(data.len(), OPCODES, || codec::read(&body, &buffers, allowed, &LIMITS));
    let read = match read {
        Ok(read) => read,
        Err(error) => {
            assert!(!error.to_string().is_empty());
            return;
        }
    };
    walk(&read);
}

/// Asks every object that the root reaches for everything that it might be.
fn walk(pickle: &Pickle) {
    let mut seen = HashSet::new();
    let mut open = vec![pickle.root()];
    while let Some(node) = open.pop() {
        if !seen.insert(node.id()) {
            continue;
        }
        ask(&node);
        match node.view() {
            View::List(items) | View::Tuple(items) => open.extend(items.iter()),
            View::Set(items) | View::FrozenSet(items) => open.extend(items.iter()),
            View::Dict(pairs) => open.extend(pairs.iter().flat_map(|(key, value)| [key, value])),
            View::Persistent(id) => open.push(id),
            View::Call(call) => {
                open.extend(call.args().iter());
                open.extend(call.pairs().iter().flat_map(|(key, value)| [key, value]));
                open.extend(call.find_state());
            }
            _ => {}
        }
    }
}

fn ask(node: &Node<'_>) {
    assert!(node.path().starts_with('$'));
    let refusals = [
        node.bool().err(),
        node.size().err(),
        node.float().err(),
        node.str().err(),
        node.bytes().err(),
        node.slice().err(),
        node.decimal().err(),
        node.datetime().err(),
        node.date().err(),
        node.time().err(),
        node.timedelta().err(),
        node.dtype().err(),
        node.array().err(),
        node.array_state().err(),
    ];
    assert!(refusals.iter().flatten().all(|error| !error.to_string().is_empty()));
    if let Ok(slice) = node.slice() {
        let _: Option<usize> = slice.map(|indices| indices.take(3).count());
    }
}
