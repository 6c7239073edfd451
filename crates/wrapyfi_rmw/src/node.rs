//! A node: joins the graph when it is made, leaves it when the last of its endpoints is dropped.

#![allow(unsafe_code, reason = "contexts and nodes are structs of C")]

use std::cell::UnsafeCell;
use std::collections::HashMap;
use std::ffi::CStr;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, MutexGuard, Weak};

use wrapyfi_retry::Mutex;

use super::dispatch::Dispatch;
use super::graph::Waiter;
use super::own::Own;
use super::security::Keys;
use super::{Fault, Gid, Notify, c_text, sys};

/// Range in which a node looks for others, `ROS_AUTOMATIC_DISCOVERY_RANGE`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs, reason = "ROS 2's own terms")]
pub enum DiscoveryRange {
    Off,
    Localhost,
    Subnet,
    SystemDefault,
}

/// Settings of a new node.
#[derive(Debug, Clone)]
pub struct NodeOptions {
    /// Name without namespace.
    pub name: String,
    /// Namespace, for instance `/robot`.
    pub namespace: String,
    /// Name by which security finds the node's keys: `/` where none is given.
    pub enclave: String,
    /// Domain.
    pub domain_id: u32,
    /// Range in which participants are looked for.
    pub range: DiscoveryRange,
    /// Addresses asked one by one; each shorter than 256 bytes.
    pub static_peers: Vec<String>,
}

/// Last domain whose ports exist.
const MAX_DOMAIN: u32 = 232;

/// A node on the graph. Copies are the same node.
#[derive(Clone)]
pub struct Node(pub(crate) Arc<Inner>);

pub(crate) struct Inner {
    node: *mut sys::rmw_node_t,
    /// Dropped after the node is destroyed.
    shared: Arc<NodeState>,
}

/// State that a node and its children share.
struct NodeState {
    /// `None` once the middleware has been left.
    joined: Option<Joined>,
    /// rmw creates and destroys one node or endpoint at a time.
    making: Mutex<()>,
    own: Mutex<Own>,
    dispatch: Dispatch,
    /// Nodes beside the first one, by name and namespace.
    children: Mutex<HashMap<(String, String), Weak<Inner>>>,
}

/// Parts that end when the middleware is left.
struct Joined {
    waiter: Waiter,
    /// The node whose graph is waited for; the others are its children.
    node: *mut sys::rmw_node_t,
    /// Boxed, because nodes point to it.
    context: Box<UnsafeCell<sys::rmw_context_t>>,
}

// SAFETY: moved to one thread, which leaves the middleware there.
unsafe impl Send for Joined {}
// SAFETY: the context is touched by rmw alone: where nodes are created, under `making`, and where it is left.
unsafe impl Sync for Joined {}

// SAFETY: rmw's functions that read the graph, publish and take may be called by every thread; those that create and
// destroy are called under `making`.
unsafe impl Send for Inner {}
// SAFETY: as above.
unsafe impl Sync for Inner {}

/// Name of the middleware that is loaded, for instance `rmw_fastrtps_cpp`. Loads it where none is.
///
/// # Errors
/// When the library that `RMW_IMPLEMENTATION` names cannot be loaded, or is of another distribution than that which the
/// program was built with; the reason names both.
pub fn implementation() -> Result<String, Fault> {
    super::loaded::check()?;
    super::log::begin();
    // SAFETY: no arguments; the text is a constant of the library, which is never unloaded.
    let name = unsafe { sys::rmw_get_implementation_identifier() };
    if name.is_null() {
        return Err(Fault::last("loading the middleware"));
    }
    // SAFETY: not null, and ends with a zero.
    Ok(unsafe { CStr::from_ptr(name) }.to_string_lossy().into_owned())
}

impl Node {
    /// Joins the graph.
    ///
    /// # Errors
    /// When the middleware cannot be loaded or refuses: the reason is its own.
    pub fn new(options: &NodeOptions) -> Result<Self, Fault> {
        if options.domain_id > MAX_DOMAIN {
            // Fast DDS ends the process.
            let reason = format!("domain {} is over {MAX_DOMAIN}", options.domain_id);
            return Err(Fault::new("rmw_init", reason));
        }
        let own = Own::on(&implementation()?);
        let dispatch = Dispatch::start()?;
        let text = |text: &str| c_text("rmw_create_node", text);
        let (name, namespace) = (text(&options.name)?, text(&options.namespace)?);
        let context = context(options, &text(&options.enclave)?)?;
        // SAFETY: the context is initialised and stays where it is.
        let node =
            unsafe { sys::rmw_create_node(context.get(), name.as_ptr(), namespace.as_ptr()) };
        if node.is_null() {
            let fault = Fault::last("rmw_create_node");
            end(&context);
            return Err(fault);
        }
        let waiter = match Waiter::start(context.get(), node) {
            Ok(waiter) => waiter,
            Err(fault) => {
                destroy(node);
                end(&context);
                return Err(fault);
            }
        };
        let shared = Arc::new(NodeState {
            joined: Some(Joined { waiter, node, context }),
            making: Mutex::default(),
            own: Mutex::new(own),
            dispatch,
            children: Mutex::default(),
        });
        Ok(Self(Arc::new(Inner { node, shared })))
    }

