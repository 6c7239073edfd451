//! The `wrapyfi` command with one middleware more: `wrapyfi_udp list udp`, `wrapyfi_udp bridge --config bridge.yaml`.

fn main() -> std::process::ExitCode {
    let drivers = [&wrapyfi_bridge::BUNDLED[..], &[wrapyfi_example_middleware::DRIVER]].concat();
    wrapyfi_bridge::main(&drivers)
}
