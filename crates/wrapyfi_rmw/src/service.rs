//! Clients and servers of services of any type.
//!
//! ```text
//!   Client::send ─ body ─▶ rmw_send_request ─▶ type_support.cpp ─▶ Fast CDR ─▶ middleware
//!   Client::take ◀─ body ─ rmw_take_response ◀─ type_support.cpp ◀──────────── middleware
//! ```

#![allow(unsafe_code, reason = "clients and services of rmw are structs of C")]

use std::ffi::{CString, c_char, c_void};
use std::ptr;
use std::sync::Arc;

use bytes::Bytes;

use super::dispatch::{Callback, call};
use super::endpoint::gid;
use super::node::{Inner, Node};
use super::{Fault, Gid, Notify, SendFault, TypeHash, c_text, qos, sys, types};
use wrapyfi_endpoint::Qos;

/// Bytes of an encapsulation header.
const HEADER: usize = 4;

/// A service on the graph.
#[derive(Debug, Clone, Copy)]
pub struct Service<'a> {
    /// Absolute name.
    pub name: &'a str,
    /// Type, for instance `example_interfaces/srv/AddTwoInts`.
    pub type_name: &'a str,
    /// Hashes of the type, of its `_Request` and of its `_Response`.
    pub hashes: [Option<TypeHash>; 3],
    /// Quality of service of both directions.
    pub qos: Qos,
}

/// Names a request among all requests to a server.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RequestId {
    /// Identity of the client.
    pub client: Gid,
    /// The client's number for it.
    pub sequence: i64,
}

/// A request or a reply that was taken.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Received {
    /// Encapsulation header and body, or the length of a message over the limit.
    pub cdr: Result<Bytes, usize>,
    /// Request that it is, or that it answers.
    pub id: RequestId,
    /// Time at which it was sent, in nanoseconds since 1970.
    pub source_timestamp_ns: i64,
}

/// Sends requests.
pub struct Client {
    raw: *mut sys::rmw_client_t,
    name: CString,
    node: Arc<Inner>,
    _on_reply: Callback,
}

/// Answers requests.
pub struct Server {
    raw: *mut sys::rmw_service_t,
    name: CString,
    node: Arc<Inner>,
    _on_request: Callback,
}

// SAFETY: rmw sends and takes from any thread; the pointer is this value's alone.
unsafe impl Send for Client {}
// SAFETY: as above.
unsafe impl Send for Server {}

/// Received message, in memory that the type support allocated.
struct Body(sys::wrapyfi_body);

// SAFETY: the memory is this value's alone.
unsafe impl Send for Body {}

impl Body {
    fn to_receive(limit: usize) -> Self {
        Self(sys::wrapyfi_body { limit, ..empty() })
    }

    fn pointer(&mut self) -> *mut c_void {
        ptr::from_mut(&mut self.0).cast()
    }

    /// Message with an encapsulation header in front, or its length where it was over the limit.
    fn cdr(&self) -> Result<Bytes, usize> {
        let length = self.0.received_length;
        if length > self.0.limit {
            return Err(length.saturating_add(HEADER));
        }
        let mut cdr = Vec::with_capacity(length.saturating_add(HEADER));
        cdr.extend_from_slice(&[0, u8::from(self.0.received_little_endian), 0, 0]);
        if !self.0.received.is_null() {
            // SAFETY: the type support has written so many bytes.
            cdr.extend_from_slice(unsafe { std::slice::from_raw_parts(self.0.received, length) });
        }
        Ok(cdr.into())
    }
}

impl Drop for Body {
    fn drop(&mut self) {
        // SAFETY: allocated by the type support, or null.
        unsafe { sys::wrapyfi_body_free(&raw mut self.0) };
    }
}

fn empty() -> sys::wrapyfi_body {
    sys::wrapyfi_body {
        data: ptr::null(),
        length: 0,
        received: ptr::null_mut(),
        received_length: 0,
        received_little_endian: true,
        limit: 0,
    }
}

/// The body behind the encapsulation header of a message given in pieces.
fn body(parts: &[&[u8]]) -> Result<Vec<u8>, Fault> {
    let mut joined = parts.concat();
    // The middleware writes a header of its own, in this machine's byte order.
    let own = u8::from(cfg!(target_endian = "little"));
    match joined.get(1) {
        Some(order) if order & 1 == own && joined.len() >= HEADER => Ok(joined.split_off(HEADER)),
        Some(_) if joined.len() >= HEADER => {
            Err(Fault::new("rmw_send_request", "the message is in the other byte order"))
        }
        _ => Err(Fault::new("rmw_send_request", "the message has no encapsulation header")),
    }
}

