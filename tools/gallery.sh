#!/usr/bin/env bash
# Draws the default picture of each file of tools/gallery.list, and writes docs/gallery.md with docs/images/gallery/*.png.
#
#     tools/gallery.sh DATA_FOLDER [PROGRAM]
#
# Files that are missing or refused stand in the page with the reason. The thumbnails are small: see LIMIT_KIB.
set -euo pipefail
cd "$(dirname "$0")/.."
data=${1:?usage: tools/gallery.sh DATA_FOLDER [PROGRAM]}
program=${2:-target/release/supervol}
readonly LIMIT_KIB=3072 SIZE=240x180
images=docs/images/gallery
page=docs/gallery.md
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
[ -x "$program" ] || cargo build --release -p supervol-cli
rm -rf "$images"
mkdir -p "$images"

cat > "$page" <<'HEAD'
# Default pictures

What `supervol render FILE.svol -o picture.png` shows of real and odd files, without a scene and without options: the kind of
data that was recognised, and why. Made, and to be looked at again whenever presets change, by

    tools/gallery.sh DATA_FOLDER

| picture | file | kind, and why | dims |
|---|---|---|---|
HEAD

row() { # file, options...
    local file=$1 name
    shift
    name=$(tr '/.:' '___' <<< "$file")
    if ! "$program" build "$data/$file" "$@" -o "$work/v.svol" --force > /dev/null 2> "$work/log"; then
        printf '| | `%s` | not read: %s | |\n' "$file" "$(tail -1 "$work/log" | sed "s#^supervol: $data/$file: ##")"
        return
    fi
    "$program" render "$work/v.svol" --size "$SIZE" --backend cpu -o "$images/$name.png" > /dev/null 2> "$work/log" || cat "$work/log" >&2
    local kind dims
    kind=$("$program" info "$work/v.svol" | sed -n 's/^kind  *//p')
    dims=$("$program" info "$work/v.svol" | sed -n 's/^volume  *//p')
    kind+=$(sed -n 's/^supervol: warning:/; warning:/p' "$work/log")
    printf '| ![](images/gallery/%s.png) | `%s` | %s | %s |\n' "$name" "$file${*:+ $*}" "$kind" "$dims"
}

while read -r line; do
    line=${line%%#*}
    [ -n "$line" ] || continue
    # shellcheck disable=SC2086 # options are words
    row $line >> "$page"
done < tools/gallery.list

size=$(du -sk "$images" | cut -f1)
[ "$size" -le "$LIMIT_KIB" ] || { echo "$images takes $size KiB, more than $LIMIT_KIB" >&2; exit 1; }
echo "$page: $(grep -c '^| !' "$page") pictures, $size KiB"
