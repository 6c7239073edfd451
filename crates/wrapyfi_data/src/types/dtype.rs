//! Element types of a tensor.

use wrapyfi_interfaces::named;

named! {
    /// Element type of a [`super::Tensor`].
    ///
    /// ```
    /// # mod wrapyfi_core { pub use wrapyfi_data::types; }
    /// use wrapyfi_core::types::Dtype;
    /// let dtype = Dtype::from_name("float32").unwrap();
    /// assert_eq!((dtype, dtype.size(), dtype.npy_descr()), (Dtype::F32, 4, Some("<f4")));
    /// ```
    #[non_exhaustive]
    #[allow(missing_docs)] // the names are the documentation
    pub enum Dtype {
        Bool => "bool",
        I8 => "int8",
        I16 => "int16",
        I32 => "int32",
        I64 => "int64",
        U8 => "uint8",
        U16 => "uint16",
        U32 => "uint32",
        U64 => "uint64",
        F16 => "float16",
        BF16 => "bfloat16",
        F32 => "float32",
        F64 => "float64",
        C64 => "complex64",
        C128 => "complex128",
    }
    /// NumPy's name, for instance `float32`; `bfloat16` as the libraries that add it call it.
    pub fn name, from_name;
}

impl Dtype {
    /// Size of one element in bytes.
    pub fn size(self) -> usize {
        match self {
            Self::Bool | Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 | Self::F16 | Self::BF16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 | Self::C64 => 8,
            Self::C128 => 16,
        }
    }

    /// Size in bytes of the scalar that byte order applies to: a complex number is two floats.
    pub fn scalar_size(self) -> usize {
        match self {
            Self::C64 | Self::C128 => self.size() / 2,
            _ => self.size(),
        }
    }

    /// Code in the header of a `.npy` file, little-endian; `None` for `bfloat16`, which NumPy
    /// has no code for.
    pub fn npy_descr(self) -> Option<&'static str> {
        Some(match self {
            Self::Bool => "|b1",
            Self::I8 => "|i1",
            Self::I16 => "<i2",
            Self::I32 => "<i4",
            Self::I64 => "<i8",
            Self::U8 => "|u1",
            Self::U16 => "<u2",
            Self::U32 => "<u4",
            Self::U64 => "<u8",
            Self::F16 => "<f2",
            Self::BF16 => return None,
            Self::F32 => "<f4",
            Self::F64 => "<f8",
            Self::C64 => "<c8",
            Self::C128 => "<c16",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_codes_agree_with_sizes() {
        for dtype in Dtype::ALL {
            assert_eq!(Dtype::from_name(dtype.name()), Some(dtype));
            if let Some(descr) = dtype.npy_descr() {
                assert_eq!(descr[2..].parse::<usize>().unwrap(), dtype.size(), "{dtype}");
            }
        }
        assert_eq!(Dtype::from_name("float128"), None);
    }
}
