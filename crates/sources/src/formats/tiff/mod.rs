//! TIFF stacks, with pages as slices, in classic TIFF and BigTIFF. Supported are strips and tiles; deflate, LZW,
//! PackBits, zstd, predictors and JPEG; integers of 8 to 64 bits, single bits and floats. The numbers of a pixel may be
//! adjacent or in separate planes. The spacing comes from ImageJ's description or OME-XML.
//!
//! Pages stored without compression and in one piece are read in place. So are the slices that ImageJ writes behind the
//! only page of a stack of more than 4 GiB. All others are decoded once into a spool file ([`crate::input::spool`]),
//! chunk by chunk. The first of several channels and times is used, with a note, unless `channel` and `frame`
//! select others. The first of several OME series is used, or `series`. Colours give their luminance, or one
//! channel. Pages that are smaller copies are skipped. Palette indices are the voxels. Single bits become the voxels 0
//! and 1; 64-bit integers the smallest type that holds all of them. White-is-zero pages are inverted, so that greater
//! is brighter, except masks by tifffile. Values are scaled as ImageJ's calibration or GDAL's metadata say; GDAL's nodata
//! is absent. The crate `tiff` decodes all but JPEG and zstd (`coded`). This module selects the pages of the volume.

mod coded;
mod description;
mod meaning;
mod page;

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use description::{Description, PAGES_LIMIT};
use supervol_format::{ByteSource, Dims, Geometry, VoxelBox, VoxelType};
use tiff::ColorType;
use tiff::decoder::{ChunkType, Decoder, DecodingResult, Limits};
use tiff::tags::{CompressionMethod, SampleFormat, Tag};

use crate::cast::index;
use crate::formats::format::{Certainty, Folder, Format, Found};
use crate::grid::dense::{GridFile, GridLayout, GridSource, Part, checked_bytes};
use crate::grid::elements::{Channels, Elements, Frames, Meaning, Number};
use crate::input::data_files::open_data;
use crate::input::file::SourceFile;
use crate::input::selection::{Choice, Selection};
use crate::input::spool::{Spool, SpoolFolder};
use crate::{Axis, Endian, Message, SourceError, SourceInfo, VolumeSource};
use coded::{CodedChunks, Compression};
pub(crate) use description::Calibration;
use page::{CHUNK_LIMIT_BYTES, Packing, refusal};
pub(crate) use page::{Page, RATIO_LIMIT};

/// Largest size of a field in bytes; it may be OME-XML of tens of thousands of planes.
const FIELD_LIMIT_BYTES: usize = 32 << 20;
/// Photometric interpretation of palette indices.
const PALETTE: u64 = 3;

