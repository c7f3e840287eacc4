//! S34 and S35: planning cost in volumes of any size; flying through a volume faster than it can be read.

use std::sync::Arc;
use std::time::Duration;

use glam::DVec3;
use supervol_format::{Container, Geometry};
use supervol_runtime::stream::state::StateKind;
use supervol_scene::scene::ResolvedScene;

use super::session::{Session, Settings, fresh, median, pixels_lost, scene, translucent};
use super::sources::{Rule, Watched, pass};
use crate::context::{ChartError, Context};
use crate::stability::regime::{CurvePoint, Gate, Outcome, Regime};
use crate::virtual_volume::{Field, VirtualVolume};
use crate::volume::{Volume, image_size};

/// S34.
pub const PLANNER_COST: Regime = Regime {
    id: "S34",
    title: "Planner cost",
    recipe: "BRICKID of 16821 x 7494 x 2070 and of 65,536^3 voxels in bricks of 32, seen whole and from inside (levels \
             from the finest to the coarsest), at growing picture sizes. Cold: nothing is known. Warm: the camera has \
             turned by 1 degree since the last frame.",
    x_label: "bricks that the frame uses",
    y_label: "planning of one frame (ms)",
    run: planner_cost,
};

/// S35.
pub const FLY_THROUGH: Regime = Regime {
    id: "S35",
    title: "Fast fly-through",
    recipe: "BRICKID 4096^3 in bricks of 16 behind a source that takes 0.3 ms per read: five zooms to five places, six \
             frames each, every frame with a time budget and less than all its bricks.",
    x_label: "frame",
    y_label: "time (ms)",
    run: fly_through,
};

/// Least duration of a read of the fly-through.
const READ_DELAY: Duration = Duration::from_micros(300);

fn watched(dims: [u64; 3], core: u32, rule: Rule) -> Result<(Volume, Arc<Watched>), ChartError> {
    let inner = Arc::new(VirtualVolume::new(Field::BrickId, dims, core, Geometry::IDENTITY)?);
    let source = Watched::new(inner, rule).map_err(|e| ChartError::Broken(e.to_string()))?;
    let source = Arc::new(source);
    let container = Arc::new(Container::from_source(source.clone())?);
    Ok((Volume::of("BRICKID", container), source))
}

fn whole_view(volume: &Volume, degrees: f64, size: (u32, u32)) -> Result<ResolvedScene, ChartError> {
    let angle = degrees.to_radians();
    let camera = volume.looking_from(DVec3::new(angle.cos(), angle.sin(), 0.41), 2.7);
    scene(volume, &[camera, image_size(size.0, size.1), translucent(volume.radius())])
}

