#!/usr/bin/env bash
# Makes a release: one archive with the programs, their documents and the licences of all that is in them.
#
#     tools/release.sh [OUTPUT_FOLDER]            # default: target/release-archive
#
# The programs are for Linux x86-64: `supervol`, and beside it `supervol-measure` (`bench`, `chart`) and `supervol-view`
# (`view`). With the target x86_64-unknown-linux-musl (rustup target add) and musl-gcc (Debian: musl-tools) they are
# static and run on any such Linux. Static programs have no window (`view`), no graphics devices, whose drivers are loaded
# at run time, and no FLIP on the chart, which is C++. Without that target the programs need glibc and libstdc++; the file
# NEEDS in the archive names the versions. Environment:
#   RELEASE_TARGET (musl if it can be had)    the target to build for
set -euo pipefail
cd "$(dirname "$0")/.."
output=${1:-target/release-archive}
readonly MUSL=x86_64-unknown-linux-musl GNU=x86_64-unknown-linux-gnu

has_musl() { rustc --print target-libdir --target "$MUSL" 2> /dev/null | xargs -I{} test -d {} && command -v musl-gcc > /dev/null; }
target=${RELEASE_TARGET:-$(has_musl && echo "$MUSL" || echo "$GNU")}
packages=(supervol-cli supervol-measure)
programs=(supervol supervol-measure)
features=()
if [ "$target" = "$MUSL" ]; then
    features=(--no-default-features)
else
    packages+=(supervol-viewer)
    programs+=(supervol-view)
fi
# A build for the host itself uses the usual build folder, so that nothing is built twice.
host=$(rustc -vV | sed -n 's/^host: //p')
built=${CARGO_TARGET_DIR:-target}
if [ "$target" = "$host" ]; then
    cargo build --release --locked --bins "${packages[@]/#/--package=}" "${features[@]}"
    built+=/release
else
    cargo build --release --locked --bins "${packages[@]/#/--package=}" --target "$target" "${features[@]}"
    built+=/$target/release
fi
version=$(cargo metadata --format-version 1 --no-deps --locked | python3 -c '
import json, sys
print(next(p["version"] for p in json.load(sys.stdin)["packages"] if p["name"] == "supervol-cli"))')
archive=supervol-$version-$target
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
folder=$work/$archive
mkdir -p "$folder/licences" "$folder/man" "$folder/completions"
program=$folder/supervol
for name in "${programs[@]}"; do
    cp "$built/$name" "$folder/$name"
    strip "$folder/$name"
done

# Libraries that the programs need on the machine that runs them.
for name in "${programs[@]}"; do
    if readelf -d "$folder/$name" | grep -q NEEDED; then
        echo "$name is linked dynamically. It needs Linux x86-64 with:"
        readelf -d "$folder/$name" | sed -n 's/.*(NEEDED).*\[\(.*\)\]/    \1/p'
        versions=$(objdump -T "$folder/$name" | grep -o 'GLIBC_[0-9.]*' | sort -Vu | tail -1)
        echo "glibc ${versions#GLIBC_} or newer."
        echo "Loaded when they are there: Vulkan (--backend gpu, view), X11 or Wayland (view)."
    else
        echo "$name is static: it needs Linux x86-64 and nothing else."
    fi
done > "$folder/NEEDS"

cp LICENSE README.md CHANGELOG.md "$folder"
"$program" man -o "$folder/man" --force
for shell in bash zsh fish; do "$program" completions "$shell" > "$folder/completions/supervol.$shell"; done
"$program" schema > "$folder/scene.schema.json"

# Licences: a table of all crates in the programs, and the texts that they bring.
cargo metadata --format-version 1 --locked --filter-platform "$target" "${features[@]}" |
    python3 tools/licences.py "$folder/licences" "${packages[@]}"

mkdir -p "$output"
tar -C "$work" --sort=name --owner=0 --group=0 --numeric-owner --mtime='@0' -czf "$output/$archive.tar.gz" "$archive"
(cd "$output" && sha256sum "$archive.tar.gz" > "$archive.tar.gz.sha256")
cat "$folder/NEEDS"
echo "$output/$archive.tar.gz: $(du -h "$output/$archive.tar.gz" | cut -f1), $(find "$folder/licences" -type f | wc -l) files of licences"
