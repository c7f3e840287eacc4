//! Memory plan of the GPU backend: bytes of everything, computed before anything is allocated.
//!
//! The budget covers the cache textures with their macro ranges, the page table, and the miss counters. It also covers
//! rays and their states, feedback, and staging for uploads and read-back. The parts that the scene fixes come first;
//! slots take the rest.

use crate::engines::gpu::error::GpuError;
use crate::engines::gpu::limits::TEXTURE_LIMIT;
use crate::engines::gpu::texels::TEXEL_BYTES;

/// Most bytes of one cache texture: the limit of the strictest driver that we know (lavapipe).
pub const TEXTURE_BYTES_LIMIT: u64 = 1 << 31;

/// Fewest slots to start with; one brick suffices for progress, two let a ray keep the one it left.
pub const MIN_SLOTS: u64 = 2;

/// Most slots in all: a use bitmap of 2 MiB.
pub const SLOT_LIMIT: u64 = 1 << 24;

/// Divisor: share of the slots that may be given up for a grid with a better memory layout.
const GRID_SPARE: u64 = 64;

/// Most bytes of voxels in flight between host and GPU.
pub const STAGING_BYTES_LIMIT: u64 = 32 << 20;

/// Request for a memory plan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MemoryRequest {
    /// The user's limit, bytes.
    pub budget_bytes: u64,
    /// Bytes that the scene fixes: rays, states, page table, counters, feedback, transfer function.
    pub fixed_bytes: u64,
    /// Texels of a slot along x, y and z.
    pub slot_texels: [u32; 3],
    /// Bytes of macro ranges beside each slot.
    pub ranges_bytes: u64,
    /// Number of bricks: more slots are useless.
    pub useful_slots: u64,
    /// Largest 3D texture dimension of the device.
    pub max_dimension: u32,
    /// Largest storage binding of the device, bytes.
    pub max_binding_bytes: u64,
}

/// Memory to allocate.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MemoryPlan {
    /// Slots along x, y, z of each cache texture; 1 to [`TEXTURE_LIMIT`] textures.
    pub textures: Vec<[u32; 3]>,
    /// Slots in all.
    pub slots: u64,
    /// Bytes of one slot: texels and macro ranges.
    pub slot_bytes: u64,
    /// Bytes for voxels in flight.
    pub staging_bytes: u64,
    /// Everything, bytes.
    pub total_bytes: u64,
}

impl MemoryPlan {
    /// A plan with as many slots as fit.
    ///
    /// # Errors
    /// [`GpuError::Budget`] if fewer than [`MIN_SLOTS`] fit.
    pub fn new(request: &MemoryRequest) -> Result<Self, GpuError> {
        let texels = slot_texels_bytes(request.slot_texels);
        let slot_bytes = texels + request.ranges_bytes;
        let min_slots = MIN_SLOTS.min(request.useful_slots);
        // The least staging holds one brick.
        let needed = request.fixed_bytes.saturating_add(texels + slot_bytes * min_slots);
        let too_small = || GpuError::Budget {
            budget: request.budget_bytes,
            fixed: request.fixed_bytes + texels,
            slot_bytes,
            min_slots,
            needed,
        };
        if needed > request.budget_bytes {
            return Err(too_small());
        }
        let spare = request.budget_bytes - needed;
        let staging_bytes = (spare / 16).clamp(texels, STAGING_BYTES_LIMIT.max(texels)).min(spare + texels);
        let fixed = request.fixed_bytes + staging_bytes;
        let by_ranges = request.max_binding_bytes / request.ranges_bytes.max(1);
        let mut wanted =
            ((request.budget_bytes - fixed) / slot_bytes).min(request.useful_slots).min(by_ranges).min(SLOT_LIMIT);

        let per_texture = TEXTURE_BYTES_LIMIT / texels;
        let per_axis = request.slot_texels.map(|n| u64::from(request.max_dimension / n));
        let mut textures = Vec::new();
        while wanted > 0 && textures.len() < TEXTURE_LIMIT && !per_axis.contains(&0) {
            let grid = best_grid(wanted.min(per_texture), per_axis);
            let slots = grid.iter().map(|&n| u64::from(n)).product::<u64>();
            if slots == 0 {
                break;
            }
            textures.push(grid);
            // A grid may leave a few slots unused; a texture for so few is not worth its binding.
            wanted -= slots;
            if wanted < slots / 32 {
                break;
            }
        }
        let slots = textures.iter().map(|g| g.iter().map(|&n| u64::from(n)).product::<u64>()).sum();
        if slots < min_slots {
            return Err(too_small());
        }
        Ok(Self { textures, slots, slot_bytes, staging_bytes, total_bytes: fixed + slots * slot_bytes })
    }
}

