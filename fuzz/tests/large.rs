//! The same promises on messages as large as the limit allows, made of what costs most: where a
//! fuzzer, whose inputs are short, would not see a factor or a square.

use std::time::Duration;

use wrapyfi_fuzz::{TARGETS, measure};

/// Size of each input, just below the limit of the targets.
const SIZE: usize = 1_000_000;
/// Most units of each input: a decoder limits how many values it makes, too.
const UNITS: usize = 40_000;
/// Ten times what the slowest of them takes without optimisation, a tenth of what a square takes: of the processor's
/// time, because other tests run beside it.
const TIMEOUT: Duration = Duration::from_secs(4);

/// Time that the processor has given this thread.
fn processor_time() -> Duration {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap();
    Duration::from_nanos(text.split_whitespace().next().unwrap().parse().unwrap())
}

fn run(target: &str, shapes: &[(&str, &str, &str)]) {
    for (start, unit, end) in shapes {
        let data = format!("{start}{}{end}", unit.repeat((SIZE / unit.len()).min(UNITS)));
        check(target, unit, &data);
    }
}

fn check(target: &str, unit: &str, data: &str) {
    let (_, body) = TARGETS.iter().find(|(name, _)| *name == target).unwrap();
    let begun = processor_time();
    let ((), peak) = measure(|| body(data.as_bytes()));
    let (factor, took) = (peak / data.len(), processor_time() - begun);
    eprintln!("{target}: {unit:?} holds {factor} times its size, takes {took:?}");
    assert!(took < TIMEOUT, "{target} takes {took:?} for {} bytes of {unit:?}", data.len());
}

/// Units that all differ.
fn distinct(start: &str, unit: impl Fn(usize) -> String, end: &str) -> String {
    let mut data = start.to_owned();
    data.push_str(&unit(0));
    for n in 1..UNITS {
        let unit = unit(n);
        if data.len() + unit.len() > SIZE {
            break;
        }
        data.push(',');
        data.push_str(&unit);
    }
    data + end
}

#[test]
fn members_and_keys() {
    const SET: &str = "{\"__wrapyfi__\":[\"set\",[";
    let lone = |n: usize| format!("\"\\ud800{n}\"");
    for (start, end) in [("{", "}"), (SET, "]]}")] {
        let colon = if start == "{" { ":0" } else { "" };
        check("json", "text", &distinct(start, |n| format!("\"{n}\"{colon}"), end));
        check("json", "UTF-16", &distinct(start, |n| lone(n) + colon, end));
    }
    check("json", "ints", &distinct(SET, |n| n.to_string(), "]]}"));
    check("json", "floats", &distinct(SET, |n| format!("{n}.5"), "]]}"));
    let tagged = |tag: &str, inner: String| format!("{{\"__wrapyfi__\":[\"{tag}\",[{inner}]]}}");
    let tuple = |inner| tagged("tuple", inner);
    check("json", "tuples", &distinct(SET, |n| tuple(n.to_string()), "]]}"));
    check("json", "lists", &distinct(SET, |n| format!("[{n}]"), "]]}"));
    check("json", "maps", &distinct(SET, |n| format!("{{\"{n}\":0}}"), "]]}"));
    check("json", "lists in tuples", &distinct(SET, |n| tuple(format!("[{n}]")), "]]}"));
    check("json", "foreign", &distinct(SET, |n| tagged("Nobody", n.to_string()), "]]}"));
}

#[test]
fn members_that_differ_from_themselves() {
    run("json", &[("{\"__wrapyfi__\":[\"set\",[", "NaN,", "0]]}")]);
}

#[test]
fn json() {
    run(
        "json",
        &[
            ("[", "0,", "0]"),
            ("[", "[],", "0]"),
            ("[", "[0],", "0]"),
            ("[", "{},", "0]"),
            ("[", "{\"\":0},", "0]"),
            ("[", "\"\",", "0]"),
            ("[", "\"a\",", "0]"),
            ("[", "[[0]],", "0]"),
            ("[", "\"\\ud800\",", "0]"),
            ("[", "12345678901234567890,", "0]"),
            ("\"", "\\n", "\""),
            ("\"", "\\ud800", "\""),
            ("\"", "a", "\""),
            ("{", "\"a\":0,", "\"b\":0}"),
            ("", " ", "0"),
            ("{\"__wrapyfi__\":[\"set\",[", "0,", "0]]}"),
            ("{\"__wrapyfi__\":[\"set\",[", "[],", "0]]}"),
            ("{\"__wrapyfi__\":[\"tuple\",[", "[0],", "0]]}"),
            ("{\"__wrapyfi__\":[\"Nobody\",[", "[0],", "0]]}"),
        ],
    );
}

