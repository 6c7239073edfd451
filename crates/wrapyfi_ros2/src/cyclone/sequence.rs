//! Sequence numbers of received samples, which show what was lost between them.
//!
//! ```text
//!   DATA, DATA_FRAG ─ writerSN ─▶ from_ser ─▶ sample.twrite = -number ─▶ take ─▶ Gaps ─▶ lost
//! ```
//!
//! Cyclone reports a sample as lost only when its reader has no room. It passes over samples that the
//! network dropped, or a writer overwrote before they were sent again, and no call tells the sequence
//! numbers. They are in the packet that a sample is made from; the field of a sample in which Cyclone
//! keeps when it was written, in nanoseconds from 0 on, has no use in a received one and takes them as
//! negative numbers.
//!
//! Contract: `Fragment` and `Packet` are as in Cyclone's public header `dds/ddsi/ddsi_radmin.h` of the
//! one version of `cyclors` that Cargo.toml allows.
#![allow(unsafe_code)]

use std::ffi::c_void;

/// Kinds of submessage that carry a sample.
const DATA: u8 = 0x15;
const DATA_FRAG: u8 = 0x16;

/// `struct ddsi_rdata` as far as it is read.
#[repr(C)]
struct Fragment {
    packet: *const Packet,
    _next: *const c_void,
    _min: u32,
    _maxp1: u32,
    /// Offset of the submessage in the packet, in bytes.
    submessage: u16,
}

/// `struct ddsi_rmsg`, behind which the bytes of the packet are.
#[repr(C)]
struct Packet {
    _references: u32,
    _last_chunk: *const c_void,
    _trace: bool,
    _chunk_buffer: *const c_void,
    _chunk_next: *const c_void,
    _chunk_size: i64,
}

/// Beginning of DATA and DATA_FRAG, in the byte order of this machine once Cyclone has read it.
#[repr(C)]
struct Submessage {
    kind: u8,
    _flags: u8,
    _octets_to_next: u16,
    _extra_flags: u16,
    _octets_to_inline_qos: u16,
    _reader: u32,
    _writer: u32,
    high: i32,
    low: u32,
}

/// The number of the sample that begins with this fragment.
///
/// # Safety
/// `fragments` is null or what Cyclone gives to `from_ser`.
unsafe fn number(fragments: *const cyclors::ddsi_rdata) -> Option<i64> {
    // SAFETY: as Cyclone's own `deliver_user_data` finds the header, by this module's contract.
    let submessage = unsafe {
        let fragment = fragments.cast::<Fragment>().as_ref()?;
        if fragment.packet.is_null() || fragment.submessage == 0 {
            return None;
        }
        let bytes = fragment.packet.add(1).cast::<u8>().add(usize::from(fragment.submessage));
        bytes.cast::<Submessage>().read_unaligned()
    };
    let number = (i64::from(submessage.high) << 32) | i64::from(submessage.low);
    let carries = matches!(submessage.kind, DATA | DATA_FRAG);
    (carries && number > 0).then_some(number)
}

/// Writes the number of the packet's sample into a sample that was made of it.
///
/// # Safety
/// `serdata` is null or a sample that no other thread knows yet, and `fragments` what it was made of.
pub(super) unsafe fn keep(
    serdata: *mut cyclors::ddsi_serdata,
    fragments: *const cyclors::ddsi_rdata,
) {
    // SAFETY: by this function's contract.
    unsafe {
        if let (Some(sample), Some(number)) = (serdata.as_mut(), number(fragments)) {
            sample.twrite.v = -number;
        }
    }
}

/// The number that [`keep`] wrote; `None` for samples of this process, among which none is lost.
pub(super) fn kept(sample: &cyclors::ddsi_serdata) -> Option<i64> {
    // A sample that is neither kept nor written has the least number that there is.
    sample.twrite.v.checked_neg().filter(|number| *number > 0)
}
