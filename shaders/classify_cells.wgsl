// Finds the visible macro cells of a slot under the transfer function, and the distance of each other cell to the
// nearest visible one. One workgroup per listed slot. Chebyshev distances are computed axis by axis.

@group(1) @binding(0) var<storage, read> slots_to_classify: array<u32>;
// Ranges of the eight blocks of each macro cell, two blocks per word. Least and greatest value are shares of the cell's
// own range, in units of 1/PARTS.
@group(1) @binding(1) var<storage, read> block_ranges: array<vec4<u32>>;

// Number of parts that a macro cell's range is divided into.
const PARTS: u32 = 255u;

// Most macro cells along an axis of a brick.
const MOST_CELLS: u32 = 16u;
var<private> along: array<u32, 16>;

// One step of the distance transform along a line of cells that are `step` apart. Each cell k of the line gives a
// bound: the greater of the distance to k along the line and k's distance by earlier axes. The new distance is the
// least bound.
fn sweep(first: u32, step: u32, edge: u32) {
    let count = min(edge, MOST_CELLS);
    for (var i = 0u; i < count; i += 1u) {
        along[i] = proximity[first + i * step];
    }
    for (var i = 0u; i < count; i += 1u) {
        var nearest = along[i];
        for (var k = 1u; k < nearest; k += 1u) {
            let before = select(edge, along[i - min(k, i)], k <= i);
            let behind = select(edge, along[min(i + k, count - 1u)], i + k < count);
            nearest = min(nearest, max(k, min(before, behind)));
        }
        proximity[first + i * step] = nearest;
    }
}

// Proximity value of a visible macro cell: one bit for each of its visible blocks.
fn shown_blocks(cell: u32) -> u32 {
    let range = macro_ranges[cell];
    let blocks = block_ranges[cell];
    var shown = 0u;
    for (var i = 0u; i < 8u; i += 1u) {
        let ends = vec2<u32>(blocks[i / 2u] >> (16u * (i % 2u))) >> vec2<u32>(0u, 8u) & vec2<u32>(PARTS);
        let within = range.x + (range.y - range.x) * (vec2<f32>(ends) / f32(PARTS));
        // The sum may be rounded; the last part must end exactly at the range's end.
        let high = select(within.y, range.y, ends.y == PARTS);
        shown |= select(0u, FIRST_BLOCK << i, is_shown(vec2<f32>(within.x, high)));
    }
    return shown;
}

@compute @workgroup_size(64)
fn classify_cells(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    config = scene.config;
    let edge = config.core / u32(MACRO_CELL);
    let cells = edge * edge * edge;
    let first = slots_to_classify[group.x] * cells;
    for (var cell = lane; cell < cells; cell += 64u) {
        proximity[first + cell] = select(edge, 0u, is_shown(macro_ranges[first + cell]));
    }
    storageBarrier();
    var step = 1u;
    for (var axis = 0u; axis < 3u; axis += 1u) {
        // A lane owns whole lines of cells, so that no lane reads a cell that another lane has overwritten.
        for (var line = lane; line < edge * edge; line += 64u) {
            let cell = line % step + line / step * step * edge;
            sweep(first + cell, step, edge);
        }
        storageBarrier();
        step *= edge;
    }
    for (var cell = first + lane; cell < first + cells; cell += 64u) {
        if (proximity[cell] == 0u) {
            proximity[cell] = shown_blocks(cell);
        }
    }
}
