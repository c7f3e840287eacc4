//! Overview: a coarse level of the volume in memory, used to estimate the visible region and the range of projections.
//!
//! The finest level of at most 2^18 voxels is read once. Its voxels are averages, so that smaller features may be
//! missed and the estimates are approximate. Labels are never averaged, and thin ones would be missed altogether. For
//! labels, macro cells of a fine level give their positions. For measured values, macro cells would show every grain of
//! noise.

use glam::DVec3;
use supervol_format::brick::MACRO_CELL;
use supervol_format::cast::{narrow, whole};
use supervol_format::container::ContainerError;
use supervol_format::level_reader::LevelReader;
use supervol_format::space::HALF_VOXEL;
use supervol_format::{BrickKey, Container, Level, Lod, ValueRange};

use super::table;
use super::view::Framed;
use crate::facts::histogram::Histogram;
use crate::facts::{DataKind, VolumeFacts};
use crate::spec::{Mode, PlaneSpec};
use crate::transfer_function::TransferFunction;

/// Most voxels of the level; 8 bytes each.
const VOXEL_LIMIT: u64 = 1 << 18;
/// Limits of the macro cells that are read: cells of 40 bytes each, bricks, and bytes of the bricks' records.
const CELL_LIMIT: u64 = 1 << 18;
const BRICK_LIMIT: u64 = 512;
const RECORDS_LIMIT_BYTES: u64 = 16 << 20;
/// Most labels in the range of a macro cell that are checked one by one.
const LABEL_LIMIT: f64 = 1024.0;
/// Opacity over the unit distance above which a value counts as visible, as a share of the greatest opacity.
const VISIBLE_SHARE: f64 = 0.02;
/// Share of far values from which they are no outliers, but a null.
const NULL_SHARE: f64 = 0.001;
/// Quantiles of the projected values that bound the window of a projection.
const DARKEST: f64 = 0.005;
const BRIGHTEST: f64 = 0.998;

/// A coarse level in memory.
#[derive(Debug, Clone)]
pub struct Overview {
    dims: [usize; 3],
    level: Level,
    /// Data values, x fastest; NaN where absent.
    values: Vec<f64>,
    /// Macro cells, for labels only.
    cells: Option<LabelCells>,
    /// Planes that cut away the table that a patient lies on; none if there is no table.
    table: Vec<PlaneSpec>,
}

/// A clip box in index coordinates of level 0, and the clip planes of the scene.
type Kept<'a> = ([[f64; 3]; 2], &'a [PlaneSpec]);

/// Macro cells of one level of a volume of labels.
#[derive(Debug, Clone)]
struct LabelCells {
    /// Half the size of a cell, in voxels of level 0 along x, y, z.
    half: DVec3,
    /// Centre of each cell in index coordinates of level 0, and the range of its labels.
    cells: Vec<(DVec3, ValueRange)>,
}

impl LabelCells {
    /// The cells of the finest level within the limits; `None` if there is no such level.
    fn read(container: &Container) -> Result<Option<Self>, ContainerError> {
        for (number, level) in container.pyramid().levels().iter().enumerate() {
            let cells = level.dims.0.map(|n| n.div_ceil(MACRO_CELL as u64));
            let cells = cells.iter().fold(1, |product: u64, &n| product.saturating_mul(n));
            if cells <= CELL_LIMIT
                && level.brick_count() <= BRICK_LIMIT
                && let Some(cells) = Self::of_level(container, Lod(narrow::<u8>(number)), level)?
            {
                return Ok(Some(cells));
            }
        }
        Ok(None)
    }

