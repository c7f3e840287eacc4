//! Camera, shading, clipping and transfer function of a scene: range checks that need the volume, and conversion into
//! the units of a picture.

use supervol_format::readable::Number;

use super::checks::check;
use super::error::SceneError;
use super::limits::{DISTANCE_LIMIT, GRADIENT_LIMITS};
use super::resolved::{GradientOpacity, Light, Shading};
use crate::camera::{Camera, Projection, unit_vector};
use crate::clip::{Clip, ClipPlane};
use crate::facts::VolumeFacts;
use crate::preset;
use crate::spec::{CameraSpec, ClipSpec, PointsSpec, ShadingSpec};
use crate::transfer_function::TransferFunction;
use crate::units::Units;

impl CameraSpec {
    pub(super) fn projection(&self) -> Result<Projection, SceneError> {
        for (key, vector) in [("camera.eye", self.eye), ("camera.target", self.target), ("camera.up", self.up)] {
            let finite = vector.iter().all(|v| v.is_finite());
            check(finite, key, || "three finite numbers".into(), format!("{vector:?}"))?;
        }
        match (self.fov_y, self.height) {
            (Some(fov_y), None) => {
                let good = fov_y > 0.0 && fov_y < 180.0;
                check(good, "camera.fov_y", || "degrees between 0 and 180, both excluded".into(), Number(fov_y))?;
                Ok(Projection::Perspective { fov_y })
            }
            (None, Some(height)) => {
                let good = height > 0.0 && height.is_finite();
                check(good, "camera.height", || "a positive finite world length".into(), Number(height))?;
                Ok(Projection::Orthographic { height })
            }
            (found, _) => Err(SceneError::Value {
                key: "camera".into(),
                expected: "exactly one of `fov_y` (perspective) and `height` (orthographic)".into(),
                found: if found.is_some() { "both" } else { "neither" }.into(),
            }),
        }
    }

    /// The camera of a picture of `size` pixels, in units.
    ///
    /// # Errors
    /// If the camera is invalid; see [`CameraError`](crate::camera::CameraError).
    pub fn camera(&self, units: &Units, size: [u32; 2]) -> Result<Camera, SceneError> {
        let [eye, target] = [self.eye, self.target].map(|point| units.point(point.into()));
        let projection = match self.projection()? {
            Projection::Orthographic { height } => Projection::Orthographic { height: height / units.length },
            perspective @ Projection::Perspective { .. } => perspective,
        };
        Ok(Camera::look_at(eye, target, self.up.into(), projection, size)?)
    }

    /// Refuses cameras that are so far from the volume, or show so large or small a region, that `f64` does not resolve
    /// it.
    pub(super) fn check_distance(&self, facts: &VolumeFacts, units: &Units) -> Result<(), SceneError> {
        let [first, .., last] = preset::domain_corners(&units.facts(facts));
        let diagonal = (last - first).length();
        let distance = (units.point(self.eye.into()) - 0.5 * (first + last)).length() / diagonal;
        let expected = || format!("a point at most {DISTANCE_LIMIT:e} diagonals from the volume's middle");
        check(distance <= DISTANCE_LIMIT, "camera.eye", expected, format!("one {distance:e} away"))?;
        let Some(height) = self.height else { return Ok(()) };
        let share = height / units.length / diagonal;
        let expected = || format!("{:e} to {DISTANCE_LIMIT:e} diagonals of the volume", 1.0 / DISTANCE_LIMIT);
        let good = (1.0 / DISTANCE_LIMIT..=DISTANCE_LIMIT).contains(&share);
        check(good, "camera.height", expected, format!("{share:e}"))
    }
}

impl PointsSpec {
    /// The transfer function. `default_unit_distance` is a world length.
    pub(super) fn transfer_function(&self, default_unit_distance: f64) -> Result<TransferFunction, SceneError> {
        Ok(TransferFunction::new(self.control_points(), self.unit_distance.unwrap_or(default_unit_distance))?)
    }
}

impl ShadingSpec {
    /// Shading for this camera. Without lights in the scene, one light shines along the camera's forward axis.
    ///
    /// # Panics
    /// If the direction of a light is zero or not finite; [`Scene::validate`](super::Scene::validate) refuses such
    /// scenes.
    #[must_use]
    pub fn resolve(&self, camera: &Camera) -> Shading {
        let lights = match &self.lights {
            None => vec![Light { to_light: -camera.forward, intensity: 1.0 }],
            Some(lights) => lights
                .iter()
                .map(|l| Light {
                    to_light: -unit_vector(l.direction.into()).expect("validated: not zero, and finite"),
                    intensity: l.intensity,
                })
                .collect(),
        };
        let Self { ambient, diffuse, specular, shininess, .. } = *self;
        Shading { ambient, diffuse, specular, shininess, lights }
    }
}

impl GradientOpacity {
    /// The ramp in the units of a picture; `ends` are data units per world unit.
    pub(super) fn resolve(ends: [f64; 2], units: &Units) -> Result<Self, SceneError> {
        let per_length = units.length / units.value;
        let [least, most] = GRADIENT_LIMITS;
        let [from, to] = ends.map(|end| end * per_length);
        let expected = || {
            let [least, most] = GRADIENT_LIMITS.map(|limit| limit / per_length);
            format!("a second number between {least:e} and {most:e} for this volume")
        };
        check((least..=most).contains(&to), "gradient_opacity", expected, Number(ends[1]))?;
        Ok(Self { from, to })
    }
}

impl ClipSpec {
    /// Clipping in the units of a picture. Reads the files of meshes.
    pub(super) fn resolve(&self, units: &Units) -> Result<Clip, SceneError> {
        let planes = self.planes.iter().map(|p| {
            let (normal, offset) = units.plane(p.normal, p.offset);
            ClipPlane { normal, offset }
        });
        Ok(Clip { index_box: self.index_box, planes: planes.collect(), solids: self.resolve_solids(units)? })
    }
}
