//! Resident bricks on the GPU: cache textures, macro ranges, page table, and what of the bricks shows under a look.
//!
//! Voxels are stored as unsigned integers (R8Uint, R16Uint, or the bits of floats in R32Uint) and read by `textureLoad`:
//! exact, without optional features, and filtered by the shader in `f32` rather than with 8-bit fractions.
//! Everything is written through the queue; what is on its way is bounded by the plan's staging bytes.

use super::device::{GpuDevice, GpuError};
use super::layout::SlotGrid;
use super::memory::{MemoryPlan, TEXTURE_LIMIT};
use super::slots::SlotIndex;

/// How voxels are stored in the cache textures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum VoxelStorage {
    /// 8-bit unsigned integers.
    U8,
    /// 16-bit unsigned integers.
    U16,
    /// 32-bit floats.
    F32,
}

impl VoxelStorage {
    /// Bytes of one voxel.
    #[must_use]
    pub fn bytes(self) -> u32 {
        match self {
            Self::U8 => 1,
            Self::U16 => 2,
            Self::F32 => 4,
        }
    }

    fn format(self) -> wgpu::TextureFormat {
        match self {
            Self::U8 => wgpu::TextureFormat::R8Uint,
            Self::U16 => wgpu::TextureFormat::R16Uint,
            Self::F32 => wgpu::TextureFormat::R32Uint,
        }
    }
}

/// Macro cell without any value: least value above greatest.
pub const EMPTY_RANGE: [f32; 2] = [1.0, -1.0];

/// Textures and tables of resident bricks.
pub struct GpuCache {
    gpu: GpuDevice,
    textures: Vec<wgpu::Texture>,
    grids: [SlotGrid; TEXTURE_LIMIT],
    /// Texture views, one per binding; unused ones show one texel.
    pub views: Vec<wgpu::TextureView>,
    /// Page table.
    pub page_table: wgpu::Buffer,
    /// Macro ranges of all slots, whatever the look.
    pub macro_ranges: wgpu::Buffer,
    /// How far each of these is from one that shows something under the look.
    pub proximity: wgpu::Buffer,
    /// Slots whose proximity is to be made.
    pub slot_list: wgpu::Buffer,
    /// Page table entries to be written before the next pass: (entry, (state, payload)), in the order of the calls.
    pending: Vec<(u32, [u32; 2])>,
    storage: VoxelStorage,
    /// Voxels along each axis of a slot.
    edge: u32,
    /// Macro cells of a slot.
    cells: usize,
    staging_bytes: u64,
    /// Bytes handed to the queue since it was last waited for.
    bytes_in_flight: u64,
}

/// What the cache is made for.
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
    /// Page table entries.
    pub entries: u64,
}

impl GpuCache {
    /// Allocates everything; all entries are missing (zero).
    ///
    /// # Errors
    /// Out of memory, or a size the device refuses.
    pub fn new(gpu: &GpuDevice, shape: &CacheShape<'_>) -> Result<Self, GpuError> {
        let CacheShape { plan, storage, edge, cells, entries } = *shape;
        let mut grids = [SlotGrid { slots: [1; 3], first: u32::MAX }; TEXTURE_LIMIT];
        let mut textures = Vec::new();
        let mut first = 0;
        for (i, &slots) in plan.textures.iter().enumerate() {
            grids[i] = SlotGrid { slots, first };
            first += slots.iter().product::<u32>();
            let size = slots.map(|n| n * edge);
            textures.push(gpu.checked("a cache texture", || texture(gpu, size, storage))?);
        }
        let dummy = gpu.checked("an empty texture", || texture(gpu, [1; 3], storage))?;
        let views = (0..TEXTURE_LIMIT)
            .map(|i| textures.get(i).unwrap_or(&dummy).create_view(&wgpu::TextureViewDescriptor::default()))
            .collect();
        let page_table = gpu.buffer("the page table", entries * 8, wgpu::BufferUsages::STORAGE)?;
        let ranges = plan.slots * cells as u64 * 8;
        let macro_ranges = gpu.buffer("the macro ranges", ranges, wgpu::BufferUsages::STORAGE)?;
        let proximity = gpu.buffer("proximity", ranges / 2, wgpu::BufferUsages::STORAGE)?;
        let slot_list = gpu.buffer("a list of slots", 4 * plan.slots, wgpu::BufferUsages::STORAGE)?;
        Ok(Self {
            gpu: gpu.clone(),
            textures,
            grids,
            views,
            page_table,
            macro_ranges,
            proximity,
            slot_list,
            pending: Vec::new(),
            storage,
            edge,
            cells,
            staging_bytes: plan.staging_bytes,
            bytes_in_flight: 0,
        })
    }

    /// Textures that hold slots.
    #[must_use]
    pub fn texture_count(&self) -> u32 {
        self.textures.len() as u32
    }

    /// Slots of all textures.
    #[must_use]
    pub fn slot_count(&self) -> u64 {
        self.grids[..self.textures.len()].iter().map(|g| g.slots.iter().map(|&n| u64::from(n)).product::<u64>()).sum()
    }

