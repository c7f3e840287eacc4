// Constants and structs shared with Rust. Written by gpu/layout.rs; do not edit.

// Texels of a row of a table.
const TABLE_WIDTH: u32 = 1024u;
// Texels of a piece of the transfer function: gpu/piece_table.rs.
const PIECE_TEXELS: u32 = 12u;
// Rays of one workgroup: one tile of 8 x 8 pixels.
const WORKGROUP_RAYS: u32 = 64u;
// The ray can continue at once: it stopped at the dispatch's limit.
const STATUS_ACTIVE: u32 = 0u;
// The ray waits for a brick.
const STATUS_WAITING: u32 = 1u;
// The ray is finished.
const STATUS_DONE: u32 = 2u;
// The ray can continue at once, in the brick where it stopped: its base point stays.
const STATUS_INSIDE: u32 = 3u;
// Some ray of a tile stopped at the dispatch's limit.
const LEFT_INTERRUPTED: u32 = 1u;
// Some ray of a tile waits for a brick.
const LEFT_WAITING: u32 = 2u;
// Page table: the brick is not resident.
const PAGE_MISSING: u32 = 0u;
// Page table: nothing of the brick is visible.
const PAGE_NOTHING: u32 = 1u;
// Page table: the brick has one value, whose bits are the payload.
const PAGE_UNIFORM: u32 = 2u;
// Page table: the brick cannot be read; its parent is drawn.
const PAGE_FAILED: u32 = 3u;
// Page table: the payload is the slot.
const PAGE_RESIDENT: u32 = 4u;
// Page table: bits of the state.
const PAGE_STATE: u32 = 255u;
// Page table: the brick is too coarse; look at its children.
const PAGE_REFINE: u32 = 256u;
// Page table: first bit of the number of the brick's deviation.
const PAGE_DEVIATION_SHIFT: u32 = 9u;
// Number of the deviation of exact bricks.
const DEVIATION_NONE: u32 = 0u;
// Number of the deviation of unknown bricks.
const DEVIATION_UNKNOWN: u32 = 1u;
// Mode of a ray.
const MODE_DVR: u32 = 0u;
// See above.
const MODE_MIP: u32 = 1u;
// See above.
const MODE_MINIP: u32 = 2u;
// See above.
const MODE_MEAN: u32 = 3u;
// See above.
const MODE_ISO: u32 = 4u;
// Flag: texels are the bits of 32-bit floats.
const FLAG_FLOAT: u32 = 1u;
// Flag: one stored value means absent.
const FLAG_ABSENT: u32 = 2u;
// Flag: samples are shaded.
const FLAG_SHADED: u32 = 4u;
// Flag: invisible macro cells are skipped.
const FLAG_SKIPPING: u32 = 8u;
// Flag: voxels can be absent at all.
const FLAG_HOLES: u32 = 16u;
// Flag: antiderivatives of the transfer function are used (light_walk.wgsl): mode dvr, without steps.
const FLAG_LIGHT: u32 = 32u;
// Flag: there are iso surfaces, alone or inside the volume.
const FLAG_SURFACES: u32 = 64u;
// Flag: voxels are bytes; a texel of a cache texture holds four rows of them (gpu/cache.rs).
const FLAG_BYTES: u32 = 128u;
// Flag: errors of rays are summed up (errors.wgsl).
const FLAG_ERRORS: u32 = 256u;
// Bytes: voxels from a texel to the next one, along x and y.
const STEP_OF_BYTES: u32 = 3u;
// 16-bit numbers: voxels from a texel to the next one along x.
const STEP_OF_HALVES: u32 = 7u;
// Floats: voxels from a texel to the next one along x.
const STEP_OF_FLOATS: u32 = 3u;
// Explained where Rust defines them: crates/format/src/brick.rs, crates/scene/src/scene/mod.rs, and in crates/runtime/src: lod/deviation.rs, engines/rules.rs, engines/blocks.rs, engines/cells/quadrature.rs, engines/packets (blocks.rs, shade.rs, turn.rs, highlight.rs), engines/gpu/limits.rs.
const APRON: i32 = 2;
const MACRO_CELL: i32 = 8;
const BLOCK: i32 = 4;
const SHARES: u32 = 12u;
const KNOT_LIMIT: u32 = 8u;
const PAIR_LIMIT: u32 = 64u;
const ISO_LIMIT: u32 = 32u;
const POSITION_ERROR: f32 = 2e-5;
const PAIR_VARIATION: f32 = 0.006;
const PAIRS_PER_VARIATION: f32 = 1.3;
const PAIR_VARIATION_DEPTH: f32 = 0.07;
const PAIR_NORMAL_CHANGE: f32 = 0.085;
const PAIR_NORMAL_DEPTH: f32 = 0.3;
const MIN_WEIGHT: f32 = 1e-20;
const LEAST_PART: f32 = 6.1035156e-5;
const SHORTEST: f32 = 0.00012207031;
const PARTS_LIMIT: f32 = 64.0;
const PARTS_PER_ROOT: f32 = 1.4;
const LEAST_SHARE: f32 = 0.25;
const EASY: f32 = 0.125;
const HARD: f32 = 16.0;
const AVERAGE_OF_BUMP: f32 = 0.2567;
const AVERAGE_OF_CUBIC: f32 = 0.03126;
const GREATEST_OF_CUBIC: f32 = 0.05;
const ORDER_SQUARE: f32 = 1.2;
const SQUARE_OF_BUMP: f32 = 0.08888889;
const SQUARE_OF_CUBIC: f32 = 0.0011904762;
const SWING_OF_BUMP: f32 = 0.06416;
const SWING_OF_CUBIC: f32 = 0.015625;
const ORDER_CUBE: f32 = 0.1;
const MOST_OF_ORDER: f32 = 3.7;
const SERIES_UP_TO: f32 = 1.0;
const ORDER_OF_DEPTH: f32 = 1e-5;
const ORDER_OF_TILT: f32 = 0.000165;
const LEAST_TILT: f32 = 1.9;
const OPAQUE_TILT: f32 = 4.0;
const TILT_LIMIT: f32 = 4.0;
const LEAN_SQUARE: f32 = 0.2;
const SPREAD_SQUARE: f32 = 0.6;
const OF_CURVE: f32 = 0.0081;
const OF_CURVES: f32 = 0.0159;
const OF_KINK: f32 = 0.0162;
const OF_UNSETTLED_KINK: f32 = 0.0186;
const OF_BENDS: f32 = 0.0313;
const OF_ANY_BENDS: f32 = 0.0434;
const MOMENT_OF_KINK: f32 = 0.00803;
const OF_STEP: f32 = 0.125;
const RESERVE_SHARE: f32 = 0.05;
const PARTS_SHARE: f32 = 0.8;
const ROUNDED_BELOW: f32 = 0.015625;
const VALUE_ERROR: f32 = 5e-7;
const SHORT_BESIDE_NOISE: f32 = 0.25;
const OF_FIRST: f32 = 0.139;
const TURN_SECOND: f32 = 1.15471;
const TURN_THIRD: f32 = 3.0;
const TURN_FOURTH: f32 = 9.8815;
const KERNEL_AT_END: f32 = 4.340278e-5;
const KERNEL_IN_MIDDLE: f32 = 0.00026041668;
const OF_SECOND: f32 = 0.01235;
const OF_THIRD: f32 = 0.016666668;
const AWAY_OF_SQUARE: f32 = 0.0625;
const AWAY_OF_CUBE: f32 = 0.094;
const SMOOTH_FROM: f32 = 4.0;
const LEAST_COSINE: f32 = 0.1;
const VERTICAL: f32 = 1000000.0;
const GAUSS_OFFSET: f32 = 0.21132487;
const GAUSS_DISTANCE: f32 = 0.5773503;
const FAR: f32 = 1e30;
const LEAP_MARGIN: f32 = 2e-5;
const EPSILON: f32 = 1.1920929e-7;
const LEAST_NORMAL: f32 = 1.1754944e-38;
const LEAST_LENGTH: f32 = 1.0842022e-19;
const OVERSHOOT: f32 = 0.25;
const PER_OPACITY: array<f32, SHARES> = array<f32, SHARES>(0.0, 0.000984251968503937, 0.001968503937007874, 0.003937007874015748, 0.007874015748031496, 0.015748031496062992, 0.031496062992125984, 0.06299212598425197, 0.12598425196850394, 0.25196850393700787, 0.5039370078740157, 1.0);