/// First bytes of a TIFF and of a `BigTIFF`, in either byte order.
const STARTS: [&[u8]; 4] = [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"];

/// Whether a file is TIFF, by its first bytes.
pub(crate) fn is_tiff(head: &[u8]) -> bool {
    STARTS.iter().any(|start| head.starts_with(start))
}

/// Row of the table of formats.
pub const FORMAT: Format = Format {
    name: "tiff",
    title: "TIFF",
    endings: &[".tif", ".tiff"],
    choices: &[Choice::Series],
    sniff: |start, _| is_tiff(&start.bytes),
    certainty: Certainty::Certain,
    folder: Folder::Never,
    open: |path, options| Ok(Box::new(TiffSource::open(path, &options.spool, &options.selection)?)),
    found: |_| Found::Volume,
};

/// A TIFF stack.
#[derive(Debug)]
pub struct TiffSource(GridSource);

impl TiffSource {
    /// Opens a TIFF; encoded pages are decoded into `spool`.
    ///
    /// # Errors
    /// If the file cannot be read, breaks the format's rules, or does not hold a supported volume.
    pub fn open(path: &Path, spool: &SpoolFolder, selection: &Selection) -> Result<Self, SourceError> {
        let source_file = SourceFile::of(path)?;
        let mut pages = Pages::open(path)?;
        let described = pages.page()?;
        let description = Description::read(path, &pages.description()?, described.samples, selection)?;
        let mut notes = description.notes.clone();
        let (slices, behind) = pages.slices(&description, described, &mut notes)?;
        let first = pages.first_of(&slices, behind.is_some(), described)?;
        let channels = match first.samples {
            1 => Channels::ONE,
            samples => Channels::choose(path, samples, first.meaning, selection, &mut notes)?,
        };
        let geometry = pages.geometry(&description)?;
        let of_gdal = pages.of_gdal(channels.wanted.unwrap_or_default())?;
        if description == Description::default() {
            pages.note_resolution(&mut notes)?;
        }
        pages.note_bits(first, &mut notes)?;
        let dims = Dims([first.size[0], first.size[1], slices.len() as u64]);
        checked_bytes(path, dims, first.stored())?;
        let in_place = match behind {
            Some(offsets) => offsets,
            None => pages.offsets_in_place(&slices, first)?,
        };
        let plain = GridLayout {
            dims,
            voxel_type: first.stored(),
            endian: Endian::Little,
            fastest_first: GridLayout::X_FASTEST,
        };
        let layout = |endian| GridLayout { endian, ..Elements::widened(channels, Frames::ONE, plain) };
        let bytes = checked_bytes(path, layout(Endian::Little).dims, first.stored())?;
        let grid = match in_place[..] {
            [] => GridFile::single(path, pages.decode(&slices, first, bytes, spool)?, 0, layout(Endian::Little)),
            [offset] => GridFile::single(path, open_data(path)?, offset, layout(pages.endian())),
            _ => {
                let parts = in_place.iter().map(|&offset| Part { path: path.into(), offset });
                GridFile::parts(path, parts.collect(), layout(pages.endian()))
            }
        };
        let grid = grid?;
        let elements = Elements::of(path, &grid, first.number, (channels, Frames::ONE), &mut notes)?;

        let mut info = SourceInfo::plain("tiff", dims, elements.voxel_type);
        info.geometry = geometry;
        info.axes = ["x", "y", "z"].map(|name| Axis { name: name.into(), unit: description.unit.clone() });
        info.notes = notes;
        info.files = vec![source_file];
        let calibration = description.calibration.as_ref().filter(|_| !first.stored().is_float()).unwrap_or(&of_gdal);
        // The luminance of colours is no number of the file.
        if channels.wanted.is_some() {
            calibration.apply(&mut info);
        }
        Ok(Self(GridSource::with_elements(info, grid, elements)))
    }
}

impl VolumeSource for TiffSource {
    fn info(&self) -> &SourceInfo {
        self.0.info()
    }

    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        self.0.read_box(voxels, out)
    }
}

/// The pages of a file; one of them is the current page.
pub(crate) struct Pages<'a> {
    path: &'a Path,
    decoder: Decoder<BufReader<File>>,
    file_bytes: u64,
    /// Whether single bits are the voxels although white is zero.
    keeps_bits: bool,
}

impl<'a> Pages<'a> {
    pub(crate) fn open(path: &'a Path) -> Result<Self, SourceError> {
        let file = open_data(path)?;
        let file_bytes = file.len().map_err(|e| SourceError::io(path, e))?;
        let mut limits = Limits::default();
        (limits.decoding_buffer_size, limits.intermediate_buffer_size) = (CHUNK_LIMIT_BYTES, CHUNK_LIMIT_BYTES);
        // The crate allocates as many values as a field states, several times their bytes, before it reads them.
        limits.ifd_value_size = FIELD_LIMIT_BYTES.min(usize::try_from(file_bytes).unwrap_or(usize::MAX));
        let decoder = Decoder::new(BufReader::new(file)).map_err(|e| refusal(path, e))?.with_limits(limits);
        let mut pages = Self { path, decoder, file_bytes, keeps_bits: false };
        pages.choose_bits()?;
        Ok(pages)
    }

    fn tag(&mut self, tag: Tag) -> Result<Option<u64>, SourceError> {
        self.decoder.find_tag_unsigned(tag).map_err(|e| refusal(self.path, e))
    }

