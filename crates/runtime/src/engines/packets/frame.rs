//! A picture by packets: its description, its tables, and when they stop.

use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use supervol_format::ValueRange;
use supervol_scene::scene::{Mode, ResolvedScene};

use super::plans::{BrickPlans, Made};
use super::rule::PacketRule;
use super::simd::InstructionSet;
use super::tables::PacketTables;
use crate::engines::asked::AskedPixels;
use crate::engines::ray_scene::{BrickChoice, DrawnVolume, RayScene};
use crate::engines::rules::{BESIDE_SURFACES, NEVER, TERMINATION_OPACITY, own_error, surfaces_error};
use crate::engines::totals::{EngineErrors, ErrorsByReason};
use crate::engines::value_error::{by_f32, by_f64};
use crate::lod::deviation::Deviations;
use crate::stop::Stop;

/// A picture by packets.
#[derive(Debug, Clone)]
pub struct PacketFrame {
    pub(crate) scene: RayScene,
    /// Tables that packets look up.
    pub(super) tables: Arc<PacketTables>,
    /// In mode `dvr` with surfaces: the frame of these, in mode `iso`, which lists all crossings and adds none.
    pub(super) inner: Option<Arc<PacketFrame>>,
    /// Deviations of coarser levels, if errors are summed up.
    pub(super) deviations: Option<Arc<Deviations>>,
    /// The pixels to cast; `None`: all.
    pub(super) asked: Option<Arc<AskedPixels>>,
    /// When packets stop where they are.
    stop: Stop,
    /// Rays that packets have finished, where somebody counts them.
    finished: Option<Arc<AtomicU64>>,
}

impl PacketFrame {
    /// The picture of a scene, by packets that keep so much of bricks.
    #[must_use]
    pub fn new(
        scene: &ResolvedScene,
        volume: &DrawnVolume<'_>,
        bricks: BrickChoice,
        rule: PacketRule,
        (mut made_bytes, plans): Made,
    ) -> Self {
        let (mut inner, mut rule) = (None, rule);
        if scene.mode == Mode::Dvr && !scene.iso.is_empty() {
            made_bytes /= 2;
            rule.max_error *= BESIDE_SURFACES;
            let scene = ResolvedScene { mode: Mode::Iso, ..scene.clone() };
            let mut surfaces = RayScene::new(&scene, volume, bricks, TERMINATION_OPACITY);
            surfaces.lists_crossings = true;
            inner = Some(Arc::new(Self::of(surfaces, &scene, rule, (made_bytes, None), None)));
        }
        // Packets end rays themselves; a cell that is integrated in `f64` is integrated to its end.
        let ends_at = if scene.mode == Mode::Dvr { NEVER } else { TERMINATION_OPACITY };
        let ray_scene = RayScene::new(scene, volume, bricks, ends_at);
        Self::of(ray_scene, scene, rule, (made_bytes, plans), inner)
    }

    fn of(ray_scene: RayScene, scene: &ResolvedScene, rule: PacketRule, made: Made, inner: Option<Arc<Self>>) -> Self {
        let tables = Arc::new(PacketTables::new(&ray_scene, &scene.transfer_function, rule, made));
        Self { scene: ray_scene, tables, inner, deviations: None, asked: None, stop: Stop::NEVER, finished: None }
    }

    /// Adds the deviations of coarser levels to the sums of errors, if errors are summed up.
    #[must_use]
    pub fn with_deviations(self, deviations: Deviations) -> Self {
        let deviations = self.tables.sums_errors().then(|| Arc::new(deviations));
        Self { deviations, ..self }
    }

    /// The same picture of these pixels only; all others are NaN.
    #[must_use]
    pub(crate) fn only(self, asked: AskedPixels) -> Self {
        Self { asked: Some(Arc::new(asked)), ..self }
    }

    /// Packets stop when this is due: rays wait where they are, and go on from there in the next pass.
    pub(crate) fn set_stop(&mut self, stop: Stop) {
        self.stop = stop;
    }

    /// Whether it is time to stop.
    pub(super) fn is_due(&self) -> bool {
        self.stop.is_due()
    }

    /// Packets count the rays that they finish here.
    #[must_use]
    pub fn counting(self, finished: Option<Arc<AtomicU64>>) -> Self {
        Self { finished, ..self }
    }

    pub(super) fn count_finished(&self, rays: u64) {
        if let Some(finished) = &self.finished {
            finished.fetch_add(rays, Ordering::Relaxed);
        }
    }

    /// Plans of bricks, for a picture of another camera; `None` in all modes but `dvr`.
    #[must_use]
    pub fn plans(&self) -> Option<Arc<BrickPlans>> {
        (self.scene.mode == Mode::Dvr).then(|| self.tables.plans.clone())
    }

    /// The same picture for some rows of pixels only: see [`RayScene::band`].
    ///
    /// # Panics
    /// If the picture has no such rows.
    #[must_use]
    pub fn band(&self, pixel_rows: Range<u32>) -> Self {
        let inner = self.inner.as_ref().map(|surfaces| Arc::new(surfaces.band(pixel_rows.clone())));
        Self { scene: self.scene.band(pixel_rows), inner, ..self.clone() }
    }

    /// The instructions that packets are cast with.
    #[must_use]
    pub fn instructions(&self) -> InstructionSet {
        self.tables.instructions()
    }

    /// Errors of a picture whose rays have these errors; `None` if errors are not summed up, and in all modes but `dvr`.
    #[must_use]
    pub fn errors(&self, rays: ErrorsByReason) -> Option<EngineErrors> {
        let tables = Some(&self.tables).filter(|tables| self.scene.mode == Mode::Dvr && tables.sums_errors())?;
        Some(EngineErrors {
            cells: rays.cells,
            levels: rays.levels,
            ray_ends: tables.end_error(),
            transfer_function: tables.fit_error(),
            rounding: tables.rounding_error(&self.scene),
        })
    }

    /// See [`value_error`](crate::engines::value_error): bricks in which `f32` may be off by more than is tolerated are cast in `f64`.
    pub fn value_error(&self, range: ValueRange) -> f64 {
        let Self { scene, tables, .. } = self;
        let by_packets = by_f32(scene.mode, &scene.map, range, scene.pyramid.layout().core());
        if by_packets <= tables.tolerated { by_packets } else { tables.tolerated.max(by_f64(range)) }
    }

    /// See [`own_error`].
    pub(super) fn own_error(&self, opacity: f64) -> f64 {
        let max_error = self.tables.max_error;
        // Surfaces only aim at an error, as in mode `iso`.
        let aimed = if self.inner.is_some() { surfaces_error(max_error) } else { 0.0 };
        own_error(self.scene.mode, opacity, max_error, aimed, self.scene.pyramid.layout().core())
    }
}
