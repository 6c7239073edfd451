//! `wrapyfi call` and `wrapyfi serve` on ZeroMQ and the real Wrapyfi: every type, both directions,
//! either broker.

use serde_json::{Value, json};
use wrapyfi_e2e::{Need, Process, Result, TestEnv, run, sha256, texts};

const NEEDS: &[Need] = &[Need::Program, Need::Python];

#[derive(Clone, Copy, PartialEq)]
enum Broker {
    Ours,
    /// Broker of the real Wrapyfi, in its first server.
    Wrapyfis,
}

fn call(env: &TestEnv, service_type: &str, more: &[&str]) -> Result<Process> {
    let port = env.rep_port().to_string();
    let mut args = vec!["call", "zeromq:/x", "--type", service_type, "--rep-port", &port];
    args.extend(["--timeout", "100", "--json"]);
    args.extend(more);
    env.wrapyfi(args)
}

/// A server that is there: with the broker, whichever program has it.
fn serve(env: &TestEnv, service_type: &str, more: &[&str]) -> Result<Process> {
    let mut args = vec!["serve", "zeromq:/x", "--type", service_type, "--json"];
    args.extend(more);
    let server = env.wrapyfi(args)?;
    server.wait_until("the server", |output| {
        output.err.iter().any(|line| line.contains("serving")).then_some(())
    })?;
    Ok(server)
}

/// The broker of the real Wrapyfi.
fn wrapyfis_broker(env: &TestEnv) -> Result<Process> {
    let ports = format!("--rep-port {} --req-port {}", env.rep_port(), env.req_port());
    let broker = env.peer("wrapyfi_peer.py", &format!("broker --topic /unused {ports}"))?;
    broker.event("ready")?;
    Ok(broker)
}

/// The real Wrapyfi serves; `wrapyfi call` must find the same hashes.
fn client_hears(test: &str, broker: Broker, peer: &str, service_type: &str, key: &str) -> Result {
    run(test, NEEDS, |env| {
        let _broker = (broker == Broker::Ours).then(|| env.broker()).transpose()?;
        let no_broker = if broker == Broker::Ours { "--no-broker" } else { "" };
        let server = env.wrapyfi_server(&format!("{peer} {no_broker}"))?;
        for number in 0..2_usize {
            let asked = format!("[{number}]");
            let mut call = call(env, service_type, &["--args", &asked])?;
            let got = call.objects(1)?.remove(0);
            call.exits_with(0)?;
            let sent = server.messages(number + 1)?.remove(number);
            assert_eq!(got["type"].as_str(), Some(service_type), "{got}");
            assert_eq!(got["sha256"], sent[key], "{got} of {sent}");
        }
        Ok(())
    })
}

macro_rules! client_hears {
    ($($test:ident: $broker:ident $peer:literal as $service_type:literal by $key:literal;)*) => {
        $(#[test]
        fn $test() -> Result {
            client_hears(stringify!($test), Broker::$broker, $peer, $service_type, $key)
        })*
    };
}

client_hears! {
    call_hears_a_small_object: Ours "--flavour small" as "NativeObject" by "sha256";
    call_hears_tuples_sets_dates_and_arrays: Ours "--flavour rich" as "NativeObject" by "sha256";
    call_hears_a_colour_image: Ours "--type Image --flavour colour" as "Image" by "sha256";
    call_hears_a_mono_image: Ours "--type Image --flavour mono" as "Image" by "sha256";
    call_hears_a_float_image: Ours "--type Image --flavour float" as "Image" by "sha256";
    call_hears_a_jpeg: Ours "--type Image --flavour jpg" as "CompressedImage" by "file_sha256";
    call_hears_mono_sound: Ours "--type AudioChunk --flavour mono" as "AudioChunk" by "sha256";
    call_hears_stereo_sound: Ours "--type AudioChunk --flavour stereo" as "AudioChunk" by "sha256";
    call_hears_an_object_through_wrapyfis_broker:
        Wrapyfis "--flavour rich" as "NativeObject" by "sha256";
    call_hears_an_image_through_wrapyfis_broker:
        Wrapyfis "--type Image --flavour colour" as "Image" by "sha256";
    call_hears_sound_through_wrapyfis_broker:
        Wrapyfis "--type AudioChunk --flavour stereo" as "AudioChunk" by "sha256";
}

/// The real Wrapyfi sends what it wants back, and tells what it got.
fn server_echoes(test: &str, broker: Broker, peer: &str, service_type: &str) -> Result {
    run(test, NEEDS, |env| {
        let _holder = match broker {
            Broker::Ours => None,
            Broker::Wrapyfis => Some(wrapyfis_broker(env)?),
        };
        let mut server = serve(env, service_type, &["--echo", "--count", "3"])?;
        let mut client = env.wrapyfi_client(&format!("{peer} --count 3"))?;
        let got = texts(&client.messages(3)?, "sha256");
        client.exits_with(0)?;
        let asked = server.objects(3)?;
        server.exits_with(0)?;
        assert_eq!(got.len(), 3);
        assert!(got[0] != got[1] && got[1] != got[2], "{got:?}");
        // An array comes with the hash of the same bytes.
        let array = &asked[2]["args"][0]["@array"]["sha256"];
        // A JPEG is not the bytes it was made of.
        if let Some(array) = array.as_str().filter(|_| service_type != "CompressedImage") {
            assert_eq!(array, got[2]);
        }
        Ok(())
    })
}

