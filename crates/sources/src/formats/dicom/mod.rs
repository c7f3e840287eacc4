//! DICOM: a folder with the files of a series, or one file, with one or many frames.
//!
//! A series is the set of files with the same series UID. If a folder holds several, they are listed, and `series`
//! chooses one. Slices are sorted by their position along the normal of the image, which is the z direction. The world
//! space is the patient's: left-posterior-superior, in mm. Missing slices are refused; a tilted gantry gives a sheared
//! grid.
//! Rescale slope and intercept become scale and offset if they are equal for all slices; voxels stay as stored.
//! Otherwise the values are computed slice by slice, as f32. A real-world value mapping that is a line takes their place
//! if they change no number. The padding value is nodata, unless it is 0. `frame`
//! chooses one of several volumes at the same place (time points, echoes), `channel` a colour.
//! Uncompressed pixels are read in place. Compressed ones (RLE, JPEG, JPEG 2000) are decoded once into a spool file,
//! one frame at a time. Single bits become bytes. JPEG-LS, JPEG XL and video are refused by name.

mod data_set;
mod frames;
mod header;
mod series;
mod syntax;

use std::fs::File;
use std::path::Path;

use supervol_format::space::WorldSpace;
use supervol_format::voxel_type::voxels_as_f64;
use supervol_format::{Dims, VoxelBox, VoxelType};

use crate::cast::{index, single};
use crate::formats::format::{Certainty, Folder, Format, Found};
use crate::grid::dense::{GridFile, GridLayout, GridSource, Part, checked_bytes};
use crate::grid::elements;
use crate::grid::elements::{Channels, Elements, Meaning, Numbers};
use crate::input::data_files::open_data;
use crate::input::file::SourceFile;
use crate::input::folder::{FolderDepth, FolderOptions, Listing};
use crate::input::selection::{Choice, Selection};
use crate::input::spool::Spool;
use crate::input::values::{Values, line};
use crate::{Axis, Message, ReadOption, SourceError, SourceInfo, VolumeSource};
use data_set::{DOUBLE_PIXEL_DATA, FLOAT_PIXEL_DATA, PixelsAt};
use frames::Frames;
use header::{FRAMES_LIMIT, Header, Image};
use series::{Member, SEGMENTATION, Slice};
use syntax::Compression;

/// Copies of a frame in memory while it is decoded: encoded, decoded, as floats, as written.
const FRAME_COPIES: u64 = 6;

/// A DICOM volume.
#[derive(Debug)]
pub struct DicomSource(GridSource);

/// Ends of file names.
const ENDINGS: &[&str] = &[".dcm", ".dicom", ".ima"];

/// Row of the table of formats.
pub const FORMAT: Format = Format {
    name: "dicom",
    title: "DICOM",
    endings: ENDINGS,
    choices: &[Choice::Series, Choice::Array],
    sniff: |start, _| is_dicom(&start.bytes) || start.is_named(ENDINGS),
    certainty: Certainty::Certain,
    folder: Folder::ByFiles { title: "DICOM", sniff: |files| files.any_start(|start| is_dicom(&start.bytes)) },
    open: |path, options| Ok(Box::new(DicomSource::open(path, &options.of_folders())?)),
    found: |_| Found::DicomSlice,
};

/// Whether a file is DICOM, judged by its first bytes.
fn is_dicom(head: &[u8]) -> bool {
    head.get(128..132) == Some(b"DICM")
}

