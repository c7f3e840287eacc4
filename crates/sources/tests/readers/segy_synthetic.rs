//! SEG-Y files made by these tests: sample formats, orders and headers for which no small real file exists.

#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "test helpers fail by panicking, and say what they skip")]

use std::collections::BTreeMap;
use std::path::Path;

use supervol_format::{Dims, VoxelBox, VoxelType, voxel_type::voxels_as_f64};
use supervol_sources::formats::segy::{SegyOptions, SegySource};
use supervol_sources::{AccessOrder, Endian, LineNumbers, SourceError, VolumeSource};

/// A trace to write: line numbers and samples, which are encoded in the file's format.
#[derive(Clone)]
struct Trace {
    inline: i32,
    crossline: i32,
    samples: Vec<f64>,
    /// Two- and four-byte words of the header, by byte number.
    words: BTreeMap<usize, Word>,
}

#[derive(Clone, Copy)]
enum Word {
    I16(i16),
    I32(i32),
    U64(u64),
    F64(f64),
}

/// A file to write.
struct Recipe {
    endian: Endian,
    format: u16,
    revision: u8,
    /// Words of the binary header by byte number (3201 to 3600); they override the usual ones.
    words: BTreeMap<usize, Word>,
    /// Bytes between the binary header and the first trace.
    extended: Vec<u8>,
    /// Zero bytes after each trace header.
    header_extension: usize,
    traces: Vec<Trace>,
}

impl Recipe {
    fn new(format: u16, traces: Vec<Trace>) -> Self {
        Self {
            endian: Endian::Big,
            format,
            revision: 1,
            words: BTreeMap::new(),
            extended: Vec::new(),
            header_extension: 0,
            traces,
        }
    }

    fn word(mut self, byte: usize, word: Word) -> Self {
        self.words.insert(byte, word);
        self
    }

    fn put(&self, header: &mut [u8], at: usize, word: Word) {
        let mut bytes = match word {
            Word::I16(v) => v.to_be_bytes().to_vec(),
            Word::I32(v) => v.to_be_bytes().to_vec(),
            Word::U64(v) => v.to_be_bytes().to_vec(),
            Word::F64(v) => v.to_be_bytes().to_vec(),
        };
        if self.endian == Endian::Little {
            bytes.reverse();
        }
        header[at..at + bytes.len()].copy_from_slice(&bytes);
    }

    fn encode(&self, value: f64) -> Vec<u8> {
        let mut bytes = match self.format {
            1 => return ibm(value, self.endian),
            2 => (value as i32).to_be_bytes().to_vec(),
            3 => (value as i16).to_be_bytes().to_vec(),
            5 => (value as f32).to_be_bytes().to_vec(),
            6 => value.to_be_bytes().to_vec(),
            7 | 15 => (value as i32).to_be_bytes()[1..].to_vec(),
            8 => (value as i8).to_be_bytes().to_vec(),
            9 => (value as i64).to_be_bytes().to_vec(),
            10 => (value as u32).to_be_bytes().to_vec(),
            11 => (value as u16).to_be_bytes().to_vec(),
            12 => (value as u64).to_be_bytes().to_vec(),
            16 => vec![value as u8],
            other => panic!("no encoder for format {other}"),
        };
        if self.endian == Endian::Little {
            bytes.reverse();
        }
        bytes
    }

    fn bytes(&self) -> Vec<u8> {
        let mut file: Vec<u8> = format!("{:3200}", "C 1 MADE BY A TEST").into_bytes();
        let mut binary = [0u8; 400];
        let samples = self.traces[0].samples.len();
        self.put(&mut binary, 16, Word::I16(4000));
        self.put(&mut binary, 20, Word::I16(samples as i16));
        self.put(&mut binary, 24, Word::I16(self.format.cast_signed()));
        binary[300] = self.revision;
        for (&byte, &word) in &self.words {
            self.put(&mut binary, byte - 3201, word);
        }
        file.extend(binary);
        file.extend(&self.extended);
        for trace in &self.traces {
            let mut header = vec![0u8; 240 + self.header_extension];
            self.put(&mut header, 188, Word::I32(trace.inline));
            self.put(&mut header, 192, Word::I32(trace.crossline));
            for (&byte, &word) in &trace.words {
                self.put(&mut header, byte - 1, word);
            }
            file.extend(header);
            trace.samples.iter().for_each(|&v| file.extend(self.encode(v)));
        }
        file
    }