    /// The cells of one level; `None` if its records are too large.
    fn of_level(container: &Container, lod: Lod, level: &Level) -> Result<Option<Self>, ContainerError> {
        let pyramid = container.pyramid();
        let keys: Vec<BrickKey> = pyramid.keys_of(lod).collect();
        // An index page that cannot be read now is read again below, with an error if it fails.
        container.read_entries_ahead(keys.iter().copied(), || true).ok();
        let entries = keys.iter().map(|&key| container.entry(key)).collect::<Result<Vec<_>, _>>()?;
        if entries.iter().map(|entry| entry.record_bytes()).sum::<u64>() > RECORDS_LIMIT_BYTES {
            return Ok(None);
        }
        let (scale, offset) = (container.descriptor().scale, container.descriptor().offset);
        let voxels = DVec3::from_array(level.scale.map(|s| s as f64));
        let core = pyramid.layout().core() as f64;
        let mut cells = Vec::new();
        for (key, entry) in keys.into_iter().zip(entries) {
            let [nx, ny, _] = pyramid.macro_cells(key);
            let first = DVec3::from_array(key.brick().0.map(f64::from)) * core;
            for (i, range) in container.read_macro_cells(key, &entry)?.into_iter().enumerate() {
                let cell = [i % nx, i / nx % ny, i / (nx * ny)].map(|n| (n * MACRO_CELL) as f64);
                // The centre of the cell's region, which begins half a voxel before the cell's first voxel.
                let middle = (first + DVec3::from_array(cell) + 0.5 * MACRO_CELL as f64) * voxels - HALF_VOXEL;
                let [a, b] = [range.min, range.max].map(|stored| stored * scale + offset);
                cells.push((middle, ValueRange { min: a.min(b), max: a.max(b) }));
            }
        }
        Ok(Some(Self { half: voxels * (0.5 * MACRO_CELL as f64), cells }))
    }

    /// Centres of the cells that may hold a label for which `is_visible` holds.
    fn visible<'a>(&'a self, is_visible: impl Fn(f64) -> bool + 'a) -> impl Iterator<Item = DVec3> + 'a {
        let may_show = move |range: &ValueRange| {
            let (first, last) = (range.min.ceil(), range.max.floor());
            // An empty range holds no label.
            let mut labels = (0..).map(|i| first + f64::from(i)).take_while(|label| *label <= last);
            last - first > LABEL_LIMIT || labels.any(&is_visible)
        };
        self.cells.iter().filter(move |(_, range)| may_show(range)).map(|(middle, _)| *middle)
    }
}

impl Overview {
    /// Reads the overview of a container; `None` if even its coarsest level is too large.
    ///
    /// # Errors
    /// If a brick of the level cannot be read.
    pub fn read(container: &Container, facts: &VolumeFacts) -> Result<Option<Self>, ContainerError> {
        let levels = container.pyramid().levels();
        let fits = |level: &Level| level.dims.voxels().is_some_and(|n| n <= VOXEL_LIMIT);
        let Some(number) = levels.iter().position(fits) else { return Ok(None) };
        let (scale, offset) = (container.descriptor().scale, container.descriptor().offset);
        let reader = LevelReader::new(container, Lod(narrow::<u8>(number)), 0);
        // Outliers and nulls count as absent, and averages that they distort, too.
        let ValueRange { min, max } = facts.central_range;
        let central = |value: f64| if (min..=max).contains(&value) { value } else { f64::NAN };
        let has_far = facts.central_range != facts.value_range;
        let value = |stored: f64| stored * scale + offset;
        let values =
            reader.values(reader.whole(), |stored| if has_far { central(value(stored)) } else { value(stored) })?;
        // An unreadable fine brick does not prevent an overview. The renderer reports it.
        let cells = if facts.kind == DataKind::Labels { LabelCells::read(container).ok().flatten() } else { None };
        let table = table::planes(container, facts)?;
        Ok(Some(Self { dims: reader.whole().extent(), level: levels[number], values, cells, table }))
    }

    /// Planes that cut away the table that a patient lies on, in tomography; none if there is no table. The default
    /// picture has them.
    #[must_use]
    pub fn table(&self) -> &[PlaneSpec] {
        &self.table
    }

    /// The overview of a volume whose table stays in the default picture.
    #[must_use]
    pub fn with_table(&self) -> Self {
        Self { table: Vec::new(), ..self.clone() }
    }

