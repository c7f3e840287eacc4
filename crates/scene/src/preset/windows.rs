//! Windows for reading slices: names, level and width, and gamma.
//!
//! A window is the range of data values that the colours span. Its level is the middle, its width the length, as
//! radiologists give them. The named windows are in Hounsfield units.

use super::ramps;
use crate::facts::{DataKind, VolumeFacts, is_hounsfield};
use crate::transfer_function::ControlPoint;

/// Least and greatest gamma.
pub const GAMMAS: [f64; 2] = [0.1, 10.0];
/// Number of straight pieces that stand for the curve of a gamma. The difference is below half a grey level of 255.
const GAMMA_PIECES: u32 = 512;

/// Named window of tomography.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NamedWindow {
    /// Bone.
    Bone,
    /// Lung.
    Lung,
    /// Soft tissue of the trunk.
    SoftTissue,
    /// Brain.
    Brain,
}

impl NamedWindow {
    /// All named windows with their names.
    pub const NAMES: [(&str, Self); 4] =
        [("bone", Self::Bone), ("lung", Self::Lung), ("soft-tissue", Self::SoftTissue), ("brain", Self::Brain)];

    /// Level and width in Hounsfield units.
    #[must_use]
    pub fn level_and_width(self) -> [f64; 2] {
        match self {
            Self::Bone => [400.0, 1800.0],
            Self::Lung => [-600.0, 1500.0],
            Self::SoftTissue => [50.0, 400.0],
            Self::Brain => [40.0, 80.0],
        }
    }

    /// Least and greatest value of the window, in data units; `None` if the values are no Hounsfield units.
    #[must_use]
    pub fn range(self, facts: &VolumeFacts) -> Option<[f64; 2]> {
        let offset = match facts.kind {
            DataKind::Ct => 0.0,
            DataKind::CtOffset => ramps::HOUNSFIELD_OFFSET,
            _ if is_hounsfield(facts.central_range) => 0.0,
            _ => return None,
        };
        let [level, width] = self.level_and_width();
        Some(window_of([level + offset, width]))
    }
}

/// The window [low, high] with this level and width.
#[must_use]
pub fn window_of([level, width]: [f64; 2]) -> [f64; 2] {
    [level - 0.5 * width, level + 0.5 * width]
}

/// Level and width of the window [low, high].
#[must_use]
pub fn level_and_width([low, high]: [f64; 2]) -> [f64; 2] {
    [0.5 * low + 0.5 * high, high - low]
}

/// The window after a drag by these shares of the picture's width to the right and of its height up. To the right widens
/// the window; up lowers its level, which makes the picture brighter.
#[must_use]
pub fn dragged(window: [f64; 2], [right, up]: [f64; 2]) -> [f64; 2] {
    /// Power of e of the width's factor, for a drag over the whole picture; and widths by which it moves the level.
    const WIDTH: f64 = 3.0;
    const LEVEL: f64 = 1.5;
    let [level, width] = level_and_width(window);
    window_of([level - LEVEL * up * width, width * (WIDTH * right).exp()])
}

/// The colours of these points over the places 0 to 1 of their window, bent by a gamma: the colour at place x is the one
/// that was at x^gamma. So 1 changes nothing, and a smaller gamma brightens a grey ramp.
#[must_use]
pub fn bent(points: &[ControlPoint], gamma: f64) -> Vec<(f64, [f64; 3])> {
    let (Some(first), Some(last)) = (points.first(), points.last()) else { return Vec::new() };
    let width = last.value - first.value;
    let place = |value: f64| if width > 0.0 { (value - first.value) / width } else { 0.5 };
    let colors: Vec<(f64, [f64; 3])> = points.iter().map(|p| (place(p.value), p.color)).collect();
    // Equal steps of x^gamma give small steps of x where the curve is steep.
    let curve = (0..=GAMMA_PIECES).map(|n| f64::from(n) / f64::from(GAMMA_PIECES));
    let mut places: Vec<f64> = curve.chain(colors.iter().map(|(at, _)| *at)).collect();
    places.sort_by(f64::total_cmp);
    places.dedup();
    places.into_iter().map(|at| (at.powf(gamma.recip()), ramps::color_at(&colors, at))).collect()
}

