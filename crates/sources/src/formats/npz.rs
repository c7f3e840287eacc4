//! Archives of NumPy arrays (`.npz`): a ZIP file with one `.npy` file per array.
//!
//! Stored arrays (`numpy.savez`) are read in place. Compressed ones (`savez_compressed`) are inflated once into a spool
//! file, at most to the length that the archive states. `FILE.npz:/NAME` names one of several arrays; without a name
//! there must be only one. The crate `zip` opens the archive, [`super::npy`] the array.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

use supervol_format::{ByteSource, VoxelBox};
use zip::{CompressionMethod, ZipArchive};

use super::npy::{ArrayPart, NpySource};
use crate::error::Part;
use crate::formats::format::{Certainty, Folder, Format, Found};
use crate::formats::unsupported::refusal_of_zip;
use crate::input::data_files::open_data;
use crate::input::file::SourceFile;
use crate::input::selection::{Choice, Selection};
use crate::input::spool::{DEFLATE_RATIO_LIMIT, Spool, SpoolFolder};
use crate::input::text::shortened;
use crate::{SourceError, SourceInfo, VolumeSource};

/// Largest number of arrays in an archive.
const ARRAYS_LIMIT: usize = 1 << 16;
/// Largest number of arrays that a message lists.
const LISTED_LIMIT: usize = 20;
/// Buffer size for inflating in bytes.
const BUFFER_BYTES: usize = 1 << 18;

/// Ends of file names.
const ENDINGS: &[&str] = &[".npz"];

/// Row of the table of formats.
pub const FORMAT: Format = Format {
    name: "npz",
    title: "npz",
    endings: ENDINGS,
    choices: &[Choice::Array, Choice::Axes],
    sniff: |start, _| start.is_named(ENDINGS),
    certainty: Certainty::Certain,
    folder: Folder::Never,
    open: |path, options| Ok(Box::new(NpzSource::open(path, &options.spool, &options.selection)?)),
    found: |_| Found::Volume,
};

/// An array of an archive.
#[derive(Debug)]
pub struct NpzSource(NpySource);

impl NpzSource {
    /// Opens an array of an archive. A compressed one is inflated into `spool`.
    ///
    /// # Errors
    /// If the file cannot be read or is not such an archive. If it holds several arrays and none is named, or the array
    /// is not a supported volume.
    pub fn open(path: &Path, spool: &SpoolFolder, selection: &Selection) -> Result<Self, SourceError> {
        let source_file = SourceFile::of(path)?;
        let file = open_data(path)?;
        let mut archive = ZipArchive::new(BufReader::new(file)).map_err(|e| of_zip(path, e))?;
        let name = choose(path, &archive, selection)?;
        let mut entry = archive.by_name(&name).map_err(|e| of_zip(path, e))?;
        let length = entry.size();
        if entry.compression() == CompressionMethod::Stored {
            let start = entry.data_start();
            let start = start.ok_or_else(|| SourceError::invalid(path, "archive", "a place of the array", "none"))?;
            drop(entry);
            let file = open_data(path)?;
            let whole = file.len().map_err(|e| SourceError::io(path, e))?;
            if start.checked_add(length).is_none_or(|end| end > whole) {
                let found = format!("{length} bytes from byte {start} on, in a file of {whole}");
                return Err(SourceError::invalid(path, "archive", "an array inside the file", found));
            }
            let part = ArrayPart { format: "npz", file, start, length, source_file };
            return Ok(Self(NpySource::of_part(path, part, selection)?));
        }
        let inflated = inflate(path, &mut entry, length, spool)?;
        let part = ArrayPart { format: "npz", file: inflated, start: 0, length, source_file };
        Ok(Self(NpySource::of_part(path, part, selection)?))
    }
}

impl VolumeSource for NpzSource {
    fn info(&self) -> &SourceInfo {
        self.0.info()
    }

    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        self.0.read_box(voxels, out)
    }
}

/// The name in the archive of the chosen array, or of the only one.
fn choose<R>(path: &Path, archive: &ZipArchive<R>, selection: &Selection) -> Result<String, SourceError>
where
    R: Read + std::io::Seek,
{
    if archive.len() > ARRAYS_LIMIT {
        let found = archive.len().to_string();
        return Err(SourceError::invalid(path, "archive", format!("at most {ARRAYS_LIMIT} files"), found));
    }
    let arrays: Vec<&str> = archive.file_names().filter(|name| name.ends_with(".npy")).collect();
    let plain = |name: &str| name.strip_suffix(".npy").unwrap_or(name).to_owned();
    let list = || arrays.iter().take(LISTED_LIMIT).map(|name| shortened(&plain(name))).collect::<Vec<_>>().join(", ");
    match (&selection.array, &arrays[..]) {
        (Some(wanted), _) => {
            let found = arrays.iter().find(|name| **name == *wanted || plain(name) == *wanted);
            found.map(|name| (*name).to_owned()).ok_or_else(|| {
                let (path, wanted) = (path.display(), shortened(wanted));
                SourceError::options(format!("{path}: no array `{wanted}`; there are: {}", list()))
            })
        }
        (None, [one]) => Ok((*one).to_owned()),
        (None, []) => {
            let what = "this is a ZIP archive without NumPy arrays, which is not read";
            Err(refusal_of_zip(path, what))
        }
        (None, several) => {
            let what = format!("{} arrays: {}", several.len(), list());
            let choices = several.iter().map(|name| Part::of_array(path, &plain(name), plain(name)));
            Err(SourceError::unsupported(path, what, "name one: FILE.npz:/NAME").with_choices(choices))
        }
    }
}

/// Inflates an array, at most to the length that the archive states.
fn inflate<R: Read>(
    path: &Path,
    entry: &mut zip::read::ZipFile<'_, R>,
    length: u64,
    spool: &SpoolFolder,
) -> Result<File, SourceError> {
    let most = entry.compressed_size().saturating_add(1).saturating_mul(DEFLATE_RATIO_LIMIT);
    if length > most {
        let found = format!("{} compressed bytes, which hold at most {most}", entry.compressed_size());
        return Err(SourceError::invalid(path, "archive", format!("an array of {length} bytes"), found));
    }
    let mut spool = Spool::create(spool)?;
    let mut buffer = vec![0; BUFFER_BYTES];
    let mut left = length;
    loop {
        let count = entry.read(&mut buffer).map_err(|e| crate::input::spool::damaged("ZIP", path, length - left, e))?;
        if count == 0 && left == 0 {
            return spool.finish();
        }
        let fits = left.checked_sub(count as u64).filter(|_| count > 0);
        left = fits.ok_or_else(|| {
            let found = if count > 0 { "more".into() } else { format!("{} bytes", length - left) };
            SourceError::invalid(path, "inflated array", format!("{length} bytes"), found)
        })?;
        spool.append(&buffer[..count])?;
    }
}

/// Converts an error of the ZIP reader.
pub(crate) fn of_zip(path: &Path, error: zip::result::ZipError) -> SourceError {
    use zip::result::ZipError;
    match error {
        ZipError::Io(e) if e.kind() != std::io::ErrorKind::UnexpectedEof => SourceError::io(path, e),
        ZipError::UnsupportedArchive(what) => {
            let advice = "write it anew, with entries that are stored or deflated";
            SourceError::unsupported(path, format!("this kind of ZIP archive is not read ({what})"), advice)
        }
        other => SourceError::invalid(path, "ZIP", "a whole archive", other.to_string()),
    }
}
