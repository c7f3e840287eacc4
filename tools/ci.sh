#!/usr/bin/env bash
# Everything that must hold before a change is taken, in one command: formatting, lints, documents, tests (shader
# validation and GPU tests among them, on a software adapter where there is no other), fuzzing, the demo, the
# viewer in a real window, a soak, and files held against other programs' readers.
#
#   tools/ci.sh            all steps
#   tools/ci.sh tests      only the steps named: format clippy documents portable tests audit fuzz examples demo window readers soak
#
# Works on a fresh Debian 12 with Rust 1.95; installs what is missing by apt. Environment:
#   FUZZ_SECONDS (7)       seconds per fuzz target
#   SOAK_MINUTES (2)       minutes of builds and pictures under random faults
#   CI_KEEP (unset)        keep the logs in this folder
#   SUPERVOL_DATA (../shared/data)       real files, for `readers`
#   CI (unset)             true: it is a failure where these files or the Python readers cannot be had
#   SUPERVOL_REQUIRE_READERS (by CI)     1 or 0: the same, or not, whatever CI is
# Steps are called by name through `step`.
# shellcheck disable=SC2329
set -euo pipefail

cd "$(dirname "${BASH_SOURCE[0]}")/.."

readonly ALL_STEPS=(format clippy documents portable tests audit fuzz examples demo window readers soak)
readonly MIN_FREE_GB=10
# Other systems that the code must compile for.
readonly PORTABLE_TARGETS=(x86_64-pc-windows-gnu aarch64-apple-darwin aarch64-unknown-linux-gnu)
readonly FUZZ_SECONDS="${FUZZ_SECONDS:-7}"
readonly FUZZ_SEED=1
readonly INSTALL_TRIES=3
readonly SOAK_MINUTES="${SOAK_MINUTES:-2}"
# Parts of the names of tests that share a device.
readonly ONE_DEVICE="gpu_images::|graphics_devices"
readonly FUZZ_TARGETS=(container journal codec_raw codec_rle codec_zstd codec_wavelet codec_trimmed codec_tree segy nrrd metaimage nifti npy dicom dicom_frames tiff vti vtk zarr zarr3 n5 hdf5 archives slices viewer_xml)

started=$SECONDS
work="$(mktemp -d)"
logs="${CI_KEEP:-$work/logs}"
mkdir -p "$logs"
trap 'rm -rf "$work"' EXIT

say() { printf '%s\n' "$*"; }
fail() { printf 'ci: FAILED: %s\n' "$*" >&2; exit 1; }

# spent: sets $processor_s to the processor seconds of all commands that this shell has waited for.
spent() {
    local file="$work/times.$BASHPID"
    times >"$file"
    processor_s="$(awk 'NR == 2 { gsub(/[ms]/, " "); print int($1 * 60 + $2 + $3 * 60 + $4) }' "$file")"
}

# step NAME COMMAND...: announces, runs, times; the output goes to the terminal and to a log. A step that fails does not
# stop the others: one run names everything that is wrong.
step() {
    local name="$1" begun=$SECONDS result="ok" processor_s before_s line
    shift
    say ""
    say "=== $name"
    spent
    before_s=$processor_s
    # In a subshell with -e of its own: bash switches -e off in functions whose status is asked for.
    set +e
    (set -e; "$@") 2>&1 | tee "$logs/${name// /-}.log"
    if [ "${PIPESTATUS[0]}" -ne 0 ]; then
        result="FAILED"
        say "$name" >>"$work/failed.txt"
    fi
    set -e
    spent
    line="$(printf '%5d s  %5d processor s  %-6s  %s' $((SECONDS - begun)) $((processor_s - before_s)) "$result" "$name")"
    say "$line" >>"$work/steps.txt"
    say "--- $line"
}

# as_root COMMAND...: runs it as root, or says that it cannot.
as_root() {
    if [ "$(id -u)" -eq 0 ]; then
        "$@"
    elif command -v sudo >/dev/null && sudo -n true 2>/dev/null; then
        sudo -n "$@"
    else
        fail "not root and no sudo without a password; run this first: $*"
    fi
}

