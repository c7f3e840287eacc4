//! Reading records: sorted by offset, neighbours merged into one read.
//!
//! Records that lie closer together than [`GAP_BYTES`] are read at once, up to [`READ_BYTES`]: on every medium we know,
//! reading a small gap is cheaper than a second request. A merged read that fails is taken apart and each record is read
//! alone, so that a damaged place costs only the bricks that lie on it; every record is tried at most twice.
//! Only reading is done here: checksums are the decoder's.

use std::ops::Range;
use std::sync::Arc;
use std::time::{Duration, Instant};

use supervol_format::BrickKey;
use supervol_format::container::ContainerError;

/// Bytes between two records that are read over rather than skipped.
pub const GAP_BYTES: u64 = 16 << 10;
/// Bytes of one merged read; a single record may be longer.
pub const READ_BYTES: u64 = 4 << 20;

/// One record to be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RecordRequest {
    /// The brick.
    pub key: BrickKey,
    /// Offset of its record, bytes.
    pub offset: u64,
    /// Length of its record, bytes.
    pub bytes: u64,
}

/// The bytes of one record: a part of what was read at once.
#[derive(Debug, Clone)]
pub struct Record {
    buffer: Arc<Vec<u8>>,
    range: Range<usize>,
}

impl Record {
    /// The record's bytes.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.buffer[self.range.clone()]
    }
}

/// What reading cost.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct IoCounters {
    /// Reads made, failed ones included.
    pub reads: u64,
    /// Reads that fetched more than one record.
    pub merged_reads: u64,
    /// Bytes fetched, gaps between records included.
    pub bytes_read: u64,
    /// Reads that failed.
    pub failed_reads: u64,
    /// Time spent in reads.
    pub time: Duration,
}

/// Several records that are read at once.
#[derive(Debug, PartialEq, Eq)]
struct MergedRead {
    /// Bytes of the file.
    bytes: Range<u64>,
    /// Which of the sorted requests lie in them.
    requests: Range<usize>,
}

/// Fills the buffer from the offset on.
pub type ReadAt<'a> = dyn Fn(u64, &mut [u8]) -> Result<(), ContainerError> + 'a;

/// Reads records; the answers come in the order of their offsets.
pub fn read_records(
    read_at: &ReadAt<'_>,
    mut requests: Vec<RecordRequest>,
    counters: &mut IoCounters,
) -> Vec<(BrickKey, Result<Record, ContainerError>)> {
    requests.sort_unstable_by_key(|r| (r.offset, r.key));
    let mut answers = Vec::with_capacity(requests.len());
    for merged in merge(&requests) {
        let records = &requests[merged.requests.clone()];
        counters.merged_reads += u64::from(records.len() > 1);
        match read_range(read_at, merged.bytes.clone(), counters) {
            Ok(buffer) => answers.extend(records.iter().map(|r| {
                let start = (r.offset - merged.bytes.start) as usize;
                let range = start..start + r.bytes as usize;
                (r.key, Ok(Record { buffer: buffer.clone(), range }))
            })),
            Err(_) => answers.extend(records.iter().map(|r| {
                // The first failure may be another record's: the second one is this record's own, and it is reported.
                let alone = read_range(read_at, r.offset..r.offset + r.bytes, counters);
                (r.key, alone.map(|buffer| Record { buffer, range: 0..r.bytes as usize }))
            })),
        }
    }
    answers
}

fn read_range(
    read_at: &ReadAt<'_>,
    range: Range<u64>,
    counters: &mut IoCounters,
) -> Result<Arc<Vec<u8>>, ContainerError> {
    let bytes = range.end - range.start;
    let mut buffer = vec![0; usize::try_from(bytes).expect("a read is bounded by the host budget")];
    let start = Instant::now();
    let result = read_at(range.start, &mut buffer);
    counters.time += start.elapsed();
    counters.reads += 1;
    match result {
        Ok(()) => {
            counters.bytes_read += bytes;
            Ok(Arc::new(buffer))
        }
        Err(error) => {
            counters.failed_reads += 1;
            Err(error)
        }
    }
}