    fn open_with(&self, options: &SegyOptions) -> Result<SegySource, SourceError> {
        SegySource::from_bytes(Box::new(self.bytes()), Path::new("made.sgy"), options)
    }

    fn open(&self) -> Result<SegySource, SourceError> {
        self.open_with(&SegyOptions::default())
    }

    fn refusal(&self) -> String {
        self.open().expect_err("refused").to_string()
    }
}

/// IBM bits of a value that fits 24 bits.
fn ibm(value: f64, endian: Endian) -> Vec<u8> {
    if value == 0.0 {
        return vec![0; 4];
    }
    let exponent = (value.abs().log2() / 4.0).floor() as i32 + 1;
    let fraction = (value.abs() / 16f64.powi(exponent) * f64::from(1 << 24)).round() as u32;
    let word = (u32::from(value < 0.0) << 31) | (((exponent + 64) as u32) << 24) | fraction;
    if endian == Endian::Big { word.to_be_bytes().to_vec() } else { word.to_le_bytes().to_vec() }
}

/// Samples that encode their position: inline, crossline and sample index.
fn value(inline: i32, crossline: i32, sample: usize) -> f64 {
    f64::from(inline * 1000 + crossline * 10) + sample as f64
}

fn trace(inline: i32, crossline: i32, samples: usize) -> Trace {
    let samples = (0..samples).map(|k| value(inline, crossline, k)).collect();
    Trace { inline, crossline, samples, words: BTreeMap::new() }
}

/// Traces inline by inline.
fn inline_sorted(inlines: &[i32], crosslines: &[i32], samples: usize) -> Vec<Trace> {
    inlines.iter().flat_map(|&il| crosslines.iter().map(move |&xl| trace(il, xl, samples))).collect()
}

/// Traces crossline by crossline.
fn crossline_sorted(inlines: &[i32], crosslines: &[i32], samples: usize) -> Vec<Trace> {
    crosslines.iter().flat_map(|&xl| inlines.iter().map(move |&il| trace(il, xl, samples))).collect()
}

fn read(source: &SegySource, voxels: VoxelBox) -> Vec<f64> {
    let voxel_type = source.info().voxel_type;
    let mut out = vec![0xA5; voxels.voxels() * voxel_type.bytes()];
    source.read_box(voxels, &mut out).unwrap();
    voxels_as_f64(voxel_type, &out)
}

fn read_all(source: &SegySource) -> Vec<f64> {
    read(source, source.info().dims.full_box())
}

/// Asserts that every voxel of the box encodes its position.
fn assert_places(source: &SegySource, voxels: VoxelBox) {
    let survey = source.info().survey.as_ref().unwrap();
    let number = |line: LineNumbers, index: u64| (line.first + index as i64 * line.step) as i32;
    let found = read(source, voxels);
    let [nx, ny, _] = voxels.extent();
    for (index, &value_found) in found.iter().enumerate() {
        let [x, y, z] = [index % nx, index / nx % ny, index / nx / ny];
        let il = number(survey.inline, voxels.start[1] + y as u64);
        let xl = number(survey.crossline, voxels.start[0] + x as u64);
        let sample = voxels.start[2] as usize + z;
        assert_eq!(value_found, value(il, xl, sample), "inline {il} crossline {xl} sample {sample} of {voxels:?}");
    }
}

