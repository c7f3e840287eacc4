//! Regime of extreme numbers: S47.

use std::collections::HashMap;

use supervol_format::{Geometry, VoxelType};
use supervol_runtime::engines::gpu::device::GpuDevice;
use supervol_runtime::render::options::Backend;
use supervol_scene::image::Image;
use supervol_sources::computed::Computed;

use super::regime::{CurvePoint, Gate, Outcome, Regime};
use super::views::{GOLD, HALF_A_LEVEL, SHADED, fractions, grey_levels, smooth};
use crate::context::{ChartError, Context};
use crate::fixtures;
use crate::volume::{Volume, build_options, image_size, transfer_function};

/// The regimes of this module.
pub const REGIMES: &[Regime] = &[Regime {
    id: "S47",
    title: "Extreme values, spacings and origins",
    recipe: "One field with its values times 2^k (f32, f64, and i16 by the file's slope), its spacing times 2^k, its origin at \
             2^k spacings: the default camera sees the same picture, which is held against the reference at k = 0. And one \
             voxel of 1e10 to 1e37 beside the others; and voxels up to 2^19 times as long as wide.",
    x_label: "k, the power of two",
    y_label: "greatest difference from the reference of the field at k = 0, grey levels of 255",
    run: extremes,
}];

const DIMS: [u64; 3] = [22, 19, 17];
/// Least value of the unscaled field, so that both signs occur.
const LEAST: f64 = -0.3;

/// Placement and scaling of the field.
#[derive(Clone, Copy)]
struct Case {
    series: &'static str,
    voxel_type: VoxelType,
    /// Factor of the values.
    value: f64,
    /// Scale of the stored values in the file; integers use it instead of `value`.
    slope: f64,
    spacing: f64,
    /// Origin, in spacings.
    origin: f64,
}

const PLAIN: Case =
    Case { series: "f32", voxel_type: VoxelType::F32, value: 1.0, slope: 1.0, spacing: 1.0, origin: 0.0 };
/// Integer steps per unit of the field.
const STEPS: f64 = 30_000.0;

impl Case {
    fn source(self) -> Computed {
        let Self { value, slope, spacing, origin, voxel_type, .. } = self;
        let steps = if voxel_type == VoxelType::I16 { STEPS } else { 1.0 };
        Computed::new(DIMS, voxel_type, move |v| (fixtures::waves_at(fixtures::point(v)) + LEAST) * value * steps)
            .with_info(|info| {
                info.scale = slope / steps;
                info.geometry = Geometry {
                    spacing: [spacing, 0.8 * spacing, 1.3 * spacing],
                    origin: [origin * spacing, -origin * spacing, 0.5 * origin * spacing],
                    ..Geometry::IDENTITY
                };
            })
    }

    fn build(self, context: &Context<'_>) -> Result<Volume, ChartError> {
        Volume::build(context, &format!("S47 {}", self.series), &self.source(), &build_options(16))
    }
}

/// Cases of all series with their powers of two: values 1e-300 to 1e300, spacings 1e-30 to 1e30, origins to 1e18
/// spacings.
fn cases(context: &Context<'_>) -> Vec<(i32, Case)> {
    type Place = fn(f64) -> Case;
    let series: [(&[i32], &[i32], Place); 5] = [
        (&[-122, -100, -73, -63, -33, 33, 63, 83, 100, 122], &[-122, -73, 63, 122], |x| Case { value: x, ..PLAIN }),
        (&[-996, -664, -332, -150, -126, 123, 150, 332, 664, 996], &[-996, -150, 123, 996], |x| Case {
            series: "f64",
            voxel_type: VoxelType::F64,
            value: x,
            ..PLAIN
        }),
        (&[-980, -332, -150, -66, 66, 116, 150, 332, 980], &[-150, 116], |x| Case {
            series: "i16 with a slope",
            voxel_type: VoxelType::I16,
            slope: x,
            ..PLAIN
        }),
        (&[-100, -83, -63, -40, -20, 20, 40, 63, 83, 100], &[-100, -63, 100], |x| Case {
            series: "spacing",
            spacing: x,
            ..PLAIN
        }),
        (&[20, 30, 40, 50, 60], &[40, 60], |x| Case { series: "origin", origin: x, ..PLAIN }),
    ];
    let all = series.iter().flat_map(|&(full, small, place)| {
        context.pick(full, small).iter().map(move |&k| (k, place(f64::from(k).exp2())))
    });
    all.collect()
}

