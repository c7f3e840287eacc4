//! Which reader a file needs: by what its first bytes say, then by its name.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::data_files::Outside;
use super::file::SourceFile;
use super::metaimage::MetaImageSource;
use super::nifti::NiftiSource;
use super::npy::NpySource;
use super::nrrd::NrrdSource;
use super::others::{HEAD_BYTES, refusal_of_file, refusal_of_folder};
use super::raw::{RawOptions, RawSource};
use super::segy::{SegyOptions, SegySource};
use super::spool::SpoolFolder;
use super::tiff::TiffSource;
use super::{SourceError, VolumeSource};

/// Classic TIFF and BigTIFF, in either byte order.
const TIFF_STARTS: [&[u8]; 4] = [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"];

/// What a person may say about a file beside its name.
#[derive(Debug, Clone, Default)]
pub struct OpenOptions {
    /// Shape of a headerless file; its presence makes the file raw.
    pub raw: Option<RawOptions>,
    /// For headers that name data files: NRRD, MetaImage.
    pub outside: Outside,
    /// For SEG-Y.
    pub segy: SegyOptions,
    /// Where compressed or textual voxels are decoded to.
    pub spool: SpoolFolder,
}

/// Opens a volume file of any format we read.
///
/// # Errors
/// If no reader knows the file, or the reader refuses it.
pub fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn VolumeSource>, SourceError> {
    if let Some(refusal) = refusal_of_folder(path) {
        return Err(refusal);
    }
    // Before anything is opened: a FIFO would keep us waiting.
    SourceFile::of(path)?;
    if let Some(raw) = &options.raw {
        return Ok(Box::new(RawSource::open(path, raw)?));
    }
    let mut start = Vec::new();
    let file = File::open(path).map_err(|e| SourceError::io(path, e))?;
    file.take(HEAD_BYTES).read_to_end(&mut start).map_err(|e| SourceError::io(path, e))?;
    let name = path.file_name().map(|n| n.to_string_lossy().to_lowercase()).unwrap_or_default();
    let named = |endings: &[&str]| endings.iter().any(|e| name.ends_with(e));

    if start.starts_with(b"NRRD") || named(&[".nrrd", ".nhdr"]) {
        return Ok(Box::new(NrrdSource::open_with(path, &options.spool, options.outside)?));
    }
    if start.starts_with(b"ObjectType") || start.starts_with(b"NDims") || named(&[".mha", ".mhd"]) {
        return Ok(Box::new(MetaImageSource::open(path, &options.spool, options.outside)?));
    }
    if start.starts_with(b"\x93NUM") || named(&[".npy"]) {
        return Ok(Box::new(NpySource::open(path)?));
    }
    // A NIfTI header begins with its own size in either byte order.
    let nifti_sizes = [348i32, 540].map(|n| [n.to_le_bytes(), n.to_be_bytes()]);
    if nifti_sizes.as_flattened().iter().any(|size| start.starts_with(size))
        || named(&[".nii", ".nii.gz", ".hdr", ".hdr.gz", ".img", ".img.gz"])
    {
        return Ok(Box::new(NiftiSource::open(path, &options.spool)?));
    }
    // Before the mark of DICOM there is room for a TIFF's beginning, and some programs write one.
    let is_dicom = start.get(128..132) == Some(b"DICM");
    if !is_dicom && TIFF_STARTS.iter().any(|magic| start.starts_with(magic)) {
        return Ok(Box::new(TiffSource::open(path, &options.spool)?));
    }
    if let Some(refusal) = refusal_of_file(path, &start, &name) {
        return Err(refusal);
    }
    // The text header of SEG-Y begins with the letter C: in EBCDIC (0xC3), or in ASCII.
    if named(&[".sgy", ".segy", ".seg-y", ".seg"]) || start.first().is_some_and(|b| [0xc3, b'C'].contains(b)) {
        return Ok(Box::new(SegySource::open(path, &options.segy)?));
    }
    Err(SourceError::unsupported(
        path,
        "neither its first bytes nor its name are those of a format we read",
        "expected SEG-Y, NRRD, NIfTI, MetaImage, TIFF, npy, or a headerless file together with --dims and --dtype",
    ))
}
