//! Why a picture shows nothing.

use supervol_format::readable::Number;
use supervol_runtime::clip::{Clip, ToIndex, clip_parts};
use supervol_runtime::facts::{DataKind, VolumeFacts};
use supervol_runtime::image::{GREY_LEVELS, Image};
use supervol_runtime::scene::{Mode, ResolvedScene};
use supervol_runtime::units::Units;

/// Rays along each edge of the picture that are tried, to see whether the camera meets anything.
const PROBES: u32 = 128;

/// Why nothing but the background is to be seen; `None` where something is.
pub fn reason(image: &Image, scene: &ResolvedScene, facts: &VolumeFacts) -> Option<String> {
    let shown = |pixel: &[f32; 4]| {
        let [.., alpha] = pixel.map(f64::from);
        (0..3).any(|c| (f64::from(pixel[c]) - alpha * scene.background[c]).abs() * GREY_LEVELS >= 0.5)
    };
    if image.pixels.iter().any(shown) {
        return None;
    }
    // What is drawn is in units of its own.
    let units = Units::of(facts);
    let placed = &units.facts(facts);
    let (range, data) = (facts.value_range, facts.kind);
    let is_outside = |value: f64| value < placed.value_range.min || value > placed.value_range.max;
    Some(if data == DataKind::Empty {
        "no voxel of the volume is present".into()
    } else if !meets(scene, &Clip::default(), placed) {
        "the camera does not see the volume; leave the scene's `camera` out, or choose a direction with --camera".into()
    } else if !meets(scene, &scene.clip, placed) {
        let cut_by = if scene.clip.solids.is_empty() { "clip box and planes" } else { "clip box, planes and solids" };
        format!("{cut_by} leave nothing of the volume where the camera looks")
    } else if scene.mode == Mode::Iso && scene.iso.iter().all(|iso| is_outside(iso.value)) {
        let values: Vec<String> = scene.iso.iter().map(|iso| Number(iso.value * units.value).to_string()).collect();
        format!("values run from {range}, and no surface is at {}", values.join(", "))
    } else if scene.mode == Mode::Iso {
        "no surface of these values lies where the camera looks".into()
    } else if data == DataKind::Constant {
        format!("every voxel is {}, and the transfer function shows nothing there", Number(range.min))
    } else {
        let points = scene.transfer_function.points();
        let ends = [points.first(), points.last()].map(|p| p.map_or(f64::NAN, |p| p.value * units.value));
        format!(
            "the transfer function, from {} to {}, shows nothing where the camera looks of values that run from {range}; try \
             --clip-percent 1",
            Number(ends[0]),
            Number(ends[1])
        )
    })
}

/// Whether any of the rays that are tried has something of the volume on it.
fn meets(scene: &ResolvedScene, clip: &Clip, facts: &VolumeFacts) -> bool {
    let camera = &scene.camera;
    let rays = ToIndex::new(&facts.geometry);
    let along = |pixels: u32| (0..pixels).step_by(pixels.div_ceil(PROBES).max(1) as usize);
    along(camera.height).any(|y| {
        along(camera.width).any(|x| {
            let ray = camera.ray(x, y);
            !clip_parts(&ray, &rays.ray(&ray), facts.dims, clip).is_empty()
        })
    })
}
