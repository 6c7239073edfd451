//! Named parameters as native objects, and back.

use bytes::Bytes;
use num_bigint::BigInt;
use proptest::prelude::*;

use super::*;
use crate::plugin::Plugins;

fn read(pairs: impl Into<Map>) -> Result<Properties, PropertiesError> {
    Properties::from_value(&Value::Map(pairs.into()))
}

fn one(value: impl Into<Value>) -> ParameterValue {
    read([("a", value)]).unwrap().get("a").unwrap().clone()
}

fn refused(value: impl Into<Value>) -> String {
    read([("a", value)]).unwrap_err().to_string()
}

#[test]
fn every_type_has_its_native_object() {
    let list = |items: &[f64]| Value::from_iter(items.iter().copied());
    for (value, wanted) in [
        (Value::Null, ParameterValue::NotSet),
        (true.into(), true.into()),
        (i64::MIN.into(), ParameterValue::Integer(i64::MIN)),
        (0.1.into(), 0.1.into()),
        ("text".into(), "text".into()),
        (Bytes::from_static(b"\0\xff").into(), vec![0_u8, 255].into()),
        (Value::from_iter([true, false]), vec![true, false].into()),
        (Value::from_iter([1, -2]), vec![1_i64, -2].into()),
        (list(&[0.5, f64::INFINITY]), vec![0.5, f64::INFINITY].into()),
        (Value::Tuple(vec!["a".into(), "".into()]), vec!["a".to_owned(), String::new()].into()),
        (Value::List(vec![1.into(), 2.5.into()]), vec![1.0, 2.5].into()),
        (Value::List(vec![]), Vec::<String>::new().into()),
    ] {
        assert_eq!(one(value), wanted);
    }
}

#[test]
fn arrays_with_one_dimension_are_lists() {
    fn of<T: crate::types::Element>(elements: Vec<T>) -> ParameterValue {
        one(Tensor::from_elements(&[elements.len()], elements).unwrap())
    }
    assert_eq!(of(vec![1_u8, 255]), vec![1_u8, 255].into());
    assert_eq!(of(vec![1_i8, -1]), vec![1_i64, -1].into());
    assert_eq!(of(vec![u16::MAX]), vec![65_535_i64].into());
    assert_eq!(of(vec![i32::MIN]), vec![i64::from(i32::MIN)].into());
    assert_eq!(of(vec![1_u64]), vec![1_i64].into());
    assert_eq!(of(vec![0.5_f32]), vec![0.5].into());
    assert_eq!(of(Vec::<f64>::new()), Vec::<f64>::new().into());
    let flags = Tensor::new(Dtype::Bool, [2], vec![1, 0]).unwrap();
    assert_eq!(one(flags), vec![true, false].into());
    let text = refused(Tensor::from_elements(&[1], vec![u64::MAX]).unwrap());
    assert!(text.contains("more than 63 bits"), "{text}");
    let text = refused(Tensor::from_elements(&[1, 1], vec![1.0]).unwrap());
    assert!(text.contains("with 2 dimensions"), "{text}");
    let text = refused(Tensor::new(Dtype::C64, [1], vec![0; 8]).unwrap());
    assert!(text.contains("an array of complex64"), "{text}");
}

#[test]
fn groups_are_names_with_dots() {
    let lens = Map::from([("f", Value::from(1.4)), ("label", "prime".into())]);
    let camera = Map::from([("rate", Value::from(30)), ("lens", lens.into())]);
    let read = read([("camera", Value::from(camera)), ("camera.name", "left".into())]).unwrap();
    let names: Vec<_> = read.names().collect();
    assert_eq!(names, ["camera.rate", "camera.lens.f", "camera.lens.label", "camera.name"]);
}

