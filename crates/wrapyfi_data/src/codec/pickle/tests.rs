use bytes::Bytes;
use num_bigint::BigInt;
use proptest::prelude::*;

use super::*;
use crate::types::{Map, NumpyArray, Tensor, Value};

fn load(pickled: &Pickled) -> Pickle {
    let data = Bytes::copy_from_slice(&pickled.data);
    read(&data, &pickled.buffers, &Allowed::PANDAS, &Limits::default()).unwrap()
}

const PROTOCOLS: [Protocol; 3] = [Protocol::V2, Protocol::V4, Protocol::V5];

#[test]
fn bytes_are_shared_with_the_input() {
    let mut writer = Writer::new(Protocol::V5);
    writer.list(|list| {
        list.bytes(&[7; 1000]);
        list.byte_array(&[8; 1000]);
        list.buffer(Bytes::from_static(b"beside"));
    });
    let pickled = writer.finish().unwrap();
    let data = Bytes::from(pickled.data);
    let pickle = read(&data, &pickled.buffers, &Allowed::BUILTINS, &Limits::default()).unwrap();
    let [bytes, array, buffer] = pickle.root().list().unwrap().exact().unwrap();
    let inside = |part: Bytes| data.as_ptr_range().contains(&part.as_ptr());
    assert!(inside(bytes.bytes().unwrap()) && inside(array.bytes().unwrap()));
    assert_eq!(buffer.bytes().unwrap().as_ptr(), pickled.buffers[0].as_ptr());
    assert!(matches!(buffer.view(), View::Buffer { index: 0, readonly: false, .. }));
}

#[test]
fn bytes_behind_the_end_are_somebody_elses() {
    let data = Bytes::from_static(b"\x80\x04N.\xff\xff\xff");
    let pickle = read(&data, &[], &Allowed::BUILTINS, &Limits::default()).unwrap();
    assert!(pickle.root().is_none());
    assert_eq!(pickle.end(), 4);
}

#[test]
fn strings_of_python_2_are_latin1() {
    let data = Bytes::from_static(b"(S'\\xe9'\nU\x01\xe9T\x01\0\0\0\xe9U\x01at.");
    let pickle = read(&data, &[], &Allowed::BUILTINS, &Limits::default()).unwrap();
    let [a, b, c, d] = pickle.root().tuple().unwrap().exact().unwrap();
    assert_eq!([a, b, c, d].map(|text| text.str().unwrap()), ["é", "é", "é", "a"]);
}

#[test]
fn objects_keep_all_that_was_done_to_them() {
    for protocol in PROTOCOLS {
        let mut writer = Writer::new(protocol);
        writer.instance("pandas.core.frame", "DataFrame", |args| args.int(1));
        writer.append(|items| items.str("item"));
        writer.set_items(|pairs| {
            pairs.str("key");
            pairs.int(2);
        });
        writer.state(|state| state.dict(|_| {}));
        let written = load(&writer.finish().unwrap()).write(protocol).unwrap();
        let pickle = load(&written);
        let call = pickle.root().call("pandas.core.frame.DataFrame").unwrap();
        assert!(call.is_new() && call.kwargs().is_none());
        assert_eq!(call.arg(0).unwrap().int().unwrap(), 1);
        assert_eq!(call.items().get(0).unwrap().str().unwrap(), "item");
        assert_eq!(call.pairs().get("key").unwrap().int().unwrap(), 2);
        assert!(call.state().unwrap().dict().unwrap().is_empty());
        let error = call.items().get(1).unwrap_err().to_string();
        let wanted = "$ should be something with at least 2 parts, it is an object of \
                      pandas.core.frame.DataFrame with 1";
        assert!(error.starts_with(wanted), "{error}");
        let error = call.pairs().get("key").unwrap().str().unwrap_err().to_string();
        assert!(error.starts_with("$.key should be a str, it is the int 2"), "{error}");
    }
}

#[test]
fn keyword_arguments_need_protocol_4() {
    let data = b"\x80\x04\x8c\x05numpy\x8c\x05dtype\x93)}\x8c\x01kK\x01s\x92.";
    let data = Bytes::from_static(data);
    let pickle = read(&data, &[], &Allowed::NUMPY, &Limits::default()).unwrap();
    let call = pickle.root().call("numpy.dtype").unwrap();
    assert_eq!(call.kwargs().unwrap().dict().unwrap().get("k").unwrap().int().unwrap(), 1);
    assert!(pickle.write(Protocol::V5).is_ok());
    let error = pickle.write(Protocol::V2).unwrap_err().to_string();
    assert!(error.contains("an object with keyword arguments"), "{error}");
}

#[test]
fn only_lists_with_them_have_persistent_ids() {
    let mut writer = Writer::new(Protocol::V2);
    writer.persistent(|id| id.str("storage"));
    let data = Bytes::from(writer.finish().unwrap().data);
    let read = |allowed| read(&data, &[], &allowed, &Limits::default());
    let pickle = read(Allowed::TORCH).unwrap();
    assert_eq!(pickle.root().persistent().unwrap().str().unwrap(), "storage");
    assert!(read(Allowed::NUMPY).is_err());
}

