// Bindings that all shaders share. Group 0 lives as long as the renderer; group 1 belongs to one pipeline.
//
// Tables are storage buffers, not uniforms. A driver may compile a shader again for every value of a uniform that
// decides a branch, and keep all compiled versions (Mesa's lavapipe does).

// Written when the volume, the look or the view changes, never when bricks change. Its `job` is written for every
// dispatch.
@group(0) @binding(0) var<storage, read> scene: Scene;

// (state, payload) of each brick of every level, by entry number.
@group(0) @binding(1) var<storage, read> page_table: array<vec2<u32>>;

// Control points: four texels each (`GpuPoint`), `TABLE_WIDTH` texels per row. Tables that every cell needs are
// textures, because software adapters read buffers lane by lane.
@group(0) @binding(2) var points: texture_2d<u32>;
// `config.bin_count` bins, then the bits of the knots' values.
@group(0) @binding(3) var transfer_index: texture_2d<u32>;
// Bindings 4 and 8 to 11 are textures: texels_stored.wgsl, texels_sampled.wgsl.

// (least, greatest) render value of each macro cell of each slot, x fastest. least > greatest: no voxel is present.
@group(0) @binding(5) var<storage, read> macro_ranges: array<vec2<f32>>;
// Proximity of each macro cell, in the same order. The bits `NEAREST` hold the Chebyshev distance, in macro cells, to
// the nearest visible macro cell, limited to the brick's edge. A distance of 0 means that the cell is visible; then the
// bits from `FIRST_BLOCK` on mark its visible blocks.
@group(0) @binding(6) var<storage, read_write> proximity: array<u32>;

// Bits of a proximity that hold the distance, and bit of the first block.
const NEAREST: u32 = 0xffu;
const FIRST_BLOCK: u32 = 0x100u;

struct Feedback {
    counters: array<atomic<u32>, 12>,
    // Number of misses found, including those beyond the list's limit.
    miss_count: atomic<u32>,
    padding_0: u32,
    padding_1: u32,
    padding_2: u32,
    // One bit per used slot. From `config.miss_words` on: `config.miss_limit` pairs (entry, waiting rays). From
    // `config.wait_words` on: number of rays waiting for each entry. From `config.tile_words` on: the listed tiles;
    // each is overwritten with its remaining work (`LEFT_...`).
    words: array<atomic<u32>>,
}
@group(0) @binding(7) var<storage, read_write> feedback: Feedback;

// Error bounds of bricks; pages hold an index into this list. Read if `FLAG_ERRORS` is set.
@group(0) @binding(12) var<storage, read> deviations: array<GpuDeviation>;

// Copy of `scene.config`, read once by every entry point.
var<private> config: Config;

// Values that a pipeline is specialised for, so that it holds only the code it needs; ANY: the value in `config`
// decides. On GPUs, specialisation saves registers, so that more rays run at once. Software adapters execute both sides
// of every branch.
const ANY: u32 = 0xffffffffu;
override ONLY_MODE: u32 = ANY;
override ONLY_FLAGS: u32 = ANY;
override TEXTURE_COUNT: u32 = 4u;
// Whether the scene has clip planes.
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

// Exponent bits, which are all set in NaNs and infinities.
const NON_FINITE: u32 = 0x7f800000u;

// Whether the bits are those of a NaN or an infinity. Tests bits, because WGSL compilers may assume that neither
// occurs.
fn is_non_finite(bits: u32) -> bool {
    return (bits & NON_FINITE) == NON_FINITE;
}
