//! S39: coordinates so large that single precision cannot distinguish neighbouring voxels.

use std::sync::Arc;

use supervol_format::cast::narrow;
use supervol_format::{Container, Geometry, Lod};
use supervol_runtime::engines::error::EngineError;
use supervol_runtime::engines::gpu::error::GpuError;
use supervol_runtime::render::error::RenderError;
use supervol_runtime::render::options::Backend;
use supervol_scene::image::Image;
use supervol_scene::scene::ResolvedScene;

use super::session::{linf, scene};
use crate::context::{ChartError, Context};
use crate::stability::regime::{CurvePoint, Gate, Outcome, Regime};
use crate::virtual_volume::{Field, PERIOD, VirtualVolume, value};
use crate::volume::{Volume, image_size, transfer_function};

/// S39.
pub const HUGE_COORDINATES: Regime = Regime {
    id: "S39",
    title: "Huge coordinates",
    recipe: "BRICKID of 2^24 + 256 x 64 x 64 voxels in bricks of 64. Orthographic pictures of 1/16 voxel per pixel across \
             the brick borders at voxels 2^16, 2^20 and 2^24 (the picture holds voxel 2^24 + 1), with the origin of the \
             world at voxel 0 and 6.5e6 m away: greatest value along rays across the border, alpha growing by 1 from one \
             brick's value to the other's, so that alpha is the position. An orbit around each border beside the same \
             orbit around a border of the same bricks near voxel 0.",
    x_label: "voxel coordinate",
    y_label: "error of the position seen (voxels)",
    run: huge_coordinates,
};

const CORE: u64 = 64;
const LENGTH: u64 = (1 << 24) + 4 * CORE;
/// Pixels per voxel of the orthographic pictures.
const PIXELS_PER_VOXEL: u32 = 16;
/// Northing of a survey in UTM, metres.
const UTM: f64 = 6.5e6;

/// A brick border, and a border near voxel 0 between bricks with the same values.
struct Border {
    /// First voxel after the border.
    voxel: u64,
    /// First voxel after the border near voxel 0.
    twin: u64,
}

fn borders() -> [Border; 3] {
    [16, 20, 24].map(|power| {
        let brick = (1u64 << power) / CORE;
        let period = u64::from(PERIOD);
        Border { voxel: brick * CORE, twin: (brick % period + period) * CORE }
    })
}

fn volume_at(origin: f64) -> Result<Volume, ChartError> {
    let geometry = Geometry { origin: [origin, origin, 0.0], ..Geometry::IDENTITY };
    let source = VirtualVolume::new(Field::BrickId, [LENGTH, CORE, CORE], narrow::<u32>(CORE), geometry)?;
    Ok(Volume::of("BRICKID", Arc::new(Container::from_source(Arc::new(source))?)))
}

/// Values on both sides of a border, in the first macro cells of y and z.
fn values(border: u64) -> [f64; 2] {
    [border - 1, border].map(|x| f64::from(value(CORE, Lod::FINEST, [x, 0, 0])))
}

