//! Sums over the bricks of a level for the build's report.

use supervol_format::codec::Codec;
use supervol_format::container::toc::BrickEntry;

use crate::report::LevelReport;

/// Adds a brick to the report of its level. `scale` converts stored units to data units.
pub(super) fn tally(report: &mut LevelReport, entry: &BrickEntry, scale: f64) {
    report.bricks += 1;
    report.uniform_bricks += u64::from(entry.uniform);
    report.absent_bricks += u64::from(entry.absent);
    report.raw_bricks += u64::from(entry.codec == Codec::Raw);
    report.rle_bricks += u64::from(entry.codec == Codec::Rle);
    report.zstd_bricks += u64::from(entry.codec == Codec::Zstd);
    report.wavelet_bricks += u64::from(entry.codec == Codec::Wavelet);
    report.trimmed_bricks += u64::from(entry.codec == Codec::Trimmed);
    report.bytes += entry.record_bytes();
    report.error = report.error.max(entry.error * scale.abs());
}
