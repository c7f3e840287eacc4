//! One number of host bytes, divided among all that a frame holds in memory.
//!
//! | part | size |
//! |---|---|
//! | picture | 16 bytes per pixel |
//! | rays | state, miss list and pixel of every ray of a band; a band is the whole picture if that takes at most 1/4 |
//! | TOC pages | what the container keeps of its table of contents, at most 64 MiB |
//! | states | one record per brick that was met, 1/32 of the budget |
//! | in flight | records being read and bricks being decoded, 1/8 of the budget, at most 128 MiB |
//! | cache | the rest; at least one brick |
//!
//! Everything is computed before anything is allocated; a budget that is too small is refused with the sum of the least
//! parts. Not counted: the program itself, its threads' stacks, and the container's manifest.

use supervol_format::container::reader::CACHED_TOC_PAGES;
use supervol_format::container::toc;
use supervol_format::{Container, VoxelType};

use super::io::{GAP_BYTES, READ_BYTES};
use super::state::RECORD_BYTES;
use crate::cache::host::BRICK_OVERHEAD_BYTES;

/// Most bytes of records and decoding buffers in flight.
pub const IN_FLIGHT_LIMIT: u64 = 128 << 20;
/// Bytes of one pixel of an image.
const PIXEL_BYTES: u64 = 16;
/// Bytes that a waiting ray costs in the list of misses.
const MISS_BYTES: u64 = 16;

/// The budget is too small.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "the host budget of {budget_bytes} bytes is too small: at least {needed_bytes} bytes are needed ({parts}). \
     Give more memory, a smaller picture, or build the container with smaller bricks"
)]
pub struct BudgetError {
    /// Bytes given.
    pub budget_bytes: u64,
    /// Least bytes that suffice.
    pub needed_bytes: u64,
    /// What they are needed for.
    pub parts: String,
}

/// Sizes of one container's bricks in memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BrickBytes {
    /// A full brick as the ray casters read it, with its place in the cache.
    pub decoded: u64,
    /// Stored voxels of a full brick: what a decoder writes.
    pub stored: u64,
    /// The longest record of a full brick.
    pub record: u64,
}

/// Bytes in the host cache of a brick with this many voxels and macro cells.
#[must_use]
pub fn decoded_bytes(voxel_type: VoxelType, voxels: u64, macro_cells: u64) -> u64 {
    // One and two byte integers stay as they are, all others become f32; a macro cell has two f32.
    let voxel_bytes = voxel_type.bytes().min(4) as u64;
    voxels * voxel_bytes + macro_cells * 8 + BRICK_OVERHEAD_BYTES
}

impl BrickBytes {
    /// The sizes of a container's largest bricks.
    #[must_use]
    pub fn of(container: &Container) -> Self {
        let layout = container.pyramid().layout();
        let voxel_type = container.descriptor().voxel_type;
        let voxels = (layout.stored() as u64).pow(3);
        let macro_cells = (layout.core() as u64).div_ceil(supervol_format::brick::MACRO_CELL as u64).pow(3);
        let stored = voxels * voxel_type.bytes() as u64;
        // The bound that the container's reader puts on payloads, and two bytes per macro cell.
        let record = stored + stored / 64 + 1024 + 2 * macro_cells;
        Self { decoded: decoded_bytes(voxel_type, voxels, macro_cells), stored, record }
    }
}

/// Whether a ray caster can cast a picture in parts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Bands {
    /// Some rows of pixels at a time.
    Allowed,
    /// The whole picture at once.
    Whole,
}

/// What a frame needs memory for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Demand {
    /// Pixels of the picture.
    pub image_size: [u32; 2],
    /// Rays along one edge of a pixel.
    pub subgrid: u32,
    /// Bytes of one ray's state; 0 where rays are not kept in host memory.
    pub ray_state_bytes: u64,
    /// Whether rays may be cast band by band.
    pub bands: Bands,
    /// Sizes of bricks.
    pub brick: BrickBytes,
    /// Bricks that the cache must hold at once.
    pub least_bricks: u64,
    /// Threads that decode.
    pub threads: u64,
    /// TOC pages of the container.
    pub toc_pages: u64,
}

/// The division of the budget.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HostPlan {
    /// Bytes given.
    pub budget_bytes: u64,
    /// Pixel rows that are cast at once.
    pub band_rows: u32,
    /// Bytes of picture, rays and TOC pages.
    pub fixed_bytes: u64,
    /// Most bricks whose state is remembered.
    pub state_limit: usize,
    /// Most bytes of records and decoding buffers.
    pub in_flight_bytes: u64,
    /// Bytes of the host cache.
    pub cache_bytes: u64,
}

