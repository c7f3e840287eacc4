//! Isosurface of a volume as a triangle mesh in world coordinates: PLY, STL, OBJ.
//!
//! The volume is processed box by box within a memory limit; boxes that the isovalue does not cross are not read. Both
//! neighbours write the vertices on the face between two boxes, equal to the last bit. So there are no cracks, and a
//! program that merges equal vertices gets one closed mesh. Triangles face away from greater values. The surface ends
//! at absent voxels and at the border of the box.

mod cells;
mod files;

use std::io::{BufWriter, Write};
use std::path::Path;

use glam::DVec3;
use supervol_files::{Existing, OutputFile, folder_of};
use supervol_format::level_reader::LevelReader;
use supervol_format::voxel_type::voxels_as_f64;
use supervol_format::{BrickIndex, BrickKey, Container, Lod, VoxelBox, cast};
use supervol_preprocess::error::{BuildError, MemoryPurpose};
use supervol_preprocess::memory::left_for_data;

use crate::extract::{checked_box, level_geometry};
use cells::{Values, bytes_of_box};
use files::{Format, MeshFile};

/// Smallest number of cells along an axis of a box.
const LEAST_CELLS: u64 = 4;
/// Positions per voxel spacing that single precision must resolve at the farthest corner of the volume; otherwise
/// vertices are doubles.
const STEPS_PER_SPACING: f64 = 1024.0;
/// Bytes of the output buffers: the mesh and its two parts.
const WRITE_BUFFERS_BYTES: u64 = 2 << 20;

/// Options of a mesh.
#[derive(Debug, Clone, Copy)]
pub struct MeshOptions {
    /// Isovalue in the data's own units.
    pub iso: f64,
    /// Level of detail.
    pub lod: Lod,
    /// Box in voxels of that level; `None`: all voxels.
    pub voxels: Option<VoxelBox>,
    /// Reaction to an existing output.
    pub existing: Existing,
    /// Largest memory to use, in bytes.
    pub memory_bytes: u64,
}

/// Size of the written mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MeshReport {
    /// Number of vertices; those on the face between two boxes count twice.
    pub vertices: u64,
    /// Number of triangles.
    pub triangles: u64,
}

/// Writes the isosurface to `output`, whose extension determines the format.
///
/// # Errors
/// If the level or box does not exist, the extension is unknown, or the surface is empty. If a brick is unreadable or
/// the output is not writable.
pub fn mesh(container: &Container, output: &Path, options: &MeshOptions) -> Result<MeshReport, BuildError> {
    let format = Format::of(output)?;
    let voxels = checked_box(container, options.lod, options.voxels)?;
    let plan = Plan::new(container, options.memory_bytes)?;
    let geometry = level_geometry(container, options.lod, container.pyramid().level_at(options.lod).dims.full_box());
    let world = geometry.world_from_index();
    let corner =
        |c: usize| std::array::from_fn(|a| if c >> a & 1 == 0 { voxels.start[a] } else { voxels.end[a] } as f64);
    let farthest =
        (0..8).map(|c| world.transform_point3(DVec3::from(corner(c))).abs().max_element()).fold(0.0, f64::max);
    let is_double = farthest * f64::from(f32::EPSILON) * STEPS_PER_SPACING > geometry.smallest_spacing();

    let file = OutputFile::begin(output, options.existing)?;
    let mut written = MeshFile::begin(output, format, is_double, folder_of(output))?;
    let reader = LevelReader::new(container, options.lod, plan.cache_bytes);
    let failed = |e| BuildError::container(container.path(), e);
    for part in boxes_of_cells(voxels, plan.cells) {
        if !is_crossed(container, options, part)? {
            continue;
        }
        let mut bytes = vec![0; part.voxels() * container.descriptor().voxel_type.bytes()];
        reader.read_box(part, &mut bytes).map_err(failed)?;
        let surface = values(container, part, &bytes).surface(options.iso);
        let vertices: Vec<DVec3> = surface.vertices.iter().map(|p| world.transform_point3(DVec3::from(*p))).collect();
        // The tables are for right-handed axes.
        let mut triangles = surface.triangles;
        if geometry.is_left_handed() {
            triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
        }
        written.add(&vertices, &triangles)?;
    }
    let report = MeshReport { vertices: written.vertex_count, triangles: written.triangle_count };
    if report.triangles == 0 {
        let (path, range) = (container.path().into(), container.manifest().value_range);
        return Err(BuildError::NoSurface { path, iso: options.iso, range });
    }
    let mut out = BufWriter::new(file.file());
    written.finish(&mut out)?;
    out.flush().map_err(|e| BuildError::write(output, e))?;
    drop(out);
    file.publish()?;
    Ok(report)
}

