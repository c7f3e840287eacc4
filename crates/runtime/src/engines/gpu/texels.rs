//! Texels of the cache textures: how the voxels of a brick are packed into them.
//!
//! A texel has 16 bytes and holds several voxels of a layer ([`VoxelStorage::voxels_of_texel`]). Neighbouring texels share
//! the voxels where they meet, so that two fetches (of bytes) or four read the eight voxels of a cell
//! (docs/decisions/017-one-loop-of-antiderivatives.md).

/// Bytes of a texel of the cache textures.
pub const TEXEL_BYTES: usize = 16;

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

    /// Voxels of a texel along x and y: 16 bytes of them.
    #[must_use]
    pub const fn voxels_of_texel(self) -> [u32; 2] {
        match self {
            Self::U8 => [4, 4],
            Self::U16 => [8, 1],
            Self::F32 => [4, 1],
        }
    }

    /// Voxels from a texel to the next one along x; along y as well where a texel has several rows.
    #[must_use]
    pub const fn texel_step(self) -> u32 {
        self.voxels_of_texel()[0] - 1
    }

    /// Texels that so many voxels take along x, y and z.
    #[must_use]
    pub fn texels(self, voxels: [u32; 3]) -> [u32; 3] {
        let [_, rows] = self.voxels_of_texel();
        let shared = |n: u32| (n - 1).div_ceil(self.texel_step()).max(1);
        let [nx, ny, nz] = voxels;
        [shared(nx), if rows > 1 { shared(ny) } else { ny }, nz]
    }

    /// Voxels (x fastest) as a slot holds them.
    ///
    /// # Panics
    /// If there are not exactly as many as the extent says.
    #[must_use]
    pub fn texels_of(self, extent: [u32; 3], voxels: &[u8]) -> Texels {
        assert_eq!(
            voxels.len(),
            (extent.iter().product::<u32>() * self.bytes()) as usize,
            "voxels of extent {extent:?}"
        );
        Texels { size: self.texels(extent), bytes: self.packed(extent, voxels) }
    }

    /// Voxels (x fastest) as texels; what lies beyond them is zero.
    #[must_use]
    pub fn packed(self, extent: [u32; 3], voxels: &[u8]) -> Vec<u8> {
        match self {
            Self::U8 => self.packed_rows::<4>(extent, voxels),
            Self::U16 | Self::F32 => self.packed_rows::<TEXEL_BYTES>(extent, voxels),
        }
    }

    /// The same, for texels with rows of `ROW` bytes.
    fn packed_rows<const ROW: usize>(self, extent: [u32; 3], voxels: &[u8]) -> Vec<u8> {
        let [nx, ny, _] = extent.map(|n| n as usize);
        let [tx, ty, tz] = self.texels(extent).map(|n| n as usize);
        let [step, rows] = [self.texel_step(), self.voxels_of_texel()[1]].map(|n| n as usize);
        let (row_bytes, step_bytes) = (nx * self.bytes() as usize, step * self.bytes() as usize);
        let from_row_to_row = if rows > 1 { step } else { 1 };
        let mut packed = vec![0; tx * ty * tz * TEXEL_BYTES];
        // A row of voxels, and what its last texel holds beyond it.
        let mut row = vec![0; tx * step_bytes + ROW];
        for (line, texels) in packed.chunks_exact_mut(tx * TEXEL_BYTES).enumerate() {
            let (first, z) = (line % ty * from_row_to_row, line / ty);
            for (i, y) in (first..(first + rows).min(ny)).enumerate() {
                let begin = (z * ny + y) * row_bytes;
                row[..row_bytes].copy_from_slice(&voxels[begin..begin + row_bytes]);
                for (texel, begin) in texels.chunks_exact_mut(TEXEL_BYTES).zip((0..).step_by(step_bytes)) {
                    let part: [u8; ROW] = row[begin..begin + ROW].try_into().expect("as many bytes");
                    texel[i * ROW..(i + 1) * ROW].copy_from_slice(&part);
                }
            }
        }
        packed
    }
}

/// A brick's voxels as texels of a slot, x fastest.
#[derive(Debug)]
pub struct Texels {
    /// Texels along x, y and z.
    pub(super) size: [u32; 3],
    pub(super) bytes: Vec<u8>,
}

#[cfg(test)]
mod tests {
    use supervol_format::random::Random;

    use super::*;

    /// Every cell's voxels lie where the shader looks for them (`stored_square` in brick.wgsl).
    #[test]
    fn texels_hold_every_square_of_voxels() {
        let mut random = Random::new(9);
        for storage in [VoxelStorage::U8, VoxelStorage::U16, VoxelStorage::F32] {
            for extent in [[20, 20, 20], [5, 6, 7], [9, 5, 5], [8, 23, 6]] {
                let bytes = storage.bytes() as usize;
                let count = extent.iter().product::<u32>() as usize * bytes;
                let voxels: Vec<u8> = (0..count).map(|_| (random.unit() * 256.0) as u8).collect();
                let texels = storage.packed(extent, &voxels);
                let size = storage.texels(extent);
                let [[width, rows], step] = [storage.voxels_of_texel(), [storage.texel_step(); 2]];
                let index = |[x, y, z]: [u32; 3], [nx, ny, _]: [u32; 3]| (x + nx * (y + ny * z)) as usize;
                let from_texels = |texel: [u32; 3], x: u32, y: u32| {
                    let begin = index(texel, size) * TEXEL_BYTES + (x + width * y) as usize * bytes;
                    texels[begin..begin + bytes].to_vec()
                };
                let all = (0..extent[2]).flat_map(|z| (0..extent[1] - 1).map(move |y| (y, z)));
                for ([x, y, z], (dx, dy)) in all
                    .flat_map(|(y, z)| (0..extent[0] - 1).map(move |x| [x, y, z]))
                    .flat_map(|v| [(0, 0), (1, 0), (0, 1), (1, 1)].map(|d| (v, d)))
                {
                    let (i, rest) = (x / step[0], x % step[0]);
                    let found = match rows {
                        1 => from_texels([i, y + dy, z], rest + dx, 0),
                        _ => from_texels([i, y / step[1], z], rest + dx, y % step[1] + dy),
                    };
                    let begin = index([x + dx, y + dy, z], extent) * bytes;
                    assert_eq!(found, voxels[begin..begin + bytes], "{storage:?}, {extent:?}, {:?}", [x, y, z]);
                }
            }
        }
    }
}
