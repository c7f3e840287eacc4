// Stored voxels of a resident brick. Brick-local index space: the core's first voxel is 0, the apron begins at -2.

// A slot: its index, its cache texture, and its first texel there.
struct Slot {
    index: u32,
    texture: u32,
    first: vec3<i32>,
}

fn slot_at(index: u32) -> Slot {
    // TEXTURE_COUNT bounds the search: with one texture the compiler removes it.
    let first = vec3<u32>(config.grids[1].first, config.grids[2].first, config.grids[3].first);
    let texture = min(dot(vec3<u32>(vec3<u32>(index) >= first), vec3<u32>(1u)), TEXTURE_COUNT - 1u);
    var grid = config.grids[0];
    switch texture {
        case 1u: { grid = config.grids[1]; }
        case 2u: { grid = config.grids[2]; }
        case 3u: { grid = config.grids[3]; }
        default: {}
    }
    let i = index - grid.first;
    let row = quotient(i, grid.slots.x);
    let layer = quotient(row, grid.slots.y);
    let place = vec3<u32>(i - row * grid.slots.x, row - layer * grid.slots.y, layer);
    return Slot(index, texture, vec3<i32>(place * slot_texels()));
}

// Integer quotient of numbers below 2^24. Software adapters divide integers lane by lane.
fn quotient(number: u32, divisor: u32) -> u32 {
    let near = u32(f32(number) / f32(divisor));
    // Float division may be wrong by some units in the last place.
    let least = near - u32(near * divisor > number);
    return least + u32(number - least * divisor >= divisor);
}

// Texels of a slot along x, y and z.
fn slot_texels() -> vec3<u32> {
    let edge = config.core + 2u * u32(APRON);
    let across = (edge - 1u + texel_step() - 1u) / texel_step();
    return vec3<u32>(across, select(edge, across, has_flag(FLAG_BYTES)), edge);
}

// Voxels per texel step along x.
fn texel_step() -> u32 {
    return select(select(STEP_OF_HALVES, STEP_OF_FLOATS, has_flag(FLAG_FLOAT)), STEP_OF_BYTES, has_flag(FLAG_BYTES));
}

// A texel of a slot: 16 bytes of voxels of one layer (engines/gpu/cache.rs).
fn texel_of(slot: Slot, place: vec3<u32>) -> vec4<u32> {
    return cache_texel(slot.texture, slot.first + vec3<i32>(place));
}

// Stored bits of a voxel and its neighbours in its layer, in the order (x, y) = 00, 10, 01, 11.
fn stored_square(slot: Slot, voxel: vec3<i32>) -> vec4<u32> {
    let place = vec3<u32>(voxel + APRON);
    if (has_flag(FLAG_BYTES)) {
        let texel = place.xy / STEP_OF_BYTES;
        return bytes_of_square(texel_of(slot, vec3<u32>(texel, place.z)), place.xy - texel * STEP_OF_BYTES);
    }
    let texel = place.x / texel_step();
    let rest = place.x - texel * texel_step();
    let near = texel_of(slot, vec3<u32>(texel, place.yz));
    let far = texel_of(slot, vec3<u32>(texel, place.y + 1u, place.z));
    if (has_flag(FLAG_FLOAT)) {
        return vec4<u32>(pair_at(near, rest), pair_at(far, rest));
    }
    return vec4<u32>(halves_of_pair(near, rest), halves_of_pair(far, rest));
}

// Words `first` and `first + 1` of four; `first` is 0 to 2. Written as selections: on GPUs, indexing with a run-time
// index costs a fifth of a picture's time.
fn pair_at(words: vec4<u32>, first: u32) -> vec2<u32> {
    return select(select(words.zw, words.yz, first == 1u), words.xy, first == 0u);
}

// Byte (x, y) of a 4 x 4 square of bytes, its neighbour in the row, and the two in the next row.
fn bytes_of_square(rows: vec4<u32>, place: vec2<u32>) -> vec4<u32> {
    let pair = pair_at(rows, place.y) >> vec2<u32>(8u * place.x);
    return vec4<u32>(pair.x, pair.x >> 8u, pair.y, pair.y >> 8u) & vec4<u32>(0xffu);
}

// 16-bit number `place` of eight, and the next one.
fn halves_of_pair(row: vec4<u32>, place: u32) -> vec2<u32> {
    // A pair that begins at an odd place spans two words.
    let pair = pair_at(row, min(place / 2u, 2u));
    let words = select(pair, pair.yy, place / 2u == 3u);
    let both = select(vec2<u32>(words.x, words.x >> 16u), vec2<u32>(words.x >> 16u, words.y), place % 2u == 1u);
    return both & vec2<u32>(0xffffu);
}

// Macro cells along each axis of a full brick.
fn macro_edge() -> i32 {
    return i32(config.core) / MACRO_CELL;
}

// Index of a macro cell among those of all slots.
fn macro_place(slot: Slot, cell: vec3<i32>) -> u32 {
    let n = u32(macro_edge());
    let c = vec3<u32>(cell);
    return slot.index * n * n * n + c.x + n * (c.y + n * c.z);
}
