//! Finding values by name, stamps in envelopes, lines that go on.

use crate::golden::sent;
use wrapyfi_yarp::bottle::Vocab;
use wrapyfi_yarp::sig::Stamp;
use wrapyfi_yarp::{Bottle, Value, WireLimits};

fn bottle(text: &str) -> Bottle {
    Bottle::from_text(text.as_bytes(), &WireLimits::default()).unwrap()
}

#[test]
fn values_are_found_by_their_key() {
    let found = |text: &str, key: &str| {
        bottle(text).find(key).map(|value| Bottle::from(vec![value.clone()]).to_text())
    };
    assert_eq!(found("(a 1) (k 2) x", "k").unwrap(), "2");
    assert_eq!(found("k 2", "k").unwrap(), "2");
    assert_eq!(found("[set] 5", "set").unwrap(), "5");
    assert_eq!(found("(\"two words\" (1 2))", "two words").unwrap(), "(1 2)");
    assert_eq!(found("3 three", "3").unwrap(), "three");
    assert_eq!(found("a k", "k"), None);
    assert_eq!(found("(k) (k 1)", "k"), None, "the first match decides, as in YARP");
    assert_eq!(found("a 1", "b"), None);
}

#[test]
fn commands_come_as_vocabs_or_strings() {
    for text in ["[list]", "list", "\"list\""] {
        assert!(bottle(text).values[0].is_word("list"), "{text}");
    }
    assert!(!bottle("[setting]").values[0].is_word("set"));
    assert!(bottle("[help]").values[0].is_word("helper"), "four letters count");
    assert!(!bottle("help").values[0].is_word("helper"));
    assert!(!Value::Int32(0x0074_6573).is_word("set"), "a number is no word");
}

#[test]
fn numbers_and_booleans_are_read_from_any_type() {
    let bottle = bottle("5 -3000000000 2.5 true false word");
    let integers: Vec<_> = bottle.values.iter().map(Value::as_i64).collect();
    assert_eq!(integers, [Some(5), Some(-3_000_000_000), None, None, None, None]);
    assert_eq!(bottle.values[0].as_f64(), Some(5.0));
    assert_eq!(bottle.values[2].as_f64(), Some(2.5));
    assert_eq!(bottle.values[3].as_bool(), Some(true));
    assert_eq!(bottle.values[4].as_bool(), Some(false));
    assert_eq!(bottle.values[5].as_bool(), None);
    assert_eq!((Vocab::OK, Vocab::FAIL), (Vocab::new("ok"), Vocab::new("fail")));
    for (word, flag) in [("[ok]", Some(true)), ("[fail]", Some(false)), ("[okay]", None)] {
        assert_eq!(self::bottle(word).values[0].as_bool(), flag, "{word}");
    }
    assert_eq!(bottle.values[5].as_str(), Some("word"));
}

/// The envelopes of `tcp_envelope.json`, read and written.
#[test]
fn tcp_envelope() {
    let stream = sent("tcp_envelope.json", "c2s");
    let text = String::from_utf8_lossy(&stream);
    let envelopes: Vec<&str> =
        text.split("D ").skip(1).map(|rest| rest.split('\0').next().unwrap()).collect();
    assert_eq!(envelopes.len(), 4);
    for (index, envelope) in envelopes.into_iter().enumerate() {
        let stamp = Stamp::from_envelope(envelope.as_bytes()).unwrap();
        assert_eq!(stamp.count, 42 + i32::try_from(index).unwrap());
        assert!((stamp.time_s - 1_700_000_000.5).abs() < 1.0);
        assert_eq!(stamp.to_envelope(), envelope);
    }
}

#[test]
fn envelopes_of_other_kinds_are_no_stamps() {
    for envelope in ["", "42", "a 1", "1 b", "1 2 3", "99999999999 1.0", "(1 2.0)"] {
        assert_eq!(Stamp::from_envelope(envelope.as_bytes()), None, "{envelope}");
    }
    let stamp = Stamp { count: 3, time_s: 1_700_000_001.0 };
    assert_eq!(Stamp::from_envelope(b"3 1700000001.0 frame"), Some(stamp));
    assert_eq!(stamp.to_envelope(), "3 1700000001");
    assert_eq!(Stamp::from_envelope(b"3 1700000001"), Some(stamp));
}

/// YARP quotes `true` and `false` and forgets these: its text is met, not bettered.
#[test]
fn words_that_text_takes_for_something_else() {
    let words = ["null", "inf", "nan", "true"];
    let strings: Bottle = words.into_iter().map(Value::string).collect();
    assert_eq!(strings.to_text(), "null inf nan \"true\"");
    let read = bottle(&strings.to_text());
    assert_eq!(read.values[0], Value::vocab("null"));
    assert_eq!(read.values[1], Value::Float64(f64::INFINITY));
    assert_eq!(read.values[3], Value::string("true"));
}
