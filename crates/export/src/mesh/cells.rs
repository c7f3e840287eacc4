//! Marching cubes in a box of voxels: the corners of a cell that are inside determine its triangles.
//!
//! The cases are those of the modified marching cubes of E. Lengyel, "Voxel-Based Terrain for Real-Time Virtual
//! Simulations" (2010), section 3.2, which leave no hole between cells. The tables are from the crate
//! `transvoxel-data`. A vertex is computed only from the two voxels of its edge, lower index first. Boxes that share a
//! face of voxels therefore compute the same bits there. Cells with an absent voxel have no triangles.

use transvoxel_data::regular_cell_data::{REGULAR_CELL_CLASS, REGULAR_CELL_DATA, REGULAR_VERTEX_DATA};

/// Values of the voxels of a box; NaN if absent.
pub(super) struct Values {
    /// Index of the first voxel.
    pub(super) start: [u64; 3],
    /// Number of voxels along x, y, z.
    pub(super) size: [usize; 3],
    /// The values, x fastest.
    pub(super) values: Vec<f64>,
}

/// Vertices at index points, and triangles of vertex numbers. With right-handed axes, triangles are counter-clockwise
/// seen from the side of smaller values.
#[derive(Debug, Default)]
pub(super) struct Surface {
    pub(super) vertices: Vec<[f64; 3]>,
    pub(super) triangles: Vec<[u32; 3]>,
}

/// Largest memory in bytes for the surface of a box of `voxels` voxels per axis. Each cell has a value, three vertices
/// with their numbers, and five triangles.
pub(super) fn bytes_of_box(voxels: u64) -> u64 {
    // The factor 2: a growing list exists twice while it is moved.
    voxels.pow(3) * (8 + 3 * (4 + 2 * 24) + 2 * 5 * 12)
}

impl Values {
    fn at(&self, [x, y, z]: [usize; 3]) -> f64 {
        self.values[(z * self.size[1] + y) * self.size[0] + x]
    }

    /// The isosurface of the value `iso`; corners at or above it are inside.
    pub(super) fn surface(&self, iso: f64) -> Surface {
        let mut surface = Surface::default();
        let mut numbers = vec![u32::MAX; 3 * self.values.len()];
        let [nx, ny, nz] = self.size.map(|n| n.saturating_sub(1));
        for z in 0..nz {
            for y in 0..ny {
                for x in 0..nx {
                    self.cell([x, y, z], iso, &mut numbers, &mut surface);
                }
            }
        }
        surface
    }

    fn cell(&self, cell: [usize; 3], iso: f64, numbers: &mut [u32], surface: &mut Surface) {
        let corner = |i: usize| std::array::from_fn(|axis| cell[axis] + (i >> axis & 1));
        let values: [f64; 8] = std::array::from_fn(|i| self.at(corner(i)));
        let case = (0..8).fold(0, |case, i| case | usize::from(values[i] >= iso) << i);
        if case == 0 || case == 255 || values.iter().any(|value| value.is_nan()) {
            return;
        }
        let class = &REGULAR_CELL_DATA[usize::from(REGULAR_CELL_CLASS[case])];
        let vertices: [u32; 12] = std::array::from_fn(|i| {
            if i >= usize::from(class.get_vertex_count()) {
                return u32::MAX;
            }
            // The lower corner is in the high half of the byte; the two corners differ in one axis.
            let code = REGULAR_VERTEX_DATA[case][i];
            let (a, b) = (usize::from(code >> 4 & 15), usize::from(code & 15));
            let axis = (a ^ b).trailing_zeros() as usize;
            let [x, y, z] = corner(a);
            let number = &mut numbers[3 * ((z * self.size[1] + y) * self.size[0] + x) + axis];
            if *number == u32::MAX {
                let share = (iso - values[a]) / (values[b] - values[a]);
                let mut point: [f64; 3] = std::array::from_fn(|k| (self.start[k] + [x, y, z][k] as u64) as f64);
                point[axis] += share.clamp(0.0, 1.0);
                *number = u32::try_from(surface.vertices.len()).expect("a box has fewer than 2^32 edges");
                surface.vertices.push(point);
            }
            *number
        });
        for triangle in class.vertex_index.chunks_exact(3).take(usize::from(class.get_triangle_count())) {
            let [a, b, c] = [0, 1, 2].map(|i| vertices[usize::from(triangle[i])]);
            let point = |n: u32| surface.vertices[n as usize];
            // If a voxel equals `iso`, several edges end in the same point.
            if point(a) != point(b) && point(b) != point(c) && point(c) != point(a) {
                surface.triangles.push([a, b, c]);
            }
        }
    }
}
