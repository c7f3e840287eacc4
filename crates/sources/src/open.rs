//! Which reader a file or a folder needs: by what its first bytes say, then by its name.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use super::{SourceError, VolumeSource};
use crate::formats::bigdataviewer::ViewerXmlSource;
use crate::formats::dicom::{DicomSource, is_dicom};
use crate::formats::metaimage::MetaImageSource;
use crate::formats::nifti::NiftiSource;
use crate::formats::npy::NpySource;
use crate::formats::npz::NpzSource;
use crate::formats::nrrd::NrrdSource;
use crate::formats::pictures::{Kind, PicturesSource};
use crate::formats::raw::{RawOptions, RawSource};
use crate::formats::segy::SegyOptions;
use crate::formats::tiff::TiffSource;
use crate::formats::unsupported::{ENVI_START, HEAD_BYTES, refusal_of_file, refusal_of_folder, refusal_of_member};
use crate::formats::vtk::VtkSource;
use crate::formats::{bigdataviewer, hdf5, segy, zarr};
use crate::input::data_files::Outside;
use crate::input::file::SourceFile;
use crate::input::folder::{FolderOptions, Listing};
use crate::input::selection::Selection;
use crate::input::spool::SpoolFolder;

/// Files of a folder that are looked into, to tell what it is.
const FILES_LOOKED_AT: usize = 64;

/// How names of SEG-Y files end.
const SEGY_NAMES: [&str; 4] = [".sgy", ".segy", ".seg-y", ".seg"];

/// How text headers of SEG-Y begin: C 1 and C01, in EBCDIC and in ASCII.
const TEXT_HEADERS: [&[u8]; 4] = [b"C 1", b"C01", b"\xc3\x40\xf1", b"\xc3\xf0\xf1"];

/// What a person may say about a file beside its name.
#[derive(Debug, Clone, Default)]
pub struct OpenOptions {
    /// Shape of a headerless file; its presence makes the file raw.
    pub raw: Option<RawOptions>,
    /// For headers that name data files (NRRD, MetaImage), and for folders with links.
    pub outside: Outside,
    /// For SEG-Y; its memory is what every other reader may take, too.
    pub segy: SegyOptions,
    /// Where compressed or textual voxels are decoded to.
    pub spool: SpoolFolder,
    /// Which volume of several.
    pub selection: Selection,
}

/// Opens a volume file of any format we read, or a folder that is a volume; `FILE:/NAME` is an array of a file with several.
///
/// # Errors
/// If no reader knows the file, or the reader refuses it.
pub fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn VolumeSource>, SourceError> {
    let (path, array) = split_array(path);
    let mut options = options.clone();
    options.selection.array = array.or(options.selection.array);
    if path.is_dir() {
        return open_folder(&path, &options);
    }
    // Before anything is opened: a FIFO would keep us waiting.
    SourceFile::of(&path)?;
    open_file(&path, &options)
}

/// The file, and the name of an array in it where that follows behind `:/`.
#[must_use]
pub fn split_array(path: &Path) -> (PathBuf, Option<String>) {
    let whole = || (path.to_path_buf(), None);
    if path.exists() {
        return whole();
    }
    let Some((file, array)) = path.to_str().and_then(|text| text.split_once(":/")) else { return whole() };
    (file.into(), Some(array.into()))
}

fn open_folder(path: &Path, options: &OpenOptions) -> Result<Box<dyn VolumeSource>, SourceError> {
    if zarr::is_zarr(path) {
        return Ok(Box::new(zarr::open(path, &options.of_folders())?));
    }
    options.selection.level_of(path, 1)?;
    if let Some(refusal) = refusal_of_folder(path) {
        return Err(refusal);
    }
    let listing = Listing::of(path, true, options.outside)?;
    let mut has_pictures = false;
    for file in listing.files.iter().take(FILES_LOOKED_AT) {
        let head = head(file)?;
        if is_dicom(&head) {
            return open_dicom(path, options);
        }
        has_pictures |= Kind::of(&head).is_some();
    }
    if has_pictures {
        return open_pictures(path, options);
    }
    let lines: Vec<PathBuf> = listing.files.iter().filter(|file| is_segy(file)).cloned().collect();
    if !lines.is_empty() {
        options.selection.refuse_all(path)?;
        return segy::open(&lines, Some(path), &options.segy);
    }
    let count = listing.files.len();
    if count == 0 {
        // The wrong folder: nothing in it could be wrong.
        let expected = "expected a file, found a folder without files, of which slices could be read";
        return Err(SourceError::Options(format!("{}: {expected}", path.display())));
    }
    let what = format!("this is a folder of {count} files that are neither DICOM, pictures nor SEG-Y");
    Err(SourceError::unsupported(path, what, "expected the slices of one volume, or give a file"))
}

