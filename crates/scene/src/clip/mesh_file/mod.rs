//! Readers of triangle meshes: PLY (text, binary), STL (text, binary), OBJ.
//!
//! Polygons become fans of triangles. Everything but positions and faces is skipped. Files are read as a stream; memory
//! is bounded by the limit of triangles.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::SystemTime;

use glam::DVec3;

use supervol_format::cast::{narrow, whole};

use super::mesh::{ClosedMesh, MeshError, TRIANGLE_LIMIT};

/// Longest line of text in a file.
const LINE_LIMIT: u64 = 1 << 16;
/// Most corners of a polygon.
const CORNER_LIMIT: usize = 1 << 12;
/// Most lines of the header of a PLY file.
const HEADER_LIMIT: usize = 1 << 10;
/// Most vertices: three per triangle.
const VERTEX_LIMIT: usize = 3 * TRIANGLE_LIMIT;
/// Bytes of a binary STL file before the first triangle, and per triangle.
const STL_BYTES: [usize; 2] = [84, 50];

/// Reason why a file holds no mesh to cut with.
#[derive(Debug, thiserror::Error)]
#[error("{}: {reason}", path.display())]
pub struct MeshFileError {
    path: PathBuf,
    reason: Reason,
}

#[derive(Debug, thiserror::Error)]
enum Reason {
    #[error(transparent)]
    Io(#[from] io::Error),
    #[error(transparent)]
    Mesh(#[from] MeshError),
    #[error("expected a name ending in .ply, .stl or .obj")]
    Name,
    #[error("expected {expected}, found {found}")]
    Content { expected: String, found: String },
}

/// Vertices and triangles in file order, not yet checked.
#[derive(Default)]
struct RawMesh {
    vertices: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
}

/// A file that is in use: path, time of change, length in bytes, and its mesh as long as a scene holds it.
type CachedMesh = (PathBuf, Option<SystemTime>, u64, Weak<ClosedMesh>);

/// Meshes in use. Scenes are resolved for every picture; this list avoids reading their files again.
static CACHED_MESHES: Mutex<Vec<CachedMesh>> = Mutex::new(Vec::new());

/// Reads the closed mesh in a file; the extension of the name gives the format.
///
/// # Errors
/// If the file cannot be read, has no known format, or holds no closed mesh.
pub fn read(path: &Path) -> Result<Arc<ClosedMesh>, MeshFileError> {
    let refused = |reason| MeshFileError { path: path.to_owned(), reason };
    let state = std::fs::metadata(path).map_err(|e| refused(e.into()))?;
    let (changed, length) = (state.modified().ok(), state.len());
    let cached_meshes = || CACHED_MESHES.lock().unwrap_or_else(PoisonError::into_inner);
    let known = cached_meshes()
        .iter()
        .find(|known| (&known.0, known.1, known.2) == (&path.to_owned(), changed, length))
        .map(|k| k.3.clone());
    if let Some(mesh) = known.and_then(|known| known.upgrade()) {
        return Ok(mesh);
    }
    let mesh = read_raw_mesh(path, length).map_err(refused)?;
    let mesh = Arc::new(ClosedMesh::new(&mesh.vertices, &mesh.triangles).map_err(|e| refused(e.into()))?);
    let mut cached_meshes = cached_meshes();
    cached_meshes.retain(|known| known.3.strong_count() > 0);
    cached_meshes.push((path.to_owned(), changed, length, Arc::downgrade(&mesh)));
    Ok(mesh)
}

fn read_raw_mesh(path: &Path, length: u64) -> Result<RawMesh, Reason> {
    let end = path.extension().map(|end| end.to_string_lossy().to_lowercase());
    let mut reader = BufReader::new(File::open(path)?);
    match end.as_deref() {
        Some("ply") => read_ply(&mut reader),
        Some("stl") => read_stl(&mut reader, length),
        Some("obj") => read_obj(&mut reader),
        _ => Err(Reason::Name),
    }
}

impl RawMesh {
    fn add_vertex(&mut self, vertex: DVec3) -> Result<u32, Reason> {
        if self.vertices.len() == VERTEX_LIMIT {
            return Err(MeshError::TooLarge.into());
        }
        self.vertices.push(vertex);
        Ok(narrow::<u32>(self.vertices.len()) - 1)
    }

    /// Adds a polygon as a fan of triangles around its first corner.
    fn add_face(&mut self, corners: &[u32]) -> Result<(), Reason> {
        if corners.len() < 3 {
            return Err(content("at least three corners of a face", corners.len()));
        }
        if self.triangles.len() + corners.len() - 2 > TRIANGLE_LIMIT {
            return Err(MeshError::TooLarge.into());
        }
        self.triangles.extend(corners[1..].windows(2).map(|pair| [corners[0], pair[0], pair[1]]));
        Ok(())
    }
}

fn content(expected: &str, found: impl std::fmt::Display) -> Reason {
    Reason::Content { expected: expected.into(), found: found.to_string() }
}

/// The next line without its end; `None` at the end of the file.
fn line(reader: &mut impl BufRead) -> Result<Option<String>, Reason> {
    let mut bytes = Vec::new();
    let count = reader.by_ref().take(LINE_LIMIT).read_until(b'\n', &mut bytes)?;
    if count as u64 == LINE_LIMIT {
        return Err(content("lines of at most 65536 bytes", "a longer one"));
    }
    let text = String::from_utf8_lossy(&bytes).trim().to_owned();
    Ok((count > 0).then_some(text))
}

fn number(word: Option<&str>, of: &str) -> Result<f64, Reason> {
    let parsed = word.and_then(|word| word.parse().ok());
    parsed.ok_or_else(|| content(&format!("a number in '{of}'"), word.unwrap_or("nothing")))
}

fn point<'a>(words: &mut impl Iterator<Item = &'a str>, of: &str) -> Result<DVec3, Reason> {
    Ok(DVec3::new(number(words.next(), of)?, number(words.next(), of)?, number(words.next(), of)?))
}

fn read_obj(reader: &mut impl BufRead) -> Result<RawMesh, Reason> {
    let mut mesh = RawMesh::default();
    while let Some(text) = line(reader)? {
        let mut words = text.split_whitespace();
        match words.next() {
            Some("v") => drop(mesh.add_vertex(point(&mut words, &text)?)?),
            Some("f") => {
                let vertices = narrow::<i64>(mesh.vertices.len());
                let corner = |word: &str| {
                    // A corner is position/texture/normal; only the position is read. Indices begin at 1; negative ones
                    // count from the end.
                    let place = word.split('/').next().unwrap_or_default();
                    let written: i64 = place.parse().map_err(|_| content("the number of a vertex", place))?;
                    let index = if written < 0 { vertices + written } else { written - 1 };
                    u32::try_from(index).map_err(|_| content("the number of a vertex", written))
                };
                let corners = words.map(corner).collect::<Result<Vec<u32>, Reason>>()?;
                mesh.add_face(&corners)?;
            }
            _ => {}
        }
    }
    Ok(mesh)
}

fn read_stl(reader: &mut impl BufRead, length: u64) -> Result<RawMesh, Reason> {
    let mut title = [0; STL_BYTES[0]];
    let is_long = length >= STL_BYTES[0] as u64;
    let begins = reader.fill_buf()?.starts_with(b"solid");
    let mut mesh = RawMesh::default();
    if is_long && (!begins || has_counted_length(reader, length)?) {
        reader.read_exact(&mut title)?;
        let count = u32::from_le_bytes([title[80], title[81], title[82], title[83]]);
        if length != stl_length(count) {
            return Err(content(&format!("{count} triangles of 50 bytes after 84 bytes"), format!("{length} bytes")));
        }
        let mut triangle = [0; STL_BYTES[1]];
        for _ in 0..count {
            reader.read_exact(&mut triangle)?;
            let value = |i: usize| f64::from(f32::from_le_bytes(std::array::from_fn(|byte| triangle[4 * i + byte])));
            let mut corners = [0; 3];
            for (c, corner) in corners.iter_mut().enumerate() {
                *corner = mesh.add_vertex(DVec3::new(value(3 * c + 3), value(3 * c + 4), value(3 * c + 5)))?;
            }
            mesh.add_face(&corners)?;
        }
        return Ok(mesh);
    }
    let mut corners = Vec::new();
    while let Some(text) = line(reader)? {
        let mut words = text.split_whitespace();
        match words.next() {
            Some("vertex") if corners.len() < CORNER_LIMIT => {
                corners.push(mesh.add_vertex(point(&mut words, &text)?)?);
            }
            Some("vertex") => return Err(content("at most 4096 corners of a facet", "more")),
            Some("endfacet") => {
                mesh.add_face(&corners)?;
                corners.clear();
            }
            _ => {}
        }
    }
    Ok(mesh)
}

/// Whether a file that begins with "solid", as text files do, has the length of a binary STL file.
fn has_counted_length(reader: &mut impl BufRead, length: u64) -> Result<bool, Reason> {
    let begin = reader.fill_buf()?;
    let count = begin.get(80..84).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    Ok(count.is_some_and(|count| length == stl_length(count)))
}

/// Bytes of a binary STL file with this number of triangles.
fn stl_length(triangles: u32) -> u64 {
    STL_BYTES[0] as u64 + STL_BYTES[1] as u64 * u64::from(triangles)
}

/// Number format of a PLY file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Encoding {
    Text,
    Little,
    Big,
}

