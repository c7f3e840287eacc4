//! NIfTI-1 and NIfTI-2 volumes: `.nii`, and pairs of `.hdr` and `.img`, gzipped or not; also ANALYZE 7.5, the
//! predecessor.
//!
//! x is fastest in the file. Uncompressed voxels are read in place. Gzip is decoded once into a spool file
//! ([`crate::input::spool`]); it is recognized by the first bytes, not by the file name. `scl_slope` and `scl_inter`
//! become scale and offset; voxels stay as stored.
//! A series (4-D and more) gives its first volume, or that of `frame`. Colours give their luminance, or one channel.
//! 64-bit integers are kept in the smallest type that holds all of them. Complex voxels are refused. ANALYZE does not
//! state which sides of a patient its axes point to, so its world space is unknown, with a note.

mod geometry;
mod header;

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

use flate2::bufread::MultiGzDecoder;
use supervol_format::space::WorldSpace;
use supervol_format::{ByteSource, Dims, VoxelBox, VoxelType};

use crate::cast;
use crate::formats::format::{Certainty, Folder, Format, Found};
use crate::formats::unsupported::ENVI_START;
use crate::grid::dense::{GridFile, GridLayout, GridSource, checked_bytes};
use crate::grid::elements::{Channels, Elements, Frames, Meaning, Number};
use crate::input::file::SourceFile;
use crate::input::selection::{Selection, first_of};
use crate::input::spool::{Excess, GzipShare, Spool, SpoolFolder, damaged};
use crate::{Axis, Message, ReadOption, SourceError, SourceInfo, VolumeSource};
use header::{Form, HEADER_BYTES, Header};

/// Ends of file names.
const ENDINGS: &[&str] = &[".nii", ".nii.gz", ".hdr", ".hdr.gz", ".img", ".img.gz"];

/// Intent codes of labels: numbers of a lookup table (`LABEL`), and of a list of brain regions (`NEURONAMES`).
const INTENT_LABELS: [i32; 2] = [1002, 1005];

/// Row of the table of formats.
pub const FORMAT: Format = Format {
    name: "nifti",
    title: "NIfTI",
    endings: ENDINGS,
    choices: &[],
    sniff: |start, _| {
        // A header begins with its own size in either byte order.
        let sizes = [348i32, 540].map(|n| [n.to_le_bytes(), n.to_be_bytes()]);
        let named = start.is_named(ENDINGS);
        sizes.as_flattened().iter().any(|size| start.begins_with(size)) || named && !start.begins_with(ENVI_START)
    },
    certainty: Certainty::Certain,
    folder: Folder::Never,
    open: |path, options| Ok(Box::new(NiftiSource::open_with(path, &options.spool, &options.selection)?)),
    found: |_| Found::Volume,
};

/// A NIfTI volume.
#[derive(Debug)]
pub struct NiftiSource(GridSource);

impl NiftiSource {
    /// Opens a NIfTI file, or a pair by either of its names. Compressed voxels are decoded into `spool`.
    ///
    /// # Errors
    /// If a file cannot be read, breaks the format's rules, or does not hold a supported volume.
    pub fn open(path: &Path, spool: &SpoolFolder) -> Result<Self, SourceError> {
        Self::open_with(path, spool, &Selection::default())
    }

