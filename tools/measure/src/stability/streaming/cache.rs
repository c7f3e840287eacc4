//! S32 and S33: a cache smaller than the working set; starvation and livelock.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use glam::DVec3;
use supervol_format::{BrickIndex, BrickKey, Container, Geometry, Lod};
use supervol_runtime::stream::budget::BrickBytes;
use supervol_runtime::stream::state::StateKind;
use supervol_scene::scene::ResolvedScene;

use super::session::{Frame, Session, Settings, fresh, linf, pixels_lost, scene, translucent};
use super::sources::Watched;
use crate::context::{ChartError, Context};
use crate::stability::regime::{CurvePoint, Gate, Outcome, Regime};
use crate::virtual_volume::{Field, VirtualVolume};
use crate::volume::{Volume, image_size};

/// S32.
pub const SMALL_CACHE: Regime = Regime {
    id: "S32",
    title: "Cache smaller than the working set",
    recipe: "BRICKID 4096^3 in bricks of 16. The host cache holds 100, 50, 25, 10 and 5 % of the bytes of the first \
             frame's working set. The same view twice, then an orbit in steps of 7 degrees; one streamer throughout. The \
             picture with a cache for everything is the one to compare with.",
    x_label: "host cache (% of the working set)",
    y_label: "page-ins of a frame per brick that the frame uses",
    run: small_cache,
};

/// S33.
pub const STARVATION: Regime = Regime {
    id: "S33",
    title: "Starvation and livelock",
    recipe: "BRICKID. Two close views of opposite corners take turns with a time budget of 0 and a cache for half of one \
             view, then without a budget; a cache for 1 % of the bricks that a frame wants at once; and one brick whose \
             reads always fail, in 32 frames.",
    x_label: "frame",
    y_label: "attempts so far to read the brick that always fails",
    run: starvation,
};

fn orbit(volume: &Volume, steps: usize, size: (u32, u32)) -> Result<Vec<ResolvedScene>, ChartError> {
    let members = |step: usize| {
        let angle = (7.0 * step as f64).to_radians();
        let direction = DVec3::new(angle.cos(), angle.sin(), 0.41);
        [volume.looking_from(direction, 2.7), image_size(size.0, size.1), translucent(volume.radius())]
    };
    (0..steps).map(|step| scene(volume, &members(step))).collect()
}

fn small_cache(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let (volume, _) = VirtualVolume::open(Field::BrickId, [4096; 3], 16)?;
    let views = orbit(&volume, context.pick(6, 3), context.pick((160, 120), (96, 72)))?;
    let ample = views.iter().map(|v| fresh(&volume, v, Settings::default())).collect::<Result<Vec<_>, _>>()?;
    let working_set_bytes = ample[0].stats.host_cache_bytes;
    let mut curve = Vec::new();
    let (mut worst_linf, mut worst_ratio) = (0.0f64, 0.0f64);
    let (mut idle, mut open, mut again_when_all_fits) = (0, 0, 0);
    for percent in [100, 50, 25, 10, 5] {
        (context.say)(&format!("S32: a cache of {percent} %"));
        let brick = BrickBytes::of(&volume.container).decoded;
        let cache_bytes = (working_set_bytes * percent).div_ceil(100).max(brick);
        let settings = Settings { cache_bytes: Some(cache_bytes), ..Settings::default() };
        let mut session = Session::new(&volume.container, settings)?;
        let mut total = (0, 0);
        for (i, (series, view)) in std::iter::once(("first frame", 0))
            .chain(std::iter::once(("the same view again", 0)))
            .chain((1..views.len()).map(|view| ("orbit", view)))
            .enumerate()
        {
            let frame = session.frame(&views[view], None)?;
            let whole = &ample[view];
            worst_linf = worst_linf.max(linf(&frame.image, &whole.image));
            idle += frame.idle_passes;
            open += u64::from(!frame.stats.converged);
            let ratio = frame.stats.streaming.page_ins as f64 / whole.stats.streaming.page_ins as f64;
            worst_ratio = worst_ratio.max(ratio);
            if i == 1 && percent == 100 {
                again_when_all_fits = frame.stats.streaming.page_ins;
            }
            if series == "orbit" {
                total = (total.0 + frame.stats.streaming.page_ins, total.1 + whole.stats.streaming.page_ins);
            } else {
                // A frame's first access to a brick must load it; bricks kept from the last frame need no load.
                let least = if i == 0 { 1.0 } else { 1.0 - percent as f64 / 100.0 };
                curve.push(CurvePoint::new(series, percent as f64, ratio, Some(least)));
            }
        }
        curve.push(CurvePoint::new("orbit", percent as f64, total.0 as f64 / total.1 as f64, None));
    }
    let gates = vec![
        Gate::at_most("page-ins of any frame per brick that it uses", worst_ratio, 1.5),
        Gate::at_most("page-ins when a view is drawn again and all of it fits", again_when_all_fits as f64, 0.0),
        Gate::at_most("greatest difference from the picture with an ample cache", worst_linf, 0.0),
        Gate::at_most("passes that read nothing although rays waited", idle as f64, 0.0),
        Gate::at_most("frames that did not converge", open as f64, 0.0),
    ];
    let note = format!(
        "The first frame uses {} bricks ({working_set_bytes} bytes). Page-ins are counted frame by frame: a brick that \
         the last frame evicted is one page-in of this frame, one that this frame evicts and reads again is two. A cache \
         costs passes, not quality: each picture is the picture. The expected line of the second frame is the least that \
         any replacement can do: all that the cache cannot hold.",
        ample[0].stats.streaming.page_ins
    );
    Ok(Outcome { curve, gates, note })
}

