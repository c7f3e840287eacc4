use std::f64::consts::{PI, TAU};

use proptest::prelude::*;

use super::*;

/// A box of twelve triangles.
fn cuboid(low: [f64; 3], high: [f64; 3]) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let corner = |n: usize| DVec3::from_array(std::array::from_fn(|a| if n >> a & 1 == 0 { low[a] } else { high[a] }));
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    ((0..8).map(corner).collect(), faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect())
}

/// A ring around the third axis.
fn ring(along: u32, around: u32) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let point = |i: u32, j: u32| {
        let (u, v) = (TAU * f64::from(i) / f64::from(along), TAU * f64::from(j) / f64::from(around));
        let r = 3.0 + v.cos();
        DVec3::new(r * u.cos(), r * u.sin(), v.sin())
    };
    let number = |i: u32, j: u32| i % along * around + j % around;
    let cells = (0..along).flat_map(|i| (0..around).map(move |j| (i, j)));
    let vertices = cells.clone().map(|(i, j)| point(i, j)).collect();
    let triangles = cells.flat_map(|(i, j)| {
        let [a, b, c, d] = [number(i, j), number(i + 1, j), number(i + 1, j + 1), number(i, j + 1)];
        [[a, b, c], [a, c, d]]
    });
    (vertices, triangles.collect())
}

fn mesh((vertices, triangles): (Vec<DVec3>, Vec<[u32; 3]>)) -> ClosedMesh {
    ClosedMesh::new(&vertices, &triangles).unwrap()
}

/// Winding number of the mesh around a point: 1 inside, 0 outside (van Oosterom and Strackee 1983).
fn winding((vertices, triangles): &(Vec<DVec3>, Vec<[u32; 3]>), point: DVec3) -> f64 {
    let solid_angle = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|vertex| vertices[vertex as usize] - point);
        let [la, lb, lc] = [a.length(), b.length(), c.length()];
        let below = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
        2.0 * a.dot(b.cross(c)).atan2(below)
    };
    triangles.iter().map(solid_angle).sum::<f64>() / (4.0 * PI)
}

#[test]
fn a_box_is_crossed_where_it_stands() {
    let cube = mesh(cuboid([1.0, 2.0, 3.0], [5.0, 6.0, 7.0]));
    assert_eq!(cube.triangle_count(), 12);
    assert_eq!(cube.crossings(DVec3::new(-10.0, 3.5, 4.0), DVec3::X), [11.0, 15.0]);
    assert_eq!(cube.crossings(DVec3::new(2.0, 3.5, -1.0), DVec3::Z), [4.0, 8.0]);
    assert!(cube.crossings(DVec3::new(-10.0, 6.5, 4.0), DVec3::X).is_empty());
    assert!(cube.crossings(DVec3::new(f64::NAN, 3.0, 4.0), DVec3::X).is_empty());
    // Through the diagonal that two triangles of a face share.
    let diagonal = cube.crossings(DVec3::new(-1e7, 4.0, 5.0), DVec3::X);
    assert!(diagonal.len() == 2 && (diagonal[0] - 1e7 - 1.0).abs() < 1e-7, "{diagonal:?}");
}

#[test]
fn lines_through_corners_and_along_edges_cross_an_even_number_of_times() {
    for solid in [cuboid([-1.0; 3], [1.0, 2.0, 3.0]), ring(12, 6)] {
        let (vertices, _) = solid.clone();
        let mesh = mesh(solid);
        let mut crossed = 0;
        for (i, &p) in vertices.iter().enumerate() {
            for &q in &vertices[i + 1..] {
                let found = mesh.crossings(p - 3.0 * (q - p), q - p);
                assert!(found.len().is_multiple_of(2), "from {p} to {q}: {found:?}");
                crossed += usize::from(!found.is_empty());
            }
        }
        assert!(crossed > vertices.len(), "{crossed} lines cross");
    }
}

