//! Mesh files: PLY (binary), STL (binary), OBJ (text).
//!
//! The numbers of vertices and triangles come first in a file but are known last. Both lists are therefore spooled to
//! temporary files and never held in memory.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, Write};
use std::path::Path;

use glam::DVec3;
use supervol_preprocess::error::BuildError;
use supervol_sources::input::spool::{Spool, SpoolFolder};

/// Buffer size for copying in bytes.
const BUFFER_BYTES: usize = 1 << 18;
/// Bytes at the beginning of an STL file without a meaning.
const STL_TITLE_BYTES: usize = 80;

/// Mesh formats.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Format {
    Ply,
    Stl,
    Obj,
}

impl Format {
    /// The format of a file name's ending.
    pub(super) fn of(path: &Path) -> Result<Self, BuildError> {
        let end = path.extension().map(|end| end.to_string_lossy().to_lowercase());
        match end.as_deref() {
            Some("ply") => Ok(Self::Ply),
            Some("stl") => Ok(Self::Stl),
            Some("obj") => Ok(Self::Obj),
            other => {
                let found = other.map_or("none".into(), |end| format!(".{end}"));
                let path = path.display();
                Err(BuildError::Options(format!(
                    "{path}: expected an output ending in .ply, .stl or .obj, found {found}"
                )))
            }
        }
    }
}

/// A mesh being written.
pub(super) struct MeshFile<'a> {
    output: &'a Path,
    format: Format,
    /// Whether single precision would move vertices.
    is_double: bool,
    vertices: Spool,
    triangles: Spool,
    pub(super) vertex_count: u64,
    pub(super) triangle_count: u64,
}

impl<'a> MeshFile<'a> {
    /// An empty mesh; its temporary files are in `folder`.
    pub(super) fn begin(output: &'a Path, format: Format, is_double: bool, folder: &Path) -> Result<Self, BuildError> {
        let folder = SpoolFolder::at(folder);
        let (vertices, triangles) = (Spool::create(&folder)?, Spool::create(&folder)?);
        Ok(Self { output, format, is_double, vertices, triangles, vertex_count: 0, triangle_count: 0 })
    }

    /// Adds vertices, and triangles whose numbers refer to these vertices.
    pub(super) fn add(&mut self, vertices: &[DVec3], triangles: &[[u32; 3]]) -> Result<(), BuildError> {
        // STL counts triangles with 32 bits, and PLY numbers vertices with 32 bits.
        let (vertex_count, triangle_count) =
            (self.vertex_count + vertices.len() as u64, self.triangle_count + triangles.len() as u64);
        if vertex_count.max(triangle_count) > u64::from(u32::MAX) {
            let (vertices, triangles) = (vertex_count, triangle_count);
            return Err(BuildError::LargeSurface { path: self.output.into(), vertices, triangles });
        }
        let mut bytes = Vec::new();
        match self.format {
            Format::Stl => {
                for triangle in triangles {
                    let [a, b, c] = triangle.map(|number| vertices[number as usize]);
                    let normal = (b - a).cross(c - a).normalize_or_zero();
                    let numbers = [normal, a, b, c].into_iter().flat_map(|point| point.to_array());
                    bytes.extend(numbers.flat_map(single));
                    bytes.extend([0; 2]);
                }
                self.triangles.append(&bytes)?;
            }
            Format::Ply => {
                for value in vertices.iter().flat_map(|point| point.to_array()) {
                    match self.is_double {
                        true => bytes.extend(value.to_le_bytes()),
                        false => bytes.extend(single(value)),
                    }
                }
                self.vertices.append(&bytes)?;
                bytes.clear();
                let before = u32::try_from(self.vertex_count).expect("the check above refuses more vertices");
                for triangle in triangles {
                    bytes.push(3);
                    bytes.extend(triangle.iter().flat_map(|number| (number + before).to_le_bytes()));
                }
                self.triangles.append(&bytes)?;
            }
            Format::Obj => {
                let lines: String = vertices.iter().map(|p| format!("v {} {} {}\n", p.x, p.y, p.z)).collect();
                self.vertices.append(lines.as_bytes())?;
                // OBJ numbers begin at 1.
                let number = |n: u32| u64::from(n) + self.vertex_count + 1;
                let lines: String = triangles
                    .iter()
                    .map(|t| format!("f {} {} {}\n", number(t[0]), number(t[1]), number(t[2])))
                    .collect();
                self.triangles.append(lines.as_bytes())?;
            }
        }
        (self.vertex_count, self.triangle_count) = (vertex_count, triangle_count);
        Ok(())
    }

    /// Writes the whole mesh.
    pub(super) fn finish(self, out: &mut impl Write) -> Result<(), BuildError> {
        let header = match self.format {
            Format::Obj => Vec::new(),
            Format::Stl => {
                let count = u32::try_from(self.triangle_count).expect("`add` refuses more triangles than fit 32 bits");
                [vec![0; STL_TITLE_BYTES], count.to_le_bytes().to_vec()].concat()
            }
            Format::Ply => {
                let (vertices, triangles) = (self.vertex_count, self.triangle_count);
                let number = if self.is_double { "double" } else { "float" };
                format!(
                    "ply\nformat binary_little_endian 1.0\nelement vertex {vertices}\nproperty {number} x\nproperty {number} y\n\
                     property {number} z\nelement face {triangles}\nproperty list uchar uint vertex_indices\nend_header\n"
                )
                .into_bytes()
            }
        };
        let (vertices, triangles) = (self.vertices.finish()?, self.triangles.finish()?);
        let write = |out: &mut dyn Write| -> io::Result<()> {
            out.write_all(&header)?;
            copy(vertices, out)?;
            copy(triangles, out)
        };
        write(out).map_err(|e| BuildError::write(self.output, e))
    }
}

/// Bytes of a number in single precision.
#[expect(clippy::cast_possible_truncation, reason = "rounding to single precision is wanted")]
fn single(number: f64) -> [u8; 4] {
    (number as f32).to_le_bytes()
}

fn copy(mut file: File, out: &mut dyn Write) -> io::Result<()> {
    file.rewind()?;
    let mut reader = BufReader::new(file);
    let mut buffer = vec![0; BUFFER_BYTES];
    loop {
        match reader.read(&mut buffer)? {
            0 => return Ok(()),
            count => out.write_all(&buffer[..count])?,
        }
    }
}
