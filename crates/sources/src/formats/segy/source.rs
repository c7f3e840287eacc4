//! A SEG-Y file as a [`VolumeSource`].

use std::fs::File;
use std::path::{Path, PathBuf};

use supervol_format::{ByteSource, Dims, Geometry, VoxelBox};

use super::binary_header::BinaryHeader;
use super::file_header::read_file_header;
use super::grid::{Grid, GridDefect, Wanted};
use super::input::Input;
use super::layout::Layout;
use super::nodata::{self, Absent};
use super::options::{Duplicates, SegyOptions};
use super::read::{Neighbours, Reader};
use super::samples::SampleFormat;
use super::scan::Scan;
use super::{diagnose, sniff, survey, text_header};
use crate::input::file::SourceFile;
use crate::{AccessOrder, Axis, Message, ReadOption, SourceError, SourceInfo, Survey, VolumeSource};

/// A SEG-Y file as a volume.
pub struct SegySource {
    path: PathBuf,
    bytes: Box<dyn ByteSource>,
    layout: Layout,
    grid: Grid,
    absent: Absent,
    neighbours: Neighbours,
    pub(super) info: SourceInfo,
}

impl std::fmt::Debug for SegySource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SegySource").field("info", &self.info).finish_non_exhaustive()
    }
}

impl SegySource {
    /// Number of live traces of the grid.
    pub(super) fn live_traces(&self) -> u64 {
        self.grid.inline.count * self.grid.crossline.count - self.grid.missing - self.grid.dead
    }

    /// Opens a file: reads its headers, and the header of every trace.
    ///
    /// Integer files whose grid has holes are read once more, to find an unused value for absent voxels.
    ///
    /// # Errors
    /// If the file cannot be read, is not a post-stack 3D SEG-Y file, or contradicts itself.
    pub fn open(path: &Path, options: &SegyOptions) -> Result<Self, SourceError> {
        let source_file = SourceFile::of(path)?;
        let file = File::open(path).map_err(|e| SourceError::io(path, e))?;
        let mut source = Self::from_bytes(Box::new(file), path, options)?;
        source.info.files = vec![source_file];
        Ok(source)
    }

    /// The same, from any source of bytes; `path` is only used in messages.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn from_bytes(bytes: Box<dyn ByteSource>, path: &Path, options: &SegyOptions) -> Result<Self, SourceError> {
        let wanted = match options.duplicates {
            Duplicates::Refuse => Wanted::Only,
            Duplicates::First | Duplicates::Mean => Wanted::First,
            Duplicates::Last => Wanted::Last,
        };
        Self::of_wanted(bytes, path, options, wanted)
    }

    /// As [`Self::from_bytes`], with the wanted one of several traces at one place.
    pub(super) fn of_wanted(
        bytes: Box<dyn ByteSource>,
        path: &Path,
        options: &SegyOptions,
        wanted: Wanted,
    ) -> Result<Self, SourceError> {
        options.check()?;
        let input = Input { path, bytes: bytes.as_ref() };
        let (text, header) = read_file_header(input, options)?;
        let mut notes = Vec::new();
        let layout = Layout::resolve(input, &header, options, &mut notes)?;
        if options.format.is_none() || layout.format == SampleFormat::FixedPointWithGain {
            sniff::check_format(input, &layout)?;
        }
        let scan = Scan::run(input, &layout, &header, options)?;
        let grid = Grid::build(input, &scan, &layout, (options, wanted)).map_err(|defect| match defect {
            GridDefect::Refused(error) => error,
            GridDefect::NoGrid(why) => diagnose::refuse(input, &layout, options, &why),
        })?;
        let holes = grid.missing + grid.dead > 0;
        let absent = if holes {
            nodata::choose(input, &layout)?
        } else {
            Absent { voxel_type: layout.format.voxel_type(), value: f64::NAN }
        };
        note_traces(&layout, &scan, &grid, (absent, options.samples.is_some()), &mut notes);
        let neighbours =
            if scan.steps_along[1] > scan.steps_along[0] { Neighbours::AlongY } else { Neighbours::AlongX };
        let mut info = {
            let read = ReadHeaders { input, layout: &layout, header: &header, scan: &scan, grid: &grid };
            read.describe(options, text, notes)?
        };
        info.voxel_type = absent.voxel_type;
        info.memory_bytes = grid.memory_bytes();
        info.reading = options.describe();
        info.nodata = (!absent.value.is_nan()).then_some(absent.value);
        info.access_order = AccessOrder(if neighbours == Neighbours::AlongX { [1, 0, 2] } else { [0, 1, 2] });
        Ok(Self { path: path.into(), bytes, layout, grid, absent, neighbours, info })
    }
}

impl VolumeSource for SegySource {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        let reader = Reader {
            input: Input { path: &self.path, bytes: self.bytes.as_ref() },
            layout: &self.layout,
            grid: &self.grid,
            absent: self.absent,
            neighbours: self.neighbours,
        };
        reader.read_box(self.info.dims, voxels, out)
    }
}