    /// Compression of the current page.
    fn compression(&mut self) -> Result<Compression, SourceError> {
        Compression::of(self.path, self.tag(Tag::Compression)?.unwrap_or(1))
    }

    /// Largest number of decoded bytes per byte of the file, for the current page.
    pub(crate) fn ratio_limit(&mut self, page: Page) -> Result<u64, SourceError> {
        let voxels_of_a_byte = if page.packing == Packing::Bits { 8 } else { 1 };
        Ok(self.compression()?.ratio_limit() * voxels_of_a_byte)
    }

    /// Properties of the current page.
    pub(crate) fn page(&mut self) -> Result<Page, SourceError> {
        let path = self.path;
        let compression = self.compression()?;
        let (width, height) = self.decoder.dimensions().map_err(|e| refusal(path, e))?;
        let is_in_planes = self.tag(Tag::PlanarConfiguration)?.is_some_and(|order| order != 1);
        let color = match self.tag(Tag::PhotometricInterpretation)? {
            // Palette indices are the voxels; the palette's colours are ignored. The decoder does not support palettes.
            Some(PALETTE) => {
                ColorType::Gray(self.tag(Tag::BitsPerSample)?.and_then(|n| n.try_into().ok()).unwrap_or(1))
            }
            _ => match self.decoder.colortype().map_err(|e| refusal(path, e))? {
                // Colour type after decoding.
                ColorType::YCbCr(bits) if compression == Compression::Jpeg && !is_in_planes => ColorType::RGB(bits),
                color => color,
            },
        };
        let formats = self.decoder.find_tag_unsigned_vec::<u16>(Tag::SampleFormat).map_err(|e| refusal(path, e))?;
        let format = formats.and_then(|formats| formats.first().copied()).unwrap_or(SampleFormat::Uint.to_u16());
        let unsupported = |what: String, advice: &str| Err(SourceError::unsupported(path, what, advice));
        let (samples, bits) = match color {
            ColorType::Gray(bits) => (1, bits),
            ColorType::GrayA(bits) => (2, bits),
            ColorType::RGB(bits) => (3, bits),
            ColorType::RGBA(bits) => (4, bits),
            ColorType::Multiband { bit_depth, num_samples } => (num_samples.into(), bit_depth),
            _ => {
                let advice = "convert to grey or RGB first, for example with Fiji (Image, Type)";
                return unsupported(format!("pixels are colours of a kind that is not read ({color:?})"), advice);
            }
        };
        let page = |number, packing| Page {
            size: [width.into(), height.into()],
            samples,
            number,
            packing,
            meaning: match color {
                ColorType::Multiband { .. } => Meaning::Components,
                _ => Meaning::Colours,
            },
        };
        let packing = if is_in_planes && samples > 1 { Packing::InPlanes } else { Packing::Together };
        let number = Number::Voxel(match (SampleFormat::from_u16_exhaustive(format), bits) {
            (SampleFormat::IEEEFP, 16) => return Ok(page(Number::Half, packing)),
            (SampleFormat::Uint, 64) => return Ok(page(Number::Whole { signed: false }, packing)),
            (SampleFormat::Int, 64) => return Ok(page(Number::Whole { signed: true }, packing)),
            (SampleFormat::Uint, 1) if samples == 1 => {
                return Ok(page(Number::Voxel(VoxelType::U8), Packing::Bits));
            }
            (SampleFormat::Uint, 8) => VoxelType::U8,
            (SampleFormat::Int, 8) => VoxelType::I8,
            (SampleFormat::Uint, 16) => VoxelType::U16,
            (SampleFormat::Int, 16) => VoxelType::I16,
            (SampleFormat::Uint, 32) => VoxelType::U32,
            (SampleFormat::Int, 32) => VoxelType::I32,
            (SampleFormat::IEEEFP, 32) => VoxelType::F32,
            (SampleFormat::IEEEFP, 64) => VoxelType::F64,
            (format, bits) => {
                let advice = "convert to 8, 16 or 32 bits, for example with Fiji (Image, Type)";
                return unsupported(format!("pixels of {bits} bits ({format:?}) have no voxel type here"), advice);
            }
        });
        Ok(page(number, packing))
    }