// Position of one cache texture's slots.
struct SlotGrid {
    // Slots along x, y, z.
    slots: vec3<u32>,
    // Number of the texture's first slot; slots of later textures are greater.
    first: u32,
}

// One level of detail.
struct GpuLevel {
    // Bricks along x, y, z.
    bricks: vec3<u32>,
    // Page table entry of the level's first brick.
    first_entry: u32,
    // Binary logarithm of the source voxels per voxel of this level, per axis.
    scale_log2: vec3<u32>,
    // Zero.
    padding: u32,
}

// One directional light.
struct GpuLight {
    // Unit world vector from the sample to the light.
    to_light: vec3<f32>,
    // Factor of its diffuse and specular terms.
    intensity: f32,
}

// One iso surface.
struct GpuIso {
    // Its own colour.
    color: vec3<f32>,
    // Its own opacity.
    alpha: f32,
    // Render value.
    value: f32,
    // Zero.
    padding_0: f32,
    // Zero.
    padding_1: f32,
    // Zero.
    padding_2: f32,
}

// One control point of the transfer function and the segment to its right; twin of `RenderPoint`.
struct GpuPoint {
    // Red, green, blue, alpha at the point.
    rgba: vec4<f32>,
    // Change of each up to the next point; 0 for the last.
    delta: vec4<f32>,
    // Render value.
    value: f32,
    // 1 / width of the segment; 0 for the last and for steps.
    inverse_width: f32,
    // Variation gathered by all segments before this point.
    variation_before: f32,
    // Variation of the segment.
    variation: f32,
    // Number of points before this one whose alpha is positive.
    visible_before: u32,
    // Number of knots with a value not greater than this point's.
    knots_up_to: u32,
    // Zero.
    padding_0: u32,
    // Zero.
    padding_1: u32,
}