    /// Where each texture's slots lie, for the shader.
    #[must_use]
    pub fn grids(&self) -> [SlotGrid; TEXTURE_LIMIT] {
        self.grids
    }

    /// Writes a brick's voxels (x fastest, apron included) into a slot; returns the bytes written.
    ///
    /// # Errors
    /// A lost device.
    ///
    /// # Panics
    /// If the extent exceeds the slot, or `voxels` is not exactly that many.
    pub fn write_voxels(&mut self, slot: SlotIndex, extent: [usize; 3], voxels: &[u8]) -> Result<u64, GpuError> {
        let extent = extent.map(|n| u32::try_from(n).expect("an extent is not larger than a slot"));
        let texel = self.storage.bytes();
        assert!(extent.iter().all(|&n| n <= self.edge), "extent {extent:?} exceeds a slot of {}", self.edge);
        let bytes = extent.iter().product::<u32>() * texel;
        assert_eq!(voxels.len(), bytes as usize, "voxels of extent {extent:?}");
        let texture = self.grids.iter().rposition(|g| g.first <= slot.0).expect("the first grid begins at slot 0");
        let grid = self.grids[texture];
        let i = slot.0 - grid.first;
        let [nx, ny, _] = grid.slots;
        let place = [i % nx, i / nx % ny, i / (nx * ny)].map(|n| n * self.edge);
        self.make_room(u64::from(bytes))?;
        self.gpu.queue.write_texture(
            wgpu::TexelCopyTextureInfo {
                texture: &self.textures[texture],
                mip_level: 0,
                origin: wgpu::Origin3d { x: place[0], y: place[1], z: place[2] },
                aspect: wgpu::TextureAspect::All,
            },
            voxels,
            wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(extent[0] * texel),
                rows_per_image: Some(extent[1]),
            },
            wgpu::Extent3d { width: extent[0], height: extent[1], depth_or_array_layers: extent[2] },
        );
        Ok(u64::from(bytes))
    }

    /// Writes the macro ranges of a slot.
    ///
    /// # Errors
    /// A lost device.
    ///
    /// # Panics
    /// If there are more or fewer than a slot has macro cells.
    pub fn write_ranges(&mut self, slot: SlotIndex, ranges: &[[f32; 2]]) -> Result<(), GpuError> {
        assert_eq!(ranges.len(), self.cells, "macro cells of a slot");
        let bytes: &[u8] = bytemuck::cast_slice(ranges);
        self.make_room(bytes.len() as u64)?;
        self.gpu.queue.write_buffer(&self.macro_ranges, u64::from(slot.0) * bytes.len() as u64, bytes);
        Ok(())
    }

    /// Notes what an entry of the page table becomes before the next pass.
    pub fn set_page(&mut self, entry: u32, page: [u32; 2]) {
        self.pending.push((entry, page));
    }

    /// Writes the noted entries: runs of neighbours at once, the last note of an entry wins.
    ///
    /// # Errors
    /// A lost device.
    pub fn flush_pages(&mut self) -> Result<(), GpuError> {
        let mut pending = std::mem::take(&mut self.pending);
        // A stable sort keeps the notes of one entry in order; of these only the last is kept.
        pending.sort_by_key(|&(entry, _)| entry);
        pending.reverse();
        pending.dedup_by_key(|&mut (entry, _)| entry);
        pending.reverse();
        for run in pending.chunk_by(|a, b| a.0 + 1 == b.0) {
            let pages: Vec<[u32; 2]> = run.iter().map(|&(_, page)| page).collect();
            self.make_room(8 * pages.len() as u64)?;
            self.gpu.queue.write_buffer(&self.page_table, 8 * u64::from(run[0].0), bytemuck::cast_slice(&pages));
        }
        Ok(())
    }

    /// Writes numbers of slots to [`Self::slot_list`].
    pub fn write_slot_list(&self, slots: &[SlotIndex]) {
        let numbers: Vec<u32> = slots.iter().map(|slot| slot.0).collect();
        self.gpu.queue.write_buffer(&self.slot_list, 0, bytemuck::cast_slice(&numbers));
    }

    /// Forgets what all entries of the page table are: all are missing.
    pub fn clear_pages(&mut self) {
        self.pending.clear();
        let mut encoder = self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.clear_buffer(&self.page_table, 0, None);
        self.gpu.queue.submit([encoder.finish()]);
    }

    /// Waits for earlier uploads if this many more bytes would exceed the staging limit.
    pub fn make_room(&mut self, bytes: u64) -> Result<(), GpuError> {
        self.bytes_in_flight += bytes;
        if self.bytes_in_flight > self.staging_bytes {
            self.gpu.queue.submit([]);
            self.gpu.wait()?;
            self.bytes_in_flight = bytes;
        }
        Ok(())
    }
}

fn texture(gpu: &GpuDevice, size: [u32; 3], storage: VoxelStorage) -> wgpu::Texture {
    gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("bricks"),
        size: wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: size[2] },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D3,
        format: storage.format(),
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    })
}