/// Change of a transfer function's window and colours; `None` keeps each.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Paint<'a> {
    /// Least and greatest value.
    pub window: Option<[f64; 2]>,
    /// Colours at places from 0 to 1 of the window.
    pub colors: Option<&'a [(f64, [f64; 3])]>,
    /// Gamma, within [`GAMMAS`]; it is applied to the new colours.
    pub gamma: Option<f64>,
}

impl Paint<'_> {
    /// The points with this change.
    #[must_use]
    pub fn applied(&self, points: &[ControlPoint]) -> Vec<ControlPoint> {
        let painted = match (self.window, self.colors) {
            (None, None) => points.to_vec(),
            (window, colors) => ramps::repainted(points, window, colors),
        };
        match self.gamma.filter(|gamma| *gamma != 1.0) {
            Some(gamma) => ramps::repainted(&painted, None, Some(&bent(&painted, gamma))),
            None => painted,
        }
    }
}

#[cfg(test)]
mod tests {
    use supervol_format::{Dims, Geometry, ValueRange};

    use super::*;

    #[test]
    fn named_windows_are_in_hounsfield_units() {
        let facts = |kind, min, max| VolumeFacts {
            kind,
            ..VolumeFacts::plain(Dims([8; 3]), Geometry::IDENTITY, ValueRange { min, max })
        };
        assert_eq!(NamedWindow::Brain.range(&facts(DataKind::Ct, -1000.0, 2000.0)), Some([0.0, 80.0]));
        assert_eq!(NamedWindow::Bone.range(&facts(DataKind::CtOffset, 0.0, 4095.0)), Some([524.0, 2324.0]));
        assert_eq!(NamedWindow::Lung.range(&facts(DataKind::Generic, -1000.0, 2000.0)), Some([-1350.0, 150.0]));
        assert_eq!(NamedWindow::SoftTissue.range(&facts(DataKind::Mri, 0.0, 900.0)), None);
        assert_eq!(level_and_width(window_of([50.0, 400.0])), [50.0, 400.0]);
        let [wider, brighter] = [[0.1, 0.0], [0.0, 0.1]].map(|drag| level_and_width(dragged([-150.0, 250.0], drag)));
        assert!(wider[0] == 50.0 && wider[1] > 450.0, "{wider:?}");
        assert!(brighter[0] < 0.0 && (brighter[1] - 400.0).abs() < 1e-9, "{brighter:?}");
    }

    #[test]
    fn a_gamma_bends_a_grey_ramp_to_a_power() {
        let grey = [0.0, 1.0].map(|x| ControlPoint { value: 100.0 + 50.0 * x, color: [x; 3], alpha: 1.0 });
        for gamma in [0.1, 0.5, 1.0, 2.2, 10.0] {
            let points = ramps::repainted(&grey, None, Some(&bent(&grey, gamma)));
            let function = crate::transfer_function::TransferFunction::new(points, 1.0).unwrap();
            // At the very beginning the curve is steeper than numbers resolve.
            for n in 1..=1000 {
                let x = f64::from(n) / 1000.0;
                let [found, ..] = function.classify(100.0 + 50.0 * x).0;
                assert!((found - x.powf(gamma)).abs() < 0.5 / 255.0, "gamma {gamma}, {x}: {found}");
            }
        }
        // Bends of the colours stay where the curve puts them.
        let bend = [(0.0, 0.0), (0.25, 1.0), (1.0, 1.0)].map(|(value, grey)| ControlPoint {
            value,
            color: [grey; 3],
            alpha: 1.0,
        });
        let at = bent(&bend, 0.5);
        assert!(at.contains(&(0.0625, [1.0; 3])), "{at:?}");
    }
}
