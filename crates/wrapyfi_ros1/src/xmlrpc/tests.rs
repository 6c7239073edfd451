use proptest::prelude::*;

use super::*;

/// Answer as rosmaster writes it (Python's `xmlrpc`).
const PYTHON: &str = "<?xml version='1.0'?>\n<methodResponse>\n<params>\n<param>\n<value><array><data>\n<value><int>1</int></value>\n<value><string>Subscribed to [/chatter]</string></value>\n<value><array><data>\n<value><string>http://127.0.0.1:35229/</string></value>\n</data></array></value>\n</data></array></value>\n</param>\n</params>\n</methodResponse>\n";
/// Answer as roscpp writes it (xmlrpcpp): text without a tag, no line ends.
const ROSCPP: &str = "<?xml version=\"1.0\"?>\r\n<methodResponse><params><param>\r\n\t<value><array><data><value><i4>1</i4></value><value></value><value><array><data><value>TCPROS</value><value>host &amp; &lt;co&gt;</value><value><i4>43859</i4></value></data></array></value></data></array></value>\r\n</param></params></methodResponse>\r\n";

#[test]
fn answers_of_python_and_of_roscpp_read() {
    let reply = decode_reply(PYTHON.as_bytes()).unwrap();
    assert_eq!((reply.status, reply.text.as_str()), (1, "Subscribed to [/chatter]"));
    assert_eq!(reply.value, texts(["http://127.0.0.1:35229/"]));
    let reply = decode_reply(ROSCPP.as_bytes()).unwrap();
    assert_eq!((reply.status, reply.text.as_str()), (1, ""));
    let protocol = vec![text("TCPROS"), text("host & <co>"), Value::Integer(43859)];
    assert_eq!(reply.value, Value::Array(protocol));
}

#[test]
fn a_call_of_roscpp_reads() {
    let call = "<?xml version=\"1.0\"?>\r\n<methodCall><methodName>requestTopic</methodName>\r\n<params><param><value>/listener</value></param><param><value>/chatter</value></param><param><value><array><data><value><array><data><value>TCPROS</value></data></array></value></data></array></value></param></params></methodCall>\r\n";
    let XmlRpcCall { method, params } = decode_call(call.as_bytes()).unwrap();
    assert_eq!(method, "requestTopic");
    let protocols = Value::Array(vec![texts(["TCPROS"])]);
    assert_eq!(params, [text("/listener"), text("/chatter"), protocols]);
    let bare = decode_call(b"<methodCall><methodName>getPid</methodName></methodCall>").unwrap();
    assert_eq!(bare.params, []);
    let empty =
        decode_call(b"<methodCall><methodName>getPid</methodName><params/></methodCall>").unwrap();
    assert_eq!(empty.params, []);
}

#[test]
fn faults_are_told() {
    let fault = encode_fault("no method \"x\"").unwrap();
    let told = decode_reply(fault.as_bytes()).unwrap_err();
    assert_eq!(told.to_string(), "fault 1: no method \"x\"");
}

#[test]
fn hostile_texts_are_refused_by_a_bound() {
    let refused = |xml: &str| decode_call(xml.as_bytes()).unwrap_err();
    let deep = format!(
        "<methodCall><methodName>x</methodName><params><param>{}",
        "<value><array><data>".repeat(100_000)
    );
    assert_eq!(refused(&deep), BoundsError::TooDeep.into());
    let many = "<a/>".repeat(MAX_ELEMENTS + 1);
    assert_eq!(refused(&many), BoundsError::TooMany.into());
    let bomb =
        "<!DOCTYPE x [<!ENTITY a \"aaaa\"><!ENTITY b \"&a;&a;\">]><methodCall>&b;</methodCall>";
    assert_eq!(refused(bomb), BoundsError::Foreign("document type").into());
    assert_eq!(refused("<a><![CDATA[</a>]]></a>"), BoundsError::Foreign("CDATA section").into());
    assert_eq!(refused("<a><!-- x --></a>"), BoundsError::Foreign("comment").into());
    assert_eq!(decode_call(&vec![b' '; MAX_BYTES + 1]), Err(BoundsError::TooLarge.into()));
    assert_eq!(decode_call(b"\xff"), Err(BoundsError::NoXml.into()));
    let unknown = refused("<methodCall><methodName>&unknown;</methodName></methodCall>");
    assert!(unknown.to_string().starts_with("this is no XML-RPC call: "), "{unknown}");
    for text in ["", "x", "<methodCall>", "<methodCall/>", "<a></b>", "{\"json\": 1}"] {
        decode_call(text.as_bytes()).unwrap_err();
        decode_reply(text.as_bytes()).unwrap_err();
    }
}

#[test]
fn an_answer_of_another_shape_is_named() {
    let xml = MethodResponse { value: texts(["only one"]) }.to_xml().unwrap();
    let error = decode_reply(xml.as_bytes()).unwrap_err();
    assert!(error.to_string().contains("[status, text, value]"), "{error}");
}

fn values() -> impl Strategy<Value = Value> {
    let leaf = prop_oneof![
        any::<i32>().prop_map(Value::Integer),
        any::<bool>().prop_map(Value::Boolean),
        "[ -~\n\u{e9}]{0,20}".prop_map(Value::String),
        (-1e6..1e6).prop_map(Value::Double),
        proptest::collection::vec(any::<u8>(), 0..20).prop_map(Value::Base64),
    ];
    leaf.prop_recursive(4, 32, 4, |inner| {
        prop_oneof![
            proptest::collection::vec(inner.clone(), 0..4).prop_map(Value::Array),
            proptest::collection::btree_map("[a-z<&]{1,5}", inner, 0..4).prop_map(Value::Struct),
        ]
    })
}

proptest! {
    #[test]
    fn calls_return(params in proptest::collection::vec(values(), 0..4)) {
        let xml = encode_call("setParam", params.clone()).unwrap();
        let call = decode_call(xml.as_bytes()).unwrap();
        prop_assert_eq!(call, XmlRpcCall { method: "setParam".into(), params });
    }

    #[test]
    fn replies_return(value in values(), text in "[ -~]{0,20}") {
        let reply = Reply::success(text, value);
        let xml = encode_reply(reply.clone()).unwrap();
        prop_assert_eq!(decode_reply(xml.as_bytes()), Ok(reply));
    }

    #[test]
    fn any_text_is_read_or_refused(xml in "[<>/a-z&;!\\[\\]\"=? ]{0,200}") {
        _ = decode_call(xml.as_bytes());
        _ = decode_reply(xml.as_bytes());
    }
}
