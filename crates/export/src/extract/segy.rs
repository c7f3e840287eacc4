//! SEG-Y writer: traces along z, big endian, inline after inline, with the survey's line numbers and coordinates.
//!
//! It writes revision 1 if that suffices, else 2.0. Revision 2.0 is needed for unsigned and double samples, traces of
//! more than 32,767 samples, and intervals that are not whole microseconds. Line numbers are at bytes 189 and 193,
//! coordinates at 181 and 185, as in the standard. Without a survey, lines are counted from 1, and coordinates are
//! world coordinates. Traces without present voxels are marked dead.

use std::io::{BufWriter, Write};
use std::path::Path;

use supervol_files::OutputFile;
use supervol_format::voxel_type::{Absence, voxels_as_f64};
use supervol_format::{Container, Geometry, VoxelBox, VoxelType, cast};
use supervol_preprocess::error::BuildError;
use supervol_preprocess::level_reader::by_all_threads;
use supervol_sources::formats::segy::{TEXT_BYTES, encode_text};
use supervol_sources::{LineNumbers, Survey};

use super::headers::Place;
use super::{Extraction, Plan, WRITE_BUFFER_BYTES, needs_scaling, scaled};

/// Bytes of the binary header, and of a trace header.
const BINARY_BYTES: usize = 400;
const TRACE_BYTES: usize = 240;
/// Lines of the text header that we write; those of the survey follow.
const OWN_LINES: usize = 6;

/// Header values that all traces share.
struct Headers {
    voxel_type: VoxelType,
    /// Format code of the samples.
    format: u16,
    is_second: bool,
    samples: usize,
    /// Sample interval in thousandths of the z axis's unit.
    interval: f64,
    /// First sample: value and scalar.
    delay: (i16, i16),
    lines: Lines,
    /// Divisor of the stored coordinates: a power of ten, at most 1000.
    divisor: i16,
    is_feet: bool,
    is_depth: bool,
}

/// Line numbers and coordinates of the traces.
struct Lines {
    /// Number of the first inline and the step from line to line; then the same for crosslines.
    inline: [i64; 2],
    crossline: [i64; 2],
    /// Position of the first trace on the grid of the corners, and the step from trace to trace, along x and y.
    start: [f64; 2],
    step: [f64; 2],
    /// Coordinates of the grid's first point, and the increments along x, along y, and along both: the corners need not
    /// form a parallelogram.
    origin: [f64; 2],
    along: [[f64; 2]; 3],
}

impl Lines {
    fn of(container: &Container, what: &Extraction, voxels: VoxelBox, geometry: &Geometry) -> Self {
        let scale = container.pyramid().level_at(what.lod).scale.map(cast::narrow::<i64>);
        // A coarse voxel gets the line number at the middle of its lines.
        let fine = |axis: usize| cast::narrow::<i64>(voxels.start[axis]) * scale[axis] + (scale[axis] - 1) / 2;
        let survey = Survey::of(container.manifest());
        let numbers = |line: Option<LineNumbers>, axis: usize| match line {
            Some(line) => [line.first + fine(axis) * line.step, line.step * scale[axis]],
            None => [1 + cast::narrow::<i64>(voxels.start[axis]) * scale[axis], scale[axis]],
        };
        let inline = numbers(survey.as_ref().map(|s| s.inline), 1);
        let crossline = numbers(survey.as_ref().map(|s| s.crossline), 0);
        let corners = survey.as_ref().and_then(|s| Some((s.corners?, [s.crossline.count, s.inline.count])));
        let Some((points, counts)) = corners else {
            // Unknown coordinates of a survey are zero. Other volumes have their world coordinates.
            let known = if survey.is_some() { 0.0 } else { 1.0 };
            let linear = geometry.linear() * known;
            let [x, y] = [0, 1].map(|axis| [linear.col(axis).x, linear.col(axis).y]);
            let origin = [geometry.origin[0] * known, geometry.origin[1] * known];
            return Self { inline, crossline, start: [0.0; 2], step: [1.0; 2], origin, along: [x, y, [0.0; 2]] };
        };
        let [nx, ny] = counts.map(|n| (n.max(2) - 1) as f64);
        let [first, last_x, last_y, last] = points;
        let x = [0, 1].map(|c| (last_x[c] - first[c]) / nx);
        let y = [0, 1].map(|c| (last_y[c] - first[c]) / ny);
        let both = [0, 1].map(|c| (last[c] - last_x[c] - last_y[c] + first[c]) / (nx * ny));
        let step = [0, 1].map(|axis| scale[axis] as f64);
        let start = [0, 1].map(|axis| (voxels.start[axis] as f64 + 0.5) * step[axis] - 0.5);
        Self { inline, crossline, start, step, origin: first, along: [x, y, both] }
    }

