//! Division of one number of host bytes among all parts of a frame.
//!
//! | part | size |
//! |---|---|
//! | picture | 16 bytes per pixel; with a deadline a quarter more; with stated errors three times as much |
//! | rays | groups, miss list and pixel of every ray of a band; a band is the whole picture if that takes at most 1/4 |
//! | casting | working memory of every casting thread |
//! | made of bricks | data derived once from each brick and kept: 1/16, at most 32 MiB; at least one brick's |
//! | TOC pages | pages of the table of contents that the container keeps, at most 64 MiB |
//! | states | one record per brick met, 1/32 of the budget |
//! | in flight | records being read and bricks being decoded, 1/8 of the budget, at most 128 MiB |
//! | cache | the rest, less the bytes that the process holds beside the frame; at least one brick |
//!
//! Everything is computed before anything is allocated. A budget that is too small is refused with the sum of the least
//! parts. [`Demand::process_bytes`] states the bytes of the program itself: its threads' stacks and the container's
//! manifest. They reduce the cache, but never cause a refusal.

use supervol_format::cast::narrow;
use supervol_format::cell_errors::CELL_ERROR_BYTES;
use supervol_format::codec::wavelet::DECODING_BYTES_PER_VOXEL;
use supervol_format::container::reader::CACHED_TOC_PAGES;
use supervol_format::container::toc;
use supervol_format::macro_cells::MACRO_CELL_BYTES;
use supervol_format::readable::{Mib, counted};
use supervol_format::{Container, VoxelType};
use supervol_scene::value_map::{ValueMap, value_map};

use super::state::RECORD_BYTES;
use crate::stream::cache::host::BRICK_OVERHEAD_BYTES;

/// Most bytes of records and decoding buffers in flight.
pub const IN_FLIGHT_LIMIT: u64 = 128 << 20;
/// Most bytes of data derived from bricks and kept.
pub const MADE_LIMIT: u64 = 32 << 20;
/// Divisor of the budget: the share of data derived from bricks.
const MADE_SHARE: u64 = 16;
/// Bytes of one pixel of an image.
pub(crate) const PIXEL_BYTES: u64 = 16;
/// Bytes of a waiting ray in the list of misses.
const MISS_BYTES: u64 = 16;
/// Bytes of a ray beside an engine's own: its miss and its pixel.
pub(crate) const RAY_BYTES: u64 = MISS_BYTES + PIXEL_BYTES;

/// The budget is too small.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "the host budget of {} is too small: at least {} are needed ({parts}). \
     Give more memory, a smaller picture, or build the container with smaller bricks",
    Mib(*budget_bytes), Mib(*needed_bytes)
)]
pub struct BudgetError {
    /// Bytes given.
    pub budget_bytes: u64,
    /// Least bytes that suffice.
    pub needed_bytes: u64,
    /// List of the parts and their bytes.
    pub parts: String,
}

/// Sizes of one container's bricks in memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BrickBytes {
    /// A full brick in the form that ray casters read, with its cache overhead.
    pub decoded: u64,
    /// Buffers for decoding a full brick, without its record: stored voxels and intermediate data.
    pub decoding: u64,
    /// The longest record of a full brick.
    pub record: u64,
}

/// Bytes in the host cache of a macro cell: its range and its error bound.
const CELL_BYTES: u64 = (size_of::<[f32; 2]>() + CELL_ERROR_BYTES) as u64;

/// Bytes in the host cache of a brick with this many voxels and macro cells.
#[must_use]
pub fn decoded_bytes(voxel_type: VoxelType, map: &ValueMap, voxels: u64, macro_cells: u64) -> u64 {
    // One-byte and two-byte integers keep their size; all other types become f32, beside which they stay if that rounds them.
    let stored = voxel_type.bytes() as u64;
    let voxel_bytes = stored.min(4) + if map.is_rounded { stored } else { 0 };
    voxels * voxel_bytes + macro_cells * CELL_BYTES + BRICK_OVERHEAD_BYTES
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
        // The limit that the container's reader sets for payloads, and the ranges and error bounds of macro cells.
        let record = stored + stored / 64 + 1024 + (MACRO_CELL_BYTES + CELL_ERROR_BYTES) as u64 * macro_cells;
        let decoding = stored + voxels * DECODING_BYTES_PER_VOXEL as u64;
        Self { decoded: decoded_bytes(voxel_type, &value_map(container), voxels, macro_cells), decoding, record }
    }
}