/// Number types of PLY files.
#[derive(Debug, Clone, Copy)]
enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

struct Property {
    name: String,
    /// For lists, the type of the length.
    list: Option<Scalar>,
    scalar: Scalar,
}

struct Element {
    name: String,
    count: u64,
    properties: Vec<Property>,
}

impl Scalar {
    fn parse(word: Option<&str>) -> Result<Self, Reason> {
        Ok(match word {
            Some("char" | "int8") => Self::I8,
            Some("uchar" | "uint8") => Self::U8,
            Some("short" | "int16") => Self::I16,
            Some("ushort" | "uint16") => Self::U16,
            Some("int" | "int32") => Self::I32,
            Some("uint" | "uint32") => Self::U32,
            Some("float" | "float32") => Self::F32,
            Some("double" | "float64") => Self::F64,
            other => return Err(content("a type of PLY such as float or uchar", other.unwrap_or("nothing"))),
        })
    }

    fn read(self, reader: &mut impl Read, is_little: bool) -> io::Result<f64> {
        let mut bytes = [0; 8];
        let size = match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        };
        reader.read_exact(&mut bytes[..size])?;
        if !is_little {
            bytes[..size].reverse();
        }
        let [a, b, c, d, ..] = bytes;
        Ok(match self {
            Self::I8 => f64::from(i8::from_le_bytes([a])),
            Self::U8 => f64::from(a),
            Self::I16 => f64::from(i16::from_le_bytes([a, b])),
            Self::U16 => f64::from(u16::from_le_bytes([a, b])),
            Self::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
            Self::U32 => f64::from(u32::from_le_bytes([a, b, c, d])),
            Self::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
            Self::F64 => f64::from_le_bytes(bytes),
        })
    }
}

