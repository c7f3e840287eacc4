// What rays tell the host: bricks they wait for, slots they used, and what it cost.

// Iterations of all loops in this invocation. They are limited per dispatch: a submit must not block the GPU for long,
// and software drivers (llvmpipe) leave a shader's loops without a word after 65535 iterations of a group of lanes.
var<private> work: u32;

// Of this invocation; added to the feedback buffer once, at its end.
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

// Whether the ray has done its share in this dispatch.
fn is_worked_off() -> bool {
    return work >= config.work_limit;
}

// Notes that the ray waits for an entry; the first ray that does so lists it.
fn note_miss(entry: u32) {
    if (atomicAdd(&feedback.words[config.wait_words + entry], 1u) != 0u) {
        return;
    }
    let place = atomicAdd(&feedback.miss_count, 1u);
    if (place < config.miss_limit) {
        atomicStore(&feedback.words[config.miss_words + 2u * place], entry);
    }
}

// Notes that the ray sampled a slot; the plain read spares most atomic writes.
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

// Adds this invocation's counters to its workgroup's; `status` is the ray's.
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

// The tile of a workgroup.
fn tile_of(group: u32) -> u32 {
    return atomicLoad(&feedback.words[config.tile_words + group]);
}

// Adds the workgroup's sums to the feedback buffer, one lane for each counter, and says in its tile's place what is left of it.
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
