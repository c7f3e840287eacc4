//! Axes that are read in reverse: voxel 0 is the last one of the file.

use supervol_format::{Dims, VoxelBox};

/// Whether each axis is read in reverse.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Mirrored(pub(crate) [bool; 3]);

impl Mirrored {
    /// The box of the file with the voxels of a box.
    pub(crate) fn of_box(self, voxels: VoxelBox, dims: Dims) -> VoxelBox {
        let mut of_file = voxels;
        for axis in (0..3).filter(|axis| self.0[*axis]) {
            of_file.start[axis] = dims.0[axis] - voxels.end[axis];
            of_file.end[axis] = dims.0[axis] - voxels.start[axis];
        }
        of_file
    }

    /// Reverses the voxels of a box, x fastest, along the mirrored axes.
    pub(crate) fn reverse(self, [nx, ny, _]: [usize; 3], voxel_bytes: usize, voxels: &mut [u8]) {
        let row = nx * voxel_bytes;
        let slice = row * ny;
        if voxels.is_empty() {
            return;
        }
        if self.0[0] {
            for row in voxels.chunks_exact_mut(row) {
                // Reverses the voxels, not the bytes of each.
                row.reverse();
                row.chunks_exact_mut(voxel_bytes).for_each(<[u8]>::reverse);
            }
        }
        if self.0[1] {
            voxels.chunks_exact_mut(slice).for_each(|slice| reverse_parts(slice, row));
        }
        if self.0[2] {
            reverse_parts(voxels, slice);
        }
    }
}

/// Reverses the order of parts of `bytes` bytes.
fn reverse_parts(all: &mut [u8], bytes: usize) {
    let count = all.len() / bytes;
    for part in 0..count / 2 {
        let (front, back) = all.split_at_mut((count - 1 - part) * bytes);
        front[part * bytes..][..bytes].swap_with_slice(&mut back[..bytes]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_and_voxels_are_reversed() {
        let dims = Dims([3, 2, 2]);
        let box_of = |start, end| VoxelBox { start, end };
        let mirrored = Mirrored([true, false, true]);
        assert_eq!(mirrored.of_box(box_of([0, 0, 0], [2, 1, 1]), dims), box_of([1, 0, 1], [3, 1, 2]));
        let all: Vec<u8> = (0..12u16).flat_map(u16::to_le_bytes).collect();
        for axes in 0..8 {
            let mirrored = Mirrored([axes & 1 > 0, axes & 2 > 0, axes & 4 > 0]);
            let mut found = all.clone();
            mirrored.reverse([3, 2, 2], 2, &mut found);
            let expected = (0..12u16).flat_map(|at| {
                let place = [at % 3, at / 3 % 2, at / 6];
                let place: [u16; 3] =
                    std::array::from_fn(|i| if mirrored.0[i] { [2, 1, 1][i] - place[i] } else { place[i] });
                (place[0] + 3 * (place[1] + 2 * place[2])).to_le_bytes()
            });
            assert!(found.into_iter().eq(expected), "{mirrored:?}");
        }
    }
}