// Facts of scene and volume.
struct Config {
    // World offset of one voxel along x.
    world_x: vec3<f32>,
    // `MODE_...`
    mode: u32,
    // World offset of one voxel along y.
    world_y: vec3<f32>,
    // `FLAG_...`
    flags: u32,
    // World offset of one voxel along z.
    world_z: vec3<f32>,
    // Levels of detail.
    level_count: u32,
    // First column of the matrix from index-space to world-space gradients.
    gradient_x: vec3<f32>,
    // Least length of a world-space gradient that is shaded, render values per world length.
    gradient_floor: f32,
    // Second column of that matrix.
    gradient_y: vec3<f32>,
    // Lights.
    light_count: u32,
    // Third column of that matrix.
    gradient_z: vec3<f32>,
    // Iso surfaces.
    iso_count: u32,
    // Shading: ka.
    ambient: f32,
    // Shading: kd.
    diffuse: f32,
    // Shading: ks.
    specular: f32,
    // Shading: exponent of the highlight.
    shininess: f32,
    // Render value per stored step.
    value_scale: f32,
    // Render value of stored 0.
    value_offset: f32,
    // Stored bits that mean absent, if `FLAG_ABSENT`.
    absent: u32,
    // Core voxels along each axis of a full brick.
    core: u32,
    // Control points of the transfer function.
    point_count: u32,
    // Bins over the control points' values: the first words of `transfer_index`; the knots follow.
    bin_count: u32,
    // Greatest opacity that has an extinction of its own.
    alpha_limit: f32,
    // Bins per render value.
    bins_per_value: f32,
    // Inverse of the world length that opacities refer to.
    inverse_unit_distance: f32,
    // A ray whose transmittance is lower is finished.
    transmittance_limit: f32,
    // A stride along a ray, in its parameter: a power of two.
    stride: f32,
    // Places in the miss list.
    miss_limit: u32,
    // Control points with positive alpha.
    visible_points: u32,
    // Loop iterations after which a ray stops at the next cell.
    work_limit: u32,
    // First word of the list of misses, behind the bits of slots used.
    miss_words: u32,
    // First word of the feedback that counts rays waiting for a brick.
    wait_words: u32,
    // First word of the tiles of a run, behind the counts.
    tile_words: u32,
    // Stored number from which values of the transfer function's pieces are counted, before it is scaled.
    light_centre: f32,
    // Such values per stored step.
    light_scale: f32,
    // The value of `light_centre`.
    light_offset: f32,
    // Error that a cell may spend per opacity: see engines/packets/budget.rs.
    by_opacity: f32,
    // Reserve of a ray, for cells that need more.
    reserve: f32,
    // Texel of the first piece, behind those of the search.
    first_piece: u32,
    // Pieces from one knot to the next in the first texel of the search: a power of 4.
    search_step: u32,
    // Width of an interval of values below which the mean is that of its ends.
    narrow: f32,
    // Bound on the error of a difference of antiderivatives.
    rounded_difference: f32,
    // Greatest change of slope per value in any piece.
    greatest_bend: f32,
    // Bounds on what roundings take from a difference of sums of bends.
    rounded_bends: f32,
    // And of those at knots alone.
    rounded_kinks: f32,
    // Opacity of a part, times the transmittance in front; parts below it are not shaded.
    least_shaded: f32,
    // Intensity of all lights.
    light_sum: f32,
    // Gauss pairs, relative to the number for half a grey level.
    pair_share: f32,
    // Half the shininess, if it is an integer for which products are used; else 0.
    whole_half: u32,
    // Bound on what render values are off by the data, because they are rounded.
    rounding: f32,
    // Bound on the length that a world-space gradient is off by, for that reason.
    gradient_noise: f32,
    // Zero.
    padding_0: u32,
    // Greatest brackets of a highlight: see engines/packets/highlight.rs.
    brackets: vec4<f32>,
    // The cache textures.
    grids: array<SlotGrid, 4>,
}

