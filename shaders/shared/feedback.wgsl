// Feedback from rays to the host: missing bricks, used slots, and counters of work.

// Loop iterations of this invocation, limited per dispatch. A submission must not block the GPU for long, and llvmpipe
// silently ends a shader's loops after 65535 iterations of a group of lanes.
var<private> work: u32;

// Counters of this invocation, added to the feedback buffer once, at its end.
var<private> cells: u32;
var<private> samples: u32;
var<private> macro_cells: u32;
var<private> macro_cells_skipped: u32;
var<private> bricks_entered: u32;
var<private> fallbacks: u32;
var<private> lost: u32;
var<private> anomalies: u32;

// Sums of one workgroup, in the order of `Counters`.
var<workgroup> group_counters: array<atomic<u32>, 12>;

// Whether the invocation has reached its work limit in this dispatch.
fn is_worked_off() -> bool {
    return work >= config.work_limit;
}

// Records that the ray waits for a page-table entry. The first waiting ray adds it to the list.
fn note_miss(entry: u32) {
    if (atomicAdd(&feedback.words[config.wait_words + entry], 1u) != 0u) {
        return;
    }
    let place = atomicAdd(&feedback.miss_count, 1u);
    if (place < config.miss_limit) {
        atomicStore(&feedback.words[config.miss_words + 2u * place], entry);
    }
}

// Records that the ray sampled a slot. The plain read avoids most atomic writes.
fn note_use(slot: u32) {
    let word = slot / 32u;
    let bit = 1u << (slot % 32u);
    if ((atomicLoad(&feedback.words[word]) & bit) == 0u) {
        atomicOr(&feedback.words[word], bit);
    }
}

fn add_to_group(counter: u32, amount: u32) {
    if (amount != 0u) {
        atomicAdd(&group_counters[counter], amount);
    }
}

// Adds this invocation's counters to its workgroup's; `status` is the ray's status.
fn count_in_group(status: u32) {
    if (status == STATUS_ACTIVE || status == STATUS_INSIDE) {
        add_to_group(0u, 1u);
    } else if (status == STATUS_WAITING) {
        add_to_group(1u, 1u);
    } else {
        add_to_group(2u, 1u);
    }
    add_to_group(3u, cells);
    add_to_group(4u, samples);
    add_to_group(5u, macro_cells);
    add_to_group(6u, macro_cells_skipped);
    add_to_group(7u, bricks_entered);
    add_to_group(8u, fallbacks);
    add_to_group(9u, lost);
    add_to_group(10u, anomalies);
}

// The tile of a workgroup, from the list of the dispatch.
fn tile_of(group: u32) -> u32 {
    return atomicLoad(&feedback.words[config.tile_words + group]);
}

// Adds the workgroup's sums to the feedback buffer, one lane per counter. Overwrites its tile in the list with the
// remaining work.
fn count_in_feedback(group: u32, lane: u32) {
    if (lane == 0u) {
        let interrupted = select(0u, LEFT_INTERRUPTED, atomicLoad(&group_counters[0]) != 0u);
        let waiting = select(0u, LEFT_WAITING, atomicLoad(&group_counters[1]) != 0u);
        atomicStore(&feedback.words[config.tile_words + group], interrupted | waiting);
    }
    if (lane < 12u) {
        let sum = atomicLoad(&group_counters[lane]);
        if (sum != 0u) {
            atomicAdd(&feedback.counters[lane], sum);
        }
    }
}
