#!/usr/bin/env bash
# A real window on a display of its own: it starts, shows a volume, answers mouse and keys, and what is on the screen is what
# `render` draws of the scene that its command names.
#
#   tools/window.sh SUPERVOL [PICTURES]    SUPERVOL is the program, PICTURES a folder that keeps screenshots
#
# Needs xvfb, xdotool and imagemagick (tools/ci.sh window installs them) and a Vulkan driver.
set -euo pipefail

readonly supervol="$1"
readonly WIDTH=1280 HEIGHT=800
# Grey levels of 255 that a pixel of the screen may differ from the one that was rendered: none but for rounding.
readonly TOLERANCE=1
readonly PATIENCE=60

work="$(mktemp -d)"
pictures="${2:-$work}"
mkdir -p "$pictures"
export XDG_CACHE_HOME="$work/cache" XDG_CONFIG_HOME="$work/config"
unset WAYLAND_DISPLAY
pids=()
# shellcheck disable=SC2329
clean() {
    [ "${#pids[@]}" -eq 0 ] || kill "${pids[@]}" 2>/dev/null || true
    wait 2>/dev/null || true
    rm -rf "$work"
}
trap clean EXIT

fail() {
    printf 'window: FAILED: %s\n' "$*" >&2
    [ ! -s "$work/view.log" ] || cat "$work/view.log" >&2
    exit 1
}

# until_true WHAT COMMAND...: runs it again and again until it succeeds.
until_true() {
    local what="$1" end=$((SECONDS + PATIENCE))
    shift
    until "$@"; do
        [ "$SECONDS" -lt "$end" ] || fail "waited $PATIENCE s in vain until $what"
        sleep 0.2
    done
}

shot() { import -silent -window "$window" "$pictures/$1.png"; }

# Whether what is on the screen has changed since a screenshot, and whether it has come to rest: the title says that no work
# goes on, and the screen stays the same.
has_changed() { shot now && ! cmp -s "$pictures/$1.png" "$pictures/now.png"; }
is_still() {
    [ "$(xdotool getwindowname "$window")" = "survey.svol - Supervol" ] || return 1
    shot now && sleep 0.7 && shot later && cmp -s "$pictures/now.png" "$pictures/later.png"
}

has_command() { compgen -G "$XDG_CACHE_HOME/supervol/scenes/*.json" >/dev/null; }

# The difference of the picture's area of the screen and a file, the greatest of all pixels, of 255.
difference() {
    convert "$pictures/$1.png" -crop "$2+0+0" +repage "$3" -compose difference -composite -colorspace gray -format '%[fx:maxima*255]' info:
}

show_number() {
    # A free display, and its number once it can be used.
    Xvfb -displayfd 3 -screen 0 "${WIDTH}x${HEIGHT}x24" -nolisten tcp 3>"$work/number" >"$work/xvfb.log" 2>&1 &
    pids+=($!)
    until_true "Xvfb has a display" test -s "$work/number"
    DISPLAY=":$(tr -d '[:space:]' <"$work/number")"
    export DISPLAY
}

is_open() { window="$(xdotool search --onlyvisible --name Supervol 2>/dev/null | head -n 1)" && [ -n "$window" ]; }

"$supervol" synth seismic --dims 96,96,96 --brick 32 -o "$work/survey.svol" >/dev/null
show_number
started="$(date +%s%N)"
"$supervol" view "$work/survey.svol" >"$work/view.log" 2>&1 &
viewer=$!
pids+=("$viewer")
until_true "the window is there" is_open
shot start
printf 'MEASURED: %d ms from the start of the viewer to its window, software adapter\n' $((($(date +%s%N) - started) / 1000000))
xdotool windowfocus "$window" mousemove --window "$window" $((WIDTH / 2)) $((HEIGHT / 2))
# Without panels, the picture begins in the upper left corner.
xdotool key --window 0 h
until_true "the picture rests" is_still
shot first

# Mouse: a drag turns the volume, the wheel brings it nearer.
xdotool mousedown 1 sleep 0.3 mousemove_relative --sync 150 60 sleep 0.3 mousemove_relative --sync 50 20 sleep 0.3 mouseup 1
until_true "a drag changes the picture" has_changed first
until_true "the picture rests after the drag" is_still
shot turned
xdotool click 4 sleep 0.3 click 4
until_true "the wheel changes the picture" has_changed turned
until_true "the picture rests after the wheel" is_still
shot nearer
# Keys: an arrow turns it on, the window of keys opens and closes.
xdotool key --window 0 Right
until_true "a key changes the picture" has_changed nearer
# Beside the picture, so that nothing is told over it of the point under the mouse.
xdotool mousemove --window "$window" $((WIDTH - 4)) $((HEIGHT - 6))
until_true "the picture rests after the key" is_still
shot keyed
xdotool key --window 0 question
until_true "the window of keys opens" has_changed keyed
xdotool key --window 0 Escape

# The copied command draws the picture on the screen. The picture is taken first: copying shows a message over it.
shot seen
xdotool key --window 0 ctrl+shift+c
until_true "the command's scene is written" has_command
scene="$(compgen -G "$XDG_CACHE_HOME/supervol/scenes/*.json" | head -n 1)"
"$supervol" render "$work/survey.svol" --scene "$scene" --backend cpu -o "$pictures/expected.png" >/dev/null
size="$(identify -format '%wx%h' "$pictures/expected.png")"
until_true "the window of keys is closed" is_still
far="$(difference keyed "$size" "$pictures/expected.png")"
printf 'window: %s pixels, at most %s of 255 from what render draws\n' "$size" "$far"
awk -v far="$far" -v most="$TOLERANCE" 'BEGIN { exit !(far <= most) }' || fail "the screen is $far grey levels from what render draws"

xdotool windowclose "$window" 2>/dev/null || xdotool windowkill "$window"
for _ in $(seq 50); do
    kill -0 "$viewer" 2>/dev/null || break
    sleep 0.2
done
# Without a window, it says what to do.
if env -u DISPLAY "$supervol" view >"$work/none.log" 2>&1; then fail "a viewer without a display ends well"; fi
grep -q "apt install" "$work/none.log" || { cat "$work/none.log"; fail "a viewer without a display does not say what to install"; }
printf 'window: passed\n'
