//! Values with names to them: quantities, labelled arrays, pictures with a mode.

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
    /// The data: a [`Value::Tensor`] where they are numbers, else nested lists.
    pub data: Value,
    /// Attributes.
    pub attrs: Map,
}

/// xarray's `DataArray` or `Dataset`.
#[derive(Debug, Clone, PartialEq)]
pub struct Labelled {
    /// Name of a `DataArray`, where it has one.
    pub name: Option<String>,
    /// What it holds.
    pub content: LabelledContent,
    /// Coordinates by name.
    pub coords: Vec<(String, Variable)>,
}

/// What a [`Labelled`] holds.
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
    /// Its pixels or its file. Stamp and frame are empty.
    pub image: Image,
    /// Pillow's mode where the image's encoding does not tell it, for instance `1`.
    pub mode: Option<String>,
}

impl Labelled {
    /// About how many bytes of content it holds.
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
