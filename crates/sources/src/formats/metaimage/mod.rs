//! MetaImage volumes, as written by ITK and related programs: `.mha` (header and voxels in one file), and `.mhd`
//! (voxels in separate files, compressed or not).
//!
//! Raw voxels are read in place. Zlib, gzip and text are decoded once into a spool file ([`crate::input::spool`]).
//! Spacing, offset and direction are taken from the header. ITK declares left-posterior-superior millimetres for every
//! image, medical or not (`AnatomicalOrientation`). This is ignored unless `Comment` names a patient space, as our own
//! exports do.
//! `ElementToIntensityFunction` becomes scale and offset; voxels stay as stored. One of several numbers per voxel is
//! chosen (for colours the default is the luminance), and one of several volumes along the fourth axis. 64-bit integers
//! are kept in the smallest type that holds all of them. More than four axes are refused.
//! Written by hand: no crate for MetaImage was found.

mod header;

use std::fs::File;
use std::io::{BufRead, BufReader, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};
use supervol_format::space::WorldSpace;
use supervol_format::{ByteSource, Geometry, VoxelBox, VoxelType};

use crate::formats::format::{Certainty, Folder, Format, Found};
use crate::grid::dense::shape::{ChosenAxes, FastestAxis, SplitAxes, split_axes};
use crate::grid::dense::{GridFile, GridLayout, GridSource, checked_bytes};
use crate::grid::elements::{Channels, Elements, Frames, Meaning, Number};
use crate::grid::header_data::{DataLayout, HeaderData};
pub use crate::input::data_files::Outside;
use crate::input::data_files::{find_all, note_excess, open_data};
use crate::input::file::SourceFile;
use crate::input::selection::Selection;
use crate::input::spool::{Excess, GzipShare, Spool, SpoolFolder, TextNumbers, Words};
use crate::input::text::shortened;
use crate::{Axis, Endian, Message, SourceError, SourceInfo, VolumeSource};
use header::{DataFiles, Header};

/// First byte of a gzip stream; a zlib stream begins with another byte.
const GZIP_START: u8 = 0x1f;

/// Ends of file names.
const ENDINGS: &[&str] = &[".mha", ".mhd"];

/// Row of the table of formats.
pub const FORMAT: Format = Format {
    name: "metaimage",
    title: "MetaImage",
    endings: ENDINGS,
    choices: &[],
    sniff: |start, _| start.begins_with(b"ObjectType") || start.begins_with(b"NDims") || start.is_named(ENDINGS),
    certainty: Certainty::Certain,
    folder: Folder::Never,
    open: |path, options| {
        Ok(Box::new(MetaImageSource::open_with(path, &options.spool, options.outside, &options.selection)?))
    },
    found: |_| Found::Volume,
};

/// A MetaImage volume.
#[derive(Debug)]
pub struct MetaImageSource(GridSource);

impl MetaImageSource {
    /// Opens a MetaImage, or the header (`.mhd`) of several files. Compressed voxels are decoded into `spool`.
    ///
    /// # Errors
    /// If a file cannot be read, breaks the format's rules, or does not hold a supported volume. If a data file lies
    /// outside the header's folder and `outside` forbids that.
    pub fn open(path: &Path, spool: &SpoolFolder, outside: Outside) -> Result<Self, SourceError> {
        Self::open_with(path, spool, outside, &Selection::default())
    }