/// Groups requests, sorted by offset, into reads.
fn merge(requests: &[RecordRequest]) -> Vec<MergedRead> {
    let mut reads: Vec<MergedRead> = Vec::new();
    for (i, request) in requests.iter().enumerate() {
        let end = request.offset + request.bytes;
        if let Some(last) = reads.last_mut() {
            let gap = request.offset.saturating_sub(last.bytes.end);
            let merged_end = end.max(last.bytes.end);
            if gap <= GAP_BYTES && merged_end - last.bytes.start <= READ_BYTES {
                last.bytes.end = merged_end;
                last.requests.end = i + 1;
                continue;
            }
        }
        reads.push(MergedRead { bytes: request.offset..end, requests: i..i + 1 });
    }
    reads
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io;
    use supervol_format::{BrickIndex, Lod};

    fn request(x: u32, offset: u64, bytes: u64) -> RecordRequest {
        RecordRequest { key: BrickKey::new(Lod(0), BrickIndex([x, 0, 0])), offset, bytes }
    }

    fn broken(offset: u64, buffer: &[u8]) -> ContainerError {
        let source = io::Error::other("bad sector");
        ContainerError::Io { what: "test".into(), offset, bytes: buffer.len() as u64, source }
    }

    /// A file whose byte at offset i is `i % 251`, except that reads touching `bad` fail.
    fn file(bad: Range<u64>) -> impl Fn(u64, &mut [u8]) -> Result<(), ContainerError> {
        move |offset, buffer| {
            let end = offset + buffer.len() as u64;
            if offset < bad.end && bad.start < end {
                return Err(broken(offset, buffer));
            }
            (offset..).zip(buffer).for_each(|(i, b)| *b = (i % 251) as u8);
            Ok(())
        }
    }

    fn is_right(request: &RecordRequest, record: &Record) -> bool {
        record.bytes().len() as u64 == request.bytes
            && (request.offset..).zip(record.bytes()).all(|(i, &b)| b == (i % 251) as u8)
    }

    #[test]
    fn neighbours_are_merged_and_distant_records_are_not() {
        let far = 100 + 200 + GAP_BYTES + 1;
        let requests = vec![request(2, far, 50), request(1, 100, 200), request(0, 0, 100), request(3, far + 60, 5)];
        let mut counters = IoCounters::default();
        let answers = read_records(&file(0..0), requests.clone(), &mut counters);
        assert_eq!(counters.reads, 2);
        assert_eq!((counters.merged_reads, counters.bytes_read, counters.failed_reads), (2, 300 + 65, 0));
        for (key, record) in answers {
            let request = requests.iter().find(|r| r.key == key).expect("asked for");
            assert!(is_right(request, &record.expect("readable")));
        }
    }

    #[test]
    fn reads_stay_below_the_limit_and_long_records_are_read_alone() {
        let quarter = READ_BYTES / 4;
        let requests: Vec<_> = (0..9).map(|i| request(i, u64::from(i) * quarter, quarter)).collect();
        assert_eq!(merge(&requests).iter().map(|r| r.requests.len()).collect::<Vec<_>>(), [4, 4, 1]);
        let long = [request(0, 0, 3 * READ_BYTES), request(1, 3 * READ_BYTES, 10)];
        assert_eq!(merge(&long).len(), 2);
    }

    #[test]
    fn overlapping_and_equal_records_of_a_damaged_table_are_served() {
        let requests = vec![request(0, 10, 100), request(1, 10, 100), request(2, 20, 5), request(3, 50, 100)];
        let answers = read_records(&file(0..0), requests.clone(), &mut IoCounters::default());
        for ((_, record), request) in answers.iter().zip(&requests) {
            assert!(is_right(request, record.as_ref().expect("readable")));
        }
    }

    #[test]
    fn a_failed_merged_read_costs_only_the_record_on_the_bad_place() {
        let requests: Vec<_> = (0..4).map(|i| request(i, u64::from(i) * 100, 100)).collect();
        let mut counters = IoCounters::default();
        let answers = read_records(&file(210..220), requests.clone(), &mut counters);
        let good: Vec<bool> = answers.iter().map(|(_, r)| r.is_ok()).collect();
        assert_eq!(good, [true, true, false, true]);
        assert_eq!((counters.reads, counters.failed_reads, counters.bytes_read), (5, 2, 300));
        assert!(answers[2].1.as_ref().is_err_and(|e| e.to_string().contains("offset 200")), "the record's own error");
    }
}