// Tables of fixed size.
struct Tables {
    // Finest first; `Config.level_count` of them count.
    levels: array<GpuLevel, 64>,
    // `Config.light_count` of them count.
    lights: array<GpuLight, 16>,
    // `Config.iso_count` of them count.
    isos: array<GpuIso, 32>,
}

// A number in two's complement: `whole + high * 2^-32 + low * 2^-64`, the last two unsigned.
struct Fixed {
    // Rounded down.
    whole: i32,
    // First 32 bits of the fraction.
    high: u32,
    // The next 32 bits.
    low: u32,
}

// A number that changes linearly from pixel to pixel: `base + x * per_x + y * per_y`.
struct Affine {
    // At pixel (0, 0).
    base: Fixed,
    // From a pixel to the next one in its row.
    per_x: Fixed,
    // From a row to the next one.
    per_y: Fixed,
}

// The height of rays above a clip plane, approximately in voxels: parts below 0 are cut off.
struct PlaneLine {
    // Height at the ray's begin.
    origin: Affine,
    // Change per stride.
    stride: Affine,
}

// Rays of a picture, in the index space of level 0: `origin + n * stride`, where n counts strides.
//
// The parameter t of a ray is a world length for orthographic cameras, and a depth for perspective ones;
// `length_at` gives the length of one unit of it.
struct View {
    // `sqrt(1 + (u.x + x u.y)^2 + (u.z + y u.w)^2)` is the world length of one unit of t.
    length: vec4<f32>,
    // Least corner of the drawn part of the volume's domain: whole voxels.
    box_low: vec3<i32>,
    // Rays of the picture along x.
    width: u32,
    // Greatest corner of the same: whole voxels.
    box_high: vec3<i32>,
    // Rays along y.
    height: u32,
    // Rest to add to `box_low`.
    box_low_rest: vec3<f32>,
    // First row of the band in progress.
    first_row: u32,
    // Rest to add to `box_high`.
    box_high_rest: vec3<f32>,
    // Tiles of 8 x 8 rays along x.
    tiles_x: u32,
    // Places of rays in the band: 64 for each tile.
    places: u32,
    // Clip planes.
    plane_count: u32,
    // First value of every ray's accumulator, modes mip and minip.
    first_value: f32,
    // 1 if the host provides the parts of rays (`RayPart`), else 0.
    in_parts: u32,
    // Begin of rays: a plane in front of the volume, or the eye.
    origin: array<Affine, 3>,
    // Index offset of one stride.
    stride: array<Affine, 3>,
    // `plane_count` of them count.
    planes: array<PlaneLine, 64>,
    // Zero: the size is a multiple of 16.
    padding_1: vec2<u32>,
}

// One dispatch: a run of tiles of rays, or of pixels.
struct Dispatch {
    // For a run of pixels: number of the first one in its band, row by row.
    first_pixel: u32,
    // 0 in a pass's first round, in which waiting rays look again whether their brick has come; then 1.
    later_round: u32,
    // Number of coarsest levels whose bricks are all too coarse: the search for a brick's level begins behind
    // them.
    refined_levels: u32,
    // Zero.
    padding: u32,
}