/// View from inside along the volume. The nearest 200 voxels have an opacity of about one half.
fn inside_view(volume: &Volume, degrees: f64, size: (u32, u32)) -> Result<ResolvedScene, ChartError> {
    let angle = (20.0 + degrees).to_radians();
    let eye = volume.world(volume.facts.dims.0.map(|n| 0.3 * n as f64));
    let target = (eye + DVec3::new(angle.cos(), angle.sin(), 0.1)).to_array();
    let eye = eye.to_array();
    let camera = format!(r#""camera": {{"eye": {eye:?}, "target": {target:?}, "up": [0, 0, 1], "fov_y": 38}}"#);
    scene(volume, &[camera, image_size(size.0, size.1), translucent(100.0)])
}

/// A view at an angle in degrees, with an image size.
type View = fn(&Volume, f64, (u32, u32)) -> Result<ResolvedScene, ChartError>;

/// Planning time of one frame, ms: the streamer's time without the source's reads and decoding.
fn planning_ms(session: &mut Session, scene: &ResolvedScene, source: &Watched) -> Result<f64, ChartError> {
    let before = source.time();
    let stats = session.frame(scene, None)?.stats;
    // Planning reads pages of the table of contents; their time is subtracted.
    Ok(stats.streaming.plan_ms - (source.time() - before).as_secs_f64() * 1e3)
}

/// Planning of frames of one view: cold time, warm time (ms), and bricks used by the frame.
fn plan_view(context: &Context<'_>, dims: [u64; 3], view: View, size: (u32, u32)) -> Result<[f64; 3], ChartError> {
    let (mut cold, mut warm, mut bricks) = (Vec::new(), Vec::new(), 0);
    for _ in 0..context.pick(2, 1) {
        // Opened again, so that the table of contents is cold too.
        let (volume, source) = watched(dims, 32, pass())?;
        let scene = |degrees| view(&volume, degrees, size);
        let mut session = Session::new(&volume.container, Settings::default())?;
        cold.push(planning_ms(&mut session, &scene(0.0)?, &source)?);
        bricks = session.streamer().states().total(StateKind::InHost);
        for step in 1..=context.pick(3, 1) {
            warm.push(planning_ms(&mut session, &scene(f64::from(step))?, &source)?);
        }
    }
    Ok([median(&cold), median(&warm), bricks as f64])
}

fn planner_cost(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let mut curve = Vec::new();
    let (mut worst_cold, mut worst_warm) = (0.0f64, 0.0f64);
    // Bricks and cold planning time of the frame with the most bricks.
    let mut largest = [0.0f64; 2];
    let views: [(&str, View); 2] = [("whole", whole_view), ("inside", inside_view)];
    for (name, dims) in [("16821 x 7494 x 2070", [16_821, 7494, 2070]), ("65,536^3", [65_536; 3])] {
        for (seen, view) in views {
            for &size in context.pick::<&[_]>(&[(48, 36), (96, 72), (192, 144)], &[(48, 36)]) {
                (context.say)(&format!("S34: {name}, {seen}, {} x {} pixels", size.0, size.1));
                let [cold, warm, bricks] = plan_view(context, dims, view, size)?;
                curve.push(CurvePoint::new(&format!("{name}, {seen}, cold"), bricks, cold, None));
                curve.push(CurvePoint::new(&format!("{name}, {seen}, warm"), bricks, warm, None));
                if bricks > largest[0] {
                    largest = [bricks, cold];
                }
                (worst_cold, worst_warm) = (worst_cold.max(cold), worst_warm.max(warm));
            }
        }
    }
    let (lost, first_ms) = first_image(context)?;
    let gates = vec![
        Gate::at_most("planning of a cold frame (ms)", worst_cold, 20.0).speed(),
        Gate::at_most("planning of a warm frame (ms)", worst_warm, 2.0).speed(),
        Gate::at_most("pixels without anything in the first image of 65,536^3 in 160 MiB", lost as f64, 0.0),
    ];
    let [bricks, cold] = largest;
    let note = format!(
        "These pictures are small (at most 192 x 144), because larger ones take minutes to cast; the gates are met or missed \
         for them only. Cold planning grows with the bricks that a frame uses: {cold:.1} ms for {bricks} in the largest. At \
         that rate 20 ms are reached at about {:.0} bricks, which larger pictures may exceed. Planning is everything that the streamer does between the passes of one frame but the source's reads and the \
         decoding: ranking, the table of contents (checksums of its pages included), classification, states, admission, \
         eviction, buffers, and putting bricks into the cache; summed over all passes, median of repeated frames, wall \
         time. Levels of detail are chosen while rays are cast and are not in it. The first image of 65,536^3 (budget: 0 \
         ms of time, 160 MiB of memory, 64 MiB of them for pages of the table of contents) took {first_ms:.0} ms.",
        20.0 * bricks / cold.max(1e-9)
    );
    Ok(Outcome { curve, gates, note })
}

/// Missing pixels of the first image, and its time.
fn first_image(context: &Context<'_>) -> Result<(usize, f64), ChartError> {
    let (volume, _) = watched([65_536; 3], 64, pass())?;
    let view = whole_view(&volume, 0.0, context.pick((160, 120), (64, 48)))?;
    let settings = Settings { host_memory_bytes: 160 << 20, ..Settings::default() };
    let whole = fresh(&volume, &view, settings)?;
    let (volume, _) = watched([65_536; 3], 64, pass())?;
    let first = Session::new(&volume.container, settings)?.frame(&view, Some(0))?;
    Ok((pixels_lost(&first.image, &whole.image), first.ms))
}

/// Frame `step` of 6 of a zoom to one of five positions.
fn zoom(volume: &Volume, place: usize, step: usize, size: (u32, u32)) -> Result<ResolvedScene, ChartError> {
    const PLACES: [[f64; 3]; 5] = [[0.2, 0.3, 0.8], [0.8, 0.7, 0.1], [0.5, 0.1, 0.5], [0.1, 0.9, 0.6], [0.9, 0.2, 0.9]];
    let target = DVec3::from_array(PLACES[place]) * 4096.0;
    let distance = 2.5 * volume.radius() * 0.35f64.powf(step as f64);
    let eye = target + DVec3::new(0.57, -0.71, 0.41).normalize() * distance;
    let (eye, target) = (eye.to_array(), target.to_array());
    let camera = format!(r#""camera": {{"eye": {eye:?}, "target": {target:?}, "up": [0.02, 0.013, 1], "fov_y": 38}}"#);
    // Opacity grows as the camera comes closer: the visible depth in voxels is the same at every distance.
    scene(volume, &[camera, image_size(size.0, size.1), translucent(distance / 2.0)])
}

fn fly_through(context: &Context<'_>) -> Result<Outcome, ChartError> {
    const STEPS: usize = 6;
    let delay: Rule = Box::new(|_, _, _| {
        std::thread::sleep(READ_DELAY);
        Ok(())
    });
    let (volume, _) = watched([4096; 3], 16, delay)?;
    let (undelayed, _) = VirtualVolume::open(Field::BrickId, [4096; 3], 16)?;
    let size = context.pick((160, 120), (48, 36));
    let budget_ms = context.pick(150, 40);
    let places = context.pick(5, 2);
    let mut session = Session::new(&volume.container, Settings::default())?;
    let mut curve = Vec::new();
    let (mut times, mut worst_streaming, mut cancelled, mut lost, mut most_wanted) = (Vec::new(), 0.0f64, 0, 0, 0);
    for i in 0..places * STEPS {
        let view = zoom(&volume, i / STEPS, i % STEPS, size)?;
        let frame = session.frame(&view, Some(budget_ms))?;
        let streaming = frame.stats.streaming.wait_ms + frame.stats.streaming.decode_ms;
        curve.push(CurvePoint::new("frame", i as f64, frame.ms, Some(budget_ms as f64)));
        curve.push(CurvePoint::new("waiting for reads and decoding", i as f64, streaming, Some(budget_ms as f64)));
        times.push(frame.ms);
        worst_streaming = worst_streaming.max(streaming);
        cancelled += frame.stats.streaming.cancelled;
        if i % STEPS == STEPS / 2 {
            let whole = fresh(&undelayed, &view, Settings::default())?;
            lost += pixels_lost(&frame.image, &whole.image);
            most_wanted = most_wanted.max(whole.stats.streaming.page_ins);
        }
    }
    let last = session.frame(&zoom(&volume, places - 1, STEPS - 1, size)?, None)?;
    let stale = session.streamer().states().total(StateKind::Queued);
    let slowest = times.iter().copied().fold(0.0, f64::max);
    let gates = vec![
        Gate::at_most("slowest frame (medians)", slowest / median(&times), 2.0).speed(),
        Gate::at_most("waiting for reads and decoding in any frame (ms)", worst_streaming, budget_ms as f64).speed(),
        Gate::at_least(
            "requests cancelled because no view wants them any more",
            (cancelled + last.stats.streaming.cancelled) as f64,
            1.0,
        )
        .speed(),
        Gate::at_most("requests left when the last view has converged", stale as f64, 0.0),
        Gate::at_most("pixels without anything on screen", lost as f64, 0.0),
    ];
    let note = format!(
        "{budget_ms} ms per frame; up to {most_wanted} bricks wanted in one. {} requests were cancelled. A frame ends at \
         most one pass or one batch of reads late, and the pass that completes the picture from parents comes after the \
         budget.",
        cancelled + last.stats.streaming.cancelled
    );
    Ok(Outcome { curve, gates, note })
}
