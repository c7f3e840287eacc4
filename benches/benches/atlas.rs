//! Memory saving by a packed adaptive atlas (Kraus and Ertl 2002). The bench finds the coarsest sufficient lattice for
//! each brick of real volumes, and the memory that this would save. `cargo bench -p supervol-benches --bench atlas --
//! A.svol B.svol ...` prints a table.
//!
//! A lattice has every 2nd, 4th, 8th or 16th voxel along each axis, starting at the core's first voxel. Its nodes are
//! voxels. Within a cell of the fine grid both interpolants are then trilinear, and their greatest difference occurs at
//! a voxel. So the comparison covers everything that rays see. Apron layers outside the grid repeat its edge; they are
//! not data and are not compared. Nodes there, and beyond the stored voxels, continue the line through the last two
//! known nodes, as exactly as the voxel type allows. Bricks with absent voxels stay unchanged. A brick may also become
//! uniform.
//!
//! Containers must hold the source's own voxels. For each tolerance (a share of the volume's range) the table shows:
//! - the present memory of bricks: none for uniform bricks, the stored voxels for all others;
//! - their memory from a container of `build --max-error` with that tolerance, in which more bricks are uniform;
//! - their memory as lattices, equal along all axes or not, packed without loss;
//! - the same for bricks whose parent's error exceeds the tolerance: all others are drawn from the coarser level.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "it measures small numbers"
)]
#![allow(missing_docs, clippy::print_stdout, reason = "a bench has no callers, and prints what it found")]

use std::path::{Path, PathBuf};

use supervol_format::brick::APRON;
use supervol_format::codec::quantize::Quantizer;
use supervol_format::voxel_type::voxels_as_f64;
use supervol_format::{BrickKey, Container, Lod, VoxelType};

/// Greatest errors, as shares of the volume's range.
const TOLERANCES: [f64; 5] = [0.0, 0.001, 0.005, 0.01, 0.02];
/// Distances between nodes, in voxels.
const SCALES: [usize; 5] = [1, 2, 4, 8, 16];
/// Cache size for the number of bricks that fit.
const CACHE_BYTES: f64 = 256.0 * 1024.0 * 1024.0;

/// The stored voxels of a brick, and the part of them inside the grid.
struct Brick {
    values: Vec<f64>,
    extent: [usize; 3],
    /// First and last voxel inside the grid, along each axis.
    inside: [(usize, usize); 3],
    voxel_type: VoxelType,
}

/// Nodes along one axis, and the position of each voxel between them.
struct Axis {
    /// Position of each node in voxels; some lie beyond the grid.
    nodes: Vec<isize>,
    /// For each voxel inside the grid: the node before it, and the share of the way to the next node, 0 to 1.
    places: Vec<(usize, f64)>,
}

impl Axis {
    fn new((first, last): (usize, usize), scale: usize) -> Self {
        let (scale, apron) = (scale as isize, APRON as isize);
        let (first, last) = (first as isize, last as isize);
        let start = apron - ((apron - first).max(0) + scale - 1) / scale * scale;
        let count = (last - start + scale - 1) / scale + 1;
        let nodes: Vec<isize> = (0..count).map(|i| start + i * scale).collect();
        let place = |voxel: isize| {
            let node = ((voxel - start) / scale).min((count - 2).max(0));
            (node as usize, (voxel - start - node * scale) as f64 / scale as f64)
        };
        Self { places: (first..=last).map(place).collect(), nodes }
    }

    /// Voxels and weights that give a node's value: the voxel itself, or the line through two others.
    fn sources(&self, node: usize, (first, last): (usize, usize)) -> [(usize, f64); 2] {
        let at = self.nodes[node];
        let line = |edge: usize, inner: isize| {
            let inner = inner.clamp(first as isize, last as isize) as usize;
            if inner == edge {
                return [(edge, 1.0), (edge, 0.0)];
            }
            let t = (at - inner as isize) as f64 / (edge as f64 - inner as f64);
            [(edge, t), (inner, 1.0 - t)]
        };
        if at < first as isize {
            line(first, self.nodes.get(node + 1).copied().unwrap_or(at))
        } else if at > last as isize {
            line(last, if node > 0 { self.nodes[node - 1] } else { at })
        } else {
            [(at as usize, 1.0), (at as usize, 0.0)]
        }
    }
}

impl Brick {
    fn read(container: &Container, key: BrickKey) -> Self {
        let descriptor = container.descriptor();
        let entry = container.entry(key).expect("a whole container");
        let bytes = container.read_brick(key, &entry).expect("a whole container");
        let core = container.pyramid().core_box(key);
        let dims = container.pyramid().level_at(key.lod()).dims.0;
        let extent = container.shape(key).extent;
        let inside = std::array::from_fn(|a| {
            let before = core.start[a].min(APRON as u64) as usize;
            let behind = (dims[a] - core.end[a]).min(APRON as u64) as usize;
            (APRON - before, extent[a] - 1 - (APRON - behind))
        });
        let voxel_type = descriptor.voxel_type;
        Self { values: voxels_as_f64(voxel_type, &bytes), extent, inside, voxel_type }
    }

