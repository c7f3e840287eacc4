//! A box of voxels cut into smaller boxes in the order of a plain file: x fastest, z slowest.

use crate::VoxelBox;

/// Boxes of at most `most_voxels` each, in file order. A box holds whole slices if one fits, else whole rows of a
/// slice, else part of a row.
///
/// Pieces along y and z end at multiples of `brick` where possible, so that each brick is decoded as rarely as
/// possible. With a `brick` of [`u64::MAX`] a box holds as many slices or rows as fit.
pub fn boxes(voxels: VoxelBox, most_voxels: u64, brick: u64) -> impl Iterator<Item = VoxelBox> {
    let [nx, ny, _] = voxels.extent().map(|n| n as u64);
    let most = most_voxels.max(1);
    let (slices, rows) = (most / (nx * ny), most / nx);
    let whole = move |axis: usize| pieces(voxels, axis, u64::MAX);
    let along_z = pieces(voxels, 2, if slices > 0 { slices.min(brick) } else { 1 });
    let along_y = move || match (slices, rows) {
        (1.., _) => whole(1),
        (0, 1..) => pieces(voxels, 1, if rows >= brick { rows / brick * brick } else { rows }),
        _ => pieces(voxels, 1, 1),
    };
    let along_x = move || if rows > 0 { whole(0) } else { pieces(voxels, 0, most) };
    along_z.flat_map(move |z| {
        along_y()
            .flat_map(move |y| along_x().map(move |x| VoxelBox { start: [x[0], y[0], z[0]], end: [x[1], y[1], z[1]] }))
    })
}

/// The extent of a box along one axis, cut into pieces that end at multiples of `step`.
fn pieces(voxels: VoxelBox, axis: usize, step: u64) -> impl Iterator<Item = [u64; 2]> {
    let (start, last) = (voxels.start[axis], voxels.end[axis]);
    let end = move |at: u64| (at / step + 1).saturating_mul(step).min(last);
    std::iter::successors(Some(start), move |&at| Some(end(at)).filter(|&next| next < last))
        .map(move |at| [at, end(at)])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The boxes in order contain the voxels in the order of the file.
    #[test]
    fn boxes_follow_the_file_and_stay_small() {
        let whole = VoxelBox { start: [3, 5, 6], end: [19, 37, 27] };
        let in_order = |b: VoxelBox| {
            let mut out = Vec::new();
            for z in b.start[2]..b.end[2] {
                for y in b.start[1]..b.end[1] {
                    out.extend((b.start[0]..b.end[0]).map(|x| [x, y, z]));
                }
            }
            out
        };
        for most in [1, 3, 15, 16, 17, 100, 255, 256, 511, 512, 513, 1000, 8191, 8192, 100_000] {
            for brick in [16, 4, u64::MAX] {
                let cut: Vec<_> = boxes(whole, most, brick).collect();
                let joined: Vec<_> = cut.iter().flat_map(|&b| in_order(b)).collect();
                assert!(joined == in_order(whole), "at most {most} voxels, bricks of {brick}");
                assert!(cut.iter().all(|b| b.voxels() as u64 <= most), "at most {most} voxels: {cut:?}");
            }
        }
        let thick: Vec<_> = boxes(whole, 100_000, 16).map(|b| [b.start[2], b.end[2]]).collect();
        assert_eq!(thick, [[6, 16], [16, 27]]);
        let one: Vec<_> = boxes(whole, 100_000, u64::MAX).collect();
        assert_eq!(one, [whole]);
    }
}
