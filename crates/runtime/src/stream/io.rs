//! Reading of records: sorted by offset, neighbours merged into one read.
//!
//! Records closer together than the source's gap are merged, up to its best read size. If a merged read fails, each of
//! its records is read alone, so that a damaged place costs only the bricks on it. Failures that may be temporary (such
//! as network errors) are retried after [`RETRY_AFTER`]. All other records are read at most twice. Checksums are
//! checked by the decoder, not here.

use std::io::ErrorKind;
use std::ops::Range;
use std::sync::Arc;
use std::time::{Duration, Instant};

use supervol_format::byte_source::ReadShape;
use supervol_format::cast::index;
use supervol_format::container::ContainerError;

use crate::stop::Stop;
use crate::stream::counters::{StreamCounters, milliseconds};
use crate::stream::field::FieldBrick;

/// Waiting times before the first, second, ... retry of a read whose failure may be temporary.
pub const RETRY_AFTER: [Duration; 2] = [Duration::from_millis(20), Duration::from_millis(80)];

/// A request to read one record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RecordRequest {
    /// The brick.
    pub key: FieldBrick,
    /// Offset of its record, bytes.
    pub offset: u64,
    /// Length of its record, bytes.
    pub bytes: u64,
}

/// The bytes of one record: a part of the buffer of a merged read.
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

/// Records read at once.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MergedRead {
    /// Byte range in the file.
    pub bytes: Range<u64>,
    /// The records in this range, sorted by offset.
    pub records: Vec<RecordRequest>,
}

impl MergedRead {
    /// Bytes of memory that the read takes.
    #[must_use]
    pub fn in_flight_bytes(&self) -> u64 {
        self.bytes.end - self.bytes.start
    }
}

/// Function that fills the buffer with the bytes from an offset on.
pub type ReadAt<'a> = dyn Fn(u64, &mut [u8]) -> Result<(), ContainerError> + 'a;

/// A brick, with its record or the error that prevented reading it.
pub type Answer = (FieldBrick, Result<Record, ContainerError>);

/// Reads a merged read, or its records one by one if that fails.
pub fn read_merged(read_at: &ReadAt<'_>, merged: &MergedRead, counters: &mut StreamCounters) -> Vec<Answer> {
    counters.merged_reads += u64::from(merged.records.len() > 1);
    let part = |buffer: &Arc<Vec<u8>>, r: &RecordRequest| {
        let start = index(r.offset - merged.bytes.start);
        Record { buffer: buffer.clone(), range: start..start + index(r.bytes) }
    };
    match read_range(read_at, merged.bytes.clone(), counters) {
        Ok(buffer) => merged.records.iter().map(|r| (r.key, Ok(part(&buffer, r)))).collect(),
        // The first failure may be another record's. The second one is this record's own and is reported.
        Err(_) => merged
            .records
            .iter()
            .map(|r| {
                let alone = read_range(read_at, r.offset..r.offset + r.bytes, counters);
                (r.key, alone.map(|buffer| Record { buffer, range: 0..index(r.bytes) }))
            })
            .collect(),
    }
}

/// Whether a failure may be temporary.
fn may_pass(error: &ContainerError) -> bool {
    use ErrorKind::{
        ConnectionAborted, ConnectionReset, Interrupted, NotConnected, ResourceBusy, TimedOut, WouldBlock,
    };
    let ContainerError::Io { source, .. } = error else { return false };
    let kinds = [ConnectionAborted, ConnectionReset, Interrupted, NotConnected, ResourceBusy, TimedOut, WouldBlock];
    kinds.contains(&source.kind())
}

fn read_range(
    read_at: &ReadAt<'_>,
    range: Range<u64>,
    counters: &mut StreamCounters,
) -> Result<Arc<Vec<u8>>, ContainerError> {
    let bytes = range.end - range.start;
    let mut buffer = vec![0; usize::try_from(bytes).expect("a read is bounded by the host budget")];
    patiently(counters, &Stop::NEVER, |counters| {
        let start = Instant::now();
        let result = read_at(range.start, &mut buffer);
        counters.read_ms += milliseconds(start.elapsed());
        counters.reads += 1;
        result
    })?;
    counters.bytes_read += bytes;
    Ok(Arc::new(buffer))
}

/// Repeats a read until it succeeds, at most as often as [`RETRY_AFTER`] says. It retries only temporary failures, and
/// only while there is time.
///
/// # Errors
/// The error of the last attempt.
pub fn patiently(
    counters: &mut StreamCounters,
    stop: &Stop,
    mut attempt: impl FnMut(&mut StreamCounters) -> Result<(), ContainerError>,
) -> Result<(), ContainerError> {
    let mut delays = RETRY_AFTER.iter();
    loop {
        let Err(error) = attempt(counters) else { return Ok(()) };
        counters.failed_reads += 1;
        let Some(&delay) = delays.next().filter(|_| may_pass(&error)) else { return Err(error) };
        let left = stop.deadline().map_or(delay, |deadline| deadline.saturating_duration_since(Instant::now()));
        std::thread::sleep(delay.min(left));
        if stop.is_due() {
            return Err(error);
        }
        counters.retried_reads += 1;
    }
}

