//! NumPy arrays as pickles describe them, in the pickle or in buffers beside it.
//!
//! ```text
//!   _reconstruct(ndarray, (0,), b'b'), state (1, shape, dtype, is_fortran, elements)
//!   _frombuffer(elements, dtype, shape, 'C')                                protocol 5
//!   scalar(dtype, elements)
//! ```

use bytes::Bytes;

use super::dtype::ArrayDtype;
use super::error::PickleError;
use super::items::Items;
use super::node::{Node, View};
use super::text;
use wrapyfi_data::codec::npy::{self, NpyArray, Order};
use wrapyfi_data::types::{Dtype, NumpyArray, Tensor, element_count};

/// Names of the functions that make arrays, in every release of NumPy.
const RECONSTRUCT: [&str; 2] =
    ["numpy.core.multiarray._reconstruct", "numpy._core.multiarray._reconstruct"];
const FROM_BUFFER: [&str; 2] =
    ["numpy.core.numeric._frombuffer", "numpy._core.numeric._frombuffer"];
const SCALAR: [&str; 2] = ["numpy.core.multiarray.scalar", "numpy._core.multiarray.scalar"];

/// An array that was pickled.
///
/// ```
/// use wrapyfi_data::Limits;
/// use wrapyfi_plugins::pickle::{self, Allowed, PickledArray};
/// // numpy.core.numeric._frombuffer(bytearray(b"ab"), numpy.dtype("u1"), (2,), "C")
/// let data = b"\x80\x02cnumpy.core.numeric\n_frombuffer\n(c__builtin__\nbytearray\n\
///     Vab\nVlatin1\n\x86Rcnumpy\ndtype\nVu1\n\x85RK\x02\x85VC\ntR.";
/// let pickle = pickle::read(&data.to_vec().into(), &[], &Allowed::NUMPY, &Limits::default())?;
/// let PickledArray::Tensor(tensor) = pickle.root().array()? else { panic!("no numbers") };
/// assert_eq!(tensor.as_slice(), Some(b"ab".as_slice()));
/// # Ok::<(), pickle::PickleError>(())
/// ```
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum PickledArray<'p> {
    /// Plain numbers, row-major and little-endian whatever their order was.
    Tensor(Tensor),
    /// Other elements of a fixed size, row-major, in the byte order that `descr` states.
    Array(NumpyArray),
    /// Python objects.
    Objects {
        /// Extent of each dimension.
        shape: Vec<usize>,
        /// As many as the shape says, row-major.
        items: Items<'p>,
    },
}

type Result<T> = std::result::Result<T, PickleError>;

impl<'p> Node<'p> {
    /// True for a NumPy array, whose content [`Self::array`] may still refuse.
    pub fn is_array(&self) -> bool {
        match self.view() {
            View::Call(call) => {
                let names = RECONSTRUCT.iter().chain(&FROM_BUFFER).chain(&SCALAR);
                names.into_iter().any(|name| call.global().is(name))
            }
            _ => false,
        }
    }