/// Bytes of a slot's texels.
fn slot_texels_bytes(texels: [u32; 3]) -> u64 {
    texels.iter().map(|&n| u64::from(n)).product::<u64>() * TEXEL_BYTES as u64
}

/// The grid of at most `count` slots, with axes of at most `longest`. It has nearly as many slots as possible; among
/// these, as few as possible along x, then along y. In textures stored row by row and layer by layer, a brick's rows
/// and layers are then closer together.
fn best_grid(count: u64, longest: [u64; 3]) -> [u32; 3] {
    let most_along = |rest: u64, axis: usize| rest.min(longest[axis]);
    let grids = || {
        (1..=most_along(count, 0))
            .flat_map(move |x| (1..=most_along(count / x, 1)).map(move |y| [x, y, most_along(count / (x * y), 2)]))
    };
    let slots = |grid: &[u64; 3]| grid.iter().product::<u64>();
    let most = grids().map(|grid| slots(&grid)).max().unwrap_or(0);
    let best = grids().find(|grid| slots(grid) >= most - most / GRID_SPARE).unwrap_or([0; 3]);
    best.map(|n| u32::try_from(n).expect("an axis is not longer than `longest`"))
}

#[cfg(test)]
mod tests {
    use super::*;

    const REQUEST: MemoryRequest = MemoryRequest {
        budget_bytes: 256 << 20,
        fixed_bytes: 10 << 20,
        slot_texels: [23, 23, 68],
        ranges_bytes: 4096,
        useful_slots: 1 << 30,
        max_dimension: 2048,
        max_binding_bytes: 128 << 20,
    };

    #[test]
    fn the_plan_keeps_the_budget_and_uses_most_of_it() {
        for budget_mib in [12, 17, 64, 100, 256, 1000, 3000, 9000, 20000] {
            let request = MemoryRequest { budget_bytes: budget_mib << 20, ..REQUEST };
            let plan = MemoryPlan::new(&request).expect("the budget is large enough");
            assert!(plan.total_bytes <= request.budget_bytes, "{plan:?}");
            assert!(plan.textures.len() <= TEXTURE_LIMIT, "{plan:?}");
            for grid in &plan.textures {
                let size: [u32; 3] = std::array::from_fn(|axis| grid[axis] * REQUEST.slot_texels[axis]);
                assert!(size.iter().all(|&n| n <= REQUEST.max_dimension), "{plan:?}");
                assert!(slot_texels_bytes(size) <= TEXTURE_BYTES_LIMIT, "{plan:?}");
            }
            let room = ((request.budget_bytes - 10 * (1 << 20) - plan.staging_bytes) / plan.slot_bytes)
                .min(TEXTURE_LIMIT as u64 * (TEXTURE_BYTES_LIMIT / slot_texels_bytes(REQUEST.slot_texels)));
            assert!(plan.slots * 10 >= room * 9, "{} of {room} slots: {plan:?}", plan.slots);
        }
    }

    #[test]
    fn grids_lie_along_z_before_y_and_y_before_x() {
        assert_eq!(best_grid(450, [89, 89, 30]), [1, 15, 30]);
        assert_eq!(best_grid(7919, [89, 89, 30]), [3, 87, 30], "a prime, and one in 64 slots to spare");
        assert_eq!(best_grid(1, [89, 89, 30]), [1; 3]);
        assert_eq!(best_grid(1 << 20, [89, 89, 30]), [88, 89, 30]);
    }

    #[test]
    fn no_more_slots_than_bricks() {
        let plan = MemoryPlan::new(&MemoryRequest { useful_slots: 9, ..REQUEST }).expect("the budget is large enough");
        assert_eq!(plan.slots, 9);
        assert_eq!(plan.textures, [[1, 1, 9]]);
        let one = MemoryPlan::new(&MemoryRequest { useful_slots: 1, ..REQUEST }).expect("the budget is large enough");
        assert_eq!(one.slots, 1);
    }

    #[test]
    fn too_little_says_how_much_is_needed() {
        let request = MemoryRequest { budget_bytes: 11 << 20, fixed_bytes: (11 << 20) - 1000, ..REQUEST };
        let Err(GpuError::Budget { needed, .. }) = MemoryPlan::new(&request) else { panic!("the budget was accepted") };
        let plan =
            MemoryPlan::new(&MemoryRequest { budget_bytes: needed, ..request }).expect("the named bytes suffice");
        assert_eq!(plan.slots, MIN_SLOTS);
    }
}
