//! The table that a patient lies on, in tomography: it hides the back, and its rails cross the picture.
//!
//! A table is a part of its own in a coarse level: long, wide, flat, below the body and not connected to it. Planes along
//! the body's length that touch the body cut it away. They never cut the body, however it lies on a curved table.

use glam::DVec3;
use supervol_format::cast::narrow;
use supervol_format::container::ContainerError;
use supervol_format::level_reader::LevelReader;
use supervol_format::space::HALF_VOXEL;
use supervol_format::{Container, Level, Lod};

use super::ramps::HOUNSFIELD_OFFSET;
use crate::facts::{DataKind, Frame, VolumeFacts, is_hounsfield};
use crate::spec::PlaneSpec;

/// Most voxels of the level.
const VOXEL_LIMIT: u64 = 1 << 21;
/// Hounsfield units that part air from matter: half of an edge between air and soft tissue.
const MATTER: f64 = -500.0;
/// Least length of a table, as a share of the volume's, and least width, as a share of the body's.
const LONG: f64 = 0.5;
const WIDE: f64 = 0.4;
/// Greatest mean thickness of a table, as a share of its width.
const FLAT: f64 = 0.15;
/// Least distance of a table's middle from the body's middle, as a share of the body's depth.
const BELOW: f64 = 0.25;
/// Angles of the planes from the horizontal, in degrees.
const ANGLES: [f64; 5] = [0.0, 30.0, -30.0, 55.0, -55.0];
/// Least share of the table that a plane must cut away, and that all planes together must.
const CUT_BY_PLANE: f64 = 0.05;
const CUT_BY_ALL: f64 = 0.8;
/// Distance of the planes from the centres of the body's voxels, in voxels: a voxel's own half, and some of its fringe.
const MARGIN: f64 = 1.0;

/// The planes that cut the table away; none if there is no table.
///
/// # Errors
/// If a brick of the level cannot be read.
pub(super) fn planes(container: &Container, facts: &VolumeFacts) -> Result<Vec<PlaneSpec>, ContainerError> {
    let offset = match facts.kind {
        DataKind::Ct if is_hounsfield(facts.central_range) => 0.0,
        DataKind::CtOffset => HOUNSFIELD_OFFSET,
        _ => return Ok(Vec::new()),
    };
    let back = match facts.frame {
        Frame::LeftPosteriorSuperior => DVec3::Y,
        Frame::RightAnteriorSuperior => DVec3::NEG_Y,
        Frame::Survey | Frame::Unknown => return Ok(Vec::new()),
    };
    let levels = container.pyramid().levels();
    let fits = |level: &Level| level.dims.voxels().is_some_and(|n| n <= VOXEL_LIMIT);
    let Some(number) = levels.iter().position(fits) else { return Ok(Vec::new()) };
    let (scale, shift) = (container.descriptor().scale, container.descriptor().offset);
    let reader = LevelReader::new(container, Lod(narrow::<u8>(number)), 0);
    let is_matter = |stored: f64| f64::from(u8::from(stored * scale + shift >= MATTER + offset));
    let matter = reader.values(reader.whole(), is_matter)?;
    let solid: Vec<bool> = matter.into_iter().map(|value| value > 0.0).collect();
    let grid = Grid { dims: reader.whole().extent(), level: levels[number] };
    // The table lies in front of patients on their belly.
    Ok([back, -back]
        .into_iter()
        .map(|down| grid.planes(facts, &solid, down))
        .find(|p| !p.is_empty())
        .unwrap_or_default())
}

/// A level's grid.
struct Grid {
    dims: [usize; 3],
    level: Level,
}

/// A connected part: its voxels' positions in the world.
type Part = Vec<DVec3>;

impl Grid {
    /// The planes that cut away what lies flat below the body.
    fn planes(&self, facts: &VolumeFacts, solid: &[bool], down: DVec3) -> Vec<PlaneSpec> {
        let mut parts: Vec<Part> = self.parts(solid).iter().map(|part| self.places(facts, part)).collect();
        parts.sort_by_key(|part| std::cmp::Reverse(part.len()));
        let Some((body, others)) = parts.split_first() else { return Vec::new() };
        let length = whole_length(facts);
        let edges = (0..3).map(|a| facts.geometry.spacing[a] * self.level.scale[a] as f64);
        let margin = MARGIN * edges.clone().fold(0.0, f64::max);
        let voxel: f64 = edges.product();
        let table: Part =
            others.iter().filter(|part| is_table(part, body, down, length, voxel)).flatten().copied().collect();
        let mut left = table.clone();
        let mut planes = Vec::new();
        for angle in ANGLES {
            let (sin, cos) = angle.to_radians().sin_cos();
            let outward = cos * down + sin * DVec3::X;
            let reach = body.iter().map(|p| p.dot(outward)).fold(f64::NEG_INFINITY, f64::max) + margin;
            let kept: Part = left.iter().copied().filter(|p| p.dot(outward) <= reach).collect();
            if (left.len() - kept.len()) as f64 > CUT_BY_PLANE * table.len() as f64 {
                planes.push(PlaneSpec { normal: (-outward).to_array(), offset: -reach });
                left = kept;
            }
        }
        let is_cut = left.len() as f64 <= (1.0 - CUT_BY_ALL) * table.len() as f64;
        if is_cut { planes } else { Vec::new() }
    }