    fn at(&self, [x, y, z]: [usize; 3]) -> f64 {
        self.values[(z * self.extent[1] + y) * self.extent[0] + x]
    }

    /// The nodes of a lattice, x fastest, rounded to the voxel type.
    fn lattice(&self, axes: &[Axis; 3]) -> Vec<f64> {
        let sources: [Vec<[(usize, f64); 2]>; 3] =
            std::array::from_fn(|a| (0..axes[a].nodes.len()).map(|n| axes[a].sources(n, self.inside[a])).collect());
        let mut nodes = Vec::with_capacity(sources.iter().map(Vec::len).product());
        for z in &sources[2] {
            for y in &sources[1] {
                for x in &sources[0] {
                    if [x, y, z].iter().all(|line| line[1].1 == 0.0) {
                        nodes.push(self.at([x[0].0, y[0].0, z[0].0]));
                        continue;
                    }
                    let terms = z.iter().flat_map(|z| y.iter().flat_map(move |y| x.iter().map(move |x| (x, y, z))));
                    let value = terms.map(|(x, y, z)| x.1 * y.1 * z.1 * self.at([x.0, y.0, z.0]));
                    nodes.push(self.representable(value.sum()));
                }
            }
        }
        nodes
    }

    fn representable(&self, value: f64) -> f64 {
        supervol_format::with_voxel!(self.voxel_type, V => {
            use supervol_format::voxel_type::Voxel;
            <V as Voxel>::from_f64(if V::TYPE.is_float() { value } else { value.round() }).to_f64()
        })
    }

    /// Greatest distance between the voxels and a lattice with these scales; infinity as soon as it exceeds `limit`.
    fn error(&self, scales: [usize; 3], limit: f64) -> f64 {
        let axes: [Axis; 3] = std::array::from_fn(|a| Axis::new(self.inside[a], scales[a]));
        let nodes = self.lattice(&axes);
        let [nx, ny, nz] = [0, 1, 2].map(|a| axes[a].nodes.len());
        let mut worst = 0.0f64;
        for (k, &(z, wz)) in axes[2].places.iter().enumerate() {
            for (j, &(y, wy)) in axes[1].places.iter().enumerate() {
                // The four surrounding rows of nodes, combined into one row.
                let (y1, z1) = ((y + 1).min(ny - 1), (z + 1).min(nz - 1));
                let node = |x: usize, y: usize, z: usize| nodes[(z * ny + y) * nx + x];
                let row: Vec<f64> = (0..nx)
                    .map(|x| {
                        let [low, high] = [z, z1].map(|z| node(x, y, z) + wy * (node(x, y1, z) - node(x, y, z)));
                        low + wz * (high - low)
                    })
                    .collect();
                for (i, &(x, wx)) in axes[0].places.iter().enumerate() {
                    let coarse = row[x] + wx * (row[(x + 1).min(nx - 1)] - row[x]);
                    let at = [self.inside[0].0 + i, self.inside[1].0 + j, self.inside[2].0 + k];
                    worst = worst.max((coarse - self.at(at)).abs());
                }
                if worst > limit {
                    return f64::INFINITY;
                }
            }
        }
        worst
    }

    /// Half of the value range: the distance from the best single value.
    fn error_of_one_value(&self) -> f64 {
        let (min, max) = self.values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), &v| (a.min(v), b.max(v)));
        0.5 * (max - min)
    }

    fn voxel_bytes(&self) -> usize {
        self.voxel_type.bytes()
    }

    fn bytes(&self) -> usize {
        self.values.len() * self.voxel_bytes()
    }

    /// Bytes on a lattice that covers the stored voxels.
    fn bytes_at(&self, scales: [usize; 3]) -> usize {
        let nodes = (0..3).map(|a| Axis::new((0, self.extent[a] - 1), scales[a]).nodes.len());
        (nodes.product::<usize>() * self.voxel_bytes()).min(self.bytes())
    }

    /// Whether `build --max-error` makes the brick uniform.
    fn is_one_value_within(&self, tolerance: f64) -> bool {
        let Some(quantizer) = Quantizer::within(self.voxel_type, tolerance) else { return false };
        supervol_format::with_voxel!(self.voxel_type, V => {
            use supervol_format::voxel_type::Voxel;
            let mut indices = self.values.iter().map(|&v| quantizer.index(<V as Voxel>::from_f64(v)));
            let first = indices.next();
            indices.all(|index| Some(index) == first)
        })
    }
}

