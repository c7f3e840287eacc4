//! Resident bricks on the GPU: cache textures, macro ranges, page table, and the visibility of bricks under a look.
//!
//! Voxels are stored as unsigned integers, or as the bits of floats. `textureLoad` reads them exactly and needs no
//! optional features; the shader filters in `f32`, not with 8-bit fractions. [`super::texels`] packs the texels.
//! Everything is written through the queue; the plan's staging bytes limit the amount that is on its way.

use supervol_format::cast::narrow;

use super::deviations::DeviationTable;
use super::device::GpuDevice;
use super::layout::SlotGrid;
use super::memory::MemoryPlan;
use super::page_table::PageTable;
use super::slots::SlotIndex;
use crate::engines::gpu::error::GpuError;
use crate::engines::gpu::limits::TEXTURE_LIMIT;
use crate::engines::gpu::texels::{Texels, VoxelStorage};

/// Range of a macro cell without values: the least is above the greatest.
pub const EMPTY_RANGE: [f32; 2] = [1.0, -1.0];

/// Ranges of a macro cell's eight blocks, x fastest: begin and end in units of 1/255 of the macro cell's range.
pub type BlockRanges = [[u8; 2]; 8];

/// Range of a block without values.
pub const EMPTY_BLOCK: [u8; 2] = [u8::MAX, 0];

/// Range of a block that may have any value of its macro cell.
pub const WHOLE_BLOCK: [u8; 2] = [0, u8::MAX];

/// Contents of a slot.
#[derive(Debug)]
pub struct SlotContents {
    /// The voxels.
    pub texels: Texels,
    /// Ranges of all macro cells of a full slot.
    pub ranges: Vec<[f32; 2]>,
    /// Ranges of their blocks.
    pub blocks: Vec<BlockRanges>,
}

/// Textures and tables of resident bricks.
#[derive(Debug)]
pub struct GpuCache {
    gpu: GpuDevice,
    textures: Vec<wgpu::Texture>,
    grids: [SlotGrid; TEXTURE_LIMIT],
    /// Texture views, one per binding; unused ones show one texel.
    pub views: Vec<wgpu::TextureView>,
    /// Page table.
    pub page_table: wgpu::Buffer,
    /// Host side of the page table, with entries that are not written yet.
    pub pages: PageTable,
    /// Macro ranges of all slots; independent of the look.
    pub macro_ranges: wgpu::Buffer,
    /// Ranges of their blocks.
    pub block_ranges: wgpu::Buffer,
    /// Distance of each macro cell from the nearest visible one under the look.
    pub proximity: wgpu::Buffer,
    /// Slots whose proximity is to be computed.
    pub slot_list: wgpu::Buffer,
    /// Deviations of bricks.
    pub deviations: DeviationTable,
    /// Texels of a slot along x, y and z.
    slot: [u32; 3],
    /// Macro cells of a slot.
    cells: usize,
    staging_bytes: u64,
    /// Bytes handed to the queue since it was last waited for.
    bytes_in_flight: u64,
}

/// Parameters of a cache.
#[derive(Debug, Clone, Copy)]
pub struct CacheShape<'a> {
    /// Grids of slots.
    pub plan: &'a MemoryPlan,
    /// Type of the texels.
    pub storage: VoxelStorage,
    /// Voxels along each axis of a slot.
    pub edge: u32,
    /// Macro cells of a slot.
    pub cells: usize,
    /// Whether deviations of bricks will be needed.
    pub sums_errors: bool,
}

impl GpuCache {
    /// Allocates everything; all entries of `pages` are missing (zero).
    ///
    /// # Errors
    /// If memory does not suffice, or the device refuses a size.
    pub fn new(gpu: &GpuDevice, shape: &CacheShape<'_>, pages: PageTable) -> Result<Self, GpuError> {
        let CacheShape { plan, storage, edge, cells, sums_errors } = *shape;
        let slot = storage.texels([edge; 3]);
        let mut grids = [SlotGrid { slots: [1; 3], first: u32::MAX }; TEXTURE_LIMIT];
        let mut textures = Vec::new();
        let mut first = 0;
        for (i, &slots) in plan.textures.iter().enumerate() {
            grids[i] = SlotGrid { slots, first };
            first += slots.iter().product::<u32>();
            let size = std::array::from_fn(|axis| slots[axis] * slot[axis]);
            textures.push(gpu.checked("a cache texture", || texture(gpu, size))?);
        }
        let dummy = gpu.checked("an empty texture", || texture(gpu, [1; 3]))?;
        let views = (0..TEXTURE_LIMIT)
            .map(|i| textures.get(i).unwrap_or(&dummy).create_view(&wgpu::TextureViewDescriptor::default()))
            .collect();
        let page_table = gpu.buffer("the page table", pages.count() * 8, wgpu::BufferUsages::STORAGE)?;
        let ranges = plan.slots * cells as u64 * 8;
        let macro_ranges = gpu.buffer("the macro ranges", ranges, wgpu::BufferUsages::STORAGE)?;
        let blocks = plan.slots * (cells * size_of::<BlockRanges>()) as u64;
        let block_ranges = gpu.buffer("the ranges of blocks", blocks, wgpu::BufferUsages::STORAGE)?;
        let proximity = gpu.buffer("proximity", ranges / 2, wgpu::BufferUsages::STORAGE)?;
        let slot_list = gpu.buffer("a list of slots", 4 * plan.slots, wgpu::BufferUsages::STORAGE)?;
        Ok(Self {
            gpu: gpu.clone(),
            textures,
            grids,
            views,
            page_table,
            pages,
            macro_ranges,
            block_ranges,
            proximity,
            slot_list,
            deviations: DeviationTable::new(gpu, sums_errors)?,
            slot,
            cells,
            staging_bytes: plan.staging_bytes,
            bytes_in_flight: 0,
        })
    }

