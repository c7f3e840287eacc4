// What every shader can see: bindings. Group 0 lives as long as the renderer, group 1 belongs to one pipeline.
//
// Tables are storage buffers, not uniforms: a driver may compile a shader anew for every value of a uniform that decides
// where it branches, and keep all that it has compiled (Mesa's lavapipe does).

// Written where the volume, the look or the view changes, never with bricks; its job with every dispatch.
@group(0) @binding(0) var<storage, read> scene: Scene;

// One (state, payload) for each brick of every level, by entry number.
@group(0) @binding(1) var<storage, read> page_table: array<vec2<u32>>;

// Control points, four texels each (`GpuPoint`), `TABLE_WIDTH` texels a row. What rays look up in every cell is a texture:
// software adapters read buffers lane by lane.
@group(0) @binding(2) var points: texture_2d<u32>;
// `config.bin_count` bins, then the bits of the knots' values.
@group(0) @binding(3) var transfer_index: texture_2d<u32>;
// 4 and 8 to 11 are textures: texels_stored.wgsl, texels_sampled.wgsl.

// For each slot the (least, greatest) render value of each macro cell, x fastest; least > greatest: nothing is there.
@group(0) @binding(5) var<storage, read> macro_ranges: array<vec2<f32>>;
// For each of these how many macro cells away, along the axis on which it is furthest, the nearest one is that shows
// something under this look, but no further than the brick's edge needs; 0: it does so itself, and from `FIRST_BLOCK` on
// there is a bit for each of its blocks that does.
@group(0) @binding(6) var<storage, read_write> proximity: array<u32>;

// Bits of a proximity that are the distance, and the bit of the first block.
const NEAREST: u32 = 0xffu;
const FIRST_BLOCK: u32 = 0x100u;

struct Feedback {
    counters: array<atomic<u32>, 12>,
    // Misses found, also those beyond the list's limit.
    miss_count: atomic<u32>,
    padding_0: u32,
    padding_1: u32,
    padding_2: u32,
    // One bit for each slot that was used; from `config.miss_words` on `config.miss_limit` pairs (entry, waiting rays); from
    // `config.wait_words` on the rays waiting for each entry; from `config.tile_words` on the tiles of the run, each of which
    // becomes what is left of it (`LEFT_...`).
    words: array<atomic<u32>>,
}
@group(0) @binding(7) var<storage, read_write> feedback: Feedback;

// What bricks may be off by; pages say which is theirs. Read where `FLAG_ERRORS` is set.
@group(0) @binding(12) var<storage, read> deviations: array<GpuDeviation>;

// `scene.config`, read once by every entry.
var<private> config: Config;

// What a pipeline is compiled for, so that it holds nothing else; ANY: whatever `config` says. On GPUs that leaves registers
// for more rays; software adapters run through both sides of every branch, whoever takes it.
const ANY: u32 = 0xffffffffu;
override ONLY_MODE: u32 = ANY;
override ONLY_FLAGS: u32 = ANY;
override TEXTURE_COUNT: u32 = 4u;
// Whether there are clip planes.
override CUT_BY_PLANES: bool = true;

fn mode() -> u32 {
    return select(ONLY_MODE, config.mode, ONLY_MODE == ANY);
}

fn flags() -> u32 {
    return select(ONLY_FLAGS, config.flags, ONLY_FLAGS == ANY);
}

fn has_flag(flag: u32) -> bool {
    return (flags() & flag) != 0u;
}

// Bits that all NaNs and infinities have.
const NON_FINITE: u32 = 0x7f800000u;

// Whether the bits are those of a NaN or an infinity: tested on bits, since WGSL may assume that neither occurs.
fn is_non_finite(bits: u32) -> bool {
    return (bits & NON_FINITE) == NON_FINITE;
}
