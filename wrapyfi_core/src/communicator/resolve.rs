//! Replaces `$` by the arguments of the first call.
//!
//! ```text
//!   Register { "$mware", "/topic", should_wait = "$wait" } + (mware: "zeromq", wait: false)
//!      ──▶ Resolved { zeromq, /topic, should_wait = false }   kept until close
//! ```

use super::describe::{Class, MethodSpec, Register};
use super::error::MethodError;
use wrapyfi_data::types::{DataType, TypedError, Value, to_value};
use wrapyfi_endpoint::Role;
use wrapyfi_endpoint::method::{OptionError, OptionValue, Options};
use wrapyfi_interfaces::GeneratedType;

/// An argument of a call: its place and value.
pub type Given = (usize, Result<Value, TypedError>);

/// Converts an argument into a native object.
///
/// # Errors
/// When its `Serialize` fails.
pub fn argument<T: serde::Serialize + ?Sized>(value: &T) -> Result<Value, TypedError> {
    to_value(value)
}

/// A [`Register`] without `$`.
#[derive(Debug, Clone, PartialEq)]
pub struct Resolved {
    /// Kind of the value.
    pub data_type: DataType,
    /// Name of the middleware; `None` where an argument selects none.
    pub middleware: Option<String>,
    /// Name of the topic.
    pub topic: String,
    /// ROS type of the returned value, where that is a generated message.
    pub ros_type: Option<GeneratedType>,
    /// `None` for messages and functions; for an action, whether its body has feedback.
    pub action: Option<bool>,
    /// Options of both sides.
    pub options: Options,
}

impl Resolved {
    /// Topic and options of an endpoint in a role.
    pub(super) fn end(&self, role: Role) -> Result<(String, Options), OptionError> {
        let (kwargs, topic) = match role.is_provider() {
            true => ("publisher_kwargs", "out_topic"),
            false => ("listener_kwargs", "in_topic"),
        };
        let options = self.options.with_side(kwargs);
        let topic = match options.text(topic)? {
            Some(own) => own.to_owned(),
            None => options.text("topic")?.unwrap_or(&self.topic).to_owned(),
        };
        Ok((topic, options))
    }
}

/// Replaces `$` in the registrations of a method.
pub(super) fn resolve(
    class: &Class,
    index: usize,
    default_middleware: &str,
    given: &[Given],
) -> Result<Vec<Resolved>, MethodError> {
    let Some(spec) = class.methods.get(index) else { return Ok(Vec::new()) };
    let call = FirstCall { method: class.label(index), spec, given };
    spec.registers.iter().map(|register| call.resolve(register, default_middleware)).collect()
}

struct FirstCall<'a> {
    method: String,
    spec: &'a MethodSpec,
    given: &'a [Given],
}

impl FirstCall<'_> {
    fn resolve(&self, register: &Register, default: &str) -> Result<Resolved, MethodError> {
        let middleware = match register.middleware {
            None => Some(default.to_owned()),
            Some(written) => match self.replace(written)? {
                // An argument that names no middleware leaves this value out.
                OptionValue::Nothing => None,
                OptionValue::Text(name) if name.is_empty() || name == "none" => None,
                OptionValue::Text(name) => Some(name),
                other => return Err(self.fault("middleware", &other)),
            },
        };
        let topic = match self.replace(register.topic)? {
            OptionValue::Text(topic) => topic,
            other => return Err(self.fault("topic", &other)),
        };
        let options = Options::from_literals(register.options, &mut |text| self.replace(text))?;
        let Register { data_type, ros_type, .. } = *register;
        let action = self.spec.is_action.then_some(self.spec.has_feedback);
        Ok(Resolved { data_type, middleware, topic, ros_type, action, options })
    }

    fn fault(&self, name: &str, found: &OptionValue) -> MethodError {
        let fault = OptionError::new(name, found, "a text").to_string();
        MethodError::Option { method: self.method.clone(), fault }
    }

    /// Value of the argument that a text names with `$`, or the text itself.
    fn replace(&self, written: &'static str) -> Result<OptionValue, MethodError> {
        let Some(name) = written.strip_prefix('$') else {
            return Ok(OptionValue::Text(written.to_owned()));
        };
        let arguments = self.spec.arguments;
        let place = arguments
            .iter()
            .position(|argument| *argument == name)
            .or_else(|| name.parse().ok().filter(|&place: &usize| place < arguments.len()));
        let found = place.and_then(|place| self.given.iter().find(|(given, _)| *given == place));
        let Some((place, value)) = found else {
            return Err(MethodError::MissingArgument {
                method: self.method.clone(),
                written: written.to_owned(),
                known: arguments.join(", "),
            });
        };
        let unusable = |reason: String| MethodError::Argument {
            method: self.method.clone(),
            argument: arguments.get(*place).copied().unwrap_or_default().to_owned(),
            reason,
        };
        let value = value.as_ref().map_err(|error| unusable(error.to_string()))?;
        OptionValue::from_value(value).ok_or_else(|| {
            unusable(format!(
                "{written:?} stands for it, and a {} is no option: pass a text, a number, a bool or \
                 None",
                value.kind()
            ))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wrapyfi_endpoint::method::Literal;

    const CLASS: Class = Class {
        name: "Mirror",
        methods: &[MethodSpec {
            name: "read",
            arguments: &["mware", "wait"],
            registers: &[Register {
                data_type: DataType::NativeObject,
                middleware: Some("$mware"),
                topic: "/x",
                options: &[
                    ("should_wait", Literal::Text("$1")),
                    ("listener_kwargs", Literal::Map(&[("in_topic", Literal::Text("$0"))])),
                ],
                ros_type: None,
            }],
            receives: false,
            is_action: false,
            has_feedback: false,
        }],
    };

    #[test]
    fn names_and_numbers_are_replaced() {
        let given = [(0, Ok(Value::from("zeromq"))), (1, Ok(Value::from(true)))];
        let resolved = resolve(&CLASS, 0, "memory", &given).unwrap().remove(0);
        assert_eq!(resolved.middleware.as_deref(), Some("zeromq"));
        let (topic, options) = resolved.end(Role::Listener).unwrap();
        assert_eq!((topic.as_str(), options.switch("should_wait")), ("zeromq", Ok(Some(true))));
        assert_eq!(resolved.end(Role::Publisher).unwrap().0, "/x");
    }

    #[test]
    fn an_argument_can_unselect_and_must_be_usable() {
        let given = [(0, Ok(Value::Null)), (1, Ok(Value::Null))];
        let mut resolved = resolve(&CLASS, 0, "memory", &given).unwrap();
        let resolved = resolved.remove(0);
        assert_eq!(resolved.middleware, None);
        assert_eq!(resolved.end(Role::Listener).unwrap().0, "/x");
        let given = [(0, Ok(Value::List(vec![]))), (1, Ok(Value::Null))];
        let error = resolve(&CLASS, 0, "memory", &given).unwrap_err().to_string();
        assert!(error.starts_with("Mirror::read: argument mware cannot be used"), "{error}");
        let error = resolve(&CLASS, 0, "memory", &[]).unwrap_err().to_string();
        assert!(
            error.contains("\"$mware\" names no argument; arguments are mware, wait"),
            "{error}"
        );
    }
}
