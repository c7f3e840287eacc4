//! Range checks of a scene's numbers that do not depend on the volume. Errors name the key, the expectation and the
//! value found.

use supervol_format::readable::Number;

use super::Scene;
use super::checks::{check, check_color, check_direction, check_factor, check_share};
use super::error::SceneError;
use super::limits::{
    EXAGGERATION_LIMITS, INNER_SURFACE_LIMIT, ISO_LIMIT, LEAST_GRADIENT_RAMP, LIGHT_LIMIT, PLANE_LIMIT, RAY_LIMIT,
    SHADING_LIMIT,
};
use crate::preset;
use crate::slices::SLICE_LIMIT;
use crate::spec::{ClipSpec, ImageSpec, Mode, TransferFunctionSpec};
use crate::units::Units;

impl Scene {
    /// Checks every number whose range does not depend on the volume.
    ///
    /// # Errors
    /// As [`Scene::from_json`].
    pub fn validate(&self) -> Result<(), SceneError> {
        self.validate_image()?;
        let factor = self.vertical_exaggeration.unwrap_or(1.0);
        let [least, most] = EXAGGERATION_LIMITS;
        let expected = || format!("a factor between {least:e} and {most:e}");
        check((least..=most).contains(&factor), "vertical_exaggeration", expected, Number(factor))?;
        if let Some(camera) = &self.camera {
            camera.projection()?;
            camera.camera(&Units::WORLD, [1, 1])?;
        }
        match &self.transfer_function {
            Some(TransferFunctionSpec::Preset(name)) => check(
                preset::NAMES.contains(&name.as_str()),
                "transfer_function",
                || format!("an object, or one of the presets {}", preset::NAMES.join(", ")),
                name,
            )?,
            Some(TransferFunctionSpec::Points(points)) => drop(points.transfer_function(1.0)?),
            None => {}
        }
        self.validate_surfaces()?;
        self.validate_slices()?;
        self.validate_shading()?;
        self.validate_gradient_opacity()?;
        let expected = || "mode `dvr`: in other modes cuts have no lit faces".into();
        self.check_mode_dvr("cut_normals", self.cut_normals, expected)?;
        self.validate_clip()
    }

    fn validate_image(&self) -> Result<(), SceneError> {
        let ImageSpec { width, height, background } = self.image;
        let samples = self.samples_per_pixel.unwrap_or(1);
        check(width >= 1, "image.width", || "at least 1 pixel".into(), width)?;
        check(height >= 1, "image.height", || "at least 1 pixel".into(), height)?;
        let square = samples >= 1 && samples.isqrt().pow(2) == samples;
        check(square, "samples_per_pixel", || "a square number (1, 4, 9, 16, ...)".into(), samples)?;
        let rays = u64::from(width).saturating_mul(u64::from(height)).saturating_mul(u64::from(samples));
        check(rays <= RAY_LIMIT, "image", || format!("at most {RAY_LIMIT} rays in all"), rays)?;
        check_color("image.background", background)
    }

    fn validate_surfaces(&self) -> Result<(), SceneError> {
        match self.effective_mode() {
            Mode::Iso => check(!self.iso.is_empty(), "iso", || "at least one surface in mode `iso`".into(), "none")?,
            Mode::Dvr => {
                let few = self.iso.len() <= INNER_SURFACE_LIMIT;
                check(few, "iso", || format!("at most {INNER_SURFACE_LIMIT} surfaces in mode `dvr`"), self.iso.len())?;
            }
            _ => check(self.iso.is_empty(), "iso", || "no surfaces in this mode".into(), self.iso.len())?,
        }
        check(self.iso.len() <= ISO_LIMIT, "iso", || format!("at most {ISO_LIMIT} surfaces"), self.iso.len())?;
        for (i, iso) in self.iso.iter().enumerate() {
            check(iso.value.is_finite(), &format!("iso[{i}].value"), || "a finite number".into(), Number(iso.value))?;
            check_color(&format!("iso[{i}].color"), iso.color)?;
            check_share(&format!("iso[{i}].alpha"), iso.alpha)?;
        }
        Ok(())
    }

    fn validate_slices(&self) -> Result<(), SceneError> {
        let few = self.slices.len() <= SLICE_LIMIT;
        check(few, "slices", || format!("at most {SLICE_LIMIT} slices"), self.slices.len())?;
        match self.effective_mode() {
            Mode::Slice => check(!self.slices.is_empty(), "slices", || "at least one in mode `slice`".into(), "none")?,
            Mode::Dvr | Mode::Iso => {}
            Mode::Mip | Mode::Minip | Mode::Mean => {
                let expected = || "none in a mode without depth (modes with depth: `dvr`, `iso`, `slice`)".into();
                check(self.slices.is_empty(), "slices", expected, self.slices.len())?;
            }
        }
        self.slices.iter().enumerate().try_for_each(|(i, slice)| slice.validate(&format!("slices[{i}]")))
    }