    /// Moves to the first page of the volume. It must have as many numbers per pixel as the page with the description.
    fn first_of(&mut self, slices: &[usize], is_behind: bool, described: Page) -> Result<Page, SourceError> {
        let Some(&slice) = slices.first().filter(|_| !is_behind) else { return Ok(described) };
        self.seek(slice)?;
        let first = self.page()?;
        if first.samples == described.samples {
            return Ok(first);
        }
        let expected = format!("{} numbers per pixel, as the first", described.samples);
        Err(SourceError::invalid(self.path, format!("page {slice}"), expected, first.samples.to_string()))
    }

    /// Description of the current page.
    fn description(&mut self) -> Result<String, SourceError> {
        let value = self.decoder.find_tag(Tag::ImageDescription).map_err(|e| refusal(self.path, e))?;
        // A field that is not text is ignored.
        Ok(value.and_then(|value| value.into_string().ok()).unwrap_or_default())
    }

    /// Numbers of the pages that are the slices of the volume. If these lie behind the only page, the offset of each, or
    /// of the first if they follow one another.
    fn slices(
        &mut self,
        description: &Description,
        page: Page,
        notes: &mut Vec<Message>,
    ) -> Result<(Vec<usize>, Option<Vec<u64>>), SourceError> {
        let wanted = description.slices.as_deref();
        let is_behind = |slices: &&[usize]| slices.iter().any(|slice| *slice > 0);
        if let Some(slices) = wanted.filter(is_behind)
            && !self.decoder.more_images()
        {
            return Ok((slices.to_vec(), Some(self.behind_the_page(slices, page)?)));
        }
        let whole = self.whole_pages(notes)?;
        let Some(wanted) = wanted else { return Ok((whole, None)) };
        // Descriptions do not count smaller copies.
        let page = |&slice: &usize| {
            whole.get(slice).copied().ok_or_else(|| {
                let found = format!("{} pages", whole.len());
                SourceError::invalid(
                    self.path,
                    "pages",
                    format!("page {slice}, which its description speaks of"),
                    found,
                )
            })
        };
        Ok((wanted.iter().map(page).collect::<Result<_, _>>()?, None))
    }

    /// Numbers of all pages that are not smaller copies. Afterwards the first page is the current one.
    pub(crate) fn whole_pages(&mut self, notes: &mut Vec<Message>) -> Result<Vec<usize>, SourceError> {
        let (mut whole, mut copies, mut number) = (Vec::new(), 0, 0);
        loop {
            let is_copy = self.tag(Tag::NewSubfileType)?.is_some_and(|kind| kind & 1 == 1) && number > 0;
            copies += usize::from(is_copy);
            whole.extend((!is_copy).then_some(number));
            if !self.decoder.more_images() {
                break;
            }
            number += 1;
            if number == PAGES_LIMIT {
                return Err(SourceError::invalid(self.path, "pages", format!("at most {PAGES_LIMIT}"), "more"));
            }
            self.decoder.next_image().map_err(|e| refusal(self.path, e))?;
        }
        if copies > 0 {
            notes.push(format!("{copies} pages are smaller copies of others and left out").into());
        }
        self.seek(0)?;
        Ok(whole)
    }

    fn seek(&mut self, page: usize) -> Result<(), SourceError> {
        self.decoder.seek_to_image(page).map_err(|e| refusal(self.path, e))
    }

    /// Offsets of the slices of an ImageJ stack of more than 4 GiB, which has one page, and all slices behind it.
    fn behind_the_page(&mut self, slices: &[usize], page: Page) -> Result<Vec<u64>, SourceError> {
        let (first, file_bytes) = (self.place_of_page(page)?, self.file_bytes);
        let follow_one_another = slices.windows(2).all(|pair| pair[0].checked_add(1) == Some(pair[1]));
        let offset = |slice: usize, first: u64| {
            let start = page.bytes().checked_mul(slice as u64)?.checked_add(first)?;
            // The length of the file is checked for a whole grid.
            let is_inside = |end: &u64| follow_one_another || *end <= file_bytes;
            start.checked_add(page.bytes()).filter(is_inside).map(|_| start)
        };
        let offsets: Option<Vec<u64>> =
            first.and_then(|first| slices.iter().map(|&slice| offset(slice, first)).collect());
        let Some(mut offsets) = offsets else {
            let last = slices.iter().max().map_or(0, |slice| slice + 1);
            let expected = format!("{last} pages, which its description speaks of");
            return Err(SourceError::invalid(self.path, "pages", expected, "one"));
        };
        if follow_one_another {
            offsets.truncate(1);
        }
        Ok(offsets)
    }

