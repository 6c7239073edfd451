//! Type supports for types that no package here defines.
//!
//! ```text
//!   "sensor_msgs/msg/Image", RIHS01_… ─▶ rosidl_message_type_support_t   kept as long as the process:
//!                                                                        middlewares keep pointers
//! ```

#![allow(unsafe_code, reason = "type supports are structs of C")]

use std::collections::HashMap;
use std::ffi::{CString, c_char};
use std::hash::Hash;
use std::ptr;
use std::sync::LazyLock;

use wrapyfi_retry::Mutex;

use super::Fault;
use super::sys;

/// REP-2016 hash of a type, version 1.
pub type TypeHash = [u8; 32];

/// A pointer that every thread may read.
#[derive(Clone, Copy)]
pub(crate) struct SharedPointer<T>(pub(crate) *const T);

// SAFETY: what it points to is written before it is shared, never after, and is never freed.
unsafe impl<T> Send for SharedPointer<T> {}

pub(crate) type MessageType = SharedPointer<sys::rosidl_message_type_support_t>;
pub(crate) type ServiceType = SharedPointer<sys::rosidl_service_type_support_t>;

type Hashes = [Option<TypeHash>; 3];

/// Type supports, by name and hashes.
type Known<H, T> = LazyLock<Mutex<HashMap<(String, H), T>>>;

static MESSAGES: Known<Option<TypeHash>, MessageType> = LazyLock::new(Mutex::default);
static SERVICES: Known<Hashes, ServiceType> = LazyLock::new(Mutex::default);

/// `sensor_msgs/msg/Image` as `sensor_msgs::msg` and `Image`.
fn split(type_name: &str) -> Result<[CString; 2], Fault> {
    let wrong = || Fault::new("type support", format!("{type_name:?} is no package/kind/Type"));
    let (before, name) = type_name.rsplit_once('/').ok_or_else(wrong)?;
    if !before.contains('/') {
        return Err(wrong());
    }
    let text = |text: String| CString::new(text).ok().ok_or_else(wrong);
    Ok([text(before.replace('/', "::"))?, text(name.to_owned())?])
}

fn pointer(hash: Option<&TypeHash>) -> *const u8 {
    hash.map_or(ptr::null(), |hash| hash.as_ptr())
}

/// The type support that is known by this name and these hashes, else the one that `make` makes of package and name.
fn kept<H: Eq + Hash, T: Copy>(
    known: &Known<H, SharedPointer<T>>,
    (type_name, hashes): (&str, H),
    make: impl FnOnce(*const c_char, *const c_char) -> *const T,
) -> Result<SharedPointer<T>, Fault> {
    let [namespace, name] = split(type_name)?;
    let mut known = known.lock();
    let key = (type_name.to_owned(), hashes);
    if let Some(&made) = known.get(&key) {
        return Ok(made);
    }
    let made = make(namespace.as_ptr(), name.as_ptr());
    if made.is_null() {
        return Err(Fault::new("type support", "no memory"));
    }
    Ok(*known.entry(key).or_insert(SharedPointer(made)))
}

/// Type support of a message type.
pub(crate) fn message(type_name: &str, hash: Option<&TypeHash>) -> Result<MessageType, Fault> {
    // SAFETY: the texts end with zeros and the hash has 32 bytes; all are copied.
    kept(&MESSAGES, (type_name, hash.copied()), |namespace, name| unsafe {
        sys::wrapyfi_message_type(namespace, name, pointer(hash))
    })
}

/// Type support of a service type, with its hash and those of its request and its response.
pub(crate) fn service(type_name: &str, hashes: &Hashes) -> Result<ServiceType, Fault> {
    let [own, request, response] = hashes.each_ref().map(|hash| pointer(hash.as_ref()));
    // SAFETY: as in `message`.
    kept(&SERVICES, (type_name, *hashes), |namespace, name| unsafe {
        sys::wrapyfi_service_type(namespace, name, own, request, response)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_split_at_the_type() {
        let [namespace, name] = split("sensor_msgs/msg/Image").unwrap();
        assert_eq!(namespace.to_str(), Ok("sensor_msgs::msg"));
        assert_eq!(name.to_str(), Ok("Image"));
        for wrong in ["", "Image", "msg/Image", "a/b/C\0"] {
            assert!(split(wrong).is_err(), "{wrong:?}");
        }
    }

    #[test]
    fn a_type_has_one_support() {
        let first = message("a/msg/B", Some(&[1; 32])).unwrap();
        assert_eq!(first.0, message("a/msg/B", Some(&[1; 32])).unwrap().0);
        assert_ne!(first.0, message("a/msg/B", None).unwrap().0);
    }

    /// Fast CDR throws where its buffer has no room: the exception ends in the type support.
    #[test]
    fn an_exception_of_fast_cdr_is_a_refusal() {
        let data = [7; 64];
        let body =
            sys::wrapyfi_body { data: data.as_ptr(), length: data.len(), ..Default::default() };
        let mut buffer = [0; 64];
        for (capacity, fits) in [(64, true), (63, false), (0, false)] {
            buffer.fill(0);
            // SAFETY: `body` points to `data`, and the buffer has at least `capacity` bytes.
            let wrote = unsafe { sys::wrapyfi_body_write(&body, buffer.as_mut_ptr(), capacity) };
            assert_eq!(wrote, fits, "{capacity}");
            assert!(!fits || buffer == data);
        }
    }
}
