#!/usr/bin/env bash
# Makes a release: one archive with the program, its documents and the licences of all that is in it.
#
#     tools/release.sh [OUTPUT_FOLDER]            # default: target/release-archive
#
# The program is for Linux x86-64. Where the toolchain has the target x86_64-unknown-linux-musl (rustup target add) and musl-gcc is there
# (Debian: musl-tools), it is static and runs on any such Linux; but then without the window (`view`), without graphics devices, whose
# drivers are loaded at run time, and without FLIP on the chart, which is C++. Elsewhere the program needs glibc and libstdc++, and the
# archive says which (in NEEDS). Environment:
#   RELEASE_TARGET (musl if it can be had)    the target to build for
set -euo pipefail
cd "$(dirname "$0")/.."
output=${1:-target/release-archive}
readonly MUSL=x86_64-unknown-linux-musl GNU=x86_64-unknown-linux-gnu

has_musl() { rustc --print target-libdir --target "$MUSL" 2> /dev/null | xargs -I{} test -d {} && command -v musl-gcc > /dev/null; }
target=${RELEASE_TARGET:-$(has_musl && echo "$MUSL" || echo "$GNU")}
features=()
[ "$target" != "$MUSL" ] || features=(--no-default-features)
# What is built for the machine itself lies where other builds lie, and is not built twice.
host=$(rustc -vV | sed -n 's/^host: //p')
if [ "$target" = "$host" ]; then
    cargo build --release --locked -p supervol-cli "${features[@]}"
    built=target/release/supervol
else
    cargo build --release --locked -p supervol-cli --target "$target" "${features[@]}"
    built=target/$target/release/supervol
fi
version=$(cargo metadata --format-version 1 --no-deps --locked | python3 -c '
import json, sys
print(next(p["version"] for p in json.load(sys.stdin)["packages"] if p["name"] == "supervol"))')
name=supervol-$version-$target
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
folder=$work/$name
mkdir -p "$folder/licences" "$folder/man" "$folder/completions"
program=$folder/supervol
cp "$built" "$program"
strip "$program"

# What the program needs of the machine that it runs on.
{
    if readelf -d "$program" | grep -q NEEDED; then
        echo "This program is linked dynamically. It needs Linux x86-64 with:"
        readelf -d "$program" | sed -n 's/.*(NEEDED).*\[\(.*\)\]/    \1/p'
        versions=$(objdump -T "$program" | grep -o 'GLIBC_[0-9.]*' | sort -Vu | tail -1)
        echo "glibc ${versions#GLIBC_} or newer."
        echo "Loaded when they are there: Vulkan (--backend gpu, view), X11 or Wayland (view)."
    else
        echo "This program is static: it needs Linux x86-64 and nothing else."
    fi
} > "$folder/NEEDS"

cp LICENSE README.md CHANGELOG.md "$folder"
"$program" man -o "$folder/man" --force
for shell in bash zsh fish; do "$program" completions "$shell" > "$folder/completions/supervol.$shell"; done
"$program" schema > "$folder/scene.schema.json"

# Licences: a table of all crates in the program, and the texts that they bring.
cargo metadata --format-version 1 --locked --filter-platform "$target" "${features[@]}" --manifest-path tools/supervol/Cargo.toml |
    python3 tools/licences.py "$folder/licences"

mkdir -p "$output"
tar -C "$work" --sort=name --owner=0 --group=0 --numeric-owner --mtime='@0' -czf "$output/$name.tar.gz" "$name"
(cd "$output" && sha256sum "$name.tar.gz" > "$name.tar.gz.sha256")
cat "$folder/NEEDS"
echo "$output/$name.tar.gz: $(du -h "$output/$name.tar.gz" | cut -f1), $(find "$folder/licences" -type f | wc -l) files of licences"
