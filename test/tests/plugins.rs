//! Objects of other libraries: sent by the real Wrapyfi with the real library, carried by a bridge,
//! and what the real Wrapyfi makes of them on the other side.
//!
//! ```text
//!   Wrapyfi ── zeromq:/from ──▶ bridge ── zeromq:/to ──▶ Wrapyfi        the same object again
//!                                  └───── ros2:/graph ─▶ a ROS program  its readable form
//! ```

#![allow(clippy::indexing_slicing, reason = "in a test a panic is the right answer")]

use wrapyfi_e2e::{Need, Result, Route, run, texts};

/// `case` of `test/peers/plugins.py` arrives as it was sent, and in the graph as `tag`.
fn travels(test: &str, package: &'static str, case: &str, tag: &str) -> Result {
    run(test, &[Need::Program, Need::Python, Need::Package(package)], |world| {
        let (from, to, graph) = (world.topic("from"), world.topic("to"), world.topic("graph"));
        let (source, object) = (format!("zeromq:{from}"), "NativeObject");
        let config = world
            .embedded()
            .route(Route::new(&source, &format!("zeromq:{to}"), object))
            .route(Route::new(&source, &format!("ros2:{graph}"), object));
        let bridge = world.bridge(&config)?;
        let ros = world.dds_subscriber(&graph, "wrapyfi_msgs/msg/NativeObject", "--count 2")?;
        let listener = world.wrapyfi_listener(&to, &format!("--case {case} --count 2"))?;
        let publisher = world.wrapyfi_publisher(&from, &format!("--case {case} --no-broker"))?;

        let heard = listener.messages(2).map_err(|e| e.context(bridge.tail()))?;
        publisher.sent_in_order("sha256", &texts(&heard, "sha256"))?;
        for message in ros.messages(2).map_err(|e| e.context(bridge.tail()))? {
            let json = message["fields"]["json"].as_str().unwrap_or_default();
            let wanted = format!(r#"{{"object": {{"__wrapyfi__": ["{tag}", "#);
            assert!(json.starts_with(&wanted), "not as {tag:?} in the graph: {json}");
        }
        Ok(())
    })
}

macro_rules! travels {
    ($($test:ident: $package:literal, $case:literal as $tag:literal;)*) => {
        $(#[test]
        fn $test() -> Result {
            travels(stringify!($test), $package, $case, $tag)
        })*
    };
}

travels! {
    numpy_arrays_travel: "numpy", "numpy" as "tensor";
    pint_quantities_travel: "pint", "pint" as "quantity";
}