/// Scene members for mode, transfer function and shading.
fn looks(volume: &Volume) -> Vec<(&'static str, Vec<String>)> {
    let unit = 1.5 * volume.facts.geometry.smallest_spacing();
    let tf = smooth(volume, unit);
    let opaque = fractions(volume, unit, &[(0.0, GOLD, 0.0), (1.0, GOLD, 0.9)]);
    let surface =
        format!(r#""mode": "iso", "iso": [{{"value": {:?}, "color": {GOLD:?}, "alpha": 0.6}}]"#, volume.value(0.55));
    let mode = |mode: &str| format!(r#""mode": "{mode}""#);
    let mut looks = vec![
        ("shaded", vec![tf.clone(), SHADED.into()]),
        ("iso", vec![surface, SHADED.into()]),
        ("unshaded", vec![tf]),
        ("mip", vec![opaque.clone(), mode("mip")]),
        ("mean", vec![opaque, mode("mean")]),
    ];
    // Percentiles of `f64` are counted in `f32`, which has a smaller range.
    if volume.container.descriptor().voxel_type != VoxelType::F64 {
        looks.push(("preset", vec![SHADED.into()]));
    }
    looks
}

/// Pictures of a volume by the default camera, one per look.
fn pictures(volume: &Volume, size: &str, backend: Backend) -> Result<Vec<Image>, ChartError> {
    let picture = |(_, members): (_, Vec<String>)| {
        let mut all: Vec<&str> = members.iter().map(String::as_str).collect();
        all.push(size);
        volume.finest(&volume.scene(&all)?, backend)
    };
    looks(volume).into_iter().map(picture).collect()
}

fn extremes(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let size = context.pick(image_size(48, 36), image_size(20, 15));
    // One reference per voxel type: the percentiles of presets are exact only for 16 bits.
    let types = [VoxelType::F32, VoxelType::F64, VoxelType::I16];
    let exact = |voxel_type| pictures(&Case { voxel_type, ..PLAIN }.build(context)?, &size, Backend::Reference);
    let exact = types.map(|voxel_type| exact(voxel_type).map(|pictures| (voxel_type, pictures)));
    let exact = exact.into_iter().collect::<Result<HashMap<_, _>, ChartError>>()?;
    let mut backends = vec![("", Backend::Cpu), (", reference", Backend::Reference)];
    if GpuDevice::open().is_ok() {
        backends.push((", gpu", Backend::Gpu));
    }
    let (mut curve, mut worst) = (Vec::new(), vec![0.0f64; backends.len()]);
    for (power, case) in std::iter::once((0, PLAIN)).chain(cases(context)) {
        let volume = case.build(context)?;
        for (&(name, backend), worst) in backends.iter().zip(&mut worst) {
            let made = pictures(&volume, &size, backend)?;
            let off = made
                .iter()
                .zip(&exact[&case.voxel_type])
                .map(|(made, exact)| grey_levels(made, exact))
                .fold(0.0, f64::max);
            curve.push(CurvePoint::new(&format!("{}{name}", case.series), f64::from(power), off, Some(0.0)));
            *worst = worst.max(off);
        }
    }
    let gates = backends.iter().zip(worst).map(|(&(name, _), worst)| {
        Gate::at_most(format!("difference from the reference at k = 0, grey levels{name}"), worst, HALF_A_LEVEL)
    });
    let gates = gates.chain([beside_a_spike(context, &size)?, long_voxels(context, &size)?]).collect();
    let note = "Volumes are looked at by the default camera, shaded, as a surface, unshaded, by greatest and mean value, and \
                by the preset; the curve has the worst of these.";
    Ok(Outcome { curve, gates, note: note.into() })
}

/// Greatest difference from the reference if one voxel is far beyond all others.
fn beside_a_spike(context: &Context<'_>, size: &str) -> Result<Gate, ChartError> {
    let mut worst = 0.0f64;
    for power in context.pick(&[10, 20, 30, 37][..], &[20, 37][..]) {
        let spike = 10f64.powi(*power);
        let field = move |v| if v == [11, 9, 8] { spike } else { fixtures::waves_at(fixtures::point(v)) + LEAST };
        let volume =
            Volume::build(context, "S47 spike", &Computed::new(DIMS, VoxelType::F32, field), &build_options(16))?;
        let window = transfer_function(1.5, &[(LEAST, GOLD, 0.0), (1.0 + LEAST, GOLD, 0.3)]);
        for shading in ["", SHADED] {
            let members: Vec<&str> = [window.as_str(), size, shading].into_iter().filter(|m| !m.is_empty()).collect();
            let scene = volume.scene(&members)?;
            let exact = volume.finest(&scene, Backend::Reference)?;
            let off = grey_levels(&volume.finest(&scene, Backend::Cpu)?, &exact);
            worst = worst.max(off);
        }
    }
    Ok(Gate::at_most(
        "difference from the reference beside one voxel of 1e10 to 1e37, grey levels",
        worst,
        HALF_A_LEVEL,
    ))
}

/// Greatest difference from the reference for voxels much longer or shorter than wide.
fn long_voxels(context: &Context<'_>, size: &str) -> Result<Gate, ChartError> {
    let mut worst = 0.0f64;
    for power in context.pick(&[-19, -10, -4, 4, 10, 19][..], &[-19, 19][..]) {
        let source = PLAIN.source().with_info(|info| info.geometry.spacing[2] = f64::from(*power).exp2());
        let volume = Volume::build(context, "S47 long voxels", &source, &build_options(16))?;
        let tf = smooth(&volume, volume.radius() / 20.0);
        let scene = volume.scene(&[&tf, SHADED, size])?;
        let exact = volume.finest(&scene, Backend::Reference)?;
        worst = worst.max(grey_levels(&volume.finest(&scene, Backend::Cpu)?, &exact));
    }
    Ok(Gate::at_most(
        "difference from the reference with voxels up to 2^19 times as long as wide, grey levels",
        worst,
        HALF_A_LEVEL,
    ))
}