    /// Offset of each slice, or a single offset if they are contiguous; empty if the pages must be decoded.
    fn offsets_in_place(&mut self, slices: &[usize], like: Page) -> Result<Vec<u64>, SourceError> {
        let mut offsets = Vec::new();
        for &slice in slices {
            self.seek(slice)?;
            self.check_page(slice, like)?;
            match self.place_of_page(like)? {
                Some(offset) => offsets.push(offset),
                None => return Ok(Vec::new()),
            }
        }
        let follows = |pair: &[u64]| pair[0].checked_add(like.bytes()) == Some(pair[1]);
        if offsets.windows(2).all(follows) {
            offsets.truncate(1);
        }
        Ok(offsets)
    }

    /// Offset of the current page's pixels, if they are stored without encoding and in one piece.
    pub(crate) fn place_of_page(&mut self, page: Page) -> Result<Option<u64>, SourceError> {
        let path = self.path;
        let is_plain = self.tag(Tag::Compression)?.is_none_or(|c| c == u64::from(CompressionMethod::None.to_u16()));
        // The decoder inverts these.
        let is_inverted = self.tag(Tag::PhotometricInterpretation)? == Some(0);
        let is_other = is_inverted || page.packing != Packing::Together;
        if !is_plain || is_other || self.decoder.get_chunk_type() == ChunkType::Tile {
            return Ok(None);
        }
        let mut list = |tag| self.decoder.find_tag_unsigned_vec::<u64>(tag).map_err(|e| refusal(path, e));
        let (Some(offsets), Some(counts)) = (list(Tag::StripOffsets)?, list(Tag::StripByteCounts)?) else {
            return Ok(None);
        };
        let ends = offsets.iter().zip(&counts).map(|(offset, count)| offset.checked_add(*count));
        let is_one_piece = offsets.len() == counts.len()
            && offsets.iter().skip(1).zip(ends).all(|(next, end)| Some(*next) == end)
            && counts.iter().try_fold(0u64, |sum, count| sum.checked_add(*count)) == Some(page.bytes());
        Ok(offsets.first().copied().filter(|_| is_one_piece))
    }

    pub(crate) fn endian(&self) -> Endian {
        match self.decoder.byte_order() {
            tiff::tags::ByteOrder::LittleEndian => Endian::Little,
            tiff::tags::ByteOrder::BigEndian => Endian::Big,
        }
    }

    /// Refuses a current page that differs from the first.
    pub(crate) fn check_page(&mut self, number: usize, like: Page) -> Result<(), SourceError> {
        let page = self.page()?;
        if page == like {
            return Ok(());
        }
        let (expected, found) = (format!("{like}, as the first"), page.to_string());
        Err(SourceError::invalid(self.path, format!("page {number}"), expected, found))
    }

    /// Spacing from the description, else 1. Resolutions in dots per inch concern paper and are ignored.
    fn geometry(&mut self, description: &Description) -> Result<Geometry, SourceError> {
        let mut spacing = description.spacing;
        if description.has_resolution {
            for (i, tag) in [Tag::XResolution, Tag::YResolution].into_iter().enumerate() {
                spacing[i] = self.per_unit(tag)?.map(|n| 1.0 / n).filter(|s| s.is_finite() && *s > 0.0);
            }
        }
        // ImageJ omits the distance of slices if it is 1.
        let spacing = spacing.map(|s| s.filter(|s| s.is_finite() && *s > 0.0).unwrap_or(1.0));
        Ok(Geometry { spacing, ..Geometry::IDENTITY })
    }