fn is_segy(path: &Path) -> bool {
    let name = path.file_name().map(|name| name.to_string_lossy().to_lowercase()).unwrap_or_default();
    SEGY_NAMES.iter().any(|end| name.ends_with(end))
}

fn open_dicom(path: &Path, options: &OpenOptions) -> Result<Box<dyn VolumeSource>, SourceError> {
    Ok(Box::new(DicomSource::open(path, &options.of_folders())?))
}

fn open_pictures(path: &Path, options: &OpenOptions) -> Result<Box<dyn VolumeSource>, SourceError> {
    options.selection.refuse_series(path)?;
    Ok(Box::new(PicturesSource::open(path, &options.of_folders())?))
}

impl OpenOptions {
    /// Those for folders of slices.
    fn of_folders(&self) -> FolderOptions<'_> {
        let Self { selection, outside, spool, segy, .. } = self;
        FolderOptions { selection, outside: *outside, spool, memory_bytes: segy.memory_bytes }
    }
}

fn find(bytes: &[u8], wanted: &[u8]) -> bool {
    bytes.windows(wanted.len()).any(|window| window == wanted)
}

/// The first bytes of a file.
pub(super) fn head(path: &Path) -> Result<Vec<u8>, SourceError> {
    let mut head = Vec::new();
    let file = File::open(path).map_err(|e| SourceError::io(path, e))?;
    file.take(HEAD_BYTES).read_to_end(&mut head).map_err(|e| SourceError::io(path, e))?;
    Ok(head)
}

/// Formats of single files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Format {
    Dicom,
    Vtk,
    Npz,
    ViewerXml,
    Hdf5,
    Nrrd,
    MetaImage,
    Npy,
    Nifti,
    Tiff,
    Picture,
    Segy,
}

/// The format of a file of this lower-case name that begins like this.
fn format_of(start: &[u8], name: &str) -> Option<Format> {
    let named = |endings: &[&str]| endings.iter().any(|e| name.ends_with(e));
    // Before the mark of DICOM there is room for a TIFF's beginning, and some programs write one.
    if is_dicom(start) || named(&[".dcm", ".dicom", ".ima"]) {
        return Some(Format::Dicom);
    }
    let is_xml = start.trim_ascii_start().starts_with(b"<?xml") || start.trim_ascii_start().starts_with(b"<VTKFile");
    if start.starts_with(b"# vtk DataFile") || named(&[".vti"]) || is_xml && find(start, b"<VTKFile") {
        return Some(Format::Vtk);
    }
    if is_xml && find(start, bigdataviewer::START) || start.starts_with(bigdataviewer::START) {
        return Some(Format::ViewerXml);
    }
    if named(&[".npz"]) {
        return Some(Format::Npz);
    }
    if start.starts_with(hdf5::MAGIC) || named(&[".h5", ".hdf5", ".ims"]) {
        return Some(Format::Hdf5);
    }
    if start.starts_with(b"NRRD") || named(&[".nrrd", ".nhdr"]) {
        return Some(Format::Nrrd);
    }
    if start.starts_with(b"ObjectType") || start.starts_with(b"NDims") || named(&[".mha", ".mhd"]) {
        return Some(Format::MetaImage);
    }
    if start.starts_with(b"\x93NUM") || named(&[".npy"]) {
        return Some(Format::Npy);
    }
    // A NIfTI header begins with its own size in either byte order.
    let nifti_sizes = [348i32, 540].map(|n| [n.to_le_bytes(), n.to_be_bytes()]);
    if nifti_sizes.as_flattened().iter().any(|size| start.starts_with(size))
        || named(&[".nii", ".nii.gz", ".hdr", ".hdr.gz", ".img", ".img.gz"]) && !start.starts_with(ENVI_START)
    {
        return Some(Format::Nifti);
    }
    match Kind::of(start) {
        Some(Kind::Tiff) => return Some(Format::Tiff),
        Some(Kind::Png | Kind::Jpeg) => return Some(Format::Picture),
        None => {}
    }
    // The text header of SEG-Y begins with the letter C: in EBCDIC (0xC3), or in ASCII.
    let is_segy = named(&SEGY_NAMES) || start.first().is_some_and(|b| [0xc3, b'C'].contains(b));
    is_segy.then_some(Format::Segy)
}