#[test]
fn pickle() {
    run(
        "pickle",
        &[
            ("0", "]", "."),
            ("0(", "}", "l."),
            ("0](", "N", "e."),
            ("0(", "(", "."),
            ("0(", "]Na", "l."),
            ("0(", "}NNs", "l."),
            ("0(", "I5\n", "t."),
            ("0(", "V\\u1234\n", "t."),
            ("0(", "cbuiltins\nset\n(tR", "l."),
            ("0(", "cnumpy\ndtype\n(tR", "l."),
            ("0]p0\n(", "(g0\nt", "l."),
            ("0]p0\n(", "g0\n(g0\na", "e."),
        ],
    );
}

#[test]
fn texts() {
    run(
        "msg_parser",
        &[
            ("", "#\n", ""),
            ("", "\n", ""),
            ("int32[] a [", "1,", "1]"),
            ("string s \"", "a", "\""),
            ("#", "a", ""),
        ],
    );
    run(
        "config",
        &[
            ("routes: [", "1,", "1]"),
            ("routes: [", "{},", "1]"),
            ("routes: [", "[1],", "1]"),
            ("", "#\n", ""),
            ("", "a: 1\n", ""),
            ("a: \"", "a", "\""),
        ],
    );
    run(
        "ros_args",
        &[
            ("--ros-args\n", "-p\na:=1\n", ""),
            ("--ros-args\n-p\na:=[", "1,", "1]"),
            ("--ros-args\n--params-file\nx\n----\n/**: {ros__parameters: {a: [", "1,", "1]}}"),
            ("--ros-args\n--params-file\nx\n----\n", "a: {b: {c: 1}}\n", ""),
            ("--ros-args\n-r\n", "/*", ":=/a"),
            ("--ros-args\n-r\n", "a", ":=/a"),
            ("", "a\n", ""),
        ],
    );
}

#[test]
fn yarp_texts() {
    run(
        "yarp_text",
        &[
            ("\0", "1 ", ""),
            ("\0", "a,", ""),
            ("\0", "(1) ", ""),
            ("\0", "() ", ""),
            ("\0{", "1 ", "}"),
            ("\0\"", "\\n", "\""),
            ("\0", "(", ""),
            ("\0", ")", " a b"),
        ],
    );
}

#[test]
fn ros1_definitions() {
    let lines = |unit: &dyn Fn(usize) -> String| {
        let mut text = String::new();
        for n in 0..UNITS {
            let unit = unit(n);
            if text.len() + unit.len() > SIZE {
                break;
            }
            text.push_str(&unit);
        }
        text
    };
    let separator = "=".repeat(80);
    for (unit, text) in [
        ("fields", lines(&|n| format!("uint8 a{n}\n"))),
        ("strings", lines(&|n| format!("string a{n}\n"))),
        ("fields that ROS 2 names otherwise", lines(&|n| format!("uint8 A{n}\n"))),
        ("fields that become one", lines(&|n| format!("uint8 a{}b\n", "_".repeat(n % 500 + 1)))),
        ("constants", lines(&|n| format!("string A{n}= a\n"))),
        ("headers", lines(&|n| format!("Header h{n}\n"))),
        (
            "uses of one type",
            lines(&|n| format!("T[] t{n}\n")) + &separator + "\nMSG: fuzz_msgs/T\nint8 x\n",
        ),
        (
            "types",
            lines(&|n| if n < 1000 { format!("T{n} t{n}\n") } else { String::new() })
                + &lines(&|n| {
                    if n < 1000 {
                        format!("{separator}\nMSG: fuzz_msgs/T{n}\nbool x\n")
                    } else {
                        String::new()
                    }
                }),
        ),
        ("comments", lines(&|_| "# a\n".to_owned())),
    ] {
        check("ros1_definition", unit, &text);
    }
}
