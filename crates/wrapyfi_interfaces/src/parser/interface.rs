//! Services and actions, and the messages that ROS 2 derives from them.
//!
//! ```text
//!   SetBool.srv       request --- response
//!     SetBool_Request, SetBool_Response              as written
//!     SetBool_Event    info, request[<=1], response[<=1]
//!     SetBool          request_message, response_message, event_message
//!
//!   Count.action      goal --- result --- feedback
//!     Count_Goal, Count_Result, Count_Feedback       as written
//!     Count_SendGoal   service: goal_id, goal  →  accepted, stamp
//!     Count_GetResult  service: goal_id  →  status, result
//!     Count_FeedbackMessage   goal_id, feedback
//!     Count            goal, result, feedback, the two services, the feedback message
//! ```
//!
//! All of them are [`MessageDefinition`]s, so that whatever works for messages works for them.

use super::definition::{Container, Element, Field, FieldType, MessageDefinition, Primitive};
use super::{Dialect, InterfaceKind, ParseError, ParseFault, TypeName, parse_section};

/// A parsed `.srv` file.
#[derive(Debug, Clone, PartialEq)]
pub struct ServiceDefinition {
    /// Full name of the service.
    pub name: TypeName,
    /// Message that the client sends, `…_Request`.
    pub request: MessageDefinition,
    /// Message that the server answers, `…_Response`.
    pub response: MessageDefinition,
}

/// A parsed `.action` file.
#[derive(Debug, Clone, PartialEq)]
pub struct ActionDefinition {
    /// Full name of the action.
    pub name: TypeName,
    /// Message with the task, `…_Goal`.
    pub goal: MessageDefinition,
    /// Message with the outcome, `…_Result`.
    pub result: MessageDefinition,
    /// Message about the progress, `…_Feedback`.
    pub feedback: MessageDefinition,
}

/// Parses the text of a `.srv` file.
///
/// ```
/// use wrapyfi_interfaces::parser::{Dialect, TypeName, parse_service};
/// let name = TypeName::parse(Dialect::Ros2, "std_srvs/srv/SetBool").unwrap();
/// let text = "bool data\n---\nbool success\nstring message\n";
/// let service = parse_service(Dialect::Ros2, &name, text).unwrap();
/// assert_eq!(service.response.fields[1].name, "message");
/// assert_eq!(service.messages().len(), 4);
/// ```
///
/// # Errors
/// The first line that cannot be read, and a number of `---` other than one.
pub fn parse_service(
    dialect: Dialect,
    name: &TypeName,
    text: &str,
) -> Result<ServiceDefinition, ParseError> {
    let parts = "request --- response";
    let [request, response] = sections(name, InterfaceKind::Service, text, parts)?;
    let section = |suffix, section: Section<'_>| {
        parse_section(dialect, &name.derived(suffix), section.text, section.skipped)
    };
    Ok(ServiceDefinition {
        name: name.clone(),
        request: section("_Request", request)?,
        response: section("_Response", response)?,
    })
}

/// Parses the text of an `.action` file.
///
/// # Errors
/// The first line that cannot be read, and a number of `---` other than two.
pub fn parse_action(
    dialect: Dialect,
    name: &TypeName,
    text: &str,
) -> Result<ActionDefinition, ParseError> {
    let parts = "goal --- result --- feedback";
    let [goal, result, feedback] = sections(name, InterfaceKind::Action, text, parts)?;
    let section = |suffix, section: Section<'_>| {
        parse_section(dialect, &name.derived(suffix), section.text, section.skipped)
    };
    Ok(ActionDefinition {
        name: name.clone(),
        goal: section("_Goal", goal)?,
        result: section("_Result", result)?,
        feedback: section("_Feedback", feedback)?,
    })
}

impl ServiceDefinition {
    /// Request, response, event and the service itself.
    #[must_use]
    pub fn messages(self) -> Vec<MessageDefinition> {
        let Self { name, request, response } = self;
        let fixed = Container::Single;
        let optional = Container::Sequence { bound: Some(1) };
        let event = message(
            name.derived("_Event"),
            vec![
                field("info", well_known("service_msgs", "ServiceEventInfo"), fixed),
                field("request", Element::Nested(request.name.clone()), optional),
                field("response", Element::Nested(response.name.clone()), optional),
            ],
        );
        let service = message(
            name,
            vec![
                field("request_message", Element::Nested(request.name.clone()), fixed),
                field("response_message", Element::Nested(response.name.clone()), fixed),
                field("event_message", Element::Nested(event.name.clone()), fixed),
            ],
        );
        vec![request, response, event, service]
    }
}

