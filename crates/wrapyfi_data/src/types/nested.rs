//! Arrays as nested lists of numbers, the form that JSON has for them.
//!
//! ```text
//!   [[1, 2], [3, 4]]  ◀─▶  Tensor { int64, shape (2, 2) }
//! ```

use super::element::Element;
use super::{Tensor, Value};

/// Largest number of lists that stand for an array without elements, because that number is only
/// claimed.
const MOST_EMPTY_LISTS: usize = 1 << 16;
/// Largest integer up to which all integers are exact as floats.
const EXACT: u64 = 1 << 53;

/// Converts nested lists of equal length to an array: of `bool`, `int64`, or `float64` where floats
/// are among the numbers or there are none. `None` for other lists, and where an integer would
/// change by becoming a float.
pub fn rectangular(items: &[Value]) -> Option<Tensor> {
    let mut shape = vec![items.len()];
    let mut inside = items.first();
    while let Some(Value::List(inner)) = inside {
        shape.push(inner.len());
        inside = inner.first();
    }
    match inside {
        Some(Value::Bool(_)) => collect(items, &shape, Value::as_bool),
        // Most lists hold integers only; the first float ends the try.
        Some(Value::Int(_)) => {
            collect(items, &shape, Value::as_i64).or_else(|| collect(items, &shape, exact_float))
        }
        Some(Value::Float(_)) | None => collect(items, &shape, exact_float),
        Some(_) => None,
    }
}

/// Converts a number to a float that is equal to it.
pub(super) fn exact_float(value: &Value) -> Option<f64> {
    match value {
        Value::Int(whole) if whole.unsigned_abs() > EXACT => None,
        number => number.as_f64(),
    }
}

fn collect<T: Element>(
    items: &[Value],
    shape: &[usize],
    number: fn(&Value) -> Option<T>,
) -> Option<Tensor> {
    fn append<T>(
        items: &[Value],
        shape: &[usize],
        number: fn(&Value) -> Option<T>,
        out: &mut Vec<T>,
    ) -> Option<()> {
        let (&extent, inner) = shape.split_first()?;
        if items.len() != extent {
            return None;
        }
        for item in items {
            match item {
                Value::List(items) if !inner.is_empty() => append(items, inner, number, out)?,
                item if inner.is_empty() => out.push(number(item)?),
                _ => return None,
            }
        }
        Some(())
    }
    let mut elements = Vec::new();
    append(items, shape, number, &mut elements)?;
    Tensor::from_elements(shape, elements).ok()
}

/// Converts a tensor to nested lists, or to a single number. `None` for complex numbers, and for
/// shapes without elements that ask for more than 65536 lists.
pub fn nested_list(tensor: &Tensor) -> Option<Value> {
    fn all<T: Element>(tensor: &Tensor, number: fn(T) -> Value) -> Option<Vec<Value>> {
        Some(tensor.to_vec()?.into_iter().map(number).collect())
    }
    // The numbers, where the tensor has one of these types.
    macro_rules! one_of {
        ($($number:ty),*) => { None$(.or_else(|| all::<$number>(tensor, Into::into)))* };
    }
    let numbers = one_of!(bool, i8, i16, i32, i64, u8, u16, u32, u64, f32, f64)
        .or_else(|| all::<half::f16>(tensor, |x| x.to_f64().into()))
        .or_else(|| all::<half::bf16>(tensor, |x| x.to_f64().into()))?;
    let lists = tensor.shape().iter().take_while(|&&extent| extent > 0).copied();
    if numbers.is_empty() && lists.fold(1, usize::saturating_mul) > MOST_EMPTY_LISTS {
        return None;
    }
    let mut numbers = numbers.into_iter();
    nest(tensor.shape(), &mut numbers)
}

fn nest(shape: &[usize], numbers: &mut impl Iterator<Item = Value>) -> Option<Value> {
    match shape.split_first() {
        None => numbers.next(),
        Some((&extent, inner)) => {
            (0..extent).map(|_| nest(inner, numbers)).collect::<Option<_>>().map(Value::List)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::types::Dtype;

    fn list(items: impl IntoIterator<Item = Value>) -> Value {
        Value::List(items.into_iter().collect())
    }

    fn tensor(value: &Value) -> Option<Tensor> {
        rectangular(value.as_items().unwrap())
    }

    #[test]
    fn lists_become_the_array_that_numpy_makes_of_them() {
        let matrix = list([list([1.into(), 2.into()]), list([3.into(), 4.into()])]);
        assert_eq!(
            tensor(&matrix).unwrap(),
            Tensor::from_elements(&[2, 2], vec![1_i64, 2, 3, 4]).unwrap()
        );
        let mixed = list([1.into(), 2.5.into()]);
        assert_eq!(tensor(&mixed).unwrap(), Tensor::from_elements(&[2], vec![1.0, 2.5]).unwrap());
        let flags = list([true.into(), false.into()]);
        assert_eq!(tensor(&flags).unwrap().dtype(), Dtype::Bool);
        assert_eq!(tensor(&list([])).unwrap().shape(), [0]);
        assert_eq!(tensor(&list([list([]), list([])])).unwrap().shape(), [2, 0]);
        for value in [matrix, flags, list([list([]), list([])])] {
            assert_eq!(nested_list(&tensor(&value).unwrap()), Some(value));
        }
    }

    #[test]
    fn what_is_no_array_of_numbers_is_none() {
        for items in [
            vec!["a".into()],
            vec![1.into(), true.into()],
            vec![1.into(), Value::Null],
            vec![list([1.into()]), list([1.into(), 2.into()])],
            vec![list([1.into()]), 2.into()],
            vec![1.into(), list([1.into()])],
            vec![list([]), list([1.into()])],
            vec![0.5.into(), ((1_i64 << 53) + 1).into()],
        ] {
            assert_eq!(tensor(&list(items.clone())), None, "{items:?}");
        }
    }

    #[test]
    fn lists_that_are_only_claimed_are_not_made() {
        let empty = Tensor::new(Dtype::F64, [1 << 40, 0], vec![]).unwrap();
        assert_eq!(nested_list(&empty), None);
        let empty = Tensor::new(Dtype::F64, [0, 1 << 40], vec![]).unwrap();
        assert_eq!(nested_list(&empty), Some(list([])));
    }
}