    /// Decodes pages, one after the other, into a spool file.
    fn decode(&mut self, slices: &[usize], like: Page, bytes: u64, spool: &SpoolFolder) -> Result<File, SourceError> {
        self.seek(slices.first().copied().unwrap_or_default())?;
        let ceiling = self.file_bytes.saturating_mul(self.ratio_limit(like)?);
        if bytes > ceiling {
            let found = format!("a file of {} bytes, which holds at most {ceiling}", self.file_bytes);
            return Err(SourceError::invalid(self.path, "voxels", format!("{bytes} bytes"), found));
        }
        let mut spool = Spool::create(spool)?;
        for &slice in slices {
            self.seek(slice)?;
            self.check_page(slice, like)?;
            self.decode_page(slice, like, &mut spool)?;
        }
        spool.finish()
    }

    /// Appends a page, one band of chunks at a time.
    pub(crate) fn decode_page(&mut self, number: usize, page: Page, spool: &mut Spool) -> Result<(), SourceError> {
        let path = self.path;
        let (chunk_width, chunk_height) = self.decoder.chunk_dimensions();
        let is_tiled = self.decoder.get_chunk_type() == ChunkType::Tile;
        let across = if is_tiled { page.size[0].div_ceil(u64::from(chunk_width.max(1))) } else { 1 };
        let bands = page.size[1].div_ceil(u64::from(chunk_height.max(1)));
        let row_bytes = index(page.size[0]) * page.pixel_bytes();
        let band_bytes = row_bytes.saturating_mul(index(u64::from(chunk_height).min(page.size[1])));
        if band_bytes > CHUNK_LIMIT_BYTES {
            let advice = "rewrite it with smaller strips or tiles, for example with `tiffcp -r 16 IN OUT`";
            let what = format!("strips or rows of tiles of {band_bytes} bytes; {CHUNK_LIMIT_BYTES} are read at once");
            return Err(SourceError::unsupported(path, what, advice));
        }
        let (compression, endian) = (self.compression()?, self.endian());
        let mut coded = CodedChunks::of(path, &mut self.decoder, (page, endian), compression)?;
        // Allocated only after a chunk has been found to exist.
        let mut band = Vec::new();
        for band_number in 0..bands {
            let mut rows = 0;
            for (plane, column) in (0..page.planes()).flat_map(|plane| (0..across).map(move |column| (plane, column))) {
                let of_first = band_number.saturating_mul(across).saturating_add(column);
                let chunk = plane.saturating_mul(bands).saturating_mul(across).saturating_add(of_first);
                let [of_first, chunk] = [of_first, chunk].map(u32::try_from);
                let [of_first, chunk] = [of_first.map_err(|_| self.too_many())?, chunk.map_err(|_| self.too_many())?];
                let piece = self.piece(page, of_first, chunk, coded.as_mut())?;
                band.resize(band_bytes, 0);
                let start = index(column) * chunk_width as usize;
                let is_first = (plane, column) == (0, 0);
                if !piece.put(page, (plane, start), &mut band) || !(is_first || rows == piece.size[1]) {
                    let found = format!("{} x {} pixels in {} bytes", piece.size[0], piece.size[1], piece.voxels.len());
                    let location = format!("page {number}, chunk {chunk}");
                    return Err(SourceError::invalid(path, location, format!("pixels of {page}"), found));
                }
                rows = piece.size[1];
            }
            spool.append(&band[..row_bytes * rows])?;
        }
        Ok(())
    }