#[test]
fn every_format_in_both_byte_orders() {
    let types = [
        (1, VoxelType::F32),
        (2, VoxelType::I32),
        (3, VoxelType::I16),
        (5, VoxelType::F32),
        (6, VoxelType::F64),
        (7, VoxelType::I32),
        (9, VoxelType::F64),
        (10, VoxelType::U32),
        (11, VoxelType::U16),
        (12, VoxelType::F64),
        (15, VoxelType::U32),
    ];
    for (format, voxel_type) in types {
        for endian in [Endian::Big, Endian::Little] {
            let recipe = Recipe { endian, ..Recipe::new(format, inline_sorted(&[1, 2, 3], &[20, 21], 7)) };
            let source = recipe.open().unwrap();
            assert_eq!((source.info().dims, source.info().voxel_type), (Dims([2, 3, 7]), voxel_type), "{format}");
            assert_places(&source, source.info().dims.full_box());
        }
    }
}

#[test]
fn signed_three_byte_and_one_byte_samples() {
    for (format, samples) in [(7, vec![-8_388_608.0, -1.0, 8_388_607.0]), (8, vec![-128.0, -1.0, 127.0])] {
        let one = Trace { samples: samples.clone(), ..trace(1, 1, 0) };
        assert_eq!(read_all(&Recipe::new(format, vec![one]).open().unwrap()), samples, "format {format}");
    }
}

#[test]
fn any_order_of_lines_gives_the_same_ascending_grid() {
    let (inlines, crosslines) = ([100, 103, 106, 109], [-8, -6, -4, -2, 0]);
    let reversed = |numbers: &[i32]| numbers.iter().rev().copied().collect::<Vec<_>>();
    let (down_il, down_xl) = (reversed(&inlines), reversed(&crosslines));
    for (il, xl) in
        [(&inlines[..], &crosslines[..]), (&down_il, &crosslines), (&inlines, &down_xl), (&down_il, &down_xl)]
    {
        for by_inline in [true, false] {
            let traces = if by_inline { inline_sorted(il, xl, 6) } else { crossline_sorted(il, xl, 6) };
            let source = Recipe::new(5, traces).open().unwrap();
            let info = source.info();
            let survey = info.survey.as_ref().unwrap();
            assert_eq!(survey.inline, LineNumbers { first: 100, step: 3, count: 4 });
            assert_eq!(survey.crossline, LineNumbers { first: -8, step: 2, count: 5 });
            assert_eq!(info.access_order, AccessOrder(if by_inline { [1, 0, 2] } else { [0, 1, 2] }));
            assert_places(&source, info.dims.full_box());
            assert_places(&source, VoxelBox { start: [1, 1, 2], end: [4, 3, 5] });
        }
    }
}

#[test]
fn boxes_beyond_one_tile_are_stitched() {
    let lines: Vec<i32> = (0..40).collect();
    for by_inline in [true, false] {
        let traces = if by_inline {
            inline_sorted(&lines, &lines[..37], 3000)
        } else {
            crossline_sorted(&lines, &lines[..37], 3000)
        };
        let source = Recipe::new(5, traces).open().unwrap();
        assert_places(&source, source.info().dims.full_box());
        assert_places(&source, VoxelBox { start: [3, 1, 1000], end: [36, 39, 1064] });
        assert_places(&source, VoxelBox { start: [36, 39, 2999], end: [37, 40, 3000] });
        assert!(read(&source, VoxelBox { start: [3, 3, 3], end: [3, 5, 5] }).is_empty());
    }
    // Traces longer than one tile.
    let long = inline_sorted(&[1, 2], &[5, 6, 7], 40_000);
    let source = Recipe::new(2, long).word(3503, Word::I16(1)).open().unwrap();
    assert_eq!(source.info().dims, Dims([3, 2, 40_000]));
    assert_places(&source, source.info().dims.full_box());
}