    /// As [`Self::open`], with the user's choice of volume and channel.
    ///
    /// # Errors
    /// As [`Self::open`]; also if there is no such volume or channel.
    pub fn open_with(path: &Path, spool: &SpoolFolder, selection: &Selection) -> Result<Self, SourceError> {
        let header_path = partner(path, "img", "hdr")?.unwrap_or_else(|| path.into());
        let mut files = vec![SourceFile::of(path)?, SourceFile::of(&header_path)?];
        let header = Header::parse(&header_path, &first_bytes(&header_path)?)?;
        let shape = Shape::read(&header_path, &header, selection)?;
        let (number, count) = match header.form {
            Form::Analyze => numbers_of_analyze(&header_path, header.datatype)?,
            Form::SingleFile | Form::Pair => numbers(&header_path, header.datatype)?,
        };
        let mut notes = shape.notes.clone();
        let channels = Channels::choose(&header_path, count, Meaning::Colours, selection, &mut notes)?;
        let (geometry, geometry_notes) = geometry::placement(&header);
        notes.extend(geometry_notes);
        let (scale, offset) = scaling(&header, &mut notes);
        if u64::try_from(header.bits_per_voxel).ok() != Some(8 * number.stored().bytes() as u64 * count) {
            let (bits, code) = (header.bits_per_voxel, header.datatype);
            notes.push(
                format!("the header says {bits} bits per voxel, but its datatype is {code}: the type counts").into(),
            );
        }

        let data_path = if header.form == Form::SingleFile {
            header_path.clone()
        } else {
            partner(&header_path, "hdr", "img")?.ok_or_else(|| {
                let expected = "the .img or .img.gz of the pair beside it";
                SourceError::invalid(&header_path, "voxels of the pair", expected, "none")
            })?
        };
        files.push(SourceFile::of(&data_path)?);
        let plain = GridLayout {
            dims: shape.dims,
            voxel_type: number.stored(),
            endian: header.endian,
            fastest_first: GridLayout::X_FASTEST,
        };
        let layout = Elements::widened(channels, Frames::ONE, plain);
        let data = Data { path: &data_path, header: &header, shape: &shape, layout };
        let grid = data.open(spool)?;
        let elements = Elements::of(&header_path, &grid, number, (channels, Frames::ONE), &mut notes)?;
        let mut info = SourceInfo::plain("nifti", shape.dims, elements.voxel_type);
        info.geometry = geometry;
        if header.form == Form::Analyze {
            let unknown =
                "ANALYZE 7.5: which sides of a patient the axes point to, left and right above all, is unknown";
            notes.push(unknown.into());
        } else {
            info.space = WorldSpace::RightAnteriorSuperior;
        }
        info.labels = INTENT_LABELS.contains(&header.intent_code).then_some("the intent code of the file says labels");
        (info.scale, info.offset, info.notes) = (scale, offset, notes);
        info.files = SourceFile::distinct(files);
        info.axes = ["x", "y", "z"].map(|name| Axis { name: name.into(), unit: length_unit(header.units).into() });
        Ok(Self(GridSource::with_elements(info, grid, elements)))
    }
}

impl VolumeSource for NiftiSource {
    fn info(&self) -> &SourceInfo {
        self.0.info()
    }

    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        self.0.read_box(voxels, out)
    }
}

/// Grid of a volume, the number of volumes, and the chosen one.
struct Shape {
    dims: Dims,
    volumes: u64,
    wanted: u64,
    notes: Vec<Message>,
}

impl Shape {
    fn read(path: &Path, header: &Header, selection: &Selection) -> Result<Self, SourceError> {
        let axes = usize::try_from(header.dim[0]).ok().filter(|n| (1..=7).contains(n)).ok_or_else(|| {
            SourceError::invalid(path, "number of axes (dim[0])", "1 to 7", header.dim[0].to_string())
        })?;
        let size = |axis: usize| -> Result<u64, SourceError> {
            let stated = if axis <= axes { header.dim[axis] } else { 1 };
            u64::try_from(stated)
                .ok()
                .filter(|n| *n > 0)
                .ok_or_else(|| SourceError::invalid(path, format!("dim[{axis}]"), "at least 1", stated.to_string()))
        };
        let dims = Dims([size(1)?, size(2)?, size(3)?]);
        let mut notes = Vec::new();
        if axes < 3 {
            notes.push(format!("the file has {axes} of three axes: read as {dims} voxels").into());
        }
        let (mut volumes, mut what): (u64, String) = (1, String::new());
        for axis in 4..=7 {
            let count = size(axis)?;
            let product = volumes.checked_mul(count);
            volumes = product.ok_or_else(|| {
                SourceError::invalid(path, format!("dim[{axis}]"), "fewer than 2^64 volumes", count.to_string())
            })?;
            if count > 1 && axis == 4 {
                what = format!("{count} time points");
            } else if count > 1 {
                let more = format!("{count} values along axis {axis}");
                what = if what.is_empty() { more } else { format!("{what}, {more}") };
            }
        }
        let wanted = selection.frame_of(path, volumes)?;
        if volumes > 1 && selection.frame.is_none() {
            notes.push(first_of(&what, ReadOption::Frame, volumes));
        }
        Ok(Self { dims, volumes, wanted, notes })
    }
}

