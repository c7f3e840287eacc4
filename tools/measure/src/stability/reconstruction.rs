//! Reconstruction of values and gradients between voxels (S10, S11, S12): errors of filters and gradient operators.
//!
//! ML and plane waves are known everywhere, so errors are measured between the voxels. Filters and operators are the
//! ray caster's own functions.

use std::f64::consts::TAU;

use glam::DVec3;
use supervol_format::cast::{single, whole};
use supervol_format::random::Random;
use supervol_runtime::engines::cells::cell::trilinear;
use supervol_runtime::render::options::Backend;

use super::parallel::{GREY_LEVELS, HALF_A_LEVEL, NEVER, by_samples, worst};
use super::regime::{CurvePoint, Gate, Outcome, Regime};
use crate::comparison::gradient::gradient_at_voxel;
use crate::comparison::reconstruction::{bspline_coefficients, bspline_weights, catmull_rom_weights, tricubic};
use crate::comparison::{GradientOperator, Reconstruction, Sampling};
use crate::context::{ChartError, Context};
use crate::fixtures;
use crate::measure::distance;
use crate::volume::{Volume, build_options, image_size, transfer_function};

/// The regimes of this file.
pub const REGIMES: &[Regime] = &[
    Regime {
        id: "S10",
        title: "Reconstruction filter",
        recipe: "ML sampled on 40^3, 64^3 and 128^3 voxels, reconstructed at random points of [-0.85, 0.85]^3 and \
                 compared with the signal itself; peak 1.",
        x_label: "voxels along each axis",
        y_label: "peak signal-to-noise ratio, dB",
        run: filters,
    },
    Regime {
        id: "S11",
        title: "8-bit fractions of hardware filtering",
        recipe: "ML 40^3 with the fractions of trilinear interpolation rounded to 1/256, as texture units do, under \
                 ever narrower hats; against the same samples with exact fractions.",
        x_label: "width of the hat, share of the value range",
        y_label: "greatest difference, grey levels of 255",
        run: byte_fractions,
    },
    Regime {
        id: "S12",
        title: "Isotropy of gradients",
        recipe: "Plane waves of 0.1, 0.2 and 0.3 cycles per voxel in 4,000 random directions; the greatest angle \
                 between the gradient by an operator and the wave's direction.",
        x_label: "frequency, cycles per voxel",
        y_label: "greatest angle, degrees",
        run: isotropy,
    },
];

/// Half edge of the box of random points, signal coordinates: three voxels of 40^3 from the border.
const HALF_EDGE: f64 = 0.85;
/// Seed of all random numbers in this file.
const SEED: u64 = 10;
/// Grid edge, and dB of nearest, trilinear, Catmull-Rom and prefiltered cubic B-spline, computed independently.
const KNOWN_DB: [(usize, [f64; 4]); 3] =
    [(40, [26.0, 29.3, 32.0, 35.6]), (64, [30.0, 36.5, 45.4, 58.3]), (128, [36.0, 48.1, 66.7, 86.7])];
/// Filters in that order, with half a unit of the last digit of their known values.
const FILTERS: [(&str, f64); 4] =
    [("nearest", 0.5), ("trilinear", 0.05), ("Catmull-Rom", 0.05), ("cubic B-spline, prefiltered", 0.05)];
/// Greatest error of byte fractions on 40^3, fraction of the range, computed independently.
const KNOWN_BYTE_ERROR: f64 = 5.2e-4;

/// ML on a grid: voxels and B-spline coefficients.
struct Grid {
    edge: usize,
    voxels: Vec<f64>,
    coefficients: Vec<f64>,
}

impl Grid {
    fn new(edge: usize) -> Self {
        let scale = 2.0 / (edge as f64 - 1.0);
        let at = |i: usize| {
            let index = [i % edge, i / edge % edge, i / edge / edge].map(|v| v as f64);
            fixtures::marschner_lobb_at(DVec3::from_array(index) * scale - DVec3::ONE)
        };
        let voxels: Vec<f64> = (0..edge * edge * edge).map(at).collect();
        let mut coefficients = voxels.clone();
        bspline_coefficients([edge; 3], &mut coefficients);
        Self { edge, voxels, coefficients }
    }

    /// Voxel before a point of signal coordinates, and fractions between it and the next voxels.
    fn place(&self, p: DVec3) -> ([usize; 3], [f64; 3]) {
        let index = (p + DVec3::ONE) * (0.5 * (self.edge as f64 - 1.0));
        let cell = index.floor();
        (cell.to_array().map(whole::<usize>), (index - cell).to_array())
    }

    fn read(&self, values: &[f64], [x, y, z]: [usize; 3]) -> f64 {
        values[x + self.edge * (y + self.edge * z)]
    }

    fn corners(&self, cell: [usize; 3]) -> [f32; 8] {
        std::array::from_fn(|c| {
            let offset = [c & 1, c >> 1 & 1, c >> 2];
            single(self.read(&self.voxels, std::array::from_fn(|a| cell[a] + offset[a])))
        })
    }

