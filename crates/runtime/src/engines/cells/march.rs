//! One ray through the resident bricks, until it is finished or waits.

use supervol_format::cast::narrow;
use supervol_format::{BrickIndex, BrickKey, Lod};
use supervol_scene::clip::IndexRay;

use super::visit::{BrickVisit, CastRay, LevelVisit};
use super::walk::{AxisRay, CellBox, GridWalk, Planes};
use crate::engines::cells::frame::CellFrame;
use crate::engines::feedback::BlockFeedback;
use crate::engines::ray::RayState;
use crate::stream::counters::RayCounters;
use crate::stream::residency::{BrickView, Resident};

/// Casts one ray with the frame's integrator until it is finished or waits. `pixel` counts rays, not pixels of a
/// supersampled picture.
///
/// # Panics
/// If the ray has nothing to draw: such rays are finished before they are cast.
pub(crate) fn cast_ray<V: BrickView + ?Sized>(
    view: &V,
    frame: &CellFrame,
    pixel: [u32; 2],
    state: &mut RayState,
    feedback: &mut BlockFeedback,
) {
    let ray = frame.scene.camera.ray(pixel[0], pixel[1]);
    let index_ray = IndexRay::new(&ray, &frame.scene.geometry);
    let axis_ray = AxisRay::new(&index_ray);
    let to_eye = -ray.direction.as_vec3();
    state.waiting = None;
    // The current part of the ray, and those behind it.
    let present = state.t_end;
    for segment in frame.scene.parts_of(&ray, &index_ray).into_iter().filter(|part| part.t1 >= present) {
        if segment.t1 > state.t_end {
            (state.t, state.t_end) = (segment.t0, segment.t1);
            // The side in front of a gap is not the side behind it.
            state.iso.known = 0;
        }
        cast_part(view, frame, &CastRay { axis_ray, to_eye, segment, pixel }, state, feedback);
        if state.waiting.is_some() {
            return;
        }
        if frame.scene.is_done(state) {
            break;
        }
    }
    state.finished = true;
    feedback.counters.rays_finished += 1;
}

/// Casts one part of a ray until its end, or until the ray is done or waits.
fn cast_part<V: BrickView + ?Sized>(
    view: &V,
    frame: &CellFrame,
    ray: &CastRay,
    state: &mut RayState,
    feedback: &mut BlockFeedback,
) {
    let mut last_used = None;
    while state.t < state.t_end && !frame.scene.is_done(state) {
        let (key, resident, exit) = resident_at(view, frame, &ray.axis_ray, state.t, &mut feedback.counters);
        let exit = exit.min(state.t_end);
        if !matches!(resident, Resident::Missing) && last_used != Some(key) {
            feedback.uses.insert(key);
            last_used = Some(key);
        }
        feedback.counters.bricks += 1;
        match resident {
            Resident::Missing => {
                state.waiting = Some(key);
                let entry = feedback.misses.entry(key).or_insert((0, f64::INFINITY));
                *entry = (entry.0 + 1, entry.1.min(state.t));
                feedback.counters.rays_waiting += 1;
                return;
            }
            Resident::Brick(brick) => {
                let brick = brick.read();
                let visit = BrickVisit::new(LevelVisit::new(&frame.scene, ray, key), &brick, key);
                visit.march(exit, &*frame.integrator, state, &mut feedback.counters);
            }
            Resident::Uniform(value) => {
                let t = [state.t, exit];
                let visit = LevelVisit::new(&frame.scene, ray, key);
                frame.integrator.gather_uniform(&visit, value, t, state, &mut feedback.counters);
            }
            Resident::Nothing | Resident::TooCoarse | Resident::UseParent => state.iso.known = 0,
        }
        state.t = exit;
    }
}

/// The resident data at t, at the level that is fine enough there; and the t at which the ray leaves it.
fn resident_at<'v, V: BrickView + ?Sized>(
    view: &'v V,
    frame: &CellFrame,
    ray: &AxisRay,
    t: f64,
    counters: &mut RayCounters,
) -> (BrickKey, Resident<'v>, f64) {
    let mut lod = frame.scene.first_lod;
    loop {
        let (wanted, exit) = brick_at(frame, ray, t, lod);
        let (key, resident) = resident_or_parent(view, frame, wanted, counters);
        let goes_on_beneath = matches!(resident, Resident::TooCoarse) && key == wanted && wanted.lod() > Lod::FINEST;
        if !goes_on_beneath {
            return (key, resident, exit);
        }
        lod = Lod(wanted.lod().0 - 1);
    }
}

/// The brick at t on the first level that is fine enough there, searched from `lod` on, and the t at which the ray
/// leaves it.
fn brick_at(frame: &CellFrame, ray: &AxisRay, t: f64, mut lod: Lod) -> (BrickKey, f64) {
    let core = frame.scene.pyramid.layout().core();
    loop {
        let level = frame.scene.pyramid.level_at(lod);
        let bricks = CellBox { low: [0; 3], high: level.bricks.map(|n| i64::from(n) - 1) };
        let walk = GridWalk::new(ray, Planes::of_bricks(level, core), bricks, t);
        let key = BrickKey::new(lod, BrickIndex(walk.index.map(narrow::<u32>)));
        if frame.scene.lod.is_fine_enough(&frame.scene.pyramid, key) {
            return (key, walk.exit());
        }
        lod = Lod(lod.0 - 1);
    }
}

/// The resident data of a brick; for a failed brick, that of its nearest ancestor that has not failed.
fn resident_or_parent<'v, V: BrickView + ?Sized>(
    view: &'v V,
    frame: &CellFrame,
    mut key: BrickKey,
    counters: &mut RayCounters,
) -> (BrickKey, Resident<'v>) {
    let mut resident = view.lookup(key);
    loop {
        match (resident, frame.scene.pyramid.parent(key)) {
            (Resident::UseParent, Some(parent)) => {
                counters.parent_bricks += 1;
                key = parent;
                resident = view.stand_in(key);
            }
            _ => return (key, resident),
        }
    }
}
