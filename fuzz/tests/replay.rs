//! Every file of every corpus, once: what a fuzzer found stays found.

use std::path::{Path, PathBuf};

use wrapyfi_fuzz::TARGETS;

fn corpus(target: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(target);
    let mut files: Vec<_> = std::fs::read_dir(&folder)
        .unwrap_or_else(|error| panic!("{}: {error}", folder.display()))
        .map(|entry| entry.unwrap().path())
        .collect();
    files.sort();
    files
}

/// The test of the same name in the table.
fn replay(name: &str) {
    let (_, target) = TARGETS.iter().find(|(target, _)| *target == name).unwrap();
    let files = corpus(name);
    assert!(!files.is_empty(), "no seeds");
    let mut failed = Vec::new();
    for file in files {
        let data = std::fs::read(&file).unwrap();
        if std::panic::catch_unwind(|| target(&data)).is_err() {
            failed.push(file.file_name().unwrap().to_string_lossy().into_owned());
        }
    }
    assert!(failed.is_empty(), "{name} does not hold for {failed:?}");
}

macro_rules! replays {
    ($($name:ident)*) => {
        $(
            #[test]
            fn $name() {
                replay(stringify!($name));
            }
        )*

        #[test]
        fn every_target_is_replayed() {
            let replayed = [$(stringify!($name)),*];
            assert_eq!(TARGETS.iter().map(|(name, _)| *name).collect::<Vec<_>>(), replayed);
            for (name, _) in TARGETS {
                let program = format!("targets/fuzz_targets/{name}.rs");
                assert!(Path::new(env!("CARGO_MANIFEST_DIR")).join(program).exists(), "{name}");
            }
        }
    };
}

replays! {
    json npy frames jpeg cdr msg_parser ros_args config plugin_tensor pickle plugin_table
    plugin_picture plugin_zarr node_services dynamic zeromq_requests yarp_bottle yarp_text
    yarp_object yarp_name_lines yarp_connection ros1_definition ros1_messages tcpros_header
    xmlrpc yarp_payload zeromq_probe zeromq_peer zeromq_counts ros2_discovery bridge_marks
    yarp_conf yarp_multicast mapping_rules bag
}
