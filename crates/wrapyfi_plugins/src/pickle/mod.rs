//! Python's pickles, read as data.
//!
//! ```text
//!   pickle ────▶ machine ─▶ arena of nodes ─▶ Node: walk by what should be there ─▶ arrays, values
//!   buffers ──┘     │
//!                   └ names looked up in the list of the plug-in: one that is not on it ends the
//!                     reading, and the object travels on undecoded
//! ```
//!
//! Reading a pickle imports and calls nothing. An instruction that would call a function becomes a
//! [`PickleCall`], whose meaning the plug-in knows. `docs/reference/wire/pickle.md` has the lists.
//!
//! # What is read
//!
//! Protocols 0 to 5, all opcodes of Python's `pickletools` but those that name code of the sender's process or objects beside the pickle. Bytes behind `STOP`
//! are ignored: Wrapyfi's decoder appends the buffers there.
//!
//! | in the pickle | becomes |
//! | --- | --- |
//! | `None`, bools, ints of any size, floats | the same |
//! | text, also with lone surrogates | `Str`, `Utf16` |
//! | strings of Python 2 | text, one character per byte |
//! | `bytes`, `bytearray` | shared with the message, not copied |
//! | out-of-band buffers | shared with the list that came beside the pickle |
//! | lists, tuples, dicts, sets, frozensets | the same; also where they are made by `list(…)`, `set(…)` and so on |
//! | `_codecs.encode(text, 'latin1')`, `bytes(…)`, `bytearray(…)` | bytes: how older protocols write them |
//! | a function or class applied to arguments, its state, what is set in it | a `Call`: written down, not done |
//! | keyword arguments of a class, what is appended to an object | passed over: no plug-in reads them |
//! | a persistent id | its id, in `Allowed::TORCH` only |
//!
//! The same object used twice is one node; one that holds itself is read, and walked to a limit.
//!
//! The codec itself knows these calls, which every plug-in may have:
//!
//! | call | read by |
//! | --- | --- |
//! | `numpy…_reconstruct` with its state, `_frombuffer` (orders C, F, K), `scalar` | `Node::array`: a tensor, another array with its `descr`, or a list of objects |
//! | `numpy.dtype`, structured, with units of time, `ml_dtypes.bfloat16` | `Node::dtype` |
//! | `slice`, `decimal.Decimal` | the method of that name |
//! | `datetime`, `date`, `time`, `timedelta`, with a `timezone` | the method of that name |
//!
//! Arrays become row-major and, where they are numbers, little-endian. Their bytes are shared where they
//! lie so already.
//!
//! # Limits
//!
//! | what | limit |
//! | --- | --- |
//! | pickle and buffers together | `max_message_mib` |
//! | memory of the objects, without the bytes they share | four times that, and 64 bytes for each byte of the pickle |
//! | an integer written as text | 4300 digits, Python's own limit |
//! | a dtype | 65536 characters as `descr`, 16 levels |
//! | dimensions of an array | 64 |
//!
//! Reading is not recursive: depth costs nothing until it is walked.
//!
//! # What is written
//!
//! Protocol 5, without frames, for `pickle.loads`: Python's own types, names, calls, and arrays whose elements
//! lie beside the pickle, by `_frombuffer`, with the module names of NumPy 1. NumPy 2 reads these, and gives a
//! `DeprecationWarning`, which Python hides unless asked.

mod arena;
mod atoms;
mod build;
mod builtin;
mod call;
mod dtype;
mod error;
mod globals;
mod items;
mod machine;
mod names;
mod node;
mod numpy;
mod opcode;
mod scan;
mod text;
mod trail;
mod write;

pub use arena::{NodeId, Pickle};
pub use call::PickleCall;
pub use dtype::ArrayDtype;
pub use error::PickleError;
pub use globals::{Allowed, Global};
pub use items::{Items, Pairs};
pub use machine::read;
pub use node::{Node, View};
pub use numpy::PickledArray;
pub(crate) use numpy::bits_of_bfloat16;
pub(crate) use write::Writer;

#[cfg(test)]
mod hostile_tests;
#[cfg(test)]
mod tests;