    /// Parts of voxels that are connected by their faces.
    fn parts(&self, solid: &[bool]) -> Vec<Vec<usize>> {
        let [nx, ny, nz] = self.dims;
        let mut is_open = solid.to_vec();
        let mut parts = Vec::new();
        for start in 0..solid.len() {
            if !std::mem::take(&mut is_open[start]) {
                continue;
            }
            let (mut part, mut next) = (vec![start], 0);
            while let Some(&at) = part.get(next) {
                next += 1;
                let index = [at % nx, at / nx % ny, at / (nx * ny)];
                for (axis, (step, count)) in [(1, nx), (nx, ny), (nx * ny, nz)].into_iter().enumerate() {
                    let before = (index[axis] > 0).then(|| at - step);
                    let after = (index[axis] + 1 < count).then(|| at + step);
                    for neighbour in before.into_iter().chain(after) {
                        if std::mem::take(&mut is_open[neighbour]) {
                            part.push(neighbour);
                        }
                    }
                }
            }
            parts.push(part);
        }
        parts
    }

    /// World positions of voxels of the level.
    fn places(&self, facts: &VolumeFacts, part: &[usize]) -> Part {
        let [nx, ny, _] = self.dims;
        let scale = DVec3::from_array(self.level.scale.map(|s| s as f64));
        let world = facts.geometry.world_from_index();
        let place = |&at: &usize| {
            let index = DVec3::new((at % nx) as f64, (at / nx % ny) as f64, (at / (nx * ny)) as f64);
            world.transform_point3((index + HALF_VOXEL) * scale - HALF_VOXEL)
        };
        part.iter().map(place).collect()
    }
}

/// Length of the volume from feet to head.
fn whole_length(facts: &VolumeFacts) -> f64 {
    let linear = facts.geometry.linear();
    (0..3).map(|a| (linear.col(a) * facts.dims.0[a] as f64).z.abs()).sum()
}

/// Whether a part is long, wide and flat, and lies below the body; `voxel` is the volume of its voxels.
fn is_table(part: &Part, body: &Part, down: DVec3, length: f64, voxel: f64) -> bool {
    let extent = |part: &Part, along: DVec3| {
        let ends = part
            .iter()
            .map(|p| p.dot(along))
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], at| [low.min(at), high.max(at)]);
        ends[1] - ends[0]
    };
    let middle = |part: &Part| part.iter().map(|p| p.dot(down)).sum::<f64>() / part.len().max(1) as f64;
    let (long, wide) = (extent(part, DVec3::Z), extent(part, DVec3::X));
    long >= LONG * length
        && wide >= WIDE * extent(body, DVec3::X)
        && part.len() as f64 * voxel <= FLAT * wide * wide * long
        && middle(part) - middle(body) >= BELOW * extent(body, down)
}

#[cfg(test)]
mod tests {
    use supervol_format::{Dims, Geometry, Level, ValueRange};

    use super::*;

    const DIMS: [usize; 3] = [60, 60, 40];

    /// A cylindrical body of radius 16 around (30, 26), and what `more` adds.
    fn planes(more: impl Fn([f64; 3]) -> bool) -> Vec<PlaneSpec> {
        let dims = Dims(DIMS.map(|n| n as u64));
        let facts = VolumeFacts::plain(dims, Geometry::IDENTITY, ValueRange { min: -1000.0, max: 2000.0 });
        let level = Level { factors: [1; 3], scale: [1; 3], dims, bricks: [1; 3], first_entry: 0 };
        let at = |i: usize| [i % 60, i / 60 % 60, i / 3600].map(|n| n as f64);
        let body = |[x, y, _]: [f64; 3]| (x - 30.0).hypot(y - 26.0) <= 16.0;
        let solid: Vec<bool> = (0..60 * 60 * 40).map(at).map(|p| body(p) || more(p)).collect();
        Grid { dims: DIMS, level }.planes(&facts, &solid, DVec3::Y)
    }

    fn keeps(planes: &[PlaneSpec], p: [f64; 3]) -> bool {
        planes.iter().all(|plane| DVec3::from_array(plane.normal).dot(p.into()) >= plane.offset)
    }

    #[test]
    fn curved_tables_are_cut_away_and_bodies_are_whole() {
        // A shell of radius 30 around (30, 16): its edges rise beside the body.
        let table = |[x, y, _]: [f64; 3]| ((x - 30.0).hypot(y - 16.0) - 30.0).abs() <= 1.0 && y > 38.0;
        let found = planes(table);
        assert!((1..=5).contains(&found.len()), "{found:?}");
        for n in 0..360 {
            let (sin, cos) = f64::from(n).to_radians().sin_cos();
            assert!(keeps(&found, [30.0 + 16.0 * cos, 26.0 + 16.0 * sin, 7.0]), "{n} degrees of the body");
        }
        assert!(
            !keeps(&found, [30.0, 46.0, 7.0]) && !keeps(&found, [12.0, 40.0, 7.0]) && !keeps(&found, [48.0, 40.0, 7.0])
        );
    }

    #[test]
    fn nothing_is_cut_without_a_table() {
        assert!(planes(|_| false).is_empty());
        // Connected to the body, short, above the body, or thick.
        assert!(planes(|[x, y, _]| y == 44.0 || (x == 30.0 && y > 40.0 && y < 44.0)).is_empty());
        assert!(planes(|[_, y, z]| y == 46.0 && z < 12.0).is_empty());
        assert!(planes(|[_, y, _]| y == 6.0).is_empty());
        assert!(planes(|[x, y, _]| y >= 46.0 && (x - 30.0).abs() < 15.0).is_empty());
    }
}
