//! VTK images: `.vti` and legacy `.vtk` of structured points. A `.vti` is XML; its arrays are raw, base64 or text,
//! inline or appended, uncompressed or compressed by zlib or LZ4. Legacy files are binary or text.
//!
//! Raw arrays are read in place. All else is decoded once into a spool file ([`crate::input::spool`]), block by block.
//! If there are several arrays, the active scalars are used, or the named array (`FILE.vti:/NAME`). `channel` selects
//! one of several components. Cell data are voxels between the points. Origin, spacing and direction are the file's.
//! 64-bit integers are kept in the smallest type that holds all of them. Several pieces, LZMA, meshes and grids with
//! uneven distances are refused by name. Written by hand: `vtkio` reads whole files into memory and depends on
//! unmaintained parsers.

mod blocks;
mod header;
mod legacy;
mod xml;

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use supervol_format::{ByteSource, VoxelBox, VoxelType};

use crate::cast::{self, low_8, low_32};
use crate::formats::format::{Certainty, Folder, Format, Found};
use crate::grid::dense::{GridFile, GridLayout, GridSource, checked_bytes};
use crate::grid::elements::{Channels, Elements, Frames, Meaning, Number};
use crate::input::data_files::open_data;
use crate::input::file::SourceFile;
use crate::input::selection::{Choice, Selection};
use crate::input::spool::{Excess, Spool, SpoolFolder, TextNumbers, Words, parse_voxel};
use crate::input::start::FileStart;
use crate::{Endian, SourceError, SourceInfo, VolumeSource};
use blocks::{EncodedArray, UpTo};
use header::{Array, Blocks, Encoding, Header, number};

/// First bytes of a legacy file.
const LEGACY_START: &[u8] = b"# vtk DataFile";

/// Row of the table of formats.
pub const FORMAT: Format = Format {
    name: "vtk",
    title: "VTK",
    endings: &[".vti", ".vtk"],
    choices: &[Choice::Array],
    sniff: |start, _| {
        let is_xml = start.text_begins_with(b"<?xml") || start.text_begins_with(b"<VTKFile");
        start.begins_with(LEGACY_START) || start.is_named(&[".vti"]) || is_xml && start.holds(b"<VTKFile")
    },
    certainty: Certainty::Certain,
    folder: Folder::Never,
    open: |path, options| Ok(Box::new(VtkSource::open(path, &options.spool, &options.selection)?)),
    found: |_| Found::Volume,
};

/// A VTK image.
#[derive(Debug)]
pub struct VtkSource(GridSource);

impl VtkSource {
    /// Opens a VTK image; encoded arrays are decoded into `spool`.
    ///
    /// # Errors
    /// If the file cannot be read, breaks the format's rules, or does not hold a supported volume.
    pub fn open(path: &Path, spool: &SpoolFolder, selection: &Selection) -> Result<Self, SourceError> {
        let source_file = SourceFile::of(path)?;
        let is_legacy = FileStart::of(path)?.begins_with(LEGACY_START);
        let reader = BufReader::new(open_data(path)?);
        let header = if is_legacy { legacy::read(path, reader)? } else { xml::read(path, reader)? };
        let mut notes = Vec::new();
        let array = header.choose(path, selection, &mut notes)?;
        selection.frame_of(path, 1)?;
        let meaning = if array.is_colour { Meaning::Colours } else { Meaning::Components };
        let channels = Channels::choose(path, array.components, meaning, selection, &mut notes)?;
        let plain = GridLayout {
            dims: header.dims(array),
            voxel_type: array.number.stored(),
            endian: header.endian,
            fastest_first: GridLayout::X_FASTEST,
        };
        checked_bytes(path, plain.dims, plain.voxel_type)?;
        let layout = Elements::widened(channels, Frames::ONE, plain);
        let bytes = checked_bytes(path, layout.dims, layout.voxel_type)?;
        let grid = header.grid(path, array, layout, bytes, spool)?;
        // Text has been read as doubles.
        let number = if array.encoding == Encoding::Text { Number::Voxel(plain.voxel_type) } else { array.number };
        let elements = Elements::of(path, &grid, number, (channels, Frames::ONE), &mut notes)?;
        let mut info = SourceInfo::plain("vtk", plain.dims, elements.voxel_type);
        info.geometry = header.placed(path, array)?;
        if array.is_of_cells {
            notes.push("voxels are the file's cells: half a spacing from its points".into());
        }
        info.notes = notes;
        info.files = vec![source_file];
        Ok(Self(GridSource::with_elements(info, grid, elements)))
    }
}

