//! Regimes of values: S23 (narrow windows), S38 (holes), S45 (colour), S46 (run lengths).

use std::collections::BTreeSet;

use glam::DVec3;
use supervol_format::cast::{narrow, single, whole};
use supervol_format::codec::{BrickShape, Codec, CodecChoice, decode_into, encode};
use supervol_format::random::{Random, mix};
use supervol_format::{Lod, ValueRange, VoxelType};
use supervol_runtime::render::accuracy::reference;
use supervol_runtime::render::options::Backend;
use supervol_scene::image::Image;
use supervol_sources::computed::Computed;

use super::regime::{CurvePoint, Gate, Outcome, Regime};
use super::views::{BLUE, GOLD, GREY_LEVEL, HALF_A_LEVEL, SHADED, WHITE, grey_levels, orthographic};
use crate::context::{ChartError, Context};
use crate::fixtures;
use crate::ricker::Ricker;
use crate::volume::{HOST_MEMORY_BYTES, Volume, build_options, image_size, transfer_function};

/// The regimes of this module.
pub const REGIMES: &[Regime] = &[
    Regime {
        id: "S23",
        title: "Narrow windows, and windows beside spikes",
        recipe: "A 16-bit RAMP of one code per voxel, seen through a window 1 % of the range wide, stored with fewer and fewer \
                 bits. Then RICKER with more and more spikes of 1e7, seen through the seismic preset.",
        x_label: "bits stored; for `window`, share of voxels that are spikes",
        y_label: "distinct grey levels in the picture; width of the window, share of that without spikes",
        run: narrow_windows,
    },
    Regime {
        id: "S38",
        title: "Not a number, infinity, no data",
        recipe: "One voxel, dead traces, a slab, a whole brick and half of all voxels absent, as NaN, infinities and a declared \
                 -999.25; held against the reference, and against the whole volume outside of the holes' cells.",
        x_label: "share of voxels that are absent",
        y_label: "greatest difference from the reference, grey levels of 255",
        run: holes,
    },
    Regime {
        id: "S45",
        title: "Colour at an opacity step",
        recipe: "STEP under a transfer function that is clear and blue below 0.5, dense and red above: nothing blue may be \
                 seen, nothing darker than red.",
        x_label: "distance from the edge, voxels",
        y_label: "difference of the colour (divided by opacity) from red, grey levels of 255",
        run: colour_step,
    },
    Regime {
        id: "S46",
        title: "Run lengths",
        recipe: "Bricks whose voxels come in runs of 1, 2^k - 1, 2^k, 2^k + 1, all equal and none equal, across rows, coded as \
                 runs and decoded.",
        x_label: "length of every run, voxels",
        y_label: "coded bytes, share of the raw bytes",
        run: run_lengths,
    },
];

/// First code of S23's ramp. The second constant is the window's offset: windows begin inside the ramp.
const RAMP_CODE: u64 = 32_440;
const WINDOW_VOXEL: u64 = 184;
/// 1 % of 65,536 codes.
const WINDOW_CODES: u64 = 655;

/// The code at x with the lower bits removed.
fn code(x: u64, bits: u32) -> u64 {
    (RAMP_CODE + x) >> (16 - bits) << (16 - bits)
}

fn narrow_windows(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let (mut curve, mut displayed) = (Vec::new(), 0);
    for bits in [8, 10, 12, 14, 16] {
        let volume = ramp_of_bits(context, bits)?;
        let picture = window_picture(&volume)?;
        let levels: BTreeSet<u32> = picture.pixels.iter().map(|p| p[0].to_bits()).collect();
        let codes: BTreeSet<u64> = (0..WINDOW_CODES).map(|x| code(WINDOW_VOXEL + x, bits)).collect();
        let series = if bits == 16 { "default" } else { "fewer bits" };
        curve.push(CurvePoint::new(series, f64::from(bits), levels.len() as f64, Some(codes.len() as f64)));
        if bits == 16 {
            displayed = picture.to_rgb8([0.0; 3]).chunks_exact(3).map(|p| p[0]).collect::<BTreeSet<u8>>().len();
        }
    }
    let (windows, moved) = windows_beside_spikes(context)?;
    curve.extend(windows);
    let gates = vec![
        Gate::at_least(
            "distinct levels of the 8-bit picture of a window of 1 %, 16 bits stored",
            displayed as f64,
            256.0,
        ),
        Gate::at_most("the seismic window's change by 0.1 % of spikes, share", moved, WINDOW_TOLERANCE),
    ];
    let note = "The window of the preset goes by percentiles, which are counted in bins that resolve 1 part in 128. Where \
                spikes are more than the 2 % beyond the percentiles, they are the window; the expected widths are those of \
                exact percentiles."
        .into();
    Ok(Outcome { curve, gates, note })
}