    /// Textures that hold slots.
    #[must_use]
    pub fn texture_count(&self) -> u32 {
        narrow::<u32>(self.textures.len())
    }

    /// Slots of all textures.
    #[must_use]
    pub fn slot_count(&self) -> u64 {
        self.grids[..self.textures.len()].iter().map(|g| g.slots.iter().map(|&n| u64::from(n)).product::<u64>()).sum()
    }

    /// Position of each texture's slots, for the shader.
    #[must_use]
    pub fn grids(&self) -> [SlotGrid; TEXTURE_LIMIT] {
        self.grids
    }

    /// Writes a slot's contents; returns the bytes of texels written.
    ///
    /// # Errors
    /// If the device is lost.
    ///
    /// # Panics
    /// If the texels exceed the slot, or the number of ranges differs from its macro cells.
    pub fn write(&mut self, slot: SlotIndex, contents: &SlotContents) -> Result<u64, GpuError> {
        let SlotContents { texels: Texels { size: size @ [width, height, depth], bytes }, ranges, blocks } = contents;
        assert!(
            size.iter().zip(self.slot).all(|(n, most)| *n <= most),
            "{size:?} texels exceed a slot of {:?}",
            self.slot
        );
        assert_eq!([ranges.len(), blocks.len()], [self.cells; 2], "macro cells of a slot");
        let (ranges, blocks): (&[u8], &[u8]) = (bytemuck::cast_slice(ranges), bytemuck::cast_slice(blocks));
        let (texture, [x, y, z]) = slot_at(&self.grids, self.slot, slot.0);
        self.make_room((bytes.len() + ranges.len() + blocks.len()) as u64)?;
        let place =
            wgpu::TexelCopyTextureInfo { origin: wgpu::Origin3d { x, y, z }, ..self.textures[texture].as_image_copy() };
        let size = wgpu::Extent3d { width: *width, height: *height, depth_or_array_layers: *depth };
        self.gpu.write_texture(place, bytes, size);
        for (buffer, bytes) in [(&self.macro_ranges, ranges), (&self.block_ranges, blocks)] {
            self.gpu.write_buffer(buffer, u64::from(slot.0) * bytes.len() as u64, bytes);
        }
        Ok(bytes.len() as u64)
    }

    /// Writes changed entries, runs of neighbours at once, and the deviations that they refer to.
    ///
    /// # Errors
    /// If the device is lost.
    pub fn flush_pages(&mut self) -> Result<(), GpuError> {
        self.deviations.flush();
        for run in self.pages.take_changes().chunk_by(|a, b| a.0 + 1 == b.0) {
            let pages: Vec<[u32; 2]> = run.iter().map(|&(_, page)| page).collect();
            self.make_room(8 * pages.len() as u64)?;
            self.gpu.write_buffer(&self.page_table, 8 * u64::from(run[0].0), bytemuck::cast_slice(&pages));
        }
        Ok(())
    }

    /// Writes numbers of slots to [`Self::slot_list`].
    pub fn write_slot_list(&self, slots: &[SlotIndex]) {
        let numbers: Vec<u32> = slots.iter().map(|slot| slot.0).collect();
        self.gpu.write_buffer(&self.slot_list, 0, bytemuck::cast_slice(&numbers));
    }

    /// Clears the page table: all entries are missing.
    pub fn clear_pages(&mut self) {
        self.pages.clear();
        self.deviations.clear();
        let mut encoder = self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.clear_buffer(&self.page_table, 0, None);
        self.gpu.submit(encoder);
    }

    /// Waits for earlier uploads if this many more bytes would exceed the staging limit.
    ///
    /// # Errors
    /// If the device fails.
    pub fn make_room(&mut self, bytes: u64) -> Result<(), GpuError> {
        self.bytes_in_flight += bytes;
        if self.bytes_in_flight > self.staging_bytes {
            self.gpu.flush()?;
            self.bytes_in_flight = bytes;
        }
        Ok(())
    }
}

/// Cache texture of a slot, and its first texel there; `texels`: size of a slot.
#[must_use]
pub fn slot_at(grids: &[SlotGrid], texels: [u32; 3], slot: u32) -> (usize, [u32; 3]) {
    let texture = grids.iter().rposition(|grid| grid.first <= slot).expect("the first grid begins at slot 0");
    let grid = grids[texture];
    let i = slot - grid.first;
    let [nx, ny, _] = grid.slots;
    let place = [i % nx, i / nx % ny, i / (nx * ny)];
    (texture, std::array::from_fn(|axis| place[axis] * texels[axis]))
}

fn texture(gpu: &GpuDevice, size: [u32; 3]) -> wgpu::Texture {
    gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("bricks"),
        size: wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: size[2] },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D3,
        format: wgpu::TextureFormat::Rgba32Uint,
        usage: gpu.texels().usage() | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    })
}
