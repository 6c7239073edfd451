//! An option of XPUB sockets for which the crate `zmq` has no call.
//!
//! Contract of the unsafe code here: `zmq_setsockopt` gets a socket that is open, that no other
//! thread uses during the call, and a pointer to one C `int` with its size. A `&mut zmq::Socket`
//! is open until dropped and excludes every other use; the `int` lives on the stack for the call,
//! and libzmq keeps no pointer to it.

use std::ffi::{c_int, c_void};

/// With `on`, a message for which one of its receivers has no room is refused with `EAGAIN` as a
/// whole; otherwise that receiver misses it, and nobody is told.
pub(super) fn set_xpub_nodrop(socket: &mut zmq::Socket, on: bool) -> zmq::Result<()> {
    let Ok(option) = c_int::try_from(zmq_sys::ZMQ_XPUB_NODROP) else {
        return Err(zmq::Error::EINVAL);
    };
    let value = c_int::from(on);
    let pointer: *const c_void = std::ptr::from_ref(&value).cast();
    // SAFETY: the socket is open and ours alone (see the contract above); `pointer` is valid for
    // the given size, which is that of the `int` it points to.
    let code = unsafe {
        zmq_sys::zmq_setsockopt(socket.as_mut_ptr(), option, pointer, size_of::<c_int>())
    };
    if code == 0 {
        return Ok(());
    }
    // SAFETY: reads this thread's error number, nothing else.
    Err(zmq::Error::from_raw(unsafe { zmq_sys::zmq_errno() }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_xpub_has_this_option() {
        let context = zmq::Context::new();
        let mut xpub = context.socket(zmq::XPUB).unwrap();
        let mut sub = context.socket(zmq::SUB).unwrap();
        assert_eq!(set_xpub_nodrop(&mut xpub, true), Ok(()));
        assert_eq!(set_xpub_nodrop(&mut xpub, false), Ok(()));
        assert_eq!(set_xpub_nodrop(&mut sub, true), Err(zmq::Error::EINVAL));
    }
}