#[test]
fn what_no_parameter_can_be_is_named() {
    let text = Properties::from_value(&Value::from(5)).unwrap_err().to_string();
    assert!(text.contains("not int"), "{text}");
    let text = refused(Value::BigInt(BigInt::from(1_u128 << 80)));
    assert!(text.contains("1208925819614629174706176, which has more than 64 bits"), "{text}");
    let text = refused(Value::Set(vec![1.into()]));
    assert!(text.contains("parameter \"a\" cannot be set"), "{text}");
    let text = refused(Value::List(vec![1.into(), "x".into()]));
    assert!(text.contains("int and str"), "{text}");
    let text = refused(Value::List(vec![true.into(), 1.into()]));
    assert!(text.contains("bool and int"), "{text}");
    let text = refused(Value::List(vec![Value::List(vec![])]));
    assert!(text.contains("a list of list"), "{text}");
    let text = refused(Value::List(vec![i64::MAX.into(), 0.5.into()]));
    assert!(text.contains("no float is equal to"), "{text}");
    let error = read([(Value::Int(1), 1)]).unwrap_err();
    assert_eq!(error, key_error("", "int"));
    let inner = Map::from([("", 1)]);
    assert_eq!(read([("g", inner)]).unwrap_err(), key_error("g", "an empty one"));
    let group = Value::from(Map::from([("b", 1)]));
    let error = read([("a", group), ("a.b", 2.into())]).unwrap_err();
    assert_eq!(error, PropertiesError::Twice("a.b".into()));
    let deep = (0..70).fold(Value::from(1), |inner, _| Map::from([("g", inner)]).into());
    let error = Properties::from_value(&deep).unwrap_err();
    assert!(error.to_string().ends_with("deeper than 64"), "{error}");
}

#[test]
fn changes_are_told_and_taken_over() {
    let old = Properties::from([("a", 1_i64), ("b", 2), ("c", 3)]);
    let new = Properties::from([("c", 3_i64), ("b", 5), ("d", 4)]);
    let changes = old.changes_to(&new);
    let told: Vec<_> = changes.iter().map(|(name, value)| format!("{name}={value}")).collect();
    assert_eq!(told, ["b=5", "d=4", "a=not set"]);
    let mut now = old;
    now.apply(&changes);
    assert_eq!(now, Properties::from([("b", 5_i64), ("c", 3), ("d", 4)]));
    assert_eq!((now.get("a"), now.get("d")), (None, Some(&4_i64.into())));
    assert!(now.changes_to(&new).is_empty());
}

fn values() -> impl Strategy<Value = ParameterValue> {
    use proptest::collection::vec;
    prop_oneof![
        Just(ParameterValue::NotSet),
        any::<bool>().prop_map(ParameterValue::from),
        any::<i64>().prop_map(ParameterValue::from),
        any::<f64>().prop_filter("equal to itself", |x| !x.is_nan()).prop_map(ParameterValue::from),
        ".{0,8}".prop_map(ParameterValue::from),
        vec(any::<u8>(), 0..8).prop_map(ParameterValue::from),
        // An empty list has lost its type.
        vec(any::<bool>(), 1..8).prop_map(ParameterValue::from),
        vec(any::<i64>(), 1..8).prop_map(ParameterValue::from),
        vec(-1e300..1e300, 1..8).prop_map(ParameterValue::from),
        vec(".{0,4}", 0..8).prop_map(ParameterValue::from),
    ]
}

fn properties() -> impl Strategy<Value = Properties> {
    let names = proptest::collection::vec(("[a-z]{1,3}(\\.[a-z]{1,2}){0,2}", values()), 0..20);
    names.prop_map(Properties::from_iter)
}

proptest! {
    #[test]
    fn what_is_written_is_read(original in properties()) {
        prop_assert_eq!(Properties::from_value(&original.to_value()).unwrap(), original);
    }

    /// Parameters survive Wrapyfi's JSON, in which a script sees them.
    #[test]
    fn json_keeps_them(original in properties()) {
        let json = crate::codec::json::encode(&original.to_value(), &Plugins::none()).unwrap();
        let value = crate::codec::json::decode(&json.into(), &crate::Limits::default(), &Plugins::none()).unwrap();
        prop_assert_eq!(Properties::from_value(&value).unwrap(), original);
    }

    #[test]
    fn changes_lead_from_any_to_any(old in properties(), new in properties()) {
        let strip = |all: Properties| -> Properties {
            all.into_iter().filter(|(_, value)| *value != ParameterValue::NotSet).collect()
        };
        let (old, new) = (strip(old), strip(new));
        let mut now = old.clone();
        now.apply(&old.changes_to(&new));
        prop_assert!(now.changes_to(&new).is_empty());
        prop_assert_eq!(now.len(), new.len());
    }
}