impl ActionDefinition {
    /// Goal, result, feedback, all that the two services and the feedback topic carry, and the
    /// action itself.
    #[must_use]
    pub fn messages(self) -> Vec<MessageDefinition> {
        let Self { name, goal, result, feedback } = self;
        let single = |name, element| field(name, element, Container::Single);
        let nested =
            |name, message: &MessageDefinition| single(name, Element::Nested(message.name.clone()));
        let goal_id = || single("goal_id", well_known("unique_identifier_msgs", "UUID"));
        let primitive = |name, primitive| single(name, Element::Primitive(primitive));

        let send_goal = name.derived("_SendGoal");
        let send_goal = ServiceDefinition {
            request: message(send_goal.derived("_Request"), vec![goal_id(), nested("goal", &goal)]),
            response: message(
                send_goal.derived("_Response"),
                vec![
                    primitive("accepted", Primitive::Bool),
                    single("stamp", well_known("builtin_interfaces", "Time")),
                ],
            ),
            name: send_goal,
        };
        let get_result = name.derived("_GetResult");
        let get_result = ServiceDefinition {
            request: message(get_result.derived("_Request"), vec![goal_id()]),
            response: message(
                get_result.derived("_Response"),
                vec![primitive("status", Primitive::Int8), nested("result", &result)],
            ),
            name: get_result,
        };
        let feedback_message = message(
            name.derived("_FeedbackMessage"),
            vec![goal_id(), nested("feedback", &feedback)],
        );
        let action = message(
            name,
            vec![
                nested("goal", &goal),
                nested("result", &result),
                nested("feedback", &feedback),
                single("send_goal_service", Element::Nested(send_goal.name.clone())),
                single("get_result_service", Element::Nested(get_result.name.clone())),
                nested("feedback_message", &feedback_message),
            ],
        );
        let mut messages = vec![goal, result, feedback, feedback_message, action];
        messages.extend(send_goal.messages());
        messages.extend(get_result.messages());
        messages
    }
}

fn message(name: TypeName, fields: Vec<Field>) -> MessageDefinition {
    MessageDefinition { name, doc: Vec::new(), fields, constants: Vec::new() }
}

fn field(name: &str, element: Element, container: Container) -> Field {
    let field_type = FieldType { element, container };
    Field { name: name.to_owned(), field_type, default: None, doc: Vec::new() }
}

/// A message that every ROS 2 has. Its name needs no check, since it is one of those above.
fn well_known(package: &str, name: &str) -> Element {
    Element::Nested(TypeName::well_known(package, name))
}

/// Lines between two `---`.
#[derive(Clone, Copy, Default)]
struct Section<'t> {
    text: &'t str,
    /// Lines of the file before it.
    skipped: usize,
}

/// Cuts `text` at its `---` lines into exactly `N` sections.
fn sections<'t, const N: usize>(
    name: &TypeName,
    kind: InterfaceKind,
    text: &'t str,
    parts: &'static str,
) -> Result<[Section<'t>; N], ParseError> {
    let fault = |fault| ParseError {
        interface: name.to_string(),
        line: 1,
        text: text.lines().next().unwrap_or_default().trim().to_owned(),
        fault,
    };
    if name.kind() != kind || name.file_stem() != name.name() {
        let expected = kind.as_str();
        return Err(fault(ParseFault::Kind { name: name.to_string(), expected }));
    }
    let mut sections = Vec::with_capacity(N);
    let mut skipped = 0; // lines before the section
    let mut start = 0; // its first byte
    let mut end = 0; // first byte of the line
    for (index, line) in text.split_inclusive('\n').enumerate() {
        if line.trim_end() == "---" {
            sections.push(Section { text: text.get(start..end).unwrap_or_default(), skipped });
            start = end + line.len();
            skipped = index + 1;
        }
        end += line.len();
    }
    sections.push(Section { text: text.get(start..).unwrap_or_default(), skipped });
    <[Section<'t>; N]>::try_from(sections).map_err(|sections| {
        let separators = sections.len() - 1;
        fault(ParseFault::Sections { separators, expected: N - 1, parts })
    })
}