impl DicomSource {
    /// Opens a folder or a file.
    ///
    /// # Errors
    /// If a file cannot be read or breaks the format's rules. If there are several series and none is chosen. If slices
    /// are missing, or the kind of pixels is not supported.
    pub fn open(path: &Path, options: &FolderOptions<'_>) -> Result<Self, SourceError> {
        options.selection.refuse_array(path)?;
        let mut notes = Vec::new();
        let (members, damaged) = members(path, options, &mut notes)?;
        let (members, is_only) = series::choose_series(path, members, options.selection)?;
        if let Some((error, count)) = damaged {
            // The damaged file may belong to the only series.
            if is_only {
                return Err(error);
            }
            notes.push(format!("{count} damaged files are left out, whatever series they belong to: {error}").into());
        }
        members.iter().try_for_each(|member| member.header.syntax.check(&member.path))?;
        let members = series::keep_alike(members, &mut notes);
        let frames = members.iter().fold(0u64, |sum, member| sum.saturating_add(member.header.frame_count));
        if frames > FRAMES_LIMIT {
            let found = frames.to_string();
            return Err(SourceError::invalid(path, "frames of all files", format!("at most {FRAMES_LIMIT}"), found));
        }
        // The reason why pixels cannot be read precedes defects of the stack.
        let pixels = members[0].header.pixels.map_or(0, |pixels| pixels.tag);
        voxel_type(&members[0].path, &members[0].header.image, pixels)?;
        let slices = series::slices(path, &members, options.selection, &mut notes)?;
        let geometry = series::geometry(path, &slices, &mut notes)?;

        let first = &members[0].header;
        let volume = Volume::new(path, &members, &slices, options, &mut notes)?;
        let (grid, elements) = volume.grid()?;
        let mut info = SourceInfo::plain("dicom", elements.dims(&grid), elements.voxel_type);
        info.geometry = geometry;
        if slices[0].place.orientation.is_some() {
            info.space = WorldSpace::LeftPosteriorSuperior;
        }
        info.axes = ["x", "y", "z"].map(|name| Axis { name: name.into(), unit: "mm".into() });
        info.unit = if volume.meaning == Meant::RealWorld { unit_of_code(&first.real_unit) } else { unit(first) };
        if volume.scaling == Scaling::Same {
            (info.scale, info.offset) = volume.meaning.scaling(&slices[0]);
            info.nodata = first.padding.filter(|_| volume.padding_is_one());
        }
        if first.image.photometric == "MONOCHROME1" {
            notes.push("greater values are meant to be darker (MONOCHROME1); values are as stored".into());
        }
        if !first.modality.is_empty() {
            info.reading.push(("modality", first.modality.clone()));
        }
        info.notes = notes;
        info.memory_bytes = (size_of::<Part>() as u64 + 512) * slices.len() as u64;
        info.folder = path.is_dir().then(|| path.into());
        info.files = members.iter().map(|member| SourceFile::of(&member.path)).collect::<Result<_, _>>()?;
        Ok(Self(GridSource::with_elements(info, grid, elements)))
    }
}

impl VolumeSource for DicomSource {
    fn info(&self) -> &SourceInfo {
        self.0.info()
    }

    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        self.0.read_box(voxels, out)
    }
}

/// First error of the skipped files, and their number.
type Damaged = Option<(SourceError, u64)>;

/// The files that hold an image, with their headers.
///
/// In a folder, files that break the format's rules are skipped and counted; the first error is returned with the
/// count.
fn members(
    path: &Path,
    options: &FolderOptions<'_>,
    notes: &mut Vec<Message>,
) -> Result<(Vec<Member>, Damaged), SourceError> {
    let listing = match path.is_dir() {
        true => Listing::of(path, FolderDepth::WithSubfolders, options.outside)?,
        false => Listing::one(path),
    };
    listing.note(notes);
    let (mut members, mut others, mut without_image, mut damaged) = (Vec::new(), 0, 0, None);
    for path in listing.files {
        // A folder may hold other files, too: an index, texts, DICOM without pixels.
        let header = match Header::read(&path, options.spool) {
            Err(error @ SourceError::Invalid { .. }) => {
                damaged = damaged.map_or(Some((error, 1)), |(first, count)| Some((first, count + 1)));
                continue;
            }
            header => header?,
        };
        match header {
            None => others += 1,
            Some(header) if header.pixels.is_none() || header.image.rows == 0 => without_image += 1,
            Some(header) => members.push(Member { path, header }),
        }
    }
    if members.is_empty()
        && let Some((error, _)) = damaged
    {
        return Err(error);
    }
    if members.is_empty() && !path.is_dir() {
        let found = if others > 0 { "no mark `DICM` at byte 128, nor elements of group 8" } else { "no pixels" };
        return Err(SourceError::invalid(path, "DICOM", "an image", found));
    }
    if members.is_empty() {
        let found = format!("{without_image} DICOM files without an image, {others} other files");
        return Err(SourceError::invalid(path, "DICOM", "at least one file with pixels", found));
    }
    if others + without_image > 0 {
        notes.push(
            format!("{} files of the folder hold no DICOM image and are left out", others + without_image).into(),
        );
    }
    Ok((members, damaged))
}

/// Unit of the values.
fn unit(header: &Header) -> String {
    match header.unit.as_str() {
        "" if header.modality == "CT" => "HU".into(),
        // Unspecified.
        "US" => String::new(),
        unit => unit.into(),
    }
}