fn sent(operation: &'static str, code: sys::rmw_ret_t) -> Result<(), SendFault> {
    if code == sys::RMW_RET_TIMEOUT as sys::rmw_ret_t {
        _ = Fault::last(operation);
        return Err(SendFault::Timeout);
    }
    Ok(Fault::check(operation, code)?)
}

/// Sends a message given in pieces with `send`, which is told where the type support finds its body.
fn send(
    operation: &'static str,
    parts: &[&[u8]],
    send: impl FnOnce(*mut c_void) -> sys::rmw_ret_t,
) -> Result<(), SendFault> {
    let bytes = body(parts)?;
    let mut message = sys::wrapyfi_body { data: bytes.as_ptr(), length: bytes.len(), ..empty() };
    sent(operation, send(ptr::from_mut(&mut message).cast()))
}

/// The message that `take` takes, if one waits: its information, its body, and true where one was taken.
fn take(
    operation: &'static str,
    max_bytes: usize,
    take: impl FnOnce(&mut sys::rmw_service_info_t, *mut c_void, &mut bool) -> sys::rmw_ret_t,
) -> Result<Option<Received>, Fault> {
    let mut body = Body::to_receive(max_bytes);
    let mut info = sys::rmw_service_info_t::default();
    let mut taken = false;
    Fault::check(operation, take(&mut info, body.pointer(), &mut taken))?;
    let client = super::endpoint::gid(&info.request_id.writer_guid);
    Ok(taken.then(|| Received {
        cdr: body.cdr(),
        id: RequestId { client, sequence: info.request_id.sequence_number },
        source_timestamp_ns: info.source_timestamp,
    }))
}

impl Node {
    /// Creates a client. `on_reply` is called when a reply waits.
    ///
    /// # Errors
    /// When rmw refuses; the reason is its own.
    pub fn client(&self, service: &Service<'_>, on_reply: Notify) -> Result<Client, Fault> {
        let support = types::service(service.type_name, &service.hashes)?;
        let name = c_text("rmw_create_client", service.name)?;
        let node = Arc::clone(&self.0);
        let making = node.making();
        let qos = qos::to_rmw(&service.qos, service.name);
        // SAFETY: the node lives, the type support lives as long as the process, and rmw copies the rest.
        let raw = unsafe {
            sys::rmw_create_client(node.node(), support.0, name.as_ptr(), &raw const qos)
        };
        if raw.is_null() {
            return Err(Fault::last("rmw_create_client"));
        }
        drop(making);
        let on_reply = node.dispatch().callback(on_reply, None);
        let user_data = on_reply.user_data();
        let made = Client { raw, name, node, _on_reply: on_reply };
        // SAFETY: the callback lives as long as the client, which takes it back on drop.
        let code =
            unsafe { sys::rmw_client_set_on_new_response_callback(raw, Some(call), user_data) };
        Fault::check("rmw_client_set_on_new_response_callback", code)?;
        Ok(made)
    }

    /// Creates a server. `on_request` is called when a request waits.
    ///
    /// # Errors
    /// When rmw refuses; the reason is its own.
    pub fn server(&self, service: &Service<'_>, on_request: Notify) -> Result<Server, Fault> {
        let support = types::service(service.type_name, &service.hashes)?;
        let name = c_text("rmw_create_service", service.name)?;
        let node = Arc::clone(&self.0);
        let making = node.making();
        let qos = qos::to_rmw(&service.qos, service.name);
        // SAFETY: as for a client.
        let raw = unsafe {
            sys::rmw_create_service(node.node(), support.0, name.as_ptr(), &raw const qos)
        };
        if raw.is_null() {
            return Err(Fault::last("rmw_create_service"));
        }
        drop(making);
        let on_request = node.dispatch().callback(on_request, None);
        let user_data = on_request.user_data();
        let made = Server { raw, name, node, _on_request: on_request };
        // SAFETY: the callback lives as long as the server, which takes it back on drop.
        let code =
            unsafe { sys::rmw_service_set_on_new_request_callback(raw, Some(call), user_data) };
        Fault::check("rmw_service_set_on_new_request_callback", code)?;
        Ok(made)
    }
}

