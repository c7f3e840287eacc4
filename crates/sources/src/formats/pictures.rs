//! Folders of pictures as slices, in natural order (`s9` before `s10`), and single pictures: PNG, JPEG, TIFF.
//!
//! All pictures must have the same format, size and type. Other files are skipped, with a note. Colours give their
//! luminance, or one channel. Palette indices, and pixels of fewer than eight bits, are voxels as stored. Pictures do
//! not state the distance of slices; `spacing` does. Uncompressed TIFF is read in place. All else is decoded once
//! into a spool file, one picture at a time, by the crates `png`, `jpeg-decoder` and `tiff`.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

use jpeg_decoder::PixelFormat;
use png::{BitDepth, ColorType};
use supervol_format::{Dims, VoxelBox, VoxelType};

use super::tiff::{Calibration, Page, Pages, RATIO_LIMIT, is_tiff};
use crate::cast::index;
use crate::formats::format::{Certainty, Folder, Format, Found};
use crate::grid::dense::{GridFile, GridLayout, GridSource, Part, checked_bytes, swap_bytes};
use crate::grid::elements::{Channels, Elements, Frames, Number};
use crate::input::data_files::Outside;
use crate::input::file::SourceFile;
use crate::input::folder::{FolderDepth, FolderOptions, Listing};
use crate::input::spool::Spool;
use crate::{Endian, Message, SourceError, SourceInfo, VolumeSource};

/// Copies of a picture's pixels in memory while it is decoded.
const PICTURE_COPIES: u64 = 3;

/// Picture formats.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Png,
    Jpeg,
    Tiff,
}

impl Kind {
    /// The format of a file that begins with `head`.
    fn of(head: &[u8]) -> Option<Self> {
        if head.starts_with(b"\x89PNG\r\n\x1a\n") {
            return Some(Self::Png);
        }
        if head.starts_with(b"\xff\xd8\xff") {
            return Some(Self::Jpeg);
        }
        is_tiff(head).then_some(Self::Tiff)
    }

    fn name(self) -> &'static str {
        match self {
            Self::Png => "PNG",
            Self::Jpeg => "JPEG",
            Self::Tiff => "TIFF",
        }
    }
}

/// Row of the table of formats.
pub const FORMAT: Format = Format {
    name: "pictures",
    title: "PNG, JPEG",
    endings: &[".png", ".jpg", ".jpeg"],
    choices: &[],
    sniff: |start, _| Kind::of(&start.bytes).is_some(),
    certainty: Certainty::Certain,
    folder: Folder::ByFiles {
        title: "pictures",
        sniff: |files| files.any_start(|start| Kind::of(&start.bytes).is_some()),
    },
    open: |path, options| Ok(Box::new(PicturesSource::open(path, &options.of_folders())?)),
    found: |_| Found::Picture,
};

/// A folder of pictures, or a single one.
#[derive(Debug)]
pub struct PicturesSource(GridSource);