/// Reads the numbers of a PLY file one after the other.
struct NumberReader<'a, R> {
    reader: &'a mut R,
    written: Encoding,
    /// Unread words of the current line, the next one last.
    words: Vec<String>,
}

impl<R: BufRead> NumberReader<'_, R> {
    fn next(&mut self, scalar: Scalar) -> Result<f64, Reason> {
        if self.written != Encoding::Text {
            return Ok(scalar.read(self.reader, self.written == Encoding::Little)?);
        }
        while self.words.is_empty() {
            let text = line(self.reader)?.ok_or_else(|| content("more numbers", "the end of the file"))?;
            self.words = text.split_whitespace().rev().map(str::to_owned).collect();
        }
        let word = self.words.pop();
        number(word.as_deref(), "the file")
    }

    fn list(&mut self, count: Scalar, scalar: Scalar) -> Result<Vec<f64>, Reason> {
        let count = self.next(count)?;
        if !(0.0..=CORNER_LIMIT as f64).contains(&count) {
            return Err(content("lists of at most 4096 numbers", count));
        }
        (0..whole::<usize>(count)).map(|_| self.next(scalar)).collect()
    }
}

fn read_ply(reader: &mut impl BufRead) -> Result<RawMesh, Reason> {
    let (written, elements) = ply_header(reader)?;
    let mut numbers = NumberReader { reader, written, words: Vec::new() };
    let mut mesh = RawMesh::default();
    for element in elements {
        for _ in 0..element.count {
            let mut vertex = DVec3::NAN;
            let mut corners = None;
            for Property { name, list, scalar } in &element.properties {
                match list {
                    Some(count) => {
                        let list = numbers.list(*count, *scalar)?;
                        if name.starts_with("vertex_ind") {
                            corners = Some(list);
                        }
                    }
                    None => {
                        let value = numbers.next(*scalar)?;
                        if let Some(axis) = ["x", "y", "z"].iter().position(|axis| axis == name) {
                            vertex[axis] = value;
                        }
                    }
                }
            }
            match (&element.name[..], corners) {
                ("vertex", _) => drop(mesh.add_vertex(vertex)?),
                ("face", Some(corners)) => {
                    let index = |&c: &f64| {
                        let is_index = (0.0..=f64::from(u32::MAX)).contains(&c);
                        if is_index { Ok(whole::<u32>(c)) } else { Err(content("the number of a vertex", c)) }
                    };
                    mesh.add_face(&corners.iter().map(index).collect::<Result<Vec<u32>, Reason>>()?)?;
                }
                ("face", None) => return Err(content("faces with vertex_indices", "faces without")),
                _ => {}
            }
        }
    }
    Ok(mesh)
}

