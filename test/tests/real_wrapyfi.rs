//! Wrapyfi's own tests and examples, as its package ships them, at our broker and with our programs on the
//! other side.

use std::time::Instant;

use serde_json::{Value, json};
use wrapyfi_e2e::{Need, Process, Result, TIMEOUT, TestEnv, run};

const NEEDS: &[Need] = &[Need::Program, Need::Python];

/// Wrapyfi's test suite of its wrapper, whose publishers find our broker.
#[test]
fn wrapyfis_own_tests_pass_at_our_broker() -> Result {
    run("wrapyfis_own_tests_pass_at_our_broker", NEEDS, |env| {
        let _broker = env.broker()?;
        let case = "wrapyfi.tests.test_wrapper.ZeroMQTestWrapper";
        let mut tests = env.python(&["-m", "unittest", "-v", case])?;
        tests.exits_with(0)?;
        let said = tests.stderr();
        assert!(said.contains("Ran 3 tests") && !said.contains("skipped"), "{said}");
        Ok(())
    })
}

/// The scenario of Wrapyfi's test suite of its middlewares, with its class.
#[test]
fn the_class_of_wrapyfis_own_tests_publishes_and_listens() -> Result {
    run("the_class_of_wrapyfis_own_tests_publishes_and_listens", NEEDS, |env| {
        let _broker = env.broker()?;
        let listener = env.peer("class_test.py", "--mode listen")?;
        let publisher = env.peer("class_test.py", "--mode publish")?;
        let heard = listener.messages(10)?;
        publisher.wait_until("what was heard, among what was said", |output| {
            let said = output.events("message");
            heard.iter().all(|one| said.contains(one)).then_some(())
        })
    })
}

/// Runs a module as a program, with all of Wrapyfi's plug-ins: 0.5 does not find them by itself.
const RUN: &str = "import importlib.util as u, os, runpy, sys\n\
    os.environ['WRAPYFI_PLUGIN_PATHS'] = u.find_spec('wrapyfi').submodule_search_locations[0]\n\
    runpy.run_module(sys.argv.pop(1), run_name='__main__', alter_sys=True)";

/// Starts a script of Wrapyfi's examples by its module; what it asks for is typed as `typed`.
fn example(env: &TestEnv, module: &str, args: &[&str], typed: &[&str]) -> Result<Process> {
    let module = format!("examples.{module}");
    let mut script = env.python(&[&["-u", "-c", RUN, &module], args].concat())?;
    for line in typed {
        script.tell(line)?;
    }
    Ok(script)
}

/// The first object that `wrapyfi echo` hears.
fn heard(env: &TestEnv, topic: &str, kind: &str) -> Result<(Value, String)> {
    let endpoint = format!("zeromq:{topic}");
    let args = ["echo", &endpoint, "--type", kind, "--count", "1", "--json", "--timeout", "100"];
    let mut echo = env.wrapyfi(args)?;
    let object = echo.objects(1)?.remove(0);
    echo.exits_with(0)?;
    Ok((object, echo.stderr()))
}

/// Waits until a script of the examples prints a line with these words.
fn prints(script: &Process, words: &[&str]) -> Result {
    script.wait_until(&words.join(", "), |output| {
        let all = |line: &String| words.iter().all(|word| line.contains(word));
        output.out.iter().any(all).then_some(())
    })
}

#[test]
fn hello_world_is_heard_by_ours() -> Result {
    run("hello_world_is_heard_by_ours", NEEDS, |env| {
        let _broker = env.broker()?;
        let _script = example(env, "hello_world", &["--publish"], &["hello you"])?;
        let (object, _) = heard(env, "/hello/my_message", "NativeObject")?;
        assert_eq!(object["value"]["message"], "hello you", "{object}");
        Ok(())
    })
}

#[test]
fn hello_world_hears_ours() -> Result {
    run("hello_world_hears_ours", NEEDS, |env| {
        let _broker = env.broker()?;
        let script = example(env, "hello_world", &["--listen"], &[])?;
        let value = r#"{"message": "from Rust", "list": [1, null]}"#;
        let publish = ["pub", "zeromq:/hello/my_message", "--type", "NativeObject"];
        let _publisher =
            env.wrapyfi([&publish[..], &["--value", value, "--rate", "10"]].concat())?;
        prints(&script, &["Method result:", "'message': 'from Rust'", "'list': [1, None]"])
    })
}