impl PicturesSource {
    /// Opens a folder of pictures, or one picture.
    ///
    /// # Errors
    /// If there is no picture, if pictures differ in format, size or type, or if one cannot be decoded.
    pub fn open(path: &Path, options: &FolderOptions<'_>) -> Result<Self, SourceError> {
        options.selection.refuse_array(path)?;
        options.selection.frame_of(path, 1)?;
        let mut notes = Vec::new();
        let (files, kind) = files(path, options.outside, &mut notes)?;
        let first = Picture::open(&files[0], kind)?.page(&files[0])?;
        let channels = Channels::choose(path, first.samples, first.meaning, options.selection, &mut notes)?;
        let dims = Dims([first.size[0], first.size[1], files.len() as u64]);
        let plain = GridLayout {
            dims,
            voxel_type: first.stored(),
            endian: Endian::Little,
            fastest_first: GridLayout::X_FASTEST,
        };
        let layout = Elements::widened(channels, Frames::ONE, plain);
        checked_bytes(path, layout.dims, layout.voxel_type)?;
        let source_files = files.iter().map(|file| SourceFile::of(file)).collect::<Result<_, _>>()?;
        let grid = match in_place(&files, kind, first)? {
            Some((parts, endian)) => GridFile::parts(path, parts, GridLayout { endian, ..layout })?,
            None => GridFile::single(path, decode(&files, kind, first, options)?, 0, layout)?,
        };
        let elements = Elements::of(path, &grid, first.number, (channels, Frames::ONE), &mut notes)?;
        let mut info = SourceInfo::plain("pictures", dims, elements.voxel_type);
        let calibration = calibration(&files, (kind, first), channels, &mut notes)?;
        info.notes = notes;
        calibration.apply(&mut info);
        info.memory_bytes = (size_of::<Part>() + size_of::<SourceFile>() + 256) as u64 * files.len() as u64;
        info.folder = path.is_dir().then(|| path.into());
        info.files = source_files;
        Ok(Self(GridSource::with_elements(info, grid, elements)))
    }
}

impl VolumeSource for PicturesSource {
    fn info(&self) -> &SourceInfo {
        self.0.info()
    }

    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        self.0.read_box(voxels, out)
    }
}

/// Meaning of the numbers of all slices, if the first and the last agree. Other pictures than TIFF state none.
fn calibration(
    files: &[PathBuf],
    (kind, page): (Kind, Page),
    channels: Channels,
    notes: &mut Vec<Message>,
) -> Result<Calibration, SourceError> {
    let of = |file: &PathBuf, notes: &mut Vec<Message>| {
        let (Picture::Tiff(mut pages), Some(channel)) = (Picture::open(file, kind)?, channels.wanted) else {
            return Ok(Calibration::default());
        };
        pages.note_bits(page, notes)?;
        pages.calibration(page, channel, notes)
    };
    let first = of(&files[0], notes)?;
    if of(&files[files.len() - 1], &mut Vec::new())? == first {
        return Ok(first);
    }
    notes.push("slices are calibrated differently: values are as stored".into());
    Ok(Calibration::default())
}

/// The pictures of a folder, which must have the same format.
fn files(path: &Path, outside: Outside, notes: &mut Vec<Message>) -> Result<(Vec<PathBuf>, Kind), SourceError> {
    let listing = if path.is_dir() { Listing::of(path, FolderDepth::Flat, outside)? } else { Listing::one(path) };
    listing.note(notes);
    let (mut pictures, mut others) = (Vec::new(), 0);
    for file in listing.files {
        let mut head = Vec::new();
        let opened = File::open(&file).map_err(|e| SourceError::io(&file, e))?;
        opened.take(8).read_to_end(&mut head).map_err(|e| SourceError::io(&file, e))?;
        match Kind::of(&head) {
            Some(kind) => pictures.push((file, kind)),
            None => others += 1,
        }
    }
    let Some(&(_, kind)) = pictures.first() else {
        return Err(SourceError::invalid(
            path,
            "folder",
            "pictures (PNG, JPEG, TIFF)",
            format!("{others} other files"),
        ));
    };
    if let Some((_, other)) = pictures.iter().find(|(_, other)| *other != kind) {
        let count = |kind| pictures.iter().filter(|(_, of)| *of == kind).count();
        let found = format!("{} {} and {} {}", count(kind), kind.name(), count(*other), other.name());
        return Err(SourceError::invalid(path, "folder", "pictures of one format", found));
    }
    if others > 0 {
        notes.push(format!("{others} files of the folder are no pictures and are left out").into());
    }
    Ok((pictures.into_iter().map(|(file, _)| file).collect(), kind))
}

