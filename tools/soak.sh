#!/usr/bin/env bash
# Builds, renders and verifies under random faults until the time is up, and counts what came of it.
#
#   tools/soak.sh [MINUTES]      3 by default
#
# Faults: processes killed (KILL, INT, TERM, HUP) while they build or render; disks that fill, in a small tmpfs where
# mounting is permitted; containers that are cut or overwritten; sources that are written to while they are read; four
# processes at once on one output. Reads that fail cannot be had without a broken disk: tests/tests/contracts/failures.rs has them.
# Whatever happens, a file that was whole stays whole, nothing half written keeps lying about, no exit code but those that
# are documented, and nothing hangs. Environment:
#   SOAK_SEED (1)      seed of the faults
#   SUPERVOL (unset)   the program; by default it is built
set -euo pipefail

cd "$(dirname "${BASH_SOURCE[0]}")/.."

readonly MINUTES="${1:-3}"
readonly SEED="${SOAK_SEED:-1}"
readonly LIMIT_S=120
readonly DIMS=96,96,96
RANDOM=$SEED

if [ -z "${SUPERVOL:-}" ]; then
    cargo build --quiet --locked -p supervol-cli
    SUPERVOL="${CARGO_TARGET_DIR:-$PWD/target}/debug/supervol"
fi
work="$(mktemp -d)"
disk="$work/disk"
mkdir "$disk"

# A background child that a signal ends before it has become the program runs this trap, too: it must remove nothing.
clean() {
    [ "$BASHPID" = "$$" ] || return 0
    umount "$disk" 2>/dev/null || true
    rm -rf "$work"
}
trap clean EXIT
cd "$work"

say() { printf '%s\n' "$*"; }

# run COMMAND...: runs it, with a limit; the exit code is in $code, what it said in the file "said".
run() {
    code=0
    timeout "$LIMIT_S" "$SUPERVOL" "$@" >said 2>&1 || code=$?
}

# lost WHAT: counts a promise that was not kept, and keeps what was said.
lost=0
is_kept=1
lost() {
    is_kept=0
    lost=$((lost + 1))
    say "LOST: $* (exit code $code)"
    tail -n 3 said || true
}

hash_of() { sha256sum "$1" | cut -d ' ' -f 1; }

no_partials() {
    local found
    found="$(find "$1" -maxdepth 1 -name '.supervol-*' | head -n 1)"
    [ -z "$found" ] || lost "$found is left"
}

# stopped SIGNAL COMMAND...: starts it, and sends the signal after up to 0.3 s.
stopped() {
    local signal="$1" process
    shift
    "$SUPERVOL" "$@" >said 2>&1 &
    process=$!
    sleep "0.$(printf '%03d' $((RANDOM % 300)))"
    kill "-$signal" "$process" 2>/dev/null || true
    code=0
    wait "$process" 2>/dev/null || code=$?
    case "$signal-$code" in
        *-0 | KILL-137 | INT-130 | TERM-143 | HUP-129) ;;
        *) lost "SIG$signal" ;;
    esac
    [ "$signal" = KILL ] || no_partials .
}

random_signal() {
    local signals=(KILL INT TERM HUP)
    signal="${signals[RANDOM % 4]}"
}

# made COMMAND...: what must work before anything is tried.
made() {
    run "$@"
    [ "$code" = 0 ] || { say "soak: cannot begin: supervol $*: $(cat said)"; exit 1; }
}

prepare() {
    local seed
    for seed in 1 2; do
        made synth seismic --dims "$DIMS" --dtype f32 --seed "$seed" -o "$seed.raw"
        made build "$seed.raw" --dims "$DIMS" --dtype f32 -o "$seed.svol"
        hashes[seed]="$(hash_of "$seed.svol")"
    done
    cp 1.svol kept.svol
    printf '{"image": {"width": 160, "height": 120}}' >scene.json
    made render 1.svol --scene scene.json --backend cpu -o kept.png
    picture="$(hash_of kept.png)"
    if mount -t tmpfs -o size=2m tmpfs "$disk" 2>/dev/null; then
        umount "$disk"
        faults+=(full_disk)
    else
        say "SKIPPED: full disks need the right to mount a tmpfs (run as root)"
    fi
}

killed_build() {
    local seed=$((RANDOM % 2 + 1)) now
    random_signal
    stopped "$signal" build "$seed.raw" --dims "$DIMS" --dtype f32 -o kept.svol --force
    now="$(hash_of kept.svol)"
    [ "$now" = "${hashes[1]}" ] || [ "$now" = "${hashes[2]}" ] || lost "kept.svol is neither the old nor the new one"
    if ((RANDOM % 2)); then
        # The same build goes on with what a kill has left.
        run build "$seed.raw" --dims "$DIMS" --dtype f32 -o kept.svol --force
        [ "$(hash_of kept.svol)" = "${hashes[seed]}" ] || lost "a build that went on makes other bytes"
        no_partials .
    fi
    # Another build to this folder removes it.
    run synth sphere --dims 8,8,8 -o next.svol --force
    no_partials .
}

