//! Record of a picture: what it shows, of which container, and how exact it states to be. Picture files carry it, so that
//! others can draw the picture again and prove it ([`super::accuracy::proof`]).
//!
//! A record is one JSON object in ASCII. It holds no date, folder or host name: the same command gives the same bytes. It
//! names files (the container, meshes of the scene) without their folders, each with a checksum.
//!
//! Records are read from untrusted files: [`PictureRecord::from_json`] checks every number that others compute with.

use std::path::Path;

use serde::{Deserialize, Serialize};
use supervol_format::container::checksum;
use supervol_format::{Container, Geometry, Lod};
use supervol_scene::facts::VolumeFacts;
use supervol_scene::image::{GREY_LEVELS, Image, ImageFormat};
use supervol_scene::scene::{Scene, SceneError};

use crate::render::accuracy::stated::ErrorStated;
use crate::render::options::{LevelChoice, RenderOptions};
use crate::render::stats::FrameStats;
use crate::stream::state::Failure;

/// Version of records that this program writes. Later minor additions keep the number: unknown keys are ignored.
pub const RECORD_VERSION: u32 = 1;
/// Most failures of bricks that a record lists; all are counted.
const FAILURES_LISTED: usize = 4;
/// Longest file of a scene whose checksum is recorded, bytes.
const FILE_LIMIT_BYTES: u64 = 1 << 30;

/// A finished drawing, from which its record and its fidelity follow.
#[derive(Debug, Clone, Copy)]
pub struct Drawn<'a> {
    /// The container at the place where it was drawn.
    pub container: &'a Container,
    /// Facts of the volume at that place.
    pub facts: &'a VolumeFacts,
    /// The complete scene.
    pub scene: &'a Scene,
    /// Options of the frame.
    pub options: &'a RenderOptions,
    /// Statistics of the frame.
    pub stats: &'a FrameStats,
    /// Origin of the engine.
    pub engine: DrawnBy,
}

/// Origin of the engine that drew a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DrawnBy {
    /// An engine of this library, chosen by the options.
    Supervol,
    /// An engine of the calling program.
    Caller,
}

/// Record of a picture; see the module.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PictureRecord {
    /// [`RECORD_VERSION`].
    pub record_version: u32,
    /// Name and version of the program that drew the picture.
    pub program: String,
    /// The pixels in the file; `None` before the picture is written.
    pub pixels: Option<PixelsRecord>,
    /// The container.
    pub container: ContainerRecord,
    /// The complete scene, which draws the same picture again. Meshes are named without folders.
    pub scene: Scene,
    /// Files that the scene names.
    pub files: Vec<FileRecord>,
    /// Engine: `cpu`, `gpu`, `reference`.
    pub backend: String,
    /// Whether the engine is one that aims at the requested error; false for methods of comparison.
    pub aims_at_error: bool,
    /// The requested level; null if levels were chosen brick by brick.
    pub level: Option<u8>,
    /// Levels of the bricks that rays drew, finest first.
    pub levels_drawn: Vec<u8>,
    /// Requested error, grey levels of 255: against the exact picture of `level`, or of level 0.
    pub requested_grey_levels: f64,
    /// Stated error against the exact picture of level 0; null if it was not asked for.
    pub stated: Option<ErrorStated>,
    /// Whether every pixel is finished from the bricks that it wants, and no brick failed.
    pub converged: bool,
    /// Pixels that are taken from a picture of larger pixels.
    pub pixels_unfinished: u64,
    /// Bricks drawn from coarser levels without a bound of their effect on the picture.
    pub bricks_without_bound: u64,
    /// Bricks that could not be read or decoded.
    pub bricks_failed: u64,
    /// The first of them.
    pub failures: Vec<Failure>,
}

/// Pixels of a picture file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PixelsRecord {
    /// Pixels along x and y.
    pub size: [u32; 2],
    /// `png`, `exr` or `npy`.
    pub format: String,
    /// Checksum of the stored pixels, 16 hexadecimal digits ([`Image::stored_checksum`]).
    ///
    /// [`Image::stored_checksum`]: supervol_scene::image::Image::stored_checksum
    pub xxh3_64: String,
    /// Pixels under decorations, which prove nothing: lengths of runs in row order, in turn without and with
    /// decorations. Empty: no decorations.
    pub decorated_runs: Vec<u64>,
}

