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

use super::definition::{Container, Element, Field, MessageDefinition, Primitive};
use super::{Dialect, InterfaceKind, ParseError, ParseFault, TypeName, parse_section};

/// Parses the text of a `.srv` file: request, response, event and the service itself.
///
/// ```
/// use wrapyfi_interfaces::parser::{Dialect, TypeName, parse_service};
/// let name = TypeName::parse(Dialect::Ros2, "std_srvs/srv/SetBool").unwrap();
/// let text = "bool data\n---\nbool success\nstring message\n";
/// let messages = parse_service(Dialect::Ros2, &name, text).unwrap();
/// assert_eq!(messages[1].fields[1].name, "message");
/// assert_eq!(messages.len(), 4);
/// ```
///
/// # Errors
/// The first line that cannot be read, and a number of `---` other than one.
pub fn parse_service(
    dialect: Dialect,
    name: &TypeName,
    text: &str,
) -> Result<Vec<MessageDefinition>, ParseError> {
    let parts = "request --- response";
    let [request, response] = sections(name, InterfaceKind::Service, text, parts)?;
    let request = request.parse(dialect, &name.derived("_Request"))?;
    let response = response.parse(dialect, &name.derived("_Response"))?;
    Ok(service_messages(name, request, response))
}

/// Parses the text of an `.action` file: goal, result, feedback, all that the two services and the
/// feedback topic carry, and the action itself.
///
/// # Errors
/// The first line that cannot be read, and a number of `---` other than two.
pub fn parse_action(
    dialect: Dialect,
    name: &TypeName,
    text: &str,
) -> Result<Vec<MessageDefinition>, ParseError> {
    let parts = "goal --- result --- feedback";
    let [goal, result, feedback] = sections(name, InterfaceKind::Action, text, parts)?;
    let goal = goal.parse(dialect, &name.derived("_Goal"))?;
    let result = result.parse(dialect, &name.derived("_Result"))?;
    let feedback = feedback.parse(dialect, &name.derived("_Feedback"))?;
    Ok(action_messages(name, goal, result, feedback))
}

/// Request, response, event and the service itself.
pub(crate) fn service_messages(
    name: &TypeName,
    request: MessageDefinition,
    response: MessageDefinition,
) -> Vec<MessageDefinition> {
    let fixed = Container::Single;
    let optional = Container::Sequence { bound: Some(1) };
    let event = MessageDefinition::new(
        name.derived("_Event"),
        vec![
            Field::new("info", well_known("service_msgs", "ServiceEventInfo"), fixed),
            Field::new("request", Element::Nested(request.name.clone()), optional),
            Field::new("response", Element::Nested(response.name.clone()), optional),
        ],
    );
    let service = MessageDefinition::new(
        name.clone(),
        vec![
            Field::new("request_message", Element::Nested(request.name.clone()), fixed),
            Field::new("response_message", Element::Nested(response.name.clone()), fixed),
            Field::new("event_message", Element::Nested(event.name.clone()), fixed),
        ],
    );
    vec![request, response, event, service]
}

/// Goal, result and feedback, what ROS 2 sends of them, and the action itself.
pub(crate) fn action_messages(
    name: &TypeName,
    goal: MessageDefinition,
    result: MessageDefinition,
    feedback: MessageDefinition,
) -> Vec<MessageDefinition> {
    let message = MessageDefinition::new;
    let single = |name, element| Field::new(name, element, Container::Single);
    let nested =
        |name, message: &MessageDefinition| single(name, Element::Nested(message.name.clone()));
    let goal_id = || single("goal_id", well_known("unique_identifier_msgs", "UUID"));
    let primitive = |name, primitive| single(name, Element::Primitive(primitive));

    let send_goal_name = name.derived("_SendGoal");
    let send_goal = service_messages(
        &send_goal_name,
        message(send_goal_name.derived("_Request"), vec![goal_id(), nested("goal", &goal)]),
        message(
            send_goal_name.derived("_Response"),
            vec![
                primitive("accepted", Primitive::Bool),
                single("stamp", well_known("builtin_interfaces", "Time")),
            ],
        ),
    );
    let get_result_name = name.derived("_GetResult");
    let get_result = service_messages(
        &get_result_name,
        message(get_result_name.derived("_Request"), vec![goal_id()]),
        message(
            get_result_name.derived("_Response"),
            vec![primitive("status", Primitive::Int8), nested("result", &result)],
        ),
    );
    let feedback_message =
        message(name.derived("_FeedbackMessage"), vec![goal_id(), nested("feedback", &feedback)]);
    let action = message(
        name.clone(),
        vec![
            nested("goal", &goal),
            nested("result", &result),
            nested("feedback", &feedback),
            single("send_goal_service", Element::Nested(send_goal_name)),
            single("get_result_service", Element::Nested(get_result_name)),
            nested("feedback_message", &feedback_message),
        ],
    );
    let mut messages = vec![goal, result, feedback, feedback_message, action];
    messages.extend(send_goal);
    messages.extend(get_result);
    messages
}

/// A message that every ROS 2 has. Its name needs no check, since it is one of those above.
fn well_known(package: &str, name: &str) -> Element {
    Element::Nested(TypeName::well_known(package, name))
}

/// Lines between two `---`.
#[derive(Clone, Copy)]
struct Section<'t> {
    text: &'t str,
    /// Lines of the file before it.
    skipped: usize,
}

impl Section<'_> {
    fn parse(self, dialect: Dialect, name: &TypeName) -> Result<MessageDefinition, ParseError> {
        parse_section(dialect, name, self.text, self.skipped)
    }
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