#[test]
fn a_file_on_disk_reads_like_bytes_in_memory() {
    let recipe = Recipe::new(3, inline_sorted(&[1, 2], &[20, 21, 22], 9));
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), recipe.bytes()).unwrap();
    let source = SegySource::open(file.path(), &SegyOptions::default()).unwrap();
    assert_eq!(read_all(&source), read_all(&recipe.open().unwrap()));
    let message = SegySource::open(Path::new("/no/such/file.sgy"), &SegyOptions::default()).expect_err("no file");
    assert!(matches!(message, SourceError::Io { .. }));
}

#[test]
fn revision_2_little_endian_with_wide_fields() {
    let mut recipe = Recipe::new(6, inline_sorted(&[1, 2], &[20, 21, 22], 9))
        .word(3221, Word::I16(0))
        .word(3269, Word::I32(9))
        .word(3273, Word::F64(2500.5))
        .word(3297, Word::I32(0x0102_0304))
        .word(3507, Word::I16(2))
        .word(3513, Word::U64(6))
        .word(3521, Word::U64(3600 + 320));
    recipe.endian = Endian::Little;
    recipe.revision = 2;
    recipe.header_extension = 480;
    recipe.extended = vec![b' '; 320];
    let source = recipe.open().unwrap();
    assert_eq!(source.info().dims, Dims([3, 2, 9]));
    assert_eq!(source.info().geometry.spacing[2], 2.5005);
    assert_places(&source, source.info().dims.full_box());
}

#[test]
fn extended_text_headers_end_at_their_stanza() {
    let mut recipe = Recipe::new(5, inline_sorted(&[1], &[20, 21], 4)).word(3505, Word::I16(-1));
    recipe.extended = format!("{:3200}{:3200}{:3200}", "((SEG: Layout))", "more", "((SEG: EndText))").into_bytes();
    assert_places(&recipe.open().unwrap(), Dims([2, 1, 4]).full_box());
    recipe.extended.truncate(6400);
    assert!(recipe.refusal().contains("EndText"), "{}", recipe.refusal());
}

#[test]
fn holes_in_integer_volumes_get_a_value_no_sample_has() {
    let corner_missing = |format| {
        let mut traces = inline_sorted(&[1, 2, 3], &[20, 21, 22], 5);
        traces.remove(8);
        traces[0].words.insert(29, Word::I16(2));
        Recipe::new(format, traces).open().unwrap()
    };
    for (format, nodata) in [(2, -2_147_483_648.0), (3, -32768.0), (11, 65535.0), (7, -2_147_483_648.0)] {
        let source = corner_missing(format);
        assert_eq!(source.info().nodata, Some(nodata), "format {format}");
        let values = read_all(&source);
        assert_eq!(values.iter().filter(|&&v| v == nodata).count(), 10);
        assert_eq!((values[0], values[8], values[1]), (nodata, nodata, value(1, 21, 0)));
        let survey = source.info().survey.as_ref().unwrap();
        assert_eq!((survey.missing_traces, survey.dead_traces), (1, 1));
    }
    let float = corner_missing(5);
    assert_eq!(float.info().nodata, None);
    assert_eq!(read_all(&float).iter().filter(|v| v.is_nan()).count(), 10);
}

#[test]
fn bytes_that_use_every_value_widen_where_there_are_holes() {
    let samples: Vec<f64> = (0..256).map(f64::from).collect();
    let with = |positions: &[(i32, i32)]| {
        let traces = positions.iter().map(|&(il, xl)| Trace { samples: samples.clone(), ..trace(il, xl, 0) });
        Recipe::new(16, traces.collect()).open().unwrap()
    };
    assert_eq!(with(&[(1, 1), (1, 2)]).info().voxel_type, VoxelType::U8);
    let holes = with(&[(1, 1), (1, 2), (2, 1)]);
    assert_eq!((holes.info().voxel_type, holes.info().nodata), (VoxelType::I16, Some(-32768.0)));
    let values = read_all(&holes);
    assert_eq!((values[4 * 255], values[4 * 255 + 3]), (255.0, -32768.0));
}