    /// Another node of the same program, which shares everything with this one but its name. The same one as long as it
    /// lives.
    ///
    /// # Errors
    /// When rmw refuses the name.
    pub fn child(&self, name: &str, namespace: &str) -> Result<Self, Fault> {
        let text = |text: &str| c_text("rmw_create_node", text);
        let key = (name.to_owned(), namespace.to_owned());
        let (name, namespace) = (text(name)?, text(namespace)?);
        let shared = Arc::clone(&self.0.shared);
        let mut children = shared.children.lock();
        if let Some(known) = children.get(&key).and_then(Weak::upgrade) {
            return Ok(Self(known));
        }
        let Some(joined) = &shared.joined else {
            return Err(Fault::new("rmw_create_node", "the middleware was left"));
        };
        let making = self.0.making();
        // SAFETY: the context lives as long as what is shared.
        let node = unsafe {
            sys::rmw_create_node(joined.context.get(), name.as_ptr(), namespace.as_ptr())
        };
        drop(making);
        if node.is_null() {
            return Err(Fault::last("rmw_create_node"));
        }
        let child = Arc::new(Inner { node, shared: Arc::clone(&shared) });
        children.retain(|_, child| child.strong_count() > 0);
        children.insert(key, Arc::downgrade(&child));
        drop(children);
        Ok(Self(child))
    }

    /// Calls `on_change` from a thread of the node whenever the graph has changed, for as long as the returned value
    /// lives.
    #[must_use]
    pub fn watch_graph(&self, on_change: Notify) -> Arc<Notify> {
        let kept = Arc::new(on_change);
        if let Some(joined) = &self.0.shared.joined {
            joined.waiter.watch(&kept);
        }
        kept
    }

    /// Number of changes of the graph so far.
    pub fn graph_changes(&self) -> u64 {
        self.0.shared.joined.as_ref().map_or(0, |joined| joined.waiter.changes())
    }

    /// True when the identity is that of an endpoint of this node: it begins as those of the node's
    /// publishers, on DDS by the twelve bytes of the participant.
    pub fn owns(&self, gid: &Gid) -> bool {
        self.0.own().gids.iter().any(|one| one.first_chunk::<12>() == gid.first_chunk::<12>())
    }
}

impl Inner {
    pub(crate) fn node(&self) -> *mut sys::rmw_node_t {
        self.node
    }

    pub(crate) fn making(&self) -> MutexGuard<'_, ()> {
        self.shared.making.lock()
    }

    pub(crate) fn dispatch(&self) -> &Dispatch {
        &self.shared.dispatch
    }

    pub(crate) fn own(&self) -> MutexGuard<'_, Own> {
        self.shared.own.lock()
    }
}

/// Initialises rmw for a node.
fn context(
    options: &NodeOptions,
    enclave: &CStr,
) -> Result<Box<UnsafeCell<sys::rmw_context_t>>, Fault> {
    static INSTANCES: AtomicU64 = AtomicU64::new(1);
    // SAFETY: structs of values, by value.
    let (allocator, mut init, zero) = unsafe {
        (
            sys::rcutils_get_default_allocator(),
            sys::rmw_get_zero_initialized_init_options(),
            sys::rmw_get_zero_initialized_context(),
        )
    };
    // SAFETY: the options are zero-initialised, as rmw asks for.
    let code = unsafe { sys::rmw_init_options_init(&raw mut init, allocator) };
    Fault::check("rmw_init_options_init", code)?;
    init.instance_id = INSTANCES.fetch_add(1, Relaxed);
    init.domain_id = options.domain_id as usize;
    let filled = fill(options, enclave, &mut init, allocator);
    let context = Box::new(UnsafeCell::new(zero));
    let outcome = filled.and_then(|()| {
        // SAFETY: both are initialised, and rmw copies the options.
        Fault::check("rmw_init", unsafe { sys::rmw_init(&raw const init, context.get()) })
    });
    // SAFETY: initialised above, used by nothing else.
    let code = unsafe { sys::rmw_init_options_fini(&raw mut init) };
    if let Err(fault) = Fault::check("rmw_init_options_fini", code) {
        tracing::debug!(%fault, "options were not freed");
    }
    outcome.map(|()| context)
}

