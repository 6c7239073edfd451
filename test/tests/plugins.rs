//! Objects of other libraries: sent by the real Wrapyfi with the real library, carried by a bridge,
//! and what the real Wrapyfi, and a ROS program with `wrapyfi_py`, make of them on the other side.
//!
//! ```text
//!   Wrapyfi ── zeromq:/from ──▶ bridge ── zeromq:/to ──▶ Wrapyfi        the same object again
//!                                  └───── ros2:/graph ─▶ wrapyfi_py     the same, from its readable form
//!   Wrapyfi ── zeromq:/x ─────▶ wrapyfi echo                            in words
//!   wrapyfi_py ── ros2:/from ──▶ bridge ─ zeromq:/to ──▶ Wrapyfi        the same object again
//! ```

use serde_json::Value;
use wrapyfi_e2e::{Need, Result, Route, run, texts};

/// `case` of `test/peers/plugins.py` arrives as it was sent, and in the graph as `tag`.
fn travels(test: &str, package: &'static str, case: &str, tag: &str) -> Result {
    run(test, &[Need::Program, Need::Python, Need::Package(package)], |env| {
        let (from, to, graph) = (env.topic("from"), env.topic("to"), env.topic("graph"));
        let (source, object) = (format!("zeromq:{from}"), "NativeObject");
        let config = env
            .embedded()
            .route(Route::new(&source, &format!("zeromq:{to}"), object))
            .route(Route::new(&source, &format!("ros2:{graph}"), object));
        let bridge = env.bridge(&config)?;
        let ros = env.dds_subscriber(&graph, NATIVE_OBJECT, &in_python(case, tag))?;
        let listener = env.wrapyfi_listener(&to, &format!("--case {case} --count 2"))?;
        let publisher = env.wrapyfi_publisher(&from, &format!("--case {case} --no-broker"))?;

        let heard = listener.messages(2).map_err(|e| e.context(bridge.tail()))?;
        publisher.sent_in_order("sha256", &texts(&heard, "sha256"))?;
        let seen = ros.messages(2).map_err(|e| e.context(bridge.tail()))?;
        if is_read_in_python(tag) {
            publisher.sent_in_order("sha256", &texts(&seen, "sha256"))?;
        }
        for message in seen {
            let json = message["fields"]["json"].as_str().unwrap_or_default();
            let wanted = format!(r#"{{"object": {{"__wrapyfi__": ["{tag}", "#);
            assert!(json.starts_with(&wanted), "not as {tag:?} in the graph: {json}");
        }
        Ok(())
    })
}

const NATIVE_OBJECT: &str = "wrapyfi_msgs/msg/NativeObject";

/// True when the graph has a form of its own for objects that arrive there as `tag`. `wrapyfi_py`
/// reads no pickle.
fn is_read_in_python(tag: &str) -> bool {
    ["tuple", "tensor", "table", "picture", "labelled", "quantity"].contains(&tag)
}

fn in_python(case: &str, tag: &str) -> String {
    let case = if is_read_in_python(tag) { format!("--case {case}") } else { String::new() };
    format!("--count 2 {case}")
}

/// `case` of `test/peers/plugins.py` arrives at the real Wrapyfi as a ROS program made it a message.
fn travels_from_ros(test: &str, package: &'static str, case: &str) -> Result {
    run(test, &[Need::Program, Need::Python, Need::Package(package)], |env| {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let route = Route::new(&format!("ros2:{from}"), &format!("zeromq:{to}"), "NativeObject");
        let bridge = env.bridge(&env.embedded().route(route))?;
        let listener = env.wrapyfi_listener(&to, &format!("--case {case} --count 2"))?;
        let publisher = env.dds_publisher(&from, NATIVE_OBJECT, &format!("--case {case}"))?;
        let heard = listener.messages(2).map_err(|e| e.context(bridge.tail()))?;
        publisher.sent_in_order("sha256", &texts(&heard, "sha256"))
    })
}

/// A Wrapyfi script that publishes its frames as native objects: ROS gets them as images.
fn arrives_as_an_image(
    test: &str,
    package: &'static str,
    peer: &str,
    fields: &[(&str, Value)],
) -> Result {
    run(test, &[Need::Program, Need::Python, Need::Package(package)], |env| {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let route = Route::new(&format!("zeromq:{from}"), &format!("ros2:{to}"), "Image");
        let route = route.with("from_type", "NativeObject");
        let bridge = env.bridge(&env.embedded().route(route))?;
        let ros = env.dds_subscriber(&to, "sensor_msgs/msg/Image", "--count 2")?;
        let publisher = env.wrapyfi_publisher(&from, &format!("{peer} --no-broker"))?;
        let heard = ros.messages(2).map_err(|e| e.context(bridge.tail()))?;
        publisher.sent_in_order("pixels", &texts(&heard, "sha256"))?;
        for message in &heard {
            for (name, value) in fields {
                assert_eq!(&message["fields"][*name], value, "field {name} of {message}");
            }
            assert!(message["stamp"].as_f64().is_some_and(|s| s > 1.7e9), "no time: {message}");
        }
        Ok(())
    })
}

/// `wrapyfi echo` says to a person what Wrapyfi publishes: the lines that `words` makes of the facts that
/// the publisher tells.
fn is_said(
    test: &str,
    package: &'static str,
    case: &str,
    words: impl Fn(&Value) -> Vec<String>,
) -> Result {
    run(test, &[Need::Program, Need::Python, Need::Package(package)], |env| {
        let topic = env.topic("x");
        let publisher = env.wrapyfi_publisher(&topic, &format!("--case {case} --bare"))?;
        let endpoint = format!("zeromq:{topic}");
        let args = ["echo", &endpoint, "--type", "NativeObject", "--count", "1"];
        let mut echo = env.wrapyfi(args.into_iter().chain(["--timeout", "100"]))?;
        echo.exits_with(0)?;
        let said: Vec<String> = echo.stdout().lines().map(str::to_owned).collect();
        let told = publisher.wait_until("what was published up to then", |output| {
            let sent = output.events("message");
            let told: Vec<_> = sent.iter().map(|one| words(&one["facts"])).collect();
            // The publisher tells of a message after it was sent.
            (told.contains(&said) || told.len() > 200).then_some(told)
        })?;
        assert!(told.contains(&said), "{said:#?} is not among {:#?}", told.first());
        Ok(())
    })
}

#[test]
fn echo_says_how_large_a_picture_is() -> Result {
    is_said("echo_says_how_large_a_picture_is", "PIL", "pillowfile", |_| {
        vec!["Picture 64x48 png".to_owned()]
    })
}

#[test]
fn echo_says_the_rows_of_a_table() -> Result {
    is_said("echo_says_the_rows_of_a_table", "pandas", "pandasframe", |facts| {
        let first = facts["values"][0][0].as_str().unwrap_or_default();
        let width = first.len();
        [
            "DataFrame, 2 rows of 4 columns".to_owned(),
            format!("  row     {:width$}  s  t", "a"),
            format!("  first   {first}  x  2024-01-01 00:00:00"),
            format!("  second  {:width$}  -  2024-01-02 00:00:00", "2"),
        ]
        .to_vec()
    })
}

#[test]
fn echo_says_a_quantity_with_its_unit() -> Result {
    is_said("echo_says_a_quantity_with_its_unit", "pint", "pint", |facts| {
        let units = facts["units"].as_str().unwrap_or_default();
        vec![format!("{} {units}", facts["magnitude"])]
    })
}

#[test]
fn echo_says_the_numbers_of_an_array() -> Result {
    is_said("echo_says_the_numbers_of_an_array", "numpy", "numpy", |facts| {
        let values = facts["values"].to_string().replace(',', ", ");
        vec![format!("array int32 (2, 3): {values}")]
    })
}

#[test]
fn an_array_arrives_as_an_image() -> Result {
    arrives_as_an_image(
        "an_array_arrives_as_an_image",
        "numpy",
        "--case frame --bare",
        &[("encoding", "bgr8".into()), ("width", 64.into()), ("height", 48.into())],
    )
}

#[test]
fn a_pillow_image_arrives_as_an_image() -> Result {
    arrives_as_an_image(
        "a_pillow_image_arrives_as_an_image",
        "PIL",
        "--case pillowfile --bare",
        // Decompressed to the order of the route; which is which, the encoding says.
        &[("encoding", "bgr8".into()), ("width", 64.into()), ("height", 48.into())],
    )
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
    python_objects_travel: "numpy", "builtins" as "tuple";
    pint_quantities_travel: "pint", "pint" as "quantity";
    pillow_files_travel: "PIL", "pillowfile" as "picture";
    pillow_palettes_travel: "PIL", "pillowp" as "picture";
    pillow_inks_travel: "PIL", "pillowcmyk" as "picture";
    pillow_colour_images_travel: "PIL", "pillowrgb" as "picture";
    pillow_grey_images_travel: "PIL", "pillowl" as "picture";
    pillow_images_with_alpha_travel: "PIL", "pillowrgba" as "picture";
    pillow_images_of_bits_travel: "PIL", "pillowbits" as "picture";
    pillow_images_of_floats_travel: "PIL", "pillowf" as "picture";
    pillow_images_of_integers_travel: "PIL", "pillowi" as "picture";
    pillow_images_of_16_bits_travel: "PIL", "pillowi16" as "picture";
    pandas_frames_travel: "pandas", "pandasframe" as "table";
    pandas_frames_of_every_type_travel: "pandas", "pandastypes" as "table";
    pandas_series_travel: "pandas", "pandasseries" as "table";
    pandas_indices_travel: "pandas", "pandasindex" as "table";
    pyarrow_arrays_travel: "pyarrow", "arrowarray" as "table";
    pandas_columns_of_arrow_types_travel: "pandas", "pandasarrow" as "table";
    pandas_zones_and_periods_travel: "pandas", "pandastimes" as "table";
    pandas_regular_times_travel: "pandas", "pandasfreq" as "table";
    pandas_labels_of_several_levels_travel: "pandas", "pandaslevels" as "table";
    pandas_labels_that_are_equal_travel: "pandas", "pandastwice" as "table";
    pandas_objects_of_any_kind_travel: "pandas", "pandasobjects" as "table";
    pandas_intervals_travel: "pandas", "pandasintervals" as "table";
    pyarrow_decimals_travel: "pyarrow", "arrowdecimal" as "table";
    pyarrow_maps_travel: "pyarrow", "arrowmap" as "table";
    pyarrow_structs_travel: "pyarrow", "arrowstruct" as "table";
    pyarrow_lists_travel: "pyarrow", "arrowlist" as "table";
    pyarrow_scalars_travel: "pyarrow", "arrowscalar" as "table";
    xarray_arrays_travel: "xarray", "xarray" as "labelled";
    xarray_data_sets_travel: "xarray", "xarrayset" as "labelled";
}

macro_rules! travels_from_ros {
    ($($test:ident: $package:literal, $case:literal;)*) => {
        $(#[test]
        fn $test() -> Result {
            travels_from_ros(stringify!($test), $package, $case)
        })*
    };
}

travels_from_ros! {
    numpy_arrays_travel_from_ros: "numpy", "numpy";
    python_objects_travel_from_ros: "numpy", "builtins";
    pint_quantities_travel_from_ros: "pint", "pint";
    pillow_images_travel_from_ros: "PIL", "pillowrgb";
    pandas_frames_travel_from_ros: "pandas", "pandasframe";
    pandas_frames_of_every_type_travel_from_ros: "pandas", "pandastypes";
    pandas_labels_of_several_levels_travel_from_ros: "pandas", "pandaslevels";
    pandas_labels_that_are_equal_travel_from_ros: "pandas", "pandastwice";
    pandas_series_travel_from_ros: "pandas", "pandasseries";
    pandas_indices_travel_from_ros: "pandas", "pandasindex";
    pandas_objects_of_any_kind_travel_from_ros: "pandas", "pandasobjects";
    pandas_intervals_travel_from_ros: "pandas", "pandasintervals";
    pyarrow_decimals_travel_from_ros: "pyarrow", "arrowdecimal";
    pyarrow_maps_travel_from_ros: "pyarrow", "arrowmap";
    pyarrow_arrays_travel_from_ros: "pyarrow", "arrowarray";
    xarray_arrays_travel_from_ros: "xarray", "xarray";
    xarray_data_sets_travel_from_ros: "xarray", "xarrayset";
    pillow_files_travel_from_ros: "PIL", "pillowfile";
    pillow_inks_travel_from_ros: "PIL", "pillowcmyk";
    pillow_grey_images_travel_from_ros: "PIL", "pillowl";
    pillow_images_with_alpha_travel_from_ros: "PIL", "pillowrgba";
    pillow_images_of_bits_travel_from_ros: "PIL", "pillowbits";
    pillow_images_of_floats_travel_from_ros: "PIL", "pillowf";
    pillow_images_of_integers_travel_from_ros: "PIL", "pillowi";
    pillow_images_of_16_bits_travel_from_ros: "PIL", "pillowi16";
    pandas_columns_of_arrow_types_travel_from_ros: "pandas", "pandasarrow";
    pandas_zones_and_periods_travel_from_ros: "pandas", "pandastimes";
    pandas_regular_times_travel_from_ros: "pandas", "pandasfreq";
    pyarrow_structs_travel_from_ros: "pyarrow", "arrowstruct";
    pyarrow_lists_travel_from_ros: "pyarrow", "arrowlist";
    pyarrow_scalars_travel_from_ros: "pyarrow", "arrowscalar";
}