/// The container that a picture shows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ContainerRecord {
    /// File name without its folder.
    pub name: String,
    /// Length of the file.
    pub bytes: u64,
    /// Checksum of its content, 16 hexadecimal digits ([`Container::identity`]); null if it could not be read.
    pub xxh3_64: Option<String>,
    /// Part of the container that the checksum covers: `content` or `description`.
    pub covers: String,
    /// Voxels of level 0 along x, y and z.
    pub dims: [u64; 3],
    /// Place in the world where it is drawn.
    pub geometry: Geometry,
    /// Kind of data.
    pub kind: String,
    /// Name of the file that the container was built from.
    pub source: String,
}

/// A file that a scene names.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileRecord {
    /// Name as in the recorded scene, without folder.
    pub name: String,
    /// XXH3-64 of the file, 16 hexadecimal digits; null if it could not be read.
    pub xxh3_64: Option<String>,
}

/// Reason why a record is not used.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum RecordError {
    #[error("its record is not the JSON of a picture's record: {0}")]
    Json(#[from] serde_json::Error),
    #[error("its record has version {found}; this program reads version {RECORD_VERSION}. Use a newer supervol")]
    Version { found: u64 },
    #[error("its record, {key}: expected {expected}, found {found}")]
    Value { key: &'static str, expected: &'static str, found: String },
    #[error("the scene of its record: {0}")]
    Scene(#[from] SceneError),
}

impl PictureRecord {
    /// The record of a picture, without its pixels.
    #[must_use]
    pub fn of(drawn: &Drawn<'_>) -> Self {
        let Drawn { scene, options, stats, .. } = *drawn;
        let (scene, files) = with_file_names(scene);
        let is_finite = |e: &ErrorStated| {
            [e.largest_grey_levels, e.mean_grey_levels, e.levels_grey_levels].iter().all(|v| v.is_finite())
        };
        let levels_drawn = match options.level {
            LevelChoice::Auto if stats.backend == "reference" => vec![Lod::FINEST.0],
            LevelChoice::Fixed(_) if stats.backend == "reference" => stats.level.into_iter().collect(),
            _ => stats.levels_drawn.clone(),
        };
        Self {
            record_version: RECORD_VERSION,
            program: concat!("supervol ", env!("CARGO_PKG_VERSION")).into(),
            pixels: None,
            container: ContainerRecord::of(drawn.container, drawn.facts),
            scene,
            files,
            backend: stats.backend.into(),
            aims_at_error: options.caster.is_default() && drawn.engine == DrawnBy::Supervol,
            level: stats.level,
            levels_drawn,
            requested_grey_levels: GREY_LEVELS * options.max_error,
            stated: stats.error_stated.filter(is_finite),
            converged: stats.converged,
            pixels_unfinished: stats.pixels_unfinished,
            bricks_without_bound: stats.bricks_without_bound,
            bricks_failed: stats.bricks_failed,
            failures: stats.failures.iter().take(FAILURES_LISTED).cloned().collect(),
        }
    }

    /// The same for a file of this format, whose pixels have this checksum.
    #[must_use]
    pub fn with_pixels(&self, format: ImageFormat, sum: u64, decorated_runs: Vec<u64>) -> Self {
        let size = [self.scene.image.width, self.scene.image.height];
        let pixels = PixelsRecord { size, format: format.ending().into(), xxh3_64: digits(sum), decorated_runs };
        Self { pixels: Some(pixels), ..self.clone() }
    }

    /// The text of the record in a file of this format, from the checksum of the stored pixels. `shown` is the picture
    /// with its decorations, `plain` the same without.
    pub fn text_in(&self, format: ImageFormat, plain: &Image, shown: &Image) -> impl Fn(u64) -> String {
        let is_plain = std::ptr::eq(plain, shown);
        let runs = if is_plain { Vec::new() } else { runs_of_differences(&plain.pixels, &shown.pixels) };
        move |sum| self.with_pixels(format, sum, runs.clone()).to_json()
    }

    /// The record as JSON in ASCII, on one line.
    #[must_use]
    pub fn to_json(&self) -> String {
        ascii(&serde_json::to_string(self).expect("a record is JSON: its keys are texts"))
    }

    /// Reads a record and checks it.
    ///
    /// # Errors
    /// If the text is no record, of a later version, or breaks a rule of its fields.
    pub fn from_json(text: &str) -> Result<Self, RecordError> {
        #[derive(Deserialize)]
        struct Version {
            record_version: u64,
        }
        let Version { record_version: found } = serde_json::from_str(text)?;
        if found != u64::from(RECORD_VERSION) {
            return Err(RecordError::Version { found });
        }
        let record: Self = serde_json::from_str(text)?;
        record.check()?;
        Ok(record)
    }

    fn check(&self) -> Result<(), RecordError> {
        let wrong = |key, expected, found: String| Err(RecordError::Value { key, expected, found });
        self.scene.validate()?;
        if let Some(defect) = self.container.geometry.defect() {
            return wrong("container.geometry", "a place in the world", defect);
        }
        let named = self.scene.files().filter_map(Path::to_str).chain(self.files.iter().map(|file| &*file.name));
        if let Some(path) = named.into_iter().find(|name| !is_file_name(name)) {
            return wrong("files", "file names without folders", path.into());
        }
        if !(self.requested_grey_levels.is_finite() && self.requested_grey_levels >= 0.0) {
            let found = self.requested_grey_levels.to_string();
            return wrong("requested_grey_levels", "a number from 0 on", found);
        }
        let Some(pixels) = &self.pixels else { return wrong("pixels", "the pixels of its file", "null".into()) };
        let size = [self.scene.image.width, self.scene.image.height];
        if pixels.size != size {
            return wrong("pixels.size", "the size of the scene's image", format!("{:?}, not {size:?}", pixels.size));
        }
        let covered = pixels.decorated_runs.iter().try_fold(0u64, |sum, &run| sum.checked_add(run));
        if covered.is_none_or(|covered| covered > u64::from(size[0]) * u64::from(size[1])) {
            return wrong("pixels.decorated_runs", "runs inside the picture", "longer ones".into());
        }
        Ok(())
    }
}

impl ContainerRecord {
    fn of(container: &Container, facts: &VolumeFacts) -> Self {
        let identity = container.identity().ok();
        Self {
            name: container.path().file_name().unwrap_or_default().to_string_lossy().into_owned(),
            bytes: container.file_bytes(),
            xxh3_64: identity.map(|identity| identity.digits()),
            covers: identity.map_or("nothing", |identity| identity.covers.name()).into(),
            dims: container.descriptor().dims().0,
            geometry: container.descriptor().geometry,
            kind: facts.kind.name().into(),
            source: container.manifest().source.name.clone(),
        }
    }
}

impl PixelsRecord {
    /// For each pixel in row order, whether decorations lie over it.
    #[must_use]
    pub fn decorated(&self) -> Vec<bool> {
        let pixels = self.size[0] as usize * self.size[1] as usize;
        let mut decorated = Vec::with_capacity(pixels);
        for (number, &run) in self.decorated_runs.iter().enumerate() {
            let end = decorated.len().saturating_add(usize::try_from(run).unwrap_or(usize::MAX)).min(pixels);
            decorated.resize(end, number % 2 == 1);
        }
        decorated.resize(pixels, false);
        decorated
    }
}

/// Runs of [`PixelsRecord::decorated_runs`]: pixels that differ between a picture and the same with decorations. Empty if
/// none differs.
fn runs_of_differences(plain: &[[f32; 4]], decorated: &[[f32; 4]]) -> Vec<u64> {
    let (mut runs, mut run, mut differs) = (Vec::new(), 0, false);
    for (plain, decorated) in plain.iter().zip(decorated) {
        let here = plain.map(f32::to_bits) != decorated.map(f32::to_bits);
        if here != differs {
            runs.push(std::mem::take(&mut run));
            differs = here;
        }
        run += 1;
    }
    if differs {
        runs.push(run);
    }
    runs
}

/// 16 hexadecimal digits of a checksum.
#[must_use]
pub fn digits(sum: u64) -> String {
    format!("{sum:016x}")
}

/// XXH3-64 of a file, 16 hexadecimal digits.
///
/// # Errors
/// If the file cannot be read, or is longer than any file of a scene.
pub fn file_digits(path: &Path) -> std::io::Result<String> {
    supervol_format::byte_source::check_is_file(path)?;
    if std::fs::metadata(path)?.len() > FILE_LIMIT_BYTES {
        let message = format!("expected a file of at most {FILE_LIMIT_BYTES} bytes");
        return Err(std::io::Error::new(std::io::ErrorKind::InvalidInput, message));
    }
    Ok(digits(checksum(&std::fs::read(path)?)))
}

/// Whether this is the name of a file, without any folder.
fn is_file_name(name: &str) -> bool {
    !name.is_empty() && !name.contains(['/', '\\', '\0']) && name != "." && name != ".."
}

/// The scene with files named without folders, and the checksums of these files. Different files with one name get a
/// number before it.
fn with_file_names(scene: &Scene) -> (Scene, Vec<FileRecord>) {
    let (mut scene, mut files) = (scene.clone(), Vec::<FileRecord>::new());
    for (number, mesh) in scene.clip.solids.iter_mut().filter_map(|solid| solid.mesh.as_mut()).enumerate() {
        let xxh3_64 = file_digits(mesh).ok();
        let name = mesh.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let is_taken = files.iter().any(|file| file.name == name && file.xxh3_64 != xxh3_64);
        let name = if is_taken || !is_file_name(&name) { format!("{number}-{name}") } else { name };
        *mesh = name.clone().into();
        if !files.iter().any(|file| file.name == name) {
            files.push(FileRecord { name, xxh3_64 });
        }
    }
    (scene, files)
}

/// JSON with all characters beyond ASCII written as escapes.
fn ascii(text: &str) -> String {
    let mut ascii = String::with_capacity(text.len());
    for character in text.chars() {
        if character.is_ascii() {
            ascii.push(character);
        } else {
            let mut units = [0; 2];
            character.encode_utf16(&mut units).iter().for_each(|unit| ascii.push_str(&format!("\\u{unit:04x}")));
        }
    }
    ascii
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A record of the default scene: converged, half a grey level requested, nothing stated.
    pub(crate) fn record() -> PictureRecord {
        PictureRecord::from_json(
            r#"{"record_version":1,"program":"supervol 0","pixels":{"size":[800,600],"format":"png","xxh3_64":"00","decorated_runs":[]},
            "container":{"name":"v.svol","bytes":9,"xxh3_64":"01","covers":"content","dims":[2,2,2],"geometry":{"spacing":[1,1,1],
            "origin":[0,0,0],"direction":[1,0,0,0,1,0,0,0,1]},"kind":"ct","source":"v.raw"},"scene":{},"files":[],"backend":"cpu",
            "aims_at_error":true,"level":null,"levels_drawn":[0],"requested_grey_levels":0.5,"stated":null,"converged":true,
            "pixels_unfinished":0,"bricks_without_bound":0,"bricks_failed":0,"failures":[],"later":"ignored"}"#,
        )
        .unwrap()
    }

    #[test]
    fn records_come_back_and_later_versions_and_lies_are_refused() {
        let record = record();
        assert_eq!(PictureRecord::from_json(&record.to_json()).unwrap(), record);
        let text = record.to_json();
        let refused = |from: &str, to: &str| {
            assert!(text.contains(from), "{from} is not in {text}");
            PictureRecord::from_json(&text.replace(from, to)).unwrap_err().to_string()
        };
        assert!(refused("\"record_version\":1", "\"record_version\":2").contains("newer supervol"));
        assert!(refused("\"size\":[800,600]", "\"size\":[800,601]").contains("pixels.size"));
        assert!(refused("\"spacing\":[1.0,", "\"spacing\":[-1.0,").contains("container.geometry"));
        assert!(refused("\"decorated_runs\":[]", "\"decorated_runs\":[480001]").contains("decorated_runs"));
        assert!(refused("\"requested_grey_levels\":0.5", "\"requested_grey_levels\":-0.5").contains("from 0 on"));
        assert!(refused("\"width\":800", "\"width\":0").contains("image.width"));
        assert!(refused("\"converged\":true", "\"converged\":1").contains("not the JSON"));
    }

    #[test]
    fn runs_name_the_pixels_under_decorations() {
        let plain = [[0.0f32; 4]; 12];
        let record = |runs: Vec<u64>| PixelsRecord {
            size: [4, 3],
            format: "png".into(),
            xxh3_64: digits(7),
            decorated_runs: runs,
        };
        for touched in [vec![], vec![0], vec![11], vec![3, 4, 5, 9], (0..12).collect::<Vec<_>>()] {
            let mut decorated = plain;
            touched.iter().for_each(|&i: &usize| decorated[i][1] = 0.5);
            let runs = runs_of_differences(&plain, &decorated);
            assert_eq!(runs.is_empty(), touched.is_empty());
            let found = record(runs).decorated();
            let found: Vec<usize> = (0..12).filter(|&i| found[i]).collect();
            assert_eq!((found.len(), &found), (touched.len(), &touched));
        }
        // Runs that lie are cut, not believed.
        assert_eq!(record(vec![10, u64::MAX, 3]).decorated().len(), 12);
    }

    #[test]
    fn only_names_without_folders_are_files_of_records() {
        assert!(is_file_name("bone.stl") && is_file_name("a b.obj"));
        assert!(["", ".", "..", "/etc/passwd", "../a", "a/b", "a\\b", "a\0"].iter().all(|name| !is_file_name(name)));
    }

    #[test]
    fn json_is_ascii_and_means_the_same() {
        let text = r#"{"name":"Zwölf 😀"}"#;
        let written = ascii(text);
        assert!(written.is_ascii());
        let [one, other] = [text, &written].map(|text| serde_json::from_str::<serde_json::Value>(text).unwrap());
        assert_eq!(one, other);
    }
}
