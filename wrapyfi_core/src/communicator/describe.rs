//! Descriptions of a type's registered methods, which `#[communicator]` writes as constants.

use super::error::ActivateError;
use wrapyfi_data::{did_you_mean, types::DataType};
use wrapyfi_endpoint::method::Literal;
use wrapyfi_interfaces::GeneratedType;

/// A type with registered methods.
///
/// See [`Method`].
#[derive(Debug)]
pub struct Class {
    /// Bare name of the type, as configurations write it.
    pub name: &'static str,
    /// Registered methods, in the order of their definition.
    pub methods: &'static [MethodSpec],
}

/// A registered method.
///
/// See [`Method`].
#[derive(Debug)]
pub struct MethodSpec {
    /// Name of the method.
    pub name: &'static str,
    /// Names of the arguments, without `self` and the received one.
    pub arguments: &'static [&'static str],
    /// Registrations, one for each returned value, lists flattened.
    pub registers: &'static [Register],
    /// True for a method with an argument `#[received]`.
    pub receives: bool,
    /// True for a method registered as an action.
    pub is_action: bool,
    /// True for a method with an argument `#[feedback]`.
    pub has_feedback: bool,
}

/// Arguments of one `#[register]`.
///
/// See [`Method`].
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
    /// ROS type of the returned value, where that is a generated message.
    pub ros_type: Option<GeneratedType>,
}

/// The enum of a type's registered methods; implemented by `#[communicator]`.
///
/// ```
/// use wrapyfi_core::communicator::{Class, Literal, Method, communicator};
///
/// struct Mirror;
/// #[communicator]
/// impl Mirror {
///     #[register(NativeObject, "zeromq", "/msg", should_wait = false)]
///     fn read(&self) -> String { "hello".to_owned() }
/// }
///
/// fn topics(class: &Class) -> impl Iterator<Item = &str> {
///     class.methods.iter().flat_map(|method| method.registers).map(|register| register.topic)
/// }
///
/// assert_eq!((MirrorMethod::Read.name(), MirrorMethod::CLASS.name), ("read", "Mirror"));
/// assert_eq!(topics(MirrorMethod::CLASS).collect::<Vec<_>>(), ["/msg"]);
/// let options = MirrorMethod::CLASS.methods[0].registers[0].options;
/// assert_eq!(options, [("should_wait", Literal::Switch(false))]);
/// ```
pub trait Method: Copy + Send + Sync + 'static {
    /// Description of the type.
    #[doc(hidden)]
    const CLASS: &'static Class;
    /// All methods of the type.
    const ALL: &'static [Self];

    /// Place of the method in [`Class::methods`].
    fn index(self) -> usize;

    /// Name of the method.
    fn name(self) -> &'static str {
        Self::CLASS.methods.get(self.index()).map_or("", |method| method.name)
    }
}

/// Argument of `activate` that names a method: a value of the enum, or its name.
///
/// ```
/// use wrapyfi_core::communicator::{ActivateError, NamesMethod, communicator};
///
/// struct Mirror;
/// #[communicator]
/// impl Mirror {
///     #[register(NativeObject, "zeromq", "/msg", should_wait = false)]
///     fn read(&self) -> String { "hello".to_owned() }
/// }
///
/// fn place(method: impl NamesMethod<MirrorMethod>) -> Result<usize, ActivateError> {
///     method.find()
/// }
///
/// assert_eq!(place("read")?, place(MirrorMethod::Read)?);
/// assert!(place("raed").is_err());
/// # Ok::<(), ActivateError>(())
/// ```
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
