//! Tensors of the large libraries: sent by the real Wrapyfi with the real library, taken apart by
//! one bridge and put together by another, and what the real Wrapyfi makes of them.
//!
//! ```text
//!   Wrapyfi ── zeromq:/from ──▶ bridge ── ros2:/graph ──▶ bridge ── zeromq:/to ──▶ Wrapyfi
//!                       pickle, zip, npy ─▶ plain tensors ─▶ pickle, zip, npy
//! ```
//!
//! Not part of `make test`: the libraries take 3 GB. `make test-frameworks` installs and runs all;
//! without `WRAPYFI_FRAMEWORKS=1` every test here is skipped.

use std::io::Write as _;

use wrapyfi_e2e::{Need, Result, Route, TestEnv, run, texts};

/// Runs a test where the libraries are, and says so where they are not.
fn with_library(
    test: &str,
    package: &'static str,
    body: impl FnOnce(&TestEnv) -> Result,
) -> Result {
    if !std::env::var("WRAPYFI_FRAMEWORKS").is_ok_and(|value| value == "1") {
        writeln!(std::io::stderr(), "SKIPPED {test}: run `make test-frameworks`")?;
        return Ok(());
    }
    run(test, &[Need::Program, Need::Python, Need::Package(package)], body)
}

/// `case` of `test/peers/frameworks.py` arrives as it was sent, and nothing of it crosses the graph
/// as a plug-in object that a ROS program could not read.
fn travels(test: &str, package: &'static str, case: &str) -> Result {
    with_library(test, package, |env| {
        let (from, to, graph) = (env.topic("from"), env.topic("to"), env.topic("graph"));
        let (ros, object) = (format!("ros2:{graph}"), "NativeObject");
        let into = env.embedded().route(Route::new(&format!("zeromq:{from}"), &ros, object));
        let out_of = env.foreign().route(Route::new(&ros, &format!("zeromq:{to}"), object));
        let bridge = env.bridge(&into)?;
        // A bridge does not hear what it said itself, so the way back is another one's.
        let file = env.write("back.yaml", out_of.yaml())?.display().to_string();
        let back = env.wrapyfi(["bridge", "--config", &file])?;
        let observer = env.dds_subscriber(&graph, "wrapyfi_msgs/msg/NativeObject", "--count 2")?;
        let options = format!("--cases frameworks --case {case}");
        let listener = env.wrapyfi_listener(&to, &format!("{options} --count 2"))?;
        let publisher = env.wrapyfi_publisher(&from, &format!("{options} --no-broker"))?;

        let heard = listener.messages(2).map_err(|e| e.context(back.tail()))?;
        publisher.sent_in_order("sha256", &texts(&heard, "sha256"))?;
        let tensors = heard[0]["facts"].as_object().map_or(0, serde_json::Map::len);
        assert!(tensors >= 5, "{tensors} tensors arrived");
        for message in observer.messages(2).map_err(|e| e.context(bridge.tail()))? {
            let json = message["fields"]["json"].as_str().unwrap_or_default();
            let tags = json.matches(r#""__wrapyfi__": ["#).count();
            let tensors = json.matches(r#""__wrapyfi__": ["tensor", "#).count();
            assert!(tensors > 0 && tensors == tags, "not all are tensors in the graph: {json}");
        }
        Ok(())
    })
}

macro_rules! travels {
    ($($test:ident: $package:literal, $case:literal;)*) => {
        $(#[test]
        fn $test() -> Result {
            travels(stringify!($test), $package, $case)
        })*
    };
}

travels! {
    pytorch_tensors_travel: "torch", "torch";
    jax_arrays_travel: "jax", "jax";
    trax_arrays_travel: "jax", "trax";
    tensorflow_tensors_travel: "tensorflow", "tensorflow";
    paddle_tensors_travel: "paddle", "paddle";
    zarr_arrays_travel: "zarr", "zarr";
    dask_arrays_travel: "dask", "dask";
}

/// The same tensors between methods of the package for Python, which makes them by the library itself.
fn travels_in_python(test: &str, package: &'static str, case: &str) -> Result {
    with_library(test, package, |env| {
        let _broker = env.broker()?;
        let mut script = env.our_peer("python_frameworks.py", case)?;
        script.exits_with(0)?;
        assert_eq!(script.stdout(), "all", "{}", script.stderr());
        Ok(())
    })
}

macro_rules! travels_in_python {
    ($($test:ident: $package:literal, $case:literal;)*) => {
        $(#[test]
        fn $test() -> Result {
            travels_in_python(stringify!($test), $package, $case)
        })*
    };
}

travels_in_python! {
    python_carries_pytorch_tensors: "torch", "torch";
    python_carries_jax_arrays: "jax", "jax";
    python_carries_tensorflow_tensors: "tensorflow", "tensorflow";
    python_carries_paddle_tensors: "paddle", "paddle";
    python_carries_zarr_arrays: "zarr", "zarr";
    python_carries_dask_arrays: "dask", "dask";
}

/// `devices` of a route: what the script has on its CPU is labelled for a GPU in the graph.
#[test]
fn a_route_says_where_tensors_go() -> Result {
    with_library("a_route_says_where_tensors_go", "torch", |env| {
        let (from, graph) = (env.topic("from"), env.topic("graph"));
        let route = Route::new(&format!("zeromq:{from}"), &format!("ros2:{graph}"), "NativeObject");
        let devices = "{ map_torch_devices: { cpu: 'cuda:7' }, load_torch_device: 'cuda:1' }";
        let bridge = env.bridge(&env.embedded().route(route.with("devices", devices)))?;
        let observer = env.dds_subscriber(&graph, "wrapyfi_msgs/msg/NativeObject", "--count 1")?;
        let options = "--cases frameworks --case torch --no-broker";
        let _publisher = env.wrapyfi_publisher(&from, options)?;
        let heard = observer.messages(1).map_err(|e| e.context(bridge.tail()))?;
        let tensors = heard[0]["fields"]["tensors"].as_array().map_or(&[][..], Vec::as_slice);
        assert!(tensors.len() > 10, "{} tensors", tensors.len());
        for tensor in tensors {
            assert_eq!(tensor["device"], "cuda:7", "{tensor}");
        }
        Ok(())
    })
}
