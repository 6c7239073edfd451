//! Command lines and parameter files that are hostile: they end in a result, soon, and
//! never in a panic. Arguments that are well meant come through unchanged.

use std::io;
use std::time::{Duration, Instant};

use proptest::prelude::*;
use wrapyfi_node::args::{MAX_ARGUMENTS, MAX_FILE_BYTES, RosArgs, RosArgsError};
use wrapyfi_node::{NodeName, NodeOptions, ParameterValue};

fn parse(argv: &[String], file: &[u8]) -> Result<RosArgs, RosArgsError> {
    RosArgs::parse(argv, |_| Ok(file.to_vec()))
}

/// Uses all of a parsed command line, so that nothing lazy is left out.
fn use_up(outcome: &Result<RosArgs, RosArgsError>) {
    match outcome {
        Ok(args) => {
            if let Ok(node) = NodeOptions::resolve("talker", "ns", args) {
                for name in ["chatter", "~/private", "/abs", "{node}", ""] {
                    let _topic = args.resolve_topic(&node.name, name);
                    let _service = args.resolve_service(&node.name, name);
                }
            }
        }
        Err(error) => {
            assert!(!error.to_string().is_empty());
        }
    }
}

/// Parameter `a` that a file gives a node called `talker`.
fn parameter_a(content: &str) -> Option<ParameterValue> {
    let argv = ["--ros-args", "--params-file", "f"].map(str::to_owned);
    parse(&argv, content.as_bytes()).unwrap().parameters_for("/talker").remove("a")
}

/// Pieces of rules and flags.
fn fragment() -> impl Strategy<Value = String> {
    prop_oneof![
        4 => prop::sample::select(vec![
            "--ros-args", "--", "-r", "--remap", "-p", "--param", "--params-file", "--log-level",
            "-e", "--enclave", "--log-file-name", "--log-config-file", "--disable-rosout-logs",
            "--enable-stdout-logs", "talker", ":", ":=", "/", "~/", "__node", "__ns", "__name",
            "rostopic://", "rosservice://", "*", "**", ".", "\\1", "a", "_", "1", "[", "]", ",",
            "{", "}", " ", "é", "debug", "\"", "'", "!!str ", "&x ", "*x", "# ", "|", "\n",
        ]).prop_map(str::to_owned),
        1 => ".{0,6}",
    ]
}

fn word() -> impl Strategy<Value = String> {
    prop_oneof![
        fragment(),
        prop::collection::vec(fragment(), 0..6).prop_map(|parts| parts.concat()),
    ]
}