# install WHY PACKAGE...: by apt, with fresh lists only if the old ones do not do.
install() {
    local why="$1"
    shift
    command -v apt-get >/dev/null || fail "$why: install the equivalent of the Debian packages $* by hand"
    say "ci: installing $* ($why)"
    if ! as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends "$@" >"$logs/apt.log" 2>&1; then
        as_root apt-get update -q >>"$logs/apt.log" 2>&1 || fail "apt-get update: see $(tail -n 3 "$logs/apt.log")"
        as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends "$@" >>"$logs/apt.log" 2>&1 ||
            fail "apt cannot install $*: $(tail -n 3 "$logs/apt.log")"
    fi
}

# The Vulkan driver description of the software adapter, if it is installed.
lavapipe() {
    local folder file
    for folder in /usr/share/vulkan/icd.d /usr/local/share/vulkan/icd.d /etc/vulkan/icd.d; do
        for file in "$folder"/lvp_icd*.json; do
            if [ -e "$file" ]; then
                printf '%s' "$file"
                return
            fi
        done
    done
}

has_library() {
    ldconfig -p 2>/dev/null | grep -q "$1" || /sbin/ldconfig -p 2>/dev/null | grep -q "$1"
}

prepare() {
    local free_gb
    free_gb=$(($(df --output=avail -k . | tail -n 1) / 1024 / 1024))
    if [ "$free_gb" -lt "$MIN_FREE_GB" ]; then
        fail "$free_gb GB free in $PWD; the builds need $MIN_FREE_GB GB"
    fi
    command -v cargo >/dev/null || fail "no cargo; install Rust 1.95 or newer (https://rustup.rs)"
    cargo fmt --version >/dev/null 2>&1 || rustup component add rustfmt
    cargo clippy --version >/dev/null 2>&1 || rustup component add clippy
    if ! command -v cc >/dev/null || ! command -v c++ >/dev/null; then
        install "C and C++ compilers, for zstd and libFuzzer" build-essential
    fi
    if [ -z "$(lavapipe)" ] || ! has_library libvulkan.so.1; then
        install "a Vulkan driver that needs no GPU" mesa-vulkan-drivers libvulkan1
    fi

    # The software adapter, so that every machine tests the same; another driver may be named by VK_DRIVER_FILES.
    if [ -z "${VK_DRIVER_FILES:-}" ] && [ -n "$(lavapipe)" ]; then
        VK_DRIVER_FILES="$(lavapipe)"
        export VK_DRIVER_FILES
        export VK_ICD_FILENAMES="$VK_DRIVER_FILES"
    fi
    export XDG_RUNTIME_DIR="$work/runtime"
    mkdir -m 700 "$XDG_RUNTIME_DIR"
    export SUPERVOL_REQUIRE_GPU=1
    # A fresh clone has nothing that an incremental build could go on from.
    if [ ! -d "${CARGO_TARGET_DIR:-target}/debug" ]; then
        export CARGO_INCREMENTAL=0
        # Line tables serve backtraces alone, which are off below. Panics name their file and line without them.
        export CARGO_PROFILE_DEV_DEBUG=none
    fi
    # Many tests see to it that something panics, and pass: their backtraces would hide what fails.
    export RUST_BACKTRACE=0
    say "ci: $(rustc --version), $(nproc) cores, $free_gb GB free, Vulkan driver ${VK_DRIVER_FILES:-of the system}"
}

clippy() {
    cargo clippy --workspace --all-targets --locked -- -D warnings
    # Without the GPU engine, as programs without wgpu build the runtime; and one bench alone, with all that it depends on.
    cargo clippy -p supervol-runtime -p supervol-benches --no-default-features --lib --bench tree --locked -- -D warnings
}

# All libraries, and the programs whose names no library has. The example brings the dependencies of tests, and with
# them the features that clippy has checked everything with: otherwise the graphics and window crates are checked twice.
documents() {
    RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps --locked --lib --bin formats --bin supervol-view \
        --example open_and_draw
}