/// Scaling of stored numbers to values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Scaling {
    /// Equal for all slices.
    Same,
    /// Different between slices: the values are computed.
    BySlice,
}

/// Unit by its code in UCUM; empty for pure numbers.
fn unit_of_code(code: &str) -> String {
    match code {
        "1" | "{no units}" | "no units" => String::new(),
        "[hnsf'U]" => "HU".into(),
        other => other.into(),
    }
}

/// Attributes that give the values of stored numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Meant {
    /// None.
    Stored,
    /// Rescale slope and intercept.
    Rescaled,
    /// Real-world value mapping.
    RealWorld,
}

impl Meant {
    /// The real-world mapping counts where all slices have one and no rescaling changes a number.
    fn of(slices: &[Slice], header: &Header, values: Values, notes: &mut Vec<Message>) -> Self {
        if values == Values::Stored {
            return Self::Stored;
        }
        let mapped = slices.iter().filter(|slice| slice.place.real_world().is_some()).count();
        if mapped == 0 {
            return Self::Rescaled;
        }
        let is_rescaled = slices.iter().any(|slice| Self::Rescaled.scaling(slice) != (1.0, 0.0));
        let unit = unit_of_code(&header.real_unit);
        if is_rescaled || mapped < slices.len() {
            let by_rescale = Self::Rescaled.scaling(&slices[0]);
            if slices[0].place.real_world() != Some(by_rescale) {
                let why = if is_rescaled { "slices are rescaled" } else { "some slices have none" };
                notes.push(format!("a real-world value mapping (to {unit}) is not applied: {why}").into());
            }
            return Self::Rescaled;
        }
        let (slope, intercept) = Self::RealWorld.scaling(&slices[0]);
        let values = line(slope, intercept).unwrap_or_else(|| "value = stored".into());
        let several = if header.real_mappings > 1 { ", the first of several" } else { "" };
        let what = format!("real-world value mapping{several}: {values} {unit}; ");
        notes.push(Message::from(what).option(ReadOption::Values).text(" ignores it"));
        Self::RealWorld
    }

    /// Scale and offset of a slice.
    fn scaling(self, slice: &Slice) -> (f64, f64) {
        match self {
            Self::Stored => (1.0, 0.0),
            Self::Rescaled => (slice.place.slope.unwrap_or(1.0), slice.place.intercept.unwrap_or(0.0)),
            Self::RealWorld => slice.place.real_world().unwrap_or((1.0, 0.0)),
        }
    }
}

/// Data needed to find the voxels.
struct Volume<'a> {
    path: &'a Path,
    members: &'a [Member],
    slices: &'a [Slice],
    image: &'a Image,
    pixels: Vec<PixelsAt>,
    /// Type of the numbers in the files.
    stored: VoxelType,
    elements: Elements,
    scaling: Scaling,
    meaning: Meant,
    options: &'a FolderOptions<'a>,
}

impl<'a> Volume<'a> {
    fn new(
        path: &'a Path,
        members: &'a [Member],
        slices: &'a [Slice],
        options: &'a FolderOptions<'a>,
        notes: &mut Vec<Message>,
    ) -> Result<Self, SourceError> {
        let pixels: Vec<PixelsAt> = members.iter().filter_map(|member| member.header.pixels).collect();
        let image = &members[0].header.image;
        let stored = voxel_type(&members[0].path, image, pixels[0].tag)?;
        let is_raw = members[0].header.syntax.compression == Compression::None;
        let numbers = numbers(&members[0].path, image, pixels[0].tag, is_raw)?;
        // The channel of a segmentation is a segment.
        let is_segmentation = members[0].header.modality == SEGMENTATION;
        let of_pixels =
            Selection { channel: options.selection.channel.filter(|_| !is_segmentation), ..Selection::default() };
        let mut channels = Channels::choose(path, image.samples.into(), Meaning::Colours, &of_pixels, notes)?;
        if channels.wanted.is_none() && image.photometric.starts_with("YBR") && is_raw {
            // The first of the three is the luminance.
            channels.wanted = Some(0);
        }
        let elements = Elements { channels, numbers, ..Elements::plain(stored) };
        let meaning = Meant::of(slices, &members[0].header, options.values, notes);
        let all_same = slices.iter().all(|slice| meaning.scaling(slice) == meaning.scaling(&slices[0]));
        let scaling = if all_same { Scaling::Same } else { Scaling::BySlice };
        if scaling == Scaling::BySlice {
            notes.push("each slice has a rescale slope and intercept of its own: values are computed, as f32".into());
        }
        let volume = Self { path, members, slices, image, pixels, stored, elements, scaling, meaning, options };
        volume.check_lengths()?;
        Ok(volume)
    }

