use std::fmt::Write as _;

use super::*;

const CORNERS: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 4.0]];
const FACES: [[u8; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];

fn written(name: &str, bytes: &[u8]) -> Result<Arc<ClosedMesh>, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    read(&path).map_err(|e| e.to_string())
}

fn ply(format: &str, rows: &[u8]) -> Vec<u8> {
    let header = format!(
        "ply\nformat {format} 1.0\ncomment none\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
         property uchar red\nelement face 4\nproperty list uchar int vertex_indices\nend_header\n"
    );
    [header.as_bytes(), rows].concat()
}

fn ply_text() -> Vec<u8> {
    let mut rows = String::new();
    CORNERS.iter().for_each(|[x, y, z]| writeln!(rows, "{x} {y} {z} 7").unwrap());
    FACES.iter().for_each(|[a, b, c]| writeln!(rows, "3 {a} {b} {c}").unwrap());
    ply("ascii", rows.as_bytes())
}

fn ply_binary(is_little: bool) -> Vec<u8> {
    let of = |mut bytes: [u8; 4]| {
        if !is_little {
            bytes.reverse();
        }
        bytes
    };
    let mut rows = Vec::new();
    for corner in CORNERS {
        corner.iter().for_each(|v| rows.extend(of(v.to_le_bytes())));
        rows.push(7);
    }
    for face in FACES {
        rows.push(3);
        face.iter().for_each(|&n| rows.extend(of(u32::from(n).to_le_bytes())));
    }
    ply(if is_little { "binary_little_endian" } else { "binary_big_endian" }, &rows)
}

fn stl_binary(title: &[u8]) -> Vec<u8> {
    let mut bytes = vec![b' '; 80];
    bytes[..title.len()].copy_from_slice(title);
    bytes.extend(4u32.to_le_bytes());
    for face in FACES {
        bytes.extend([0; 12]);
        face.iter().flat_map(|&n| CORNERS[usize::from(n)]).for_each(|v| bytes.extend(v.to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

fn stl_text() -> Vec<u8> {
    let mut text = "solid of four faces\n".to_owned();
    for face in FACES {
        text += "facet normal 0 0 0\n outer loop\n";
        face.iter().for_each(|&n| {
            let [x, y, z] = CORNERS[usize::from(n)];
            writeln!(text, "  vertex {x} {y} {z}").unwrap();
        });
        text += " endloop\nendfacet\n";
    }
    (text + "endsolid\n").into_bytes()
}

fn obj() -> Vec<u8> {
    let mut text = "# none\no four\n".to_owned();
    CORNERS.iter().for_each(|[x, y, z]| writeln!(text, "v {x} {y} {z}").unwrap());
    // Indices from the beginning, and from the end.
    FACES[..3].iter().for_each(|[a, b, c]| writeln!(text, "f {}/1/1 {}//2 {}", a + 1, b + 1, c + 1).unwrap());
    (text + "f -3 -2 -1\n").into_bytes()
}

#[test]
fn every_format_holds_the_same_mesh() {
    let along_x = (DVec3::new(-1.0, 0.5, 0.5), DVec3::X);
    let expected = 1.0 + 2.0 * (1.0 - 0.5 / 3.0 - 0.5 / 4.0);
    for (name, bytes) in [
        ("a.ply", ply_text()),
        ("a.PLY", ply_binary(true)),
        ("b.ply", ply_binary(false)),
        ("a.stl", stl_binary(b"made by hand")),
        ("b.stl", stl_binary(b"solid, but binary")),
        ("c.stl", stl_text()),
        ("a.obj", obj()),
    ] {
        let mesh = written(name, &bytes).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!(mesh.triangle_count(), 4, "{name}");
        let found = mesh.crossings(along_x.0, along_x.1);
        assert!(found.len() == 2 && found[0] == 1.0 && (found[1] - expected).abs() < 1e-12, "{name}: {found:?}");
    }
}

#[test]
fn polygons_are_cut_into_triangles() {
    let square = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n\
        f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";
    assert_eq!(written("cube.obj", square).unwrap().triangle_count(), 12);
}

#[test]
fn what_is_no_mesh_is_refused_with_what_was_expected() {
    let text = ply_text();
    let short = &text[..text.len() - 9];
    let beyond = String::from_utf8(text.clone()).unwrap().replace("3 1 2 3\n", "3 1 2 9\n");
    let open = String::from_utf8(obj()).unwrap().replace("f -3 -2 -1\n", "");
    let stl = stl_binary(b"made by hand");
    let long = format!("v 1 2 3{}\n", " ".repeat(70_000));
    for (name, bytes, expected) in [
        ("a.xyz", &b"1 2 3"[..], ".ply, .stl or .obj"),
        ("a.ply", b"PLY\n", "begins with 'ply'"),
        ("a.ply", short, "expected more numbers"),
        ("a.ply", &ply_binary(true)[..200], "failed to fill"),
        ("a.ply", beyond.as_bytes(), "found 9 in triangle 3"),
        ("a.ply", b"ply\nformat ascii 1.0\nelement vertex 9999999999999\nend_header\n", "expected triangles"),
        ("a.stl", &stl[..stl.len() - 1], "4 triangles of 50 bytes"),
        ("a.obj", open.as_bytes(), "open edge"),
        ("a.obj", b"v 1 2\n", "expected a number"),
        ("a.obj", b"v 1 2 3\nf 1 2\n", "at least three corners"),
        ("a.obj", b"f 0 1 2\n", "the number of a vertex"),
        ("a.obj", long.as_bytes(), "at most 65536 bytes"),
        ("a.obj", b"", "expected triangles"),
    ] {
        let message = written(name, bytes).unwrap_err();
        assert!(message.contains(expected) && message.contains(name), "{name}: {message}");
    }
    assert!(read(Path::new("/nowhere/a.ply")).unwrap_err().to_string().contains("/nowhere/a.ply"));
}

/// Scenes are resolved for every picture. A changed file is read again.
#[test]
fn a_mesh_is_read_once() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.obj");
    std::fs::write(&path, obj()).unwrap();
    let first = read(&path).unwrap();
    assert!(Arc::ptr_eq(&first, &read(&path).unwrap()));
    std::fs::write(&path, [&b"# longer\n"[..], &obj()].concat()).unwrap();
    assert!(!Arc::ptr_eq(&first, &read(&path).unwrap()));
}