fn border_scene(volume: &Volume, border: u64, camera: String, size: (u32, u32)) -> Result<ResolvedScene, ChartError> {
    let [a, b] = values(border);
    let ramp = transfer_function(1.0, &[(a.min(b), [1.0; 3], 0.0), (a.max(b), [1.0; 3], 1.0)]);
    // Clipped to the first macro cells of y and z, where a brick has one value.
    let clip = format!(r#""clip": {{"box": [[{}.0, 0, 0], [{}.0, 6, 6]]}}"#, border - 6, border + 6);
    scene(volume, &[camera, image_size(size.0, size.1), ramp, clip, r#""mode": "mip""#.into()])
}

fn picture(volume: &Volume, scene: &ResolvedScene, backend: Backend) -> Result<Image, ChartError> {
    volume.finest(scene, backend)
}

/// Largest distance between the position in the picture and the true position, voxels.
fn position_error(volume: &Volume, border: u64, backend: Backend) -> Result<f64, ChartError> {
    let target = volume.world([border as f64, 3.0, 3.0]);
    let eye = target - glam::DVec3::Z * 40.0;
    let (eye, target) = (eye.to_array(), target.to_array());
    let (width, height) = (4 * PIXELS_PER_VOXEL, 4);
    let world_height = f64::from(height) / f64::from(PIXELS_PER_VOXEL);
    let camera =
        format!(r#""camera": {{"eye": {eye:?}, "target": {target:?}, "up": [0, 1, 0], "height": {world_height:?}}}"#);
    let scene = border_scene(volume, border, camera, (width, height))?;
    let image = picture(volume, &scene, backend)?;
    let [a, b] = values(border);
    let index_from_world = volume.facts.geometry.index_from_world();
    let mut worst = 0.0f64;
    for y in 0..height {
        for x in 0..width {
            let seen = f64::from(image.pixels[(y * width + x) as usize][3]);
            let at = index_from_world.transform_point3(scene.camera.ray(x, y).origin).x;
            // Between the border's two voxels the value is linear; outside it is constant.
            let share = (at - (border - 1) as f64).clamp(0.0, 1.0);
            let expected = if b > a { share } else { 1.0 - share };
            worst = worst.max((seen - expected).abs());
        }
    }
    Ok(worst)
}

/// Frame `step` of an orbit around a border.
fn orbit_picture(volume: &Volume, border: u64, step: u32, backend: Backend) -> Result<Image, ChartError> {
    let target = volume.world([border as f64 - 0.5, 3.0, 3.0]);
    let angle = 0.7 + 0.003 * f64::from(step);
    let eye = target + 14.0 * glam::DVec3::new(0.4 * angle.sin(), angle.cos(), angle.sin());
    let (eye, target) = (eye.to_array(), target.to_array());
    let camera = format!(r#""camera": {{"eye": {eye:?}, "target": {target:?}, "up": [1, 0.1, 0], "fov_y": 35}}"#);
    let scene = border_scene(volume, border, camera, (32, 32))?;
    picture(volume, &scene, backend)
}

/// Greatest change of alpha between vertically neighbouring pixels.
fn steepest(image: &Image) -> f64 {
    let width = image.width as usize;
    let pairs = image.pixels.iter().zip(&image.pixels[width..]);
    pairs.map(|(a, b)| f64::from((a[3] - b[3]).abs())).fold(0.0, f64::max)
}

/// Shift of the far orbit, in pixels, that explains the difference between its pictures and those of the near orbit.
fn jitter(near: &Volume, far: &Volume, border: &Border, steps: u32, backend: Backend) -> Result<f64, ChartError> {
    let mut worst = 0.0f64;
    for step in 0..steps {
        let expected = orbit_picture(near, border.twin, step, backend)?;
        let seen = orbit_picture(far, border.voxel, step, backend)?;
        worst = worst.max(linf(&seen, &expected) / steepest(&expected));
    }
    Ok(worst)
}

fn huge_coordinates(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let (near, utm) = (volume_at(0.0)?, volume_at(UTM)?);
    let mut curve = Vec::new();
    let mut gates = Vec::new();
    let mut note =
        "Jitter is the greatest difference between the two orbits' pictures, divided by the steepest change of \
                    alpha between two pixels: the shift that explains it."
            .to_owned();
    for (name, backend) in [("CPU", Backend::Cpu), ("GPU", Backend::Gpu)] {
        let (mut worst_error, mut worst_jitter) = (0.0f64, 0.0f64);
        // Software adapters are slow, so the small scale runs only the hardest case.
        let least = context.pick(false, backend == Backend::Gpu);
        let mut measure = || -> Result<(), ChartError> {
            for border in borders().into_iter().skip(if least { 2 } else { 0 }) {
                for (place, volume) in
                    [("origin 0", &near), ("origin 6.5e6 m", &utm)].into_iter().skip(usize::from(least))
                {
                    let error = position_error(volume, border.voxel, backend)?;
                    curve.push(CurvePoint::new(&format!("{name}, {place}"), border.voxel as f64, error, Some(0.0)));
                    worst_error = worst_error.max(error);
                    let steps = context.pick(8, if least { 1 } else { 2 });
                    worst_jitter = worst_jitter.max(jitter(&near, volume, &border, steps, backend)?);
                }
            }
            Ok(())
        };
        match measure() {
            Ok(()) => {
                let what = format!("error of a brick border's position, {name} (voxels)");
                gates.push(Gate::at_most(what, worst_error, 1.0 / 256.0));
                gates.push(Gate::at_most(format!("jitter of an orbit, {name} (pixels)"), worst_jitter, 0.1));
            }
            Err(ChartError::Render(RenderError::Engine(EngineError::Gpu(GpuError::NoAdapter { reason })))) => {
                note += &format!(" Not measured: the GPU; no GPU adapter: {reason}.");
            }
            Err(error) => return Err(error),
        }
    }
    Ok(Outcome { curve, gates, note })
}
