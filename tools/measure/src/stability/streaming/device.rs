//! S42: long work on a graphics device; a lost device.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use supervol_runtime::engines::error::EngineError;
use supervol_runtime::engines::gpu::device::GpuDevice;
use supervol_runtime::engines::gpu::error::GpuError;
use supervol_runtime::render::error::RenderError;
use supervol_runtime::render::frame::render_gpu_surviving;
use supervol_runtime::render::options::{Backend, Progress, RenderOptions};
use supervol_runtime::render::stats::FrameStats;
use supervol_scene::image::Image;
use supervol_scene::scene::ResolvedScene;

use super::session::{linf, scene, translucent};
use crate::context::{ChartError, Context};
use crate::stability::regime::{CurvePoint, Gate, Outcome, Regime};
use crate::virtual_volume::{Field, VirtualVolume};
use crate::volume::{HOST_MEMORY_BYTES, Volume, finest, image_size, transfer_function};

/// S42.
pub const DEVICE_LOSS: Regime = Regime {
    id: "S42",
    title: "Device loss, time-out",
    recipe: "BRICKID 256^3 in bricks of 32 on the GPU backend: shaded pictures of growing size, up to seconds of work, \
             and a picture during which the device is destroyed after its n-th pass.",
    x_label: "pixels",
    y_label: "longest dispatch (ms)",
    run: device_loss,
};

/// Longest time that one dispatch may block the display, milliseconds.
const DISPATCH_LIMIT_MS: f64 = 100.0;

fn options() -> RenderOptions {
    RenderOptions { host_memory_bytes: HOST_MEMORY_BYTES, gpu_memory_bytes: Some(128 << 20), ..finest(Backend::Gpu) }
}

fn device_loss(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let device = GpuDevice::open()?;
    let (volume, _) = VirtualVolume::open(Field::BrickId, [256; 3], 32)?;
    let mut curve = Vec::new();
    let (mut longest, mut total_ms) = (0.0f64, 0.0f64);
    for width in context.pick(vec![64, 128, 256, 512], vec![32, 64]) {
        (context.say)(&format!("S42: {width} pixels across"));
        let (_, stats) = draw(device.clone(), &volume, &heavy(&volume, width)?, &options())?;
        let pixels = f64::from(stats.image_width) * f64::from(stats.image_height);
        curve.push(CurvePoint::new("default", pixels, stats.gpu_dispatch_ms_max, Some(DISPATCH_LIMIT_MS)));
        longest = longest.max(stats.gpu_dispatch_ms_max);
        total_ms = total_ms.max(stats.render_ms);
    }
    let lost = losses(context, &volume)?;
    let gates = vec![
        Gate::at_most("longest dispatch (ms)", longest, DISPATCH_LIMIT_MS).speed(),
        Gate::at_most("losses after which no picture came", lost.without_picture as f64, 0.0),
        Gate::at_most("losses that the statistics do not tell of", lost.silent as f64, 0.0),
        Gate::at_most("greatest difference of the picture after a loss", lost.worst, 1e-5),
        Gate::at_most("errors that are not called a lost device when no other can be opened", lost.unclear as f64, 0.0),
    ];
    let note = format!(
        "On {}. The largest picture keeps the device busy for {total_ms:.0} ms. The device was destroyed {} times, after \
         each of a picture's first passes: a new one was opened, the renderer built anew and its memory filled again from \
         the container; the statistics carry the driver's message ({}). The time of a dispatch is wall time, the wait \
         for its result included. Its rays follow the times measured before, but are never fewer than 256: an adapter that \
         takes longer for those fails the first gate.",
        device.name(),
        lost.cases,
        lost.message
    );
    Ok(Outcome { curve, gates, note })
}

/// A scene in which every cell is visible, shaded and translucent.
fn heavy(volume: &Volume, width: u32) -> Result<ResolvedScene, ChartError> {
    let points = [(0.0, [0.1, 0.2, 0.9], 0.02), (125.0, [0.9, 0.9, 0.8], 0.05), (249.0, [1.0, 0.5, 0.1], 0.1)];
    let tf = transfer_function(volume.radius(), &points);
    let shading = r#""shading": {}"#.to_owned();
    scene(volume, &[volume.outside(), image_size(width, width * 3 / 4), tf, shading])
}

fn draw(
    device: GpuDevice,
    volume: &Volume,
    scene: &ResolvedScene,
    options: &RenderOptions,
) -> Result<(Image, FrameStats), RenderError> {
    let (image, mut stats) = render_gpu_surviving(device, &GpuDevice::open, &volume.container, scene, options)?;
    [stats.image_width, stats.image_height] = scene.image_size;
    Ok((image, stats))
}

/// Results of pictures with a lost device.
#[derive(Default)]
struct Losses {
    cases: u64,
    without_picture: u64,
    silent: u64,
    unclear: u64,
    worst: f64,
    message: String,
}

fn losses(context: &Context<'_>, volume: &Volume) -> Result<Losses, ChartError> {
    let members = [volume.outside(), image_size(32, 24), translucent(volume.radius())];
    let scene = scene(volume, &members)?;
    let (whole, stats) = draw(GpuDevice::open()?, volume, &scene, &options())?;
    let mut losses = Losses::default();
    for lose_after in 1..=context.pick(8, 1).min(stats.passes) {
        losses.cases += 1;
        let device = GpuDevice::open()?;
        let passes = AtomicU64::new(0);
        // Only the first device is destroyed: its passes are counted first.
        let doomed = device.clone();
        let destroy = move |_: Progress| {
            if passes.fetch_add(1, Ordering::Relaxed) + 1 == lose_after {
                doomed.destroy();
            }
        };
        let options = RenderOptions { progress: Some(Arc::new(destroy)), ..options() };
        match draw(device.clone(), volume, &scene, &options) {
            Ok((image, stats)) => {
                losses.worst = losses.worst.max(linf(&image, &whole));
                // After the last pass the picture is read back, which also needs the device.
                losses.silent += u64::from(stats.gpu_lost_because.is_none());
                losses.message = stats.gpu_lost_because.unwrap_or_default();
            }
            Err(_) => losses.without_picture += 1,
        }
        let gone = || Err(GpuError::NoAdapter { reason: "the only device is gone".into() });
        let again = render_gpu_surviving(device, &gone, &volume.container, &scene, &options).err();
        losses.unclear +=
            u64::from(!matches!(again, Some(RenderError::Engine(EngineError::Gpu(GpuError::DeviceLost { .. })))));
    }
    Ok(losses)
}