impl VolumeSource for VtkSource {
    fn info(&self) -> &SourceInfo {
        self.0.info()
    }

    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        self.0.read_box(voxels, out)
    }
}

impl Header {
    fn grid(
        &self,
        path: &Path,
        array: &Array,
        layout: GridLayout,
        bytes: u64,
        spool: &SpoolFolder,
    ) -> Result<GridFile, SourceError> {
        let file = open_data(path)?;
        let is_raw = array.encoding == Encoding::Raw;
        match self.blocks {
            None if is_raw => return GridFile::single(path, file, array.offset, layout),
            Some(Blocks { word_bytes, compressor: None }) if is_raw => {
                let stated = word(path, &file, array.offset, word_bytes, self.endian)?;
                if stated != bytes {
                    let expected = format!("{bytes} bytes");
                    return Err(SourceError::invalid(path, "bytes of the array", expected, format!("{stated} bytes")));
                }
                return GridFile::single(path, file, array.offset + word_bytes as u64, layout);
            }
            _ => {}
        }
        let mut decoded = Spool::create(spool)?;
        if let Encoding::Text | Encoding::Shares = array.encoding {
            let left = file.len().map_err(|e| SourceError::io(path, e))?.saturating_sub(array.offset);
            let numbers = bytes / layout.voxel_type.bytes() as u64;
            // A number takes at least a digit and a separator.
            if left.saturating_add(1) / 2 < numbers {
                let found = format!("{left} bytes of text");
                return Err(SourceError::invalid(path, "text data", format!("{numbers} numbers"), found));
            }
            let text = UpTo::new(path, file, array.offset)?;
            // In a legacy file other arrays may follow directly.
            let excess = if self.blocks.is_some() { Excess::Refused } else { Excess::Expected };
            let voxel_type = layout.voxel_type;
            let numbers = TextNumbers { voxel_type, voxels: numbers, words: Words::Shown, excess };
            let read = if array.encoding == Encoding::Shares { share } else { parse_voxel };
            decoded.append_words(path, BufReader::new(text), numbers, read)?;
            let layout = GridLayout { endian: Endian::Little, ..layout };
            return GridFile::single(path, decoded.finish()?, 0, layout);
        }
        let blocks = self.blocks.unwrap_or(Blocks { word_bytes: 4, compressor: None });
        let encoded = EncodedArray { path, file, array, blocks, endian: self.endian, bytes };
        encoded.decode(&mut decoded)?;
        GridFile::single(path, decoded.finish()?, 0, layout)
    }
}

/// Parses a fraction between 0 and 1 and writes it as a fraction of 255.
fn share(word: &str, _: VoxelType, out: &mut [u8]) -> bool {
    let share = word.parse::<f64>().ok().filter(|share| (0.0..=1.0).contains(share));
    // The rounded result is at most 255.
    share.map(|share| out[0] = low_8(low_32(cast::whole::<u64>((share * f64::from(u8::MAX)).round())))).is_some()
}

/// Reads a word of `bytes` bytes at offset `at` of a file.
fn word(path: &Path, file: &File, at: u64, bytes: usize, endian: Endian) -> Result<u64, SourceError> {
    let mut word = [0; 8];
    file.read_exact_at(at, &mut word[..bytes]).map_err(|e| match e.kind() {
        std::io::ErrorKind::UnexpectedEof => SourceError::invalid(path, format!("byte {at}"), "an array", "the end"),
        _ => SourceError::io(path, e),
    })?;
    Ok(number(&word[..bytes], endian))
}
