//! S40 and S44: edits while bricks are loading; equal pictures for any number of threads and any cache content.

use supervol_runtime::engines::error::EngineError;
use supervol_runtime::engines::gpu::error::GpuError;
use supervol_runtime::render::error::RenderError;
use supervol_runtime::render::options::{Backend, RenderOptions};
use supervol_runtime::render::renderer::Renderer;
use supervol_scene::scene::ResolvedScene;

use super::session::{Session, Settings, fresh, linf, scene, translucent};
use crate::context::{ChartError, Context};
use crate::stability::regime::{CurvePoint, Gate, Outcome, Regime};
use crate::virtual_volume::{Field, VirtualVolume};
use crate::volume::{HOST_MEMORY_BYTES, Volume, device, finest, image_size, transfer_function};

/// S40.
pub const EDITS_WHILE_LOADING: Regime = Regime {
    id: "S40",
    title: "Edits while loading",
    recipe: "BRICKID 512^3 in bricks of 16, a cache for a fifth of a frame's bricks. A frame is abandoned after n passes, \
             the transfer function (or the mode) is edited and the next frame is drawn by the same streamer. What was \
             invisible becomes visible and the other way round.",
    x_label: "passes of the abandoned frame",
    y_label: "greatest difference from a fresh picture (share of full scale)",
    run: edits_while_loading,
};

/// S44.
pub const DETERMINISM: Regime = Regime {
    id: "S44",
    title: "Determinism",
    recipe: "BRICKID 128^3 in bricks of 16 and 4096^3 at chosen levels: 1, 2 and 8 threads, a cold and a warm cache, \
             ample and small; the picture of one thread with a cold ample cache is the one to compare with.",
    x_label: "threads",
    y_label: "greatest difference (share of full scale)",
    run: determinism,
};

/// Scenes of one camera with different transfer functions and an iso surface.
fn edits(volume: &Volume, size: (u32, u32)) -> Result<Vec<ResolvedScene>, ChartError> {
    let unit = volume.radius() / 4.0;
    let (blue, gold) = ([0.1, 0.3, 0.9], [1.0, 0.75, 0.2]);
    let members = |edit: String| [volume.outside(), image_size(size.0, size.1), edit];
    let low = transfer_function(unit, &[(0.0, blue, 0.4), (90.0, gold, 0.1), (91.0, gold, 0.0), (249.0, gold, 0.0)]);
    let high = transfer_function(unit, &[(0.0, blue, 0.0), (150.0, blue, 0.0), (151.0, gold, 0.3), (249.0, gold, 0.5)]);
    let iso = r#""mode": "iso", "shading": null, "iso": [{"value": 120.3, "color": [0.9, 0.7, 0.4], "alpha": 0.5}]"#;
    [low, high, iso.into(), translucent(volume.radius())]
        .into_iter()
        .map(|edit| scene(volume, &members(edit)))
        .collect()
}

fn edits_while_loading(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let (volume, _) = VirtualVolume::open(Field::BrickId, [512; 3], 16)?;
    let scenes = edits(&volume, context.pick((96, 72), (40, 30)))?;
    let whole = scenes.iter().map(|s| fresh(&volume, s, Settings::default())).collect::<Result<Vec<_>, _>>()?;
    let mut curve = Vec::new();
    let mut worst = 0.0f64;
    let cache_bytes = Some(whole[3].stats.host_cache_bytes / 5);
    for passes in context.pick(vec![0, 1, 2, 3, 5, 8, 13, 21], vec![0, 1, 3, 8]) {
        let mut session = Session::new(&volume.container, Settings { cache_bytes, ..Settings::default() })?;
        let mut here = 0.0f64;
        for (before, after) in [(0, 1), (1, 2), (2, 3), (3, 0), (0, 2), (2, 1), (1, 3), (3, 3)] {
            session.begin_only(&scenes[before], passes)?;
            let frame = session.frame(&scenes[after], None)?;
            here = here.max(linf(&frame.image, &whole[after].image));
        }
        curve.push(CurvePoint::new("default", passes as f64, here, Some(0.0)));
        worst = worst.max(here);
    }
    let gates = vec![Gate::at_most("greatest difference from a fresh picture after an edit", worst, 0.0)];
    let note = "A picture belongs to one transfer function: it is part of the frame, and an edit begins the next one, so \
                that no frame can mix two. What an edit could spoil is the streamer that outlives it: bricks known to be \
                invisible or uniform under the old one, and bricks queued for it. Updates of bricks do not apply: a \
                container does not change once it is written."
        .into();
    Ok(Outcome { curve, gates, note })
}