#[test]
fn live_traces_of_zeros_stay_zeros() {
    let mut traces = inline_sorted(&[1], &[20, 21], 4);
    traces[0].samples = vec![0.0; 4];
    let values = read_all(&Recipe::new(5, traces).open().unwrap());
    assert_eq!([values[0], values[2], values[4], values[6]], [0.0; 4]);
}

#[test]
fn dead_padding_without_line_numbers_is_left_out() {
    let mut traces = inline_sorted(&[100, 101], &[200, 201], 4);
    traces.push(Trace { words: BTreeMap::from([(29, Word::I16(2))]), ..trace(0, 0, 4) });
    let source = Recipe::new(5, traces).open().unwrap();
    assert_eq!(source.info().dims, Dims([2, 2, 4]));
    assert!(source.info().notes.iter().any(|n| n.to_string().contains("1 dead traces without line numbers")));
}

#[test]
fn samples_no_voxel_can_hold_are_named() {
    let with = |format, sample| {
        let mut traces = inline_sorted(&[1], &[20, 21], 4);
        traces[1].samples[2] = sample;
        let source = Recipe::new(format, traces).open().unwrap();
        let mut out = vec![0; source.info().dims.bytes(source.info().voxel_type).unwrap() as usize];
        source.read_box(source.info().dims.full_box(), &mut out).unwrap_err().to_string()
    };
    // The casts saturate: 2^63 - 1 and 2^64 - 1 are not exact in f64.
    for message in [with(1, 1e60), with(9, 1e30), with(12, 1e30)] {
        assert!(message.contains("trace 2, sample 3"), "{message}");
    }
}

#[test]
fn lying_headers_are_refused_with_the_reason() {
    let grid = || inline_sorted(&[1, 2], &[20, 21, 22], 5);
    let check = |recipe: Recipe, words: &[&str]| {
        let message = recipe.refusal();
        for word in words {
            assert!(message.contains(word), "no {word:?} in {message}");
        }
    };
    check(Recipe::new(5, grid()).word(3221, Word::I16(6)), &["whole number of traces", "bytes more"]);
    check(Recipe::new(5, grid()).word(3225, Word::I16(0)), &["sample format", "found 0"]);
    check(Recipe::new(5, grid()).word(3225, Word::I16(-5)), &["sample format", "found 65531"]);
    check(Recipe::new(5, grid()).word(3505, Word::I16(-2)), &["extended text headers", "-2"]);
    check(Recipe::new(5, grid()).word(3505, Word::I16(1000)), &["first trace", "3203600"]);
    let with_word = |index: usize, byte, word| {
        let mut traces = grid();
        traces[index].words.insert(byte, word);
        Recipe::new(5, traces)
    };
    check(with_word(3, 115, Word::I16(9)), &["trace 4", "expected 5", "found 9"]);
    check(with_word(4, 189, Word::I32(1)), &["traces 2 and 5 both stand at inline 1", "crossline 21"]);
    check(with_word(4, 189, Word::I32(i32::MAX)), &["less than 1/64", "(trace 5)"]);
    let mut lie = Recipe::new(5, grid()).word(3513, Word::U64(7));
    lie.revision = 2;
    check(lie, &["expected 7 traces", "found 6"]);
    let label = {
        let mut bytes = Recipe::new(5, grid()).bytes();
        bytes[..7].copy_from_slice(b"0001SY1");
        SegySource::from_bytes(Box::new(bytes), Path::new("x"), &SegyOptions::default()).expect_err("refused")
    };
    assert!(label.to_string().contains("tape label"), "{label}");
    let short = SegySource::from_bytes(Box::new(vec![0; 100]), Path::new("x"), &SegyOptions::default());
    assert!(short.expect_err("refused").to_string().contains("3600"));
}

#[test]
fn sample_counts_missing_in_the_binary_header_come_from_the_traces() {
    let mut traces = inline_sorted(&[1, 2], &[20, 21, 22], 5);
    traces.iter_mut().for_each(|t| t.words.extend([(115, Word::I16(5))]));
    let source = Recipe::new(5, traces.clone()).word(3221, Word::I16(0)).open().unwrap();
    assert_places(&source, Dims([3, 2, 5]).full_box());
    assert!(source.info().notes.iter().any(|n| n.to_string().contains("0 samples per trace")));
    traces[3].words.insert(115, Word::I16(4));
    assert!(Recipe::new(5, traces).word(3221, Word::I16(0)).refusal().contains("trace 4"));
}