macro_rules! server_echoes {
    ($($test:ident: $broker:ident $peer:literal as $service_type:literal;)*) => {
        $(#[test]
        fn $test() -> Result {
            server_echoes(stringify!($test), Broker::$broker, $peer, $service_type)
        })*
    };
}

server_echoes! {
    serve_answers_a_rich_object: Ours "--flavour rich" as "NativeObject";
    serve_answers_a_colour_image: Ours "--type Image --flavour colour" as "Image";
    serve_answers_a_mono_image: Ours "--type Image --flavour mono" as "Image";
    serve_answers_a_float_image: Ours "--type Image --flavour float" as "Image";
    serve_answers_a_jpeg: Ours "--type Image --flavour jpg" as "CompressedImage";
    serve_answers_mono_sound: Ours "--type AudioChunk --flavour mono" as "AudioChunk";
    serve_answers_stereo_sound: Ours "--type AudioChunk --flavour stereo" as "AudioChunk";
    serve_answers_an_object_through_wrapyfis_broker: Wrapyfis "--flavour small" as "NativeObject";
    serve_answers_an_image_through_wrapyfis_broker:
        Wrapyfis "--type Image --flavour colour" as "Image";
    serve_answers_sound_through_wrapyfis_broker:
        Wrapyfis "--type AudioChunk --flavour mono" as "AudioChunk";
}

/// Our client and our server, through our broker: keyword arguments, constants, errors.
#[test]
fn ours_among_each_other() -> Result {
    run("ours_among_each_other", NEEDS, |env| {
        let _broker = env.broker()?;
        let _server = serve(env, "NativeObject", &["--echo"])?;
        let kwargs = r#"{"k": {"__wrapyfi__": ["tuple", [1]]}}"#;
        let mut call_one =
            call(env, "NativeObject", &["--args", "[[1, 2.5]]", "--kwargs", kwargs])?;
        assert_eq!(call_one.objects(1)?[0]["value"], json!([1, 2.5]));
        call_one.exits_with(0)?;
        let asked = _server.objects(1)?;
        assert_eq!(asked[0]["kwargs"], json!({"k": {"@tuple": [1]}}));
        // The server is of another type: told, not waited for.
        let mut wrong = call(env, "Image", &[])?;
        wrong.exits_with(1)?;
        assert!(wrong.stderr().contains("one for Image"), "{}", wrong.stderr());
        Ok(())
    })
}

/// A Python client of a server that fails raises, with the reason, and may ask again.
#[test]
fn wrapyfi_raises_where_our_server_fails() -> Result {
    run("wrapyfi_raises_where_our_server_fails", NEEDS, |env| {
        let _server = serve(env, "Image", &["--echo"])?;
        // A native object is no image: our server answers with an error.
        let mut client = env.wrapyfi_client("--flavour small --count 2 --fails")?;
        for index in 0..2 {
            let failed = client.wait_until("an exception", |output| {
                output.events("failed").into_iter().nth(index)
            })?;
            let error = failed["error"].as_str().unwrap_or_default().to_owned();
            assert!(
                error.starts_with("ValueError") && error.contains("expected an image"),
                "{error}"
            );
        }
        client.exits_with(0)
    })
}

#[test]
fn calls_that_cannot_be_end_with_a_reason() -> Result {
    run("calls_that_cannot_be_end_with_a_reason", NEEDS, |env| {
        let port = env.rep_port().to_string();
        for (more, code, words) in [
            (vec!["--timeout", "0.3"], 3, "still waiting for the broker at tcp://127.0.0.1"),
            (vec!["--args", "{}"], 2, "--args is {}; it must be a JSON list"),
            (vec!["--kwargs", "["], 2, "--kwargs: malformed JSON"),
            (vec!["--type", "std_srvs/srv/SetBool"], 2, "is no function of Wrapyfi"),
        ] {
            let mut args = vec!["call", "zeromq:/x", "--rep-port", &port];
            args.extend(more);
            let mut process = env.wrapyfi(&args)?;
            process.exits_with(code)?;
            assert!(process.stderr().contains(words), "{args:?}: {}", process.stderr());
        }
        let _broker = env.broker()?;
        let mut nobody =
            env.wrapyfi(["call", "zeromq:/x", "--rep-port", &port, "--timeout", "0.5"])?;
        nobody.exits_with(3)?;
        assert!(nobody.stderr().contains("no server is there"), "{}", nobody.stderr());
        Ok(())
    })
}

/// A picture from a file reaches our client unchanged, without lists of numbers on the way.
#[test]
fn a_file_is_served() -> Result {
    run("a_file_is_served", NEEDS, |env| {
        let text = r#"{"speed": [1, 2.5]}"#;
        let file = env.write("value.json", text)?;
        let file = file.to_string_lossy().into_owned();
        let mut server = serve(env, "NativeObject", &["--file", &file, "--count", "1"])?;
        let mut call = call(env, "NativeObject", &[])?;
        let got: Value = call.objects(1)?.remove(0);
        call.exits_with(0)?;
        server.exits_with(0)?;
        assert_eq!(got["sha256"], sha256(br#"{"speed":[1,2.5]}"#));
        Ok(())
    })
}
