use super::*;

fn parse(text: &str) -> Result<MessageDefinition, ParseError> {
    parse_message(&TypeName::new("demo_msgs", "Thing").unwrap(), text)
}

fn fault(text: &str) -> ParseFault {
    parse(text).unwrap_err().fault
}

#[test]
fn fields_constants_and_comments() {
    let message = parse(
        "# A thing.\n#\n# Second line.\n\n# About low.\nuint8 LOW=0x0F  # trailing\n\
         string<=5[<=3] names [\"a#\", 'b,c'] # with names\n\tInner[2]\tpair\n\
         std_msgs/Header header\nstd_msgs/msg/Header[] more\nstring NOTE=it's # one\n",
    )
    .unwrap();
    assert_eq!(message.doc, ["A thing.", "", "Second line."]);
    let low = &message.constants[0];
    assert_eq!((low.name.as_str(), &low.value), ("LOW", &Literal::Integer(15)));
    assert_eq!(low.doc, ["About low.", "trailing"]);
    assert_eq!(message.constants[1].value, Literal::Text("it's".into()));
    let names = &message.fields[0];
    assert_eq!(
        names.field_type,
        FieldType {
            element: Element::String { bound: Some(5) },
            container: Container::Sequence { bound: Some(3) }
        }
    );
    assert_eq!(
        names.default,
        Some(DefaultValue::Many(vec![Literal::Text("a#".into()), Literal::Text("b,c".into())]))
    );
    assert_eq!(names.doc, ["with names"]);
    let header = TypeName::new("std_msgs", "Header").unwrap();
    let own = TypeName::new("demo_msgs", "Inner").unwrap();
    let types: Vec<_> = message.fields[1..].iter().map(|f| f.field_type.clone()).collect();
    assert_eq!(
        types,
        [
            FieldType { element: Element::Nested(own), container: Container::Array(2) },
            FieldType { element: Element::Nested(header.clone()), container: Container::Single },
            FieldType {
                element: Element::Nested(header),
                container: Container::Sequence { bound: None }
            },
        ]
    );
}

#[test]
fn faults_name_line_text_and_remedy() {
    let error = parse("uint8 a\n\nuint9 b\n").unwrap_err();
    assert_eq!(error.line, 3);
    assert_eq!(
        error.to_string(),
        "demo_msgs/msg/Thing, line 3: \"uint9\" is no type; use a built-in type, `Name` or \
         `package/Name`, names in CamelCase (the line is \"uint9 b\")"
    );
    assert_eq!(fault("uint8"), ParseFault::MissingName);
    assert_eq!(fault("uint8 # x"), ParseFault::MissingName);
    assert!(matches!(fault("uint8 a\nuint8 a"), ParseFault::Duplicate { .. }));
    assert!(matches!(fault("uint8 Abc"), ParseFault::FieldName { .. }));
    assert!(matches!(fault("uint8 a__b"), ParseFault::FieldName { .. }));
    assert!(matches!(fault("uint8 a=1"), ParseFault::ConstantName { .. }));
    assert!(matches!(fault("uint8 A=256"), ParseFault::Value { .. }));
    assert!(matches!(fault("uint8 A="), ParseFault::Value { .. }));
    assert!(matches!(fault("Inner A=1"), ParseFault::ConstantType { .. }));
    assert!(matches!(fault("Inner a 1"), ParseFault::NestedDefault));
    assert!(matches!(fault("uint8[0] a"), ParseFault::Size { .. }));
    assert!(matches!(fault("uint8[<=x] a"), ParseFault::Size { .. }));
    assert!(matches!(fault("uint8[2] a [1]"), ParseFault::DefaultCount { .. }));
    assert!(matches!(fault("string a \"open"), ParseFault::Value { .. }));
    assert!(matches!(fault("Pkg/Name a"), ParseFault::PackageName { .. }));
    assert!(matches!(fault("a/b/c/D a"), ParseFault::TypeName { .. }));
    assert!(matches!(fault("uint8<=3 a"), ParseFault::TypeName { .. }));
}

