//! Samples values of a volume at points, through the streamer: for slices.
//!
//! Sampling runs in passes, like ray casting. Points in resident bricks get their values; the bricks of all others are
//! fetched. At the deadline coarser bricks stand in, or the point stays absent.

use std::collections::BTreeSet;
use std::time::Instant;

use rayon::prelude::*;
use supervol_format::brick::APRON;
use supervol_format::cast::{narrow, single, whole};
use supervol_format::{BrickIndex, BrickKey, Geometry, Lod, Pyramid};
use supervol_scene::slices::{Interpolation, interpolate};
use supervol_scene::units::InUnits;
use supervol_scene::value_map::ValueMap;
use supervol_scene::value_map::value_map;

use crate::render::error::RenderError;
use crate::stop::{LEAST_STEP, Stop};
use crate::stream::field::{Field, FieldBrick};
use crate::stream::residency::{BrickView, DecodedBrick, Resident, Voxels};
use crate::stream::streamer::{HostView, OnMissing, Room, Streamer};

/// Points per task.
const TASK_POINTS: usize = 4096;

/// Samples one level.
pub struct Sampler<'a> {
    streamer: &'a mut Streamer,
    pyramid: Pyramid,
    map: ValueMap,
    lod: Lod,
    stop: Stop,
    on_missing: OnMissing,
    passes: u64,
}

/// A chunk of points in progress.
#[derive(Debug, Default)]
pub struct Chunk {
    /// Render values; NaN is absent, or not known yet.
    pub values: Vec<f32>,
    waiting: Vec<usize>,
}

/// Result of one task.
#[derive(Default)]
struct TaskSamples {
    /// Number of a point, and its render value; NaN is absent.
    values: Vec<(usize, f32)>,
    /// Points whose brick is missing.
    waiting: Vec<usize>,
    misses: BTreeSet<BrickKey>,
    uses: BTreeSet<BrickKey>,
}

impl<'a> Sampler<'a> {
    /// A sampler of a level; aims the streamer at it.
    ///
    /// # Errors
    /// If there is a deadline and memory does not suffice for the coarsest level.
    pub fn new(streamer: &'a mut Streamer, lod: Lod, stop: Stop) -> Result<Self, RenderError> {
        let container = streamer.container().clone();
        let pyramid = container.pyramid().clone();
        streamer.begin_frame();
        streamer.begin_band();
        if stop.deadline().is_some() {
            // The coarsest level stands in at the deadline.
            let coarsest = Field::FIRST.bricks(pyramid.keys_of(pyramid.coarsest()));
            streamer
                .fetch_to_keep(&coarsest, Room { bricks: usize::MAX, stop: stop.instead_at(None), patience: None })?;
        }
        let on_missing = OnMissing::Wait;
        Ok(Self { map: value_map(&container), streamer, pyramid, lod, stop, on_missing, passes: 0 })
    }

    /// The same, with coarser bricks in place of missing ones.
    #[must_use]
    pub fn of_what_is_there(self) -> Self {
        Self { on_missing: OnMissing::UseParent, ..self }
    }

    /// Map from stored values to render values.
    #[must_use]
    pub fn map(&self) -> &ValueMap {
        &self.map
    }

    /// Geometry of level 0, and the voxels of level 0 along each axis of one voxel of this level.
    #[must_use]
    pub fn grid(&self) -> (Geometry, [u64; 3]) {
        let container = self.streamer.container();
        (InUnits::of(container).geometry, container.pyramid().level_at(self.lod).scale)
    }