    /// A decoded chunk, with the size of the first plane's chunk at its place. For later planes the decoder does not
    /// cut off rows below the page.
    fn piece(
        &mut self,
        page: Page,
        of_first: u32,
        chunk: u32,
        coded: Option<&mut CodedChunks>,
    ) -> Result<Piece, SourceError> {
        let whole = |(width, height): (u32, u32)| [width as usize, height as usize];
        let size = whole(self.decoder.chunk_data_dimensions(of_first));
        let (decoded, voxels) = match coded {
            Some(coded) => {
                let [width, height] = whole(self.decoder.chunk_dimensions());
                let is_tiled = self.decoder.get_chunk_type() == ChunkType::Tile;
                let most = [width, if is_tiled { height } else { height.min(index(page.size[1])) }];
                coded.decode(self.path, self.decoder.inner().get_ref(), chunk, most)?
            }
            None => {
                let decoded = whole(self.decoder.chunk_data_dimensions(chunk));
                (decoded, little_endian(self.decoder.read_chunk(chunk).map_err(|e| refusal(self.path, e))?))
            }
        };
        let mut voxels = if page.packing == Packing::Bits { unpacked(&voxels, decoded) } else { voxels };
        if self.keeps_bits && page.packing == Packing::Bits {
            // The decoder has inverted them.
            voxels.iter_mut().for_each(|bit| *bit = 1 - *bit);
        }
        Ok(Piece { size, decoded, voxels })
    }

    fn too_many(&self) -> SourceError {
        SourceError::invalid(self.path, "chunks", "fewer than 2^32 in a page", "more")
    }
}

/// A decoded chunk of a page.
struct Piece {
    /// Size in pixels along x and y of the part inside the page.
    size: [usize; 2],
    /// Size in pixels of the decoded chunk.
    decoded: [usize; 2],
    voxels: Vec<u8>,
}

impl Piece {
    /// Copies the pixels into a band of rows of the page, from pixel `start` of each row on. Returns false if the
    /// number of pixels is wrong.
    fn put(&self, page: Page, (plane, start): (u64, usize), band: &mut [u8]) -> bool {
        let ([width, height], [decoded_width, decoded_height]) = (self.size, self.decoded);
        let pixel_bytes = page.pixel_bytes();
        // A piece of a plane holds only that plane's numbers of a pixel.
        let piece_bytes = page.piece_bytes();
        let row_bytes = index(page.size[0]) * pixel_bytes;
        let is_whole = Some(self.voxels.len())
            == decoded_width.checked_mul(decoded_height).and_then(|pixels| pixels.checked_mul(piece_bytes));
        let is_inside = width <= decoded_width && height <= decoded_height;
        let fits = start + width <= index(page.size[0]) && row_bytes * height <= band.len();
        if !(is_whole && is_inside && fits) || width == 0 {
            return false;
        }
        for (row, from) in self.voxels.chunks_exact(decoded_width * piece_bytes).take(height).enumerate() {
            let into = &mut band[row * row_bytes + start * pixel_bytes..][..width * pixel_bytes];
            if piece_bytes == pixel_bytes {
                into.copy_from_slice(&from[..into.len()]);
                continue;
            }
            let at = index(plane) * piece_bytes;
            for (pixel, number) in into.chunks_exact_mut(pixel_bytes).zip(from.chunks_exact(piece_bytes)) {
                pixel[at..at + piece_bytes].copy_from_slice(number);
            }
        }
        true
    }
}

/// One byte per bit, the highest bit of a byte first; each row begins at a byte boundary.
fn unpacked(bytes: &[u8], [width, height]: [usize; 2]) -> Vec<u8> {
    let rows = bytes.chunks(width.div_ceil(8).max(1)).take(height);
    rows.flat_map(|row| row.iter().flat_map(|byte| (0..8).rev().map(move |bit| byte >> bit & 1)).take(width)).collect()
}

/// Decoded numbers as little-endian bytes.
fn little_endian(mut voxels: DecodingResult) -> Vec<u8> {
    let buffer = voxels.as_buffer(0);
    let mut bytes = buffer.as_bytes().to_vec();
    if cfg!(target_endian = "big") {
        let size = match voxels {
            DecodingResult::U8(_) | DecodingResult::I8(_) => 1,
            DecodingResult::U16(_) | DecodingResult::I16(_) | DecodingResult::F16(_) => 2,
            DecodingResult::U32(_) | DecodingResult::I32(_) | DecodingResult::F32(_) => 4,
            DecodingResult::U64(_) | DecodingResult::I64(_) | DecodingResult::F64(_) => 8,
        };
        bytes.chunks_exact_mut(size).for_each(<[u8]>::reverse);
    }
    bytes
}