/// Whether an engine can draw a picture in bands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BandMode {
    /// Bands of pixel rows, one after the other.
    Allowed,
    /// The whole picture at once.
    Whole,
}

/// Host memory of an engine.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EngineBytes {
    /// Whether rays may be cast band by band.
    pub bands: BandMode,
    /// Edge of the square groups in which rays are kept between passes, rays; at least 1.
    pub group_side: u32,
    /// Bytes of a group whose rays wait, including rays outside the picture. Finished groups take less.
    pub group: u64,
    /// Bytes of working memory of a casting thread.
    pub thread: u64,
    /// Most bytes derived from one brick.
    pub made_of_brick: u64,
    /// Bytes per pixel of the statements made beside its colour.
    pub of_pixel: u64,
    /// Bytes per ray of the whole picture, beside those of a band.
    pub of_ray: u64,
}

impl EngineBytes {
    /// An engine without host memory of its own, which draws the whole picture at once.
    pub const NONE: Self =
        Self { bands: BandMode::Whole, group_side: 1, group: 0, thread: 0, made_of_brick: 0, of_pixel: 0, of_ray: 0 };
}

/// Reserve of memory for deadlines. With it, the coarsest brick stays in the cache, beside the brick that makes
/// progress. A coarser picture, of pixels at least twice as large, is kept while the next one is cast.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DeadlineReserve {
    /// Pictures have no deadline.
    None,
    /// A picture may have a deadline.
    Kept,
}

impl DeadlineReserve {
    /// Reserve for one picture, with or without a deadline.
    #[must_use]
    pub fn of<T>(deadline: Option<T>) -> Self {
        deadline.map_or(Self::None, |_| Self::Kept)
    }
}

/// The memory needs of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Demand {
    /// Width and height of the picture, pixels.
    pub image_size: [u32; 2],
    /// Rays along one edge of a pixel.
    pub subgrid: u32,
    /// Host memory of the engine.
    pub engine: EngineBytes,
    /// Sizes of bricks.
    pub brick: BrickBytes,
    /// Memory for deadlines.
    pub reserve: DeadlineReserve,
    /// Threads that cast and decode.
    pub threads: u64,
    /// TOC pages of the container.
    pub toc_pages: u64,
    /// Bytes that the process holds beside the frame.
    pub process_bytes: u64,
}

/// The division of the budget.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HostPlan {
    /// Bytes given.
    pub budget_bytes: u64,
    /// Pixel rows cast at once.
    pub band_rows: u32,
    /// Bytes of picture, rays, casting threads and TOC pages.
    pub fixed_bytes: u64,
    /// Most bytes of data derived from bricks and kept.
    pub made_bytes: u64,
    /// Most bricks whose state is remembered.
    pub state_limit: usize,
    /// Most bytes of records and decoding buffers.
    pub in_flight_bytes: u64,
    /// Bytes of the host cache.
    pub cache_bytes: u64,
}

impl Demand {
    /// Bytes of the rays of a band of `band_rows` pixel rows: whole groups, and the parts kept per ray.
    fn ray_bytes(&self, band_rows: u64) -> u64 {
        let [columns, rows] = [u64::from(self.image_size[0]), band_rows].map(|n| n * u64::from(self.subgrid));
        let groups = [columns, rows].map(|n| n.div_ceil(u64::from(self.engine.group_side)));
        groups[0] * groups[1] * self.engine.group + columns * rows * RAY_BYTES
    }

    /// Most pixel rows of a band whose rays take at most `bytes`; at least 1, whole groups if possible.
    fn band_rows(&self, bytes: u64) -> u64 {
        let height = u64::from(self.image_size[1]);
        if self.engine.bands == BandMode::Whole || self.ray_bytes(height) <= bytes {
            return height;
        }
        let (mut fits, mut too_many) = (1, height);
        while fits + 1 < too_many {
            let middle = fits.midpoint(too_many);
            if self.ray_bytes(middle) <= bytes { fits = middle } else { too_many = middle }
        }
        let [side, subgrid] = [self.engine.group_side, self.subgrid].map(u64::from);
        let of_whole_groups = fits * subgrid / side * side / subgrid;
        if of_whole_groups > 0 { of_whole_groups } else { fits }
    }
}

