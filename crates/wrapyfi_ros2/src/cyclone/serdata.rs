//! Cyclone's samples: made from pieces with one copy, read as [`Bytes`] without any.
//!
//! ```text
//!   [header][meta][pixels][0-3 × 0] ── from_parts ──▶ serdata ──▶ dds_writecdr
//!   dds_takecdr ──▶ serdata (reference counted) ── into_bytes ──▶ Bytes ── drop ──▶ unref
//! ```
//!
//! Contract: a [`Sample`] owns one reference. The buffer of a sample does not change after it was
//! made, and freeing it touches nothing but the sample itself, so neither thread nor topic,
//! participant and domain need be those that made it.
#![allow(unsafe_code)]

use std::ffi::c_void;
use std::ptr::{self, NonNull};

use bytes::Bytes;

use super::sequence;

/// Bytes that Cyclone may read beyond a sample's end to fill a word of the wire.
const WORD: usize = 4;
/// The C code that joins the pieces counts in an `int`.
const MAX_BYTES: usize = i32::MAX as usize - WORD;

/// One reference to a Cyclone sample.
pub(super) struct Sample(NonNull<cyclors::ddsi_serdata>);

impl Sample {
    /// Takes over a reference that a call returned.
    ///
    /// # Safety
    /// `serdata` is null or a sample whose reference now belongs to the caller.
    pub(super) unsafe fn adopt(serdata: *mut cyclors::ddsi_serdata) -> Option<Self> {
        NonNull::new(serdata).map(Self)
    }

    /// Joins `parts` into a sample of the type of `writer`, padded with zeros to whole words.
    ///
    /// The padding is not for beauty: Cyclone sends whole words and would otherwise read, and
    /// send, up to three bytes that are not ours.
    ///
    /// # Safety
    /// `sertype` is the type of a writer that lives through this call.
    pub(super) unsafe fn from_parts(
        sertype: *const cyclors::ddsi_sertype,
        parts: &[&[u8]],
    ) -> Result<Self, String> {
        let zeros = [0_u8; WORD];
        let bytes: usize = parts.iter().map(|part| part.len()).sum();
        if !(WORD..=MAX_BYTES).contains(&bytes) {
            return Err(format!("a message of {bytes} bytes cannot be sent"));
        }
        let padding = bytes.next_multiple_of(WORD) - bytes;
        let iov: Vec<cyclors::ddsrt_iovec_t> = parts
            .iter()
            .copied()
            .chain(zeros.get(..padding))
            .map(|part| cyclors::ddsrt_iovec_t {
                iov_base: part.as_ptr().cast_mut().cast::<c_void>(),
                iov_len: part.len(),
            })
            .collect();
        // SAFETY: the pieces outlive the call, which only reads them; their lengths add up to the
        // total given.
        let serdata = unsafe {
            cyclors::ddsi_serdata_from_ser_iov(
                sertype,
                cyclors::ddsi_serdata_kind_SDK_DATA,
                iov.len(),
                iov.as_ptr(),
                bytes + padding,
            )
        };
        // SAFETY: a new sample with one reference.
        unsafe { Self::adopt(serdata) }.ok_or_else(|| "no memory for the message".to_owned())
    }

    /// A sample without data, which tells readers that the writer has nothing to say: what real
    /// applications pass over. It is acknowledged as any other.
    ///
    /// # Safety
    /// `sertype` is the type of a writer that lives through this call.
    pub(super) unsafe fn empty(sertype: *const cyclors::ddsi_sertype) -> Option<Self> {
        let header = [0_u8, 1, 0, 0];
        let iov = cyclors::ddsrt_iovec_t {
            iov_base: header.as_ptr().cast_mut().cast::<c_void>(),
            iov_len: header.len(),
        };
        // SAFETY: as in `from_parts`; a type without key has nothing behind the header.
        let serdata = unsafe {
            cyclors::ddsi_serdata_from_ser_iov(
                sertype,
                cyclors::ddsi_serdata_kind_SDK_KEY,
                1,
                &raw const iov,
                header.len(),
            )
        };
        // SAFETY: a new sample with one reference, which no other thread knows yet.
        unsafe {
            let sample = Self::adopt(serdata)?;
            (*serdata).statusinfo = cyclors::DDSI_STATUSINFO_UNREGISTER;
            (*serdata).timestamp.v = cyclors::dds_time();
            Some(sample)
        }
    }

    /// Size in bytes, header included.
    pub(super) fn len(&self) -> usize {
        // SAFETY: the sample is alive; only called for samples with data, whose size is set.
        let size = unsafe { cyclors::ddsi_serdata_size(self.0.as_ptr()) };
        usize::try_from(size).unwrap_or(usize::MAX)
    }

    /// Sequence number of a sample that came from another process.
    pub(super) fn sequence(&self) -> Option<i64> {
        // SAFETY: the sample is alive, and no thread writes it any more.
        sequence::kept(unsafe { self.0.as_ref() })
    }

    /// Gives the reference away, to a call that consumes it.
    pub(super) fn into_raw(self) -> *mut cyclors::ddsi_serdata {
        let raw = self.0.as_ptr();
        std::mem::forget(self);
        raw
    }

    /// The sample's bytes, shared. Only for samples with data.
    pub(super) fn into_bytes(self) -> Bytes {
        let mut span = cyclors::ddsrt_iovec_t { iov_base: ptr::null_mut(), iov_len: 0 };
        // SAFETY: asks for the whole sample; `span` is set, and one more reference taken, which
        // `Lent` gives back. `self` gives back the first one on return.
        let lent = unsafe {
            cyclors::ddsi_serdata_to_ser_ref(self.0.as_ptr(), 0, self.len(), &raw mut span)
        };
        match NonNull::new(lent) {
            Some(serdata) => Bytes::from_owner(Lent { serdata, span }),
            None => Bytes::new(),
        }
    }
}

impl Drop for Sample {
    fn drop(&mut self) {
        // SAFETY: gives back the reference this value owns.
        unsafe { cyclors::ddsi_serdata_unref(self.0.as_ptr()) };
    }
}

/// A sample's buffer on loan.
struct Lent {
    serdata: NonNull<cyclors::ddsi_serdata>,
    span: cyclors::ddsrt_iovec_t,
}

// SAFETY: the reference count is atomic, the buffer is never written after the sample was made,
// and the last unref only frees memory, which any thread may do.
unsafe impl Send for Lent {}
// SAFETY: as above; shared access only reads.
unsafe impl Sync for Lent {}

impl AsRef<[u8]> for Lent {
    fn as_ref(&self) -> &[u8] {
        if self.span.iov_base.is_null() || self.span.iov_len == 0 {
            return &[];
        }
        // SAFETY: the span lies in the sample's buffer, which lives as long as `serdata`.
        unsafe { std::slice::from_raw_parts(self.span.iov_base.cast(), self.span.iov_len) }
    }
}

impl Drop for Lent {
    fn drop(&mut self) {
        // SAFETY: gives back the reference that came with the loan.
        unsafe {
            cyclors::ddsi_serdata_to_ser_unref(self.serdata.as_ptr(), &raw const self.span);
        }
    }
}