# Type checks for other systems, those that the toolchain has. Nothing is linked, hence no C compiler for them is needed:
# pkg-config names the machine's own zstd. All default features but FLIP, which is C++.
portable() {
    local target targets=()
    for target in "${PORTABLE_TARGETS[@]}"; do
        if [ -d "$(rustc --print target-libdir --target "$target" 2>/dev/null)" ]; then
            targets+=("--target=$target")
        else
            say "SKIPPED: $target: not compiled; to have it compiled: rustup target add $target"
        fi
    done
    [ "${#targets[@]}" -gt 0 ] || return 0
    if ! pkg-config --exists libzstd 2>/dev/null; then
        install "zstd for checks of other targets" pkg-config libzstd-dev
    fi
    say "portable: ${targets[*]}"
    ZSTD_SYS_USE_PKG_CONFIG=1 PKG_CONFIG_ALLOW_CROSS=1 RUSTFLAGS="-D warnings" cargo check --locked --no-default-features \
        --features supervol-cli/gpu,supervol-measure/gpu -p supervol-cli -p supervol-viewer -p supervol-measure "${targets[@]}"
}

# Tests print what they skip and measure on standard error; --success-output shows it for those that pass, too. The whole output
# goes to a log; on the terminal there is of tests that pass only that, and of others everything, at the end.
tests() {
    local on_one_device status=0
    if ! command -v cargo-nextest >/dev/null; then
        cargo test --workspace --locked --no-fail-fast --lib --bins --tests -- --show-output
        return
    fi
    built
    tests_on_one_device >"$logs/tests-on-one-device.txt" 2>&1 &
    on_one_device=$!
    cargo nextest run --workspace --locked --no-fail-fast --color never -E "not (binary(pictures) & test(/$ONE_DEVICE/))" \
        --status-level slow --final-status-level fail --success-output final --failure-output final 2>&1 |
        tee "$logs/tests-in-full.txt" |
        awk '/^ +(PASS|LEAK) +\[/ { hidden = 1 }
             /^ +[A-Z-]+ +\[/ && !/^ +(PASS|LEAK) +\[/ { hidden = 0 }
             !hidden || /SKIPPED:|MEASURED:/ { print; fflush() }' || status=1
    if wait "$on_one_device"; then
        grep -E "^test result|SKIPPED:|MEASURED:" "$logs/tests-on-one-device.txt" || true
    else
        status=1
        cat "$logs/tests-on-one-device.txt"
    fi
    [ "$status" -eq 0 ]
}

# nextest gives each test a process. These tests share one, and one device, which compiles each shader once: pipelines
# take most of their time. They give way to the others, some of which have deadlines.
tests_on_one_device() {
    # shellcheck disable=SC2086  # words of a list
    nice -n 10 cargo test --quiet --workspace --locked --test pictures -- --test-threads 1 --show-output ${ONE_DEVICE//|/ }
}

# Licences, known advisories and origin of all dependencies, held against tools/dependencies.json.
audit() { cargo test --quiet --workspace --locked --test dependencies; }

# The program and the examples as the tests have built them: naming one package would build most of it again, with other features.
built() { cargo test --quiet --workspace --locked --no-run; }

doc_tests() { cargo test --workspace --locked --doc; }

# Builds the libFuzzer targets with the stable compiler: coverage, no sanitizer (our crates hold next to no unsafe
# code; overflow checks and debug assertions are on).
fuzz_build() {
    local flags=(
        "-Cpasses=sancov-module"
        "-Cllvm-args=-sanitizer-coverage-level=4"
        "-Cllvm-args=-sanitizer-coverage-inline-8bit-counters"
        "-Cllvm-args=-sanitizer-coverage-pc-table"
        "-Cllvm-args=-sanitizer-coverage-trace-compares"
        "--cfg=fuzzing"
    )
    CARGO_TARGET_DIR="$fuzz_target" RUSTFLAGS="${flags[*]}" \
        cargo build --release --locked --manifest-path fuzz/Cargo.toml --target "$host"
    built
    "$built_target/examples/fuzz_corpus" "$work/corpus"
}

# fuzz_one TARGET: its own folders, so that several run at once.
fuzz_one() {
    local target="$1" found="$work/found/$1"
    mkdir -p "$found/inputs"
    if ! "$fuzz_target/$host/release/$target" "$found/inputs" "$work/corpus/$target" \
        -seed="$FUZZ_SEED" -max_total_time="$FUZZ_SECONDS" -rss_limit_mb=512 -timeout=10 -max_len=4096 \
        -artifact_prefix="$found/" -verbosity=0 -print_final_stats=1 >"$logs/fuzz-$target.log" 2>&1; then
        say "fuzz: $target FAILED: $(tail -n 40 "$logs/fuzz-$target.log")"
        base64 -w 0 "$found"/*-* 2>/dev/null || true
        return 1
    fi
    say "fuzz: $target: $(awk '/number_of_executed_units/ {print $2}' "$logs/fuzz-$target.log") inputs, no failure"
}

# As many targets at a time as there are processors.
fuzz_run() {
    local target pid failures=0 pids=()
    for target in "${FUZZ_TARGETS[@]}" ""; do
        if [ -z "$target" ] || [ "${#pids[@]}" -ge "$(nproc)" ]; then
            for pid in "${pids[@]}"; do
                wait "$pid" || failures=$((failures + 1))
            done
            pids=()
        fi
        if [ -n "$target" ]; then
            fuzz_one "$target" &
            pids+=("$!")
        fi
    done
    [ "$failures" -eq 0 ] || { say "fuzz: $failures targets failed"; return 1; }
}

# The programs in crates/supervol/examples, on the sample volume.
examples() {
    built
    local examples="$built_target/examples" sample=tests/data/carp_ct.nii.gz out="$work/examples"
    export XDG_CACHE_HOME="$work/cache"
    mkdir -p "$out"
    "$examples/open_and_draw" "$sample" "$out/carp.png"
    "$examples/orbit" "$sample" "$out/orbit"
    "$examples/read_box" "$sample"
    "$examples/build_from_array" "$out/built"
    "$examples/own_engine" "$sample" "$out/slabs.png"
    "$examples/error_map" "$sample" "$out/errors"
    local file
    for file in carp.png orbit/converged.png built/waves.png slabs.png errors/picture.png errors/errors.npy; do
        [ -s "$out/$file" ] || fail "the examples made no $file"
    done
}

demo() {
    built
    "$program" demo --output "$work/demo"
    local file
    for file in carp.svol carp.png seismic.svol seismic.png; do
        [ -s "$work/demo/$file" ] || fail "the demo made no $file"
    done
    "$program" verify "$work/demo/seismic.svol"
}

# The viewer in a real window. `supervol` itself needs no windowing libraries, no plots of reports and no C++.
window() {
    local tool
    for tool in Xvfb xdotool import; do
        if ! command -v "$tool" >/dev/null; then
            install "a display without a screen, a mouse without a hand" xvfb xdotool imagemagick
            break
        fi
    done
    has_library libxkbcommon-x11.so || install "what windows need" libxkbcommon-x11-0 libxcursor1 libxi6 libxrandr2
    built
    tools/window.sh "$program" "$logs/window"
    if cargo tree --locked -p supervol-cli -e normal | grep -E "eframe|winit|nv-flip"; then
        fail "supervol needs windowing libraries or C++"
    fi
}

soak() {
    built
    SUPERVOL="$program" tools/soak.sh "$SOAK_MINUTES"
}

# Says what was not compared; a failure in CI, or where it is asked for.
without_readers() {
    say "SKIPPED: $1: no file was held against an independent reader"
    local is_required=0
    [ "${CI:-}" != true ] || is_required=1
    if [ "${SUPERVOL_REQUIRE_READERS:-$is_required}" = 1 ]; then
        say "ci: this may not be skipped here (CI=${CI:-}, SUPERVOL_REQUIRE_READERS=${SUPERVOL_REQUIRE_READERS:-}): decision 020"
        return 1
    fi
}

# The Python readers, in an environment of their own. An index that hiccups is asked again.
install_readers() {
    local python="$readers_home/bin/python" try
    if [ -e "$readers_home/complete" ] && cmp -s tools/readers.txt "$readers_home/complete"; then
        return 0
    fi
    if ! python3 -c "import ensurepip, venv" 2>/dev/null; then
        (install "Python environments, for independent readers" python3 python3-venv) || return 1
    fi
    for ((try = 1; try <= INSTALL_TRIES; try++)); do
        rm -rf "$readers_home"
        if python3 -m venv "$readers_home" &&
            timeout 600 "$python" -m pip install --quiet --timeout 60 --retries 3 -r tools/readers.txt; then
            cp tools/readers.txt "$readers_home/complete"
            return 0
        fi
        say "ci: try $try of $INSTALL_TRIES to install the Python readers failed"
        [ "$try" -eq "$INSTALL_TRIES" ] || sleep $((10 * try))
    done
    return 1
}

# Every real file, and every format that is written, against SimpleITK, VTK, pydicom, tifffile, zarr, tensorstore, nibabel, pynrrd, segyio and h5py, in a
# virtual environment of their own.
readers() {
    local data="${SUPERVOL_DATA:-../shared/data}"
    if [ ! -d "$data" ]; then
        without_readers "the data folder $data is not there"
        return
    fi
    if ! install_readers; then
        without_readers "the Python readers of tools/readers.txt cannot be installed"
        return
    fi
    built
    "$readers_home/bin/python" tools/readers.py "$program" "$data" "$work/readers" docs/formats.md
}

wanted() {
    local name
    for name in "${steps[@]}"; do
        [ "$name" = "$1" ] && return 0
    done
    return 1
}

main() {
    steps=("$@")
    [ "$#" -gt 0 ] || steps=("${ALL_STEPS[@]}")
    local name
    for name in "${steps[@]}"; do
        [[ " ${ALL_STEPS[*]} " == *" $name "* ]] || fail "no step '$name'; steps are: ${ALL_STEPS[*]}"
    done

    prepare
    host="$(rustc -vV | awk '/^host:/ {print $2}')"
    built_target="${CARGO_TARGET_DIR:-$PWD/target}/debug"
    program="$built_target/supervol"
    fuzz_target="${CARGO_TARGET_DIR:-$PWD/target}/fuzz"
    readers_home="${CARGO_TARGET_DIR:-$PWD/target}/readers"

    if wanted format; then
        step "format" cargo fmt --all --check
        step "format of the fuzz targets" cargo fmt --manifest-path fuzz/Cargo.toml --check
    fi
    if wanted clippy; then step "clippy" clippy; fi
    if wanted documents; then step "documents" documents; fi
    if wanted portable; then step "portable" portable; fi
    if wanted tests; then
        step "tests" tests
        step "doc tests" doc_tests
    fi
    # After the tests, which have built all of it.
    if wanted audit; then step "audit" audit; fi
    if wanted fuzz; then
        step "fuzz build" fuzz_build
        step "fuzz run" fuzz_run
    fi
    # The soak ends by the clock, and the others wait for windows and downloads: they run at the same time.
    local soaking=""
    if wanted soak; then
        step "soak" soak >"$work/soak.txt" 2>&1 &
        soaking=$!
    fi
    if wanted examples; then step "examples" examples; fi
    if wanted demo; then step "demo" demo; fi
    if wanted window; then step "window" window; fi
    if wanted readers; then step "readers" readers; fi
    if [ -n "$soaking" ]; then
        wait "$soaking" || true
        cat "$work/soak.txt"
    fi
    local failed_steps=()
    [ ! -e "$work/failed.txt" ] || mapfile -t failed_steps <"$work/failed.txt"

    say ""
    say "=== summary"
    cat "$work/steps.txt"
    printf '%5d s  in all\n' $((SECONDS - started))
    grep -h "MEASURED:" "$logs"/*.log | sort -u || true
    if grep -hq "SKIPPED: no GPU adapter" "$logs"/*.log; then
        fail "GPU tests were skipped: no adapter, in spite of $([ -n "$(lavapipe)" ] && echo "lavapipe" || echo "everything")"
    fi
    if grep -hq "SKIPPED:" "$logs"/*.log; then
        say ""
        say "!!! NOT EVERYTHING RAN:"
        grep -h "SKIPPED:" "$logs"/*.log | sed 's/^ */!!! /' | sort | uniq -c
    else
        say "ci: nothing was skipped"
    fi
    if [ "${#failed_steps[@]}" -gt 0 ]; then
        for name in "${failed_steps[@]}"; do
            say ""
            say "=== $name failed; the end of what it said:"
            tail -n 60 "$logs/${name// /-}.log"
        done
        fail "${failed_steps[*]/%/,} see above"
    fi
    say "ci: passed"
}

# One line, so that a script changed while it runs is not read on.
{ main "$@"; exit; }