#[test]
fn the_last_of_equal_keys_counts() {
    let data = Bytes::from_static(b"}(Va\nK\x01Va\nK\x02u.");
    let pickle = read(&data, &[], &Allowed::BUILTINS, &Limits::default()).unwrap();
    assert_eq!(pickle.root().dict().unwrap().get("a").unwrap().int().unwrap(), 2);
    let error = pickle.root().dict().unwrap().get("b").unwrap_err().to_string();
    assert!(error.starts_with("$ should be something with the key \"b\", it is a dict of 2"));
}

#[test]
fn values_of_the_standard_library() {
    let data = b"(cdatetime\ndate\n(S'\\x07\\xe8\\x01\\x02'\ntR\
                 cdatetime\ntime\n(S'\\x01\\x02\\x03\\x00\\x00\\x05'\ntR\
                 cdatetime\ntimedelta\n(I-1\nI86399\nI5\ntR\
                 c__builtin__\nslice\n(NI5\nNtR\
                 c__builtin__\ncomplex\n(F1.5\nF-2\ntR\
                 cdecimal\nDecimal\n(V1.50\ntR\
                 c__builtin__\nxrange\n(I0\nI9\nI3\ntRt.";
    let data = Bytes::from_static(data);
    let pickle = read(&data, &[], &Allowed::BUILTINS, &Limits::default()).unwrap();
    let parts = pickle.root().tuple().unwrap();
    let part = |index| parts.get(index).unwrap();
    // Python 2 wrote bytes as strings: dates are read from bytes only.
    assert!(part(0).date().is_err());
    assert_eq!(part(2).timedelta().unwrap().num_microseconds(), Some(-999_995));
    let slice = part(3).slice().unwrap();
    assert_eq!(slice, Slice { start: None, stop: Some(5), step: None });
    assert_eq!(slice.indices().unwrap().collect::<Vec<_>>(), [0, 1, 2, 3, 4]);
    assert_eq!(part(4).complex().unwrap(), (1.5, -2.0));
    assert_eq!(part(5).decimal().unwrap(), "1.50");
    assert_eq!(part(6).range().unwrap(), (0, 9, 3));

    let data = b"\x80\x03(cdatetime\ndate\nC\x04\x07\xe8\x01\x02\x85Rcdatetime\ntime\n\
                 C\x06\x81\x02\x03\0\0\x05\x85Rcdatetime\ndate\nC\x04\x07\xe8\x02\x1e\x85R\
                 cdatetime\ntime\nC\x06\x01\x02\x03\xff\xff\xff\x85Rt.";
    let data = Bytes::from_static(data);
    let pickle = read(&data, &[], &Allowed::BUILTINS, &Limits::default()).unwrap();
    let [date, time, no_date, no_time] = pickle.root().tuple().unwrap().exact().unwrap();
    assert_eq!(date.date().unwrap().to_string(), "2024-01-02");
    assert_eq!(time.time().unwrap().0.to_string(), "01:02:03.000005");
    let error = no_date.date().unwrap_err().to_string();
    assert!(error.starts_with("the date at $[2] cannot be read: no such date"), "{error}");
    assert!(no_time.time().is_err());
}

#[test]
fn arrays_are_written_and_read() {
    let tensor = Tensor::from_elements(&[2, 3], vec![1.5_f32, 2.0, 3.0, 4.0, 5.0, 6.0]).unwrap();
    let others = [
        NumpyArray::new("'<M8[ns]'", 8, [1], vec![1; 8]).unwrap(),
        NumpyArray::new("'>m8[25s]'", 8, [1], vec![1; 8]).unwrap(),
        NumpyArray::new("'<U2'", 8, [2], vec![0; 16]).unwrap(),
        NumpyArray::new("'|S3'", 3, [0, 4], vec![]).unwrap(),
        NumpyArray::new("'|V3'", 3, [], vec![1, 2, 3]).unwrap(),
    ];
    for protocol in PROTOCOLS {
        let mut writer = Writer::new(protocol);
        writer.list(|list| {
            list.array(&tensor);
            list.array_beside(&tensor);
            list.object_array(&[1, 2], |items| {
                items.str("a");
                items.none();
            });
            others.iter().for_each(|other| list.other_array(other));
        });
        let pickled = writer.finish().unwrap();
        assert_eq!(pickled.buffers.len(), usize::from(protocol == Protocol::V5));
        let pickle = load(&pickled);
        let parts = pickle.root().list().unwrap();
        for index in 0..2 {
            let read = parts.get(index).unwrap().array().unwrap();
            assert!(matches!(read, PickledArray::Tensor(read) if read == tensor), "{protocol:?}");
        }
        let objects = parts.get(2).unwrap().array().unwrap();
        let PickledArray::Objects { shape, items } = objects else { panic!("objects") };
        assert_eq!((shape, items.get(0).unwrap().str().unwrap()), (vec![1, 2], "a"));
        for (index, other) in others.iter().enumerate() {
            let read = parts.get(3 + index).unwrap().array().unwrap();
            assert!(matches!(read, PickledArray::Array(read) if read == *other), "{other:?}");
        }
    }
    let structured = NumpyArray::new("[('a', '<i4')]", 4, [1], vec![0; 4]).unwrap();
    let mut writer = Writer::new(Protocol::V5);
    writer.other_array(&structured);
    let error = writer.finish().unwrap_err().to_string();
    assert!(error.contains("elements of type [('a', '<i4')]"), "{error}");
}

