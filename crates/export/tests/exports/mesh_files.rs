//! Meshes: closed across bricks, facing outwards, at the right place, in three formats.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use glam::DVec3;
use supervol_export::mesh::{MeshOptions, mesh};
use supervol_format::container::manifest::Source;
use supervol_format::random::Random;
use supervol_format::{BrickLayout, Container, Geometry, Lod, VoxelBox, VoxelType};
use supervol_preprocess::{BuildError, BuildOptions, Existing, build};
use supervol_sources::SourceInfo;
use supervol_sources::computed::Computed;

const N: u64 = 38;

struct Case {
    folder: tempfile::TempDir,
    container: Container,
}

impl Case {
    fn new(
        voxel_type: VoxelType,
        change: impl FnOnce(&mut SourceInfo),
        value: impl Fn([u64; 3]) -> f64 + Send + Sync + 'static,
    ) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let source = Computed::new([N; 3], voxel_type, value).with_info(change);
        let origin = Source { name: "v".into(), format: "synth".into(), bytes: 0, xxh3_64: String::new() };
        let path = folder.path().join("v.svol");
        let layout = BrickLayout::new(16).unwrap();
        build(
            &source,
            origin,
            &path,
            &BuildOptions { layout, memory_bytes: 64 << 20, ..BuildOptions::default() },
            &|_| (),
        )
        .unwrap();
        let container = Container::open(&path).unwrap();
        Self { folder, container }
    }

    fn write(&self, name: &str, options: &MeshOptions) -> Result<PathBuf, BuildError> {
        let output = self.folder.path().join(name);
        mesh(&self.container, &output, options).map(|_| output)
    }

    fn triangles(&self, name: &str, iso: f64) -> Vec<[DVec3; 3]> {
        read(&self.write(name, &options(iso)).unwrap())
    }
}

fn options(iso: f64) -> MeshOptions {
    MeshOptions { iso, lod: Lod(0), voxels: None, existing: Existing::Replace, memory_bytes: 64 << 20 }
}

/// Triangles of a mesh file in any of the three formats.
fn read(path: &Path) -> Vec<[DVec3; 3]> {
    let bytes = std::fs::read(path).unwrap();
    let f32_at = |at: usize| f64::from(f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()));
    let u32_at = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    match path.extension().unwrap().to_str().unwrap() {
        "stl" => {
            let count = u32_at(80);
            assert_eq!(bytes.len(), 84 + 50 * count);
            let point = |at: usize| DVec3::new(f32_at(at), f32_at(at + 4), f32_at(at + 8));
            (0..count).map(|i| [1, 2, 3].map(|k| point(84 + 50 * i + 12 * k))).collect()
        }
        "ply" => {
            let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
            let header = std::str::from_utf8(&bytes[..end]).unwrap();
            let count = |name: &str| -> usize {
                header.split(name).nth(1).unwrap().lines().next().unwrap().trim().parse().unwrap()
            };
            let (vertices, faces) = (count("element vertex "), count("element face "));
            let is_double = header.contains("property double x");
            let size = if is_double { 8 } else { 4 };
            let number = |i: usize| match is_double {
                true => f64::from_le_bytes(bytes[end + 8 * i..end + 8 * i + 8].try_into().unwrap()),
                false => f32_at(end + 4 * i),
            };
            let point = |i: usize| DVec3::new(number(3 * i), number(3 * i + 1), number(3 * i + 2));
            let first = end + 3 * size * vertices;
            assert_eq!(bytes.len(), first + 13 * faces);
            (0..faces).map(|i| [0, 1, 2].map(|k| point(u32_at(first + 13 * i + 1 + 4 * k)))).collect()
        }
        _ => {
            let text = String::from_utf8(bytes).unwrap();
            let numbers = |line: &str| -> Vec<f64> { line.split(' ').skip(1).map(|n| n.parse().unwrap()).collect() };
            let points: Vec<DVec3> =
                text.lines().filter(|l| l.starts_with('v')).map(|l| DVec3::from_slice(&numbers(l))).collect();
            let faces = text.lines().filter(|l| l.starts_with('f')).map(numbers);
            faces.map(|face| [0, 1, 2].map(|k| points[face[k] as usize - 1])).collect()
        }
    }
}

/// Whether each edge is used equally often in both directions, with corners compared by their bits.
fn is_closed(triangles: &[[DVec3; 3]]) -> bool {
    let bits = |p: DVec3| p.to_array().map(|v| (v + 0.0).to_bits());
    let mut balance: HashMap<_, i64> = HashMap::new();
    for t in triangles {
        for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
            let (a, b) = (bits(a), bits(b));
            *balance.entry((a.min(b), a.max(b))).or_default() += if a < b { 1 } else { -1 };
        }
    }
    balance.values().all(|n| *n == 0)
}

/// Volume enclosed by triangles that face outwards, and their total area.
fn volume_and_area(triangles: &[[DVec3; 3]]) -> (f64, f64) {
    let volume = triangles.iter().map(|[a, b, c]| a.dot(b.cross(*c)) / 6.0).sum();
    (volume, triangles.iter().map(|[a, b, c]| (b - a).cross(c - a).length() / 2.0).sum())
}

