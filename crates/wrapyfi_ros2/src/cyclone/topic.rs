//! Topics whose samples are opaque CDR.
//!
//! ```text
//!   cyclors' table of functions ── copied once ──▶ ours: some of them replaced ──▶ every topic
//! ```
//!
//! The table that comes with `cyclors` has no `print`, so that a user who traces with
//! `Verbosity` `finest` would make Cyclone call a null pointer at the first sample; and its
//! `to_ser` copies the whole sample wherever a part is asked for. Both are replaced here,
//! `from_ser`, so that a sample keeps its sequence number (`sequence`), and `to_ser_ref`, for the pauses between fragments
//! (`spacing`). Its `from_psmx`, for shared memory that a
//! user's configuration brings in, leaves the payload's pointer of a raw sample unset, which `free` then gives to C's
//! allocator. Without the function Cyclone takes such a topic over the network.
//!
//! Contract: the tables live for ever; functions in them touch only the sample they are given and
//! never panic.
#![allow(unsafe_code)]

use std::ffi::{CString, c_char, c_void};
use std::ptr;
use std::sync::OnceLock;

use super::entity::{Entity, ReturnCode};
use super::{sequence, spacing};

/// The functions Cyclone calls for our types and samples.
struct Tables {
    sertype: *const cyclors::ddsi_sertype_ops,
    serdata: cyclors::ddsi_serdata_ops,
    from_ser: cyclors::ddsi_serdata_from_ser_t,
    to_ser_ref: cyclors::ddsi_serdata_to_ser_ref_t,
}

// SAFETY: function pointers and a pointer to constant data; nothing is written after creation.
unsafe impl Send for Tables {}
// SAFETY: as above.
unsafe impl Sync for Tables {}

static TABLES: OnceLock<Tables> = OnceLock::new();

/// Creates topic `name` of type `type_name`, both in DDS's spelling.
pub(super) fn create(
    participant: &Entity,
    name: &str,
    type_name: &str,
) -> Result<Entity, ReturnCode> {
    let name = c_string(name)?;
    let type_name = c_string(type_name)?;
    let tables = match TABLES.get() {
        Some(tables) => tables,
        None => {
            let tables = copy_tables(participant)?;
            TABLES.get_or_init(|| tables)
        }
    };
    // SAFETY: zeroed memory from C's allocator, which never returns null; the type's own `free`
    // gives it back there.
    let mut sertype: *mut cyclors::ddsi_sertype =
        unsafe { cyclors::dds_alloc(size_of::<cyclors::ddsi_sertype>()) }.cast();
    // SAFETY: fills the memory; the name is copied, the tables are static.
    unsafe {
        cyclors::ddsi_sertype_init_flags(
            sertype,
            type_name.as_ptr(),
            tables.sertype,
            &raw const tables.serdata,
            cyclors::DDSI_SERTYPE_FLAG_TOPICKIND_NO_KEY,
        );
    }
    let created = sertype;
    // SAFETY: takes over our reference when it succeeds; the name is copied.
    let topic = Entity::adopt(unsafe {
        cyclors::dds_create_topic_sertype(
            participant.handle(),
            name.as_ptr(),
            &raw mut sertype,
            ptr::null(),
            ptr::null(),
            ptr::null(),
        )
    });
    if topic.is_err() {
        // SAFETY: the call failed, the reference is still ours.
        unsafe { cyclors::ddsi_sertype_unref(created) };
    }
    topic
}