#[test]
fn hello_world_replies_to_ours() -> Result {
    run("hello_world_replies_to_ours", NEEDS, |env| {
        let _broker = env.broker()?;
        let _script = example(env, "hello_world", &["--reply"], &["yes"])?;
        let port = env.rep_port().to_string();
        let call = ["call", "zeromq:/hello/my_message", "--rep-port", &port, "--timeout", "100"];
        let mut call = env.wrapyfi([&call[..], &["--value", r#""me""#, "--json"]].concat())?;
        let object = call.objects(1)?.remove(0);
        call.exits_with(0)?;
        let wanted = json!({"message": "yes", "message_from_requester": "me"});
        assert_eq!(object["value"], wanted);
        Ok(())
    })
}

#[test]
fn hello_world_asks_ours() -> Result {
    run("hello_world_asks_ours", NEEDS, |env| {
        let _broker = env.broker()?;
        let value = r#"{"message": "done"}"#;
        let server = env.wrapyfi(["serve", "zeromq:/hello/my_message", "--value", value])?;
        let script = example(env, "hello_world", &["--request"], &[])?;
        prints(&script, &["Method result:", "'message': 'done'"])?;
        prints(&server, &[r#""arg_from_requester":"I got this message from the script running in"#])
    })
}

/// Two scripts of the example of mirroring with our broker between them.
#[test]
fn mirroring_goes_through_our_broker() -> Result {
    run("mirroring_goes_through_our_broker", NEEDS, |env| {
        let _broker = env.broker()?;
        let listener = example(env, MIRRORING, &["--mode", "listen"], &[])?;
        let _publisher = example(env, MIRRORING, &["--mode", "publish"], &["ping", "pong"])?;
        prints(&listener, &["'msg_ip': 'ping'"])?;
        prints(&listener, &["'msg_ip': 'pong'"])
    })
}

const LISTING: &[Need] = &[Need::Program, Need::Python, Need::Example("read_msg")];
const MIRRORING: &str = "communication_schemes.mirroring_example";

/// The listing of the guide serves the script, which leaves out what has a default.
#[test]
fn mirroring_asks_the_listing_of_the_guide() -> Result {
    run("mirroring_asks_the_listing_of_the_guide", LISTING, |env| {
        let mut listing = env.example("read_msg", "reply")?;
        let script = example(env, MIRRORING, &["--mode", "request"], &[])?;
        for typed in ["yes", "and again"] {
            listing.tell(typed)?;
            let reply = format!("'msg_ip': '{typed}'");
            prints(
                &script,
                &["'msg': 'This argument message was sent by the request script'", &reply],
            )
            .map_err(|error| error.context(listing.tail()))?;
            prints(&listing, &[typed])?;
        }
        Ok(())
    })
}

#[test]
fn mirroring_hears_the_listing_of_the_guide() -> Result {
    run("mirroring_hears_the_listing_of_the_guide", LISTING, |env| {
        let _broker = env.broker()?;
        let script = example(env, MIRRORING, &["--mode", "listen"], &[])?;
        let mut listing = env.example("read_msg", "publish")?;
        listing.tell("ping")?;
        prints(&script, &["'msg': 'hello'", "'msg_ip': 'ping'"])
    })
}

#[test]
fn the_listing_of_the_guide_hears_mirroring() -> Result {
    run("the_listing_of_the_guide_hears_mirroring", LISTING, |env| {
        let _broker = env.broker()?;
        let listing = env.example("read_msg", "listen")?;
        let _script = example(env, MIRRORING, &["--mode", "publish"], &["pong"])?;
        prints(&listing, &["pong"])
    })
}

#[test]
fn the_listing_of_the_guide_asks_mirroring() -> Result {
    run("the_listing_of_the_guide_asks_mirroring", LISTING, |env| {
        let mut script = example(env, MIRRORING, &["--mode", "reply"], &[])?;
        let started = Instant::now();
        loop {
            // A question that is not asked in time may be answered late, and that takes a line,
            // too.
            script.tell("answer")?;
            let listing = env.example("read_msg", "request")?;
            match prints(&listing, &["answer"]) {
                Err(error) if started.elapsed() > TIMEOUT => return Err(error),
                // The script needs a while to start, and a call waits for five seconds.
                Err(_) => {}
                Ok(()) => return Ok(()),
            }
        }
    })
}

/// The example of channeling publishes an object, a picture and sound at once.
#[test]
fn all_channels_of_channeling_are_heard_by_ours() -> Result {
    run("all_channels_of_channeling_are_heard_by_ours", NEEDS, |env| {
        let _broker = env.broker()?;
        let args = ["--mode", "publish", "--mware_A", "zeromq", "--mware_B", "zeromq", "--mware_C"];
        let module = "communication_schemes.channeling_example";
        let _script = example(env, module, &[&args[..], &["zeromq"]].concat(), &[])?;
        // Its first channel waits for a program that listens, and the others with it.
        let (object, said) = heard(env, "/example/native_A_msg", "NativeObject")?;
        assert!(object["value"].is_array() && !said.contains("unread"), "{said}");
        let native = ["echo", "zeromq:/example/native_A_msg", "--type", "NativeObject", "--json"];
        let _keeps_it_going = env.wrapyfi(native)?;
        let (image, _) = heard(env, "/example/image_B_msg", "Image")?;
        assert_eq!((&image["shape"], &image["encoding"]), (&json!([200, 200, 3]), &json!("bgr8")));
        let (sound, _) = heard(env, "/example/audio_C_msg", "AudioChunk")?;
        assert_eq!(sound["type"], "AudioChunk", "{sound}");
        Ok(())
    })
}

/// An example of a plug-in: what it publishes is read here, no object stays as it came.
fn plug_in(test: &str, package: &'static str, module: &str, topic: &str) -> Result {
    let needs = [NEEDS, &[Need::Package(package)]].concat();
    run(test, &needs, |env| {
        let _broker = env.broker()?;
        let module = format!("encoders.{module}");
        let _script = example(env, &module, &["--mode", "publish"], &["hello", "again"])?;
        let (object, said) = heard(env, topic, "NativeObject")?;
        assert!(object["value"].to_string().contains(r#""message":"hello""#), "{object}");
        assert!(!said.contains("unread"), "{said}");
        Ok(())
    })
}

macro_rules! plug_ins {
    ($($test:ident: $package:literal in $module:literal on $topic:literal;)*) => {
        $(#[test]
        fn $test() -> Result {
            plug_in(stringify!($test), $package, $module, $topic)
        })*
    };
}

plug_ins! {
    numpy_and_pandas_are_read: "pandas" in "numpy_pandas_example" on "/notify/test_native_exchange";
    pint_is_read: "pint" in "pint_example" on "/notify/test_pint_exchange";
    pyarrow_is_read: "pyarrow" in "pyarrow_example" on "/notify/test_arrow_exchange";
    xarray_is_read: "xarray" in "xarray_example" on "/notify/test_xarray_exchange";
}