/// Division of the memory.
struct Plan {
    /// Cells along an axis of a box: a power of two, at most the core of a brick.
    cells: u64,
    cache_bytes: usize,
}

impl Plan {
    fn new(container: &Container, memory_bytes: u64) -> Result<Self, BuildError> {
        let descriptor = container.descriptor();
        let fixed = LevelReader::working_bytes(descriptor, 1) + WRITE_BUFFERS_BYTES;
        let needed = |cells: u64| fixed + bytes_of_box(cells + 1);
        let purpose = MemoryPurpose::Other("to decode a brick and to make a mesh of it");
        let memory_bytes = left_for_data(memory_bytes, needed(LEAST_CELLS), purpose)?;
        let core = container.pyramid().layout().core() as u64;
        // A quarter of the memory is left for the brick cache.
        let fits = |cells: &u64| *cells == LEAST_CELLS || needed(*cells) <= memory_bytes / 4 * 3;
        let cells = std::iter::successors(Some(core), |n| Some(n / 2)).find(fits).unwrap_or(LEAST_CELLS);
        Ok(Self { cells, cache_bytes: cast::index(memory_bytes - needed(cells)) })
    }
}

/// Boxes of voxels that overlap by one voxel, so that each cell between voxels is in exactly one of them.
fn boxes_of_cells(voxels: VoxelBox, cells: u64) -> impl Iterator<Item = VoxelBox> {
    let pieces = move |axis: usize| {
        let (start, last) = (voxels.start[axis], voxels.end[axis] - 1);
        let ends = move |at: u64| (at / cells + 1).saturating_mul(cells).min(last);
        std::iter::successors(Some(start).filter(|at| *at < last), move |at| {
            Some(ends(*at)).filter(|next| *next < last)
        })
        .map(move |at| [at, ends(at) + 1])
    };
    pieces(2).flat_map(move |z| {
        pieces(1)
            .flat_map(move |y| pieces(0).map(move |x| VoxelBox { start: [x[0], y[0], z[0]], end: [x[1], y[1], z[1]] }))
    })
}

/// Whether the isovalue lies in the range of the brick in which a box begins; the range includes the voxels around the
/// brick.
fn is_crossed(container: &Container, options: &MeshOptions, part: VoxelBox) -> Result<bool, BuildError> {
    let core = container.pyramid().layout().core() as u64;
    let brick = part.start.map(|at| u32::try_from(at / core).expect("brick keys hold every brick of a level"));
    let entry = container.entry(BrickKey::new(options.lod, BrickIndex(brick)));
    let range = entry.map_err(|e| BuildError::container(container.path(), e))?.range;
    let [a, b] = [range.min, range.max].map(|stored| container.descriptor().value(stored));
    Ok(a.min(b) <= options.iso && options.iso <= a.max(b))
}

/// Voxels in the data's own units; absent ones are NaN.
fn values(container: &Container, part: VoxelBox, bytes: &[u8]) -> Values {
    let descriptor = container.descriptor();
    let value = |stored| if descriptor.absence.is_absent(stored) { f64::NAN } else { descriptor.value(stored) };
    let values = voxels_as_f64(descriptor.voxel_type, bytes).into_iter().map(value).collect();
    Values { start: part.start, size: part.extent(), values }
}
