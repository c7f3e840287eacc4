//! Picking: the point under a pixel, against closed forms and against the picture there.

#![allow(clippy::unwrap_used, reason = "helpers of tests are tests")]

use supervol_format::{Lod, VoxelType};
use supervol_runtime::render::error::RenderError;
use supervol_runtime::render::options::{Backend, LevelChoice, RenderOptions};
use supervol_runtime::render::renderer::{Picked, PickedOn, Renderer};
use supervol_runtime::render::stats::FrameStats;
use supervol_runtime::render::volume::PlacedVolume;

use crate::{containers, support};
use containers::{container_bytes, open};
use support::{Volume, points, scene};

/// A ramp along x: the value is the voxel's index. World x = 10 + 2 i, y = 5 + j, z = k.
fn ramp() -> Volume {
    let ramp = Volume::new([32, 24, 20], VoxelType::F32, |p| p[0]);
    ramp.with_geometry([2.0, 1.0, 1.0], [10.0, 5.0, 0.0], [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
}

/// A view along x, 20 by 20 world lengths on 20 by 20 pixels: pixel (x, y) shows world y = 25.5 - x and z = 19.5 - y.
fn along_x(more: &str) -> String {
    format!(
        r#"{{"camera": {{"eye": [-50, 16, 10], "target": [0, 16, 10], "up": [0, 0, 1], "height": 20}},
            "image": {{"width": 20, "height": 20}}{more}}}"#
    )
}

fn options() -> RenderOptions {
    RenderOptions { backend: Backend::Cpu, threads: Some(2), ..RenderOptions::default() }
}

fn picked(volume: &Volume, json: &str, pixel: [u32; 2], options: RenderOptions) -> Result<Option<Picked>, RenderError> {
    let container = open(&container_bytes(volume, 16));
    let mut renderer = Renderer::new(PlacedVolume::of(container), options).unwrap();
    renderer.set_scene(scene(volume, json));
    renderer.pick(pixel)
}

fn found(volume: &Volume, more: &str, pixel: [u32; 2]) -> Option<Picked> {
    picked(volume, &along_x(more), pixel, options()).unwrap()
}

/// Checks that a point lies at this world x under [`PIXEL`], with all its other fields.
fn assert_at(picked: Option<Picked>, on: PickedOn, x: f64) {
    let picked = picked.expect("something is to be seen");
    assert_eq!((picked.on, picked.level), (on, 0));
    let index = [(x - 10.0) / 2.0, 18.5 - 5.0, 15.5];
    let world = [x, 18.5, 15.5];
    for a in 0..3 {
        assert!((picked.world[a] - world[a]).abs() < 1e-4, "{picked:?}: expected {world:?}");
        assert!((picked.index[a] - index[a]).abs() < 1e-4, "{picked:?}: expected {index:?}");
    }
    assert!((picked.value - index[0].clamp(0.0, 31.0)).abs() < 1e-4, "{picked:?}: expected {}", index[0]);
}

const PIXEL: [u32; 2] = [7, 4];