    /// The visible voxels of this level, or the visible macro cells, whose centre lies in the box `kept` and is
    /// not cut away with a table. `None` if there are none, or if a null fills part of the volume, which hides the rest.
    fn framed(
        &self,
        facts: &VolumeFacts,
        (kept, planes): Kept<'_>,
        is_visible: impl Fn(f64) -> bool,
    ) -> Option<Framed> {
        if facts.far_share > NULL_SHARE {
            return None;
        }
        let [nx, ny, _] = self.dims;
        let scale = DVec3::from_array(self.level.scale.map(|s| s as f64));
        // Point p of this level is the point (p + 1/2) * scale - 1/2 of level 0.
        let at = |i: usize| {
            let place = DVec3::new((i % nx) as f64, (i / nx % ny) as f64, (i / (nx * ny)) as f64);
            (place + HALF_VOXEL) * scale - HALF_VOXEL
        };
        let (low, high) = (DVec3::from_array(kept[0]), DVec3::from_array(kept[1]));
        // Other planes of the user's change no camera.
        let planes = if planes == self.table { planes } else { &[] };
        let world = facts.geometry.world_from_index();
        let is_before = |plane: &PlaneSpec, p: DVec3| DVec3::from_array(plane.normal).dot(p) >= plane.offset;
        let is_kept = |p: &DVec3| {
            let is_uncut = || planes.iter().all(|plane| is_before(plane, world.transform_point3(*p)));
            p.cmpge(low).all() && p.cmple(high).all() && is_uncut()
        };
        let (centres, half): (Vec<DVec3>, DVec3) = match &self.cells {
            Some(cells) => (cells.visible(is_visible).filter(is_kept).collect(), cells.half),
            None => {
                let visible = self.values.iter().enumerate().filter(|(_, v)| !v.is_nan() && is_visible(**v));
                (visible.map(|(i, _)| at(i)).filter(is_kept).collect(), HALF_VOXEL * scale)
            }
        };
        let middle =
            centres.iter().copied().reduce(DVec3::min)? * 0.5 + centres.iter().copied().reduce(DVec3::max)? * 0.5;
        Some(Framed::boxes(facts, middle, centres, half.to_array()))
    }

    /// The region of a box (index coordinates of level 0) that a transfer function shows. `None` if it shows nothing,
    /// or if the averages of this level lose too much of it.
    #[must_use]
    pub fn visible(&self, facts: &VolumeFacts, kept: Kept<'_>, shown: &TransferFunction) -> Option<Framed> {
        if self.cells.is_none()
            && shown.loses(&self.values, Histogram::new(&facts.histogram, facts.central_range).shares())
        {
            return None;
        }
        let most = shown.points().iter().map(|p| p.alpha).fold(0.0, f64::max);
        self.framed(facts, kept, |value| shown.classify(value).1 > VISIBLE_SHARE * most)
    }

    /// The region that an iso surface may enclose: the voxels on the side of `iso` with fewer voxels.
    #[must_use]
    pub fn beyond(&self, facts: &VolumeFacts, kept: Kept<'_>, iso: f64) -> Option<Framed> {
        let above = self.values.iter().filter(|v| **v >= iso).count();
        let below = self.values.iter().filter(|v| **v < iso).count();
        self.framed(facts, kept, |value| (value >= iso) == (above <= below)).filter(|_| above.min(below) > 0)
    }

    /// Window of the projected values along all three axes, without the few darkest and brightest.
    #[must_use]
    pub fn projected_window(&self, mode: Mode) -> Option<[f64; 2]> {
        let mut projected: Vec<f64> = (0..3).flat_map(|axis| self.project(axis, mode)).collect();
        projected.retain(|v| v.is_finite());
        projected.sort_by(f64::total_cmp);
        let at = |share: f64| {
            projected.get(whole::<usize>((share * (projected.len().checked_sub(1)? as f64)).round())).copied()
        };
        let (low, high) = (at(DARKEST)?, at(BRIGHTEST)?);
        (high > low).then_some([low, high])
    }

    /// The projection along an axis: one value per line of voxels; infinite or NaN if no voxel of the line is present.
    fn project(&self, axis: usize, mode: Mode) -> Vec<f64> {
        let stride: usize = self.dims[..axis].iter().product();
        let count = self.dims[axis];
        let lines = self.values.len() / count;
        let line = |i: usize| {
            let start = i / stride * stride * count + i % stride;
            (0..count).map(move |k| self.values[start + k * stride]).filter(|v| !v.is_nan())
        };
        let reduce = |i: usize| match mode {
            Mode::Mip => line(i).fold(f64::NEG_INFINITY, f64::max),
            Mode::Minip => line(i).fold(f64::INFINITY, f64::min),
            _ => {
                let (sum, n) = line(i).fold((0.0, 0.0), |(sum, n), v| (sum + v, n + 1.0));
                sum / n
            }
        };
        (0..lines).map(reduce).collect()
    }
}