/// Number type of a NIfTI datatype code, and numbers per voxel.
fn numbers(path: &Path, code: i16) -> Result<(Number, u64), SourceError> {
    let refused = |what: &str, advice: &str| {
        Err(SourceError::unsupported(path, format!("voxels are {what} (datatype {code})"), advice))
    };
    let one = |voxel_type| Ok((Number::Voxel(voxel_type), 1));
    match code {
        2 => one(VoxelType::U8),
        4 => one(VoxelType::I16),
        8 => one(VoxelType::I32),
        16 => one(VoxelType::F32),
        64 => one(VoxelType::F64),
        256 => one(VoxelType::I8),
        512 => one(VoxelType::U16),
        768 => one(VoxelType::U32),
        128 => Ok((Number::Voxel(VoxelType::U8), 3)),
        2304 => Ok((Number::Voxel(VoxelType::U8), 4)),
        1024 => Ok((Number::Whole { signed: true }, 1)),
        1280 => Ok((Number::Whole { signed: false }, 1)),
        32 | 1792 | 2048 => refused("complex numbers", "write out the magnitude or the phase"),
        1536 => refused("128-bit floats", "convert to 64-bit floats first"),
        1 => refused("single bits", "convert to 8-bit integers first"),
        _ => {
            let expected = "a datatype code of NIfTI, such as 2, 4, 8, 16 or 64";
            Err(SourceError::invalid(path, "datatype", expected, code.to_string()))
        }
    }
}

/// Number type of an ANALYZE 7.5 code; some codes are SPM's.
fn numbers_of_analyze(path: &Path, code: i16) -> Result<(Number, u64), SourceError> {
    match code {
        130 => Ok((Number::Voxel(VoxelType::I8), 1)),
        132 => Ok((Number::Voxel(VoxelType::U16), 1)),
        136 => Ok((Number::Voxel(VoxelType::U32), 1)),
        // Colours may be in planes or interleaved; the file does not tell.
        128 => {
            let what = "voxels are colours of ANALYZE 7.5, of which nothing says how they lie (datatype 128)";
            let advice = "convert it to NIfTI first, for example with `nib-convert IN.hdr OUT.nii`";
            Err(SourceError::unsupported(path, what, advice))
        }
        1 | 2 | 4 | 8 | 16 | 32 | 64 => numbers(path, code),
        _ => {
            let expected = "a datatype code of ANALYZE 7.5: 2, 4, 8, 16, 64, or SPM's 130, 132, 136";
            Err(SourceError::invalid(path, "datatype", expected, code.to_string()))
        }
    }
}

fn length_unit(units: i32) -> &'static str {
    match units & 7 {
        1 => "m",
        2 => "mm",
        3 => "um",
        _ => "",
    }
}

/// Scale and offset; a slope of 0 means that there are none.
fn scaling(header: &Header, notes: &mut Vec<Message>) -> (f64, f64) {
    let Header { slope, inter, .. } = *header;
    if slope == 0.0 {
        return (1.0, 0.0);
    }
    if !slope.is_finite() || !inter.is_finite() {
        notes.push(format!("slope {slope} and intercept {inter} are impossible: values are taken as stored").into());
        return (1.0, 0.0);
    }
    (slope, inter)
}

/// Data needed to find the voxels.
struct Data<'a> {
    path: &'a Path,
    header: &'a Header,
    shape: &'a Shape,
    layout: GridLayout,
}