    /// Reads a `numpy.ndarray`, or a NumPy scalar as an array without dimensions. The bytes are
    /// shared with the pickle or the buffer unless elements have to be reordered.
    ///
    /// # Errors
    /// When it is none, or its bytes do not fit its shape.
    pub fn array(&self) -> Result<PickledArray<'p>> {
        if let Ok(call) = self.call_of(&FROM_BUFFER) {
            let args = call.args();
            let (data, dtype, shape) = (args.get(0)?, args.get(1)?, args.get(2)?);
            let order = match args.get(3)?.str()? {
                "C" => Order::RowMajor,
                "F" => Order::ColumnMajor,
                "K" => match args.find(4).and_then(Node::option) {
                    Some(axes) => Order::Permuted(sizes(&axes)?),
                    None => Order::RowMajor,
                },
                _ => return Err(args.get(3)?.unexpected("the order 'C', 'F' or 'K'")),
            };
            // With an order of axes the shape is the one before they were reordered.
            let mut extents = extents(&shape)?;
            if let Order::Permuted(axes) = &order {
                let moved: Option<Vec<usize>> =
                    axes.iter().map(|&axis| extents.get(axis).copied()).collect();
                extents = moved.ok_or_else(|| shape.unexpected("one extent for each axis"))?;
            }
            return self.fixed(&dtype, extents, &order, data.bytes()?);
        }
        if let Ok(call) = self.call_of(&SCALAR) {
            let [dtype, value] = call.args().exact()?;
            return self.fixed(&dtype, Vec::new(), &Order::RowMajor, raw_bytes(&value)?);
        }
        match self.call_of(&RECONSTRUCT) {
            Ok(call) => {
                check_class(&call.arg(0)?)?;
                call.state()?.array_state()
            }
            Err(_) => Err(self.unexpected("a NumPy array")),
        }
    }

    /// Reads the state of a `numpy.ndarray`, where it stands apart from the call that makes the
    /// array, as in JAX.
    ///
    /// # Errors
    /// As [`Self::array`].
    pub fn array_state(&self) -> Result<PickledArray<'p>> {
        let parts = self.tuple()?;
        // Before version 1 the version was not written.
        let first = usize::from(parts.len() == 5);
        if first == 1 && parts.get(0)?.int()? != 1 {
            return Err(parts.get(0)?.unexpected("version 1 of an array's state"));
        }
        let (shape, dtype) = (extents(&parts.get(first)?)?, parts.get(first + 1)?);
        let (fortran, data) = (parts.get(first + 2)?, parts.get(first + 3)?);
        if dtype.dtype()? == ArrayDtype::Object {
            let items = data.list()?;
            if element_count(&shape) != Some(items.len()) {
                return Err(data.unexpected(format!("a list for an array of shape {shape:?}")));
            }
            // Objects are listed row-major, whatever the flag says of the array's memory.
            return Ok(PickledArray::Objects { shape, items });
        }
        let fortran = match fortran.view() {
            View::Bool(value) => value,
            _ => fortran.int()? != 0,
        };
        let order = if fortran { Order::ColumnMajor } else { Order::RowMajor };
        self.fixed(&dtype, shape, &order, raw_bytes(&data)?)
    }

    /// An array of elements that have a size.
    fn fixed(
        &self,
        dtype: &Node<'p>,
        shape: Vec<usize>,
        order: &Order,
        data: Bytes,
    ) -> Result<PickledArray<'p>> {
        let (descr, bfloat16) = match dtype.dtype()? {
            ArrayDtype::Described(descr) => (descr, false),
            // Read as a type of the same size, then given its own.
            ArrayDtype::Bfloat16 => ("'<u2'".to_owned(), true),
            ArrayDtype::Object => return Err(dtype.unexpected("elements with a size")),
        };
        let array = npy::from_parts(&descr, shape, order, data);
        match array.map_err(|reason| self.invalid("NumPy array", reason))? {
            NpyArray::Tensor(tensor) if bfloat16 => {
                Ok(PickledArray::Tensor(bits_of_bfloat16(tensor)))
            }
            NpyArray::Tensor(tensor) => Ok(PickledArray::Tensor(tensor)),
            NpyArray::Array(array) => Ok(PickledArray::Array(array)),
        }
    }
}

/// Takes numbers of 16 bits as the `bfloat16` whose bits they are.
pub(crate) fn bits_of_bfloat16(bits: Tensor) -> Tensor {
    // Both types have elements of two bytes, so the data fit the shape again.
    Tensor::new(Dtype::BF16, bits.shape(), bits.data().clone()).unwrap_or(bits)
}

/// An array, or one of its subclasses that adds nothing.
fn check_class(class: &Node<'_>) -> Result<()> {
    let names = ["numpy.ndarray", "numpy.matrix", "numpy.matrixlib.defmatrix.matrix"];
    if names.iter().any(|name| class.is_global(name)) {
        return Ok(());
    }
    Err(class.unexpected("the name numpy.ndarray"))
}

/// Bytes as they are, or, as Python 2 wrote them, one character each.
fn raw_bytes(node: &Node<'_>) -> Result<Bytes> {
    match node.view() {
        View::Str(latin1) => {
            let bytes = text::to_latin1(latin1).map(Bytes::from);
            bytes.ok_or_else(|| node.unexpected("bytes"))
        }
        _ => node.bytes(),
    }
}

/// Extents of a shape; `_frombuffer` may have one number where there is one dimension.
fn extents(shape: &Node<'_>) -> Result<Vec<usize>> {
    match shape.view() {
        View::Int(_) => Ok(vec![shape.size()?]),
        _ => sizes(shape),
    }
}

fn sizes(list: &Node<'_>) -> Result<Vec<usize>> {
    list.sequence()?.iter().map(|size| size.size()).collect()
}
