//! Reads a `torch.save` file without running it.

use bytes::Bytes;

use super::super::pickled::in_member;
use super::super::{PluginError, Unpacking};
use super::{NAMED, STORAGES};
use crate::Framework;
use crate::archive::{Archive, Member};
use crate::malformed;
use crate::pickle::{self, Allowed, Node, PickleError};
use wrapyfi_data::codec::npy::gather;
use wrapyfi_data::types::{Dtype, Origin, Tensor, element_count, swap_byte_order};

/// Most dimensions of a tensor: torch's own limit.
const MAX_DIMENSIONS: usize = 64;
/// Longest `byteorder` member.
const WORD: usize = 16;

/// The tensor in `file`, an archive that `torch.save` wrote.
pub(super) fn tensor(file: &Bytes, context: &Unpacking<'_>) -> Result<Tensor, PluginError> {
    if file.first() == Some(&0x80) {
        return Err(PluginError::unsupported(
            "a torch file of before version 1.6, a row of pickles,",
            "save it with torch.save as it is by default",
        ));
    }
    let archive = Archive::open(file).map_err(malformed)?;
    let mut pickles = archive.iter().filter(|(name, _)| name.ends_with("/data.pkl"));
    let (name, member) = pickles
        .next()
        .ok_or_else(|| malformed("the zip archive has no data.pkl: torch did not save it"))?;
    if pickles.next().is_some() {
        return Err(malformed("the zip archive has more than one data.pkl"));
    }
    let folder = name.trim_end_matches("data.pkl");
    let file = TorchFile { archive: &archive, folder, context };
    let data = file.content("data.pkl", member)?;
    let pickle = pickle::read(&data, &[], &Allowed::TORCH, context.limits).map_err(in_pickle)?;
    file.root(pickle.root())
}

/// An error of the pickle in the archive.
fn in_pickle(error: PickleError) -> PluginError {
    in_member("data.pkl: ", error)
}

struct TorchFile<'a> {
    archive: &'a Archive,
    /// `archive/`, or what the file was called when it was saved to a disk.
    folder: &'a str,
    context: &'a Unpacking<'a>,
}

impl TorchFile<'_> {
    /// A member's content, booked before it is inflated.
    fn content(&self, name: &str, member: &Member) -> Result<Bytes, PluginError> {
        self.archive.content(member, &format!("{name} in the zip archive"), self.context)
    }

    fn is_big_endian(&self) -> Result<bool, PluginError> {
        let Some(member) = self.archive.member(&format!("{}byteorder", self.folder)) else {
            return Ok(false);
        };
        if member.size > WORD {
            return Err(malformed(format!(
                "byteorder has {} bytes, the limit is {WORD}",
                member.size
            )));
        }
        match &*self.content("byteorder", member)? {
            b"little" => Ok(false),
            b"big" => Ok(true),
            other => Err(malformed(format!(
                "byteorder is {:?}, neither little nor big",
                String::from_utf8_lossy(other)
            ))),
        }
    }

    fn root(&self, root: Node<'_>) -> Result<Tensor, PluginError> {
        let Ok(parameter) = root.call("torch._utils._rebuild_parameter") else {
            let (tensor, learns) = self.tensor(root)?;
            return Ok(tensor.with_origin(origin(learns, false)));
        };
        let [inner, learns, hooks] = parameter.args().exact().map_err(in_pickle)?;
        no_hooks(hooks)?;
        let (tensor, _) = self.tensor(inner)?;
        Ok(tensor.with_origin(origin(learns.bool().map_err(in_pickle)?, true)))
    }

    /// A tensor, and whether it requires a gradient.
    fn tensor(&self, node: Node<'_>) -> Result<(Tensor, bool), PluginError> {
        let call = node
            .call_of(&["torch._utils._rebuild_tensor_v2", "torch._utils._rebuild_tensor_v3"])
            .map_err(in_pickle)?;
        let args = call.args();
        let get = |index| args.get(index).map_err(in_pickle);
        let (storage, storage_type) = self.storage(get(0)?)?;
        let offset = get(1)?.size().map_err(in_pickle)?;
        let shape = sizes(get(2)?)?;
        let strides = sizes(get(3)?)?;
        let learns = get(4)?.bool().map_err(in_pickle)?;
        no_hooks(get(5)?)?;
        let (dtype, metadata) = if call.global().name == "_rebuild_tensor_v3" {
            (named_type(get(6)?)?, args.find(7))
        } else {
            let wanted = "a tensor over a storage that says its element type";
            let untyped = || in_pickle(call.node().unexpected(wanted));
            (storage_type.ok_or_else(untyped)?, args.find(6))
        };
        if let Some(metadata) = metadata.and_then(Node::option)
            && !metadata.dict().map_err(in_pickle)?.is_empty()
        {
            // A conjugate or negative that torch has not computed yet: the elements are not the values.
            return Err(PluginError::unsupported(
                format!("a tensor with {metadata} of metadata"),
                "send tensor.resolve_conj().resolve_neg()",
            ));
        }
        let view = View { dtype, offset, shape, strides };
        let data = self.elements(&storage, &view)?;
        let tensor = Tensor::new(dtype, view.shape, data).map_err(malformed)?;
        Ok((tensor, learns))
    }

    /// The bytes of a storage, and its element type where it has one.
    fn storage(&self, node: Node<'_>) -> Result<(Bytes, Option<Dtype>), PluginError> {
        let id = node.persistent().and_then(|id| id.tuple()?.exact::<5>()).map_err(in_pickle)?;
        let [kind, class, key, _location, count] = id;
        if kind.str().map_err(in_pickle)? != "storage" {
            return Err(in_pickle(kind.unexpected("the word storage")));
        }
        let class_name = class.global().map_err(in_pickle)?.name;
        let dtype = STORAGES.iter().find(|(name, _)| *name == class_name).map(|(_, dtype)| *dtype);
        if dtype.is_none() && class_name != "UntypedStorage" {
            return Err(in_pickle(class.unexpected("the class of a storage")));
        }
        let key = key.str().map_err(in_pickle)?;
        let name = format!("{}data/{key}", self.folder);
        let member = self.archive.member(&name).ok_or_else(|| {
            malformed(format!(
                "the zip archive has no storage {:?}",
                key.chars().take(40).collect::<String>()
            ))
        })?;
        let itemsize = dtype.map_or(1, Dtype::size);
        let stated = count.size().map_err(in_pickle)?;
        let stated_bytes = stated.checked_mul(itemsize);
        if stated_bytes.is_none_or(|bytes| bytes > member.size) {
            return Err(malformed(format!(
                "storage {key:?} should have {stated} elements of {itemsize} bytes, it has {} bytes",
                member.size
            )));
        }
        let content = self.content(&format!("data/{key}"), member)?;
        Ok((content.slice(..stated_bytes.unwrap_or_default().min(content.len())), dtype))
    }

    /// The elements of a view in row-major order, little-endian: shared where they lie so already.
    fn elements(&self, storage: &Bytes, view: &View) -> Result<Bytes, PluginError> {
        let itemsize = view.dtype.size();
        let bytes = view.check(storage.len() / itemsize).map_err(malformed)?;
        if bytes == 0 {
            return Ok(Bytes::new());
        }
        // From here on nothing overflows: the last element was found inside the storage.
        let start = view.offset * itemsize;
        let swap = view.dtype.scalar_size() > 1 && self.is_big_endian()?;
        let mut elements = if view.is_row_major() {
            let elements = storage.slice(start..start + bytes);
            if !swap {
                return Ok(elements);
            }
            self.context.unpack("elements in another byte order", bytes as u64)?;
            elements.to_vec()
        } else {
            self.context.unpack("elements of a view put in order", bytes as u64)?;
            gather(storage, &view.shape, &view.byte_strides(), itemsize, start)
        };
        if swap {
            swap_byte_order(&mut elements, view.dtype.scalar_size());
        }
        Ok(elements.into())
    }
}