impl Client {
    /// Sends a request, given in pieces that are concatenated: encapsulation header first. Its sequence number.
    ///
    /// # Errors
    /// The request was not sent.
    pub fn send(&self, parts: &[&[u8]]) -> Result<i64, SendFault> {
        let mut sequence = 0;
        // SAFETY: the client lives; the type support reads the body until rmw returns.
        let request =
            |body: *mut c_void| unsafe { sys::rmw_send_request(self.raw, body, &raw mut sequence) };
        send("rmw_send_request", parts, request)?;
        Ok(sequence)
    }

    /// The next reply to a request of this client, if one waits.
    ///
    /// # Errors
    /// When rmw refuses.
    pub fn take(&self, max_bytes: usize) -> Result<Option<Received>, Fault> {
        // SAFETY: the client lives; the type support writes the body.
        take("rmw_take_response", max_bytes, |info, body, taken| unsafe {
            sys::rmw_take_response(self.raw, info, body, taken)
        })
    }

    /// True when a server would hear a request now.
    pub fn has_server(&self) -> bool {
        let mut is_available = false;
        // SAFETY: node and client live.
        let code = unsafe {
            sys::rmw_service_server_is_available(self.node.node(), self.raw, &raw mut is_available)
        };
        Fault::check("rmw_service_server_is_available", code).is_ok() && is_available
    }

    /// Identity of the client; zeros where rmw does not tell it.
    pub fn gid(&self) -> Gid {
        let mut own = sys::rmw_gid_t::default();
        // SAFETY: the client lives.
        let code = unsafe { sys::rmw_get_gid_for_client(self.raw, &raw mut own) };
        Fault::check("rmw_get_gid_for_client", code).map(|()| gid(&own.data)).unwrap_or_default()
    }

    /// Number of servers on the graph.
    pub fn servers(&self) -> usize {
        count(&self.node, &self.name, sys::rmw_count_services)
    }
}

impl Server {
    /// The next request, if one waits.
    ///
    /// # Errors
    /// When rmw refuses.
    pub fn take(&self, max_bytes: usize) -> Result<Option<Received>, Fault> {
        // SAFETY: the server lives; the type support writes the body.
        take("rmw_take_request", max_bytes, |info, body, taken| unsafe {
            sys::rmw_take_request(self.raw, info, body, taken)
        })
    }

    /// Answers a request, with the reply in pieces as [`Client::send`] takes them.
    ///
    /// # Errors
    /// The reply was not sent.
    pub fn reply(&self, id: &RequestId, parts: &[&[u8]]) -> Result<(), SendFault> {
        let mut header = sys::rmw_request_id_t::default();
        for (to, from) in header.writer_guid.iter_mut().zip(id.client) {
            *to = from as _;
        }
        header.sequence_number = id.sequence;
        // SAFETY: the server lives; the type support reads the body until rmw returns.
        send("rmw_send_response", parts, |body| unsafe {
            sys::rmw_send_response(self.raw, &raw mut header, body)
        })
    }

    /// Number of clients on the graph.
    pub fn clients(&self) -> usize {
        count(&self.node, &self.name, sys::rmw_count_clients)
    }
}

type Count =
    unsafe extern "C" fn(*const sys::rmw_node_t, *const c_char, *mut usize) -> sys::rmw_ret_t;

fn count(node: &Inner, name: &CString, ask: Count) -> usize {
    let mut found = 0;
    // SAFETY: the node lives, the name ends with a zero.
    let code = unsafe { ask(node.node(), name.as_ptr(), &raw mut found) };
    Fault::check("rmw_count_clients", code).map_or(0, |()| found)
}

impl Drop for Client {
    fn drop(&mut self) {
        // SAFETY: after this no thread calls the callback: middlewares hold the lock under which they call.
        let codes = unsafe {
            let callback =
                sys::rmw_client_set_on_new_response_callback(self.raw, None, ptr::null());
            let _making = self.node.making();
            [callback, sys::rmw_destroy_client(self.node.node(), self.raw)]
        };
        ended(codes);
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        // SAFETY: as for a client.
        let codes = unsafe {
            let callback =
                sys::rmw_service_set_on_new_request_callback(self.raw, None, ptr::null());
            let _making = self.node.making();
            [callback, sys::rmw_destroy_service(self.node.node(), self.raw)]
        };
        ended(codes);
    }
}

fn ended(codes: [sys::rmw_ret_t; 2]) {
    for code in codes {
        if let Err(fault) = Fault::check("destroying a service's end", code) {
            tracing::warn!(%fault, "an end of a service was not destroyed");
        }
    }
}
