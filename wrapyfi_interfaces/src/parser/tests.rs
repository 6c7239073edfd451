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
