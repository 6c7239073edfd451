use proptest::prelude::*;

use super::*;

fn file(header: &str, data: &[u8]) -> Bytes {
    let mut file = b"\x93NUMPY\x01\x00".to_vec();
    file.extend_from_slice(&u16::try_from(header.len()).unwrap().to_le_bytes());
    file.extend_from_slice(header.as_bytes());
    file.extend_from_slice(data);
    file.into()
}

fn header(descr: &str, fortran: &str, shape: &str) -> String {
    format!("{{'descr': {descr}, 'fortran_order': {fortran}, 'shape': {shape}, }}\n")
}

fn reason(file: &Bytes) -> String {
    read(file).unwrap_err().to_string()
}

#[test]
fn elements_are_not_copied() {
    let tensor = Tensor::from_elements(&[2, 2], vec![1_u16, 2, 3, 4]).unwrap();
    let file = Bytes::from(write(&tensor));
    assert_eq!(file.len(), 128 + 8);
    let NpyArray::Tensor(read) = read(&file).unwrap() else { panic!("a tensor") };
    assert_eq!(read, tensor);
    assert_eq!(read.data.as_ptr(), file[128..].as_ptr());
}

#[test]
fn fortran_order_and_big_endian_are_undone() {
    let data: Vec<u8> = [0_u16, 3, 1, 4, 2, 5].iter().flat_map(|x| x.to_be_bytes()).collect();
    let array = read(&file(&header("'>u2'", "True", "(2, 3)"), &data)).unwrap();
    let NpyArray::Tensor(tensor) = array else { panic!("a tensor") };
    assert_eq!(tensor.to_vec::<u16>().unwrap(), [0, 1, 2, 3, 4, 5]);

    // (2, 1, 3) counted up along the first axis first.
    let array = read(&file(&header("'|S1'", "True", "(2, 1, 3)"), b"adbecf")).unwrap();
    let NpyArray::Array(array) = array else { panic!("no numbers") };
    assert_eq!((&*array.data, &*array.descr), (&b"abcdef"[..], "'|S1'"));
}

#[test]
fn structured_types_are_measured() {
    for (descr, itemsize) in [
        ("[('a', '<i4'), ('b', '<f8'), ('c', '|S2')]", 14),
        ("[('p', '<f4', (2,)), ('q', '|u1')]", 9),
        ("[(('title', 'n'), [('x', '<U3'), ('', '|V4')], (2, 2))]", 64),
        ("('<i2', (3,))", 6),
        ("'<M8[25s]'", 8),
        ("[]", 0),
        (r"[('it\'s', '<f4')]", 4),
    ] {
        let array = read(&file(&header(descr, "False", "(1,)"), &vec![7; itemsize])).unwrap();
        let NpyArray::Array(array) = array else { panic!("no numbers") };
        assert_eq!((array.itemsize, &*array.descr), (itemsize, descr));
        let written = Bytes::from(write_array(&array));
        assert_eq!(read(&written).unwrap(), NpyArray::Array(array));
    }
}

#[test]
fn names_beyond_latin1_and_long_headers_take_later_versions() {
    let array = |name: &str| {
        let descr = format!("[('{name}', '<f4')]");
        NumpyArray::new(descr, 4, [1], vec![1, 2, 3, 4]).unwrap()
    };
    for (name, version) in [("é", 1), ("你", 3), (&*"x".repeat(70_000), 2)] {
        let array = array(name);
        let written = Bytes::from(write_array(&array));
        assert_eq!(written[6], version);
        assert_eq!((written.len() - 4) % 64, 0);
        assert_eq!(read(&written).unwrap(), NpyArray::Array(array));
    }
}

