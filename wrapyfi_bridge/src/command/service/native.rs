//! Arguments of the command line into requests, and functions of Wrapyfi as services on ROS 2.
//!
//! ```text
//!   --args [true] of any other service ─▶ {"data": true}, in the order of its fields
//!
//!   --args [1, 2] --kwargs {"k": 3} ─┬─▶ wrapyfi_msgs: request.json {"args": [1, 2], "kwargs": {"k": 3}}
//!                                    └─▶ wrapyfi_ros2_interfaces: request [[1, 2], {"k": 3}]
//! ```

use serde_json::{Map, Value, json};
use wrapyfi_interfaces::dynamic::DynamicMessage;

use crate::exit::Failure;

/// Form in which a type of service carries the arguments of a function.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Convention {
    /// `wrapyfi_msgs/srv/…`: a native object with `args` and `kwargs`.
    Ours,
    /// `wrapyfi_ros2_interfaces/srv/…`, as Python Wrapyfi calls it: a list of both.
    Upstream,
}

impl Convention {
    /// Convention of a type, where it is a function of Wrapyfi.
    pub(super) fn of(type_name: &str) -> Option<Self> {
        match type_name.split_once("/srv/") {
            // The others are services of a bridge, with fields.
            Some(("wrapyfi_msgs", "NativeObjectService" | "ImageService" | "AudioService")) => {
                Some(Self::Ours)
            }
            Some(("wrapyfi_ros2_interfaces", _)) => Some(Self::Upstream),
            _ => None,
        }
    }

    /// The text that carries these arguments.
    fn text(self, args: &Value, kwargs: &Value) -> String {
        match self {
            Self::Ours => json!({"args": args, "kwargs": kwargs}).to_string(),
            // A tuple, as Wrapyfi's own clients write it.
            Self::Upstream => json!([{"__wrapyfi__": ["tuple", args]}, kwargs]).to_string(),
        }
    }

    /// The field of a request with the text.
    fn field(self) -> &'static str {
        match self {
            Self::Ours => "request.json",
            Self::Upstream => "request",
        }
    }

    /// Fills a request with the arguments of a call.
    pub(super) fn fill(
        self,
        request: &mut DynamicMessage,
        Arguments { args, kwargs }: Arguments,
    ) -> Result<(), Failure> {
        let text = self.text(&Value::Array(args), &Value::Object(kwargs));
        request.set(self.field(), text.as_str()).map_err(Failure::usage)
    }

    /// Fills a reply with what the function returned.
    pub(super) fn fill_reply(
        self,
        reply: &mut DynamicMessage,
        returned: &Value,
    ) -> Result<(), String> {
        let set = match self {
            Self::Ours => {
                reply.set("success", true).map_err(|error| error.to_string())?;
                reply.set("response.json", returned.to_string().as_str())
            }
            Self::Upstream => reply.set("response", returned.to_string().as_str()),
        };
        set.map_err(|error| format!("only native objects can be given as JSON: {error}"))
    }

    /// The reply that returns the argument of a request, or a list of them where there is not one;
    /// why not, where the request cannot be read or the reply carries something else.
    pub(super) fn echo(
        self,
        request: &DynamicMessage,
        reply: &mut DynamicMessage,
    ) -> Result<(), String> {
        let text = request.get(self.field()).and_then(|field| field.as_str()).unwrap_or_default();
        let asked: Value = serde_json::from_str(text)
            .map_err(|error| format!("the request is no JSON: {error}"))?;
        let args = match self {
            Self::Ours => asked.get("args").cloned().unwrap_or(Value::Array(Vec::new())),
            Self::Upstream => asked.get(0).map(list).unwrap_or_default(),
        };
        let returned = match args {
            Value::Array(mut args) if args.len() == 1 => args.pop().unwrap_or_default(),
            args => args,
        };
        self.fill_reply(reply, &returned)?;
        // Arrays of the request are referred to by index.
        if self == Self::Ours
            && let Some(tensors) = request.get("request.tensors").cloned()
        {
            reply.set("response.tensors", tensors).map_err(|error| error.to_string())?;
        }
        Ok(())
    }
}

/// Arguments of a call.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Arguments {
    /// Arguments in order.
    pub(super) args: Vec<Value>,
    /// Arguments with names.
    pub(super) kwargs: Map<String, Value>,
}

impl Arguments {
    /// Reads `--args` and `--kwargs`.
    pub(super) fn read(args: Option<&str>, kwargs: Option<&str>) -> Result<Self, Failure> {
        let args = match json("--args", args.unwrap_or("[]"))? {
            Value::Array(args) => args,
            other => {
                return Err(Failure::Usage(format!("--args is {other}; it must be a JSON list")));
            }
        };
        match json("--kwargs", kwargs.unwrap_or("{}"))? {
            Value::Object(kwargs) => Ok(Self { args, kwargs }),
            other => Err(Failure::Usage(format!("--kwargs is {other}; it must be a JSON object"))),
        }
    }

    /// The fields that they give to a message: in its order, by name, or one object of them all.
    pub(super) fn fields(self, of: &DynamicMessage) -> Result<Value, Failure> {
        let Self { args, kwargs: mut fields } = self;
        if let ([whole @ Value::Object(_)], true) = (args.as_slice(), fields.is_empty()) {
            return Ok(whole.clone());
        }
        let (given, mut names) = (args.len(), of.fields().map(|(name, _)| name));
        for value in args {
            let name = names.next().ok_or_else(|| {
                let (name, count) = (of.type_name(), of.fields().count());
                let text = format!("--args has {given} values, {name} has {count} fields");
                Failure::Usage(text)
            })?;
            if fields.insert(name.to_owned(), value).is_some() {
                let text = format!("{name} is given by --args and by --kwargs");
                return Err(Failure::Usage(text));
            }
        }
        Ok(Value::Object(fields))
    }
}