impl Data<'_> {
    fn open(&self, folder: &SpoolFolder) -> Result<GridFile, SourceError> {
        let layout = self.layout;
        let volume_bytes = checked_bytes(self.path, layout.dims, layout.voxel_type)?;
        let offset = self.offset()?;
        let file = File::open(self.path).map_err(|e| SourceError::io(self.path, e))?;
        let length = file.len().map_err(|e| SourceError::io(self.path, e))?;
        if !is_gzip(self.path, &file)? {
            // All volumes must be present, not only the chosen one: a truncated file is not trustworthy.
            let end = volume_bytes.checked_mul(self.shape.volumes).and_then(|b| b.checked_add(offset));
            if end.is_none_or(|end| end > length) {
                let end = end.map_or_else(|| "2^64 or more".into(), |end| end.to_string());
                let found = format!("{length} bytes");
                return Err(SourceError::invalid(self.path, "length of the file", format!("{end} bytes"), found));
            }
            // Cannot overflow: all volumes are present.
            return GridFile::single(self.path, file, offset + self.shape.wanted * volume_bytes, layout);
        }
        let excess = if self.shape.wanted + 1 < self.shape.volumes { Excess::Expected } else { Excess::Refused };
        // An impossible offset exceeds every stream and is refused there.
        let skip_bytes = volume_bytes.saturating_mul(self.shape.wanted).saturating_add(offset);
        let share = GzipShare { path: self.path, compressed_bytes: length, skip_bytes, bytes: volume_bytes, excess };
        let mut spool = Spool::create(folder)?;
        spool.append_gzip(BufReader::new(file), &share)?;
        GridFile::single(self.path, spool.finish()?, 0, layout)
    }

    /// Offset of the voxels: behind header and extensions in a single file, anywhere in the `.img` of a pair.
    fn offset(&self) -> Result<u64, SourceError> {
        let stated = self.header.vox_offset;
        let least = if self.header.form == Form::SingleFile { self.header.header_bytes + 4 } else { 0 };
        // Writers that leave the field empty put the voxels directly behind the header.
        if stated == 0.0 {
            return Ok(least);
        }
        let whole = stated.is_finite() && stated.fract() == 0.0 && (0.0..9.0e15).contains(&stated);
        if !whole || cast::whole::<u64>(stated) < least {
            let expected = format!("a whole number of bytes, at least {least}");
            return Err(SourceError::invalid(
                self.path,
                "offset of the voxels (vox_offset)",
                expected,
                stated.to_string(),
            ));
        }
        Ok(cast::whole::<u64>(stated))
    }
}

/// The first bytes of a header file, decompressed if necessary; fewer if the file is shorter.
fn first_bytes(path: &Path) -> Result<Vec<u8>, SourceError> {
    let file = File::open(path).map_err(|e| SourceError::io(path, e))?;
    let compressed = is_gzip(path, &file)?;
    let reader = BufReader::new(file);
    let mut bytes = Vec::with_capacity(HEADER_BYTES);
    if compressed {
        let decoder = MultiGzDecoder::new(reader);
        decoder.take(HEADER_BYTES as u64).read_to_end(&mut bytes).map_err(|e| damaged("gzip", path, 0, e))?;
    } else {
        reader.take(HEADER_BYTES as u64).read_to_end(&mut bytes).map_err(|e| SourceError::io(path, e))?;
    }
    Ok(bytes)
}

fn is_gzip(path: &Path, file: &File) -> Result<bool, SourceError> {
    let length = file.len().map_err(|e| SourceError::io(path, e))?;
    let mut magic = [0; 2];
    if length >= 2 {
        file.read_exact_at(0, &mut magic).map_err(|e| SourceError::io(path, e))?;
    }
    Ok(magic == [0x1f, 0x8b])
}

/// The other file of a pair. `from` and `to` are extensions (`hdr`, `img`), with or without `.gz`.
///
/// `None` if the path does not end in `from`, or if the other file does not exist in any spelling.
fn partner(path: &Path, from: &str, to: &str) -> Result<Option<PathBuf>, SourceError> {
    let Some(name) = path.file_name().and_then(|n| n.to_str()) else { return Ok(None) };
    let lower = name.to_ascii_lowercase();
    let plain = lower.strip_suffix(".gz").unwrap_or(&lower);
    let Some(stem) = plain.strip_suffix(from).and_then(|p| p.strip_suffix('.')) else { return Ok(None) };
    // Lower case keeps the length of ASCII letters, so the stem has the same length in the original name.
    let stem = &name[..stem.len()];
    let (upper_to, mut found) = (to.to_ascii_uppercase(), None);
    for extension in [to, &format!("{to}.gz"), &upper_to, &format!("{upper_to}.GZ")] {
        let candidate = path.with_file_name(format!("{stem}.{extension}"));
        let exists = candidate.try_exists().map_err(|e| SourceError::io(&candidate, e))?;
        if exists && found.is_none() {
            found = Some(candidate);
        }
    }
    Ok(found)
}