/// Noise inside, zero at the border.
fn noise([x, y, z]: [u64; 3]) -> f64 {
    let is_border = [x, y, z].iter().any(|i| *i == 0 || *i == N - 1);
    let hash = Random::new(x + (y << 20) + (z << 40)).next_u64();
    if is_border { 0.0 } else { (hash % 200 + 20) as f64 }
}

#[test]
fn noise_across_bricks_has_no_cracks() {
    let case = Case::new(VoxelType::U8, |_| (), noise);
    // Isovalues between voxel values, and equal to one, where several edges end in one point.
    for iso in [100.5, 100.0] {
        for name in ["m.ply", "m.stl", "m.obj"] {
            let triangles = case.triangles(name, iso);
            assert!(triangles.len() > 50_000, "{name}: {}", triangles.len());
            assert!(is_closed(&triangles), "{name} at {iso} has a crack");
        }
    }
    // Little memory gives smaller boxes, but the same triangles.
    let sorted = |triangles: Vec<[DVec3; 3]>| {
        let mut keys: Vec<_> = triangles.iter().map(|t| t.map(|p| p.to_array().map(f64::to_bits))).collect();
        keys.sort_unstable();
        keys
    };
    let little = MeshOptions { memory_bytes: 3 << 20, ..options(100.5) };
    let small = read(&case.write("small.ply", &little).unwrap());
    assert!(sorted(small) == sorted(case.triangles("m.ply", 100.5)));
    let error = case.write("none.ply", &MeshOptions { memory_bytes: 1 << 20, ..options(100.5) }).unwrap_err();
    assert!(error.to_string().contains("`memory_bytes`"), "{error}");
}

#[test]
fn a_ball_is_where_it_should_be_and_faces_outwards() {
    let ball =
        |[x, y, z]: [u64; 3]| 10.0 - (DVec3::new(x as f64, y as f64, z as f64) - DVec3::new(18.0, 17.5, 19.0)).length();
    for direction in [Geometry::IDENTITY.direction, [0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]] {
        let geometry = Geometry { spacing: [2.0; 3], origin: [100.0, -50.0, 3.0], direction };
        let case = Case::new(VoxelType::F32, |info| info.geometry = geometry, ball);
        let triangles = case.triangles("m.ply", 0.0);
        assert!(is_closed(&triangles));
        let (volume, area) = volume_and_area(&triangles);
        let (true_volume, true_area) = (4.0 / 3.0 * std::f64::consts::PI * 8000.0, 4.0 * std::f64::consts::PI * 400.0);
        assert!((volume / true_volume - 1.0).abs() < 0.01, "{volume} is not {true_volume}");
        assert!((area / true_area - 1.0).abs() < 0.01, "{area} is not {true_area}");
        let centre = geometry.world_from_index().transform_point3(DVec3::new(18.0, 17.5, 19.0));
        for point in triangles.iter().flatten() {
            assert!(((*point - centre).length() - 20.0).abs() < 0.05, "{point}");
        }
    }
}

#[test]
fn levels_boxes_holes_and_places_far_away() {
    let ball = |[x, y, z]: [u64; 3]| 10.0 - (DVec3::new(x as f64, y as f64, z as f64) - DVec3::splat(18.0)).length();
    let far = Geometry { origin: [432_000.0, 6_475_000.0, 0.0], ..Geometry::IDENTITY };
    let case = Case::new(VoxelType::F32, |info| info.geometry = far, ball);
    // Single precision would place vertices half a metre apart.
    assert!(
        std::fs::read(case.write("far.ply", &options(0.0)).unwrap())
            .unwrap()
            .starts_with(b"ply\nformat binary_little_endian 1.0\n")
    );
    let triangles = case.triangles("far.ply", 0.0);
    assert!(is_closed(&triangles));
    let middle = far.world_from_index().transform_point3(DVec3::splat(18.0));
    assert!(triangles.iter().flatten().all(|p| ((*p - middle).length() - 10.0).abs() < 0.05));
    // A coarser level lies at the same place.
    let coarse = read(&case.write("coarse.ply", &MeshOptions { lod: Lod(1), ..options(0.0) }).unwrap());
    assert!(coarse.len() < triangles.len() / 3 && is_closed(&coarse));
    assert!(coarse.iter().flatten().all(|p| ((*p - middle).length() - 10.0).abs() < 0.3));
    // Half of the volume.
    let half = VoxelBox { start: [0; 3], end: [19, N, N] };
    let cut = read(&case.write("half.stl", &MeshOptions { voxels: Some(half), ..options(0.0) }).unwrap());
    assert!(!is_closed(&cut) && (cut.len() * 10).abs_diff(triangles.len() * 5) < triangles.len());
    let error = case.write("none.obj", &options(11.0)).unwrap_err();
    assert!(error.to_string().contains("no surface") && matches!(error, BuildError::NoSurface { .. }), "{error}");
    let error = case.write("none.glb", &options(0.0)).unwrap_err();
    assert!(error.to_string().contains(".ply, .stl or .obj"), "{error}");
    assert!(!case.folder.path().join("none.obj").exists());
    // There is no surface at absent voxels.
    let holes = Case::new(VoxelType::F32, |_| (), move |at| if at[0] < 18 { f64::NAN } else { ball(at) });
    let triangles = holes.triangles("holes.ply", 0.0);
    assert!(triangles.iter().flatten().all(|p| p.x >= 18.0) && !triangles.is_empty());
}
