// From a position on a ray to its brick, and to the brick's entry in the page table.

// The brick at a position on a ray.
struct Region {
    brick: vec3<i32>,
    level: u32,
    // 0 if the ray has left the grid.
    found: u32,
}

// Most steps to a neighbour in a search. Rounding can misplace a point by one brick on each axis of each of two levels.
const REGION_STEPS: u32 = 16u;

// Parameters at which the ray leaves the box of `edge` voxels that begins at `first`, per axis.
fn box_crossings(ray: LevelRay, first: vec3<i32>, edge: i32) -> vec3<f32> {
    let planes = vec3<f32>(leaving_side(ray.direction) * edge) - 0.5;
    return crossings(planes, origin_from(ray, first), ray.direction);
}

// The level from which a brick of level 0 is drawn: the coarsest level whose brick need not be refined.
fn wanted_level(brick: vec3<i32>) -> u32 {
    var level = config.level_count - 1u - scene.job.refined_levels;
    loop {
        let entry = entry_of(level, brick >> scene.tables.levels[level].scale_log2);
        let is_too_coarse = level > 0u && (page_table[entry].x & PAGE_REFINE) != 0u;
        level -= u32(is_too_coarse);
        if (!is_too_coarse || level == 0u) {
            break;
        }
        work += 1u;
    }
    return level;
}

// The brick of the wanted level that contains the ray just after t.
fn region_at(ray: LevelRay, t: f32) -> Region {
    let core = i32(config.core);
    let point = vec3<i32>(floor(ray.fraction + t * ray.direction + 0.5)) + ray.voxel;
    let last = vec3<i32>(scene.tables.levels[0].bricks) - 1;
    var brick = clamp(point >> vec3<u32>(firstTrailingBit(config.core)), vec3<i32>(0), last);
    var region = Region(brick, 0u, 0u);
    var is_over = false;
    var steps = 0u;
    loop {
        work += 1u;
        steps += 1u;
        is_over = any(brick < vec3<i32>(0)) || any(brick > last);
        if (!is_over) {
            let leaves = box_crossings(ray, brick * core, core);
            if (first_crossing(leaves) <= t) {
                brick += first_axis(leaves) * step_of(ray.direction);
            } else {
                // Ancestors are computed with integers: every ray at this position makes the same choice.
                let level = wanted_level(brick);
                let shift = scene.tables.levels[level].scale_log2;
                let ancestor = brick >> shift;
                let level_leaves = box_crossings(ray_at_level(ray, level), ancestor * core, core);
                is_over = first_crossing(level_leaves) > t;
                region = Region(ancestor, level, u32(is_over));
                // The two levels round the same face differently: step out of the whole ancestor.
                let outside = ((ancestor + leaving_side(ray.direction)) << shift) + leaving_side(ray.direction) - 1;
                brick = select(brick, outside, first_axis(level_leaves) == vec3<i32>(1));
            }
        }
        if (is_over || steps >= REGION_STEPS) {
            break;
        }
    }
    anomalies += u32(!is_over);
    return region;
}

// Parameter at which the ray leaves a region.
fn region_leave(ray: LevelRay, region: Region) -> f32 {
    let core = i32(config.core);
    return first_crossing(box_crossings(ray_at_level(ray, region.level), region.brick * core, core));
}

// Entry number of a brick in the page table.
fn entry_of(level: u32, brick: vec3<i32>) -> u32 {
    let bricks = scene.tables.levels[level].bricks;
    let b = vec3<u32>(brick);
    return scene.tables.levels[level].first_entry + b.x + bricks.x * (b.y + bricks.y * b.z);
}

// The brick that a region is drawn from: its own, or its nearest ancestor that has not failed.
struct Page {
    brick: vec3<i32>,
    level: u32,
    entry: u32,
    state: u32,
    payload: u32,
    // Index of its error bounds in `deviations`.
    deviation: u32,
}

fn page_of(region: Region) -> Page {
    var level = region.level;
    var brick = region.brick;
    var entry = entry_of(level, brick);
    var page = page_table[entry];
    while ((page.x & PAGE_STATE) == PAGE_FAILED && level + 1u < config.level_count) {
        brick = brick >> (scene.tables.levels[level + 1u].scale_log2 - scene.tables.levels[level].scale_log2);
        level += 1u;
        work += 1u;
        entry = entry_of(level, brick);
        page = page_table[entry];
    }
    return Page(brick, level, entry, page.x & PAGE_STATE, page.y, page.x >> PAGE_DEVIATION_SHIFT);
}
