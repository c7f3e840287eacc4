//! Orders of convergence: how fast the error of each integration rule falls with the number of samples.
//!
//! Each field, transfer function and rule gives one [`OrderRow`]: error over samples per voxel, and the fitted order
//! (the slope on logarithmic axes). Two measurements:
//! - `rays`: the rules of other ray casters, in `f64`, on single rays through the Marschner-Lobb signal;
//! - `pictures`: the default integration, in pictures of the same signal, against the reference integrator.
//!
//! The table of known orders was computed independently on 24 random rays. Its rays, transfer functions and norm were
//! not recorded. Here the error is that of the worst channel of the worst of 24 rays, at 2.75, 5.5, ... 88 samples per
//! voxel: this norm reproduces the known numbers of samples best.
//!
//! The order depends on the set of 24 rays, most strongly where a rule jumps over a step of the transfer function. So
//! several sets are drawn; a row holds their mean order and its standard deviation. Known orders that are not
//! reproduced are in [`OTHER_ORDERS`].

mod pictures;
mod rays;

use serde::Serialize;
use supervol_scene::transfer_function::{ControlPoint, TransferFunction, TransferFunctionError};

use crate::context::{ChartError, Context};
use crate::measure::{INVISIBLE, order_of};

/// Largest allowed difference between a measured order and the known one.
pub const ORDER_TOLERANCE: f64 = 0.15;

/// One curve of error over samples.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OrderRow {
    /// `analytic` or `trilinear 40^3`.
    pub field: &'static str,
    /// `smooth`, `hat of width 0.1` or `step`.
    pub transfer_function: &'static str,
    /// Integration rule of an interval.
    pub rule: &'static str,
    /// Observed order: the negative slope of the curve on logarithmic axes.
    pub order: f64,
    /// Standard deviation of the order between sets of 24 rays; 0 if there is only one set.
    pub order_spread: f64,
    /// Order known from an independent computation; null if there is none.
    pub expected_order: Option<f64>,
    /// Samples per voxel from which on the error stays below half a grey level; null if more than tried.
    pub samples_per_voxel_needed: Option<f64>,
    /// Known value of `samples_per_voxel_needed`; null if it is above 88 or unknown.
    pub expected_samples: Option<f64>,
    /// Samples per voxel, and error as a fraction of full scale.
    pub curve: Vec<(f64, f64)>,
}

/// Names of one curve's field, transfer function and rule.
#[derive(Debug, Clone, Copy)]
struct Case {
    field: &'static str,
    transfer_function: &'static str,
    rule: &'static str,
}

impl OrderRow {
    /// The row of a curve.
    fn new(case: Case, curve: Vec<(f64, f64)>, order_spread: f64, expected: Option<Known>) -> Result<Self, ChartError> {
        let Case { field, transfer_function, rule } = case;
        let no_order = || ChartError::Broken(format!("no order of {rule} on {field}, {transfer_function}: {curve:?}"));
        let order = order_of(&curve).ok_or_else(no_order)?;
        let first_good = curve.iter().rposition(|p| p.1 >= INVISIBLE).map_or(0, |last_bad| last_bad + 1);
        let samples_per_voxel_needed = curve.get(first_good).map(|p| p.0);
        Ok(Self {
            field,
            transfer_function,
            rule,
            order,
            order_spread,
            expected_order: expected.map(|known| known.0),
            samples_per_voxel_needed,
            expected_samples: expected.and_then(|known| known.1),
            curve,
        })
    }
}

/// All rows, single rays first.
///
/// # Errors
/// If a picture cannot be made.
pub fn table(context: &Context<'_>) -> Result<Vec<OrderRow>, ChartError> {
    let mut rows = rays::rows(context)?;
    rows.extend(pictures::rows(context)?);
    Ok(rows)
}

/// Names of the transfer functions, in the order of the table.
pub(crate) const FUNCTIONS: [&str; 3] = ["smooth", "hat of width 0.1", "step"];

/// A transfer function of [`FUNCTIONS`]; its unit distance is a world length.
///
/// The smooth function is one linear piece, without a bend inside the signal's range.
fn function(name: &str, unit_distance: f64) -> Result<TransferFunction, TransferFunctionError> {
    let points: &[(f64, f64)] = match name {
        "smooth" => &[(0.0, 0.0), (1.0, 0.3)],
        "step" => &[(0.0, 0.0), (0.5, 0.0), (0.5, 0.1), (1.0, 0.1)],
        _ => &[(0.0, 0.0), (0.45, 0.0), (0.5, 0.6), (0.55, 0.0), (1.0, 0.0)],
    };
    let point = |&(value, alpha): &(f64, f64)| ControlPoint { value, color: [value, 1.0 - value, 0.5], alpha };
    TransferFunction::new(points.iter().map(point).collect(), unit_distance)
}

