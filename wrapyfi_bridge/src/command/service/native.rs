//! Functions of Wrapyfi as services: arguments into requests, and echoes out of them.
//!
//! ```text
//!   --args [1, 2] --kwargs {"k": 3} ─┬─▶ wrapyfi_msgs: request.json {"args": [1, 2], "kwargs": {"k": 3}}
//!                                    └─▶ wrapyfi_ros2_interfaces: request [[1, 2], {"k": 3}]
//! ```

use serde_json::{Map, Value, json};
use wrapyfi_interfaces::dynamic::DynamicMessage;

use crate::exit::Failure;

/// How a type of service carries the arguments of a function.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Convention {
    /// `wrapyfi_msgs/srv/…`: a native object with `args` and `kwargs`.
    Ours,
    /// `wrapyfi_ros2_interfaces/srv/…`, as Python Wrapyfi calls it: a list of both.
    Upstream,
}

impl Convention {
    /// That of a type, where it is a function of Wrapyfi.
    pub(super) fn of(type_name: &str) -> Option<Self> {
        match type_name.split_once("/srv/") {
            Some(("wrapyfi_msgs", _)) => Some(Self::Ours),
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

    /// Fills a request from the command line.
    pub(super) fn fill(
        self,
        request: &mut DynamicMessage,
        args: Option<&str>,
        kwargs: Option<&str>,
    ) -> Result<(), Failure> {
        let parsed = |option: &str, text: Option<&str>, default: Value| match text {
            None => Ok(default),
            Some(text) => serde_json::from_str::<Value>(text)
                .map_err(|error| Failure::Usage(format!("{option}: {error}"))),
        };
        let args = parsed("--args", args, Value::Array(Vec::new()))?;
        let kwargs = parsed("--kwargs", kwargs, Value::Object(Map::new()))?;
        if !args.is_array() {
            return Err(Failure::Usage(format!("--args is {args}; it must be a JSON list")));
        }
        if !kwargs.is_object() {
            return Err(Failure::Usage(format!("--kwargs is {kwargs}; it must be a JSON object")));
        }
        request.set(self.field(), self.text(&args, &kwargs).as_str()).map_err(Failure::usage)
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
        let set = match self {
            Self::Ours => {
                reply.set("success", true).map_err(|error| error.to_string())?;
                // Arrays of the request are referred to by index.
                if let Some(tensors) = request.get("request.tensors").cloned() {
                    reply.set("response.tensors", tensors).map_err(|error| error.to_string())?;
                }
                reply.set("response.json", returned.to_string().as_str())
            }
            Self::Upstream => reply.set("response", returned.to_string().as_str()),
        };
        set.map_err(|error| format!("only native objects can be echoed: {error}"))
    }
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
            convention.fill(&mut request, Some(r#"[{"a": 1}]"#), Some(r#"{"k": 2}"#)).unwrap();
            assert_eq!(request.get(request_field).unwrap().as_str(), Some(text));
            convention.echo(&request, &mut reply).unwrap();
            assert_eq!(reply.get(reply_field).unwrap().as_str(), Some(r#"{"a":1}"#));
            convention.fill(&mut request, Some("[1, 2]"), None).unwrap();
            convention.echo(&request, &mut reply).unwrap();
            assert_eq!(reply.get(reply_field).unwrap().as_str(), Some("[1,2]"));
        }
        assert_eq!(Convention::of("std_srvs/srv/SetBool"), None);
    }

    #[test]
    fn wrong_arguments_and_requests_are_named() {
        let (mut request, mut reply) = pair("wrapyfi_ros2_interfaces/srv/ROS2NativeObjectService");
        for (args, kwargs, words) in [
            (Some("{}"), None, "--args is {}; it must be a JSON list"),
            (None, Some("[]"), "--kwargs is []; it must be a JSON object"),
            (Some("["), None, "--args: EOF"),
        ] {
            let error = Convention::Upstream.fill(&mut request, args, kwargs).unwrap_err();
            assert!(error.to_string().starts_with(words), "{error}");
        }
        request.set("request", "{").unwrap();
        let error = Convention::Upstream.echo(&request, &mut reply).unwrap_err();
        assert!(error.starts_with("the request is no JSON"), "{error}");
        let (_, mut image) = pair("wrapyfi_ros2_interfaces/srv/ROS2ImageService");
        request.set("request", "[[1], {}]").unwrap();
        let error = Convention::Upstream.echo(&request, &mut image).unwrap_err();
        assert!(error.starts_with("only native objects can be echoed"), "{error}");
    }
}
