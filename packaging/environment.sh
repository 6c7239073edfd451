# Read by what builds packages: the same commit gives the same bytes, in whatever folder it is built.
# shellcheck shell=bash
SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct 2>/dev/null || stat -c %Y Cargo.toml)}
export SOURCE_DATE_EPOCH
# Paths of this machine are in no program. Not in a development build, where everything would be compiled again.
# Once, however many scripts read this: other flags would compile everything again.
if [ "${PROFILE:-dist}" = dist ] && [ -z "${WRAPYFI_REMAPPED:-}" ]; then
    export WRAPYFI_REMAPPED=1
    remapped=("$PWD=wrapyfi" "$(realpath -m "${CARGO_TARGET_DIR:-target}")=wrapyfi/target" "${CARGO_HOME:-$HOME/.cargo}=cargo")
    # Of the standard library, where its sources are installed.
    remapped+=("$(rustc --print sysroot)=rust")
    export RUSTFLAGS="${RUSTFLAGS:-} ${remapped[*]/#/--remap-path-prefix=}"
    # No panic passes through C, so that the way out of its functions is told to nobody: 0.1 MB.
    export CFLAGS="${CFLAGS:-} -fno-asynchronous-unwind-tables ${remapped[*]/#/-ffile-prefix-map=}"
    export CXXFLAGS="${CXXFLAGS:-} ${remapped[*]/#/-ffile-prefix-map=}"
fi