/// Groups requests into reads, in the order of their offsets. No read is longer than `most_bytes`, except one of a
/// single record.
#[must_use]
pub fn merge(mut requests: Vec<RecordRequest>, shape: ReadShape, most_bytes: u64) -> Vec<MergedRead> {
    requests.sort_unstable_by_key(|r| (r.offset, r.key));
    let longest = shape.read_bytes.min(most_bytes);
    let mut reads: Vec<MergedRead> = Vec::new();
    for request in requests {
        let end = request.offset + request.bytes;
        if let Some(last) = reads.last_mut() {
            let gap = request.offset.saturating_sub(last.bytes.end);
            let merged_end = end.max(last.bytes.end);
            if gap <= shape.gap_bytes && merged_end - last.bytes.start <= longest {
                last.bytes.end = merged_end;
                last.records.push(request);
                continue;
            }
        }
        reads.push(MergedRead { bytes: request.offset..end, records: vec![request] });
    }
    reads
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;
    use std::io;

    use supervol_format::{BrickIndex, BrickKey, Lod};

    use super::*;
    use crate::stream::field::Field;

    const SHAPE: ReadShape = ReadShape::FILE;
    const GAP_BYTES: u64 = SHAPE.gap_bytes;
    const READ_BYTES: u64 = SHAPE.read_bytes;

    fn read_records(read_at: &ReadAt<'_>, requests: Vec<RecordRequest>, counters: &mut StreamCounters) -> Vec<Answer> {
        merge(requests, SHAPE, u64::MAX).iter().flat_map(|read| read_merged(read_at, read, counters)).collect()
    }

    #[test]
    fn nothing_is_waited_for_beyond_the_time() {
        let failing = |_: &mut StreamCounters| {
            let source = io::Error::from(ErrorKind::TimedOut);
            Err(ContainerError::Io { what: "test".into(), offset: 0, bytes: 0, source })
        };
        let mut counters = StreamCounters::default();
        assert!(patiently(&mut counters, &Stop::at(Some(Instant::now())), failing).is_err());
        assert_eq!((counters.failed_reads, counters.retried_reads), (1, 0));
    }

    fn request(x: u32, offset: u64, bytes: u64) -> RecordRequest {
        RecordRequest { key: Field::FIRST.brick(BrickKey::new(Lod(0), BrickIndex([x, 0, 0]))), offset, bytes }
    }

    fn broken(offset: u64, buffer: &[u8]) -> ContainerError {
        let source = io::Error::other("bad sector");
        ContainerError::Io { what: "test".into(), offset, bytes: buffer.len() as u64, source }
    }

    /// A file whose byte at offset i is `i % 251`; reads that touch `bad` fail.
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
        let mut counters = StreamCounters::default();
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
        let lengths = |most| merge(requests.clone(), SHAPE, most).iter().map(|r| r.records.len()).collect::<Vec<_>>();
        assert_eq!(lengths(u64::MAX), [4, 4, 1]);
        assert_eq!(lengths(READ_BYTES / 2), [2, 2, 2, 2, 1]);
        assert_eq!(lengths(1), [1; 9]);
        let long = vec![request(0, 0, 3 * READ_BYTES), request(1, 3 * READ_BYTES, 10)];
        assert_eq!(merge(long, SHAPE, u64::MAX).len(), 2);
    }

    #[test]
    fn overlapping_and_equal_records_of_a_damaged_table_are_served() {
        let requests = vec![request(0, 10, 100), request(1, 10, 100), request(2, 20, 5), request(3, 50, 100)];
        let answers = read_records(&file(0..0), requests.clone(), &mut StreamCounters::default());
        for ((_, record), request) in answers.iter().zip(&requests) {
            assert!(is_right(request, record.as_ref().expect("readable")));
        }
    }

    #[test]
    fn a_failed_merged_read_costs_only_the_record_on_the_bad_place() {
        let requests: Vec<_> = (0..4).map(|i| request(i, u64::from(i) * 100, 100)).collect();
        let mut counters = StreamCounters::default();
        let answers = read_records(&file(210..220), requests.clone(), &mut counters);
        let good: Vec<bool> = answers.iter().map(|(_, r)| r.is_ok()).collect();
        assert_eq!(good, [true, true, false, true]);
        assert_eq!((counters.reads, counters.failed_reads, counters.bytes_read), (5, 2, 300));
        assert!(answers[2].1.as_ref().is_err_and(|e| e.to_string().contains("offset 200")), "the record's own error");
    }

    #[test]
    fn failures_that_may_pass_are_tried_again() {
        for (kind, failures, retried) in
            [(ErrorKind::TimedOut, 1, 1), (ErrorKind::WouldBlock, 2, 2), (ErrorKind::Other, 1, 0)]
        {
            let left = Cell::new(failures);
            let stumbling = |offset: u64, buffer: &mut [u8]| {
                left.set(left.get() - 1);
                if left.get() >= 0 {
                    let source = io::Error::from(kind);
                    return Err(ContainerError::Io { what: "test".into(), offset, bytes: 0, source });
                }
                file(0..0)(offset, buffer)
            };
            let mut counters = StreamCounters::default();
            let answers = read_records(&stumbling, vec![request(0, 10, 100)], &mut counters);
            assert!(answers[0].1.is_ok(), "a second attempt at least");
            assert_eq!((counters.retried_reads, counters.failed_reads), (retried, failures as u64));
        }
    }
}