/// What a file is to somebody who looks for volumes in a folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Found {
    /// A slice of a series, which its folder stands for.
    DicomSlice,
    /// A PNG or JPEG: a slice where there is nothing else, else a picture of something.
    Picture,
    /// A file that a reader takes.
    Volume,
    /// Nothing that a reader takes.
    Other,
}

/// What a file is, by its first bytes and its name. More is not looked at: a damaged volume is one, too.
pub fn look_at(path: &Path) -> Result<Found, SourceError> {
    let start = head(path)?;
    let name = lower_name(path);
    Ok(match format_of(&start, &name) {
        Some(Format::Dicom) => Found::DicomSlice,
        Some(Format::Picture) => Found::Picture,
        // Any text may begin with a C.
        Some(Format::Segy) if !is_segy(path) && !TEXT_HEADERS.iter().any(|text| start.starts_with(text)) => {
            Found::Other
        }
        Some(Format::Segy) if refusal_of_file(path, &start, &name).is_some() => Found::Other,
        Some(_) => Found::Volume,
        None if is_zip_of_zarr(path, &start) => Found::Volume,
        None => Found::Other,
    })
}

fn is_zip_of_zarr(path: &Path, start: &[u8]) -> bool {
    start.starts_with(b"PK\x03\x04") && zarr::is_zarr_archive(path)
}

/// Whether a folder is a Zarr or N5.
pub fn is_chunked(folder: &Path) -> bool {
    zarr::is_zarr(folder)
}

fn lower_name(path: &Path) -> String {
    path.file_name().map(|n| n.to_string_lossy().to_lowercase()).unwrap_or_default()
}

fn open_file(path: &Path, options: &OpenOptions) -> Result<Box<dyn VolumeSource>, SourceError> {
    let OpenOptions { raw, outside, segy: segy_options, spool, selection } = options;
    if let Some(raw) = raw {
        selection.level_of(path, 1)?;
        selection.refuse_all(path)?;
        return Ok(Box::new(RawSource::open(path, raw)?));
    }
    let start = head(path)?;
    let name = lower_name(path);
    let format = format_of(&start, &name);
    if format == Some(Format::ViewerXml) {
        return Ok(Box::new(ViewerXmlSource::open(path, &options.of_folders())?));
    }
    if format.is_none() && is_zip_of_zarr(path, &start) {
        return Ok(Box::new(zarr::open(path, &options.of_folders())?));
    }
    selection.level_of(path, 1)?;
    if !matches!(format, Some(Format::Dicom | Format::Tiff)) {
        selection.refuse_series(path)?;
    }
    if !matches!(format, Some(Format::Dicom | Format::Vtk | Format::Npz | Format::Hdf5)) {
        selection.refuse_array(path)?;
    }
    match format {
        Some(Format::Dicom) => return open_dicom(path, options),
        Some(Format::Vtk) => return Ok(Box::new(VtkSource::open(path, spool, selection)?)),
        Some(Format::Npz) => return Ok(Box::new(NpzSource::open(path, spool, selection)?)),
        Some(Format::Hdf5) => return Ok(Box::new(hdf5::open(path, &options.of_folders())?)),
        Some(Format::Nrrd) => return Ok(Box::new(NrrdSource::open_with(path, spool, *outside, selection)?)),
        Some(Format::MetaImage) => return Ok(Box::new(MetaImageSource::open_with(path, spool, *outside, selection)?)),
        Some(Format::Npy) => return Ok(Box::new(NpySource::open_with(path, selection)?)),
        Some(Format::Nifti) => return Ok(Box::new(NiftiSource::open_with(path, spool, selection)?)),
        Some(Format::Tiff) => return Ok(Box::new(TiffSource::open(path, spool, selection)?)),
        Some(Format::Picture) => return open_pictures(path, options),
        Some(Format::ViewerXml | Format::Segy) | None => {}
    }
    if let Some(refusal) = refusal_of_file(path, &start, &name).or_else(|| refusal_of_member(path)) {
        return Err(refusal);
    }
    selection.refuse_all(path)?;
    if format == Some(Format::Segy) {
        return segy::open(&[path.into()], None, segy_options);
    }
    Err(SourceError::unsupported(
        path,
        "neither its first bytes nor its name are those of a format we read",
        "expected SEG-Y, DICOM, NRRD, NIfTI, MetaImage, VTK, TIFF, PNG, JPEG, HDF5, npy, npz, a folder of Zarr, N5 or slices, or a \
         headerless file together with --dims and --dtype",
    ))
}