    /// As [`Self::open`], with the user's choice of volume and channel.
    ///
    /// # Errors
    /// As [`Self::open`]; also if there is no such volume or channel.
    pub fn open_with(
        path: &Path,
        spool: &SpoolFolder,
        outside: Outside,
        selection: &Selection,
    ) -> Result<Self, SourceError> {
        let source_file = SourceFile::of(path)?;
        let header = Header::read(path, BufReader::new(open_data(path)?))?;
        let sizes = header.sizes(path)?;
        let number = number(path, header.required(path, "ElementType")?)?;
        // A fourth axis is time.
        let split = split_axes(&sizes, &vec![true; sizes.len()], FastestAxis::AsStated).map_err(|axes| {
            let axis = axes.first().copied().unwrap_or_default();
            let what = format!("a volume has three axes, but there is also axis {axis} of {} values", sizes[axis]);
            SourceError::unsupported(
                path,
                what,
                "take one part of it first, for example with SimpleITK's `image[..., 0]`",
            )
        })?;
        let SplitAxes { frames, chosen, .. } = split;
        let mut notes = chosen.notes.clone();
        let wanted = selection.noted_frame(path, frames, "volumes", &mut notes)?;
        let frames = Frames { count: frames, wanted };
        let count = match header.whole_number(path, "ElementNumberOfChannels")? {
            0 => 1,
            count => u64::try_from(count).unwrap_or(u64::MAX),
        };
        let is_colour = number == Number::Voxel(VoxelType::U8) && (3..=4).contains(&count);
        let meaning = if is_colour { Meaning::Colours } else { Meaning::Components };
        let channels = Channels::choose(path, count, meaning, selection, &mut notes)?;
        let encoding = Encoding::of(path, &header)?;
        let endian = encoding.endian(path, &header)?;
        let fastest_first = GridLayout::X_FASTEST;
        let plain = GridLayout { dims: chosen.dims, voxel_type: number.stored(), endian, fastest_first };
        let layout = Elements::widened(channels, frames, plain);
        checked_bytes(path, layout.dims, layout.voxel_type)?;
        if encoding == Encoding::Text && number != Number::Voxel(plain.voxel_type) {
            let advice = "write it as binary first";
            return Err(SourceError::unsupported(path, "64-bit integers as text are not read", advice));
        }
        let data = Data { path, header: &header, voxel_type: plain.voxel_type, encoding, outside };
        let (grid, data_files) = data.open(layout, sizes.len(), spool, &mut notes)?;
        let elements = Elements::of(path, &grid, number, (channels, frames), &mut notes)?;

        let mut info = SourceInfo::plain("metaimage", chosen.dims, elements.voxel_type);
        info.notes = notes;
        info.space = WorldSpace::from_name(header.field(&["Comment"]).unwrap_or_default());
        info.geometry = geometry(path, &header, &chosen, sizes.len(), &mut info.notes)?;
        let unit = header.field(&["DistanceUnits"]).filter(|unit| *unit != "?").map(shortened).unwrap_or_default();
        info.axes = ["x", "y", "z"].map(|name| Axis { name: name.into(), unit: unit.clone() });
        (info.scale, info.offset) = scaling(path, &header, &mut info.notes)?;

        info.files = SourceFile::distinct([vec![source_file], data_files].concat());
        Ok(Self(GridSource::with_elements(info, grid, elements)))
    }
}

impl VolumeSource for MetaImageSource {
    fn info(&self) -> &SourceInfo {
        self.0.info()
    }

    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        self.0.read_box(voxels, out)
    }
}

/// Number type of an element type name; `LONG` has four bytes.
fn number(path: &Path, name: &str) -> Result<Number, SourceError> {
    Ok(match name {
        "MET_UCHAR" => Number::Voxel(VoxelType::U8),
        "MET_CHAR" | "MET_ASCII_CHAR" => Number::Voxel(VoxelType::I8),
        "MET_USHORT" => Number::Voxel(VoxelType::U16),
        "MET_SHORT" => Number::Voxel(VoxelType::I16),
        "MET_UINT" | "MET_ULONG" => Number::Voxel(VoxelType::U32),
        "MET_INT" | "MET_LONG" => Number::Voxel(VoxelType::I32),
        "MET_FLOAT" => Number::Voxel(VoxelType::F32),
        "MET_DOUBLE" => Number::Voxel(VoxelType::F64),
        "MET_LONG_LONG" => Number::Whole { signed: true },
        "MET_ULONG_LONG" => Number::Whole { signed: false },
        _ => {
            let found = format!("`{}`", shortened(name));
            return Err(SourceError::invalid(path, "ElementType", "MET_UCHAR to MET_DOUBLE, no arrays", found));
        }
    })
}