/// Positions of the pixels of all pictures, if they lie in the files without encoding and in one byte order.
fn in_place(files: &[PathBuf], kind: Kind, first: Page) -> Result<Option<(Vec<Part>, Endian)>, SourceError> {
    let (mut parts, mut order) = (Vec::new(), None);
    for path in files {
        let Picture::Tiff(mut pages) = Picture::open(path, kind)? else { return Ok(None) };
        pages.check_page(0, first)?;
        let endian = *order.get_or_insert(pages.endian());
        match pages.place_of_page(first)? {
            Some(offset) if pages.endian() == endian => parts.push(Part { path: path.clone(), offset }),
            _ => return Ok(None),
        }
    }
    Ok(order.map(|endian| (parts, endian)))
}

/// Decodes picture after picture into a spool file.
fn decode(files: &[PathBuf], kind: Kind, first: Page, options: &FolderOptions<'_>) -> Result<File, SourceError> {
    let needed = first.bytes().saturating_mul(PICTURE_COPIES);
    if needed > options.memory_bytes {
        let [width, height] = first.size;
        return Err(SourceError::Memory {
            what: format!("decoding pictures of {width} x {height}"),
            needed_bytes: needed,
            allowed_bytes: options.memory_bytes,
        });
    }
    let mut spool = Spool::create(options.spool)?;
    for file in files {
        let mut picture = Picture::open(file, kind)?;
        let page = picture.page(file)?;
        let file_bytes = std::fs::metadata(file).map_err(|e| SourceError::io(file, e))?.len();
        if page.bytes() > file_bytes.saturating_mul(picture.ratio_limit(page)?) {
            let found = format!("a file of {file_bytes} bytes, which cannot hold them");
            return Err(SourceError::invalid(file, "picture", page.to_string(), found));
        }
        if page != first {
            let expected = format!("{}, as {}", first, files[0].display());
            return Err(SourceError::invalid(file, "picture", expected, page.to_string()));
        }
        picture.decode(file, page, &mut spool)?;
    }
    spool.finish()
}

/// An open picture whose header has been read.
enum Picture<'a> {
    Png(Box<png::Reader<BufReader<File>>>),
    Jpeg(Box<jpeg_decoder::Decoder<BufReader<File>>>),
    Tiff(Box<Pages<'a>>),
}

impl<'a> Picture<'a> {
    fn open(path: &'a Path, kind: Kind) -> Result<Self, SourceError> {
        let file = || File::open(path).map(BufReader::new).map_err(|e| SourceError::io(path, e));
        Ok(match kind {
            Kind::Tiff => {
                let mut pages = Pages::open(path)?;
                let count = pages.whole_pages(&mut Vec::new())?.len();
                if count > 1 {
                    let advice = "give it alone, as a stack; a folder holds one slice in each file";
                    return Err(SourceError::unsupported(path, format!("it has {count} pages"), advice));
                }
                Self::Tiff(Box::new(pages))
            }
            Kind::Png => {
                let reader = png::Decoder::new(file()?).read_info();
                Self::Png(Box::new(reader.map_err(|e| of_png(path, e))?))
            }
            Kind::Jpeg => {
                let mut decoder = jpeg_decoder::Decoder::new(file()?);
                decoder.read_info().map_err(|e| of_jpeg(path, e))?;
                Self::Jpeg(Box::new(decoder))
            }
        })
    }

    /// Size and type of the picture.
    fn page(&mut self, path: &Path) -> Result<Page, SourceError> {
        match self {
            Self::Tiff(pages) => pages.page(),
            Self::Png(reader) => {
                let info = reader.info();
                let samples = match info.color_type {
                    ColorType::Grayscale | ColorType::Indexed => 1,
                    ColorType::GrayscaleAlpha => 2,
                    ColorType::Rgb => 3,
                    ColorType::Rgba => 4,
                };
                let voxel_type = if info.bit_depth == BitDepth::Sixteen { VoxelType::U16 } else { VoxelType::U8 };
                Ok(Page::plain([info.width.into(), info.height.into()], samples, Number::Voxel(voxel_type)))
            }
            Self::Jpeg(decoder) => {
                let info = decoder.info().ok_or_else(|| SourceError::invalid(path, "JPEG", "a header", "none"))?;
                let (samples, voxel_type) = match info.pixel_format {
                    PixelFormat::L8 => (1, VoxelType::U8),
                    PixelFormat::L16 => (1, VoxelType::U16),
                    PixelFormat::RGB24 => (3, VoxelType::U8),
                    PixelFormat::CMYK32 => {
                        let advice = "convert it to RGB or grey first";
                        return Err(SourceError::unsupported(path, "colours are inks (CMYK)", advice));
                    }
                };
                Ok(Page::plain([info.width.into(), info.height.into()], samples, Number::Voxel(voxel_type)))
            }
        }
    }

