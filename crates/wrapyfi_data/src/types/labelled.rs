//! Labelled values: quantities with units, arrays with names, pictures with a mode.

use super::{Image, Map, Value};

/// A number with its unit: pint's `Quantity`.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::{Quantity, Value};
/// let speed = Quantity { magnitude: 1.5.into(), units: "meter / second".into() };
/// let value = Value::Quantity(Box::new(speed));
/// assert_eq!(value.plugin_key(), Some("PintData"));
/// assert_eq!(value.as_quantity().unwrap().magnitude.as_f64(), Some(1.5));
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Quantity {
    /// An integer or a float.
    pub magnitude: Value,
    /// Unit as pint writes it, for instance `kilogram * meter / second ** 2`.
    pub units: String,
}

/// Data over named dimensions: a variable or coordinate of xarray.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::{Map, Tensor, Variable};
/// let data = Tensor::from_elements(&[2, 1], vec![21.5, 22.0])?.into();
/// let attrs = Map::from([("units", "celsius")]);
/// let temperature = Variable { dims: vec!["time".into(), "room".into()], data, attrs };
/// assert_eq!(temperature.data.as_tensor().unwrap().shape().len(), temperature.dims.len());
/// # Ok::<(), wrapyfi_data::types::ShapeError>(())
/// ```
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
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::{Labelled, LabelledContent, Map, Tensor, Value, Variable};
/// let along_x = |data: Tensor| Variable { dims: vec!["x".into()], data: data.into(), attrs: Map::new() };
/// let heights = along_x(Tensor::from_elements(&[2], vec![0.5, 0.7])?);
/// let places = along_x(Tensor::from_elements(&[2], vec![10_i64, 20])?);
/// let value = Value::Labelled(Box::new(Labelled {
///     name: Some("height".into()),
///     content: LabelledContent::Array(heights),
///     coords: vec![("x".into(), places)],
/// }));
/// assert_eq!(value.as_labelled().unwrap().name.as_deref(), Some("height"));
/// # Ok::<(), wrapyfi_data::types::ShapeError>(())
/// ```
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
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::{LabelledContent, Map, Variable};
/// fn names(content: &LabelledContent) -> Vec<&str> {
///     match content {
///         LabelledContent::Array(_) => Vec::new(),
///         LabelledContent::Dataset { variables, .. } => {
///             variables.iter().map(|(name, _)| name.as_str()).collect()
///         }
///     }
/// }
///
/// let mean = Variable { dims: Vec::new(), data: 21.5.into(), attrs: Map::new() };
/// let variables = vec![("temperature".into(), mean)];
/// let content = LabelledContent::Dataset { dims: Vec::new(), variables, attrs: Map::new() };
/// assert_eq!(names(&content), ["temperature"]);
/// ```
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
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::{Encoding, Image, Picture, RawPixels, Stamp, Value};
/// let white = RawPixels::dense(1, 1, Encoding::Rgb8, vec![255_u8; 3])?;
/// let picture = Picture { image: Image::new(Stamp::default(), white), mode: None };
/// assert_eq!(Value::Picture(Box::new(picture)).plugin_key(), Some("PILImage"));
/// # Ok::<(), wrapyfi_data::types::ShapeError>(())
/// ```
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
