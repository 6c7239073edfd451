use bytes::Bytes;
use proptest::prelude::*;

use super::*;
use wrapyfi_data::Limits;

fn accept(data: &[u8]) -> Pickle {
    read(&Bytes::copy_from_slice(data), &[], &Allowed::PANDAS, &Limits::default()).unwrap()
}

#[test]
fn bytes_are_shared_with_the_input() {
    let data = [
        b"\x80\x05](B\xe8\x03\0\0".as_slice(),
        &[7; 1000],
        b"\x96\xe8\x03\0\0\0\0\0\0",
        &[8; 1000],
        b"\x97e.",
    ];
    let (data, buffers) = (Bytes::from(data.concat()), [Bytes::from_static(b"beside")]);
    let pickle = read(&data, &buffers, &Allowed::BUILTINS, &Limits::default()).unwrap();
    let [bytes, array, buffer] = pickle.root().list().unwrap().exact().unwrap();
    let inside = |part: Bytes| data.as_ptr_range().contains(&part.as_ptr());
    assert!(inside(bytes.bytes().unwrap()) && inside(array.bytes().unwrap()));
    assert_eq!(buffer.bytes().unwrap().as_ptr(), buffers[0].as_ptr());
    assert!(matches!(buffer.view(), View::Buffer(content) if content == "beside"));
}

#[test]
fn bytes_behind_the_end_are_somebody_elses() {
    let data = Bytes::from_static(b"\x80\x04N.\xff\xff\xff");
    let pickle = read(&data, &[], &Allowed::BUILTINS, &Limits::default()).unwrap();
    assert!(pickle.root().is_none());
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
    let pickle =
        accept(b"\x80\x02cpandas.core.frame\nDataFrame\nK\x01\x85\x81(Vitem\ne(Vkey\nK\x02u}b.");
    let call = pickle.root().call("pandas.core.frame.DataFrame").unwrap();
    assert_eq!(call.arg(0).unwrap().int().unwrap(), 1);
    assert_eq!(call.pairs().get("key").unwrap().int().unwrap(), 2);
    assert!(call.state().unwrap().dict().unwrap().is_empty());
    let error = call.arg(1).unwrap_err().to_string();
    let wanted = "$ should be something with at least 2 parts, it is an object of \
                  pandas.core.frame.DataFrame with 1";
    assert!(error.starts_with(wanted), "{error}");
    let error = call.pairs().get("key").unwrap().str().unwrap_err().to_string();
    assert!(error.starts_with("$.key should be a str, it is the int 2"), "{error}");
}

#[test]
fn keyword_arguments_are_passed_over() {
    let pickle = accept(b"\x80\x04\x8c\x05numpy\x8c\x05dtype\x93)}\x8c\x01kK\x01s\x92.");
    assert!(pickle.root().call("numpy.dtype").unwrap().args().is_empty());
}

#[test]
fn only_lists_with_them_have_persistent_ids() {
    let data = Bytes::from_static(b"\x80\x02X\x07\0\0\0storageQ.");
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
                 cdecimal\nDecimal\n(V1.50\ntR\
                 c__builtin__\nslice\n(I0\nI6\nI2\ntR\
                 c__builtin__\nslice\n(I0\nI6\nI-1\ntRt.";
    let data = Bytes::from_static(data);
    let pickle = read(&data, &[], &Allowed::BUILTINS, &Limits::default()).unwrap();
    let parts = pickle.root().tuple().unwrap();
    let part = |index| parts.get(index).unwrap();
    // Python 2 wrote bytes as strings: dates are read from bytes only.
    assert!(part(0).date().is_err());
    assert_eq!(part(2).timedelta().unwrap().num_microseconds(), Some(-999_995));
    let indices = part(3).slice().unwrap().unwrap();
    assert_eq!(indices.collect::<Vec<_>>(), [0, 1, 2, 3, 4]);
    let indices = part(5).slice().unwrap().unwrap();
    assert_eq!(indices.collect::<Vec<_>>(), [0, 2, 4]);
    assert!(part(6).slice().unwrap().is_none(), "backwards");
    assert_eq!(part(4).decimal().unwrap(), "1.50");

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

#[cfg(feature = "tables")]
#[test]
fn arrays_are_written_and_read() {
    let mut writer = Writer::new();
    writer.mark().array("<f4", 2, vec![0; 8].into()).array("<M8[ns]", 1, vec![1; 8].into());
    writer.objects(2, |items| _ = items.str("a").none()).list_since_mark();
    let (data, buffers) = writer.finish();
    assert_eq!(buffers.len(), 2);
    let pickle = read(&data.into(), &buffers, &Allowed::PANDAS, &Limits::default()).unwrap();
    let [numbers, times, objects] = pickle.root().list().unwrap().exact().unwrap();
    let PickledArray::Tensor(numbers) = numbers.array().unwrap() else { panic!("numbers") };
    assert_eq!(numbers.to_vec::<f32>().unwrap(), [0.0; 2]);
    let PickledArray::Array(times) = times.array().unwrap() else { panic!("times") };
    assert_eq!(
        (&*times.descr, &times.shape[..], &times.data[..]),
        ("'<M8[ns]'", &[1][..], &[1; 8][..])
    );
    let PickledArray::Objects { shape, items } = objects.array().unwrap() else {
        panic!("objects")
    };
    assert_eq!((shape, items.get(0).unwrap().str().unwrap()), (vec![2], "a"));
}

#[test]
fn bfloat16_is_read() {
    let data = b"\x80\x02cnumpy.core.numeric\n_frombuffer\n(c__builtin__\nbytearray\n\
                 c_codecs\nencode\nX\x03\0\0\0\xc2\x80?X\x06\0\0\0latin1\x86R\x85R\
                 cnumpy\ndtype\ncml_dtypes\nbfloat16\n\x89\x88\x87RK\x01\x85X\x01\0\0\0CtR.";
    let data = Bytes::from_static(data);
    let pickle = read(&data, &[], &Allowed::JAX, &Limits::default()).unwrap();
    let PickledArray::Tensor(tensor) = pickle.root().array().unwrap() else { panic!("numbers") };
    assert_eq!(tensor.to_vec::<half::bf16>().unwrap(), [half::bf16::ONE]);
}

proptest! {
    #[test]
    fn any_bytes_are_read_or_refused(data in proptest::collection::vec(any::<u8>(), 0..200)) {
        if let Ok(pickle) = read(&data.into(), &[], &Allowed::PANDAS, &Limits::default()) {
            drop(pickle.root().array());
        }
    }
}