/// The JSON of an option.
pub(super) fn json(option: &str, text: &str) -> Result<Value, Failure> {
    serde_json::from_str(text).map_err(|error| Failure::Usage(format!("{option}: {error}")))
}

/// True when a value is an object of fields of this message, not something that a message carries.
pub(super) fn is_fields(value: &Value, of: &DynamicMessage) -> bool {
    let known = |name: &String| of.fields().any(|(field, _)| field == name);
    value.as_object().is_some_and(|map| !map.is_empty() && map.keys().all(known))
}

/// A list, or what a tagged tuple holds.
fn list(value: &Value) -> Value {
    let tagged = value.get("__wrapyfi__").filter(|tag| tag.get(0).is_some_and(|t| t == "tuple"));
    tagged.and_then(|tag| tag.get(1)).unwrap_or(value).clone()
}

#[cfg(test)]
mod tests {
    use wrapyfi_interfaces::store::TypeStore;

    use super::*;

    fn pair(name: &str) -> (DynamicMessage, DynamicMessage) {
        let resolved = TypeStore::generated().resolve_name(name).unwrap();
        let part = |suffix| resolved.part(suffix).unwrap().plan().unwrap().default_message();
        (part("_Request"), part("_Response"))
    }

    #[test]
    fn arguments_travel_and_come_back() {
        for (name, request_field, text, reply_field) in [
            (
                "wrapyfi_msgs/srv/NativeObjectService",
                "request.json",
                r#"{"args":[{"a":1}],"kwargs":{"k":2}}"#,
                "response.json",
            ),
            (
                "wrapyfi_ros2_interfaces/srv/ROS2NativeObjectService",
                "request",
                r#"[{"__wrapyfi__":["tuple",[{"a":1}]]},{"k":2}]"#,
                "response",
            ),
        ] {
            let convention = Convention::of(name).unwrap();
            let (mut request, mut reply) = pair(name);
            let arguments = |args, kwargs| Arguments::read(Some(args), kwargs).unwrap();
            let fill = |request: &mut _, asked| convention.fill(request, asked).unwrap();
            fill(&mut request, arguments(r#"[{"a": 1}]"#, Some(r#"{"k": 2}"#)));
            assert_eq!(request.get(request_field).unwrap().as_str(), Some(text));
            convention.echo(&request, &mut reply).unwrap();
            assert_eq!(reply.get(reply_field).unwrap().as_str(), Some(r#"{"a":1}"#));
            fill(&mut request, arguments("[1, 2]", None));
            convention.echo(&request, &mut reply).unwrap();
            assert_eq!(reply.get(reply_field).unwrap().as_str(), Some("[1,2]"));
            convention.fill_reply(&mut reply, &json!({"a": 3})).unwrap();
            assert_eq!(reply.get(reply_field).unwrap().as_str(), Some(r#"{"a":3}"#));
            assert!(
                is_fields(&json!({"request": {}}), &request) && !is_fields(&json!({}), &request)
            );
            assert!(!is_fields(&json!({"request": 1, "a": 2}), &request));
        }
        assert_eq!(Convention::of("std_srvs/srv/SetBool"), None);
    }

    #[test]
    fn arguments_are_fields_in_order_by_name_or_all_in_one() {
        let (set_bool, _) = pair("std_srvs/srv/SetBool");
        let (list, _) = pair("rcl_interfaces/srv/ListParameters");
        let fields = |of: &DynamicMessage, args, kwargs| {
            let arguments = Arguments::read(args, kwargs).unwrap();
            arguments.fields(of).map_err(|failure| failure.to_string())
        };
        let on = json!({"data": true});
        assert_eq!(fields(&set_bool, Some("[true]"), None).unwrap(), on);
        assert_eq!(fields(&set_bool, Some(r#"[{"data": true}]"#), None).unwrap(), on);
        assert_eq!(fields(&set_bool, None, Some(r#"{"data": true}"#)).unwrap(), on);
        assert_eq!(fields(&set_bool, None, None).unwrap(), json!({}));
        let both = fields(&list, Some(r#"[["a"]]"#), Some(r#"{"depth": 1}"#)).unwrap();
        assert_eq!(both, json!({"prefixes": ["a"], "depth": 1}));
        for (args, kwargs, words) in [
            ("[true, 2]", None, "--args has 2 values, std_srvs/srv/SetBool_Request has 1 fields"),
            ("[true]", Some(r#"{"data": true}"#), "data is given by --args and by --kwargs"),
        ] {
            assert_eq!(fields(&set_bool, Some(args), kwargs).unwrap_err(), words);
        }
    }

    #[test]
    fn wrong_arguments_and_requests_are_named() {
        let (mut request, mut reply) = pair("wrapyfi_ros2_interfaces/srv/ROS2NativeObjectService");
        for (args, kwargs, words) in [
            (Some("{}"), None, "--args is {}; it must be a JSON list"),
            (None, Some("[]"), "--kwargs is []; it must be a JSON object"),
            (Some("["), None, "--args: EOF"),
        ] {
            let error = Arguments::read(args, kwargs).unwrap_err();
            assert!(error.to_string().starts_with(words), "{error}");
        }
        request.set("request", "{").unwrap();
        let error = Convention::Upstream.echo(&request, &mut reply).unwrap_err();
        assert!(error.starts_with("the request is no JSON"), "{error}");
        let (_, mut image) = pair("wrapyfi_ros2_interfaces/srv/ROS2ImageService");
        request.set("request", "[[1], {}]").unwrap();
        let error = Convention::Upstream.echo(&request, &mut image).unwrap_err();
        assert!(error.starts_with("only native objects can be given as JSON"), "{error}");
    }
}
