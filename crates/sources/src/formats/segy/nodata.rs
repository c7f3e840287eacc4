//! A stored value for cells without a trace.
//!
//! Floats have NaN. Integers have no spare value by nature, so one is looked for that no sample of the file has: the
//! least value of a signed type, the greatest of an unsigned one, then the next ones inward. For 8 and 16 bits every
//! value may be in use; then voxels widen to the next signed type, whose least value is free. The search reads all
//! samples once, and is only made for integer files whose grid has holes. Format 7 and 15 fill 24 bits of 32 and need
//! no search.

use supervol_format::VoxelType;

use super::input::Input;
use super::layout::Layout;
use super::samples::SampleFormat;
use crate::SourceError;
use crate::cast::index;

/// Values tried for 32-bit types, from the end of the range inward.
const CANDIDATES: u32 = 64;

/// Bytes of one read of the search.
const READ_BYTES: u64 = 1 << 20;

/// How absent voxels are stored.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Absent {
    /// Type of the voxels: the format's own, or wider.
    pub(super) voxel_type: VoxelType,
    /// Stored value of absent voxels; NaN for floats.
    pub(super) value: f64,
}

/// Finds a value that no sample has.
pub(super) fn choose(input: Input<'_>, layout: &Layout) -> Result<Absent, SourceError> {
    let voxel_type = layout.format.voxel_type();
    let (least, greatest) = voxel_type.limits();
    let absent = |voxel_type, value| Ok(Absent { voxel_type, value });
    match (layout.format, voxel_type) {
        (_, VoxelType::F32 | VoxelType::F64) => absent(voxel_type, f64::NAN),
        (SampleFormat::I24, _) => absent(voxel_type, least),
        (SampleFormat::U24, _) => absent(voxel_type, greatest),
        (_, VoxelType::I32 | VoxelType::U32) => {
            let signed = voxel_type == VoxelType::I32;
            let mut used: u64 = 0;
            for_each_code(input, layout, |code| {
                // Distance from the preferred end of the range.
                let distance = if signed { code ^ 0x8000_0000 } else { !code };
                if distance < CANDIDATES {
                    used |= 1 << distance;
                }
            })?;
            let free = used.trailing_ones();
            if free >= CANDIDATES {
                let what =
                    format!("the grid has holes, and the samples use all {CANDIDATES} extreme {voxel_type} values");
                return Err(input.unsupported(what, "convert the file to format 5 or 6"));
            }
            absent(voxel_type, if signed { least + f64::from(free) } else { greatest - f64::from(free) })
        }
        (_, small) => {
            let bits = 8 * small.bytes();
            let signed = matches!(small, VoxelType::I8 | VoxelType::I16);
            let mut used = vec![false; 1 << bits];
            let sign = if signed { 1 << (bits - 1) } else { 0 };
            for_each_code(input, layout, |code| {
                let rank = code ^ sign;
                used[rank as usize] = true;
            })?;
            let free = if signed {
                used.iter().position(|u| !u).map(|rank| least + rank as f64)
            } else {
                used.iter().rposition(|u| !u).map(|rank| rank as f64)
            };
            let wider = if bits == 8 { VoxelType::I16 } else { VoxelType::I32 };
            free.map_or_else(|| absent(wider, wider.limits().0), |value| absent(small, value))
        }
    }
}

/// Calls `visit` with the bits of every sample of an integer format of 1, 2 or 4 bytes, in file order.
fn for_each_code(input: Input<'_>, layout: &Layout, mut visit: impl FnMut(u32)) -> Result<(), SourceError> {
    let sample_bytes = layout.format.bytes();
    let voxel_type = layout.format.voxel_type();
    let batch = layout.samples.min(READ_BYTES / sample_bytes as u64);
    let mut raw = vec![0; index(batch) * sample_bytes];
    let mut voxels = vec![0; raw.len()];
    for trace in 0..layout.traces {
        let mut sample = 0;
        while sample < layout.samples {
            let count = batch.min(layout.samples - sample);
            let size = index(count) * sample_bytes;
            let (raw, voxels) = (&mut raw[..size], &mut voxels[..size]);
            let offset = layout.sample_offset(trace, sample);
            input.read(offset, raw)?;
            super::samples::decode(layout.format, layout.endian, voxel_type, raw, voxels)
                .expect("integers of up to 32 bits always decode");
            match sample_bytes {
                1 => voxels.iter().for_each(|&v| visit(u32::from(v))),
                2 => voxels.as_chunks().0.iter().for_each(|&v| visit(u32::from(u16::from_le_bytes(v)))),
                _ => voxels.as_chunks().0.iter().for_each(|&v| visit(u32::from_le_bytes(v))),
            }
            sample += count;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::Endian;

    fn choose_for(format: u16, samples: &[u8]) -> Absent {
        let format = SampleFormat::from_code(format).unwrap();
        let layout = Layout {
            endian: Endian::Big,
            format,
            first_trace: 3600,
            header_bytes: 240,
            samples: (samples.len() / format.bytes()) as u64,
            traces: 1,
        };
        let mut file = vec![0; 3840];
        file.extend_from_slice(samples);
        choose(Input { path: Path::new("x.sgy"), bytes: &file }, &layout).unwrap()
    }

    #[test]
    fn the_extreme_value_is_preferred() {
        assert_eq!(choose_for(3, &[0, 1]), Absent { voxel_type: VoxelType::I16, value: -32768.0 });
        assert_eq!(choose_for(3, &[0x80, 0]), Absent { voxel_type: VoxelType::I16, value: -32767.0 });
        assert_eq!(choose_for(11, &[0xFF, 0xFF]), Absent { voxel_type: VoxelType::U16, value: 65534.0 });
        assert_eq!(choose_for(8, &[0x80, 0x81]), Absent { voxel_type: VoxelType::I8, value: -126.0 });
        assert_eq!(choose_for(2, &[0x80, 0, 0, 0]), Absent { voxel_type: VoxelType::I32, value: -2_147_483_647.0 });
        assert_eq!(choose_for(10, &[0; 4]), Absent { voxel_type: VoxelType::U32, value: 4_294_967_295.0 });
        assert_eq!(choose_for(7, &[0; 3]).value, -2_147_483_648.0);
        assert_eq!(choose_for(15, &[0; 3]).value, 4_294_967_295.0);
        assert!(choose_for(1, &[0; 4]).value.is_nan());
    }

    #[test]
    fn full_types_widen() {
        let all: Vec<u8> = (0..=255).collect();
        assert_eq!(choose_for(16, &all), Absent { voxel_type: VoxelType::I16, value: -32768.0 });
        assert_eq!(choose_for(8, &all), Absent { voxel_type: VoxelType::I16, value: -32768.0 });
        let all: Vec<u8> = (0..=u16::MAX).flat_map(u16::to_be_bytes).collect();
        assert_eq!(choose_for(3, &all), Absent { voxel_type: VoxelType::I32, value: -2_147_483_648.0 });
        assert_eq!(choose_for(11, &all), Absent { voxel_type: VoxelType::I32, value: -2_147_483_648.0 });
    }
}
