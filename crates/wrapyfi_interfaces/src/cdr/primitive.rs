//! Numbers and booleans: one at a time, and in bulk.

use zerocopy::IntoBytes as _;

/// A primitive of fixed size in CDR, aligned to that size.
pub trait CdrPrimitive: Copy {
    /// Size in bytes.
    const SIZE: usize;

    /// Appends `values` in little-endian order.
    fn append(values: &[Self], to: &mut Vec<u8>);

    /// Values of `bytes`, whose length is a multiple of [`CdrPrimitive::SIZE`].
    fn extract(bytes: &[u8], order: ByteOrder) -> impl Iterator<Item = Self>;
}

/// Order of the bytes of a number in a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum ByteOrder {
    Little,
    Big,
}

macro_rules! numbers {
    ($($number:ty),*) => {$(
        impl CdrPrimitive for $number {
            const SIZE: usize = size_of::<$number>();

            fn append(values: &[Self], to: &mut Vec<u8>) {
                if cfg!(target_endian = "little") {
                    return to.extend_from_slice(values.as_bytes());
                }
                values.iter().for_each(|value| to.extend_from_slice(&value.to_le_bytes()));
            }

            fn extract(bytes: &[u8], order: ByteOrder) -> impl Iterator<Item = Self> {
                let (chunks, _) = bytes.as_chunks::<{ size_of::<$number>() }>();
                chunks.iter().map(move |chunk| match order {
                    ByteOrder::Little => <$number>::from_le_bytes(*chunk),
                    ByteOrder::Big => <$number>::from_be_bytes(*chunk),
                })
            }
        }
    )*};
}

numbers!(i8, u8, i16, u16, i32, u32, i64, u64, f32, f64);

impl CdrPrimitive for bool {
    const SIZE: usize = 1;

    fn append(values: &[Self], to: &mut Vec<u8>) {
        to.extend(values.iter().map(|value| u8::from(*value)));
    }

    fn extract(bytes: &[u8], _: ByteOrder) -> impl Iterator<Item = Self> {
        bytes.iter().map(|byte| *byte != 0)
    }
}
