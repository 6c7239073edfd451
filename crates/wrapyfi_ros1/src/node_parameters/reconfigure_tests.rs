//! Descriptions as servers send them, and such as none should.

use bytes::BufMut as _;
use proptest::prelude::*;

use super::*;

fn put(bytes: &mut Vec<u8>, text: &str) {
    bytes.put_u32_le(text.len() as u32);
    bytes.put_slice(text.as_bytes());
}

/// A parameter: name, type, `edit_method`.
type Parameter<'t> = (&'t str, &'t str, &'t str);

/// A description of these groups: name, number of the group around it, parameters.
fn description(groups: &[(&str, u32, &[Parameter<'_>])], configs: [&Config; 3]) -> Vec<u8> {
    let mut bytes = Vec::new();
    bytes.put_u32_le(groups.len() as u32);
    for (id, (name, parent, parameters)) in groups.iter().enumerate() {
        put(&mut bytes, name);
        put(&mut bytes, "");
        bytes.put_u32_le(parameters.len() as u32);
        for (name, kind, edit_method) in *parameters {
            put(&mut bytes, name);
            put(&mut bytes, kind);
            bytes.put_u32_le(id as u32);
            put(&mut bytes, "Purpose");
            put(&mut bytes, edit_method);
        }
        bytes.put_u32_le(*parent);
        bytes.put_u32_le(id as u32);
    }
    configs.iter().for_each(|config| bytes.extend(write_config(config)));
    bytes
}

fn config<const N: usize>(pairs: [(&str, ParameterValue); N]) -> Config {
    pairs.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
}

#[test]
fn values_return() {
    let values = config([
        ("a", true.into()),
        ("b", (-5_i64).into()),
        ("c", "text".into()),
        ("d", 2.5.into()),
        ("e", "".into()),
    ]);
    let bytes = write_config(&values);
    assert_eq!(read_config(&bytes).as_ref(), Some(&values));
    for cut in 0..bytes.len() {
        assert_eq!(read_config(&bytes[..cut]), None, "{cut}");
    }
}

#[test]
fn ranges_enums_groups_levels_and_defaults_are_told() {
    let sizes = "{'enum': [{'name': 'Small', 'value': 0, 'description': 'A small one'}, {'name': 'Big', 'value': 3}]}";
    let groups: [(&str, u32, &[_]); 3] = [
        ("Default", 0, &[("size", "int", sizes), ("gain", "double", "")]),
        ("One", 0, &[]),
        ("Two", 1, &[("name", "str", ""), ("free", "double", ""), ("on", "bool", "")]),
    ];
    let infinite = f64::INFINITY;
    let max = config([("size", 3_i64.into()), ("gain", 4.0.into()), ("free", infinite.into())]);
    let min = config([("size", 0_i64.into()), ("gain", 0.5.into()), ("free", (-infinite).into())]);
    let default = config([("size", 0_i64.into()), ("gain", 1.5.into())]);
    let (all, faults) = read_description(&description(&groups, [&max, &min, &default])).unwrap();
    assert_eq!(faults, [""; 0]);
    let short: Vec<_> = all
        .iter()
        .map(|Described { descriptor, .. }| {
            (descriptor.name.as_str(), descriptor.description.as_str(), descriptor.range)
        })
        .collect();
    let integers = ParameterRange::Integer { from: 0, to: 3, step: 0 };
    let doubles = ParameterRange::Double { from: 0.5, to: 4.0, step: 0.0 };
    assert_eq!(
        short,
        [
            ("size", "Purpose (default 0)", Some(integers)),
            ("gain", "Purpose (default 1.5)", Some(doubles)),
            ("name", "Purpose (group One/Two, level 2)", None),
            ("free", "Purpose (group One/Two, level 2)", None),
            ("on", "Purpose (group One/Two, level 2)", None),
        ]
    );
    assert_eq!(all[0].descriptor.additional_constraints, "one of 0 (Small: A small one), 3 (Big)");
    assert_eq!(all[0].choices, [ParameterValue::Integer(0), ParameterValue::Integer(3)]);
}

#[test]
fn descriptions_that_lie_are_told_of_and_the_rest_is_read() {
    let groups: [(&str, u32, &[_]); 1] = [(
        "Default",
        0,
        &[
            ("turned", "int", ""),
            ("odd", "complex", ""),
            ("turned", "int", ""),
            ("bare", "double", ""),
            ("broken", "int", "{'enum': ["),
            ("mixed", "int", "{'enum': [{'name': 'a', 'value': 'x'}]}"),
        ],
    )];
    let max = config([("turned", 1_i64.into()), ("broken", 5_i64.into()), ("mixed", 5_i64.into())]);
    let min = config([("turned", 9_i64.into()), ("broken", 0_i64.into()), ("mixed", 0_i64.into())]);
    let bytes = description(&groups, [&max, &min, &Config::new()]);
    let (all, faults) = read_description(&bytes).unwrap();
    let names: Vec<&str> = all.iter().map(|one| one.descriptor.name.as_str()).collect();
    assert_eq!(names, ["turned", "bare", "broken", "mixed"]);
    for (fault, words) in faults.iter().zip([
        "\"turned\" has no range: its minimum is 9, its maximum 1",
        "\"odd\" has type \"complex\"",
        "\"turned\" is described twice",
        "\"bare\" has no range: its minimum is none",
        "the enum of parameter \"broken\" is not readable",
        "the enum of parameter \"mixed\" has values of other types than int",
    ]) {
        assert!(fault.contains(words), "{fault}");
    }
    assert_eq!(faults.len(), 6);
    assert!(all.iter().all(|one| one.choices.is_empty()));
}

/// Groups that are in each other have an end.
#[test]
fn a_circle_of_groups_ends() {
    let groups: [(&str, u32, &[_]); 3] =
        [("Default", 0, &[]), ("a", 2, &[("p", "bool", "")]), ("b", 1, &[])];
    let none = Config::new();
    let (all, _) = read_description(&description(&groups, [&none, &none, &none])).unwrap();
    assert_eq!(all[0].descriptor.description.matches('/').count(), MAX_GROUPS - 1);
}

proptest! {
    #[test]
    fn any_bytes_are_read_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        drop(read_config(&bytes));
        drop(read_description(&bytes));
    }

    /// Counts that no bytes back reserve nothing.
    #[test]
    fn any_piece_of_a_description_is_refused(cut in 0usize..200) {
        let parameters: &[_] = &[("a", "int", ""), ("b", "str", "")];
        let none = Config::new();
        let bytes = description(&[("Default", 0, parameters)], [&none, &none, &none]);
        prop_assert!(read_description(&bytes[..cut % bytes.len()]).is_none());
    }
}
