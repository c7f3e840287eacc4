//! Rays of a tile through a brick cell by cell, in `f64`: with opacity by the gradient, and behind cut faces that are lit by their
//! own normals.
//!
//! Cells that show nothing are left out. The others spend the ray's error budget as cells of packets do (`budget`), and state what
//! they spend. Behind a cut face, only the beginning of a ray is gathered here; packets gather the rest.

use supervol_format::BrickKey;
use supervol_format::cast::single;
use supervol_scene::clip::faces::{CutFace, CutNormals};

use super::places::{TILE_RAYS, place_of};
use super::visit::{CastTile, cast_ray};
use crate::engines::cells::bounded::{BoundedBrick, BoundedChord, CellBudget, Seen};
use crate::engines::cells::shown_cells::ShownCells;
use crate::engines::cells::{BrickVisit, LevelVisit};
use crate::engines::rules::BY_OPACITY;
use crate::stream::residency::DecodedBrick;

impl CastTile<'_> {
    /// Rays gather light in a brick of which these cells may show something.
    pub(super) fn cast_modulated(&mut self, (key, brick): (BrickKey, &DecodedBrick), shown: &ShownCells) {
        for i in 0..self.rays.hits().len() {
            let ray = self.rays.hits()[i];
            let t = self.rays.interval(ray);
            self.gather_cells(ray, (t, self.rays.face(ray)), (key, brick), Some(shown));
        }
    }

    /// Rays gather what cut faces light of a brick. Those that go on in it remain, and begin behind that.
    pub(super) fn cast_behind_faces(&mut self, (key, brick): (BrickKey, &DecodedBrick), cuts: &CutNormals) {
        self.go_behind_faces(cuts, |tile, ray, lit| {
            tile.gather_cells(ray, lit, (key, brick), None);
        });
    }

    /// The same of a brick of one data value.
    pub(super) fn cast_uniform_behind_faces(&mut self, key: BrickKey, value: f64, cuts: &CutNormals) {
        self.go_behind_faces(cuts, |tile, ray, lit| {
            let cast = cast_ray(tile.frame, tile.rays, tile.corner, ray);
            let setup = LevelVisit::new(&tile.frame.scene, &cast, key).setup;
            let chord = BoundedChord::even(&tile.frame.scene.modulation, &setup, value, lit);
            let mut budget = tile.budget(ray);
            let (seen, spent) = chord.seen(&budget, &mut tile.feedback.counters.samples);
            budget.left -= spent;
            tile.feedback.counters.cells += 1;
            tile.add_seen(ray, &seen, &budget);
        });
    }

    /// Calls `gather` for each ray of which a cut face lights something in the present brick, with that part and the face.
    fn go_behind_faces(
        &mut self,
        cuts: &CutNormals,
        mut gather: impl FnMut(&mut Self, u16, ([f64; 2], Option<CutFace>)),
    ) {
        let mut kept = Vec::with_capacity(TILE_RAYS);
        for i in 0..self.rays.hits().len() {
            let ray = self.rays.hits()[i];
            let [t0, t1] = self.rays.interval(ray);
            let face = self.rays.face(ray);
            let end = face.map_or(t0, |face| face.t + cuts.depths[1]).clamp(t0, t1);
            if t0 < end {
                gather(self, ray, ([t0, end], face));
            }
            if end < t1 && self.rays.is_going(usize::from(ray)) {
                self.rays.set_interval(ray, [end, t1]);
                kept.push(ray);
            }
        }
        self.rays.set_hits(&kept);
    }

    /// A ray gathers light in a brick between two lengths, behind a cut face.
    fn gather_cells(
        &mut self,
        ray: u16,
        (t, face): ([f64; 2], Option<CutFace>),
        (key, brick): (BrickKey, &DecodedBrick),
        shown: Option<&ShownCells>,
    ) {
        let frame = self.frame;
        let world_from_level = frame.scene.world_from_level_gradient(key.lod());
        let modulated = BoundedBrick { modulation: &frame.scene.modulation, world_from_level, shown, face };
        let cast = cast_ray(frame, self.rays, self.corner, ray);
        let visit = BrickVisit::new(LevelVisit::new(&frame.scene, &cast, key), brick, key);
        let last = f64::from(self.tables.precision.last_transmittance);
        let mut budget = self.budget(ray);
        let seen = modulated.gather(&visit, t, &mut budget, last, &mut self.feedback.counters);
        self.add_seen(ray, &seen, &budget);
    }

    /// Budget of the next cells of a ray.
    fn budget(&self, ray: u16) -> CellBudget {
        let (gathered, place) = (&self.rays.gathered, usize::from(ray));
        let by_opacity = BY_OPACITY * self.tables.max_error;
        CellBudget { by_opacity, left: gathered.left[place], weight: gathered.transmittance[place] }
    }

    /// Adds light to a ray, and what is left of its budget.
    fn add_seen(&mut self, ray: u16, Seen { color, transmittance, error }: &Seen, budget: &CellBudget) {
        if self.tables.precision.sums_errors {
            self.rays.add_error(ray, single(*error));
        }
        self.rays.set_left(ray, single(budget.left));
        let last = f64::from(self.tables.precision.last_transmittance);
        self.rays.add(ray, color.to_array().map(single), single(*transmittance), last);
    }

    /// Finds the cut faces in front of the parts that the rays are in, if they light something.
    pub(super) fn find_faces(&mut self) {
        let Self { frame, corner, .. } = *self;
        let Some(cuts) = &frame.scene.modulation.cuts else { return };
        let dims = frame.scene.finest_dims();
        self.rays.set_faces(|ray, end| {
            let [x, y] = place_of(ray);
            let world_ray = frame.tables.pixel_rays.ray(corner[0] + x, frame.scene.rows.start + corner[1] + y);
            cuts.face_before(end, &world_ray, &frame.tables.to_index.ray(&world_ray), dims)
        });
    }
}