    /// Whether all files state the same padding value.
    fn padding_is_one(&self) -> bool {
        self.members.iter().all(|member| member.header.padding == self.members[0].header.padding)
    }

    fn dims(&self) -> Dims {
        Dims([self.image.columns.into(), self.image.rows.into(), self.slices.len() as u64])
    }

    /// Refuses files that are too short for their frames, and frames that are too large to be decoded.
    fn check_lengths(&self) -> Result<(), SourceError> {
        checked_bytes(self.path, self.dims(), self.stored)?;
        for (Member { path, header }, pixels) in self.members.iter().zip(&self.pixels) {
            let needed = self.image.stored_bytes(header.frame_count);
            let is_compressed = header.syntax.compression != Compression::None;
            match pixels.length {
                None if is_compressed => {}
                Some(length) if !is_compressed && u64::from(length) >= needed => {}
                length => {
                    let expected =
                        if is_compressed { "pixels in fragments".into() } else { format!("pixels of {needed} bytes") };
                    let found = length.map_or("fragments".into(), |n| format!("{n} bytes in one piece"));
                    return Err(SourceError::invalid(path, "pixels", expected, found));
                }
            }
        }
        Ok(())
    }

    /// The numbers, in place or decoded, and their conversion to voxels.
    fn grid(&self) -> Result<(GridFile, Elements), SourceError> {
        let endian = self.members[0].header.syntax.spelling.endian;
        let is_in_place = self.scaling == Scaling::Same
            && self.slices.iter().all(|slice| !slice.is_empty)
            && !self.image.has_bits()
            && (!self.image.is_planar || self.image.samples == 1)
            && self.members.iter().all(|member| {
                let syntax = member.header.syntax;
                syntax.compression == Compression::None && !syntax.is_deflated && syntax.spelling.endian == endian
            });
        let plain = GridLayout {
            dims: self.dims(),
            voxel_type: self.stored,
            endian: crate::Endian::Little,
            fastest_first: GridLayout::X_FASTEST,
        };
        if self.scaling == Scaling::BySlice {
            let layout = GridLayout { voxel_type: VoxelType::F32, ..plain };
            let grid = GridFile::single(self.path, self.decode()?, 0, layout)?;
            return Ok((grid, Elements::plain(VoxelType::F32)));
        }
        let layout = Elements::widened(self.elements.channels, elements::Frames::ONE, plain);
        let grid = match is_in_place {
            false => GridFile::single(self.path, self.decode()?, 0, layout)?,
            true => self.in_place(GridLayout { endian, ..layout })?,
        };
        Ok((grid, self.elements))
    }

    fn in_place(&self, layout: GridLayout) -> Result<GridFile, SourceError> {
        let bytes = self.image.frame_bytes();
        let part = |slice: &Slice| Part {
            path: self.members[slice.file].path.clone(),
            // Cannot overflow: the length of the pixel data has been checked.
            offset: self.pixels[slice.file].offset + slice.frame * bytes,
        };
        let parts: Vec<Part> = self.slices.iter().map(part).collect();
        let follows = |pair: &[Part]| pair[0].path == pair[1].path && pair[0].offset + bytes == pair[1].offset;
        if parts.windows(2).all(follows) {
            return GridFile::single(&parts[0].path, open_data(&parts[0].path)?, parts[0].offset, layout);
        }
        GridFile::parts(self.path, parts, layout)
    }

    /// Size of a decoded slice in bytes.
    fn slice_bytes(&self) -> usize {
        let pixels = self.image.rows as usize * self.image.columns as usize;
        match self.scaling {
            Scaling::BySlice => pixels * size_of::<f32>(),
            Scaling::Same => index(self.image.frame_bytes()),
        }
    }

