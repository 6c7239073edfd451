use std::collections::{BTreeMap, HashMap};

use bytes::Bytes;
use proptest::collection::{btree_map, vec};
use proptest::prelude::*;
use serde::{Deserialize, Serialize};

use super::*;
use crate::Limits;
use crate::codec::json;
use crate::plugin::Plugins;
use crate::types::{DateTime, Map, Tensor};

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
enum Command {
    Stop,
    Turn(f64),
    Move(i32, i32),
    Say { text: String, loud: Option<bool> },
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Newtype(u8);

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Everything {
    byte: u8,
    wide: u128,
    small: f32,
    letter: char,
    pair: (bool, String),
    list: Vec<i64>,
    by_number: BTreeMap<i16, String>,
    commands: Vec<Command>,
    nothing: Option<u8>,
    unit: (),
    newtype: Newtype,
}

fn everything() -> Everything {
    Everything {
        byte: 255,
        wide: u128::MAX,
        small: 0.1,
        letter: 'ß',
        pair: (true, "a".into()),
        list: vec![i64::MIN, 0, i64::MAX],
        by_number: [(-1, "minus".into()), (7, "seven".into())].into(),
        commands: vec![
            Command::Stop,
            Command::Turn(-1.5),
            Command::Move(1, 2),
            Command::Say { text: "hello".into(), loud: None },
        ],
        nothing: None,
        unit: (),
        newtype: Newtype(3),
    }
}

#[test]
fn what_goes_in_comes_out() {
    let value = to_value(&everything()).unwrap();
    assert_eq!(from_value::<Everything>(value).unwrap(), everything());
}

/// Keys become text on the way, as in Python.
#[test]
fn what_goes_over_the_wire_comes_out() {
    let text = json::encode(&to_value(&everything()).unwrap(), &Plugins::none()).unwrap();
    let value = json::decode(&Bytes::from(text), &Limits::default(), &Plugins::none()).unwrap();
    assert_eq!(from_value::<Everything>(value).unwrap(), everything());
}

#[test]
fn forms_are_those_a_python_user_expects() {
    let text = |command: Command| {
        String::from_utf8(json::encode(&to_value(&command).unwrap(), &Plugins::none()).unwrap())
            .unwrap()
    };
    assert_eq!(text(Command::Stop), r#""Stop""#);
    assert_eq!(text(Command::Turn(0.5)), r#"{"Turn": 0.5}"#);
    assert_eq!(text(Command::Move(1, 2)), r#"{"Move": {"__wrapyfi__": ["tuple", [1, 2]]}}"#);
    let said = Command::Say { text: "a".into(), loud: Some(true) };
    assert_eq!(text(said), r#"{"Say": {"text": "a", "loud": true}}"#);
}

#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Exact {
    any: Value,
    array: Tensor,
    when: DateTime,
    more: Map,
}

#[test]
fn values_pass_as_they_are_and_arrays_are_shared() {
    let array = Tensor::from_elements(&[2], vec![1_u8, 2]).unwrap().with_device("cuda:0");
    let exact = Exact {
        any: Value::Set(vec![Value::Tuple(vec![1.into(), Value::BigInt(u64::MAX.into())])]),
        array: array.clone(),
        when: "2024-01-02T03:04:05+01:00".parse().unwrap(),
        more: Map::from([("inner", Value::Tensor(array.clone()))]),
    };
    let value = to_value(&exact).unwrap();
    let inside = value.get("array").unwrap().as_tensor().unwrap();
    assert_eq!(inside.data().as_ptr(), array.data().as_ptr());
    let again: Exact = from_value(value).unwrap();
    assert_eq!(again.array.data().as_ptr(), array.data().as_ptr());
    assert_eq!(again, exact);
}

#[test]
fn other_formats_get_their_own_forms() {
    let value: Value =
        serde_json::from_str(r#"{"a": [1, 2.5, null, "x"], "b": 18446744073709551615}"#).unwrap();
    assert_eq!(value.get("b"), Some(&Value::from(u64::MAX)));
    assert_eq!(
        serde_json::to_string(&value).unwrap(),
        r#"{"a":[1,2.5,null,"x"],"b":18446744073709551615}"#
    );
    let tensor = Tensor::from_elements(&[2], vec![1_u8, 2]).unwrap();
    assert_eq!(
        serde_json::to_string(&tensor).unwrap(),
        r#"{"dtype":"uint8","shape":[2],"device":"","data":[1,2]}"#
    );
    // The slot is empty again: nothing of one conversion reaches the next.
    assert_eq!(to_value(&Value::Int(1)).unwrap(), Value::Int(1));
    assert_eq!(serde_json::to_string(&Value::Int(2)).unwrap(), "2");
}

#[test]
fn arrays_fill_nested_vectors_and_numbers() {
    let rows = Tensor::from_elements(&[2, 3], vec![1_i16, 2, 3, 4, 5, 6]).unwrap();
    let read: Vec<Vec<i64>> = from_value(rows.into()).unwrap();
    assert_eq!(read, [[1, 2, 3], [4, 5, 6]]);
    let scalar = Tensor::from_elements(&[], vec![1.5_f32]).unwrap();
    assert_eq!(from_value::<f64>(scalar.into()), Ok(1.5));
    let empty = Tensor::from_elements::<f64>(&[0, 3], vec![]).unwrap();
    assert_eq!(from_value::<Vec<Vec<f64>>>(empty.into()), Ok(vec![]));
    // This one has more rows than bytes.
    let hollow = Tensor::from_elements::<f64>(&[3, 0], vec![]).unwrap();
    assert_eq!(from_value::<Vec<Vec<f64>>>(hollow.into()), Ok(vec![vec![]; 3]));
    let complex =
        Tensor::new(crate::types::Dtype::C64, [1], [1.0_f32, -2.0].map(f32::to_le_bytes).concat());
    assert_eq!(from_value::<Vec<(f32, f32)>>(complex.unwrap().into()), Ok(vec![(1.0, -2.0)]));
}

#[test]
fn errors_say_where_and_what() {
    let wrong = Map::from([("commands", Value::List(vec!["Stop".into(), 5.into()]))]);
    #[derive(Debug, Deserialize)]
    struct Script {
        #[allow(dead_code)]
        commands: Vec<Command>,
    }
    let error = from_value::<Script>(wrong.into()).unwrap_err().to_string();
    assert_eq!(
        error,
        "at $.commands[1]: int where the name of a variant, or a dict {variant: content}, should be"
    );
    let error = from_value::<HashMap<i32, u8>>(Map::from([("1", 256)]).into()).unwrap_err();
    assert!(error.to_string().starts_with("at $.1: invalid value: integer `256`"), "{error}");
    let error =
        from_value::<u8>(Value::BigInt(num_bigint::BigInt::from(1) << 200_u32)).unwrap_err();
    assert!(error.to_string().contains("an integer of 201 bits"), "{error}");
    let list_as_key = BTreeMap::from([(vec![1], 2)]);
    assert!(to_value(&list_as_key).unwrap_err().to_string().contains("a list as key of a dict"));
}

#[test]
fn endless_nesting_is_an_error() {
    #[derive(Serialize)]
    struct Nest(Vec<Nest>);
    let mut nest = Nest(vec![]);
    for _ in 0..=MAX_DEPTH {
        nest = Nest(vec![nest]);
    }
    let error = to_value(&nest).unwrap_err().to_string();
    assert!(error.ends_with("nested deeper than 300; nest it less"), "{error}");
}

proptest! {
    #[test]
    fn numbers_of_every_width_return(a: i64, b: u64, c: i128, d: u128, e: f64, f: f32) {
        let all = (a, b, c, d, e.to_bits(), f.to_bits());
        prop_assert_eq!(from_value(to_value(&all).unwrap()), Ok(all));
        let floats: (f64, f32) = from_value(to_value(&(e, f)).unwrap()).unwrap();
        prop_assert!(floats == (e, f) || e.is_nan() || f.is_nan());
    }

    #[test]
    fn maps_and_lists_return(
        map in btree_map(any::<u32>(), vec((".{0,8}", any::<Option<bool>>()), 0..8), 0..8),
    ) {
        prop_assert_eq!(from_value(to_value(&map).unwrap()), Ok(map));
    }
}
