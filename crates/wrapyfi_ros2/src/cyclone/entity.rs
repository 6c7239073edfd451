//! Domains, participants and topics: handles that delete themselves.
//!
//! ```text
//!   domain ◀── participant ◀── topic ◀── reader, writer     delete from right to left
//! ```
//!
//! Contract: handles are numbers that Cyclone checks, so a stale one yields an error, never
//! undefined behaviour. Pointers are passed for the time of one call only.
#![allow(unsafe_code)]

use std::ffi::{CStr, CString};
use std::ptr;

use super::qos::QosObject;

/// A negative return code of Cyclone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ReturnCode(i32);

impl ReturnCode {
    /// An argument that C cannot take, such as a NUL inside a name.
    pub(crate) const BAD_PARAMETER: Self = Self(cyclors::DDS_RETCODE_BAD_PARAMETER);

    /// The value of a call, or its error.
    pub(super) fn check(code: i32) -> Result<i32, Self> {
        if code < 0 { Err(Self(code)) } else { Ok(code) }
    }

    /// True when waiting took too long.
    pub(crate) fn is_timeout(self) -> bool {
        self.0 == cyclors::DDS_RETCODE_TIMEOUT
    }

    /// True when what was asked for exists already.
    pub(crate) fn is_precondition(self) -> bool {
        self.0 == cyclors::DDS_RETCODE_PRECONDITION_NOT_MET
    }
}

impl std::fmt::Display for ReturnCode {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        // SAFETY: returns a pointer to a constant string for every code, known or not.
        let text = unsafe { CStr::from_ptr(cyclors::dds_strretcode(self.0)) };
        write!(f, "{} ({})", text.to_string_lossy(), self.0)
    }
}

/// A Cyclone entity that is deleted on drop, its children with it.
#[derive(Debug)]
pub(crate) struct Entity(i32);

impl Entity {
    /// A domain with its configuration sources.
    pub(crate) fn domain(id: u32, sources: &str) -> Result<Self, ReturnCode> {
        super::log::install();
        let sources = CString::new(sources).map_err(|_nul| ReturnCode::BAD_PARAMETER)?;
        // SAFETY: the text is NUL-terminated and read only during the call.
        Self::adopt(unsafe { cyclors::dds_create_domain(id, sources.as_ptr()) })
    }

    /// A participant in a domain that exists.
    pub(crate) fn participant(domain_id: u32, user_data: &str) -> Result<Self, ReturnCode> {
        let qos = QosObject::with_user_data(user_data);
        // SAFETY: the QoS object lives through the call, which copies it; no listener.
        Self::adopt(unsafe {
            cyclors::dds_create_participant(domain_id, qos.as_ptr(), ptr::null())
        })
    }

    /// A topic whose samples are opaque CDR, named as DDS names it.
    pub(crate) fn topic(&self, name: &str, type_name: &str) -> Result<Self, ReturnCode> {
        super::topic::create(self, name, type_name)
    }

    /// Takes ownership of a handle that a create call returned.
    pub(super) fn adopt(code: i32) -> Result<Self, ReturnCode> {
        ReturnCode::check(code).map(Self)
    }

    /// The handle, for calls.
    pub(super) fn handle(&self) -> i32 {
        self.0
    }

    /// GUID: 12 bytes of participant, 4 of entity.
    pub(crate) fn guid(&self) -> Result<[u8; 16], ReturnCode> {
        let mut guid = cyclors::dds_guid_t { v: [0; 16] };
        // SAFETY: writes one guid to the place given.
        ReturnCode::check(unsafe { cyclors::dds_get_guid(self.0, &raw mut guid) })?;
        Ok(guid.v)
    }
}

impl Drop for Entity {
    fn drop(&mut self) {
        let handle = self.0;
        super::events::delete(move || {
            // SAFETY: a number; Cyclone refuses it when the entity went with its parent.
            let code = unsafe { cyclors::dds_delete(handle) };
            if let Err(error) = ReturnCode::check(code) {
                tracing::debug!(handle, %error, "entity was gone before its owner");
            }
        });
    }
}