#[test]
fn headers_that_lie_are_refused_before_anything_is_allocated() {
    for (descr, shape, wanted) in [
        ("'<f8'", "(1099511627776,)", "needs 8796093022208 bytes, 4 follow the header"),
        ("'<f8'", "(4294967296, 4294967296)", "larger than memory can be"),
        ("'<f8'", "(18446744073709551616,)", "does not begin with an extent"),
        ("'<f8'", "(-1,)", "does not begin with an extent"),
        ("'<f8'", "(2, 3", "does not begin with an extent"),
        ("'<f8'", "(2 3)", "'3' where ')' should be"),
        ("'|O'", "(2,)", "pickle"),
        ("[('a', '|O')]", "(2,)", "pickle"),
        ("[('a', '<f8', (4294967296, 4294967296))]", "(1,)", "overflows"),
        ("'<x9'", "(2,)", "not known"),
        ("'<f3'", "(2,)", "not known"),
        ("'<i8[ns]'", "(2,)", "not known"),
        ("'<U9999999999999999999'", "(2,)", "not known"),
        ("__import__('os')", "(2,)", "lacks a quoted string"),
    ] {
        let message = reason(&file(&header(descr, "False", shape), &[0; 4]));
        assert!(message.contains(wanted), "{descr} {shape}: {message}");
    }
    let deep = format!("{}'<f4'{}", "(".repeat(40), ", (1,))".repeat(40));
    assert!(reason(&file(&header(&deep, "False", "()"), &[0; 4])).contains("nests deeper"));
    let wide = format!("({})", "1,".repeat(65));
    assert!(reason(&file(&header("'<f4'", "False", &wide), &[0; 4])).contains("64 dimensions"));
}

#[test]
fn empty_elements_cost_nothing_however_many() {
    let text = header("'|S0'", "True", "(1099511627776, 1099511627776)");
    assert!(read(&file(&text, &[])).is_err());
    let text = header("'|S0'", "True", "(4294967296, 2147483647)");
    assert!(matches!(read(&file(&text, &[])), Ok(NpyArray::Array(_))));
}

#[test]
fn other_files_are_named() {
    for (bytes, wanted) in [
        (&b""[..], "no bytes"),
        (b"PK\x03\x04", "archive"),
        (b"\x80\x04\x95", "pickle"),
        (b"hello", "does not begin"),
        (b"\x93NUMPY", "length"),
        (b"\x93NUMPY\x01\x00\x05", "length"),
        (b"\x93NUMPY\x09\x00\x05\x00", "version 9"),
        (b"\x93NUMPY\x02\x00\xff\xff\xff\xff", "the limit is"),
        (b"\x93NUMPY\x01\x00\xff\x00{}", "a header of 255 bytes, 2 are there"),
    ] {
        let message = reason(&Bytes::from_static(bytes));
        assert!(message.contains(wanted), "{bytes:?}: {message}");
    }
    for (header, wanted) in [
        ("{}", "lacks \"descr\""),
        ("{'descr': '<f4', 'shape': ()}", "lacks \"fortran_order\""),
        ("{'descr': '<f4', 'x': ()}", "unknown key"),
        ("{'descr': '<f4', 'fortran_order': 1}", "neither True nor False"),
        ("{'descr': '<f4', 'fortran_order': False, 'shape': ()} x", "goes on"),
    ] {
        let message = reason(&file(header, &[]));
        assert!(message.contains(wanted), "{header}: {message}");
    }
}

#[test]
fn bfloat16_is_widened() {
    let values = [1.5_f32, -0.0, f32::INFINITY].map(half::bf16::from_f32);
    let tensor = Tensor::from_elements(&[3], values.to_vec()).unwrap();
    let NpyArray::Tensor(read) = read(&write(&tensor).into()).unwrap() else { panic!("tensor") };
    assert_eq!(read.to_vec::<f32>().unwrap(), [1.5, -0.0, f32::INFINITY]);
}

proptest! {
    #[test]
    fn written_then_read_is_the_same(
        dtype in proptest::sample::select(&Dtype::ALL[..]),
        shape in proptest::collection::vec(0_usize..5, 0..4),
        seed: u8,
    ) {
        prop_assume!(dtype != Dtype::BF16);
        let size = shape.iter().product::<usize>() * dtype.size();
        let data: Vec<u8> = (0..size).map(|i| (i as u8).wrapping_mul(31).wrapping_add(seed)).collect();
        let tensor = Tensor::new(dtype, shape, data).unwrap();
        prop_assert_eq!(read(&write(&tensor).into()).unwrap(), NpyArray::Tensor(tensor));
    }

    #[test]
    fn any_bytes_are_read_or_refused(tail in proptest::collection::vec(any::<u8>(), 0..200)) {
        let mut bytes = b"\x93NUMPY".to_vec();
        bytes.extend(tail);
        drop(read(&bytes.into()));
    }
}
