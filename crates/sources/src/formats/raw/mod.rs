//! Headerless volumes: packed voxels, x fastest, after an optional header of known length.
//!
//! Such a file does not describe itself, so its length must match the options to the byte. A wrong dim or type is the
//! most common mistake and would give a picture of noise.

pub(crate) mod options;

use std::fs::File;
use std::path::Path;

use supervol_format::{ByteSource, Dims, VoxelBox, VoxelType};

pub use self::options::RawOptions;
use crate::formats::format::{Certainty, Folder, Format, Found};
use crate::grid::dense::{GridFile, GridLayout, GridSource, checked_bytes};
use crate::input::file::SourceFile;
use crate::{Message, ReadOption, SourceError, SourceInfo, VolumeSource};

/// Row of the table of formats: a file is raw if the options describe its voxels.
pub const FORMAT: Format = Format {
    name: "raw",
    title: "",
    endings: &[],
    choices: &[],
    sniff: |_, options| options.raw.is_some(),
    certainty: Certainty::Certain,
    folder: Folder::Never,
    open: |path, options| {
        let raw = options.raw.as_ref().expect("files are raw only by their options");
        options.selection.refuse_all(path)?;
        Ok(Box::new(RawSource::open(path, raw)?))
    },
    found: |_| Found::Volume,
};

/// A raw file.
#[derive(Debug)]
pub struct RawSource(GridSource);

impl RawSource {
    /// Opens a raw file.
    ///
    /// # Errors
    /// If the options are impossible, the file cannot be opened, or its length is not exactly the one that the options
    /// imply.
    pub fn open(path: &Path, options: &RawOptions) -> Result<Self, SourceError> {
        let RawOptions { dims, voxel_type, header_bytes, .. } = *options;
        let bytes = checked_bytes(path, dims, voxel_type).map_err(|e| SourceError::options(e.message()))?;
        if let Some(defect) = options.geometry.defect() {
            return Err(SourceError::options(format!("{}: {defect}", path.display())));
        }
        let source_file = SourceFile::of(path)?;
        let file = File::open(path).map_err(|e| SourceError::io(path, e))?;
        let found = file.len().map_err(|e| SourceError::io(path, e))?;
        if header_bytes.checked_add(bytes) != Some(found) {
            return Err(wrong_length(path, options, bytes, found));
        }
        let layout = GridLayout { dims, voxel_type, endian: options.endian, fastest_first: GridLayout::X_FASTEST };
        let grid = GridFile::single(path, file, header_bytes, layout)?;
        let mut info = SourceInfo::plain("raw", dims, voxel_type);
        info.geometry = options.geometry;
        info.nodata = options.nodata;
        info.reading = options.describe();
        info.files = vec![source_file];
        Ok(Self(GridSource::new(info, grid)))
    }
}

impl VolumeSource for RawSource {
    fn info(&self) -> &SourceInfo {
        self.0.info()
    }

    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        self.0.read_box(voxels, out)
    }
}

/// Error that states the expected and the found length, and which offset, dims or type would fit.
fn wrong_length(path: &Path, options: &RawOptions, bytes: u64, found: u64) -> SourceError {
    let RawOptions { dims, voxel_type, header_bytes, .. } = *options;
    let mut fitting = Vec::new();
    if found > bytes {
        let header = Message::from("with these dims and a header in front, ").option(ReadOption::HeaderBytes);
        fitting.push(header.text(format_args!(" {} fits", found - bytes)));
    }
    let layer_bytes = dims.0[0] * dims.0[1] * voxel_type.bytes() as u64;
    let data_bytes = found.saturating_sub(header_bytes);
    let layers = data_bytes / layer_bytes;
    if layers > 0 && data_bytes.is_multiple_of(layer_bytes) {
        let [nx, ny, _] = dims.0;
        fitting.push(Message::from(ReadOption::Dims).text(format_args!(" {nx},{ny},{layers} fits")));
    }
    fitting.extend(fitting_types(dims, data_bytes));
    let joined = fitting.into_iter().reduce(|first, next| first.text("; ").message(next));
    let advice = joined.unwrap_or_else(|| {
        let shape = Message::from("check ").option(ReadOption::Dims).text(", ").option(ReadOption::VoxelType);
        shape.text(" and ").option(ReadOption::HeaderBytes)
    });
    SourceError::RawLength {
        path: path.into(),
        dims,
        voxel_type,
        header_bytes,
        voxel_bytes: bytes,
        found_bytes: found,
        advice,
    }
}

/// The types with which these dims would fill the file exactly.
fn fitting_types(dims: Dims, data_bytes: u64) -> Option<Message> {
    let fits = |t: &VoxelType| dims.bytes(*t) == Some(data_bytes);
    let names: Vec<&str> = VoxelType::ALL.iter().filter(|t| fits(t)).map(|t| t.name()).collect();
    let message = || Message::from(ReadOption::VoxelType).text(format_args!(" {} fits", names.join(" or ")));
    (!names.is_empty()).then(message)
}
