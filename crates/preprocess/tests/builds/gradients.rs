//! Lengths of the gradient: those of a ramp on a stretched grid, and of the neighbours of a hole.

use supervol_format::canceller::Canceller;
use supervol_format::container::manifest::Source;
use supervol_format::{BrickLayout, Container, VoxelType};
use supervol_preprocess::gradients::{self, Gradients};
use supervol_preprocess::{BuildOptions, build};
use supervol_sources::computed::Computed;

const DIMS: [u64; 3] = [30, 21, 18];
const SLOPES: [f64; 3] = [2.0, 3.0, -4.0];
const SPACING: [f64; 3] = [1.0, 2.0, 5.0];

fn ramp(hole: Option<[u64; 3]>) -> Gradients {
    let value = move |p: [u64; 3]| {
        if Some(p) == hole { f64::NAN } else { (0..3).map(|a| SLOPES[a] * p[a] as f64).sum() }
    };
    counted(value, SPACING, |container| Gradients::of(container, &|_, _| ()).unwrap_or_else(|e| panic!("{e}")))
}

/// Result of a function for the container of a field.
fn counted<T>(
    value: impl Fn([u64; 3]) -> f64 + Send + Sync + 'static,
    spacing: [f64; 3],
    find: impl FnOnce(&Container) -> T,
) -> T {
    let source = Computed::new(DIMS, VoxelType::F32, value).with_info(|info| info.geometry.spacing = spacing);
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("v.svol");
    let options = BuildOptions { layout: BrickLayout::new(16).expect("a core"), threads: 2, ..BuildOptions::default() };
    build(&source, Source::computed("ramp"), &path, &options, &|_| ()).unwrap_or_else(|e| panic!("{e}"));
    let container = Container::open(&path).unwrap_or_else(|e| panic!("{e}"));
    find(&container)
}

/// Length of the gradient if these shares of the slopes remain: half of them at the ends of an axis.
fn length(shares: [f64; 3]) -> f64 {
    (0..3).map(|a| (shares[a] * SLOPES[a] / SPACING[a]).powi(2)).sum::<f64>().sqrt()
}

#[test]
fn a_ramp_has_one_length_but_for_its_ends() {
    let found = ramp(None);
    let [all, inside] = [DIMS, DIMS.map(|n| n - 2)].map(|dims| dims.iter().product::<u64>());
    assert_eq!((found.known, found.unknown), (all, 0));
    assert!((found.greatest - length([1.0; 3])).abs() < 1e-6, "{}", found.greatest);
    let resolved = found.greatest / 4096.0;
    assert!((found.percentile(50.0) - length([1.0; 3])).abs() <= resolved, "{}", found.percentile(50.0));
    let least = length([0.5; 3]);
    assert!((found.percentile(0.0) - least).abs() <= resolved, "{} instead of {least}", found.percentile(0.0));
    // At all ends the gradient is at least 3 % shorter.
    assert!(length([1.0, 1.0, 0.5]) < 0.97 * length([1.0; 3]));
    let (counts, beyond) = found.counts(10, 0.99 * length([1.0; 3]));
    assert_eq!((counts.iter().sum::<u64>(), beyond), (all - inside, inside));
    assert!((found.histogram_end() - found.greatest).abs() <= resolved);
    // Lengths that are all alike show as much as they are long.
    let [from, to] = found.usual_ramp().expect("gradients");
    assert!(from == 0.0 && (to - found.greatest).abs() <= resolved, "{from}, {to}");
}

#[test]
fn beside_a_hole_there_is_none() {
    let (whole, holed) = (ramp(None), ramp(Some([15, 10, 9])));
    assert_eq!((holed.known, holed.unknown), (whole.known - 7, 6));
}

/// `max(0, x - 10)^2`: 0 up to x = 9, then 0.5, 2, 4, ..., 36 and, at the end, 18.5. The tenth and the nineteenth of these
/// twenty columns are 18 and 34.
#[test]
fn the_usual_ramp_goes_by_the_lengths_above_zero() {
    let square = |[x, ..]: [u64; 3]| (x.max(10) - 10).pow(2) as f64;
    let found = counted(square, [1.0; 3], |container| Gradients::of(container, &|_, _| ()).expect("bricks"));
    assert_eq!((found.known, found.flat), (30 * 21 * 18, 10 * 21 * 18));
    let [from, to] = found.usual_ramp().expect("gradients");
    assert!((from - 18.0).abs() < 0.02 && (to - 34.0).abs() < 0.02, "{from}, {to}");
    let even = counted(|_| 5.0, [1.0; 3], |container| Gradients::of(container, &|_, _| ()).expect("bricks"));
    assert_eq!((even.flat, even.usual_ramp(), even.histogram_end()), (even.known, None, 0.0));
}

#[test]
fn a_count_stops_on_request_and_tells_its_unit() {
    let bricks = 2 * 2 * 2;
    let found = counted(
        |_| 5.0,
        [1.0; 3],
        |container| {
            let (canceller, last) = (Canceller::default(), std::cell::Cell::new(0));
            let tell = |done: u64, total: u64| {
                assert_eq!(total, bricks);
                last.set(done);
                if done == 3 {
                    canceller.cancel();
                }
            };
            let counted = Gradients::unless_cancelled(container, &canceller, &tell).expect("bricks");
            let mut manifest = container.manifest().clone();
            let plain = gradients::unit(&manifest);
            manifest.unit = "HU".into();
            manifest.axes.iter_mut().for_each(|axis| axis.unit = "mm".into());
            let known = gradients::unit(&manifest);
            manifest.axes[2].unit = "ms".into();
            (counted.is_none(), last.get(), [plain, known, gradients::unit(&manifest)])
        },
    );
    let units = ["data unit per world unit", "HU per mm", "HU per world unit"].map(String::from);
    assert_eq!(found, (true, 3, units));
}