fn ply_header(reader: &mut impl BufRead) -> Result<(Encoding, Vec<Element>), Reason> {
    let mut written = None;
    let mut elements: Vec<Element> = Vec::new();
    let first = line(reader)?.unwrap_or_default();
    if first != "ply" {
        return Err(content(
            "a file that begins with 'ply'",
            format!("'{}'", first.chars().take(20).collect::<String>()),
        ));
    }
    for lines in 0.. {
        let text = line(reader)?.filter(|_| lines < HEADER_LIMIT);
        let text = text.ok_or_else(|| content("'end_header' within 1024 lines", "none"))?;
        let mut words = text.split_whitespace();
        match (words.next(), words.next()) {
            (Some("end_header"), _) => break,
            (Some("format"), Some("ascii")) => written = Some(Encoding::Text),
            (Some("format"), Some("binary_little_endian")) => written = Some(Encoding::Little),
            (Some("format"), Some("binary_big_endian")) => written = Some(Encoding::Big),
            (Some("element"), Some(name)) => {
                let count = words.next().and_then(|count| count.parse().ok());
                let count = count.ok_or_else(|| content("how many there are", &text))?;
                elements.push(Element { name: name.into(), count, properties: Vec::new() });
            }
            (Some("property"), Some(kind)) => {
                let list = (kind == "list").then(|| Scalar::parse(words.next())).transpose()?;
                let scalar = Scalar::parse(if list.is_some() { words.next() } else { Some(kind) })?;
                let name = words.next().unwrap_or_default().to_owned();
                let element = elements.last_mut().ok_or_else(|| content("an element before its properties", &text))?;
                element.properties.push(Property { name, list, scalar });
            }
            _ => {}
        }
    }
    // An element without properties takes no bytes, so that a false count would cause an endless loop.
    elements.retain(|element| !element.properties.is_empty());
    let written = written.ok_or_else(|| content("a format: ascii or binary", "none"))?;
    Ok((written, elements))
}

#[cfg(test)]
mod tests;
