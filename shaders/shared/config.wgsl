// What every shader can see: bindings. Group 0 lives as long as the renderer, group 1 belongs to one chunk of rays.

@group(0) @binding(0) var<uniform> config: Config;
@group(0) @binding(1) var<uniform> tables: Tables;

// One (state, payload) for each brick of every level, by entry number.
@group(0) @binding(2) var<storage, read> page_table: array<vec2<u32>>;

@group(0) @binding(3) var<storage, read> points: array<GpuPoint>;
// `config.bin_count` bins, then the bits of the knots' values.
@group(0) @binding(4) var<storage, read> transfer_index: array<u32>;

// For each slot the (least, greatest) render value of each macro cell, x fastest; least > greatest: nothing to see.
@group(0) @binding(5) var<storage, read> macro_ranges: array<vec2<f32>>;

struct Feedback {
    counters: array<atomic<u32>, 12>,
    // Misses found, also those beyond the list's limit.
    miss_count: atomic<u32>,
    padding_0: u32,
    padding_1: u32,
    padding_2: u32,
    // `config.miss_limit` pairs (entry, waiting rays), then one bit for each slot that was used.
    words: array<atomic<u32>>,
}
@group(0) @binding(6) var<storage, read_write> feedback: Feedback;
// Rays waiting for each entry.
@group(0) @binding(7) var<storage, read_write> miss_counts: array<atomic<u32>>;

// Slots of stored voxels: integers biased to unsigned, floats as their bits. Unused ones hold one texel.
@group(0) @binding(8) var cache_0: texture_3d<u32>;
@group(0) @binding(9) var cache_1: texture_3d<u32>;
@group(0) @binding(10) var cache_2: texture_3d<u32>;
@group(0) @binding(11) var cache_3: texture_3d<u32>;

@group(1) @binding(0) var<uniform> job: Dispatch;
@group(1) @binding(1) var<storage, read> rays: array<GpuRay>;
@group(1) @binding(2) var<storage, read_write> states: array<RayState>;

fn has_flag(flag: u32) -> bool {
    return (config.flags & flag) != 0u;
}

// Whether the bits are those of a NaN or an infinity: tested on bits, since WGSL may assume that neither occurs.
fn is_non_finite(bits: u32) -> bool {
    return (bits & 0x7f800000u) == 0x7f800000u;
}