/// The elements of a storage that make a tensor. Numbers count elements.
struct View {
    dtype: Dtype,
    offset: usize,
    shape: Vec<usize>,
    strides: Vec<usize>,
}

impl View {
    /// Checks that every element lies among the first `available`; the bytes all of them take.
    fn check(&self, available: usize) -> Result<usize, String> {
        let Self { dtype, offset, shape, strides } = self;
        if shape.len() != strides.len() {
            return Err(format!("{} sizes, but {} strides", shape.len(), strides.len()));
        }
        let bytes = element_count(shape)
            .and_then(|count| count.checked_mul(dtype.size()))
            .ok_or_else(|| format!("shape {shape:?} is larger than memory can be"))?;
        if bytes == 0 {
            return Ok(0);
        }
        let last = shape.iter().zip(strides).try_fold(*offset, |last, (&extent, &stride)| {
            last.checked_add((extent - 1).checked_mul(stride)?)
        });
        if last.is_none_or(|last| last >= available) {
            return Err(format!(
                "shape {shape:?} with strides {strides:?} from element {offset} on does not lie in a storage of {available} elements"
            ));
        }
        Ok(bytes)
    }

    /// Strides in bytes, for views whose elements lie in their storage. One that is never taken may
    /// be any number.
    fn byte_strides(&self) -> Vec<usize> {
        let taken = |(&extent, &stride)| if extent > 1 { stride * self.dtype.size() } else { 0 };
        self.shape.iter().zip(&self.strides).map(taken).collect()
    }

    /// True when the elements lie one behind the other. Not for empty ones.
    fn is_row_major(&self) -> bool {
        let mut expected = 1;
        self.shape.iter().zip(&self.strides).rev().all(|(&extent, &stride)| {
            let follows = extent == 1 || stride == expected;
            expected *= extent;
            follows
        })
    }
}

fn origin(learns: bool, parameter: bool) -> Origin {
    let flags = [("requires_grad", learns), ("parameter", parameter)];
    let origin = Origin::new(Framework::Torch.key());
    flags
        .into_iter()
        .filter(|(_, set)| *set)
        .fold(origin, |origin, (name, _)| origin.with(name, "true"))
}

/// A size or the strides.
fn sizes(node: Node<'_>) -> Result<Vec<usize>, PluginError> {
    let items = node.tuple().map_err(in_pickle)?;
    if items.len() > MAX_DIMENSIONS {
        let what = format!("data.pkl: number of dimensions at {}", node.path());
        return Err(PluginError::too_large(what, items.len(), MAX_DIMENSIONS));
    }
    items.iter().map(|item| item.size().map_err(in_pickle)).collect()
}

/// The type that an untyped storage is read as.
fn named_type(node: Node<'_>) -> Result<Dtype, PluginError> {
    let name = node.global().map_err(in_pickle)?.name;
    let found = NAMED.iter().find(|(known, _)| *known == name);
    found.map(|(_, dtype)| *dtype).ok_or_else(|| in_pickle(node.unexpected("an element type")))
}

/// Functions that torch would call when it learns. A sender has them seldom, and they are never
/// read.
fn no_hooks(node: Node<'_>) -> Result<(), PluginError> {
    if node.is_none() {
        return Ok(());
    }
    let hooks = node.call("collections.OrderedDict").map_err(in_pickle)?;
    if hooks.pairs().is_empty() && hooks.args().is_empty() {
        return Ok(());
    }
    Err(PluginError::unsupported("a tensor with hooks", "send tensor.detach()"))
}