/// Sums over the bricks of a container at one tolerance.
#[derive(Default, Clone, Copy)]
struct Sums {
    /// Number of bricks with memory now, and from a container with this error.
    bricks: usize,
    /// Numbers of these bricks by scale, equal along all axes; the last entry counts uniform bricks.
    by_scale: [usize; SCALES.len() + 1],
    /// Bytes of bricks that are not uniform: now, and with the tolerance.
    today: usize,
    bounded: usize,
    /// Bytes as lattices with equal scales along all axes, and with any scales.
    alike: usize,
    any: usize,
}

impl Sums {
    fn add(&mut self, brick: &Brick, tolerance: f64, has_holes: bool, errors: &[([usize; 3], f64)]) {
        self.today += brick.bytes();
        if brick.is_one_value_within(tolerance) {
            return;
        }
        self.bricks += 1;
        self.bounded += brick.bytes();
        if !has_holes && brick.error_of_one_value() <= tolerance {
            self.by_scale[SCALES.len()] += 1;
            return;
        }
        let fitting = || errors.iter().filter(|(_, error)| *error <= tolerance).map(|(scales, _)| *scales);
        let coarsest = fitting().filter(|s| s[0] == s[1] && s[1] == s[2]).map(|s| s[0]).max().unwrap_or(1);
        self.by_scale[SCALES.iter().position(|s| *s == coarsest).expect("one of them")] += 1;
        self.alike += brick.bytes_at([coarsest; 3]);
        self.any += fitting().map(|scales| brick.bytes_at(scales)).min().unwrap_or(brick.bytes());
    }
}

fn all_scales() -> impl Iterator<Item = [usize; 3]> {
    SCALES.into_iter().flat_map(|x| SCALES.into_iter().flat_map(move |y| SCALES.map(|z| [x, y, z]))).skip(1)
}

fn measure(path: &Path) {
    let container = Container::open(path).expect("a container");
    let descriptor = container.descriptor();
    assert!(descriptor.quantizer.is_none(), "{}: its voxels have been moved already", path.display());
    let pyramid = container.pyramid();
    let entry = |key| container.entry(key).expect("a whole container");
    let top = pyramid.keys_of(pyramid.coarsest()).map(|key| entry(key).range_beneath);
    let width = top.reduce(|a, b| a.union(b)).expect("a level has bricks").width();
    let tolerances = TOLERANCES.map(|share| share * width);
    let greatest = tolerances[TOLERANCES.len() - 1];
    // All bricks, and those that no coarser level replaces.
    let mut sums = [[Sums::default(); TOLERANCES.len()]; 2];
    for lod in 0..pyramid.levels().len() {
        for key in pyramid.keys_of(Lod(lod as u8)) {
            let of_brick = entry(key);
            if of_brick.uniform || of_brick.absent {
                continue;
            }
            let brick = Brick::read(&container, key);
            let parent_error = pyramid.parent(key).map_or(f64::INFINITY, |parent| entry(parent).error);
            let lattices = all_scales().filter(|_| !of_brick.has_holes);
            let errors: Vec<_> = lattices.map(|scales| (scales, brick.error(scales, greatest))).collect();
            for (t, &tolerance) in tolerances.iter().enumerate() {
                sums[0][t].add(&brick, tolerance, of_brick.has_holes, &errors);
                if parent_error > tolerance {
                    sums[1][t].add(&brick, tolerance, of_brick.has_holes, &errors);
                }
            }
        }
    }
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    for (t, share) in TOLERANCES.iter().enumerate() {
        print_row(&name, share * 100.0, &sums[0][t], &sums[1][t]);
    }
}

fn print_row(name: &str, percent: f64, all: &Sums, drawn: &Sums) {
    let share = |part: usize, whole: usize| if whole == 0 { 1.0 } else { part as f64 / whole as f64 };
    let fit = |bytes: usize| CACHE_BYTES * all.bricks as f64 / bytes.max(1) as f64;
    let counts: Vec<String> = all.by_scale.iter().map(usize::to_string).collect();
    println!(
        "| {name} | {percent} | {:.1} | {:.1} | {} | {:.3} | {:.3} | {:.0}, {:.0} | {}; {:.3} | {:.3} |",
        all.today as f64 / 1e6,
        all.bounded as f64 / 1e6,
        counts.join(", "),
        share(all.alike, all.bounded),
        share(all.any, all.bounded),
        fit(all.bounded),
        fit(all.alike),
        drawn.bricks,
        share(drawn.bounded, all.bounded),
        share(drawn.alike, drawn.bounded),
    );
}

fn main() {
    println!(
        "| data | tolerance, % | MB today | MB, --max-error | bricks at scale 1, 2, 4, 8, 16, one value | atlas / --max-error | scales \
         by axis / --max-error | bricks in 256 MiB: without, with | bricks no parent stands for; share of the bytes | atlas / \
         --max-error, of those |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    // Cargo passes an option of its own to benches.
    let containers = std::env::args_os().skip(1).filter(|argument| !argument.to_string_lossy().starts_with("--"));
    containers.map(PathBuf::from).for_each(|path| measure(&path));
}
