//! What `#[communicator]` tells about a type: its registered methods as constants.

use super::error::ActivateError;
use crate::engine::did_you_mean;
use crate::types::DataType;

/// A type with registered methods.
#[derive(Debug)]
pub struct Class {
    /// Its bare name, as configurations write it.
    pub name: &'static str,
    /// In the order of their definition.
    pub methods: &'static [MethodSpec],
}

/// A registered method.
#[derive(Debug)]
pub struct MethodSpec {
    /// Its name.
    pub name: &'static str,
    /// Names of its arguments, without `self` and the received one.
    pub arguments: &'static [&'static str],
    /// One for each returned value, lists flattened.
    pub registers: &'static [Register],
    /// It has an argument `#[received]`.
    pub receives: bool,
}

/// What one `#[register]` says.
#[derive(Debug)]
pub struct Register {
    /// Kind of the value.
    pub data_type: DataType,
    /// Name of the middleware, or `$argument`; `None` is the default.
    pub middleware: Option<&'static str>,
    /// Name of the topic, or `$argument`.
    pub topic: &'static str,
    /// Options as written.
    pub options: &'static [(&'static str, Literal)],
    /// ROS name of the returned type, where that is a generated message.
    pub ros_type: Option<&'static str>,
}

/// The value of an option as written.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Literal {
    /// `true` or `false`.
    Switch(bool),
    /// A whole number.
    Integer(i64),
    /// Any other number.
    Float(f64),
    /// Text, or `$argument`.
    Text(&'static str),
    /// Options inside an option.
    Map(&'static [(&'static str, Literal)]),
}

/// The enum of a type's registered methods; implemented by `#[communicator]`.
pub trait Method: Copy + Send + Sync + 'static {
    /// The type.
    const CLASS: &'static Class;
    /// Every method.
    const ALL: &'static [Self];

    /// Its place in [`Class::methods`].
    fn index(self) -> usize;

    /// Its name.
    fn name(self) -> &'static str {
        Self::CLASS.methods.get(self.index()).map_or("", |method| method.name)
    }
}

/// What `activate` takes as a method: a value of the enum, or its name.
pub trait NamesMethod<M> {
    /// Place of the method in [`Class::methods`].
    ///
    /// # Errors
    /// When the type has no such method.
    fn find(self) -> Result<usize, ActivateError>;
}

impl<M: Method> NamesMethod<M> for M {
    fn find(self) -> Result<usize, ActivateError> {
        Ok(self.index())
    }
}

impl<M: Method> NamesMethod<M> for &str {
    fn find(self) -> Result<usize, ActivateError> {
        M::CLASS.find(self)
    }
}

impl<M: Method> NamesMethod<M> for &String {
    fn find(self) -> Result<usize, ActivateError> {
        M::CLASS.find(self)
    }
}

impl Class {
    /// Place of the method called `name`.
    pub(super) fn find(&self, name: &str) -> Result<usize, ActivateError> {
        self.methods.iter().position(|method| method.name == name).ok_or_else(|| {
            let known: Vec<_> = self.methods.iter().map(|method| method.name).collect();
            ActivateError::UnknownMethod {
                class: self.name,
                name: name.to_owned(),
                hint: did_you_mean(name, &known),
                known: known.join(", "),
            }
        })
    }

    /// `Class::method`, for messages.
    pub(super) fn label(&self, index: usize) -> String {
        let method = self.methods.get(index).map_or("", |method| method.name);
        format!("{}::{method}", self.name)
    }
}