    fn point(&self, at: [usize; 2]) -> [f64; 2] {
        let [u, v] = [0, 1].map(|axis| self.start[axis] + self.step[axis] * at[axis] as f64);
        let [x, y, both] = self.along;
        [0, 1].map(|c| self.origin[c] + x[c] * u + y[c] * v + both[c] * u * v)
    }
}

impl Headers {
    fn new(
        container: &Container,
        output: &Path,
        what: &Extraction,
        (voxels, place): (VoxelBox, &Place<'_>),
    ) -> Result<Self, BuildError> {
        let refused = |message: String| BuildError::Options(format!("{}: {message}", output.display()));
        let (format, is_new) = match place.voxel_type {
            VoxelType::I32 => (2, false),
            VoxelType::I16 => (3, false),
            VoxelType::F32 => (5, false),
            VoxelType::F64 => (6, true),
            VoxelType::I8 => (8, false),
            VoxelType::U32 => (10, true),
            VoxelType::U16 => (11, true),
            VoxelType::U8 => (16, true),
        };
        let [nx, ny, samples] = place.sizes;
        let unit = container.manifest().axes[2].unit.as_str();
        let per_thousandth = if unit == "s" { 1e6 } else { 1e3 };
        let interval = place.geometry.spacing[2] * per_thousandth;
        let is_plain = interval.fract() == 0.0 && interval <= f64::from(i16::MAX);
        let first = place.geometry.origin[2] * per_thousandth / 1e3;
        let delay = delay(first, interval / 1e3).ok_or_else(|| {
            refused(format!(
                "SEG-Y has no place for a first sample at {first}; choose a box that begins elsewhere, or .nrrd"
            ))
        })?;
        let lines = Lines::of(container, what, voxels, &place.geometry);
        let corners = [[0, 0], [nx - 1, 0], [0, ny - 1], [nx - 1, ny - 1]].map(|at| lines.point(at));
        let largest = corners.as_flattened().iter().fold(0f64, |most, v| most.max(v.abs()));
        let fits = |divisor: &i16| largest * f64::from(*divisor) < f64::from(i32::MAX);
        let divisor = [1000, 100, 10, 1].into_iter().find(fits);
        let divisor = divisor.ok_or_else(|| refused(format!("SEG-Y has no place for coordinates of {largest}")))?;
        let last = |[first, step]: [i64; 2], count: usize| first + step * (cast::narrow::<i64>(count) - 1);
        let numbers = [lines.inline[0], last(lines.inline, ny), lines.crossline[0], last(lines.crossline, nx)];
        if numbers.iter().any(|n| i32::try_from(*n).is_err()) || samples > i32::MAX as usize {
            return Err(refused("SEG-Y has no place for line numbers or samples of more than 31 bits".into()));
        }
        Ok(Self {
            voxel_type: place.voxel_type,
            format,
            is_second: is_new || !is_plain || samples > i16::MAX as usize,
            samples,
            interval,
            delay,
            lines,
            divisor,
            is_feet: place.unit == "ft",
            is_depth: container.manifest().axes[2].name == "depth",
        })
    }

    /// Text header and binary header.
    fn file_header(&self, container: &Container) -> Vec<u8> {
        let manifest = container.manifest();
        let domain = if self.is_depth { "DOMAIN: DEPTH" } else { "" };
        let mut lines = vec![
            format!("WRITTEN BY {} FROM {}", manifest.tool, manifest.source.name),
            "INLINE AT BYTES 189-192, CROSSLINE AT 193-196".into(),
            "CDP X AT BYTES 181-184, CDP Y AT 185-188, SCALAR AT 71-72".into(),
            domain.into(),
            String::new(),
            "TEXT OF THE SOURCE:".into(),
        ];
        if let Some(survey) = Survey::of(manifest) {
            lines.extend(survey.text_header.lines().take(40 - OWN_LINES).map(str::to_owned));
        }
        let text: String = (0..40)
            .map(|i| {
                let line = lines.get(i).map_or("", String::as_str);
                let line = if i < OWN_LINES { format!("C{:2} {line}", i + 1) } else { line.into() };
                let line: String = line.chars().take(80).collect();
                format!("{line:80}")
            })
            .collect();
        let mut header = encode_text(&text);
        header.resize(TEXT_BYTES, 0x40);
        let mut binary = [0; BINARY_BYTES];
        let mut put = |byte: usize, value: &[u8]| binary[byte - 3201..][..value.len()].copy_from_slice(value);
        // Values that do not fit are in revision 2's own fields.
        // Saturating: longer intervals are cut to the limit below.
        let interval = if self.interval.fract() == 0.0 { cast::whole::<u16>(self.interval) } else { 0 };
        put(3217, &interval.min(i16::MAX as u16).to_be_bytes());
        put(3221, &u16::try_from(self.samples).unwrap_or(0).to_be_bytes());
        put(3225, &self.format.to_be_bytes());
        put(3255, &(if self.is_feet { 2u16 } else { 1 }).to_be_bytes());
        put(3501, &[if self.is_second { 2 } else { 1 }, 0]);
        put(3503, &1u16.to_be_bytes());
        if self.is_second {
            let samples = u32::try_from(self.samples).expect("`new` refuses more samples than fit 31 bits");
            put(3269, &samples.to_be_bytes());
            put(3273, &self.interval.to_be_bytes());
            put(3297, &[1, 2, 3, 4]);
        }
        header.extend(binary);
        header
    }

    fn trace_header(&self, number: u64, at: [usize; 2], is_dead: bool) -> [u8; TRACE_BYTES] {
        let mut header = [0; TRACE_BYTES];
        let mut put = |byte: usize, value: &[u8]| header[byte - 1..][..value.len()].copy_from_slice(value);
        #[expect(
            clippy::cast_possible_truncation,
            reason = "the low 32 bits are wanted: the numbers of more traces wrap around"
        )]
        let number = (number as u32).wrapping_add(1).to_be_bytes();
        let line = |[first, step]: [i64; 2], at: usize| {
            let number = i32::try_from(first + step * cast::narrow::<i64>(at));
            number.expect("`new` has checked the first and the last line number").to_be_bytes()
        };
        #[expect(
            clippy::cast_possible_truncation,
            reason = "saturating, and `new` has chosen a divisor with which the corners fit"
        )]
        let [x, y] = self.lines.point(at).map(|v| ((v * f64::from(self.divisor)).round() as i32).to_be_bytes());
        put(1, &number);
        put(5, &number);
        put(29, &(if is_dead { 2i16 } else { 1 }).to_be_bytes());
        put(71, &(if self.divisor > 1 { -self.divisor } else { 1 }).to_be_bytes());
        put(89, &1i16.to_be_bytes());
        put(109, &self.delay.0.to_be_bytes());
        put(115, &u16::try_from(self.samples).unwrap_or(0).to_be_bytes());
        let is_plain = self.interval.fract() == 0.0 && self.interval <= f64::from(i16::MAX);
        #[expect(clippy::cast_possible_truncation, reason = "a plain interval is a positive whole number that fits")]
        let interval = if is_plain { self.interval as i16 } else { 0 };
        put(117, &interval.to_be_bytes());
        put(181, &x);
        put(185, &y);
        put(189, &line(self.lines.inline, at[1]));
        put(193, &line(self.lines.crossline, at[0]));
        put(215, &self.delay.1.to_be_bytes());
        header
    }
}