    /// Decodes frame after frame into a spool file.
    fn decode(&self) -> Result<File, SourceError> {
        let needed = self.image.frame_bytes().saturating_mul(FRAME_COPIES);
        if needed > self.options.memory_bytes {
            let image = &self.image;
            return Err(SourceError::Memory {
                what: format!("decoding frames of {} x {} of {}", image.columns, image.rows, self.path.display()),
                needed_bytes: needed,
                allowed_bytes: self.options.memory_bytes,
            });
        }
        let mut spool = Spool::create(self.options.spool)?;
        let mut opened: Option<(usize, Frames<'_>)> = None;
        for slice in self.slices {
            if slice.is_empty {
                spool.append(&vec![0; self.slice_bytes()])?;
                continue;
            }
            let (_, frames) = match opened.take().filter(|(file, _)| *file == slice.file) {
                Some(same) => opened.insert(same),
                None => {
                    let frames = Frames::open(&self.members[slice.file], self.pixels[slice.file], self.options.spool)?;
                    opened.insert((slice.file, frames))
                }
            };
            let mut numbers = frames.read(slice.frame)?;
            if self.scaling == Scaling::BySlice {
                numbers = self.scaled(slice, &numbers);
            }
            spool.append(&numbers)?;
        }
        spool.finish()
    }

    /// Values of a slice as f32; padding becomes absent.
    fn scaled(&self, slice: &Slice, numbers: &[u8]) -> Vec<u8> {
        let pixels = self.image.rows as usize * self.image.columns as usize;
        let mut voxels = vec![0; pixels * self.stored.bytes()];
        self.elements.convert(self.stored, numbers, &mut voxels);
        let (slope, intercept) = self.meaning.scaling(slice);
        let padding = self.members[slice.file].header.padding;
        let value = |stored: f64| if Some(stored) == padding { f32::NAN } else { single(stored * slope + intercept) };
        voxels_as_f64(self.stored, &voxels).into_iter().flat_map(|stored| value(stored).to_le_bytes()).collect()
    }
}

/// Type of the numbers of an image.
fn voxel_type(path: &Path, image: &Image, tag: u32) -> Result<VoxelType, SourceError> {
    match (tag, image.allocated, image.is_signed) {
        (FLOAT_PIXEL_DATA, 32, _) => Ok(VoxelType::F32),
        (DOUBLE_PIXEL_DATA, 64, _) => Ok(VoxelType::F64),
        (FLOAT_PIXEL_DATA | DOUBLE_PIXEL_DATA, ..) => {
            let found = format!("{} bits", image.allocated);
            Err(SourceError::invalid(path, "bits allocated (0028,0100)", "32 or 64 for floats", found))
        }
        (_, 8, false) => Ok(VoxelType::U8),
        (_, 8, true) => Ok(VoxelType::I8),
        (_, 16, false) => Ok(VoxelType::U16),
        (_, 16, true) => Ok(VoxelType::I16),
        (_, 32, false) => Ok(VoxelType::U32),
        (_, 32, true) => Ok(VoxelType::I32),
        (_, 1, _) => Ok(VoxelType::U8),
        (_, bits, _) => {
            let advice = "convert it first: segmentations for example with highdicom or 3D Slicer to NRRD";
            Err(SourceError::unsupported(path, format!("pixels of {bits} bits are not read"), advice))
        }
    }
}

/// Conversion of the words of an image: keeps the significant bits.
fn numbers(path: &Path, image: &Image, tag: u32, is_raw: bool) -> Result<Numbers, SourceError> {
    let Image { allocated, stored, high, is_signed, photometric, .. } = image;
    if is_raw && (photometric == "YBR_FULL_422" || photometric == "YBR_PARTIAL_422") {
        let what = format!("colours of which some are shared between pixels ({photometric}) are not read");
        return Err(SourceError::unsupported(
            path,
            what,
            "convert to RGB first, for example with `dcmconv` or gdcmconv",
        ));
    }
    let is_float = matches!(tag, FLOAT_PIXEL_DATA | DOUBLE_PIXEL_DATA);
    if is_float && !is_raw {
        return Err(SourceError::invalid(path, "pixels", "floats as they are", "floats in compressed frames"));
    }
    if image.has_bits() && !is_raw {
        let advice = "decompress it first, for example with `gdcmconv --raw` or `dcmdrle`";
        return Err(SourceError::unsupported(path, "single bits in compressed frames are not read", advice));
    }
    if is_float || stored == allocated {
        return Ok(Numbers::AsStored);
    }
    if *stored == 0 || stored > allocated || high >= allocated || high + 1 < *stored {
        let found = format!("{stored} of {allocated} bits, the highest {high}");
        return Err(SourceError::invalid(path, "bits stored (0028,0101)", "bits inside those allocated", found));
    }
    Ok(Numbers::Bits { low: high + 1 - stored, count: *stored, signed: *is_signed })
}