/// A known order, and the needed samples per voxel if known.
type Known = (f64, Option<f64>);

/// Known orders and samples per voxel needed (`None`: more than 88), by field, transfer function, and rule: left
/// Riemann, midpoint, pre-integration with attenuation, and without.
const KNOWN: [[[Known; 4]; 3]; 2] = [
    [
        [(1.00, Some(22.0)), (2.00, Some(2.7)), (2.00, Some(5.5)), (1.04, Some(44.0))],
        [(1.01, Some(11.0)), (2.03, Some(5.5)), (2.01, Some(5.5)), (1.00, None)],
        [(0.78, Some(88.0)), (1.05, Some(22.0)), (1.77, Some(5.5)), (1.00, Some(44.0))],
    ],
    [
        [(1.00, Some(22.0)), (1.84, Some(2.7)), (2.02, Some(5.5)), (1.03, Some(44.0))],
        [(1.11, Some(22.0)), (1.58, Some(5.5)), (2.05, Some(11.0)), (1.00, None)],
        [(0.85, Some(22.0)), (0.81, Some(22.0)), (2.20, Some(22.0)), (1.02, Some(44.0))],
    ],
];

/// Known orders that this measurement does not reproduce within [`ORDER_TOLERANCE`]: field, transfer function, rule.
///
/// Measured orders with their spread between sets, and known orders:
///
/// | field | transfer function | rule | found | known |
/// |---|---|---|---|---|
/// | analytic | hat | left | 1.45 +- 0.41 | 1.01 |
/// | analytic | step | left | 1.07 +- 0.14 | 0.78 |
/// | analytic | step | pre-integration | 1.95 +- 0.10 | 1.77 |
/// | trilinear | hat | left | 1.29 +- 0.32 | 1.11 |
/// | trilinear | hat | midpoint | 1.99 +- 0.12 | 1.58 |
/// | trilinear | step | left | 1.02 +- 0.26 | 0.85 |
/// | trilinear | step | midpoint | 1.03 +- 0.24 | 0.81 |
/// | trilinear | step | pre-integration | 1.94 +- 0.49 | 2.20 |
///
/// The known orders come from one set of rays. All but the hat's midpoint rule lie within about twice the spread, so
/// another set explains them. The theoretical order is 1 for the left rule and for midpoints over a step, otherwise 2.
pub const OTHER_ORDERS: &[[&str; 3]] = &[
    ["analytic", "hat of width 0.1", "left Riemann"],
    ["analytic", "step", "left Riemann"],
    ["analytic", "step", "pre-integration with attenuation"],
    ["trilinear 40^3", "hat of width 0.1", "left Riemann"],
    ["trilinear 40^3", "hat of width 0.1", "midpoint"],
    ["trilinear 40^3", "step", "left Riemann"],
    ["trilinear 40^3", "step", "midpoint"],
    ["trilinear 40^3", "step", "pre-integration with attenuation"],
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::context::Scale;

    fn rows() -> Vec<OrderRow> {
        let folder = tempfile::tempdir().unwrap();
        let say = |_: &str| ();
        let context = Context { scale: Scale::Small, folder: folder.path(), say: &say };
        let rows = table(&context).unwrap();
        for row in &rows {
            println!(
                "{}, {}, {}: order {:.2} +- {:.2} (known {:?}), samples {:?} (known {:?})",
                row.field,
                row.transfer_function,
                row.rule,
                row.order,
                row.order_spread,
                row.expected_order,
                row.samples_per_voxel_needed,
                row.expected_samples
            );
            println!("    {:?}", row.curve);
        }
        rows
    }

    #[test]
    fn orders_are_the_known_ones() {
        let rows = rows();
        assert_eq!(rows.len(), 24 + 3);
        let mut wrong = Vec::new();
        for row in &rows {
            let name = [row.field, row.transfer_function, row.rule];
            let is_near = row.expected_order.is_none_or(|known| (row.order - known).abs() <= ORDER_TOLERANCE);
            if is_near == OTHER_ORDERS.contains(&name) {
                wrong.push(format!("{name:?}: {:.2} +- {:.2}", row.order, row.order_spread));
            }
        }
        assert!(wrong.is_empty(), "{wrong:#?}");
        let least = |rule: &str, function: &str, least: f64| {
            let mut meant = rows.iter().filter(|r| r.rule == rule && r.transfer_function == function).peekable();
            assert!(meant.peek().is_some(), "no rows of {rule}, {function}");
            meant.for_each(|r| assert!(r.order >= least, "{rule}, {function}, {}: order {}", r.field, r.order));
        };
        for rule in [rays::RULES[2], pictures::RULE] {
            least(rule, "smooth", 1.8);
            least(rule, "hat of width 0.1", 1.8);
            least(rule, "step", 1.7);
        }
    }
}
