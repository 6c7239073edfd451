//! Sequence numbers of received samples, which show what was lost between them.
//!
//! ```text
//!   DATA, DATA_FRAG ─ writerSN ─▶ from_ser ─▶ sample.twrite = -number ─▶ take ─▶ Gaps ─▶ lost
//! ```
//!
//! Cyclone reports a sample as lost only when its reader has no room. What the network dropped, or a
//! writer overwrote before it was sent again, it passes over, and no call tells the sequence numbers.
//! They are in the packet that a sample is made from; the field of a sample in which Cyclone keeps when
//! it was written, in nanoseconds from 0 on, has no use in a received one and takes them as negative
//! numbers.
//!
//! Contract: `Fragment` and `Packet` are as in Cyclone's public header `dds/ddsi/ddsi_radmin.h` of the
//! one version of `cyclors` that Cargo.toml allows.
#![allow(unsafe_code)]

use std::collections::HashMap;
use std::ffi::c_void;

/// Writers whose last number is known.
const MAX_WRITERS: usize = 4096;
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
unsafe fn number(fragments: *const cyclors::ddsi_rdata) -> Option<u64> {
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
    u64::try_from(number).ok().filter(|number| carries && *number > 0)
}

/// Writes the number of the packet's sample into a sample that was made of it.
///
/// # Safety
/// `serdata` is null or a sample that nobody else knows yet, and `fragments` what it was made of.
pub(super) unsafe fn keep(
    serdata: *mut cyclors::ddsi_serdata,
    fragments: *const cyclors::ddsi_rdata,
) {
    // SAFETY: by this function's contract.
    unsafe {
        if let (Some(sample), Some(number)) = (serdata.as_mut(), number(fragments)) {
            sample.twrite.v = i64::try_from(number).map_or(0, |number| -number);
        }
    }
}

/// The number that [`keep`] wrote; `None` for samples of this process, among which none is lost.
pub(super) fn kept(sample: &cyclors::ddsi_serdata) -> Option<u64> {
    // A sample that is neither kept nor written has the least number that there is.
    let number = sample.twrite.v.checked_neg()?;
    u64::try_from(number).ok().filter(|number| *number > 0)
}

/// Numbers that are missing between the samples of each writer.
#[derive(Debug, Default)]
pub(super) struct Gaps {
    newest: HashMap<u64, u64>,
    missing: u64,
}

impl Gaps {
    /// Notes a sample of the writer `writer`. The first one of each begins the count: what was before
    /// it was not for this reader.
    pub(super) fn note(&mut self, writer: u64, number: u64) {
        if self.newest.len() >= MAX_WRITERS && !self.newest.contains_key(&writer) {
            self.newest.clear();
        }
        let newest = self.newest.entry(writer).or_insert(number);
        let missing = number.saturating_sub(*newest).saturating_sub(1);
        self.missing = self.missing.saturating_add(missing);
        *newest = number.max(*newest);
    }

    /// Number of missing samples that were not returned before.
    pub(super) fn take(&mut self) -> u64 {
        std::mem::take(&mut self.missing)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_missing_is_counted_per_writer_and_once() {
        let mut gaps = Gaps::default();
        for (writer, number) in [(1, 7), (2, 100), (1, 8), (1, 12), (2, 101), (1, 12), (1, 11)] {
            gaps.note(writer, number);
        }
        assert_eq!((gaps.take(), gaps.take()), (3, 0));
        gaps.note(1, 14);
        assert_eq!(gaps.take(), 1);
    }

    #[test]
    fn many_writers_take_bounded_room() {
        let mut gaps = Gaps::default();
        for writer in 0..3 * MAX_WRITERS as u64 {
            gaps.note(writer, writer);
        }
        assert!(gaps.newest.len() <= MAX_WRITERS);
        assert_eq!(gaps.take(), 0);
    }
}
