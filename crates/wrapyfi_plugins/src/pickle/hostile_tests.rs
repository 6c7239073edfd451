//! Pickles made to do harm: each is refused with a word that says what it tried.

use bytes::Bytes;

use super::*;
use wrapyfi_data::Limits;

/// Name, pickle, what the refusal says.
type Case = (&'static str, &'static [u8], &'static str);

const CODE: &[Case] = &[
    (
        "os.system, protocol 0",
        b"cposix\nsystem\n(Vid\ntR.",
        "posix.system, which is not on the list",
    ),
    ("os.system, protocol 2", b"\x80\x02cos\nsystem\nX\x02\0\0\0id\x85R.", "os.system,"),
    (
        "os.system, protocol 4",
        b"\x80\x04\x8c\x02os\x8c\x06system\x93\x8c\x02id\x85R.",
        "os.system,",
    ),
    ("eval", b"c__builtin__\neval\n(S'1'\ntR.", "__builtin__.eval,"),
    ("exec", b"\x80\x04\x8c\x08builtins\x8c\x04exec\x93.", "builtins.exec,"),
    ("getattr", b"\x80\x04\x8c\x08builtins\x8c\x07getattr\x93)R.", "a class and a name"),
    (
        "an attribute path",
        b"\x80\x04\x8c\x05numpy\x8c\x10ndarray.__init__\x93.",
        "numpy.ndarray.__init__,",
    ),
    (
        "a path of modules",
        b"\x80\x04\x8c\x05numpy\x8c\x0df2py.os.popen\x93.",
        "numpy.f2py.os.popen,",
    ),
    ("a module in the name", b"\x80\x04\x8c\x00\x8c\x0enumpy.ndarrayx\x93.", ".numpy.ndarrayx,"),
    ("an instance, protocol 0", b"(S'id'\nios\nsystem\n.", "os.system,"),
    ("an instance, by OBJ", b"(cos\nsystem\nS'id'\no.", "os.system,"),
    ("an instance of data", b"(cnumpy\nndarray\no.", "numpy.ndarray is only read as data"),
    ("OBJ of text", b"(S'os'\nS'id'\no.", "OBJ at byte 13: a str where a function or class"),
    ("OBJ of nothing", b"(o.", "the class is missing"),
    ("NEWOBJ of data", b"\x80\x04\x8c\x05numpy\x8c\x07ndarray\x93)\x81.", "only read as data"),
    ("NEWOBJ_EX", b"\x80\x04\x8c\x02os\x8c\x05Popen\x93)}\x92.", "os.Popen,"),
    (
        "NEWOBJ_EX, kwargs",
        b"\x80\x04\x8c\x05numpy\x8c\x05dtype\x93))\x92.",
        "a tuple where a dict of arguments",
    ),
    ("a call of a result", b"\x80\x02cnumpy\ndtype\n)R)R.", "an object where a function or class"),
    ("arguments in a list", b"\x80\x02cnumpy\ndtype\n]R.", "a list where a tuple of arguments"),
    (
        "a state of a list",
        b"\x80\x02]}b.",
        "BUILD at byte 4: a list where an object that takes a state",
    ),
    (
        "a state of a class",
        b"\x80\x02cnumpy\ndtype\n}b.",
        "a function or class where an object that takes",
    ),
    ("a second state", b"\x80\x02cnumpy\ndtype\n)R}b}b.", "has its state already"),
    ("extension 1", b"\x80\x02\x82\x01.", "EXT1 at byte 2: the extension registry"),
    ("extension 2", b"\x80\x02\x83\x01\x00.", "EXT2 at byte 2"),
    ("extension 4", b"\x80\x02\x84\x01\0\0\0.", "EXT4 at byte 2"),
    ("a persistent id", b"\x80\x02X\x01\0\0\0aQ.", "BINPERSID at byte 8: nothing lies beside"),
    ("a persistent id, protocol 0", b"Pabc\n.", "PERSID at byte 0: nothing lies beside"),
    (
        "reconstructor",
        b"ccopy_reg\n_reconstructor\n(cnumpy\nndarray\ncnumpy\nmatrix\nNtR.",
        "base other than object",
    ),
    ("encode as something", b"c_codecs\nencode\n(Va\nVzlib\ntR.", "anything but 'latin1'"),
    ("a name that is no text", b"\x80\x04\x8c\x05numpyK\x01\x93.", "not two plain strings"),
    (
        "a name with a surrogate",
        b"\x80\x04\x8c\x05numpy\x8c\x03\xed\xa0\x80\x93.",
        "not two plain strings",
    ),
    ("a name in control characters", b"cos\x1b[2J\nx\n.", "os?[2J.x,"),
];

const SIZES: &[Case] = &[
    ("nothing", b"", "an opcode at byte 0 needs 1 bytes, 0 are left"),
    ("no end", b"\x80\x04N", "an opcode at byte 3 needs 1 bytes, 0 are left"),
    ("half a number", b"J\x01\x02", "BININT at byte 1 needs 4 bytes, 2 are left"),
    ("bytes of 4 GiB", b"B\xff\xff\xff\xffab.", "needs 4294967295 bytes, 3 are left"),
    (
        "bytes of 16 EiB",
        b"\x8e\xff\xff\xff\xff\xff\xff\xff\xff.",
        "needs 18446744073709551615 bytes, 1 are",
    ),
    (
        "a bytearray of 16 EiB",
        b"\x96\xff\xff\xff\xff\xff\xff\xff\x7f.",
        "needs 9223372036854775807 bytes",
    ),
    ("text of 4 GiB", b"X\xff\xff\xff\xff.", "needs 4294967295 bytes, 1 are"),
    ("a negative length", b"T\xff\xff\xff\xff.", "needs 4294967295 bytes"),
    ("a number of 4 GiB", b"\x8b\xff\xff\xff\xff.", "needs 4294967295 bytes"),
    (
        "a frame of 16 EiB",
        b"\x80\x04\x95\xff\xff\xff\xff\xff\xff\xff\xffN.",
        "a frame at byte 11 needs",
    ),
    (
        "a frame that is cut",
        b"\x80\x04\x95\x09\0\0\0\0\0\0\0N.",
        "a frame at byte 11 needs 9 bytes, 2 are left",
    ),
    ("a line without end", b"Vabc", "UNICODE at byte 1 needs 4 bytes, 3 are left"),
    (
        "a memo index of 4 G",
        b"Nr\xff\xff\xff\xff.",
        "memo index at byte 1 is 4294967295, the limit is 7",
    ),
    (
        "a memo index in text",
        b"Np18446744073709551615\n.",
        "memo index at byte 1 is 18446744073709551615",
    ),
    (
        "a memo index too large",
        b"Np99999999999999999999\n.",
        "PUT at byte 1: the memo's index is no number",
    ),
    ("a negative memo index", b"Np-1\n.", "PUT at byte 1: the memo's index is no number"),
    ("a memo that is empty", b"h\x05.", "BINGET at byte 0: the memo has no object number 5"),
    (
        "a memo with a gap",
        b"\x80\x02K\x01q\x05h\x04.",
        "BINGET at byte 6: the memo has no object number 4",
    ),
    ("no integer", b"Iabc\n.", "INT at byte 0: no integer"),
    ("no float", b"Fabc\n.", "FLOAT at byte 0: no float"),
    (
        "a buffer that did not come",
        b"\x80\x05\x97.",
        "uses out-of-band buffer number 1, 0 came with it (byte 2)",
    ),
    ("protocol 6", b"\x80\x06N.", "PROTO at byte 0: protocol 6, the newest known is 5"),
    ("no instruction", b"\xff.", "opcode 0xff at byte 0: no instruction"),
    ("text that is no UTF-8", b"X\x01\0\0\0\xff.", "BINUNICODE at byte 0: the text is not UTF-8"),
    ("a string without quotes", b"Sabc\n.", "STRING at byte 0: the string is not quoted"),
];

const STACK: &[Case] = &[
    ("an empty stack", b".", "STOP at byte 0: the stack is empty"),
    ("a result below a mark", b"N(.", "STOP at byte 2: the stack is empty"),
    ("pop", b"0.", "POP at byte 0: the stack is empty"),
    ("a second mark is gone", b"(00.", "POP at byte 2: the stack is empty"),
    ("dup", b"2.", "DUP at byte 0: the stack is empty"),
    ("no mark", b"t.", "TUPLE at byte 0: there is no mark"),
    ("a tuple over a mark", b"N(N\x86.", "TUPLE2 at byte 3: the stack is empty"),
    ("append to a number", b"K\x01Na.", "APPEND at byte 3: an int where a list should be"),
    ("append to a tuple", b")(Ne.", "APPENDS at byte 3: a tuple where a list should be"),
    ("append to a dict", b"}(Ne.", "a dict where a list should be"),
    ("add to a list", b"](N\x90.", "ADDITEMS at byte 3: a list where a set should be"),
    ("set in a list", b"]NNs.", "SETITEM at byte 3: a list where a dict should be"),
    ("half a pair", b"}(Nu.", "SETITEMS at byte 3: the last key has no value"),
    ("half a pair in a dict", b"(Nd.", "DICT at byte 2: the last key has no value"),
    ("read-only number", b"K\x01\x98.", "READONLY_BUFFER at byte 2: an int is no buffer"),
    ("memoize nothing", b"\x94.", "MEMOIZE at byte 0: the stack is empty"),
    ("set of a number", b"c__builtin__\nset\n(K\x01tR.", "an int where a list or tuple should be"),
    ("bytes of a number", b"c__builtin__\nbytes\n(K\x01tR.", "an int where bytes should be"),
    (
        "bytearray of a size",
        b"c__builtin__\nbytearray\n(J\xff\xff\xff\x7ftR.",
        "an int where bytes should be",
    ),
];

fn refusal(data: &[u8]) -> Option<String> {
    let data = Bytes::copy_from_slice(data);
    let limits = Limits { message_bytes: 1 << 20, ..Limits::default() };
    read(&data, &[], &Allowed::PANDAS, &limits).err().map(|error| error.to_string())
}

#[test]
fn every_trick_is_named() {
    for (name, data, wanted) in CODE.iter().chain(SIZES).chain(STACK) {
        let refused = refusal(data).unwrap_or_else(|| panic!("{name} is read"));
        assert!(refused.contains(wanted), "{name}: {refused}");
    }
}

/// `getattr(…)` with the list of pandas.
#[test]
fn getattr_names_a_method_of_the_list_or_nothing() {
    let read = |data: &[u8]| {
        let data = Bytes::copy_from_slice(data);
        read(&data, &[], &Allowed::PANDAS, &Limits::default())
    };
    let start = b"\x80\x04\x8c\x08builtins\x8c\x07getattr\x93";
    let zone = b"\x8c\x08zoneinfo\x8c\x08ZoneInfo\x93\x8c\x09_unpickle\x86R\x8c\x03UTC\x88\x86R.";
    let pickle = read(&[&start[..], zone].concat()).unwrap();
    let call = pickle.root().call("zoneinfo.ZoneInfo._unpickle").unwrap();
    assert_eq!(call.arg(0).unwrap().str().unwrap(), "UTC");
    for (rest, wanted) in [
        (&b"\x8c\x02os\x8c\x06system\x93"[..], "os.system,"),
        (b"\x8c\x06pandas\x8c\x09DataFrame\x93\x8c\x05query\x86R.", "pandas.DataFrame.query,"),
        (
            b"\x8c\x08zoneinfo\x8c\x08ZoneInfo\x93\x8c\x0c__subclasses\x86R.",
            "ZoneInfo.__subclasses,",
        ),
        (b"\x8c\x01a\x8c\x05upper\x86R.", "anything but a class and a name"),
        (b"\x8c\x01a\x85R.", "anything but a class and a name"),
        (b"\x8c\x08zoneinfo\x8c\x08ZoneInfo\x93\x8c\x09_unpickle\x86\x81.", "only read as data"),
    ] {
        let refused = read(&[&start[..], rest].concat()).unwrap_err().to_string();
        assert!(refused.contains(wanted), "{refused}");
    }
}

/// `start`, then `unit` until there is about a megabyte of it, then `end`.
fn large(start: &[u8], unit: &[u8], end: &[u8]) -> Vec<u8> {
    [start, &unit.repeat(1_000_000 / unit.len()), end].concat()
}

#[test]
fn memory_is_counted() {
    for (name, data) in [
        ("lists", large(b"", b"]", b".")),
        ("dicts in a dict", large(b"(", b"}", b"d.")),
        ("ints", large(b"", b"K\0", b".")),
        ("calls", large(b"\x80\x02cnumpy\ndtype\n)Rq\0", b"0cnumpy\ndtype\n)R", b".")),
        ("a list copied by list()", {
            let mut data = b"\x80\x02c__builtin__\nlist\nq\0](".to_vec();
            data.extend([b'N'; 100_000]);
            data.extend(b"eq\x01");
            data.extend(b"h\0h\x01\x85R".repeat(100));
            data.push(b'.');
            data
        }),
        ("text copied by encode", {
            let text = "é".repeat(100_000);
            let mut data = b"\x80\x02c_codecs\nencode\nq\0X".to_vec();
            data.extend(u32::try_from(text.len()).unwrap().to_le_bytes());
            data.extend(text.as_bytes());
            data.extend(b"q\x01X\x06\0\0\0latin1q\x02");
            data.extend(b"h\0h\x01h\x02\x86R".repeat(1000));
            data.push(b'.');
            data
        }),
        ("text looked through by encode", {
            let mut data = b"\x80\x02c_codecs\nencode\nq\0X\xa0\x86\x01\0".to_vec();
            data.extend([b'a'; 100_000]);
            data.extend(b"q\x01X\x06\0\0\0latin1q\x02");
            data.extend(b"h\0h\x01h\x02\x86R".repeat(1000));
            data.push(b'.');
            data
        }),
    ] {
        let refused = refusal(&data).unwrap_or_else(|| panic!("{name} are read"));
        let wanted = "the limit is 4194304 (raise max_message_mib)";
        assert!(
            refused.starts_with("memory of the pickle") && refused.contains(wanted),
            "{refused}"
        );
    }
    let message = refusal(&[b'N'; 2 << 20]).unwrap();
    assert!(message.contains("pickle with its buffers at byte 0 is 2097152, the limit is 1048576"));
}

fn accept(data: &[u8], allowed: &Allowed) -> Pickle {
    read(&Bytes::copy_from_slice(data), &[], allowed, &Limits::default()).unwrap()
}

#[test]
fn nesting_costs_nothing_until_it_is_walked() {
    // A list in a list in a list…
    let deep = [b"]".repeat(100_000), b"a".repeat(99_999), b".".to_vec()].concat();
    let pickle = accept(&deep, &Allowed::BUILTINS);
    let mut node = pickle.root();
    for _ in 0..100 {
        node = node.list().unwrap().get(0).unwrap();
    }
    assert!(node.path().starts_with("$…[0][0][0]"), "{}", node.path());
}

#[test]
fn what_holds_itself_has_no_end() {
    // l = []; l.append(l)
    let list = accept(b"]q\0h\0a.", &Allowed::BUILTINS);
    let inner = list.root().list().unwrap().get(0).unwrap();
    assert_eq!(inner.id(), list.root().id());
}

#[test]
fn arrays_that_lie_are_refused() {
    let dtype =
        |code: &str, state: &str| format!("cnumpy\ndtype\n(V{code}\nI00\nI01\ntR({state}tb");
    let array = |shape: &str, dtype: &str, data: &str| {
        format!(
            "cnumpy.core.multiarray\n_reconstruct\n(cnumpy\nndarray\n(I0\ntS'b'\ntR(I1\n({shape}t{dtype}I00\n{data}tb."
        )
    };
    let plain = "I3\nV<\nNNNI-1\nI-1\nI0\n";
    let nested = "I3\nV|\nNVa\n\u{85}}Va\ncnumpy\ndtype\n(VO8\nI00\nI01\ntRI0\n\u{86}sI8\nI1\nI0\n";
    let overlap = "I3\nV|\nN(Va\nVb\nt}(Va\ncnumpy\ndtype\n(Vi4\ntRI0\n\u{86}Vb\ncnumpy\ndtype\n(Vi4\n\
                   tRI2\n\u{86}uI8\nI1\nI0\n";
    for (shape, dtype, data, wanted) in [
        ("I1099511627776\n", dtype("f8", plain), "S'1234'\n", "needs 8796093022208 bytes, 4 came"),
        (
            "I4294967296\nI4294967296\n",
            dtype("f8", plain),
            "S''\n",
            "more memory than there can be",
        ),
        ("I-1\n", dtype("f8", plain), "S''\n", "$.state[1][0] should be an int of 0 or more"),
        ("I1\n", dtype("x9", plain), "S''\n", "not known"),
        ("I1\n", dtype("f3", plain), "S''\n", "not known"),
        ("I1\n", dtype("__import__('os')", plain), "S''\n", "no letter with a number"),
        ("I1\n", dtype("O8", plain), "S''\n", "$.state[4] should be a list, it is the str \"\""),
        ("I9\n", dtype("O8", plain), "]", "a list for an array of shape [9], it is a list of 0"),
        ("I1\n", dtype("V8", nested), "S'12345678'\n", "objects inside a structure"),
        ("I1\n", dtype("V8", overlap), "S'12345678'\n", "field at byte 2 overlaps"),
        ("I1\n", dtype("f8", "I9\nV<\nNNNI-1\nI-1\nI0\n"), "S''\n", "state of version 9"),
        ("I1\n", dtype("f8", "I3\nVx\nNNNI-1\nI-1\nI0\n"), "S''\n", "\"x\" is no byte order"),
        (
            "I1\n",
            dtype("M8", "I4\nV<\nNNNI-1\nI-1\nI0\n(}(Vhuh\nI1\nI1\ntt"),
            "S''\n",
            "should be bytes",
        ),
    ] {
        let text = array(shape, &dtype, data);
        let bytes: Vec<u8> = text.chars().map(|c| u8::try_from(c).unwrap()).collect();
        let pickle = accept(&bytes, &Allowed::NUMPY);
        let error = pickle.root().array().unwrap_err().to_string();
        assert!(error.contains(wanted), "{shape} {dtype}: {error}");
    }
}

#[test]
fn a_type_used_by_number_is_not_written_without_end() {
    // Each structure has ten members of the one before.
    let mut data = b"\x80\x02cnumpy\ndtype\nq\x00X\x02\0\0\0u1\x85R".to_vec();
    let mut size = 1_u64;
    for level in 1..=8_u8 {
        data.extend([b'q', level]);
        data.extend(b"0h\0X\x02\0\0\0V1\x85R(K\x03X\x01\0\0\0|N(");
        let name = |n: u8| [b"X\x01\0\0\0".to_vec(), vec![b'a' + n]].concat();
        (0..10).for_each(|n| data.extend(name(n)));
        data.extend(b"t}(");
        for n in 0..10 {
            data.extend(name(n));
            data.extend([b'h', level]);
            data.extend(b"\x8a\x08");
            data.extend((size * u64::from(n)).to_le_bytes());
            data.push(0x86);
        }
        size *= 10;
        data.extend(b"u\x8a\x08");
        data.extend(size.to_le_bytes());
        data.extend(b"K\x01K\0tb");
    }
    data.push(b'.');
    let pickle = accept(&data, &Allowed::NUMPY);
    let error = pickle.root().dtype().unwrap_err().to_string();
    assert!(error.contains("longer than 65536 characters"), "{error}");
}
