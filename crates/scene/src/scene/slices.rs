//! Slices of a scene: range checks and conversion into the units of a picture.

use supervol_format::readable::Number;

use super::checks::{check, check_color, check_direction, check_share};
use super::error::SceneError;
use crate::slices::filter::FilterSpec;
use crate::slices::{ColorSpec, SliceColors, SlicePlane, SliceSpec};
use crate::transfer_function::{ControlPoint, TransferFunction};
use crate::units::Units;

impl SliceSpec {
    /// The slice in the units of a picture; `labels` are those that occur in the volume.
    pub(super) fn resolve(&self, units: &Units, labels: &[f64]) -> Result<SlicePlane, SceneError> {
        let (normal, offset) = units.plane(self.normal, self.offset);
        let is_of_values = self.filter.is_none_or(|filter| filter.kind.keeps_values());
        let point = |c: &ColorSpec| {
            let value = if is_of_values { units.value(c.value) } else { c.value / units.value };
            ControlPoint { value, color: c.color, alpha: 1.0 }
        };
        let points: Vec<ControlPoint> = self.colors.iter().map(point).collect();
        let colors = if self.labels {
            Some(SliceColors::Labels { unit: units.value, known: labels.to_vec() })
        } else if points.is_empty() {
            None
        } else {
            Some(SliceColors::Values(TransferFunction::new(points, 1.0)?))
        };
        let Self { opacity, interpolation, filter, .. } = *self;
        Ok(SlicePlane { normal, offset, opacity, interpolation, filter, colors })
    }

    /// Checks the numbers; `key` is the path of the slice in the scene, for messages.
    pub(super) fn validate(&self, key: &str) -> Result<(), SceneError> {
        check_direction(&format!("{key}.normal"), self.normal)?;
        check(self.offset.is_finite(), &format!("{key}.offset"), || "a finite number".into(), Number(self.offset))?;
        check_share(&format!("{key}.opacity"), self.opacity)?;
        for (i, color) in self.colors.iter().enumerate() {
            let key = format!("{key}.colors[{i}]");
            check(color.value.is_finite(), &format!("{key}.value"), || "a finite number".into(), Number(color.value))?;
            check_color(&format!("{key}.color"), color.color)?;
        }
        let Some(FilterSpec { kind, size: Some(size) }) = self.filter else { return Ok(()) };
        let key = format!("{key}.filter.size");
        match kind.sizes() {
            Some([least, most]) => {
                check((least..=most).contains(&size), &key, || format!("{least} to {most} texels"), Number(size))
            }
            None => check(false, &key, || "none: this filter has no size".into(), Number(size)),
        }
    }
}