#[test]
fn in_fog_it_is_where_half_of_the_opacity_is_reached() {
    // Transparent below 8, and an opacity of a tenth per world length from there on: over 2 * (31.5 - 8).
    let tf = |alpha: f64| points(1.0, &[(0.0, [1.0; 3], 0.0), (8.0, [1.0; 3], 0.0), (8.0, [1.0; 3], alpha)]);
    let length = 2.0 * (31.5 - 8.0);
    for alpha in [0.1, 0.01, 0.001] {
        let half = 0.5 * (1.0 - (1.0f64 - alpha).powf(length));
        let depth = (1.0 - half).ln() / (1.0 - alpha).ln();
        let picked = found(&ramp(), &format!(r#", "transfer_function": {}"#, tf(alpha)), PIXEL);
        assert_at(picked, PickedOn::Volume, 26.0 + depth);
    }
    // So thin that nothing is visible; and beside the volume.
    assert_eq!(found(&ramp(), &format!(r#", "transfer_function": {}"#, tf(1e-5)), PIXEL), None);
    let wide =
        along_x(&format!(r#", "transfer_function": {}"#, tf(0.1))).replace("\"height\": 20}", "\"height\": 200}");
    assert_eq!(picked(&ramp(), &wide, [0, 0], options()).unwrap(), None);
}

#[test]
fn it_is_the_first_surface_that_can_be_seen() {
    let iso = r#", "mode": "iso", "iso": [{"value": 12.25, "color": [1, 0, 0]}, {"value": 5, "color": [1, 0, 0], "alpha": 0},
        {"value": 7.5, "color": [0, 1, 0], "alpha": 0.2}]"#;
    assert_at(found(&ramp(), iso, PIXEL), PickedOn::Surface(2), 10.0 + 2.0 * 7.5);
    // With this surface clipped, the next one is the first.
    let clip = r#", "clip": {"solids": [{"keep": "outside", "sphere": {"center": [25, 18, 15], "radius": 3}}]}"#;
    assert_at(found(&ramp(), &format!("{iso}{clip}"), PIXEL), PickedOn::Surface(0), 10.0 + 2.0 * 12.25);
    let none = r#", "mode": "iso", "iso": [{"value": 99, "color": [1, 0, 0]}]"#;
    assert_eq!(found(&ramp(), none, PIXEL), None);
}

#[test]
fn it_is_the_extreme_of_a_projection() {
    // A parabola along x between voxels, greatest at voxel 13, in linear cells.
    let hill = Volume::new([32, 24, 20], VoxelType::F32, |p| 100.0 - (p[0] - 13.0).powi(2));
    let hill = hill.with_geometry([2.0, 1.0, 1.0], [10.0, 5.0, 0.0], [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    let grey = |low: f64, high: f64| points(1.0, &[(low, [0.0; 3], 1.0), (high, [1.0; 3], 1.0)]);
    let more = |mode: &str| format!(r#", "mode": "{mode}", "transfer_function": {}"#, grey(-300.0, 100.0));
    let top = found(&hill, &more("mip"), PIXEL).unwrap();
    assert_eq!(top.on, PickedOn::Extreme);
    assert!((top.value - 100.0).abs() < 1e-4 && (top.world[0] - 36.0).abs() < 1e-3, "{top:?}");
    let bottom = found(&hill, &more("minip"), PIXEL).unwrap();
    assert!(
        (bottom.value - (100.0 - 18.0f64.powi(2))).abs() < 1e-3 && (bottom.index[0] - 31.0).abs() < 1e-3,
        "{bottom:?}"
    );
    let refused = picked(&hill, &along_x(&more("mean")), PIXEL, options());
    assert!(matches!(refused, Err(RenderError::NoPlace)), "{refused:?}");
}

/// The ramp's gradient is half a value per world length, so that the ramp of opacity lets half of the extinction through.
#[test]
fn opacity_by_the_gradient_moves_it() {
    let fog = |opacity_by_gradient: &str| {
        let tf = points(1.0, &[(0.0, [1.0; 3], 0.2)]);
        let clip = r#", "clip": {"box": [[8, -1, -1], [20, 99, 99]]}"#;
        found(&ramp(), &format!(r#", "transfer_function": {tf}{clip}{opacity_by_gradient}"#), PIXEL)
    };
    for (ends, factor) in
        [("", 1.0), (r#", "gradient_opacity": [0, 1]"#, 0.5), (r#", "gradient_opacity": [0.1, 0.4]"#, 1.0)]
    {
        let kappa = -factor * (0.8f64).ln();
        let half = 0.5 * (1.0 - (-kappa * 24.0).exp());
        assert_at(fog(ends), PickedOn::Volume, 26.0 - (1.0 - half).ln() / kappa);
    }
    assert_eq!(fog(r#", "gradient_opacity": [0.5, 1]"#), None);
}

/// Light by the normals of cuts changes colours alone.
#[test]
fn normals_of_cuts_do_not_move_it() {
    let fog = |more: &str| {
        let tf = points(1.0, &[(0.0, [1.0; 3], 0.2)]);
        let clip = r#", "clip": {"box": [[8, -1, -1], [20, 99, 99]]}, "shading": {}"#;
        found(&ramp(), &format!(r#", "transfer_function": {tf}{clip}{more}"#), PIXEL)
    };
    let half = 0.5 * (1.0 - 0.8f64.powi(24));
    for more in ["", r#", "cut_normals": true"#] {
        assert_at(fog(more), PickedOn::Volume, 26.0 + (1.0 - half).ln() / 0.8f64.ln());
    }
}

#[test]
fn it_is_a_slice_where_that_takes_the_opacity_beyond_half() {
    let tf = points(1.0, &[(0.0, [1.0; 3], 0.0), (8.0, [1.0; 3], 0.0), (8.0, [1.0; 3], 0.1)]);
    let colors = r#""colors": [{"value": 0, "color": [0, 0, 0]}, {"value": 31, "color": [1, 1, 1]}]"#;
    let slice = |opacity: f64| {
        format!(
            r#", "transfer_function": {tf}, "slices": [{{"normal": [1, 0, 0], "offset": 20, "opacity": {opacity}, {colors}}}]"#
        )
    };
    assert_at(found(&ramp(), &slice(1.0), PIXEL), PickedOn::Slice(0), 20.0);
    // A semi-transparent slice leaves half of the light to the fog behind it.
    let all = 1.0 - 0.8 * 0.9f64.powf(2.0 * 23.5);
    let depth = ((1.0 - 0.5 * all) / 0.8).ln() / 0.9f64.ln();
    assert_at(found(&ramp(), &slice(0.2), PIXEL), PickedOn::Volume, 26.0 + depth);
    let alone = r#", "mode": "slice""#;
    assert_at(found(&ramp(), &format!("{}{alone}", slice(0.2)), PIXEL), PickedOn::Slice(0), 20.0);
}

#[test]
fn pixels_of_supersampled_pictures_are_those_of_the_picture() {
    let iso = r#", "mode": "iso", "iso": [{"value": 12.25, "color": [1, 0, 0]}], "samples_per_pixel": 16"#;
    assert_at(found(&ramp(), iso, PIXEL), PickedOn::Surface(0), 10.0 + 2.0 * 12.25);
    let beyond = picked(&ramp(), &along_x(iso), [20, 4], options());
    assert!(matches!(beyond, Err(RenderError::NoSuchPixel { pixel: [20, 4], size: [20, 20] })), "{beyond:?}");
}

/// A section across x, as `render --slice` draws it: a slab of the clip box in mode `mean`.
#[test]
fn a_section_seen_face_on_is_picked_exactly() {
    // The field is not linear along x, so a mean over any length differs from the value in the middle.
    let hill = Volume::new([32, 24, 20], VoxelType::F32, |p| 100.0 - (p[0] - 13.0).powi(2) + 2.0 * p[1] + 3.0 * p[2]);
    let hill = hill.with_geometry([2.0, 1.0, 1.0], [10.0, 5.0, 0.0], [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    let grey = points(1.0, &[(-300.0, [0.0; 3], 1.0), (200.0, [1.0; 3], 1.0)]);
    let slab = |from: f64, to: f64, more: &str| {
        let corners = format!("[[{from}, -0.5, -0.5], [{to}, 23.5, 19.5]]");
        format!(r#", "mode": "mean", "transfer_function": {grey}, "clip": {{"box": {corners}{more}}}"#)
    };
    let across = 2.0 * 13.5 + 3.0 * 15.5;
    let check = |picked: Option<Picked>, at: f64, value: f64| {
        let picked = picked.expect("the section is to be seen");
        assert_eq!((picked.on, picked.level), (PickedOn::Slice(0), 0));
        let expected = [[10.0 + 2.0 * at, 18.5, 15.5], [at, 13.5, 15.5]];
        for a in 0..3 {
            assert!((picked.world[a] - expected[0][a]).abs() < 1e-9, "{picked:?}: expected {expected:?}");
            assert!((picked.index[a] - expected[1][a]).abs() < 1e-9, "{picked:?}: expected {expected:?}");
        }
        assert!((picked.value - value).abs() < 1e-4, "{picked:?}: expected {value}");
    };
    // Voxel 9: 100 - 16. Between voxels 9 and 10, the value is linear: 100 - 12.5.
    check(found(&hill, &slab(8.95, 9.05, ""), PIXEL), 9.0, 84.0 + across);
    check(found(&hill, &slab(9.45, 9.55, ""), PIXEL), 9.5, 87.5 + across);
    // The first voxel, cut at the border of the volume, and the mean of a slab from 8 to 10.
    check(found(&hill, &slab(-0.5, 0.5, ""), PIXEL), 0.0, 100.0 - 169.0 + 25.0 / 8.0 + across);
    check(found(&hill, &slab(8.0, 10.0, ""), PIXEL), 9.0, 100.0 - (25.0 / 2.0 + 16.0 + 9.0 / 2.0) / 2.0 + across);
    // A solid that hides the place; and a slab seen at an angle has no place.
    let hidden = r#", "solids": [{"keep": "outside", "sphere": {"center": [28, 18, 15], "radius": 3}}]"#;
    assert_eq!(found(&hill, &slab(8.95, 9.05, hidden), PIXEL), None);
    let askew = along_x(&slab(8.95, 9.05, "")).replace("[-50, 16, 10]", "[-50, 17, 10]");
    let refused = picked(&hill, &askew, PIXEL, options());
    assert!(matches!(refused, Err(RenderError::NoPlace)), "{refused:?}");
}

/// Means of two voxels along x: the ramp of level 1 is the same field, except at its ends.
#[test]
fn the_level_that_is_asked_for_is_the_one_that_is_read() {
    let iso = r#", "mode": "iso", "iso": [{"value": 12.25, "color": [1, 0, 0]}]"#;
    let level = LevelChoice::Fixed(Lod(1));
    let coarse = picked(&ramp(), &along_x(iso), PIXEL, RenderOptions { level, ..options() }).unwrap().unwrap();
    assert_eq!(coarse.level, 1);
    assert!((coarse.world[0] - 34.5).abs() < 1e-4 && (coarse.index[0] - 12.25).abs() < 1e-4, "{coarse:?}");
}

/// Only bricks on the ray are read, and a picture drawn afterwards is the same.
#[test]
fn picking_reads_the_ray_and_changes_no_picture() {
    let volume = ramp();
    let container = open(&container_bytes(&volume, 16));
    let tf = points(1.0, &[(0.0, [1.0; 3], 0.0), (31.0, [1.0; 3], 0.3)]);
    let wanted = scene(&volume, &along_x(&format!(r#", "transfer_function": {tf}"#)));
    let (expected, _) = supervol_runtime::render::renderer::render(&container, &wanted, &options()).unwrap();
    let mut renderer = Renderer::new(PlacedVolume::of(container), options()).unwrap();
    renderer.set_scene(wanted);
    let first = renderer.pick(PIXEL).unwrap();
    assert!(first.is_some());
    let mut stats = FrameStats::default();
    stats.gather_streamer(renderer.streamer().unwrap());
    let read = stats.streaming.page_ins;
    assert!((1..=4).contains(&read), "{read} bricks for a ray along 2");
    assert!(renderer.advance(None).unwrap().is_finished);
    assert_eq!(renderer.picture().unwrap().pixels, expected.pixels);
    assert_eq!(renderer.pick(PIXEL).unwrap(), first);
    assert!(renderer.advance(None).unwrap().is_finished);
    assert_eq!(renderer.picture().unwrap().pixels, expected.pixels);
}