/// Results of the three experiments of S33.
#[derive(Default)]
struct Starved {
    pixels_lost: usize,
    worst_ratio: f64,
    worst_linf: f64,
    idle_passes: u64,
}

impl Starved {
    fn add(&mut self, frame: &Frame, whole: &Frame) {
        self.worst_ratio =
            self.worst_ratio.max(frame.stats.streaming.page_ins as f64 / whole.stats.streaming.page_ins as f64);
        self.worst_linf = self.worst_linf.max(linf(&frame.image, &whole.image));
        self.idle_passes += frame.idle_passes;
    }
}

fn starvation(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let mut starved = Starved::default();
    let disjoint = two_views(context, &mut starved)?;
    let wanted = overflow(context, &mut starved)?;
    let failing = one_failing_brick(context)?;
    let gates = vec![
        Gate::at_most("pixels without anything on screen at a time budget of 0", starved.pixels_lost as f64, 0.0),
        Gate::at_most("greatest difference from the picture with an ample cache", starved.worst_linf, 0.0),
        Gate::at_most("page-ins of a frame per brick that it uses", starved.worst_ratio, 1.5),
        Gate::at_most("passes that read nothing although rays waited", starved.idle_passes as f64, 0.0),
        Gate::at_most("attempts at the failing brick in 32 frames", failing.attempts as f64, 5.0),
        Gate::at_most("frames that do not show the brick as failed", failing.frames_silent as f64, 0.0),
        Gate::at_most(
            "pixels without anything on screen beside or in the failed brick",
            failing.pixels_lost as f64,
            0.0,
        ),
    ];
    let note = format!(
        "The two views share {disjoint} of their bricks. At a budget of 0 only the coarsest level is read, and kept. The \
         frame that wants {wanted} bricks has a cache for one in a hundred. The failing brick waits 2, 4, 8, 16 frames \
         between attempts, so that 32 frames see attempts in frames 1, 3, 7, 15 and 31; it is drawn from its parent."
    );
    Ok(Outcome { curve: failing.curve, gates, note })
}

