// Stored voxels of a resident brick. Brick-local index space: the core's first voxel is 0, the apron begins at -2.

// A slot: its cache texture, and the texel of the core's first voxel.
struct Slot {
    index: u32,
    texture: u32,
    first: vec3<i32>,
}

fn slot_at(index: u32) -> Slot {
    let last = vec3<u32>(scene.config.grids[1].first, scene.config.grids[2].first, scene.config.grids[3].first);
    let texture = dot(vec3<u32>(vec3<u32>(index) >= last), vec3<u32>(1u));
    let grid = scene.config.grids[texture];
    let i = index - grid.first;
    let place = vec3<u32>(i % grid.slots.x, (i / grid.slots.x) % grid.slots.y, i / (grid.slots.x * grid.slots.y));
    let edge = i32(config.core) + 2 * APRON;
    return Slot(index, texture, vec3<i32>(place) * edge + APRON);
}

// The stored bits of one voxel.
fn stored(slot: Slot, voxel: vec3<i32>) -> u32 {
    let texel = slot.first + voxel;
    switch min(slot.texture, TEXTURE_COUNT - 1u) {
        case 0u: { return textureLoad(cache_0, texel, 0).x; }
        case 1u: { return textureLoad(cache_1, texel, 0).x; }
        case 2u: { return textureLoad(cache_2, texel, 0).x; }
        default: { return textureLoad(cache_3, texel, 0).x; }
    }
}

// Macro cells along each axis of a full brick.
fn macro_edge() -> i32 {
    return i32(config.core) / MACRO_CELL;
}

// Number of a macro cell among all.
fn macro_place(slot: Slot, cell: vec3<i32>) -> u32 {
    let n = u32(macro_edge());
    let c = vec3<u32>(cell);
    return slot.index * n * n * n + c.x + n * (c.y + n * c.z);
}
