//! Topics, services and nodes of the graph, and the thread that waits for its changes.
//!
//! ```text
//!   guard condition of the graph ──┐
//!   guard condition to stop ───────┴─▶ rmw_wait ─▶ every Notify that is watched
//! ```

#![allow(unsafe_code, reason = "lists of rmw are structs of C")]

use std::ffi::{CStr, c_char, c_void};
use std::ptr;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Weak};
use std::thread::JoinHandle;
use std::time::Duration;

use wrapyfi_retry::Mutex;

use super::endpoint::gid;
use super::node::Node;
use super::{Endpoint, EndpointType, Fault, Notify, TypeHash, c_text, qos, sys};

/// Time for which changes are collected: an endpoint that comes changes the graph several times.
const SETTLES: Duration = Duration::from_millis(5);

impl Node {
    /// Every topic and the types it has, both as the middleware spells them: `rt/chatter`, `rq/addRequest`.
    ///
    /// # Errors
    /// When rmw refuses.
    pub fn topics(&self) -> Result<Vec<(String, Vec<String>)>, Fault> {
        // SAFETY: the node lives; allocator and list are `names_and_types`'s, which frees the list.
        names_and_types("rmw_get_topic_names_and_types", |allocator, found| unsafe {
            sys::rmw_get_topic_names_and_types(self.0.node(), allocator, true, found)
        })
    }

    /// Name and namespace of every node, our own among them.
    ///
    /// # Errors
    /// When rmw refuses.
    pub fn nodes(&self) -> Result<Vec<(String, String)>, Fault> {
        // SAFETY: structs of values, by value.
        let [mut names, mut namespaces] = unsafe {
            [
                sys::rcutils_get_zero_initialized_string_array(),
                sys::rcutils_get_zero_initialized_string_array(),
            ]
        };
        // SAFETY: the lists are zero-initialised, and freed below.
        let code =
            unsafe { sys::rmw_get_node_names(self.0.node(), &raw mut names, &raw mut namespaces) };
        Fault::check("rmw_get_node_names", code)?;
        let nodes = (0..names.size.min(namespaces.size)).map(|at| {
            // SAFETY: both arrays have `size` elements.
            unsafe { (text(*names.data.add(at)), text(*namespaces.data.add(at))) }
        });
        let nodes = nodes.collect();
        for mut list in [names, namespaces] {
            // SAFETY: filled by rmw above.
            let code = unsafe { sys::rcutils_string_array_fini(&raw mut list) };
            Fault::check("rcutils_string_array_fini", code)?;
        }
        Ok(nodes)
    }

    /// Services that a node offers, or with `clients` those that it calls, and their types
    /// (`std_srvs/srv/SetBool`).
    ///
    /// # Errors
    /// When rmw refuses, for instance because the node has gone.
    pub fn services_of(
        &self,
        (name, namespace): (&str, &str),
        clients: bool,
    ) -> Result<Vec<(String, Vec<String>)>, Fault> {
        let operation = "rmw_get_service_names_and_types_by_node";
        let (name, namespace) = (c_text(operation, name)?, c_text(operation, namespace)?);
        let ask = if clients {
            sys::rmw_get_client_names_and_types_by_node
        } else {
            sys::rmw_get_service_names_and_types_by_node
        };
        // SAFETY: as above; the texts end with zeros.
        names_and_types(operation, |allocator, found| unsafe {
            ask(self.0.node(), allocator, name.as_ptr(), namespace.as_ptr(), found)
        })
    }

