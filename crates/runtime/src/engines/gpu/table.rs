//! Look-up tables of shaders, stored as textures: drivers read those for all lanes at once, while software drivers read
//! buffers lane by lane.

use supervol_format::cast::narrow;

use super::device::GpuDevice;
use super::layout::TABLE_WIDTH as WIDTH;
use crate::engines::gpu::error::GpuError;

/// A table of texels of one or four 32-bit words, row by row.
#[derive(Debug)]
pub struct Table {
    texture: wgpu::Texture,
    /// The view that shaders bind.
    pub view: wgpu::TextureView,
    texel_words: usize,
    /// The words written last.
    held: Vec<u32>,
}

impl Table {
    /// Allocates `texels` of 1 or 4 words.
    ///
    /// # Errors
    /// [`GpuError::TableLimit`] beyond the size of textures, and errors of the device.
    pub fn new(gpu: &GpuDevice, doing: &str, texels: usize, texel_words: usize) -> Result<Self, GpuError> {
        let rows = narrow::<u32>(texels.max(1).div_ceil(WIDTH as usize));
        let most = gpu.limits().max_texture_dimension_2d;
        if rows > most {
            let bytes = |rows: u32| u64::from(rows) * u64::from(WIDTH) * 4 * texel_words as u64;
            let (what, advice) = (doing.to_owned(), "use fewer control points, or the CPU backend".to_owned());
            return Err(GpuError::TableLimit { what, needed: bytes(rows), limit: bytes(most), advice });
        }
        let format = if texel_words == 1 { wgpu::TextureFormat::R32Uint } else { wgpu::TextureFormat::Rgba32Uint };
        let texture = gpu.checked(doing, || {
            gpu.device.create_texture(&wgpu::TextureDescriptor {
                label: Some(doing),
                size: wgpu::Extent3d { width: WIDTH, height: rows, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::TEXTURE_BINDING
                    | wgpu::TextureUsages::STORAGE_BINDING
                    | wgpu::TextureUsages::COPY_DST,
                view_formats: &[],
            })
        })?;
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        Ok(Self { texture, view, texel_words, held: Vec::new() })
    }

    /// Bytes of a table of `texels` texels.
    #[must_use]
    pub fn bytes(texels: usize, texel_words: usize) -> u64 {
        (texels.max(1).next_multiple_of(WIDTH as usize) * texel_words * 4) as u64
    }

    /// Writes the first texels, unless they hold these words already.
    pub fn write(&mut self, gpu: &GpuDevice, words: &[u32]) {
        if self.held == words {
            return;
        }
        self.held = words.to_vec();
        let row_words = WIDTH as usize * self.texel_words;
        let mut rows = words.to_vec();
        rows.resize(words.len().next_multiple_of(row_words), 0);
        let height = narrow::<u32>(rows.len() / row_words);
        let size = wgpu::Extent3d { width: WIDTH, height, depth_or_array_layers: 1 };
        gpu.write_texture(self.texture.as_image_copy(), bytemuck::cast_slice(&rows), size);
    }
}