// All tables of fixed size.
struct Scene {
    // Facts of scene and volume.
    config: Config,
    // Tables.
    tables: Tables,
    // Rays.
    view: View,
    // The dispatch in progress.
    job: Dispatch,
}

// State of a ray between dispatches: 64 bytes. Its path follows from its pixel and is not stored.
struct RayState {
    // Premultiplied colour. Modes mip and minip: the extreme so far in x; mode mean: the integral of the value.
    color: vec3<f32>,
    // Share of the light behind that still passes.
    transmittance: f32,
    // Parameter beyond the strides taken.
    t: f32,
    // Strides taken: the ray's base point lies that many strides behind its origin.
    strides: u32,
    // Strides to the last base point.
    end_strides: u32,
    // Parameter from there to the end of what is drawn.
    end_rest: f32,
    // `STATUS_...`
    status: u32,
    // Modes mip, minip, mean: world length over which the value was present; with surfaces: 1 where `sides` holds.
    present: f32,
    // One bit for each surface, set if the value was not below the surface's.
    sides: u32,
    // Mode iso: one bit for each surface that was crossed already: only first crossings count.
    crossed: u32,
    // Mode dvr: rest of the reserve of the ray's budget of error.
    left: f32,
    // Mode dvr: upper bound on the share of the light behind that still passes.
    weight: f32,
    // Zero.
    padding_0: u32,
    // Zero.
    padding_1: u32,
}

// Errors of a ray so far; 1 is white. Infinity is `FAR` here.
struct RayErrors {
    // Mode dvr: sum over its cells.
    cells: f32,
    // Modes dvr and iso: sum of the deviations of coarser bricks. Mode mean: that of values, times world lengths.
    // Modes mip and minip: largest possible
    // excess of the drawn value over the exact one.
    levels: f32,
    // Modes dvr and iso: least sum plus transmittance over all places so far. Modes mip and minip: largest
    // possible excess of the exact value over the drawn one.
    bound: f32,
    // Mode dvr: largest possible excess of drawn optical depth in front.
    thinner: f32,
    // 1 if a voxel may be present in one level and absent in another.
    presence_may_change: u32,
}

// Deviation of a drawn brick from level 0: `lod::deviation::Deviation`. World lengths, render values; infinity is
// `FAR`.
struct GpuDeviation {
    // Mode dvr: error per length for each of `PER_OPACITY`.
    per_length: array<f32, 12>,
    // Mode dvr: greatest difference of the drawn extinction above the exact one.
    thinner: f32,
    // Greatest extinction, drawn or exact; `FAR` if a surface may lie beneath.
    kappa_max: f32,
    // Largest difference of a value; `FAR` if a value may be present or absent.
    value: f32,
    // Least exact value; above the greatest one if there is none.
    least: f32,
    // Greatest exact value.
    greatest: f32,
    // 1 if a voxel in the brick or beneath it may be absent.
    presence_may_change: u32,
}

// A part of a ray, if solids divide rays; `RayState` describes the numbers.
struct RayPart {
    // Place of the ray; unused beyond the band's places.
    place: u32,
    // Parameter beyond the strides to the base point.
    t: f32,
    // Strides to the base point of its begin.
    strides: u32,
    // Strides to the last base point.
    end_strides: u32,
    // Parameter from there to its end.
    end_rest: f32,
}

// Counters of one dispatch, read back after it.
struct GpuCounters {
    // Rays that stopped at the work limit.
    interrupted: u32,
    // Rays that wait for a brick.
    waiting: u32,
    // Rays that finished in this dispatch.
    finished: u32,
    // Trilinear cells integrated.
    cells: u32,
    // Points at which the transfer function was evaluated.
    samples: u32,
    // Macro cells entered.
    macro_cells: u32,
    // Macro cells skipped.
    macro_cells_skipped: u32,
    // Bricks entered.
    bricks: u32,
    // Bricks drawn from an ancestor because they have failed.
    fallbacks: u32,
    // Bricks left out because they and all their ancestors have failed.
    lost: u32,
    // Times a loop hit its limit: such a ray is not exact.
    anomalies: u32,
    // Zero.
    padding: u32,
}