/// Scale and offset of the values; 1 and 0 if the file's are unusable.
fn scaling(path: &Path, header: &Header, notes: &mut Vec<Message>) -> Result<(f64, f64), SourceError> {
    let one = |name: &str| header.numbers(path, &[name], 1).map(|numbers| numbers.map(|n| n[0]));
    let scale = one("ElementToIntensityFunctionSlope")?.unwrap_or(1.0);
    let offset = one("ElementToIntensityFunctionOffset")?.unwrap_or(0.0);
    if scale.is_finite() && scale != 0.0 && offset.is_finite() {
        return Ok((scale, offset));
    }
    notes.push(format!("values by slope {scale} and offset {offset} are impossible: kept as stored").into());
    Ok((1.0, 0.0))
}

/// Spacing, origin and direction of the chosen axes. Each row of the header's matrix belongs to one axis of the grid.
fn geometry(
    path: &Path,
    header: &Header,
    chosen: &ChosenAxes,
    axes: usize,
    notes: &mut Vec<Message>,
) -> Result<Geometry, SourceError> {
    let spacings = header.numbers(path, &["ElementSpacing", "ElementSize"], axes)?;
    let offsets = header.numbers(path, &["Offset", "Position", "Origin"], axes)?;
    let matrix = header.numbers(path, &["TransformMatrix", "Rotation", "Orientation"], axes * axes)?;
    let of_axis = |numbers: &Option<Vec<f64>>, i: usize| Some(numbers.as_ref()?[*chosen.axes.get(i)?]);
    let (mut spacing, mut signs) = ([1.0; 3], [1.0; 3]);
    for i in 0..3 {
        let stated = of_axis(&spacings, i).unwrap_or(1.0);
        if stated.is_finite() && stated != 0.0 {
            // A negative spacing turns the axis round.
            (spacing[i], signs[i]) = (stated.abs(), stated.signum());
        } else {
            notes.push(format!("spacing {stated} of axis {i} is impossible: replaced by 1").into());
        }
    }
    // Axes that the file does not have keep the world's direction.
    let component = |column: usize, row: usize| {
        let place = (chosen.axes.get(column), chosen.axes.get(row), matrix.as_ref());
        let (Some(column_axis), Some(row_axis), Some(matrix)) = place else {
            return if column == row { 1.0 } else { 0.0 };
        };
        matrix[column_axis * axes + row_axis]
    };
    let column = |c: usize| DVec3::from_array(std::array::from_fn(|row| component(c, row) * signs[c] + 0.0));
    let direction = DMat3::from_cols(column(0), column(1), column(2)).transpose().to_cols_array();
    let origin = std::array::from_fn(|i| of_axis(&offsets, i).unwrap_or(0.0));
    let geometry = Geometry { spacing, origin, direction };
    let Some(defect) = geometry.defect() else { return Ok(geometry) };
    notes.push(format!("{defect}: replaced by the world's axes").into());
    Ok(Geometry { spacing, ..Geometry::IDENTITY })
}

/// Encoding of the voxels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Encoding {
    Raw,
    Deflated,
    Text,
}

impl Encoding {
    fn of(path: &Path, header: &Header) -> Result<Self, SourceError> {
        let is_binary = header.flag(path, &["BinaryData"], true)?;
        let is_compressed = header.flag(path, &["CompressedData"], false)?;
        Ok(match (is_binary, is_compressed) {
            (_, true) => Self::Deflated,
            (true, false) => Self::Raw,
            (false, false) => Self::Text,
        })
    }
}

impl Encoding {
    /// Byte order of the decoded voxels.
    fn endian(self, path: &Path, header: &Header) -> Result<Endian, SourceError> {
        // Text is decoded to little endian.
        let names = ["BinaryDataByteOrderMSB", "ElementByteOrderMSB"];
        let is_big = self != Self::Text && header.flag(path, &names, false)?;
        Ok(if is_big { Endian::Big } else { Endian::Little })
    }
}