    /// The endpoints on one side of a topic, given as the middleware spells it; our own are among them.
    ///
    /// # Errors
    /// When rmw refuses.
    pub fn endpoints(&self, topic: &str, side: EndpointType) -> Result<Vec<Endpoint>, Fault> {
        let name = c_text("rmw_get_publishers_info_by_topic", topic)?;
        // SAFETY: structs of values, by value.
        let (mut allocator, mut found) = unsafe {
            (
                sys::rcutils_get_default_allocator(),
                sys::rmw_get_zero_initialized_topic_endpoint_info_array(),
            )
        };
        let ask = match side {
            EndpointType::Publishers => sys::rmw_get_publishers_info_by_topic,
            EndpointType::Subscriptions => sys::rmw_get_subscriptions_info_by_topic,
        };
        // SAFETY: the array is zero-initialised, and freed below.
        let code =
            unsafe { ask(self.0.node(), &raw mut allocator, name.as_ptr(), true, &raw mut found) };
        Fault::check("rmw_get_publishers_info_by_topic", code)?;
        // SAFETY: the array has `size` elements.
        let endpoints = (0..found.size).map(|at| endpoint(unsafe { &*found.info_array.add(at) }));
        let endpoints = endpoints.collect();
        // SAFETY: filled by rmw above.
        let code =
            unsafe { sys::rmw_topic_endpoint_info_array_fini(&raw mut found, &raw mut allocator) };
        Fault::check("rmw_topic_endpoint_info_array_fini", code)?;
        Ok(endpoints)
    }
}

/// Reads the list that `ask` has rmw fill, and frees it.
fn names_and_types(
    operation: &'static str,
    ask: impl FnOnce(*mut sys::rcutils_allocator_t, *mut sys::rmw_names_and_types_t) -> sys::rmw_ret_t,
) -> Result<Vec<(String, Vec<String>)>, Fault> {
    // SAFETY: structs of values, by value; the list is zero-initialised, and freed below.
    let (mut allocator, mut found) = unsafe {
        (sys::rcutils_get_default_allocator(), sys::rmw_get_zero_initialized_names_and_types())
    };
    Fault::check(operation, ask(&raw mut allocator, &raw mut found))?;
    let mut all = Vec::new();
    for at in 0..found.names.size {
        // SAFETY: both arrays have `size` elements.
        let (name, types) = unsafe { (*found.names.data.add(at), &*found.types.add(at)) };
        // SAFETY: as above.
        let types = (0..types.size).map(|one| text(unsafe { *types.data.add(one) })).collect();
        all.push((text(name), types));
    }
    // SAFETY: filled by rmw.
    let code = unsafe { sys::rmw_names_and_types_fini(&raw mut found) };
    Fault::check("rmw_names_and_types_fini", code)?;
    Ok(all)
}

fn endpoint(info: &sys::rmw_topic_endpoint_info_t) -> Endpoint {
    let (namespace, name) = (text(info.node_namespace), text(info.node_name));
    let hash: TypeHash = info.topic_type_hash.value;
    Endpoint {
        node: format!("{}/{name}", namespace.trim_end_matches('/')),
        type_name: text(info.topic_type),
        type_hash: (info.topic_type_hash.version == 1).then_some(hash),
        gid: gid(&info.endpoint_gid),
        qos: qos::from_rmw(&info.qos_profile),
    }
}

/// A text of C; empty where there is none.
fn text(text: *const c_char) -> String {
    if text.is_null() {
        return String::new();
    }
    // SAFETY: texts of rmw end with a zero.
    unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned()
}

/// The thread that waits for changes of the graph.
pub(crate) struct Waiter {
    shared: Arc<Watched>,
    stop: *mut sys::rmw_guard_condition_t,
    thread: Option<JoinHandle<()>>,
}

#[derive(Default)]
struct Watched {
    stops: AtomicBool,
    changes: AtomicU64,
    watches: Mutex<Vec<Weak<Notify>>>,
}

/// Wait set of the thread and its conditions: alive until the thread is joined.
struct Conditions {
    graph: *mut c_void,
    stop: *mut c_void,
    set: *mut sys::rmw_wait_set_t,
}

// SAFETY: guard conditions may be waited for on another thread than that which triggers them; the set is
// the thread's alone.
unsafe impl Send for Conditions {}
// SAFETY: the condition is triggered and destroyed by the owner alone.
unsafe impl Send for Waiter {}

