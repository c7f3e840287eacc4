//! Warnings about a picture: reasons for an empty picture, and cuts without effect.

use glam::DVec3;
use rayon::prelude::*;
use supervol_format::readable::Number;
use supervol_format::space::HALF_VOXEL;
use supervol_scene::camera::{Camera, Ray};
use supervol_scene::clip::{Clip, IndexRay, ToIndex, clip_parts};
use supervol_scene::facts::{DataKind, VolumeFacts};
use supervol_scene::image::{GREY_LEVELS, Image};
use supervol_scene::scene::{Mode, ResolvedScene};
use supervol_scene::units::Units;

/// Test rays along each edge of the picture for tests whether the camera sees anything.
const PROBES: u32 = 128;
/// Test rays along each edge for tests whether a cut removes anything. This is every ray of most pictures, because a
/// cut may remove little.
const CUT_PROBES: u32 = 1024;
/// Relative difference of length along a ray that is attributed to rounding.
const ROUNDED_SHARE: f64 = 1e-9;

/// Reason why the picture shows only background; `None` if it shows something.
pub fn reason(image: &Image, scene: &ResolvedScene, facts: &VolumeFacts) -> Option<String> {
    let shown = |pixel: &[f32; 4]| {
        let [.., alpha] = pixel.map(f64::from);
        (0..3).any(|c| (f64::from(pixel[c]) - alpha * scene.background[c]).abs() * GREY_LEVELS >= 0.5)
    };
    if image.pixels.iter().any(shown) {
        return None;
    }
    if image.pixels.iter().any(|[.., alpha]| f64::from(*alpha) * GREY_LEVELS >= 0.5) {
        return Some("all that is drawn has the colour of the background; change --background or --colormap".into());
    }
    // Drawing uses scaled units.
    let units = Units::of(facts);
    let placed = &units.facts(facts);
    let (range, data) = (facts.value_range, facts.kind);
    let is_outside = |value: f64| value < placed.value_range.min || value > placed.value_range.max;
    Some(if data == DataKind::Empty {
        "all voxels of the volume are absent".into()
    } else if !meets(scene, &Clip::default(), placed) {
        "the camera does not see the volume; remove `camera` from the scene, or set --camera".into()
    } else if !meets(scene, &scene.clip, placed) {
        let cut_by = if scene.clip.solids.is_empty() { "clip box and planes" } else { "clip box, planes and solids" };
        format!("{cut_by} leave nothing of the volume in the camera's view")
    } else if scene.mode == Mode::Iso && scene.iso.iter().all(|iso| is_outside(iso.value)) {
        let values: Vec<String> = scene.iso.iter().map(|iso| Number(iso.value * units.value).to_string()).collect();
        format!("values range from {range}, and no surface is at {}", values.join(", "))
    } else if scene.mode == Mode::Iso {
        "the camera's view holds no surface of these values".into()
    } else if data == DataKind::Constant && scene.iso.is_empty() {
        format!("every voxel is {}, and the transfer function is transparent there", Number(range.min))
    } else {
        let points = scene.transfer_function.points();
        let ends = [points.first(), points.last()].map(|p| p.map_or(f64::NAN, |p| p.value * units.value));
        let with_surfaces = if scene.iso.is_empty() { "" } else { "the camera's view holds no surface, and " };
        format!(
            "{with_surfaces}the transfer function (from {} to {}) is transparent for all values in the camera's view; the \
             volume's values range from {range}; try --clip-percent 1",
            Number(ends[0]),
            Number(ends[1])
        )
    })
}

/// Names of planes and solids that cut nothing off: a sign of a wrong unit or position.
pub fn idle_cuts(scene: &ResolvedScene, facts: &VolumeFacts) -> Vec<String> {
    let placed = &Units::of(facts).facts(facts);
    let uncut = Clip { planes: Vec::new(), solids: Vec::new(), ..scene.clip.clone() };
    if !meets(scene, &uncut, placed) {
        return Vec::new();
    }
    let Clip { planes, solids, .. } = &scene.clip;
    let plane = |n: usize| Clip { planes: vec![planes[n]], ..uncut.clone() };
    let solid = |n: usize| Clip { solids: vec![solids[n].clone()], ..uncut.clone() };
    let shortens = |cut: &Clip, ray: &Ray, index_ray: &IndexRay| {
        let [all, left] = [&uncut, cut].map(|clip| {
            let parts = clip_parts(ray, index_ray, placed.dims, clip);
            parts.iter().map(|part| part.t1 - part.t0).sum::<f64>()
        });
        left < all * (1.0 - ROUNDED_SHARE)
    };
    // A few rays suffice for nearly every effective cut.
    let is_idle = |cut: &Clip| {
        ![PROBES, CUT_PROBES]
            .iter()
            .any(|probes| any_ray(scene, placed, *probes, |ray, index_ray| shortens(cut, ray, index_ray)))
    };
    let named = |what: &'static str, count: usize, n: usize| match count {
        1 => format!("the {what}"),
        _ => format!("{what} {} of {count}", n + 1),
    };
    let idle_planes = (0..planes.len()).filter(|n| is_idle(&plane(*n))).map(|n| named("clip plane", planes.len(), n));
    // Testing a mesh ray by ray is slow.
    let (low, high) = extent(placed, &uncut);
    let is_idle_solid = |n: &usize| solids[*n].surely_keeps(low, high) || is_idle(&solid(*n));
    let idle_solids = (0..solids.len()).filter(is_idle_solid).map(|n| named("clip solid", solids.len(), n));
    idle_planes.chain(idle_solids).collect()
}

/// World bounding box of the volume inside the clip box.
fn extent(facts: &VolumeFacts, clip: &Clip) -> (DVec3, DVec3) {
    let ends: [[f64; 2]; 3] = std::array::from_fn(|a| {
        let [low, high] = clip.index_box.map_or([f64::NEG_INFINITY, f64::INFINITY], |ends| ends.map(|end| end[a]));
        [low.max(-HALF_VOXEL), high.min(facts.dims.0[a] as f64 - HALF_VOXEL)]
    });
    let (linear, origin) = (facts.geometry.linear(), DVec3::from_array(facts.geometry.origin));
    let corner = |n: usize| origin + linear * DVec3::from_array(std::array::from_fn(|a| ends[a][n >> a & 1]));
    let nothing = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    (0..8).map(corner).fold(nothing, |(low, high), corner| (low.min(corner), high.max(corner)))
}

/// Tests if any test ray meets the volume.
fn meets(scene: &ResolvedScene, clip: &Clip, facts: &VolumeFacts) -> bool {
    any_ray(scene, facts, PROBES, |ray, index_ray| !clip_parts(ray, index_ray, facts.dims, clip).is_empty())
}

/// Tests if `holds` is true for any test ray; `probes` is their number along each edge.
fn any_ray(
    scene: &ResolvedScene,
    facts: &VolumeFacts,
    probes: u32,
    holds: impl Fn(&Ray, &IndexRay) -> bool + Sync,
) -> bool {
    let rays = ToIndex::new(&facts.geometry);
    let step = |pixels: u32| pixels.div_ceil(probes).max(1) as usize;
    let Camera { width, height, .. } = scene.camera;
    (0..height).into_par_iter().step_by(step(height)).any(|y| {
        (0..width).step_by(step(width)).any(|x| {
            let ray = scene.camera.ray(x, y);
            holds(&ray, &rays.ray(&ray))
        })
    })
}