    fn cubic(&self, values: &[f64], cell: [usize; 3], weights: [[f64; 4]; 3]) -> f64 {
        let around = std::array::from_fn(|i| {
            let offset = [i & 3, i >> 2 & 3, i >> 4];
            // The points are so far inside that this index is never below 0.
            self.read(values, std::array::from_fn(|a| cell[a] + offset[a] - 1))
        });
        tricubic(&around, weights)
    }

    /// The value at a point by each of [`FILTERS`].
    fn reconstructed(&self, p: DVec3) -> [f64; 4] {
        let (cell, u) = self.place(p);
        let nearest = std::array::from_fn(|a| cell[a] + usize::from(u[a] >= 0.5));
        [
            self.read(&self.voxels, nearest),
            trilinear(&self.corners(cell), u),
            self.cubic(&self.voxels, cell, u.map(catmull_rom_weights)),
            self.cubic(&self.coefficients, cell, u.map(bspline_weights)),
        ]
    }
}

fn random_point(random: &mut Random) -> DVec3 {
    DVec3::from_array(std::array::from_fn(|_| HALF_EDGE * (2.0 * random.unit() - 1.0)))
}

fn filters(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let points = context.pick(200_000, 40_000);
    let mut curve = Vec::new();
    let mut beyond = [0.0f64; 4];
    for (edge, known) in KNOWN_DB {
        (context.say)(&format!("S10: {edge}^3 voxels"));
        let grid = Grid::new(edge);
        let mut random = Random::new(SEED);
        let mut squares = [0.0; 4];
        for _ in 0..points {
            let p = random_point(&mut random);
            let signal = fixtures::marschner_lobb_at(p);
            let found = grid.reconstructed(p);
            (0..4).for_each(|f| squares[f] += (found[f] - signal).powi(2));
        }
        for (f, (name, rounding)) in FILTERS.iter().enumerate() {
            let db = -10.0 * (squares[f] / f64::from(points)).log10();
            curve.push(CurvePoint::new(name, edge as f64, db, Some(known[f])));
            beyond[f] = beyond[f].max((db - known[f]).abs() - rounding);
        }
    }
    let gate = |(f, (name, _)): (usize, &(&str, f64))| {
        Gate::at_most(format!("{name}, distance from the known figure beyond its rounding, dB"), beyond[f], 0.2)
    };
    let gates = FILTERS.iter().enumerate().map(gate).collect();
    let note = "The default is trilinear: that is what the model says the field is. The cubic filters are methods of \
                comparison. The figures for nearest are known to whole dB, the others to tenths.";
    Ok(Outcome { curve, gates, note: note.into() })
}

/// Widths of the hats of S11, fractions of the value range.
const HATS: [f64; 6] = [0.1, 0.03, 0.01, 0.004, 0.002, 0.001];

fn byte_fractions(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let volume = Volume::build(context, "s11", &fixtures::marschner_lobb(40), &build_options(16))?;
    let pixels = context.pick(48, 16);
    let exact_fractions = Sampling {
        step_voxels: context.pick(1.0 / 256.0, 1.0 / 64.0),
        termination_opacity: NEVER,
        ..Sampling::default()
    };
    let byte = Sampling { reconstruction: Reconstruction::TrilinearByteFractions, ..exact_fractions };
    let (mut curve, mut from_reference) = (Vec::new(), Vec::new());
    for width in HATS {
        (context.say)(&format!("S11: hat of width {width}"));
        let (blue, gold) = ([0.2, 0.4, 0.9], [1.0, 0.8, 0.3]);
        let [low, top, high] = [-0.5, 0.0, 0.5].map(|side| volume.value(0.5 + side * width));
        let points = [(low, blue, 0.0), (top, gold, 0.6), (high, blue, 0.0)];
        let tf = transfer_function(1.0, &points);
        let scene = volume.scene(&[&volume.outside(), &image_size(pixels, pixels), &tf])?;
        let [plain, rounded] = [exact_fractions, byte].map(|sampling| volume.render(&scene, &by_samples(sampling)));
        let moved = GREY_LEVELS * distance(&rounded?.0, &plain?.0).linf;
        curve.push(CurvePoint::new("fractions of 8 bit", width, moved, None));
        let exact = volume.finest(&scene, Backend::Reference)?;
        let default = GREY_LEVELS * distance(&volume.finest(&scene, Backend::Cpu)?, &exact).linf;
        curve.push(CurvePoint::new("default, from the reference", width, default, Some(0.0)));
        from_reference.push(default);
    }
    let (error, points) = greatest_byte_error(context.pick(200_000, 40_000));
    let gates = vec![Gate::at_most(
        "default, distance from the reference under every hat, grey levels",
        worst(from_reference),
        HALF_A_LEVEL,
    )];
    let byte_line: Vec<(f64, f64)> =
        curve.iter().filter(|p| p.series == "fractions of 8 bit").map(|p| (p.x, p.measured)).collect();
    let visible = byte_line
        .iter()
        .find(|p| p.1 > HALF_A_LEVEL)
        .map_or("none of these hats".into(), |p| format!("hats {} of the range wide and narrower", p.0));
    let moved: Vec<String> = byte_line.iter().map(|(width, moved)| format!("{moved:.2} under {width}")).collect();
    let note = format!(
        "Values move by at most {error:.2e} of the range at {points} random points ({KNOWN_BYTE_ERROR:.1e} was \
         known; the greatest of more points is greater). The default never rounds fractions, whatever the transfer \
         function. With rounded ones the picture moves visibly, by more than half a grey level, under {visible} \
         (0.002 was supposed): {} grey levels.",
        moved.join(", "),
    );
    Ok(Outcome { curve, gates, note })
}