    /// Largest number of decoded bytes per byte of the file.
    fn ratio_limit(&mut self, page: Page) -> Result<u64, SourceError> {
        match self {
            Self::Tiff(pages) => pages.ratio_limit(page),
            Self::Png(_) | Self::Jpeg(_) => Ok(RATIO_LIMIT),
        }
    }

    /// Appends the decoded pixels, little endian.
    fn decode(&mut self, path: &Path, page: Page, spool: &mut Spool) -> Result<(), SourceError> {
        let pixels = match self {
            Self::Tiff(pages) => return pages.decode_page(0, page, spool),
            Self::Png(reader) => decode_png(reader, page).map_err(|e| of_png(path, e))?,
            Self::Jpeg(decoder) => {
                let mut pixels = decoder.decode().map_err(|e| of_jpeg(path, e))?;
                if cfg!(target_endian = "big") {
                    swap_bytes(&mut pixels, page.stored().bytes());
                }
                pixels
            }
        };
        if pixels.len() as u64 != page.bytes() {
            let found = format!("{} bytes", pixels.len());
            return Err(SourceError::invalid(path, "decoded picture", format!("{} bytes", page.bytes()), found));
        }
        spool.append(&pixels)
    }
}

fn decode_png(reader: &mut png::Reader<BufReader<File>>, page: Page) -> Result<Vec<u8>, png::DecodingError> {
    let too_large = || png::DecodingError::LimitsExceeded;
    let mut pixels = vec![0; reader.output_buffer_size().ok_or_else(too_large)?];
    let (row_bytes, depth) = (reader.output_line_size(reader.info().width).unwrap_or(1), reader.info().bit_depth);
    reader.next_frame(&mut pixels)?;
    if depth == BitDepth::Sixteen {
        swap_bytes(&mut pixels, 2);
    }
    let bits = depth as usize;
    if bits >= 8 {
        return Ok(pixels);
    }
    // Each row begins at a byte boundary; the first pixel has the highest bits.
    let width = index(page.size[0]);
    let pixel = |row: &[u8], x: usize| row[x * bits / 8] >> (8 - bits - x * bits % 8) & ((1 << bits) - 1);
    Ok(pixels
        .chunks_exact(row_bytes.max(1))
        .flat_map(|row| (0..width).map(|x| pixel(row, x)).collect::<Vec<_>>())
        .collect())
}

fn of_png(path: &Path, error: png::DecodingError) -> SourceError {
    match error {
        png::DecodingError::IoError(e) if e.kind() != std::io::ErrorKind::UnexpectedEof => SourceError::io(path, e),
        other => SourceError::invalid(path, "PNG", "what the format allows", other.to_string()),
    }
}

fn of_jpeg(path: &Path, error: jpeg_decoder::Error) -> SourceError {
    match error {
        jpeg_decoder::Error::Io(e) if e.kind() != std::io::ErrorKind::UnexpectedEof => SourceError::io(path, e),
        jpeg_decoder::Error::Unsupported(what) => {
            let advice = "convert it to PNG first";
            SourceError::unsupported(path, format!("this kind of JPEG is not read ({what:?})"), advice)
        }
        other => SourceError::invalid(path, "JPEG", "what the format allows", other.to_string()),
    }
}