impl HostPlan {
    /// Divides the budget.
    ///
    /// # Errors
    /// If it is too small for the least of every part.
    pub fn new(budget_bytes: u64, demand: &Demand) -> Result<Self, BudgetError> {
        let [width, height] = demand.image_size.map(u64::from);
        let subgrid = u64::from(demand.subgrid);
        let image = width * height * PIXEL_BYTES;
        let row = width * subgrid * subgrid * (demand.ray_state_bytes + MISS_BYTES + PIXEL_BYTES);
        let band_rows = match demand.bands {
            Bands::Allowed => (budget_bytes / 4 / row.max(1)).clamp(1, height),
            Bands::Whole => height,
        };
        let toc = demand.toc_pages.min(CACHED_TOC_PAGES as u64) * toc::PAGE_BYTES as u64;
        let scratch = demand.threads * demand.brick.stored;
        let least_in_flight = demand.brick.record + scratch;
        let in_flight = (budget_bytes / 8).min(IN_FLIGHT_LIMIT).max(least_in_flight);
        let states = budget_bytes / 32;
        let least_cache = demand.least_bricks * demand.brick.decoded;
        // A band is no higher than the least of all other parts allows: otherwise more memory would raise the need.
        let least_others = image + toc + states + least_in_flight + least_cache;
        let band_rows = match demand.bands {
            Bands::Allowed => band_rows.min(budget_bytes.saturating_sub(least_others) / row.max(1)).max(1),
            Bands::Whole => band_rows,
        };
        let rays = band_rows * row;
        let fixed = image + rays + toc;
        // Where the shares leave too little for the cache, reads in flight go down to one record.
        let in_flight =
            if fixed + states + in_flight + least_cache > budget_bytes { least_in_flight } else { in_flight };
        let needed = fixed + states + in_flight + least_cache;
        if needed > budget_bytes {
            return Err(BudgetError {
                budget_bytes,
                // The states' share grows with the budget: solve for the budget, rounding up.
                needed_bytes: ((needed - states) * 32).div_ceil(31),
                parts: format!(
                    "picture {image}, rays {rays}, table of contents {toc}, reading and decoding {in_flight}, \
                     cache for {} of {} bytes, and 1/32 for the states of bricks",
                    plural(demand.least_bricks, "brick"),
                    demand.brick.decoded
                ),
            });
        }
        Ok(Self {
            budget_bytes,
            band_rows: band_rows as u32,
            fixed_bytes: fixed,
            state_limit: usize::try_from(states / RECORD_BYTES).unwrap_or(usize::MAX),
            in_flight_bytes: in_flight - scratch,
            cache_bytes: budget_bytes - fixed - states - in_flight,
        })
    }
}

/// Bytes that reading a record may hold in memory, the gap to the next one included.
#[must_use]
pub fn record_in_flight(record_bytes: u64) -> u64 {
    record_bytes + GAP_BYTES.min(READ_BYTES)
}

fn plural(n: u64, thing: &str) -> String {
    if n == 1 { format!("1 {thing}") } else { format!("{n} {thing}s") }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn demand() -> Demand {
        Demand {
            image_size: [800, 600],
            subgrid: 1,
            ray_state_bytes: 64,
            bands: Bands::Allowed,
            brick: BrickBytes { decoded: 1_300_000, stored: 1_250_000, record: 1_280_000 },
            least_bricks: 1,
            threads: 2,
            toc_pages: 3,
        }
    }

    #[test]
    fn parts_never_exceed_the_budget_and_the_least_budget_is_told_exactly() {
        let error = HostPlan::new(1, &demand()).unwrap_err();
        assert!(error.to_string().contains("cache for 1 brick of 1300000 bytes"), "{error}");
        let mut least = error.needed_bytes;
        // Bands shrink to one row at first; with a larger budget they may take up to a quarter of it.
        while let Err(error) = HostPlan::new(least, &demand()) {
            assert!(error.needed_bytes > least, "a budget that is said to suffice must suffice");
            least = error.needed_bytes;
        }
        for budget in [least, least + 1, 2 * least, 512 << 20, 64 << 30] {
            let plan = HostPlan::new(budget, &demand()).unwrap();
            let states = plan.state_limit as u64 * RECORD_BYTES;
            let scratch = 2 * demand().brick.stored;
            assert!(plan.fixed_bytes + states + plan.in_flight_bytes + scratch + plan.cache_bytes <= budget);
            assert!(plan.cache_bytes >= demand().brick.decoded && plan.in_flight_bytes >= demand().brick.record);
        }
        assert_eq!(HostPlan::new(1 << 30, &demand()).unwrap().band_rows, 600);
    }

    #[test]
    fn pictures_whose_rays_exceed_a_quarter_are_cast_in_bands() {
        let large = Demand { image_size: [8000, 8000], subgrid: 4, ..demand() };
        let plan = HostPlan::new(2 << 30, &large).unwrap();
        assert!(plan.band_rows < 8000 && plan.band_rows >= 1, "{plan:?}");
        let whole = Demand { bands: Bands::Whole, ..large };
        assert!(HostPlan::new(2 << 30, &whole).unwrap_err().needed_bytes > 16 * 64_000_000 * 80);
    }

    #[test]
    fn the_least_budget_that_is_named_suffices() {
        for image_size in [[40, 32], [800, 600], [8000, 8000]] {
            let demand = Demand { image_size, ..demand() };
            let least = HostPlan::new(1, &demand).unwrap_err().needed_bytes;
            assert_eq!(HostPlan::new(least, &demand).unwrap().band_rows, 1);
            assert!(HostPlan::new(least - 32, &demand).is_err());
        }
    }
}