/// Pieces that make YAML more often than chance would.
fn yaml() -> impl Strategy<Value = String> {
    let piece = prop::sample::select(vec![
        "/**",
        "talker",
        "ros__parameters",
        "a",
        "b.c",
        ":",
        ": ",
        "\n",
        "\n  ",
        "\n    ",
        "\n      ",
        "- ",
        "[",
        "]",
        "{",
        "}",
        ", ",
        "? ",
        "&x ",
        "*x",
        "!!str ",
        "!!binary ",
        "!",
        "'",
        "\"",
        "|",
        ">-",
        "~",
        "1",
        "0x1f",
        "1e3",
        ".nan",
        "yes",
        "---\n",
        "...\n",
        "%YAML 1.1\n",
        "# c",
        "\t",
        "\r",
        "\u{0}",
        "\u{feff}",
        "é",
    ]);
    prop_oneof![
        prop::collection::vec(piece.clone(), 0..40).prop_map(|parts| parts.concat()),
        prop::collection::vec(piece, 0..20).prop_map(|parts| {
            format!("talker:\n  ros__parameters:\n    a: {}", parts.concat())
        }),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_argv_ends_in_a_result(argv in prop::collection::vec(word(), 0..12), file in yaml()) {
        use_up(&parse(&argv, file.as_bytes()));
    }

    #[test]
    fn any_block_ends_in_a_result(words in prop::collection::vec(word(), 0..6)) {
        for flag in ["-r", "-p", "--log-level", "-e"] {
            for word in &words {
                use_up(&parse(&["--ros-args".into(), flag.into(), word.clone()], b""));
            }
        }
    }

    #[test]
    fn any_yaml_ends_in_a_result(text in yaml()) {
        use_up(&parse(&["--ros-args", "--params-file", "f"].map(str::to_owned), text.as_bytes()));
    }

    #[test]
    fn any_bytes_end_in_a_result(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        use_up(&parse(&["--ros-args", "--params-file", "f"].map(str::to_owned), &bytes));
    }

    #[test]
    fn what_is_not_ros_passes_through(argv in prop::collection::vec("[^:]{0,8}", 0..8)) {
        prop_assume!(argv.iter().all(|word| word != "--ros-args"));
        let args = parse(&argv, b"").unwrap();
        prop_assert_eq!(args.program_args, argv);
        prop_assert!(args.warnings.is_empty());
    }

    #[test]
    fn integers_come_through(value: i64) {
        prop_assert_eq!(
            parameter_a(&format!("talker: {{ros__parameters: {{a: {value}}}}}")),
            Some(ParameterValue::Integer(value))
        );
    }

    #[test]
    fn doubles_come_through(value in prop::num::f64::NORMAL | prop::num::f64::ZERO) {
        let argv = ["--ros-args".to_owned(), "-p".to_owned(), format!("a:={value:?}")];
        let args = parse(&argv, b"").unwrap();
        prop_assert_eq!(
            args.parameters_for("/x").remove("a"),
            Some(ParameterValue::Double(value))
        );
    }

    #[test]
    fn quoted_texts_come_through(value in "\\PC{0,30}") {
        let quoted = serde_json::to_string(&value).unwrap();
        prop_assert_eq!(
            parameter_a(&format!("/**:\n  ros__parameters:\n    a: {quoted}\n")),
            Some(ParameterValue::String(value))
        );
    }

    #[test]
    fn the_first_rule_and_the_last_parameter_win(values in prop::collection::vec(0_i64..9, 1..6)) {
        let mut argv = vec!["--ros-args".to_owned()];
        for (index, value) in values.iter().enumerate() {
            let node = if value % 2 == 0 { "talker:" } else { "" };
            argv.extend(["-p".into(), format!("{node}a:={value}")]);
            argv.extend(["-r".into(), format!("{node}chatter:=topic{index}")]);
        }
        let args = parse(&argv, b"").unwrap();
        let node = NodeName::new("talker", "/").unwrap();
        prop_assert_eq!(args.resolve_topic(&node, "chatter").unwrap(), "/topic0");
        prop_assert_eq!(
            args.parameters_for("/talker").remove("a"),
            values.last().copied().map(ParameterValue::Integer)
        );
    }
}

#[test]
fn large_files_of_any_shape_end_soon() {
    let fill = |piece: &str| piece.repeat(MAX_FILE_BYTES / piece.len());
    let head = "talker:\n  ros__parameters:\n    a: ";
    for piece in [
        "[", "{", "- ", "? ", "a: ", "&x ", "*x ", "!x ", "!!str ", "\"", "'", "|\n", "# \n", "\n",
        "x", " ", "\t", "---\n", "...\n", "%a b\n", "a: 1\n", "[1], ", "1, ", "\\", "é", "- - a\n",
        "a:\n ",
    ] {
        for text in
            [fill(piece), format!("{head}{}", fill(piece)), format!("{head}[{}", fill(piece))]
        {
            let start = Instant::now();
            use_up(&parse(
                &["--ros-args", "--params-file", "f"].map(str::to_owned),
                text.get(..MAX_FILE_BYTES - 1).unwrap_or(&text).as_bytes(),
            ));
            assert!(start.elapsed() < Duration::from_secs(20), "{piece:?}");
        }
    }
}

#[test]
fn giant_scalars_are_values_like_others() {
    let text = "y".repeat(MAX_FILE_BYTES - 100);
    let found = parameter_a(&format!("talker: {{ros__parameters: {{a: [{text}]}}}}"));
    assert_eq!(found, Some(ParameterValue::StringArray(vec![text])));
}

#[test]
fn aliases_are_refused_before_they_grow() {
    let bomb = "talker:\n  ros__parameters:\n    a: &a [x, x]\n    b: &b [*a, *a]\n";
    let error = parse(&["--ros-args", "--params-file", "f"].map(str::to_owned), bomb.as_bytes());
    let text = error.unwrap_err().to_string();
    assert!(text.ends_with("Error: Will not support aliasing at line 4"), "{text}");
}

#[test]
fn the_number_of_arguments_is_bounded() {
    let endless = std::iter::repeat("word");
    let unread = |_: &str| -> io::Result<Vec<u8>> { Err(io::ErrorKind::NotFound.into()) };
    let error = RosArgs::parse(endless.clone(), unread).unwrap_err();
    assert_eq!(error.to_string(), format!("more than {MAX_ARGUMENTS} arguments"));
    let args = RosArgs::parse(endless.take(MAX_ARGUMENTS), unread).unwrap();
    assert_eq!(args.program_args.len(), MAX_ARGUMENTS);
}

#[test]
fn nodes_cannot_start_with_names_the_graph_lacks() {
    let resolve = |rule: &str| {
        let argv = ["--ros-args", "-r", rule].map(str::to_owned);
        NodeOptions::resolve("talker", "", &parse(&argv, b"").unwrap()).unwrap_err().to_string()
    };
    assert_eq!(resolve("__ns:=/a/"), "namespace must not end with a '/', unless only a '/'");
    let long = resolve(&format!("__node:={}", "a".repeat(256)));
    assert_eq!(long, "node name length should not exceed '255'");
}

#[test]
fn switches_of_every_node_keep_their_type() {
    let resolve = |rule: &str| {
        let argv = ["--ros-args", "-p", rule].map(str::to_owned);
        NodeOptions::resolve("talker", "", &parse(&argv, b"").unwrap())
    };
    let switch = |rule: &str| resolve(rule).unwrap().parameters.remove("use_sim_time");
    assert_eq!(switch("use_sim_time:=yes"), Some(true.into()));
    assert_eq!(switch("use_sim_time:=[]"), Some(ParameterValue::NotSet));
    let error = resolve("start_type_description_service:=[1, 2]").unwrap_err().to_string();
    assert!(error.contains("to '[1, 2]' of type 'INTEGER_ARRAY'"), "{error}");
}