/// Notes missing, dead and skipped traces, and contradictions between headers.
fn note_traces(layout: &Layout, scan: &Scan, grid: &Grid, (absent, given): (Absent, bool), notes: &mut Vec<Message>) {
    let stored = if absent.value.is_nan() { "NaN".to_owned() } else { format!("{}", absent.value) };
    if grid.missing > 0 {
        notes.push(
            format!("{} places of the grid have no trace; their voxels are absent ({stored})", grid.missing).into(),
        );
    }
    if grid.dead > 0 {
        notes.push(format!("{} traces are marked dead; their voxels are absent ({stored})", grid.dead).into());
    }
    if scan.other_offsets > 0 {
        notes.push(format!("{} traces of other offsets were left out", scan.other_offsets).into());
    }
    if scan.skipped > 0 {
        notes.push(format!("{} traces were left out by hand", scan.skipped).into());
    }
    if grid.duplicates > 0 {
        notes.push(format!("{} traces stand where others do; one was read at each place", grid.duplicates).into());
    }
    if scan.padding > 0 {
        notes.push(format!("{} dead traces without line numbers were left out", scan.padding).into());
    }
    if absent.voxel_type != layout.format.voxel_type() {
        notes.push(
            format!(
                "every {} value occurs in the file; voxels were widened to {} to have one for absence",
                layout.format.voxel_type(),
                absent.voxel_type
            )
            .into(),
        );
    }
    if let Some(samples) = scan.overruled_samples {
        let why = if given { "given by hand" } else { "of the binary header, which declares a fixed trace length," };
        let read = layout.samples;
        notes.push(format!("trace headers say {samples} samples (bytes 115-116); the {read} {why} were read").into());
    }
    if let Some(delay) = scan.delay_ms
        && delay.min.0 != delay.max.0
    {
        notes.push(format!(
            "delays differ between traces, from {} ms (trace {}) to {} ms (trace {}); traces were not shifted, and the \
             first sample is taken to lie at the smallest",
            delay.min.0,
            delay.min.1 + 1,
            delay.max.0,
            delay.max.1 + 1
        ).into());
    }
}

/// All headers of a file.
struct ReadHeaders<'a> {
    input: Input<'a>,
    layout: &'a Layout,
    header: &'a BinaryHeader,
    scan: &'a Scan,
    grid: &'a Grid,
}

impl ReadHeaders<'_> {
    /// Grid, world and survey, once traces and grid are known.
    fn describe(
        self,
        options: &SegyOptions,
        text_header: String,
        mut notes: Vec<Message>,
    ) -> Result<SourceInfo, SourceError> {
        let Self { input, layout, header, scan, grid } = self;
        let placement = survey::place(input, (layout, header), scan, grid, &mut notes)?;
        let interval = survey::sample_interval(header, scan, options.interval, &mut notes);
        let depth = text_header::says_depth_domain(&text_header);
        let (z_name, z_unit) = match (interval, depth, header.feet) {
            (None, _, _) => ("sample", ""),
            (_, false, _) => ("time", "ms"),
            (_, true, false) => ("depth", "m"),
            (_, true, true) => ("depth", "ft"),
        };
        if z_name == "time" && text_header::may_mean_depth(&text_header) {
            notes.push(
                Message::from("the third axis is taken for time; the text header speaks of depth, too: ")
                    .option(ReadOption::Domain)
                    .text(" depth says that"),
            );
        }
        // Without an interval the z axis counts samples, and a delay in ms has no place on it.
        let first_sample = interval.and(scan.delay_ms).map_or(0.0, |delay| delay.min.0);
        let spacing_z = interval.unwrap_or(1.0);
        let dims = Dims([grid.crossline.count, grid.inline.count, layout.samples]);
        let axis = |name: &str, unit: &str| Axis { name: name.into(), unit: unit.into() };
        let mut info = SourceInfo::plain("segy", dims, layout.format.voxel_type());
        info.geometry = Geometry {
            spacing: [placement.spacing[0], placement.spacing[1], spacing_z],
            origin: [0.0, 0.0, first_sample],
            direction: survey::direction(placement.corners),
        };
        info.axes = [axis("crossline", placement.units[0]), axis("inline", placement.units[1]), axis(z_name, z_unit)];
        info.survey = Some(Survey {
            inline: grid.inline,
            crossline: grid.crossline,
            corners: placement.corners,
            sample_interval: spacing_z,
            first_sample,
            missing_traces: grid.missing,
            dead_traces: grid.dead,
            text_header,
        });
        info.notes = notes;
        if let Some(defect) = info.geometry.defect() {
            return Err(input.invalid("geometry from coordinates and sample interval", "finite lengths", defect));
        }
        Ok(info)
    }
}