    /// Samples the waiting points of a chunk (index coordinates of level 0) until none waits or the deadline passes.
    /// Returns whether none waits.
    ///
    /// # Errors
    /// If memory does not suffice, there is no progress, or it is cancelled.
    pub fn advance(&mut self, points: &[[f64; 3]], how: Interpolation, chunk: &mut Chunk) -> Result<bool, RenderError> {
        self.stop = self.stop.not_before(Instant::now() + LEAST_STEP);
        if chunk.values.len() != points.len() {
            *chunk = Chunk { values: vec![f32::NAN; points.len()], waiting: (0..points.len()).collect() };
        }
        while !chunk.waiting.is_empty() {
            if self.stop.is_cancelled() {
                return Err(RenderError::Cancelled);
            }
            self.streamer.begin_pass();
            self.passes += 1;
            let (pyramid, map, lod) = (&self.pyramid, &self.map, self.lod);
            let view = self.streamer.view(self.on_missing);
            let look = |task: &[usize]| {
                let mut found = TaskSamples::default();
                for &point in task {
                    look_up(&view, (pyramid, map, lod), (point, points[point]), how, &mut found);
                }
                found
            };
            let found: Vec<TaskSamples> = chunk.waiting.par_chunks(TASK_POINTS).map(look).collect();
            chunk.waiting.clear();
            let (mut misses, mut uses) = (BTreeSet::new(), BTreeSet::new());
            for task in found {
                task.values.into_iter().for_each(|(point, value)| chunk.values[point] = value);
                chunk.waiting.extend(task.waiting);
                misses.extend(task.misses);
                uses.extend(task.uses);
            }
            let [misses, uses] = [misses, uses].map(|keys: BTreeSet<BrickKey>| view.field().bricks(keys));
            self.streamer.note_uses(&uses, misses.len() as u64);
            if !misses.is_empty() {
                self.fetch(&misses, chunk.waiting.len())?;
                if self.stop.is_due() {
                    return Ok(false);
                }
            }
        }
        Ok(true)
    }

    fn fetch(&mut self, misses: &[FieldBrick], waiting: usize) -> Result<(), RenderError> {
        let room = Room { bricks: usize::MAX, stop: self.stop.clone(), patience: None };
        let fetched = self.streamer.fetch(misses, room)?;
        if fetched.is_progress() || self.stop.is_due() {
            return Ok(());
        }
        let first = misses.first().map_or("none".into(), ToString::to_string);
        Err(RenderError::NoProgress { pass: self.passes, remaining: waiting as u64, wanted: misses.len(), first })
    }
}

/// The value at a point, from the brick that holds its nearest voxel, or from a coarser one that stands in.
fn look_up(
    view: &HostView<'_>,
    (pyramid, map, finest): (&Pyramid, &ValueMap, Lod),
    (number, point): (usize, [f64; 3]),
    how: Interpolation,
    found: &mut TaskSamples,
) {
    let core = pyramid.layout().core() as u64;
    for lod in (finest.0..=pyramid.coarsest().0).map(Lod) {
        let level = pyramid.level_at(lod);
        let p = level.from_level_0(point);
        let nearest: [u64; 3] =
            std::array::from_fn(|a| whole::<u64>((p[a] + 0.5).floor().clamp(0.0, level.dims.0[a] as f64 - 1.0)));
        let key = BrickKey::new(lod, BrickIndex(nearest.map(|n| narrow::<u32>(n / core))));
        let resident = if lod == finest { view.lookup(key) } else { view.stand_in(key) };
        let value = match resident {
            Resident::Brick(brick) => {
                let brick = brick.read();
                found.uses.insert(key);
                let first = pyramid.core_box(key).start.map(|s| narrow::<i64>(s) - narrow::<i64>(APRON));
                single(interpolate(p, how, |index| voxel(&brick, map, std::array::from_fn(|a| index[a] - first[a]))))
            }
            Resident::Uniform(value) => value,
            Resident::Nothing => f32::NAN,
            Resident::Missing => {
                found.misses.insert(key);
                found.waiting.push(number);
                return;
            }
            Resident::UseParent | Resident::TooCoarse => continue,
        };
        found.values.push((number, value));
        return;
    }
    // No brick covers it, however coarse.
    found.values.push((number, f32::NAN));
}

/// Render value of a voxel of a brick, apron included; NaN where absent.
fn voxel(brick: &DecodedBrick, map: &ValueMap, at: [i64; 3]) -> f64 {
    let extent = brick.extent.map(|n| n as usize);
    let [i, j, k]: [usize; 3] = std::array::from_fn(|a| narrow::<usize>(at[a].clamp(0, narrow::<i64>(extent[a]) - 1)));
    let place = i + extent[0] * (j + extent[1] * k);
    let of_number = |number: u16| {
        if map.absent == Some(number) { f64::NAN } else { f64::from(map.from_stored_number(f32::from(number))) }
    };
    match &brick.voxels {
        Voxels::U8(voxels) => of_number(voxels[place].into()),
        Voxels::U16(voxels) => of_number(voxels[place]),
        Voxels::F32(voxels) => voxels[place].into(),
    }
}