/// Data needed to find the voxels.
struct Data<'a> {
    path: &'a Path,
    header: &'a Header,
    voxel_type: VoxelType,
    encoding: Encoding,
    outside: Outside,
}

impl Data<'_> {
    fn open(
        &self,
        layout: GridLayout,
        axes: usize,
        spool: &SpoolFolder,
        notes: &mut Vec<Message>,
    ) -> Result<(GridFile, Vec<SourceFile>), SourceError> {
        let (files, start) = match self.header.data_files(self.path, axes)? {
            DataFiles::Local => (vec![self.path.to_path_buf()], self.header.end),
            DataFiles::Named(names) => (find_all(self.path, &names, self.outside)?, 0),
        };
        HeaderData { header: self.path, key: "ElementDataFile", files, start, layout }.open(self, spool, notes)
    }
}

impl DataLayout for Data<'_> {
    fn is_raw(&self) -> bool {
        self.encoding == Encoding::Raw
    }

    /// Offset of the voxels in a raw data file: behind the header, at `HeaderSize`, or such that they end with the
    /// file.
    fn offset(&self, path: &Path, start: u64, share_bytes: u64, notes: &mut Vec<Message>) -> Result<u64, SourceError> {
        let length = open_data(path)?.len().map_err(|e| SourceError::io(path, e))?;
        let stated = self.header.whole_number(self.path, "HeaderSize")?;
        let offset = match u64::try_from(stated) {
            Ok(0) => Some(start),
            Ok(stated) => Some(stated),
            // -1: the voxels are at the end of the file.
            Err(_) => length.checked_sub(share_bytes),
        };
        let offset = offset.filter(|offset| (start..=length).contains(offset)).ok_or_else(|| {
            let expected = format!("{share_bytes} bytes of voxels in it, behind byte {start}");
            SourceError::invalid(path, "length of the file", expected, format!("{length} bytes, HeaderSize {stated}"))
        })?;
        // Opening the grid finds a file that is too short.
        let excess = (length - offset).saturating_sub(share_bytes);
        note_excess(path, excess, notes);
        Ok(offset)
    }

    /// Decodes all data files, one after the other, into one spool file.
    fn decode(
        &self,
        files: &[PathBuf],
        start: u64,
        share_bytes: u64,
        folder: &SpoolFolder,
    ) -> Result<File, SourceError> {
        let mut spool = Spool::create(folder)?;
        for path in files {
            let file = open_data(path)?;
            let left = file.len().map_err(|e| SourceError::io(path, e))?.saturating_sub(start);
            let mut reader = BufReader::new(file);
            reader.seek(SeekFrom::Start(start)).map_err(|e| SourceError::io(path, e))?;
            if self.encoding == Encoding::Deflated {
                let excess = Excess::Refused;
                let share = GzipShare { path, compressed_bytes: left, skip_bytes: 0, bytes: share_bytes, excess };
                let first = reader.fill_buf().map_err(|e| SourceError::io(path, e))?.first().copied();
                match first {
                    Some(GZIP_START) => spool.append_gzip(reader, &share)?,
                    _ => spool.append_zlib(reader, &share)?,
                }
                continue;
            }
            let voxels = share_bytes / self.voxel_type.bytes() as u64;
            // A number takes at least a digit and, unless it is the last, a separator.
            if left.saturating_add(1) / 2 < voxels {
                let found = format!("{left} bytes of text");
                return Err(SourceError::invalid(path, "text data", format!("{voxels} numbers"), found));
            }
            let words = if path == self.path { Words::Shown } else { Words::Hidden };
            let numbers = TextNumbers { voxel_type: self.voxel_type, voxels, words, excess: Excess::Refused };
            spool.append_text(path, reader, numbers)?;
        }
        spool.finish()
    }
}
