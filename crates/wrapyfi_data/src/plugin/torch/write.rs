//! Writes a `torch.save` file, as torch 1.6 and later read it, with `weights_only` and without.

use super::super::PluginError;
use super::super::pickle_text::PickleText;
use super::{FOLDER, NAMED, STORAGES};
use crate::codec::archive::Writer;
use crate::types::Tensor;

/// Bytes of an archive beside the elements.
const FRAME: usize = 2048;

/// The file of a tensor that torch shall load onto `device`.
pub(super) fn file(tensor: &Tensor, device: &str) -> Result<Vec<u8>, PluginError> {
    let data = tensor.data();
    let write = || {
        let mut writer = Writer::with_capacity(data.len().checked_add(FRAME)?);
        for (name, content) in [
            ("data.pkl", &*pickle(tensor, device)?),
            ("byteorder", b"little"),
            ("data/0", &**data),
            ("version", b"3\n"),
        ] {
            writer.add(&format!("{FOLDER}/{name}"), content)?;
        }
        writer.finish()
    };
    write().ok_or_else(|| PluginError::TooLarge {
        what: "the torch file".into(),
        actual: data.len() as u64,
        limit: i32::MAX.unsigned_abs().into(),
    })
}

/// The pickle that puts the tensor together; `None` for extents beyond 63 bits.
fn pickle(tensor: &Tensor, device: &str) -> Option<Vec<u8>> {
    let is = |attribute: &str| {
        tensor
            .origin()
            .and_then(|origin| origin.get(attribute))
            .is_some_and(|value| value == "true")
    };
    let learns = is("requires_grad");
    let named = NAMED.iter().find(|(_, dtype)| *dtype == tensor.dtype()).map(|(name, _)| *name);
    let mut out = PickleText::with_room(2, 0);
    if is("parameter") {
        out.global("torch._utils", "_rebuild_parameter");
    }
    let function = if named.is_some() { "_rebuild_tensor_v3" } else { "_rebuild_tensor_v2" };
    out.global("torch._utils", function);
    out.raw(b"(");
    storage(&mut out, tensor, device)?;
    out.int(0)?;
    out.tuple(tensor.shape().iter().copied())?;
    out.tuple(strides(tensor.shape()).into_iter())?;
    out.bool(learns && !is("parameter"));
    no_hooks(&mut out);
    if let Some(name) = named {
        out.global("torch", name);
    }
    out.raw(b"tR");
    if is("parameter") {
        out.bool(learns);
        no_hooks(&mut out);
        // TUPLE3 makes the arguments, REDUCE the call.
        out.raw(b"\x87R");
    }
    Some(out.finish())
}

/// Elements from one index to the next, row-major. An extent of 0 counts as 1, as with torch; the
/// strides of an empty tensor may be anything, so those that would overflow become 1.
fn strides(shape: &[usize]) -> Vec<usize> {
    let next = |next: &mut usize, &extent: &usize| {
        let stride = *next;
        let larger = stride.checked_mul(extent.max(1)).filter(|&it| i64::try_from(it).is_ok());
        *next = larger.unwrap_or(1);
        Some(stride)
    };
    let mut strides: Vec<usize> = shape.iter().rev().scan(1, next).collect();
    strides.reverse();
    strides
}

/// The storage by its persistent id.
fn storage(out: &mut PickleText, tensor: &Tensor, device: &str) -> Option<()> {
    let dtype = tensor.dtype();
    let typed = STORAGES.iter().find(|(_, known)| *known == dtype).map(|(name, _)| *name);
    out.raw(b"(");
    out.text("storage")?;
    match typed {
        Some(name) => out.global("torch", name),
        None => out.global("torch.storage", "UntypedStorage"),
    }
    out.text("0")?;
    out.text(device)?;
    let itemsize = if typed.is_some() { dtype.size() } else { 1 };
    out.int(tensor.data().len() / itemsize)?;
    out.raw(b"tQ");
    Some(())
}

/// `OrderedDict()`
fn no_hooks(out: &mut PickleText) {
    out.global("collections", "OrderedDict");
    out.raw(b")R");
}
