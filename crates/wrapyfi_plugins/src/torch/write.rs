//! Writes a `torch.save` file, as torch 1.6 and later read it, with `weights_only` and without.

use super::super::PluginError;
use super::{FOLDER, NAMED, STORAGES};
use crate::{archive, pickle};
use wrapyfi_data::types::Tensor;

/// Bytes of an archive beside the elements.
const FRAME: usize = 2048;

/// The file of a tensor that torch shall load onto `device`.
pub(super) fn file(tensor: &Tensor, device: &str) -> Result<Vec<u8>, PluginError> {
    let data = tensor.data();
    let write = || {
        let mut writer = archive::Writer::with_capacity(data.len().checked_add(FRAME)?);
        // Extents have 63 bits in a pickle.
        tensor.shape().iter().try_for_each(|&extent| i64::try_from(extent).map(drop).ok())?;
        for (name, content) in [
            ("data.pkl", &*pickle(tensor, device)),
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

/// The pickle that puts the tensor together.
fn pickle(tensor: &Tensor, device: &str) -> Vec<u8> {
    let is = |attribute: &str| {
        tensor
            .origin()
            .and_then(|origin| origin.get(attribute))
            .is_some_and(|value| value == "true")
    };
    let learns = is("requires_grad");
    let named = NAMED.iter().find(|(_, dtype)| *dtype == tensor.dtype()).map(|(name, _)| *name);
    let mut to = pickle::Writer::of_protocol(2);
    if is("parameter") {
        to.global("torch._utils", "_rebuild_parameter").mark();
    }
    let function = if named.is_some() { "_rebuild_tensor_v3" } else { "_rebuild_tensor_v2" };
    to.global("torch._utils", function).mark();
    storage(&mut to, tensor, device);
    to.int(0).sizes(tensor.shape()).sizes(&strides(tensor.shape()));
    to.bool(learns && !is("parameter"));
    no_hooks(&mut to);
    if let Some(name) = named {
        to.global("torch", name);
    }
    to.tuple_since_mark().reduce();
    if is("parameter") {
        no_hooks(to.bool(learns));
        to.tuple_since_mark().reduce();
    }
    to.finish().0
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
fn storage(to: &mut pickle::Writer, tensor: &Tensor, device: &str) {
    let dtype = tensor.dtype();
    let typed = STORAGES.iter().find(|(_, known)| *known == dtype).map(|(name, _)| *name);
    to.mark().str("storage");
    match typed {
        Some(name) => to.global("torch", name),
        None => to.global("torch.storage", "UntypedStorage"),
    };
    let itemsize = if typed.is_some() { dtype.size() } else { 1 };
    to.str("0").str(device).size(tensor.data().len() / itemsize).tuple_since_mark().persistent();
}

/// `OrderedDict()`
fn no_hooks(to: &mut pickle::Writer) {
    to.global("collections", "OrderedDict").mark().tuple_since_mark().reduce();
}