fn determinism(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let size = context.pick((160, 120), (48, 36));
    let mut curve = Vec::new();
    let mut worst_cpu = 0.0f64;
    for (dims, settings) in [(128, Settings::default().finest()), (4096, Settings::default())] {
        let (volume, _) = VirtualVolume::open(Field::BrickId, [dims; 3], 16)?;
        let view = scene(&volume, &[volume.outside(), image_size(size.0, size.1), translucent(volume.radius())])?;
        let whole = fresh(&volume, &view, Settings { threads: 1, ..settings })?;
        let small = Some(whole.stats.host_cache_bytes / 7);
        for threads in [1, 2, 8] {
            for (series, cache_bytes) in [("CPU, ample cache", None), ("CPU, cache for a seventh", small)] {
                let mut session = Session::new(&volume.container, Settings { threads, cache_bytes, ..settings })?;
                // First with a cold cache, then with a warm one.
                let mut here = 0.0f64;
                for _ in 0..2 {
                    here = here.max(linf(&session.frame(&view, None)?.image, &whole.image));
                }
                worst_cpu = worst_cpu.max(here);
                curve.push(CurvePoint::new(&format!("{series}, {dims}^3"), threads as f64, here, Some(0.0)));
            }
        }
    }
    let mut gates = vec![Gate::at_most("greatest difference between CPU pictures", worst_cpu, 0.0)];
    let mut note = "Each value is the greater of a cold and a warm frame.".to_owned();
    match gpu_differences(context, size, &mut curve) {
        Ok(worst) => {
            gates.push(Gate::at_most("greatest difference between GPU pictures", worst, 1e-5));
            note += " GPU pictures: memory for all bricks and for a few, so that bricks arrive in other orders.";
        }
        Err(ChartError::Render(RenderError::Engine(EngineError::Gpu(GpuError::NoAdapter { reason })))) => {
            note += &format!(" Not measured: the GPU; no GPU adapter: {reason}.");
        }
        Err(error) => return Err(error),
    }
    Ok(Outcome { curve, gates, note })
}

fn gpu_differences(context: &Context<'_>, size: (u32, u32), curve: &mut Vec<CurvePoint>) -> Result<f64, ChartError> {
    let (volume, _) = VirtualVolume::open(Field::BrickId, [128; 3], 16)?;
    let view = scene(&volume, &[volume.outside(), image_size(size.0, size.1), translucent(volume.radius())])?;
    let options = |threads, gpu_memory_bytes: u64| RenderOptions {
        threads: Some(threads),
        gpu_memory_bytes: Some(gpu_memory_bytes),
        host_memory_bytes: HOST_MEMORY_BYTES,
        ..finest(Backend::Gpu)
    };
    let (whole, _, stats) = volume.render_with_maps(&view, &options(1, 64 << 20))?;
    // Memory for rays, tables and the fewest bricks, plus a tenth of the memory of all bricks.
    let least = match volume.render_with_maps(&view, &options(1, 1)) {
        Err(RenderError::Engine(EngineError::Gpu(GpuError::Budget { needed, .. }))) => needed,
        other => return Err(ChartError::Broken(format!("a picture in 1 byte of GPU memory: {:?}", other.err()))),
    };
    let few = least + stats.gpu_bytes.saturating_sub(least) / 10;
    let mut worst = 0.0f64;
    // Software adapters are slow, so the small scale runs one case of each kind.
    let all = [(1, 64 << 20), (1, few), (2, 64 << 20), (2, few), (8, 64 << 20), (8, few)];
    for (threads, memory) in all.into_iter().skip(context.pick(0, 4)) {
        let living = supervol_runtime::render::volume::PlacedVolume::of(volume.container.clone());
        let mut renderer = Renderer::on_device(living, options(threads, memory), device()?)?;
        let mut here = 0.0f64;
        // First with a cold cache, then with a warm one.
        for _ in 0..2 {
            renderer.set_scene(view.clone());
            renderer.begin_anew();
            renderer.advance(None)?;
            let image = renderer.picture().expect("nobody cancels");
            here = here.max(linf(&image, &whole));
        }
        curve.push(CurvePoint::new(&format!("GPU, {} MiB", memory >> 20), threads as f64, here, Some(0.0)));
        worst = worst.max(here);
    }
    Ok(worst)
}
