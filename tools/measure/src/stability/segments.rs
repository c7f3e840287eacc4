//! Segments of different lengths along a ray (S05, S07): start of sampling, clipped cells, unequal spacings.
//!
//! The picture is an integral over world length. The position of a ray's first sample, the length of its last step and
//! the shape of the stored voxels must not change it.

use glam::DVec3;
use supervol_format::VoxelType;
use supervol_format::cast::whole;
use supervol_runtime::render::options::{Backend, RenderOptions};
use supervol_scene::image::Image;
use supervol_sources::computed::Computed;

use super::parallel::{GREY_LEVELS, HALF_A_LEVEL, NEVER, by_samples, worst};
use super::regime::{CurvePoint, Gate, Outcome, Regime};
use crate::comparison::{Offset, Rule, Sampling};
use crate::context::{ChartError, Context};
use crate::fixtures;
use crate::measure::distance;
use crate::volume::{Volume, build_options, finest, image_size, transfer_function};

/// The regimes of this file.
pub const REGIMES: &[Regime] = &[
    Regime {
        id: "S05",
        title: "Segments of varying length",
        recipe: "ML in bricks of 16, cut by a plane across the rays that takes 0.1 of a voxel's step from some cell; \
                 the start of every ray moved by 16ths of a step, then the plane itself.",
        x_label: "offset of the ray's start, steps",
        y_label: "greatest difference from the first offset, grey levels of 255",
        run: varying_segments,
    },
    Regime {
        id: "S07",
        title: "Opacity correction across spacings",
        recipe: "One body, linear in world coordinates, stored at spacings (1, 1, 1), (1/2, 1/2, 2) and (1/4, 1/4, \
                 4); perspective, clipped to where all three grids hold the same field.",
        x_label: "spacing along z / spacing along x",
        y_label: "greatest difference from spacing (1, 1, 1), grey levels of 255",
        run: unequal_spacings,
    },
];

/// Number of offsets of S05.
const OFFSETS: u32 = 16;
/// Ray direction of S05: along no axis and no diagonal.
const ACROSS: DVec3 = DVec3::new(0.57, 0.71, 0.41);

/// ML with a transfer function without steps, seen by parallel rays along [`ACROSS`], cut by a plane across them.
struct Cut {
    volume: Volume,
    pixels: u32,
}