killed_render() {
    random_signal
    stopped "$signal" render 1.svol --scene scene.json --backend cpu -o kept.png
    [ "$(hash_of kept.png)" = "$picture" ] || lost "kept.png is not what it was"
    run synth sphere --dims 8,8,8 -o next.svol --force
    no_partials .
}

full_disk() {
    local kept
    mount -t tmpfs -o "size=$((RANDOM % 4000 + 8))k" tmpfs "$disk"
    run build 1.raw --dims "$DIMS" --dtype f32 -o "$disk/full.svol"
    if [ "$code" = 3 ]; then
        grep -q "disk is full" said || lost "a full disk is not named"
        # The message names the kept parts of a build. With more room, the same command continues it.
        for kept in "$disk"/.[!.]* "$disk"/*; do
            if [ -e "$kept" ] && ! grep -qF "is kept, about" said; then
                lost "$kept is left on a full disk without a word"
            elif [ -e "$kept" ] && ! grep -qF "$kept" said; then
                lost "$kept is left on a full disk, and is not named"
            fi
        done
        mount -o remount,size=64m "$disk"
        run build 1.raw --dims "$DIMS" --dtype f32 -o "$disk/full.svol"
        [ "$(hash_of "$disk/full.svol")" = "${hashes[1]}" ] || lost "a build that went on after a full disk"
        no_partials "$disk"
    elif [ "$code" != 0 ] || [ "$(hash_of "$disk/full.svol")" != "${hashes[1]}" ]; then
        lost "a small disk"
    fi
    umount "$disk"
}

# harmed: what commands do with bad.svol.
harmed() {
    local command
    run verify bad.svol
    [ "$code" = 1 ] || lost "verify of a container with $1"
    for command in "info bad.svol" "extract bad.svol -o bad.raw --force" \
        "render bad.svol --scene scene.json --backend cpu -o bad.png --force"; do
        # shellcheck disable=SC2086  # words of a command
        run $command
        [ "$code" = 0 ] || [ "$code" = 1 ] || lost "$command, a container with $1"
    done
    no_partials .
}

cut_short() {
    local bytes at
    bytes="$(stat -c %s 1.svol)"
    at=$(((RANDOM * 32768 + RANDOM) % bytes))
    head -c "$at" 1.svol >bad.svol
    harmed "$at of $bytes bytes"
}

overwritten() {
    local bytes at
    bytes="$(stat -c %s 1.svol)"
    at=$(((RANDOM * 32768 + RANDOM) % (bytes - 64)))
    cp 1.svol bad.svol
    head -c 64 /dev/urandom | dd of=bad.svol bs=1 seek="$at" conv=notrunc status=none
    harmed "64 other bytes at $at"
}

changed_source() {
    local process
    cp 1.raw changing.raw
    "$SUPERVOL" build changing.raw --dims "$DIMS" --dtype f32 -o changing.svol --force >said 2>&1 &
    process=$!
    sleep "0.$(printf '%03d' $((RANDOM % 200)))"
    printf 'changed' | dd of=changing.raw bs=1 seek=$((RANDOM * 4)) conv=notrunc status=none
    code=0
    wait "$process" || code=$?
    case "$code" in
        0) [ "$(hash_of changing.svol)" = "${hashes[1]}" ] || verified changing.svol ;;
        1) grep -q "changed while it was read" said || lost "a source that changed" ;;
        *) lost "a source that changed" ;;
    esac
    no_partials .
}

verified() {
    run verify "$1"
    [ "$code" = 0 ] || lost "verify of $1"
}

four_at_once() {
    local seed processes=() process
    for seed in 1 2 1 2; do
        "$SUPERVOL" build "$seed.raw" --dims "$DIMS" --dtype f32 -o kept.svol --force >"said.$seed" 2>&1 &
        processes+=($!)
    done
    for process in "${processes[@]}"; do
        code=0
        wait "$process" || code=$?
        [ "$code" = 0 ] || lost "one of four builds of one output"
    done
    verified kept.svol
    no_partials .
}

faults=(killed_build killed_render cut_short overwritten changed_source four_at_once)
hashes=()
declare -A times
tried=0
survived=0
prepare
end=$((SECONDS + MINUTES * 60))
while [ "$SECONDS" -lt "$end" ]; do
    fault="${faults[RANDOM % ${#faults[@]}]}"
    is_kept=1
    "$fault"
    tried=$((tried + 1))
    survived=$((survived + is_kept))
    times[$fault]=$((${times[$fault]:-0} + 1))
done
for fault in "${!times[@]}"; do say "$(printf '%6d  %s' "${times[$fault]}" "$fault")"; done | sort -k 2
say "soak: $MINUTES minutes, seed $SEED: tried $tried, survived $survived, lost: $lost"
[ "$lost" -eq 0 ]