/// Greatest value error from rounding the fractions on 40^3, fraction of ML's range (1); number of tested points.
fn greatest_byte_error(points: u32) -> (f64, u32) {
    let grid = Grid::new(40);
    let mut random = Random::new(SEED);
    let difference = |p: DVec3| {
        let (cell, u) = grid.place(p);
        let corners = grid.corners(cell);
        trilinear(&corners, u) - trilinear(&corners, u.map(|f| (f * 256.0).round() / 256.0))
    };
    (worst((0..points).map(|_| difference(random_point(&mut random)))), points)
}

/// Number of directions of S12.
const DIRECTIONS: u32 = 4_000;
/// Cycles per voxel, and errors in degrees of central differences and of Sobel's operator, computed independently, to
/// 0.1.
const KNOWN_ANGLES: [(f64, f64, f64); 3] = [(0.1, 1.1, 0.5), (0.2, 4.7, 2.2), (0.3, 12.5, 5.4)];
/// Half a unit of the last digit of these values, degrees.
const ANGLE_ROUNDING: f64 = 0.05;

fn isotropy(_context: &Context<'_>) -> Result<Outcome, ChartError> {
    let mut curve = Vec::new();
    let mut beyond: [f64; 2] = [0.0; 2];
    for (frequency, central, sobel) in KNOWN_ANGLES {
        let at_voxel = |operator| {
            move |direction: DVec3| {
                let wave = |o: [i32; 3]| (TAU * frequency * direction.dot(DVec3::from_array(o.map(f64::from)))).sin();
                DVec3::from_array(gradient_at_voxel(operator, wave))
            }
        };
        let angles = [
            greatest_angle(at_voxel(GradientOperator::Central)),
            greatest_angle(at_voxel(GradientOperator::Sobel)),
            greatest_angle(|direction| in_cell_middle(TAU * frequency * direction)),
        ];
        curve.push(CurvePoint::new("central", frequency, angles[0], Some(central)));
        curve.push(CurvePoint::new("Sobel", frequency, angles[1], Some(sobel)));
        curve.push(CurvePoint::new("intermediate, in the middle of a cell", frequency, angles[2], None));
        for (share, (angle, known)) in beyond.iter_mut().zip([(angles[0], central), (angles[1], sobel)]) {
            *share = share.max(((angle - known).abs() - ANGLE_ROUNDING) / known);
        }
    }
    let gates = vec![
        Gate::at_most("central, share by which an angle misses the known figure beyond its rounding", beyond[0], 0.05),
        Gate::at_most("Sobel, share by which an angle misses the known figure beyond its rounding", beyond[1], 0.05),
    ];
    let note = "The default is central differences at the voxels, interpolated, as the model says. Sobel's operator \
                halves the angle and reads 26 voxels instead of 6. The figures are known to tenths of a degree.";
    Ok(Outcome { curve, gates, note: note.into() })
}

/// Greatest angle between wave directions and measured gradients, degrees.
fn greatest_angle(gradient: impl Fn(DVec3) -> DVec3) -> f64 {
    let mut random = Random::new(SEED);
    let angle = |direction: DVec3| {
        let found = gradient(direction).normalize();
        found.cross(direction).length().atan2(found.dot(direction)).to_degrees()
    };
    worst((0..DIRECTIONS).map(|_| angle(DVec3::from_array(random.direction()))))
}

/// Half-voxel differences of the trilinear field at the centre of a cell, for a wave `sin(k . x)` with phase 0 there.
/// Both taps lie at face centres.
fn in_cell_middle(k: DVec3) -> DVec3 {
    let mut gradient = DVec3::ZERO;
    for corner in 0..8 {
        let offset = DVec3::from_array([corner & 1, corner >> 1 & 1, corner >> 2].map(f64::from)) - 0.5;
        // The centre of a face is the mean of its four corners; the taps are one voxel apart.
        gradient += 0.25 * k.dot(offset).sin() * offset.signum();
    }
    gradient
}