#[test]
fn lines_in_other_bytes_are_suggested_and_then_read() {
    let mut traces = inline_sorted(&[1, 2, 3], &[20, 21], 5);
    for t in &mut traces {
        t.words = BTreeMap::from([(9, Word::I32(t.inline)), (21, Word::I32(t.crossline))]);
        t.words.extend([(189, Word::I32(0)), (193, Word::I32(0))]);
    }
    let recipe = Recipe::new(5, traces);
    let message = recipe.refusal();
    assert!(
        message.contains("`inline_byte` 9 `crossline_byte` 21 would read it as a full grid of 3 x 2 traces"),
        "{message}"
    );
    // The same with noise in bytes 189 and 193 that spans a huge grid.
    let mut noise = recipe.traces.clone();
    for (index, t) in noise.iter_mut().enumerate() {
        let number = (index as i32 + 1).wrapping_mul(0x2545_F491);
        t.words.extend([(189, Word::I32(number)), (193, Word::I32(number ^ 0x5A5A_5A5A))]);
    }
    let message = Recipe::new(5, noise).refusal();
    assert!(message.contains("less than 1/64") && message.contains("`inline_byte` 9 `crossline_byte` 21"), "{message}");
    let options = SegyOptions { inline_byte: 9, crossline_byte: 21, ..SegyOptions::default() };
    assert_places(&recipe.open_with(&options).unwrap(), Dims([2, 3, 5]).full_box());
}

#[test]
fn coordinates_give_the_spacing_where_they_are_lengths() {
    let with = |unit: i16, scale: f64, feet: i16| {
        let mut traces = inline_sorted(&[1, 2, 3], &[20, 22], 4);
        for t in &mut traces {
            let x = (f64::from(t.crossline) * 12.5 * scale) as i32;
            let y = (f64::from(t.inline) * 25.0 * scale) as i32;
            t.words = BTreeMap::from([(71, Word::I16(-100)), (89, Word::I16(unit))]);
            t.words.extend([(181, Word::I32(x)), (185, Word::I32(y))]);
        }
        Recipe::new(5, traces).word(3255, Word::I16(feet)).open().unwrap().info().clone()
    };
    let metres = with(1, 100.0, 1);
    assert_eq!(metres.geometry.spacing, [25.0, 25.0, 4.0]);
    assert_eq!((metres.axes[0].unit.as_str(), metres.axes[2].unit.as_str()), ("m", "ms"));
    assert_eq!(metres.survey.unwrap().corners.unwrap()[3], [275.0, 75.0]);
    assert_eq!(with(1, 100.0, 2).axes[1].unit, "ft");
    let degrees = with(3, 10.0, 1);
    assert_eq!((degrees.geometry.spacing[0], degrees.axes[0].unit.as_str()), (1.0, ""));
    assert!(degrees.notes.iter().any(|n| n.to_string().contains("decimal degrees")), "{:?}", degrees.notes);
}

#[test]
fn differing_delays_and_intervals_are_noted() {
    let mut traces = inline_sorted(&[1], &[20, 21], 4);
    traces[0].words.insert(109, Word::I16(100));
    traces[1].words.extend([(109, Word::I16(1040)), (215, Word::I16(-10)), (117, Word::I16(2000))]);
    let source = Recipe::new(5, traces).open().unwrap();
    let notes = source.info().notes.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n");
    assert!(notes.contains("from 100 ms (trace 1) to 104 ms (trace 2)"), "{notes}");
    assert!(notes.contains("2000 to 2000; the binary header's 4000"), "{notes}");
    assert_eq!(source.info().geometry.origin[2], 100.0);
}