#[test]
fn what_is_not_closed_is_refused_with_the_place() {
    let (vertices, triangles) = cuboid([0.0; 3], [1.0; 3]);
    let refused = |vertices: &[DVec3], triangles: &[[u32; 3]]| ClosedMesh::new(vertices, triangles).unwrap_err();
    match refused(&vertices, &triangles[1..]) {
        MeshError::Open { from, to, triangles: 1 } => assert!(from != to && from.min_element() >= 0.0),
        other => panic!("{other}"),
    }
    assert_eq!(refused(&vertices, &[]), MeshError::Empty);
    assert_eq!(refused(&vertices, &[[0, 0, 1]]), MeshError::Empty);
    assert_eq!(refused(&vertices, &[[0, 1, 9]]), MeshError::NoSuchVertex { triangle: 0, found: 9, vertices: 8 });
    let mut broken = vertices.clone();
    broken[3].y = f64::INFINITY;
    assert!(matches!(refused(&broken, &triangles), MeshError::NotFinite { vertex: 3, .. }));
    // Two boxes: crossing each other, side by side, and one inside the other, which makes a hollow box.
    let both = |low: f64, high: f64| {
        let (others, _) = cuboid([low; 3], [high; 3]);
        let numbers = triangles.iter().map(|t| t.map(|n| n + 8));
        let vertices: Vec<DVec3> = vertices.iter().chain(&others).copied().collect();
        ClosedMesh::new(&vertices, &triangles.iter().copied().chain(numbers).collect::<Vec<_>>())
    };
    match both(0.4, 1.7) {
        Err(MeshError::CrossesItself { near }) => {
            assert!(near.min_element() >= 0.4 - 1e-9 && near.max_element() <= 1.0 + 1e-9, "{near}");
        }
        other => panic!("{other:?}"),
    }
    assert!(both(2.0, 3.0).is_ok());
    let hollow = both(0.25, 0.75).unwrap();
    assert_eq!(hollow.crossings(DVec3::new(-1.0, 0.4, 0.45), DVec3::X), [1.0, 1.25, 1.75, 2.0]);
}

proptest! {
    /// The inside by crossings is the inside by winding number.
    #[test]
    fn inside_is_what_the_mesh_goes_around(
        origin in prop::array::uniform3(-5.0..5.0f64),
        direction in prop::array::uniform3(-1.0..1.0f64),
    ) {
        let direction = DVec3::from(direction);
        prop_assume!(direction.length() > 1e-3);
        let (origin, direction) = (DVec3::from(origin), direction.normalize());
        let solid = ring(16, 8);
        let found = mesh(solid.clone()).crossings(origin, direction);
        prop_assert!(found.len().is_multiple_of(2) && found.is_sorted());
        for i in 0..60 {
            let t = -12.0 + 24.0 * (f64::from(i) + 0.5) / 60.0;
            prop_assume!(found.iter().all(|crossing| (crossing - t).abs() > 1e-6));
            let is_inside = found.iter().filter(|&&crossing| crossing < t).count() % 2 == 1;
            let around = winding(&solid, origin + t * direction).abs();
            prop_assert_eq!(is_inside, around > 0.5, "at {}: {}", t, around);
        }
    }
}

proptest! {
    /// A box that holds a point of the surface is never reported free; a box far from the surface is.
    #[test]
    fn boxes_with_a_part_of_the_surface_are_entered(
        triangle in 0..256usize,
        shares in prop::array::uniform2(0.0..1.0f64),
        sizes in prop::array::uniform3(0.0..2.0f64),
    ) {
        let solid = ring(16, 8);
        let [a, b, c] = solid.1[triangle].map(|vertex| solid.0[vertex as usize]);
        let point = a + shares[0] * ((1.0 - shares[1]) * (b - a) + shares[1] * (c - a));
        let size = DVec3::from(sizes);
        let mesh = mesh(solid);
        prop_assert!(mesh.may_enter(point - size, point + size));
        // In the hole of the ring, and above it.
        for far in [DVec3::ZERO, DVec3::new(0.0, 0.0, 5.0)] {
            prop_assert!(!mesh.may_enter(far - 0.5 * size, far + 0.5 * size));
        }
    }
}