/// The first sample as a number and a scalar: the closest pair, if it is within a thousandth of a sample.
#[expect(
    clippy::cast_possible_truncation,
    reason = "the candidates are whole numbers, and those beyond the limit are filtered out"
)]
fn delay(first: f64, interval: f64) -> Option<(i16, i16)> {
    let limit = f64::from(i16::MAX);
    let candidates = [1i16, -10, -100, -1000, -10000, 10, 100, 1000, 10000].map(|scalar| {
        let factor = f64::from(scalar.abs());
        let number = if scalar < 0 { (first * factor).round() } else { (first / factor).round() };
        let back = if scalar < 0 { number / factor } else { number * factor };
        (number, scalar, (back - first).abs())
    });
    let fitting = candidates.into_iter().filter(|(number, ..)| number.abs() <= limit);
    let (number, scalar, _) = fitting.min_by(|a, b| a.2.total_cmp(&b.2)).filter(|best| best.2 <= interval / 1000.0)?;
    Some((number as i16, scalar))
}

pub(super) fn write(
    container: &Container,
    output: &Path,
    what: &Extraction,
    (voxels, place): (VoxelBox, &Place<'_>),
) -> Result<(), BuildError> {
    let headers = Headers::new(container, output, what, (voxels, place))?;
    let write_error = |e| BuildError::write(output, e);
    let file = OutputFile::begin(output, what.existing)?;
    let mut plain = BufWriter::with_capacity(WRITE_BUFFER_BYTES, file.file());
    plain.write_all(&headers.file_header(container)).map_err(write_error)?;
    let descriptor = container.descriptor();
    let plan = Plan::of_boxes(descriptor, place.voxel_type, what.memory_bytes, voxels.extent()[2] as u64)?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(plan.threads).build();
    let pool = pool.map_err(|source| BuildError::Threads { threads: plan.threads, source })?;
    let reader = by_all_threads(container, what.lod, plan.cache_bytes);
    pool.install(|| {
        for part in trace_boxes(voxels, plan.box_voxels, container.pyramid().layout().core() as u64) {
            let mut bytes = vec![0; part.voxels() * descriptor.voxel_type.bytes()];
            reader.read_box(part, &mut bytes).map_err(|e| BuildError::container(container.path(), e))?;
            if needs_scaling(descriptor, place.voxel_type) {
                bytes = scaled(descriptor, &bytes, place.voxel_type);
            }
            write_traces(&headers, descriptor.absence, (part, voxels), &bytes, &mut plain).map_err(write_error)?;
        }
        Ok::<_, BuildError>(())
    })?;
    plain.flush().map_err(write_error)?;
    drop(plain);
    file.publish()?;
    Ok(())
}

/// Boxes of whole traces in file order, as large as allowed: some inlines, one inline, or a part of one.
fn trace_boxes(voxels: VoxelBox, most_voxels: u64, core: u64) -> impl Iterator<Item = VoxelBox> {
    let [nx, _, nz] = voxels.extent().map(|n| n as u64);
    let rows = (most_voxels / (nx * nz)).min(core).max(1);
    let columns = if most_voxels >= nx * nz { nx } else { (most_voxels / nz).max(1) };
    let starts = move |axis: usize, step: u64| (voxels.start[axis]..voxels.end[axis]).step_by(cast::index(step));
    starts(1, rows).flat_map(move |y| {
        starts(0, columns).map(move |x| VoxelBox {
            start: [x, y, voxels.start[2]],
            end: [(x + columns).min(voxels.end[0]), (y + rows).min(voxels.end[1]), voxels.end[2]],
        })
    })
}

/// Writes the traces of a box; `bytes` has its voxels, x fastest.
fn write_traces(
    headers: &Headers,
    absence: Absence,
    (part, whole): (VoxelBox, VoxelBox),
    bytes: &[u8],
    out: &mut impl Write,
) -> std::io::Result<()> {
    let size = headers.voxel_type.bytes();
    let [nx, ny, nz] = part.extent();
    let width = whole.extent()[0];
    let start = [0, 1].map(|axis| cast::index(part.start[axis] - whole.start[axis]));
    let mut trace = vec![0; nz * size];
    for y in 0..ny {
        for x in 0..nx {
            for (z, sample) in trace.chunks_exact_mut(size).enumerate() {
                sample.copy_from_slice(&bytes[(x + nx * (y + ny * z)) * size..][..size]);
            }
            let is_dead = voxels_as_f64(headers.voxel_type, &trace).into_iter().all(|v| absence.is_absent(v));
            let at = [start[0] + x, start[1] + y];
            out.write_all(&headers.trace_header((at[1] * width + at[0]) as u64, at, is_dead))?;
            trace.chunks_exact_mut(size).for_each(<[u8]>::reverse);
            out.write_all(&trace)?;
        }
    }
    Ok(())
}