/// Looks at a topic that `cyclors` made, for its functions.
fn copy_tables(participant: &Entity) -> Result<Tables, ReturnCode> {
    let name = c_string("wrapyfi_template")?;
    let raw = name.into_raw();
    // SAFETY: NUL-terminated, only read and copied.
    let code = unsafe { cyclors::cdds_create_blob_topic(participant.handle(), raw, raw, true) };
    // SAFETY: came from into_raw; C neither kept nor freed it.
    drop(unsafe { CString::from_raw(raw) });
    let template = Entity::adopt(code)?;
    let mut sertype = ptr::null();
    // SAFETY: writes one pointer, valid while the topic lives, which is until the end of this.
    ReturnCode::check(unsafe {
        cyclors::dds_get_entity_sertype(template.handle(), &raw mut sertype)
    })?;
    // SAFETY: the type is alive; its tables are constants of the library.
    let (sertype, serdata) = unsafe { ((*sertype).ops, *(*sertype).serdata_ops) };
    let replaced = cyclors::ddsi_serdata_ops {
        print: Some(print),
        to_ser: Some(to_ser),
        from_ser: Some(from_ser),
        to_ser_ref: Some(to_ser_ref),
        from_psmx: None,
        ..serdata
    };
    Ok(Tables {
        sertype,
        serdata: replaced,
        from_ser: serdata.from_ser,
        to_ser_ref: serdata.to_ser_ref,
    })
}

/// Makes a sample as the table of `cyclors` does, with its sequence number.
unsafe extern "C" fn from_ser(
    sertype: *const cyclors::ddsi_sertype,
    kind: cyclors::ddsi_serdata_kind,
    fragments: *const cyclors::ddsi_rdata,
    size: usize,
) -> *mut cyclors::ddsi_serdata {
    // Cyclone has this function from the tables, so they are there.
    let Some(make) = TABLES.get().and_then(|tables| tables.from_ser) else {
        return ptr::null_mut();
    };
    // SAFETY: what Cyclone gave is passed on; the sample is new.
    unsafe {
        let serdata = make(sertype, kind, fragments, size);
        sequence::keep(serdata, fragments);
        serdata
    }
}

/// Lends `size` bytes of a sample from `offset` on: a fragment that is about to be sent.
unsafe extern "C" fn to_ser_ref(
    serdata: *const cyclors::ddsi_serdata,
    offset: usize,
    size: usize,
    span: *mut cyclors::ddsrt_iovec_t,
) -> *mut cyclors::ddsi_serdata {
    spacing::before_fragment(offset);
    // Cyclone has this function from the tables, so they are there.
    let Some(lend) = TABLES.get().and_then(|tables| tables.to_ser_ref) else {
        return ptr::null_mut();
    };
    // SAFETY: what Cyclone gave is passed on.
    unsafe { lend(serdata, offset, size, span) }
}

/// A sample in a trace: its size only, because printing may meet samples without content.
unsafe extern "C" fn print(
    _: *const cyclors::ddsi_sertype,
    _: *const cyclors::ddsi_serdata,
    buffer: *mut c_char,
    size: usize,
) -> usize {
    const TEXT: &[u8] = b"(cdr)\0";
    let length = TEXT.len().min(size);
    if buffer.is_null() || length == 0 {
        return 0;
    }
    // SAFETY: `length` bytes fit into both; the last one is made a NUL below.
    unsafe {
        ptr::copy_nonoverlapping(TEXT.as_ptr(), buffer.cast::<u8>(), length);
        buffer.add(length - 1).write(0);
    }
    length - 1
}

/// Copies `size` bytes of a sample from `offset` on.
unsafe extern "C" fn to_ser(
    serdata: *const cyclors::ddsi_serdata,
    offset: usize,
    size: usize,
    buffer: *mut c_void,
) {
    let mut span = cyclors::ddsrt_iovec_t { iov_base: ptr::null_mut(), iov_len: 0 };
    // SAFETY: Cyclone asks for a part that exists, and gives room for it; the loan is returned.
    unsafe {
        let lent = cyclors::ddsi_serdata_to_ser_ref(serdata, offset, size, &raw mut span);
        ptr::copy_nonoverlapping(span.iov_base.cast::<u8>(), buffer.cast::<u8>(), size);
        cyclors::ddsi_serdata_to_ser_unref(lent, &raw const span);
    }
}

fn c_string(text: &str) -> Result<CString, ReturnCode> {
    CString::new(text).map_err(|_nul| ReturnCode::BAD_PARAMETER)
}