#[test]
fn bfloat16_is_read_and_widened_when_written() {
    let data = b"\x80\x02cnumpy.core.numeric\n_frombuffer\n(c__builtin__\nbytearray\n\
                 c_codecs\nencode\nX\x03\0\0\0\xc2\x80?X\x06\0\0\0latin1\x86R\x85R\
                 cnumpy\ndtype\ncml_dtypes\nbfloat16\n\x89\x88\x87RK\x01\x85X\x01\0\0\0CtR.";
    let data = Bytes::from_static(data);
    let pickle = read(&data, &[], &Allowed::JAX, &Limits::default()).unwrap();
    let PickledArray::Tensor(tensor) = pickle.root().array().unwrap() else { panic!("numbers") };
    assert_eq!(tensor.to_vec::<half::bf16>().unwrap(), [half::bf16::ONE]);
    let mut writer = Writer::new(Protocol::V5);
    writer.array_beside(&tensor);
    let written = load(&writer.finish().unwrap());
    let PickledArray::Tensor(wide) = written.root().array().unwrap() else { panic!("numbers") };
    assert_eq!(wide.to_vec::<f32>().unwrap(), [1.0]);
}

fn write(value: &Value, w: &mut Writer) {
    match value {
        Value::Null => w.none(),
        Value::Bool(value) => w.bool(*value),
        Value::Int(value) => w.int(*value),
        Value::BigInt(value) => w.big_int(value),
        Value::Float(value) => w.float(*value),
        Value::Str(text) => w.str(text),
        Value::Utf16(units) => w.utf16(units),
        Value::Bytes(bytes) => w.bytes(bytes),
        Value::List(items) => w.list(|w| items.iter().for_each(|item| write(item, w))),
        Value::Tuple(items) => w.tuple(|w| items.iter().for_each(|item| write(item, w))),
        Value::Set(items) => w.set(|w| items.iter().for_each(|item| write(item, w))),
        Value::Map(map) => w.dict(|w| {
            map.iter().for_each(|(key, value)| {
                write(key, w);
                write(value, w);
            });
        }),
        Value::Tensor(tensor) => w.array_beside(tensor),
        other => panic!("{other:?}"),
    }
}

fn any_value() -> impl Strategy<Value = Value> {
    let leaf = prop_oneof![
        Just(Value::Null),
        any::<bool>().prop_map(Value::from),
        any::<i64>().prop_map(Value::from),
        (-300_i64..300).prop_map(Value::from),
        (any::<i64>(), 1_u32..100).prop_map(|(n, shift)| Value::from(BigInt::from(n) << shift)),
        (-1e300_f64..1e300).prop_map(Value::from),
        ".*".prop_map(Value::from),
        Just(Value::Utf16(vec![0x61, 0xD800, 0xDC])),
        proptest::collection::vec(any::<u8>(), 0..300).prop_map(|b| Value::Bytes(b.into())),
        proptest::collection::vec(any::<i16>(), 0..20).prop_map(|v| Tensor::from_elements(
            &[v.len()],
            v
        )
        .unwrap()
        .into()),
    ];
    leaf.prop_recursive(4, 40, 6, |inner| {
        let items = || proptest::collection::vec(inner.clone(), 0..6);
        let names = proptest::collection::vec("[a-z]{1,3}", 0..4);
        prop_oneof![
            items().prop_map(Value::List),
            items().prop_map(Value::Tuple),
            names.prop_map(|names| {
                let members = names.into_iter().map(Value::from).collect();
                Value::Set(crate::types::unique_members(members))
            }),
            proptest::collection::vec(("[a-z]{0,3}", inner.clone()), 0..4)
                .prop_map(|pairs| Value::Map(pairs.into_iter().collect::<Map>())),
        ]
    })
}

proptest! {
    #[test]
    fn written_then_read_is_the_same(value in any_value()) {
        for protocol in PROTOCOLS {
            let mut writer = Writer::new(protocol);
            write(&value, &mut writer);
            let pickled = writer.finish().unwrap();
            let pickle = load(&pickled);
            prop_assert_eq!(pickle.end(), pickled.data.len());
            prop_assert_eq!(&pickle.root().to_value(&Limits::default()).unwrap(), &value);
            let again = load(&pickle.write(protocol).unwrap());
            prop_assert_eq!(&again.root().to_value(&Limits::default()).unwrap(), &value);
        }
    }

    #[test]
    fn any_bytes_are_read_or_refused(data in proptest::collection::vec(any::<u8>(), 0..200)) {
        if let Ok(pickle) = read(&data.into(), &[], &Allowed::PANDAS, &Limits::default()) {
            drop(pickle.root().to_value(&Limits::default()));
        }
    }
}