#[test]
fn services_and_actions_are_sections() {
    let service = TypeName::parse(Dialect::Ros2, "demo_msgs/srv/Ask").unwrap();
    let messages = parse_service(
        Dialect::Ros2,
        &service,
        "# What.\n\nstring what 'all'\n--- \nuint8 GOOD=1\nThing[<=2] things\n",
    )
    .unwrap();
    let [request, response, ..] = messages.as_slice() else { panic!("{messages:?}") };
    assert_eq!(request.doc, ["What."]);
    assert_eq!(request.name.to_string(), "demo_msgs/srv/Ask_Request");
    assert_eq!(response.constants[0].name, "GOOD");
    let own = TypeName::new("demo_msgs", "Thing").unwrap();
    assert_eq!(response.fields[0].field_type.element, Element::Nested(own));
    let names: Vec<_> = messages.iter().map(|m| m.name.to_string()).collect();
    assert_eq!(
        names,
        ["Ask_Request", "Ask_Response", "Ask_Event", "Ask"].map(|n| format!("demo_msgs/srv/{n}"))
    );

    let action = TypeName::parse(Dialect::Ros2, "demo_msgs/action/Do").unwrap();
    let text = "int32 goal\n---\nint32 result\n---\nint32 feedback";
    let messages = parse_action(Dialect::Ros2, &action, text).unwrap();
    assert_eq!(messages.len(), 13);
    for message in &messages {
        assert_eq!(message.name.interface(), action, "{}", message.name);
    }
    let sections = |text| parse_action(Dialect::Ros2, &action, text).unwrap_err().fault;
    let parts = "goal --- result --- feedback";
    assert_eq!(
        sections("int32 a\n---\nint32 b"),
        ParseFault::Sections { separators: 1, expected: 2, parts }
    );
    let late =
        parse_service(Dialect::Ros2, &service, "uint8 a\n\n---\nuint8 b\nuint8 b").unwrap_err();
    assert_eq!(
        late.to_string(),
        "demo_msgs/srv/Ask_Response, line 5: \"b\" is defined twice (the line is \"uint8 b\")"
    );
    let wrong = parse_service(Dialect::Ros2, &action, "---").unwrap_err();
    assert!(matches!(wrong.fault, ParseFault::Kind { expected: "srv", .. }));
}

#[test]
fn default_values_are_written_as_python_does() {
    let python = |text: &str| parse(text).unwrap().fields[0].default.as_ref().unwrap().to_python();
    assert_eq!(
        python("float64[] a [1e16, 1.5e300, 0.00005, 0.0001, -1, .5]"),
        "(1e+16, 1.5e+300, 5e-05, 0.0001, -1.0, 0.5)"
    );
    assert_eq!(python("uint8[] a [7]"), "(7,)");
    assert_eq!(python("uint8[] a []"), "()");
    assert_eq!(python("bool a false"), "False");
    assert_eq!(python("string a \"it's\""), "it's");
    assert_eq!(python(r#"string[] a ["it's", "b\"", "c\\"]"#), r#"("it's", 'b"', 'c\\')"#);
}

#[test]
fn names_say_their_kind_and_file() {
    let parse = |text| TypeName::parse(Dialect::Ros2, text);
    let part = parse("demo_msgs/action/Do_SendGoal_Response").unwrap();
    assert_eq!((part.file_stem(), part.kind()), ("Do", InterfaceKind::Action));
    assert_eq!(part.dds(), "demo_msgs::action::dds_::Do_SendGoal_Response_");
    assert_eq!(parse("std_msgs/String").unwrap().to_string(), "std_msgs/msg/String");
    assert!(parse("demo_msgs/msg/Do_Request").is_err(), "only services have requests");
    assert!(parse("demo_msgs/idl/Do").is_err());
    assert!(parse("tf/tfMessage").is_err());
    assert!(TypeName::parse(Dialect::Ros1, "tf/tfMessage").is_ok());
    assert!(TypeName::parse(Dialect::Ros1, "a/../B").is_err());
}

#[test]
fn the_words_of_ros1_are_read_in_its_dialect_only() {
    let name = TypeName::parse(Dialect::Ros1, "demo/Thing").unwrap();
    let ros1 = |text: &str| parse_section(Dialect::Ros1, &name, text, 0);
    let message = ros1(
        "byte LOW=-1\nstring left= a \"b\" # c \ntime at\nduration[] waits\nHeader header\n\
         float64[9] K # matrix\nbyte level\nchar letter\n",
    )
    .unwrap();
    assert_eq!(message.constants[0].value, Literal::Integer(-1));
    assert_eq!(message.constants[1].value, Literal::Text("a \"b\" # c".into()));
    let types: Vec<_> = message.fields.iter().map(|f| f.field_type.to_string()).collect();
    assert_eq!(
        types,
        [
            "builtin_interfaces/Time",
            "builtin_interfaces/Duration[]",
            "std_msgs/Header",
            "float64[9]",
            "byte",
            "char"
        ]
    );
    for only_ros2 in ["uint8 a 1", "string<=3 a", "uint8[<=3] a", "wstring a"] {
        let error = ros1(only_ros2).unwrap_err();
        assert!(matches!(error.fault, ParseFault::OnlyRos2 { .. }), "{only_ros2}");
    }
    assert!(matches!(fault("byte A=-1"), ParseFault::Value { .. }));
    assert!(matches!(fault("time at"), ParseFault::TypeName { .. }));
    assert!(matches!(fault("float64[9] K"), ParseFault::FieldName { .. }));
}

proptest::proptest! {
    #[test]
    fn any_text_is_read_or_refused(text in "[ -~\\n]{0,80}") {
        if let Err(error) = parse(&text) {
            assert!((1..=text.lines().count()).contains(&error.line));
        }
    }

    #[test]
    fn any_value_is_read_or_refused(text in "(string|uint8|float32|bool\\[\\]) [a-zA-Z]=?.{0,20}") {
        if let Err(error) = parse(&text) {
            assert_eq!(error.line, 1);
        }
    }
}