    fn validate_shading(&self) -> Result<(), SceneError> {
        let Some(Some(shading)) = &self.shading else { return Ok(()) };
        let factors = [("ambient", shading.ambient), ("diffuse", shading.diffuse), ("specular", shading.specular)];
        for (name, factor) in factors {
            check_factor(&format!("shading.{name}"), factor)?;
        }
        let good = shading.shininess > 0.0 && shading.shininess <= SHADING_LIMIT;
        let expected = || format!("a positive number, at most {SHADING_LIMIT:e}");
        check(good, "shading.shininess", expected, Number(shading.shininess))?;
        let lights = shading.lights.as_deref().unwrap_or_default();
        let few = lights.len() <= LIGHT_LIMIT;
        check(few, "shading.lights", || format!("at most {LIGHT_LIMIT} lights"), lights.len())?;
        for (i, light) in lights.iter().enumerate() {
            check_direction(&format!("shading.lights[{i}].direction"), light.direction)?;
            check_factor(&format!("shading.lights[{i}].intensity"), light.intensity)?;
        }
        Ok(())
    }

    fn validate_gradient_opacity(&self) -> Result<(), SceneError> {
        let Some([from, to]) = self.gradient_opacity else { return Ok(()) };
        let good = from >= 0.0 && to.is_finite() && to - from >= LEAST_GRADIENT_RAMP * to && to > from;
        let expected = || {
            format!(
                "two finite numbers, 0 <= G0 < G1 (data units per world unit), at least {LEAST_GRADIENT_RAMP:e} of G1 apart \
                 (for a step, take a narrow ramp)"
            )
        };
        check(good, "gradient_opacity", expected, format!("{} and {}", Number(from), Number(to)))?;
        let expected = || "mode `dvr`: other modes show no extinction".into();
        self.check_mode_dvr("gradient_opacity", true, expected)
    }

    /// Refuses a key, if it is given, in all modes but `dvr`.
    fn check_mode_dvr(&self, key: &str, is_given: bool, expected: impl FnOnce() -> String) -> Result<(), SceneError> {
        let mode = self.effective_mode();
        check(!is_given || mode == Mode::Dvr, key, expected, format!("mode `{mode:?}`").to_lowercase())
    }

    /// Whether a complete scene may have `cut_normals`: mode `dvr`, with a cut, and with light.
    #[must_use]
    pub fn may_light_cuts(&self) -> bool {
        self.effective_mode() == Mode::Dvr && self.check_cuts().is_ok()
    }

    /// Checks that a complete scene with `cut_normals` has a cut, and light for its faces.
    ///
    /// # Errors
    /// If one of them is missing.
    pub fn validate_cuts(&self) -> Result<(), SceneError> {
        if self.cut_normals { self.check_cuts() } else { Ok(()) }
    }

    /// Checks that there is a cut, and light for its faces.
    fn check_cuts(&self) -> Result<(), SceneError> {
        let expected = || "a cut whose faces it lights: `clip` with a box, a plane or a solid".into();
        check(self.clip != ClipSpec::default(), "cut_normals", expected, "no cut")?;
        let expected = || "`shading`, which lights the faces of cuts (`{}` is the default light)".into();
        check(matches!(self.shading, Some(Some(_))), "cut_normals", expected, "no shading")
    }

    fn validate_clip(&self) -> Result<(), SceneError> {
        if let Some([low, high]) = self.clip.index_box {
            let good = (0..3).all(|a| low[a].is_finite() && high[a].is_finite() && low[a] <= high[a]);
            let expected = || "a least and a greatest corner, finite, least first on every axis".into();
            check(good, "clip.box", expected, format!("{low:?} and {high:?}"))?;
        }
        let planes = &self.clip.planes;
        check(planes.len() <= PLANE_LIMIT, "clip.planes", || format!("at most {PLANE_LIMIT} planes"), planes.len())?;
        for (i, plane) in planes.iter().enumerate() {
            check_direction(&format!("clip.planes[{i}].normal"), plane.normal)?;
            let key = format!("clip.planes[{i}].offset");
            check(plane.offset.is_finite(), &key, || "a finite number".into(), Number(plane.offset))?;
        }
        self.clip.validate_solids()
    }
}