/// Largest shift of a window by 0.1 % of spikes: two bins of the percentile histogram.
const WINDOW_TOLERANCE: f64 = 2.0 / 128.0;

/// One code per voxel of x; two opposite corners span the whole range.
fn ramp_of_bits(context: &Context<'_>, bits: u32) -> Result<Volume, ChartError> {
    let dims = [1024, 3, 3];
    let ramp = Computed::new(dims, VoxelType::U16, move |v| match v {
        [0, 0, 0] => 0.0,
        [1023, 2, 2] => 65_535.0,
        [x, _, _] => code(x, bits) as f64,
    });
    Volume::build(context, &format!("S23 {bits} bits"), &ramp, &build_options(64))
}

/// One pixel per voxel of the window, grey from 0 to 1.
fn window_picture(volume: &Volume) -> Result<Image, ChartError> {
    let middle = [(WINDOW_VOXEL + WINDOW_CODES / 2) as f64, 1.0, 1.0];
    let camera = orthographic(volume, middle, DVec3::Z, [0.0, 1.0, 0.0], 1.0);
    let low = (RAMP_CODE + WINDOW_VOXEL) as f64;
    let tf = transfer_function(1.0, &[(low, [0.0; 3], 1.0), (low + (WINDOW_CODES - 1) as f64, WHITE, 1.0)]);
    let scene = volume.scene(&[&camera, &image_size(narrow::<u32>(WINDOW_CODES), 1), r#""mode": "mip""#, &tf])?;
    volume.finest(&scene, Backend::Cpu)
}

/// Windows of the seismic preset by fraction of spikes, and the shift caused by 0.1 % of spikes.
fn windows_beside_spikes(context: &Context<'_>) -> Result<(Vec<CurvePoint>, f64), ChartError> {
    const GATE_SHARE: f64 = 1e-3;
    let dims = context.pick([96, 96, 128], [48, 48, 64]);
    let (mut curve, mut moved) = (Vec::new(), f64::NAN);
    let mut clean: Option<[f64; 2]> = None;
    for spikes in [0.0, 1e-5, 1e-4, GATE_SHARE, 1e-2, 4e-2] {
        let cube = Ricker { spikes, dead: Some(0.0), ..Ricker::clean(dims) };
        let volume = Volume::build(context, "seismic S23", &cube.source(), &build_options(64))?;
        let scene = volume.scene(&[&image_size(1, 1), r#""transfer_function": "seismic""#])?;
        let points = scene.transfer_function.points();
        let window = points[points.len() - 1].value - points[0].value;
        let values = reference::load_level(&volume.container, Lod(0), &scene, HOST_MEMORY_BYTES)?.values;
        let widths = [window, exact_window(values)];
        let [first, first_exact] = *clean.get_or_insert(widths);
        curve.push(CurvePoint::new("window, default", spikes, window / first, Some(widths[1] / first_exact)));
        if spikes == GATE_SHARE {
            moved = (window / first - 1.0).abs();
        }
    }
    Ok((curve, moved))
}

/// Twice the greater magnitude of the 1st and 99th percentile.
fn exact_window(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let at = |share: f64| values[whole::<usize>((share * (values.len() - 1) as f64).round())];
    2.0 * at(0.01).abs().max(at(0.99).abs())
}

const HOLED_DIMS: [u64; 3] = [40, 37, 34];

/// Predicate of absent voxels.
type Hole = fn([u64; 3]) -> bool;

const HOLES: [(&str, Hole); 5] = [
    ("one voxel", |v| v == [20, 21, 13]),
    ("dead traces", |[x, y, _]| mix(x ^ mix(y ^ 38)).is_multiple_of(23)),
    ("slab", |[_, y, _]| y == 17 || y == 18),
    ("whole brick", |v| v.iter().all(|i| (16..32).contains(i))),
    ("half of all voxels", |[x, y, z]| mix(x ^ mix(y ^ mix(z))).is_multiple_of(2)),
];

/// Stored values of absent voxels; the last is declared as nodata.
const FILLS: [(&str, f64); 4] =
    [("NaN", f64::NAN), ("+infinity", f64::INFINITY), ("-infinity", f64::NEG_INFINITY), ("-999.25", -999.25)];

/// The waves, with holes.
fn holed(is_hole: Hole, fill: f64) -> Computed {
    let value = move |v| if is_hole(v) { fill } else { fixtures::waves_at(fixtures::point(v)) };
    let field = Computed::new(HOLED_DIMS, VoxelType::F32, value);
    if fill.is_finite() { field.with_info(|info| info.nodata = Some(fill)) } else { field }
}

fn holes(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let whole = Volume::build(context, "S38 whole", &holed(|_| false, 0.0), &build_options(16))?;
    let size = context.pick(image_size(80, 74), image_size(40, 37));
    let tf = transfer_function(1.0, &[(0.0, BLUE, 0.02), (0.5, GOLD, 0.1), (1.0, BLUE, 0.3)]);
    // Two rays per voxel along z, across the whole grid: on voxels and between them.
    let facing = orthographic(&whole, whole.middle(), DVec3::Z, [0.0, 1.0, 0.0], HOLED_DIMS[1] as f64);
    let flat = [facing.as_str(), size.as_str(), tf.as_str()];
    let clean = whole.finest(&whole.scene(&flat)?, Backend::Cpu)?;
    let small = context.pick(image_size(32, 24), image_size(16, 12));
    let (mut curve, mut worst, mut not_finite, mut leaked, mut wrong) = (Vec::new(), 0.0f64, 0.0, 0.0, 0.0);
    for (i, (name, is_hole)) in HOLES.into_iter().enumerate() {
        let mut at_worst = 0.0f64;
        for (fill_name, fill) in context.pick(&FILLS[..], &FILLS[i % 4..=i % 4]) {
            let volume =
                Volume::build(context, &format!("S38 {name} {fill_name}"), &holed(is_hole, *fill), &build_options(16))?;
            let scene = volume.scene(&[&volume.outside(), &small, &tf, SHADED])?;
            let picture = volume.finest(&scene, Backend::Cpu)?;
            at_worst = at_worst.max(grey_levels(&picture, &volume.finest(&scene, Backend::Reference)?));
            let scene = volume.scene(&flat)?;
            let through = volume.finest(&scene, Backend::Cpu)?;
            let pixels = [&picture, &through].into_iter().flat_map(|image| image.pixels.iter());
            not_finite += pixels.filter(|p| p.iter().any(|v| !v.is_finite())).count() as f64;
            at_worst = at_worst.max(grey_levels(&through, &volume.finest(&scene, Backend::Reference)?));
            let untouched = |i: usize| {
                !footprint(
                    &scene.camera.ray(narrow::<u32>(i) % clean.width, narrow::<u32>(i) / clean.width).origin,
                    is_hole,
                )
            };
            let changed = (0..clean.pixels.len()).filter(|&i| untouched(i) && through.pixels[i] != clean.pixels[i]);
            leaked += changed.count() as f64;
            wrong += wrong_ranges(&volume, is_hole)?;
        }
        curve.push(CurvePoint::new("default", share_absent(is_hole), at_worst, Some(0.0)));
        worst = worst.max(at_worst);
    }
    curve.sort_by(|a, b| a.x.total_cmp(&b.x));
    let gates = vec![
        Gate::at_most("difference from the reference, grey levels", worst, HALF_A_LEVEL),
        Gate::at_most("pixels that are not finite", not_finite, 0.0),
        Gate::at_most("pixels that change although their ray meets no cell of an absent voxel", leaked, 0.0),
        Gate::at_most("bricks whose range or flag of holes is not that of their present voxels", wrong, 0.0),
    ];
    let names = HOLES.map(|(name, _)| name).join(", ");
    Ok(Outcome { curve, gates, note: format!("Absent: {names}. Shaded and unshaded.") })
}

fn all_voxels() -> impl Iterator<Item = [u64; 3]> {
    let [nx, ny, nz] = HOLED_DIMS;
    (0..nx * ny * nz).map(move |i| [i % nx, i / nx % ny, i / nx / ny])
}

fn share_absent(is_hole: Hole) -> f64 {
    all_voxels().filter(|&v| is_hole(v)).count() as f64 / all_voxels().count() as f64
}

/// Whether a ray along z at this x and y meets a cell with an absent corner, including rays in a face of the cell.
///
/// In such a face the absent voxel has no weight and the exact picture is that of the whole volume: the reference
/// decides.
fn footprint(origin: &DVec3, is_hole: Hole) -> bool {
    let reach = |p: f64, n: u64| (0..n).filter(move |&i| (p.clamp(0.0, (n - 1) as f64) - i as f64).abs() <= 1.0);
    reach(origin.x, HOLED_DIMS[0])
        .any(|x| reach(origin.y, HOLED_DIMS[1]).any(|y| (0..HOLED_DIMS[2]).any(|z| is_hole([x, y, z]))))
}

/// Bricks of level 0 whose entry does not match their voxels and one voxel around them.
fn wrong_ranges(volume: &Volume, is_hole: Hole) -> Result<f64, ChartError> {
    let pyramid = volume.container.pyramid();
    let mut wrong = 0.0;
    for key in pyramid.keys_of(Lod(0)) {
        let entry = volume.container.entry(key)?;
        let core = pyramid.core_box(key);
        let reached = core.grown(1, volume.facts.dims);
        let (mut range, mut has_holes) = (ValueRange::EMPTY, false);
        for v in all_voxels().filter(|&v| reached.contains(v)) {
            if is_hole(v) {
                has_holes = true;
            } else {
                range.include(f64::from(single(fixtures::waves_at(fixtures::point(v)))));
            }
        }
        let absent = all_voxels().filter(|&v| core.contains(v)).all(is_hole);
        let is_right = if absent { entry.absent } else { entry.range == range && entry.has_holes == has_holes };
        wrong += if is_right && entry.absent == absent { 0.0 } else { 1.0 };
    }
    let range = volume.facts.value_range;
    wrong +=
        if range.min.is_finite() && range.max.is_finite() && range.min >= 0.0 && range.max <= 1.0 { 0.0 } else { 1.0 };
    Ok(wrong)
}

fn colour_step(context: &Context<'_>) -> Result<Outcome, ChartError> {
    const EDGE: u64 = 32;
    const PURE_RED: [f64; 3] = [1.0, 0.0, 0.0];
    const PURE_BLUE: [f64; 3] = [0.0, 0.0, 1.0];
    let volume = Volume::build(context, "S45", &fixtures::step(EDGE), &build_options(16))?;
    let clear_to_red = [(0.0, PURE_BLUE, 0.0), (0.5, PURE_BLUE, 0.0), (0.5, PURE_RED, 0.3), (1.0, PURE_RED, 0.3)];
    let tf = transfer_function(1.0, &clear_to_red);
    // A row of rays, from two voxels left of the edge to two voxels right of it.
    let pixels = context.pick(257, 65);
    let height = 4.0 / f64::from(pixels);
    let camera = orthographic(&volume, [15.5, 15.5, 15.5], DVec3::Y, [0.0, 0.0, 1.0], height);
    let scene = volume.scene(&[&camera, &image_size(pixels, 1), &tf])?;
    let row = volume.finest(&scene, Backend::Cpu)?;
    let exact = volume.finest(&scene, Backend::Reference)?;
    let (mut curve, mut bleeding) = (Vec::new(), 0.0f64);
    for (i, pixel) in row.pixels.iter().enumerate() {
        let from_edge = scene.camera.ray(narrow::<u32>(i), 0).origin.x - 15.5;
        let share = (from_edge + 0.5).clamp(0.0, 1.0);
        if pixel[3] > 0.0 {
            let straight = [0, 1, 2].map(|c| f64::from(pixel[c]) / f64::from(pixel[3]));
            let off = (0..3).map(|c| (straight[c] - PURE_RED[c]).abs()).fold(0.0, f64::max) / GREY_LEVEL;
            curve.push(CurvePoint::new("default", from_edge, off, Some(0.0)));
            bleeding = bleeding.max(off);
        }
        if share > 0.0 {
            let series = "colour and opacity of voxels interpolated apart (closed form)";
            curve.push(CurvePoint::new(series, from_edge, (1.0 - share) / GREY_LEVEL, None));
        }
    }
    let wrong_side = wrong_side(&row, &scene.camera);
    let askew = volume.scene(&[&volume.outside(), &context.pick(image_size(64, 48), image_size(24, 18)), &tf])?;
    let oracle = grey_levels(&row, &exact)
        .max(grey_levels(&volume.finest(&askew, Backend::Cpu)?, &volume.finest(&askew, Backend::Reference)?));
    let gates = vec![
        Gate::at_most("colour off red wherever there is opacity, grey levels", bleeding, HALF_A_LEVEL),
        Gate::at_most("pixels with opacity left of the edge, or without it right of it", wrong_side, 0.0),
        Gate::at_most("difference from the reference, grey levels", oracle, HALF_A_LEVEL),
    ];
    let note = "Values are interpolated, then classified: the edge lies where the value is 0.5. The closed form is what \
                interpolating classified voxels without premultiplying gives: blue from clear voxels bleeds into the edge."
        .into();
    Ok(Outcome { curve, gates, note })
}

/// Pixels with the opacity of the wrong side of the edge; the pixel on the edge itself is ignored.
fn wrong_side(row: &Image, camera: &supervol_scene::camera::Camera) -> f64 {
    let pixel = camera.pixel_height();
    let wrong = row.pixels.iter().enumerate().filter(|(i, p)| {
        let from_edge = camera.ray(narrow::<u32>(*i), 0).origin.x - 15.5;
        from_edge.abs() > 0.5 * pixel && (p[3] > 0.0) != (from_edge > 0.0)
    });
    wrong.count() as f64
}

/// Shapes of stored bricks: the smallest possible one, a full brick of the smallest core, a large one.
const SHAPES: [[usize; 3]; 4] = [[5, 5, 5], [5, 7, 20], [20, 20, 20], [68, 68, 20]];

fn run_lengths(_context: &Context<'_>) -> Result<Outcome, ChartError> {
    let mut random = Random::new(46);
    let (mut curve, mut inexact, mut worst, mut worst_full, mut worst_written) =
        (Vec::new(), 0.0, 0.0f64, 0.0f64, 0.0f64);
    let mut worst_name = String::new();
    let runs: Vec<usize> =
        std::iter::once(1).chain((1..=13).flat_map(|k| [(1 << k) - 1, 1 << k, (1 << k) + 1])).collect();
    for voxel_type in [VoxelType::U8, VoxelType::U16, VoxelType::F32, VoxelType::F64] {
        for extent in SHAPES {
            let shape = BrickShape { voxel_type, extent };
            for run in runs.iter().copied().filter(|&run| run <= shape.voxels()).chain([shape.voxels()]) {
                let voxels = in_runs(shape, run, &mut random);
                let share = coded_share(shape, &voxels, CodecChoice::Only(Codec::Rle), &mut inexact)?;
                worst_written = worst_written.max(coded_share(shape, &voxels, CodecChoice::Smallest, &mut inexact)?);
                if share > worst {
                    worst_name = format!("{voxel_type}, stored extent {extent:?}, runs of {run}");
                }
                worst = worst.max(share);
                if extent.iter().all(|&n| n >= 20) {
                    worst_full = worst_full.max(share);
                    if extent == [20; 3] {
                        let expected = (run == 1).then_some(1.0);
                        curve.push(CurvePoint::new(&format!("rle, {voxel_type}"), run as f64, share, expected));
                    }
                }
            }
        }
    }
    let gates = vec![
        Gate::at_most("worst expansion by run lengths of any brick a container can hold, share", worst - 1.0, 0.01),
        Gate::at_most("worst expansion by run lengths of full bricks, share", worst_full - 1.0, 0.01),
        Gate::at_most("worst expansion by the codec that is written by default, share", worst_written - 1.0, 0.01),
        Gate::at_most("bricks that do not come back to the last bit", inexact, 0.0),
    ];
    let note = format!(
        "The worst is {worst_name}. A brick without runs costs one token of at most 5 bytes, which is more than 1 % of the \
         smallest bricks only (one voxel of core and its apron, 125 voxels); the codec chosen by default takes raw there. The \
         curve is of bricks of 20^3 stored voxels."
    );
    Ok(Outcome { curve, gates, note })
}

/// Bytes of a brick with runs of one length; neighbouring runs differ. Runs continue across rows.
fn in_runs(shape: BrickShape, run: usize, random: &mut Random) -> Vec<u8> {
    let size = shape.voxel_type.bytes();
    let mut out = Vec::with_capacity(shape.bytes());
    let mut value = random.next_u64();
    for i in 0..shape.voxels() {
        if i % run == 0 {
            // Different lowest byte, so that the run ends here.
            value = (random.next_u64() & !0xff) | (value & 0xff).wrapping_add(1 + random.below(255)) & 0xff;
        }
        out.extend_from_slice(&value.to_le_bytes()[..size]);
    }
    out
}

/// Coded bytes divided by raw bytes. Counts bricks that differ after decoding.
fn coded_share(shape: BrickShape, voxels: &[u8], choice: CodecChoice, inexact: &mut f64) -> Result<f64, ChartError> {
    let broken = |e| ChartError::Broken(format!("{shape:?}: {e}"));
    let (codec, payload) = encode(choice, shape, voxels).map_err(broken)?;
    let mut back = vec![0; voxels.len()];
    decode_into(codec, shape, &payload, &mut back).map_err(broken)?;
    *inexact += if back == voxels { 0.0 } else { 1.0 };
    Ok(payload.len() as f64 / voxels.len() as f64)
}