impl HostPlan {
    /// Divides the budget.
    ///
    /// # Errors
    /// If the budget is smaller than the sum of the least parts.
    pub fn new(budget_bytes: u64, demand: &Demand) -> Result<Self, BudgetError> {
        let [width, height] = demand.image_size.map(u64::from);
        let image = width * height * PIXEL_BYTES;
        let (coarser_image, least_bricks) = match demand.reserve {
            DeadlineReserve::None => (0, 1),
            DeadlineReserve::Kept => (image.div_ceil(4), 2),
        };
        let of_rays = u64::from(demand.subgrid).pow(2) * demand.engine.of_ray;
        let image = image + coarser_image + width * height * (demand.engine.of_pixel + of_rays);
        let casting = demand.threads * demand.engine.thread;
        let toc = demand.toc_pages.min(CACHED_TOC_PAGES as u64) * toc::PAGE_BYTES as u64;
        let scratch = demand.threads * demand.brick.decoding;
        let least_in_flight = demand.brick.record + scratch;
        let in_flight = (budget_bytes / 8).min(IN_FLIGHT_LIMIT).max(least_in_flight);
        let least_made = demand.engine.made_of_brick;
        let made = if least_made > 0 { (budget_bytes / MADE_SHARE).min(MADE_LIMIT).max(least_made) } else { 0 };
        let states = budget_bytes / 32;
        let least_cache = least_bricks * demand.brick.decoded;
        // The band is limited by the least of all other parts. Otherwise more memory would raise the need.
        let least_others = image + casting + toc + states + least_made + least_in_flight + least_cache;
        let band_rows = demand.band_rows((budget_bytes / 4).min(budget_bytes.saturating_sub(least_others)));
        let rays = demand.ray_bytes(band_rows);
        let fixed = image + rays + casting + toc;
        // If the cache would get too little, derived data shrinks to one brick's and reads in flight to one record.
        let has_room = fixed + states + made + in_flight + least_cache <= budget_bytes;
        let (made, in_flight) = if has_room { (made, in_flight) } else { (least_made, least_in_flight) };
        let needed = fixed + states + made + in_flight + least_cache;
        if needed > budget_bytes {
            return Err(BudgetError {
                budget_bytes,
                // The states' share grows with the budget: solve for the budget, rounding up.
                needed_bytes: ((needed - states) * 32).div_ceil(31),
                parts: format!(
                    "picture {}, rays {}, casting {}, made of a brick {}, table of contents {}, reading and decoding {}, \
                     cache for {} of {}, and 1/32 for the states of bricks",
                    Mib(image),
                    Mib(rays),
                    Mib(casting),
                    Mib(made),
                    Mib(toc),
                    Mib(in_flight),
                    counted(least_bricks, "brick"),
                    Mib(demand.brick.decoded)
                ),
            });
        }
        Ok(Self {
            budget_bytes,
            band_rows: narrow::<u32>(band_rows),
            fixed_bytes: fixed,
            made_bytes: made,
            state_limit: usize::try_from(states / RECORD_BYTES).unwrap_or(usize::MAX),
            in_flight_bytes: in_flight - scratch,
            cache_bytes: (budget_bytes - fixed - made - states - in_flight)
                .saturating_sub(demand.process_bytes)
                .max(least_cache),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const IN_GROUPS: EngineBytes = EngineBytes {
        bands: BandMode::Allowed,
        group_side: 16,
        group: 24_000,
        thread: 250_000,
        made_of_brick: 5_000,
        of_pixel: 0,
        of_ray: 0,
    };

    fn demand() -> Demand {
        Demand {
            image_size: [800, 600],
            subgrid: 1,
            engine: IN_GROUPS,
            brick: BrickBytes { decoded: 1_300_000, decoding: 1_250_000, record: 1_280_000 },
            reserve: DeadlineReserve::None,
            threads: 2,
            toc_pages: 3,
            process_bytes: 0,
        }
    }

    #[test]
    fn parts_never_exceed_the_budget_and_the_least_budget_is_told_exactly() {
        let error = HostPlan::new(1, &demand()).unwrap_err();
        assert!(error.to_string().contains("cache for 1 brick of 1.3 MiB"), "{error}");
        assert!(error.to_string().contains("casting 0.477 MiB, made of a brick 0.005 MiB,"), "{error}");
        let mut least = error.needed_bytes;
        // Bands shrink to one row at first; with a larger budget they may take up to a quarter of it.
        while let Err(error) = HostPlan::new(least, &demand()) {
            assert!(error.needed_bytes > least, "a budget that is said to suffice must suffice");
            least = error.needed_bytes;
        }
        for budget in [least, least + 1, 2 * least, 512 << 20, 64 << 30] {
            let plan = HostPlan::new(budget, &demand()).unwrap();
            let states = plan.state_limit as u64 * RECORD_BYTES;
            let scratch = 2 * demand().brick.decoding;
            let parts = plan.fixed_bytes + plan.made_bytes + states + plan.in_flight_bytes + scratch + plan.cache_bytes;
            assert!(parts <= budget && parts + RECORD_BYTES > budget, "{parts} of {budget}");
            assert!(plan.cache_bytes >= demand().brick.decoded && plan.in_flight_bytes >= demand().brick.record);
            assert!((IN_GROUPS.made_of_brick..=MADE_LIMIT).contains(&plan.made_bytes));
        }
        assert_eq!(HostPlan::new(1 << 30, &demand()).unwrap().band_rows, 600);
        assert_eq!(HostPlan::new(1 << 30, &demand()).unwrap().made_bytes, MADE_LIMIT);
        assert_eq!(HostPlan::new(64 << 20, &demand()).unwrap().made_bytes, 4 << 20);
    }

    #[test]
    fn what_the_process_holds_is_taken_off_the_cache_as_far_as_that_goes() {
        let plan = |budget, process_bytes| HostPlan::new(budget, &Demand { process_bytes, ..demand() });
        let (all, less) = (plan(64 << 20, 0).unwrap(), plan(64 << 20, 9 << 20).unwrap());
        assert_eq!(HostPlan { cache_bytes: all.cache_bytes - (9 << 20), ..all }, less);
        let least = plan(1, 0).unwrap_err().needed_bytes;
        assert_eq!(plan(1, 9 << 20).unwrap_err().needed_bytes, least);
        let little = plan(64 << 20, 1 << 30).unwrap();
        assert_eq!(little.cache_bytes, demand().brick.decoded);
    }

    #[test]
    fn groups_threads_and_what_is_made_of_bricks_are_counted() {
        let pixels = 800 * 600;
        let plan = |engine| HostPlan::new(1 << 30, &Demand { engine, ..demand() }).unwrap();
        let (without, with) = (plan(EngineBytes::NONE), plan(IN_GROUPS));
        // 600 rows are 37 groups and a half.
        assert_eq!(with.fixed_bytes - without.fixed_bytes, 50 * 38 * 24_000 + 2 * 250_000);
        assert_eq!(without.fixed_bytes, pixels * (16 + 32) + 3 * toc::PAGE_BYTES as u64);
        assert_eq!((without.made_bytes, with.made_bytes), (0, MADE_LIMIT));
        let spent = |plan: HostPlan| plan.fixed_bytes + plan.made_bytes;
        assert_eq!(without.cache_bytes - with.cache_bytes, spent(with) - spent(without));
    }

    #[test]
    fn pictures_whose_rays_exceed_a_quarter_are_cast_in_bands_of_whole_groups() {
        let large = Demand { image_size: [8000, 8000], subgrid: 4, ..demand() };
        let plan = HostPlan::new(2 << 30, &large).unwrap();
        assert!(plan.band_rows < 8000 && plan.band_rows.is_multiple_of(4), "{plan:?}");
        // One more row of groups would be too much.
        assert!(large.ray_bytes(u64::from(plan.band_rows)) <= (2 << 30) / 4);
        assert!(large.ray_bytes(u64::from(plan.band_rows) + 4) > (2 << 30) / 4);
        let whole = Demand { engine: EngineBytes { bands: BandMode::Whole, ..IN_GROUPS }, ..large };
        assert!(HostPlan::new(2 << 30, &whole).unwrap_err().needed_bytes > 16 * 64_000_000 * 80);
    }

    #[test]
    fn the_least_budget_that_is_named_suffices() {
        for image_size in [[40, 32], [800, 600], [8000, 8000]] {
            for subgrid in [1, 3, 32] {
                let demand = Demand { image_size, subgrid, ..demand() };
                let least = HostPlan::new(1, &demand).unwrap_err().needed_bytes;
                let plan = HostPlan::new(least, &demand).unwrap();
                assert_eq!((plan.band_rows, plan.made_bytes), (1, IN_GROUPS.made_of_brick));
                assert!(HostPlan::new(least - 32, &demand).is_err());
            }
        }
    }
}