/// Two views of opposite corners in alternation. Returns the fraction of bricks used by both, as text.
fn two_views(context: &Context<'_>, starved: &mut Starved) -> Result<String, ChartError> {
    let (volume, _) = VirtualVolume::open(Field::BrickId, [2048; 3], 16)?;
    let size = context.pick((120, 90), (40, 30));
    let corner = |low: f64| {
        let target = [low; 3];
        let eye = target.map(|t| if low < 1024.0 { t - 300.0 } else { t + 300.0 });
        let camera = format!(r#""camera": {{"eye": {eye:?}, "target": {target:?}, "up": [0, 0.1, 1], "fov_y": 20}}"#);
        // Opaque within a corner: rays end before they reach the other view's bricks.
        let dense = translucent(0.02 * volume.radius());
        scene(&volume, &[camera, image_size(size.0, size.1), dense])
    };
    let views = [corner(60.0)?, corner(1987.0)?];
    let whole = [fresh(&volume, &views[0], Settings::default())?, fresh(&volume, &views[1], Settings::default())?];
    let mut both = Session::new(&volume.container, Settings::default())?;
    let together =
        both.frame(&views[0], None)?.stats.streaming.page_ins + both.frame(&views[1], None)?.stats.streaming.page_ins;
    let shared = whole[0].stats.streaming.page_ins + whole[1].stats.streaming.page_ins - together;

    let brick = BrickBytes::of(&volume.container).decoded;
    let cache_bytes = (whole[0].stats.host_cache_bytes / 2).max(2 * brick);
    let settings = Settings { cache_bytes: Some(cache_bytes), ..Settings::default() };
    let mut session = Session::new(&volume.container, settings)?;
    for turn in 0..4 {
        let late = session.frame(&views[turn % 2], Some(0))?;
        starved.pixels_lost += pixels_lost(&late.image, &whole[turn % 2].image);
    }
    for turn in 0..4 {
        let frame = session.frame(&views[turn % 2], None)?;
        starved.add(&frame, &whole[turn % 2]);
    }
    Ok(format!("{shared} of {}", whole[0].stats.streaming.page_ins))
}

/// A frame that needs a hundred times as many bricks as the cache holds. Returns the number of bricks.
fn overflow(context: &Context<'_>, starved: &mut Starved) -> Result<u64, ChartError> {
    let (volume, _) = VirtualVolume::open(Field::BrickId, [65_536; 3], 16)?;
    let view = &orbit(&volume, 1, context.pick((192, 144), (96, 72)))?[0];
    let whole = fresh(&volume, view, Settings::default())?;
    let cache_bytes = (whole.stats.host_cache_bytes / 100).max(BrickBytes::of(&volume.container).decoded);
    let frame = fresh(&volume, view, Settings { cache_bytes: Some(cache_bytes), ..Settings::default() })?;
    starved.add(&frame, &whole);
    Ok(whole.stats.streaming.page_ins)
}

/// Effects on 32 frames of one brick that always fails.
struct Failing {
    curve: Vec<CurvePoint>,
    attempts: u64,
    frames_silent: u64,
    pixels_lost: usize,
}

fn one_failing_brick(context: &Context<'_>) -> Result<Failing, ChartError> {
    const FRAMES: u32 = 32;
    let source = Arc::new(VirtualVolume::new(Field::BrickId, [128; 3], 16, Geometry::IDENTITY)?);
    let bad = BrickKey::new(Lod::FINEST, BrickIndex([1, 2, 3]));
    let place = source.record_bytes_of(bad);
    let hits = Arc::new(AtomicU64::new(0));
    let count = hits.clone();
    let watched = Watched::new(
        source,
        Box::new(move |_, offset, buffer| {
            if offset < place.end && offset + buffer.len() as u64 > place.start {
                count.fetch_add(1, Ordering::Relaxed);
                return Err(io::Error::other("this brick always fails"));
            }
            Ok(())
        }),
    );
    let watched = watched.map_err(|e| ChartError::Broken(e.to_string()))?;
    let volume = Volume::of("BRICKID with a bad brick", Arc::new(Container::from_source(Arc::new(watched))?));
    let size = context.pick((96, 72), (40, 30));
    let view = scene(&volume, &[volume.outside(), image_size(size.0, size.1), translucent(volume.radius())])?;
    let settings = Settings::default().finest();
    let whole = fresh(&VirtualVolume::open(Field::BrickId, [128; 3], 16)?.0, &view, settings)?;
    let mut session = Session::new(&volume.container, settings)?;
    let mut failing = Failing { curve: Vec::new(), attempts: 0, frames_silent: 0, pixels_lost: 0 };
    for frame_number in 1..=FRAMES {
        let frame = session.frame(&view, None)?;
        let named = frame.stats.failures.iter().any(|f| f.brick == bad.to_string());
        failing.frames_silent += u64::from(frame.stats.bricks_failed != 1 || !named);
        failing.pixels_lost += pixels_lost(&frame.image, &whole.image);
        failing.attempts = session.streamer().states().transitions(StateKind::Reading, StateKind::Failed);
        // Attempts are 2, 4, 8, ... frames apart: attempt n is in frame 2^n - 1.
        let expected = f64::from(frame_number + 1).log2().floor();
        let x = f64::from(frame_number);
        failing.curve.push(CurvePoint::new("default", x, failing.attempts as f64, Some(expected)));
    }
    if hits.load(Ordering::Relaxed) < failing.attempts {
        return Err(ChartError::Broken("fewer reads failed than bricks".into()));
    }
    Ok(failing)
}