impl Waiter {
    /// Waits for the graph of `node`, which has to live longer.
    pub(crate) fn start(
        context: *mut sys::rmw_context_t,
        node: *const sys::rmw_node_t,
    ) -> Result<Self, Fault> {
        // SAFETY: node and context live.
        let (graph, stop, set) = unsafe {
            (
                sys::rmw_node_get_graph_guard_condition(node),
                sys::rmw_create_guard_condition(context),
                sys::rmw_create_wait_set(context, 2),
            )
        };
        if graph.is_null() || stop.is_null() || set.is_null() {
            return Err(Fault::last("rmw_create_wait_set"));
        }
        // SAFETY: not null.
        let conditions = unsafe { Conditions { graph: (*graph).data, stop: (*stop).data, set } };
        let shared = Arc::new(Watched::default());
        let watched = Arc::clone(&shared);
        let thread = std::thread::Builder::new()
            .name("rmw-graph".to_owned())
            .spawn(move || wait(&conditions, &watched))
            .map_err(|error| Fault::new("starting a thread", error.to_string()))?;
        Ok(Self { shared, stop, thread: Some(thread) })
    }

    pub(crate) fn watch(&self, notify: &Arc<Notify>) {
        let mut watches = self.shared.watches.lock();
        watches.retain(|watch| watch.strong_count() > 0);
        watches.push(Arc::downgrade(notify));
    }

    /// True on the thread that waits.
    pub(crate) fn is_current(&self) -> bool {
        let current = std::thread::current().id();
        self.thread.as_ref().is_some_and(|thread| thread.thread().id() == current)
    }

    pub(crate) fn changes(&self) -> u64 {
        self.shared.changes.load(Relaxed)
    }
}

fn wait(conditions: &Conditions, watched: &Watched) {
    while !watched.stops.load(Relaxed) {
        let mut both = [conditions.graph, conditions.stop];
        let mut guards = sys::rmw_guard_conditions_t {
            guard_condition_count: both.len(),
            guard_conditions: both.as_mut_ptr(),
        };
        let none = ptr::null_mut();
        // SAFETY: conditions and set live until this thread is joined.
        let code = unsafe {
            sys::rmw_wait(
                ptr::null_mut(),
                &raw mut guards,
                ptr::null_mut(),
                ptr::null_mut(),
                ptr::null_mut(),
                conditions.set,
                none,
            )
        };
        if let Err(fault) = Fault::check("rmw_wait", code) {
            tracing::error!(%fault, "changes of the graph are not heard any more");
            break;
        }
        if watched.stops.load(Relaxed) {
            break;
        }
        std::thread::sleep(SETTLES);
        watched.changes.fetch_add(1, Relaxed);
        let watches: Vec<_> = {
            let watches = watched.watches.lock();
            watches.iter().filter_map(Weak::upgrade).collect()
        };
        for watch in watches {
            watch();
        }
    }
    // SAFETY: made for this thread, which is the only one that waits on it.
    let code = unsafe { sys::rmw_destroy_wait_set(conditions.set) };
    if let Err(fault) = Fault::check("rmw_destroy_wait_set", code) {
        tracing::debug!(%fault, "a wait set was not destroyed");
    }
}

impl Drop for Waiter {
    fn drop(&mut self) {
        self.shared.stops.store(true, Relaxed);
        // SAFETY: the condition lives until below.
        let code = unsafe { sys::rmw_trigger_guard_condition(self.stop) };
        if let Err(fault) = Fault::check("rmw_trigger_guard_condition", code) {
            tracing::warn!(%fault, "the thread that waits for the graph is left behind");
            return;
        }
        if self.thread.take().is_some_and(|thread| thread.join().is_err()) {
            tracing::error!("the thread that waited for the graph panicked");
        }
        // SAFETY: no thread waits on it any more.
        let code = unsafe { sys::rmw_destroy_guard_condition(self.stop) };
        if let Err(fault) = Fault::check("rmw_destroy_guard_condition", code) {
            tracing::debug!(%fault, "a guard condition was not destroyed");
        }
    }
}
