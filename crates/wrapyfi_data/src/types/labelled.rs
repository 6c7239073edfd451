//! Labelled values: quantities with units, arrays with names, pictures with a mode.

use super::{Image, Map, Value};

/// A number with its unit: pint's `Quantity`.
#[derive(Debug, Clone, PartialEq)]
pub struct Quantity {
    /// An integer or a float.
    pub magnitude: Value,
    /// Unit as pint writes it, for instance `kilogram * meter / second ** 2`.
    pub units: String,
}

/// Data over named dimensions: a variable or coordinate of xarray.
#[derive(Debug, Clone, PartialEq)]
pub struct Variable {
    /// Name of each dimension, in the order of the shape.
    pub dims: Vec<String>,
    /// Data: a [`Value::Tensor`] of numbers, or nested lists.
    pub data: Value,
    /// Attributes.
    pub attrs: Map,
}

/// xarray's `DataArray` or `Dataset`.
#[derive(Debug, Clone, PartialEq)]
pub struct Labelled {
    /// Name of a `DataArray`, where it has one.
    pub name: Option<String>,
    /// Array or arrays.
    pub content: LabelledContent,
    /// Coordinates by name.
    pub coords: Vec<(String, Variable)>,
}

/// Array or arrays of a [`Labelled`].
#[derive(Debug, Clone, PartialEq)]
pub enum LabelledContent {
    /// `DataArray`: one array.
    Array(Variable),
    /// `Dataset`: arrays by name, and attributes of the whole.
    Dataset {
        /// Extent of each dimension by name, as xarray states it.
        dims: Vec<(String, usize)>,
        /// The arrays.
        variables: Vec<(String, Variable)>,
        /// Attributes of the data set.
        attrs: Map,
    },
}

/// A Pillow image.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// Pixels or file of the picture. Stamp and frame are empty.
    pub image: Image,
    /// Pillow's mode where the image's encoding does not tell it, for instance `1`.
    pub mode: Option<String>,
}

impl Labelled {
    /// Size of the content in bytes, about.
    pub(crate) fn size_hint(&self) -> usize {
        let variable = |variable: &Variable| variable.data.size_hint();
        let named = |named: &[(String, Variable)]| {
            named.iter().map(|(name, member)| name.len() + variable(member)).sum::<usize>()
        };
        named(&self.coords)
            + match &self.content {
                LabelledContent::Array(array) => variable(array),
                LabelledContent::Dataset { variables, .. } => named(variables),
            }
    }
}
