//! S48: memory growth of a long run.

use glam::DVec3;
use supervol_runtime::engines::error::EngineError;
use supervol_runtime::engines::gpu::error::GpuError;
use supervol_runtime::render::error::RenderError;
use supervol_runtime::render::options::Backend;
use supervol_runtime::render::process;
use supervol_scene::scene::ResolvedScene;

use super::session::{Session, Settings, scene};
use crate::context::{ChartError, Context, Pace};
use crate::stability::regime::{CurvePoint, Gate, Outcome, Regime};
use crate::virtual_volume::{Field, VirtualVolume};
use crate::volume::{Volume, image_size, transfer_function};

/// S48.
pub const LONG_RUN: Regime = Regime {
    id: "S48",
    title: "Memory of a long run",
    recipe: "BRICKID 128^3 in bricks of 16, one renderer: a thousand pictures, each from another side with another transfer function, \
             unshaded, shaded and as a maximum projection in turn. Resident memory of the process after every picture.",
    x_label: "pictures",
    y_label: "resident memory (MiB)",
    run: long_run,
};

/// Largest memory growth after the first tenth of a run that counts as noise, MiB. For comparison: a driver that
/// recompiles a shader for every dispatch keeps 4 MiB each time.
const GROWTH_LIMIT_MIB: f64 = 16.0;
/// Number of points of a curve.
const POINTS: usize = 50;

fn long_run(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let (volume, _) = VirtualVolume::open(Field::BrickId, [128; 3], 16)?;
    let mut curve = Vec::new();
    let mut gates = Vec::new();
    let mut note = "Memory is that of the whole process, what earlier regimes have left included; what is expected is what was resident \
                    after the first tenth of the pictures, when pipelines are compiled and all bricks are there."
        .to_owned();
    for (series, backend) in [("CPU", Backend::Cpu), ("GPU", Backend::Gpu)] {
        match resident_after(context, &volume, backend) {
            Ok(resident) => {
                let settled = resident[resident.len() / 10];
                let last = resident.len() - 1;
                let growth = resident[resident.len() / 10..].iter().fold(0.0f64, |most, mib| most.max(mib - settled));
                gates.push(Gate::at_most(format!("growth, {series} (MiB)"), growth, GROWTH_LIMIT_MIB));
                let shown = (0..=last).filter(|i| i % resident.len().div_ceil(POINTS) == 0 || *i == last);
                curve.extend(shown.map(|i| CurvePoint::new(series, i as f64 + 1.0, resident[i], Some(settled))));
            }
            Err(ChartError::Render(RenderError::Engine(EngineError::Gpu(GpuError::NoAdapter { reason })))) => {
                note += &format!(" Not measured: the GPU; no GPU adapter: {reason}.");
            }
            Err(error) => return Err(error),
        }
    }
    Ok(Outcome { curve, gates, note })
}

/// Resident memory of the process after each picture, MiB.
fn resident_after(context: &Context<'_>, volume: &Volume, backend: Backend) -> Result<Vec<f64>, ChartError> {
    let pictures = context.pick(1000, 60);
    let mut session = Session::new(&volume.container, Settings { backend, ..Settings::default() })?;
    let pace = Pace::new(context.say);
    let mut resident = Vec::with_capacity(pictures);
    for picture in 0..pictures {
        session.frame(&look(volume, picture)?, None)?;
        resident.push(process::resident_bytes() as f64 / f64::from(1 << 20));
        pace.tell(|| format!("S48: {} of {pictures} pictures", picture + 1));
    }
    Ok(resident)
}

/// Scene of one picture of the run.
fn look(volume: &Volume, picture: usize) -> Result<ResolvedScene, ChartError> {
    let angle = 0.1 * picture as f64;
    let camera = volume.looking_from(DVec3::new(angle.cos(), angle.sin(), 0.4), 2.7);
    let most = 0.3 + 0.2 * angle.sin();
    let tf = transfer_function(0.5 * volume.radius(), &[(0.0, [0.1, 0.2, 0.9], 0.0), (249.0, [1.0, 0.5, 0.1], most)]);
    let kind = match picture % 3 {
        0 => r#""mode": "dvr""#,
        1 => r#""mode": "dvr", "shading": {}"#,
        _ => r#""mode": "mip""#,
    };
    scene(volume, &[camera, image_size(32, 24), tf, kind.to_owned()])
}