/// Writes enclave, discovery and security into the options.
fn fill(
    options: &NodeOptions,
    enclave: &CStr,
    init: &mut sys::rmw_init_options_t,
    mut allocator: sys::rcutils_allocator_t,
) -> Result<(), Fault> {
    // SAFETY: a copy that the options own from now on.
    init.enclave = unsafe { sys::rcutils_strdup(enclave.as_ptr(), allocator) };
    // SAFETY: the peers' place was empty; it gets room for so many.
    let code = unsafe {
        let peers = options.static_peers.len();
        sys::rmw_discovery_options_init(&raw mut init.discovery_options, peers, &raw mut allocator)
    };
    Fault::check("rmw_discovery_options_init", code)?;
    init.discovery_options.automatic_discovery_range = match options.range {
        DiscoveryRange::Off => sys::RMW_AUTOMATIC_DISCOVERY_RANGE_OFF,
        DiscoveryRange::Localhost => sys::RMW_AUTOMATIC_DISCOVERY_RANGE_LOCALHOST,
        DiscoveryRange::Subnet => sys::RMW_AUTOMATIC_DISCOVERY_RANGE_SUBNET,
        DiscoveryRange::SystemDefault => sys::RMW_AUTOMATIC_DISCOVERY_RANGE_SYSTEM_DEFAULT,
    };
    for (at, peer) in options.static_peers.iter().enumerate() {
        // SAFETY: there are as many places as peers.
        let place = unsafe { &mut (*init.discovery_options.static_peers.add(at)).peer_address };
        if peer.len() >= place.len() {
            let (actual, limit) = (peer.len(), place.len() - 1);
            let reason = format!("peer {peer:?} has {actual} bytes, the limit is {limit}");
            return Err(Fault::new("ROS_STATIC_PEERS", reason));
        }
        for (to, from) in place.iter_mut().zip(peer.bytes().chain([0])) {
            *to = from.cast_signed() as std::ffi::c_char;
        }
    }
    let Some(keys) = Keys::from_environment(&options.enclave, |name| std::env::var(name).ok())?
    else {
        return Ok(());
    };
    init.security_options.enforce_security = if keys.enforced {
        sys::RMW_SECURITY_ENFORCEMENT_ENFORCE
    } else {
        sys::RMW_SECURITY_ENFORCEMENT_PERMISSIVE
    };
    let folder = c_text("ROS_SECURITY_KEYSTORE", &keys.folder.to_string_lossy())?;
    // SAFETY: the options get a copy of the path, which they own from now on.
    let code = unsafe {
        let security = &raw mut init.security_options;
        sys::rmw_security_options_set_root_path(folder.as_ptr(), &raw const allocator, security)
    };
    Fault::check("ROS_SECURITY_KEYSTORE", code)
}

/// Leaves the middleware.
fn end(context: &UnsafeCell<sys::rmw_context_t>) {
    // SAFETY: the context was initialised, and nothing uses it any more.
    let code = unsafe { sys::wrapyfi_leave(context.get()) };
    if let Err(fault) = Fault::check("rmw_shutdown", code) {
        tracing::warn!(%fault, "the middleware did not end well");
    }
}

/// Destroys a node.
fn destroy(node: *mut sys::rmw_node_t) {
    // SAFETY: endpoints keep the node alive: there are none any more.
    let code = unsafe { sys::rmw_destroy_node(node) };
    if let Err(fault) = Fault::check("rmw_destroy_node", code) {
        tracing::warn!(%fault, "the node was not destroyed");
    }
}

impl Joined {
    fn leave(self) {
        // Before what it waits on.
        drop(self.waiter);
        destroy(self.node);
        end(&self.context);
    }
}

impl Drop for Inner {
    fn drop(&mut self) {
        // The first node goes last, with what is shared.
        if self.shared.joined.as_ref().is_some_and(|joined| joined.node != self.node) {
            let _making = self.making();
            destroy(self.node);
        }
    }
}

impl Drop for NodeState {
    fn drop(&mut self) {
        let Some(joined) = self.joined.take() else { return };
        // A watch that holds the last share of the node may be dropped by the thread that waits for the graph, which
        // cannot wait for its own end.
        if joined.waiter.is_current() {
            std::thread::spawn(move || joined.leave());
        } else {
            joined.leave();
        }
    }
}