impl Cut {
    /// The picture with the eye and the plane moved along the rays by these world lengths.
    fn picture(&self, eye_shift: f64, plane_shift: f64, options: &RenderOptions) -> Result<Image, ChartError> {
        let volume = &self.volume;
        let direction = ACROSS.normalize();
        let middle = volume.world(volume.middle());
        let eye = (middle + direction * (eye_shift - 2.0 * volume.radius())).to_array();
        let (target, height) = (middle.to_array(), 1.2 * volume.radius());
        let camera =
            format!(r#""camera": {{"eye": {eye:?}, "target": {target:?}, "up": [0, 0, 1], "height": {height:?}}}"#);
        let (normal, offset) = (direction.to_array(), direction.dot(middle) - 0.25 * volume.radius() + plane_shift);
        let clip = format!(r#""clip": {{"planes": [{{"normal": {normal:?}, "offset": {offset:?}}}]}}"#);
        let tf = transfer_function(
            1.0,
            &[
                (0.0, [0.1, 0.3, 0.9], 0.0),
                (0.4, [0.1, 0.9, 0.3], 0.02),
                (0.7, [1.0, 0.7, 0.2], 0.3),
                (1.0, [1.0; 3], 0.1),
            ],
        );
        let scene = volume.scene(&[&camera, &image_size(self.pixels, self.pixels), &clip, &tf])?;
        Ok(volume.render(&scene, options)?.0)
    }
}

/// The picture at one of the [`OFFSETS`] offsets.
type Moved<'a> = dyn Fn(u32) -> Result<Image, ChartError> + 'a;

fn varying_segments(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let volume = Volume::build(context, "s05", &fixtures::marschner_lobb(40), &build_options(16))?;
    let cut = Cut { volume, pixels: context.pick(40, 20) };
    let default = finest(Backend::Cpu);
    let sampled = |rule, offset: u32| {
        let offset = Offset::Fixed(f64::from(offset + 1) / f64::from(OFFSETS));
        by_samples(Sampling { rule, offset, termination_opacity: NEVER, ..Sampling::default() })
    };
    let series: [(&str, Box<Moved<'_>>); 3] = [
        // The default has no samples to move. Instead, the eye moves along the rays, which changes the rounding.
        ("default", Box::new(|i| cut.picture(f64::from(i) / f64::from(OFFSETS), 0.1, &default))),
        (
            "pre-integration, one sample per voxel",
            Box::new(|i| cut.picture(0.0, 0.1, &sampled(Rule::PreIntegrated, i))),
        ),
        ("midpoint, one sample per voxel", Box::new(|i| cut.picture(0.0, 0.1, &sampled(Rule::Midpoint, i)))),
    ];
    let mut curve = Vec::new();
    for (name, picture) in &series {
        let first = picture(0)?;
        for i in 0..OFFSETS {
            let moved = GREY_LEVELS * distance(&picture(i)?, &first).linf;
            curve.push(CurvePoint::new(name, f64::from(i) / f64::from(OFFSETS), moved, Some(0.0)));
        }
    }
    let greatest = |name: &str| worst(curve.iter().filter(|p| p.series == name).map(|p| p.measured));
    let mut wrong = Vec::new();
    for i in (0..OFFSETS).step_by(context.pick(1, 5)) {
        let plane = 0.1 + f64::from(i) / f64::from(OFFSETS);
        let exact = cut.picture(0.0, plane, &finest(Backend::Reference))?;
        wrong.push(GREY_LEVELS * distance(&cut.picture(0.0, plane, &default)?, &exact).linf);
    }
    let gates = vec![
        Gate::at_most("default, greatest difference between offsets, grey levels", greatest("default"), HALF_A_LEVEL),
        Gate::at_most(
            "default, distance from the reference with the plane anywhere, grey levels",
            worst(wrong),
            HALF_A_LEVEL,
        ),
    ];
    let note = format!(
        "The default cuts cells where the plane cuts them, and gives the rest its own length. Sampling at equal \
         distances depends on where it begins: midpoints move by up to {:.2} grey levels, pre-integration by up to \
         {:.2}, at one sample per voxel.",
        greatest("midpoint, one sample per voxel"),
        greatest("pre-integration, one sample per voxel"),
    );
    Ok(Outcome { curve, gates, note })
}

/// Voxels of S07's body along each axis at spacing (1, 1, 1): also world lengths.
const BODY: f64 = 32.0;

/// The body at spacing `(1 / k, 1 / k, k)` for k = `factor`; voxel centres cover the same domain.
fn body(context: &Context<'_>, factor: f64) -> Result<Volume, ChartError> {
    let spacing = [1.0 / factor, 1.0 / factor, factor];
    let dims = spacing.map(|s| whole::<u64>(BODY / s));
    let origin = spacing.map(|s| 0.5 * s);
    let value = move |v: [u64; 3]| {
        let p = DVec3::from_array(std::array::from_fn(|a| origin[a] + spacing[a] * v[a] as f64));
        p.dot(DVec3::new(0.7, -0.4, 0.9))
    };
    let source = Computed::new(dims, VoxelType::F32, value).with_info(|info| {
        info.geometry.spacing = spacing;
        info.geometry.origin = origin;
    });
    Volume::build(context, &format!("s07 {factor}"), &source, &build_options(16))
}

/// The body's picture, clipped so that no grid extends its outermost values beyond its outermost voxels.
fn body_picture(volume: &Volume, pixels: u32, tf: &str, options: &RenderOptions) -> Result<Image, ChartError> {
    let camera = r#""camera": {"eye": [70, -50, 45], "target": [16, 16, 16], "up": [0, 0, 1], "fov_y": 30}"#;
    let plane = |axis: usize, sign: f64, at: f64| {
        let mut normal = [0.0; 3];
        normal[axis] = sign;
        format!(r#"{{"normal": {normal:?}, "offset": {:?}}}"#, sign * at)
    };
    let planes: Vec<String> = (0..3).flat_map(|a| [plane(a, 1.0, 3.1), plane(a, -1.0, BODY - 3.3)]).collect();
    let clip = format!(r#""clip": {{"planes": [{}]}}"#, planes.join(", "));
    let scene = volume.scene(&[camera, &image_size(pixels, pixels), &clip, tf])?;
    Ok(volume.render(&scene, options)?.0)
}

/// Transfer functions of S07, without and with a step; unit distance 1 in the world.
fn body_functions() -> [String; 2] {
    let (blue, green, gold, red) = ([0.1, 0.3, 0.9], [0.1, 0.9, 0.3], [1.0, 0.7, 0.2], [1.0, 0.2, 0.1]);
    let smooth = [(-10.0, blue, 0.0), (8.0, green, 0.05), (17.3, gold, 0.3), (50.0, [1.0; 3], 0.6)];
    let stepped = [
        (-10.0, blue, 0.0),
        (8.0, green, 0.05),
        (17.3, gold, 0.02),
        (17.3, red, 0.4),
        (19.0, red, 0.01),
        (50.0, [1.0; 3], 0.2),
    ];
    [transfer_function(1.0, &smooth), transfer_function(1.0, &stepped)]
}

fn unequal_spacings(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let pixels = context.pick(128, 40);
    let sampled = |rule| by_samples(Sampling { rule, ..Sampling::default() });
    let [smooth, stepped] = body_functions();
    let series = [
        ("default", &smooth, finest(Backend::Cpu)),
        ("default, transfer function with a step", &stepped, finest(Backend::Cpu)),
        ("midpoint, corrected", &smooth, sampled(Rule::Midpoint)),
        ("midpoint, linear rule", &smooth, sampled(Rule::LinearOpacity)),
    ];
    let mut firsts: Vec<Image> = Vec::new();
    let mut curve = Vec::new();
    for factor in [1.0, 2.0, 4.0] {
        let volume = body(context, factor)?;
        for (line, (name, tf, options)) in series.iter().enumerate() {
            let picture = body_picture(&volume, pixels, tf, options)?;
            if firsts.len() == line {
                firsts.push(picture.clone());
            }
            let moved = GREY_LEVELS * distance(&picture, &firsts[line]).linf;
            curve.push(CurvePoint::new(name, factor * factor, moved, Some(0.0)));
        }
    }
    let greatest = |name: &str| worst(curve.iter().filter(|p| p.series.starts_with(name)).map(|p| p.measured));
    let gates = vec![Gate::at_most(
        "default, greatest difference between spacings, grey levels",
        greatest("default"),
        HALF_A_LEVEL,
    )];
    let note = format!(
        "The transfer function's unit distance is 1 in the world in all three. Sampled once per smallest spacing, \
         the corrected midpoint rule moves by up to {:.1} grey levels, because its step shrinks with the smallest \
         spacing; the linear rule, whose opacity is alpha times the step, by up to {:.1}.",
        greatest("midpoint, corrected"),
        greatest("midpoint, linear rule"),
    );
    Ok(Outcome { curve, gates, note })
}
