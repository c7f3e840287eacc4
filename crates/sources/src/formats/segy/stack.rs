//! Pre-stack files: the offsets of a file, and the mean over all offsets.
//!
//! Each offset is a volume on the grid of all traces. Its voxels are absent where it has no live trace. The mean is
//! over the present voxels, as f32, or as f64 for 32-bit integers and doubles. A voxel that is absent in all is NaN.

use std::collections::BTreeSet;
use std::io;
use std::path::Path;
use std::sync::Arc;

use supervol_format::file_order::boxes;
use supervol_format::voxel_type::{Absence, Voxel, voxels_as_f64};
use supervol_format::{ByteSource, VoxelBox, VoxelType, with_voxel};

use super::fields::Fields;
use super::file_header::read_file_header;
use super::grid::Wanted;
use super::input::Input;
use super::layout::Layout;
use super::options::{Offsets, SegyOptions};
use super::scan::for_each_header;
use super::source::SegySource;
use crate::{Message, ReadOption, SourceError, SourceInfo, VolumeSource};

/// Largest number of offsets that are averaged: each has a table of traces.
const OFFSETS_LIMIT: usize = 256;
/// Voxels that are averaged at once.
const PART_VOXELS: u64 = 1 << 18;

/// Bytes that several readers share.
#[derive(Clone)]
struct Shared(Arc<dyn ByteSource>);

impl ByteSource for Shared {
    fn len(&self) -> io::Result<u64> {
        self.0.len()
    }

    fn read_exact_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<()> {
        self.0.read_exact_at(offset, buffer)
    }
}

/// The mean over all offsets.
pub(super) struct Stack {
    offsets: Vec<SegySource>,
    pub(super) info: SourceInfo,
}

impl Stack {
    pub(super) fn from_bytes(
        bytes: Box<dyn ByteSource>,
        path: &Path,
        options: &SegyOptions,
    ) -> Result<Self, SourceError> {
        let bytes = Shared(bytes.into());
        if options.offsets != Offsets::Stack {
            return Self::of_duplicates(&bytes, path, options);
        }
        let numbers = offsets(Input { path, bytes: &bytes }, options)?;
        let memory_bytes = options.memory_bytes / numbers.len() as u64;
        let one = |number: &i32| {
            let options = SegyOptions { offsets: Offsets::One(*number), memory_bytes, ..options.clone() };
            SegySource::from_bytes(Box::new(bytes.clone()), path, &options)
        };
        let offsets = numbers.iter().map(one).collect::<Result<Vec<_>, _>>()?;
        let what = format!("the mean of {} offsets, {} to {}", numbers.len(), numbers[0], numbers[numbers.len() - 1]);
        Ok(Self::of_parts(offsets, options, what))
    }

    /// The mean of all traces at each place.
    fn of_duplicates(bytes: &Shared, path: &Path, options: &SegyOptions) -> Result<Self, SourceError> {
        let mut parts: Vec<SegySource> = Vec::new();
        loop {
            let number = u32::try_from(parts.len()).unwrap_or(u32::MAX);
            // Each part has its own table; the number of parts is not known beforehand.
            let memory_bytes = options.memory_bytes / (parts.len() as u64 + 2);
            let of_part = SegyOptions { memory_bytes, ..options.clone() };
            let part = SegySource::of_wanted(Box::new(bytes.clone()), path, &of_part, Wanted::Number(number))?;
            if !parts.is_empty() && part.live_traces() == 0 {
                break;
            }
            if parts.len() == OFFSETS_LIMIT {
                let what = format!("more than {OFFSETS_LIMIT} traces at one place");
                let advice = Message::from("choose one with ").option(ReadOption::Duplicates).text(" first or last");
                return Err(SourceError::unsupported(path, what, advice));
            }
            parts.push(part);
        }
        let most = parts.len();
        Ok(Self::of_parts(parts, options, format!("the mean of the traces at each place, of {most} at most")))
    }

    /// The mean of these volumes.
    fn of_parts(offsets: Vec<SegySource>, options: &SegyOptions, what: String) -> Self {
        let mut info = offsets[0].info().clone();
        info.voxel_type = match info.voxel_type {
            VoxelType::F64 | VoxelType::I32 | VoxelType::U32 => VoxelType::F64,
            _ => VoxelType::F32,
        };
        info.nodata = None;
        info.memory_bytes = offsets.iter().map(|o| o.info().memory_bytes).sum::<u64>() + 16 * PART_VOXELS;
        info.reading = options.describe();
        // These notes hold for one offset only; the first part of duplicates has all places.
        info.notes.retain(|note| {
            let note = note.to_string();
            options.offsets != Offsets::Stack || (!note.contains("no trace") && !note.contains("other offsets"))
        });
        info.notes.push(what.into());
        Self { offsets, info }
    }
}

/// The offsets of a file, in ascending order.
fn offsets(input: Input<'_>, options: &SegyOptions) -> Result<Vec<i32>, SourceError> {
    let (_, header) = read_file_header(input, options)?;
    let layout = Layout::resolve(input, &header, options, &mut Vec::new())?;
    let mut found = BTreeSet::new();
    for_each_header(input, &layout, |_, fields: Fields<'_>| {
        found.insert(fields.i32(options.offset_byte.into()));
        if found.len() <= OFFSETS_LIMIT {
            return Ok(());
        }
        let what = format!("more than {OFFSETS_LIMIT} offsets (bytes {0} on)", options.offset_byte);
        let advice = Message::from("stack the file first, or choose one with ").option(ReadOption::Offsets);
        Err(input.unsupported(what, advice.text(" N")))
    })?;
    Ok(found.into_iter().collect())
}

impl VolumeSource for Stack {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        if out.is_empty() {
            return Ok(());
        }
        let mut rest = out;
        for part in boxes(voxels, PART_VOXELS, u64::MAX) {
            let (mut sums, mut counts) = (vec![0.0; part.voxels()], vec![0u32; part.voxels()]);
            for offset in &self.offsets {
                let info = offset.info();
                let absence = Absence::declared(info.nodata, info.voxel_type);
                let mut stored = vec![0; part.voxels() * info.voxel_type.bytes()];
                offset.read_box(part, &mut stored)?;
                let values = voxels_as_f64(info.voxel_type, &stored);
                for ((value, sum), count) in values.into_iter().zip(&mut sums).zip(&mut counts) {
                    if !absence.is_absent(value) {
                        *sum += value;
                        *count += 1;
                    }
                }
            }
            let (now, later) = rest.split_at_mut(part.voxels() * self.info.voxel_type.bytes());
            with_voxel!(self.info.voxel_type, V => {
                for ((voxel, sum), count) in now.chunks_exact_mut(size_of::<V>()).zip(&sums).zip(&counts) {
                    let mean = if *count > 0 { sum / f64::from(*count) } else { f64::NAN };
                    V::from_f64(mean).write_le(voxel);
                }
            });
            rest = later;
        }
        Ok(())
    }
}
