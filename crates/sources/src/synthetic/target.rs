//! Buffers that computed voxels are written to, and the conversion of field values to stored values.
use supervol_format::voxel_type::Voxel;
use supervol_format::{VoxelBox, VoxelType, with_voxel};

use crate::cast::{self, index, single};

/// Voxels along x that are computed together: columns share their tables, and the tables stay in the cache.
pub(super) const CHUNK_VOXELS: usize = 1024;

/// Buffer of a read, and its box.
pub(super) struct Target<'a> {
    pub(super) voxels: VoxelBox,
    pub(super) voxel_type: VoxelType,
    pub(super) out: &'a mut [u8],
}

impl Target<'_> {
    /// The bytes of `length` voxels along x from `start` on; all must lie in the box.
    pub(super) fn row(&mut self, start: [u64; 3], length: usize) -> &mut [u8] {
        let [nx, ny, _] = self.voxels.extent();
        // Inside the box, whose extent fits the address space.
        let [x, y, z] = std::array::from_fn(|a| index(start[a] - self.voxels.start[a]));
        let bytes = self.voxel_type.bytes();
        let first = (x + nx * (y + ny * z)) * bytes;
        &mut self.out[first..first + length * bytes]
    }

    /// Starts and lengths of the pieces along x that are computed together.
    pub(super) fn chunks(&self) -> impl Iterator<Item = (u64, usize)> + use<> {
        let (start, end) = (self.voxels.start[0], self.voxels.end[0]);
        (start..end).step_by(CHUNK_VOXELS).map(move |x| (x, CHUNK_VOXELS.min(index(end - x))))
    }
}

/// Conversion of field values to stored values: `stored = value * gain + bias`, rounded for integer types.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Scale {
    pub(super) gain: f64,
    pub(super) bias: f64,
}

impl Scale {
    /// Scale for values from 0 to 1.
    pub(super) fn unit(voxel_type: VoxelType) -> Self {
        let gain = if voxel_type.is_float() { 1.0 } else { voxel_type.limits().1.min(65535.0) };
        Self { gain, bias: 0.0 }
    }

    /// Scale for values from -1 to 1.
    pub(super) fn amplitude(voxel_type: VoxelType) -> Self {
        match voxel_type {
            VoxelType::U8 => Self { gain: 127.0, bias: 128.0 },
            VoxelType::I8 => Self { gain: 127.0, bias: 0.0 },
            VoxelType::U16 | VoxelType::U32 => Self { gain: 30000.0, bias: 32768.0 },
            VoxelType::I16 | VoxelType::I32 | VoxelType::F32 | VoxelType::F64 => Self { gain: 30000.0, bias: 0.0 },
        }
    }

    /// Writes doubles as voxels, rounded to nearest.
    pub(super) fn write(self, values: &[f64], voxel_type: VoxelType, out: &mut [u8]) {
        with_voxel!(voxel_type, V => {
            for (value, voxel) in values.iter().zip(out.chunks_exact_mut(size_of::<V>())) {
                V::from_f64(value * self.gain + self.bias).write_le(voxel);
            }
        });
    }

    /// Writes f32 values as voxels. Integers are rounded half up, which compiles to a few vector instructions.
    pub(super) fn write_fast(self, values: &[f32], voxel_type: VoxelType, out: &mut [u8]) {
        match voxel_type {
            VoxelType::U8 => {
                let (gain, bias) = (single(self.gain), single(self.bias) + 0.5);
                for (value, voxel) in values.iter().zip(out) {
                    *voxel = low_byte(value * gain + bias);
                }
            }
            VoxelType::I8 => self.write_integers::<1>(values, out),
            VoxelType::U16 | VoxelType::I16 => self.write_integers::<2>(values, out),
            VoxelType::U32 | VoxelType::I32 => self.write_integers::<4>(values, out),
            VoxelType::F32 | VoxelType::F64 => with_voxel!(voxel_type, V => {
                for (value, voxel) in values.iter().zip(out.chunks_exact_mut(size_of::<V>())) {
                    V::from_f64(f64::from(*value) * self.gain + self.bias).write_le(voxel);
                }
            }),
        }
    }

    /// Writes integers: the low bytes of a two's complement number are the voxel, signed or not.
    pub(super) fn write_integers<const BYTES: usize>(self, values: &[f32], out: &mut [u8]) {
        // Shifted to be positive, so that truncation rounds down.
        const SHIFT: i32 = 1 << 17;
        let bias = self.bias + 0.5 + f64::from(SHIFT);
        for (value, voxel) in values.iter().zip(out.as_chunks_mut::<BYTES>().0) {
            let stored = cast::whole::<i32>(f64::from(*value) * self.gain + bias) - SHIFT;
            let bytes = stored.to_le_bytes();
            *voxel = std::array::from_fn(|i| bytes[i]);
        }
    }
}

/// The low byte of the whole part of a number; in range after scaling.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "scaled values are between 0 and 256")]
const fn low_byte(n: f32) -> u8 {
    n as i32 as u8
}
