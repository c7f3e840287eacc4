//! The scene file: a description of the wanted picture (RENDERING-MODEL, section 9).
//!
//! The format is JSON. Unknown keys, wrong types and numbers out of range are errors that name the key, the expectation
//! and the value found. Every key is optional: [`Scene::complete`] fills in the rest for a given volume, so that `{}`
//! is the default picture. Features of the model that this version does not draw are refused by name.

mod checks;
mod convert;
mod error;
mod limits;
mod resolved;
pub mod section;
mod slices;
mod solids;
#[cfg(test)]
mod tests;
mod validate;

use std::path::Path;

use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize};

use self::checks::check;
pub use self::error::SceneError;
pub use self::limits::{
    DISTANCE_LIMIT, EDGE_RATIO_LIMIT, EXAGGERATION_LIMITS, GRADIENT_LIMITS, INNER_SURFACE_LIMIT, ISO_LIMIT,
    LEAST_GRADIENT_RAMP, LIGHT_LIMIT, PLANE_LIMIT, RAY_LIMIT, SHADING_LIMIT, UNIT_DISTANCE_LIMITS,
};
pub use self::resolved::{GradientOpacity, Light, ResolvedScene, Shading};
use crate::camera::Camera;
use crate::clip::faces::CutNormals;
use crate::facts::{DataKind, VolumeFacts};
use crate::preset::overview::Overview;
use crate::preset::view::{Framed, View};
use crate::preset::{self, Look, looks};
use crate::slices::{ColorSpec, Interpolation, SliceSpec};
pub use crate::spec::{
    BoxSpec, CameraSpec, ClipSpec, CylinderSpec, ImageSpec, IsoSpec, LightSpec, Mode, PlaneSpec, PointSpec, PointsSpec,
    ShadingSpec, SolidSpec, SphereSpec, TransferFunctionSpec,
};
use crate::transfer_function::TransferFunction;
use crate::units::{Units, edges};

/// A scene: description of a picture. Every key is optional.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Default, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Scene {
    /// Camera; if missing, it frames the visible part of the volume.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera: Option<CameraSpec>,
    /// Size of the picture in pixels, and background.
    pub image: ImageSpec,
    /// Rendering mode; if missing, the mode for the kind of data if `transfer_function` and `iso` are missing too,
    /// `iso` if `iso` has surfaces, else `dvr`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mode: Option<Mode>,
    /// Colours and opacities, or the name of a preset; if missing, the preset for the kind of data.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub transfer_function: Option<TransferFunctionSpec>,
    /// Shading; null: none. If missing: that of the kind of data if `mode` and `transfer_function` are missing too,
    /// default shading if `iso` has surfaces or `cut_normals` is true, else none.
    #[serde(skip_serializing_if = "Option::is_none", deserialize_with = "present")]
    #[schemars(with = "Option<ShadingSpec>")]
    pub shading: Option<Option<ShadingSpec>>,
    /// Mode `dvr`: opacity by the length of the gradient, data units per world unit. From 0 at the first number and below,
    /// extinction rises linearly to its own value at the second number and above. If missing: the whole extinction.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gradient_opacity: Option<[f64; 2]>,
    /// Mode `dvr` with shading: light the faces of cuts (`clip`) by the cut's own normal. Up to two of the smallest spacings
    /// behind a face, along the ray, this light counts alone. From four on, only that by the gradient does.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub cut_normals: bool,
    /// Iso surfaces. Mode `iso` draws only them; mode `dvr` draws them inside the semi-transparent volume.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub iso: Vec<IsoSpec>,
    /// Slices: planes inside the picture in modes `dvr` and `iso`. Mode `slice` draws only them. Default opacities of the
    /// volume are fainter around slices.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub slices: Vec<SliceSpec>,
    /// Clipping: the part of the volume to keep.
    pub clip: ClipSpec,
    /// Factor of heights or depths. All world coordinates of the scene are those of the exaggerated volume.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vertical_exaggeration: Option<f64>,
    /// Rays per pixel on a regular grid: a square number. If missing: chosen for the kind of data if the look is
    /// missing too, else 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub samples_per_pixel: Option<u32>,
}

/// Deserialises a key that is present, so that `null` differs from a missing key.
fn present<'de, D: Deserializer<'de>, T: Deserialize<'de>>(deserializer: D) -> Result<Option<T>, D::Error> {
    T::deserialize(deserializer).map(Some)
}

impl Scene {
    /// Reads and checks a scene.
    ///
    /// # Errors
    /// If the text is not JSON, has unknown keys, wrong types or numbers out of range, or uses a feature that is not
    /// drawn.
    pub fn from_json(text: &str) -> Result<Self, SceneError> {
        let scene: Self = serde_json::from_str(text)?;
        scene.validate()?;
        Ok(scene)
    }

    /// The JSON Schema (draft 2020-12) of scenes: keys, types, meanings and defaults. Ranges of numbers are checked
    /// only by [`Self::validate`].
    #[must_use]
    pub fn schema() -> serde_json::Value {
        schemars::schema_for!(Self).to_value()
    }

    /// The mode of a scene. If it is left out: `iso` with iso surfaces, else `dvr`.
    fn effective_mode(&self) -> Mode {
        self.mode.unwrap_or(if self.iso.is_empty() { Mode::Dvr } else { Mode::Iso })
    }

    /// The scene with all defaults written out for this volume. The result is a scene that gives the same picture.
    ///
    /// With an overview, the camera frames the visible part of the volume, and projections use the range of the
    /// projected values. Without one, the camera frames the whole volume, and projections use percentiles of the
    /// voxels.
    #[must_use]
    pub fn complete(&self, facts: &VolumeFacts, overview: Option<&Overview>) -> Self {
        let mut scene = self.with_look(facts, overview);
        // In a world whose coordinates are too coarse for a camera, the camera stays open. It is computed in units
        // later.
        if scene.camera.is_none() && Units::of(facts).has_world_lengths() {
            scene.camera = Some(scene.default_camera(facts, overview));
        }
        let units = Units::WORLD;
        let camera = scene.camera.as_ref().and_then(|c| c.camera(&units, [scene.image.width, scene.image.height]).ok());
        if let (None, Some(camera)) = (self.samples_per_pixel, camera) {
            let subgrid = scene.subgrid_of_thin(&camera, &scene.framed(facts, overview));
            scene.samples_per_pixel = Some(subgrid * subgrid);
        }
        scene
    }

    /// Rays along one edge of a pixel: those of the scene, or more if the framed region is thinner than a pixel. A single
    /// ray through each pixel would miss it.
    fn subgrid_of_thin(&self, camera: &Camera, framed: &Framed) -> u32 {
        let samples = self.samples_per_pixel.unwrap_or(1);
        let needed = if self.effective_mode() == Mode::Slice { 1 } else { framed.subgrid_of_thin(camera) };
        samples.isqrt().max(limited_samples(&self.image, needed * needed).isqrt())
    }

    /// As [`Self::complete`], without the camera.
    fn with_look(&self, facts: &VolumeFacts, overview: Option<&Overview>) -> Self {
        let mut scene = self.clone();
        let look = Look::of(facts);
        // Only a volume has an opacity by its gradient.
        let suits = self.gradient_opacity.is_none() || (look.mode == Mode::Dvr && look.slices.is_empty());
        let suits = suits && (!self.cut_normals || look.mode == Mode::Dvr);
        let left_open = self.mode.is_none() && self.transfer_function.is_none() && self.iso.is_empty() && suits;
        if left_open {
            scene.mode = Some(look.mode);
            let shading = look.shading.or_else(|| self.cut_normals.then(ShadingSpec::default));
            scene.shading.get_or_insert(shading);
            scene.iso = look.iso;
            if !scene.slices.is_empty() {
                scene.iso.iter_mut().for_each(|iso| iso.alpha = looks::SURFACE_AROUND_SLICES);
            }
            if let Some(overview) = overview.filter(|_| scene.clip.planes.is_empty() && scene.clip.solids.is_empty()) {
                scene.clip.planes = overview.table().to_vec();
            }
            if scene.slices.is_empty() && !look.slices.is_empty() {
                scene.slices = look.slices;
                let points = look.around.clone().unwrap_or_else(|| preset::clear(facts));
                scene.transfer_function = Some(TransferFunctionSpec::Points(points));
            }
        }
        let mode = scene.effective_mode();
        scene.mode = Some(mode);
        let needs_light = mode == Mode::Iso || !scene.iso.is_empty() || scene.cut_normals;
        scene.shading.get_or_insert_with(|| needs_light.then(ShadingSpec::default));
        let samples = if left_open { look.samples_per_pixel } else { 1 };
        scene.samples_per_pixel = Some(self.samples_per_pixel.unwrap_or_else(|| limited_samples(&self.image, samples)));
        scene.transfer_function = scene.transfer_function.take().or_else(|| {
            let points = match mode {
                Mode::Mip | Mode::Minip | Mode::Mean => looks::projection(mode, facts, overview),
                Mode::Dvr if look.mode == Mode::Mip => looks::body(facts),
                _ => look.transfer_function,
            };
            let shows_both = mode == Mode::Dvr && !scene.slices.is_empty();
            let points = match look.around {
                Some(around) if shows_both => around,
                _ if shows_both => looks::around_slices(points, facts),
                _ => points,
            };
            Some(TransferFunctionSpec::Points(points))
        });
        let plain = preset::ramps::plain_slice(facts);
        let colors = || plain.iter().map(|p| ColorSpec { value: p.value, color: p.color }).collect();
        let suits = |slice: &&mut SliceSpec| slice.filter.is_none_or(|filter| filter.kind.keeps_values());
        let is_open = |slice: &&mut SliceSpec| slice.colors.is_empty() && !slice.labels;
        for slice in scene.slices.iter_mut().filter(is_open).filter(suits) {
            // Between labels there is no value.
            if facts.kind == DataKind::Labels && slice.filter.is_none() && slice.interpolation != Interpolation::Cubic {
                (slice.labels, slice.interpolation) = (true, Interpolation::Nearest);
            } else {
                slice.colors = colors();
            }
        }
        scene
    }

    /// The camera of a scene without one.
    fn default_camera(&self, facts: &VolumeFacts, overview: Option<&Overview>) -> CameraSpec {
        let framed = self.framed(facts, overview);
        View::facing(facts, &framed).camera(&framed, [self.image.width, self.image.height])
    }

    /// The region that the camera should frame, inside the clip box: the visible part according to the overview, or
    /// everything if there is no overview.
    #[must_use]
    pub fn framed(&self, facts: &VolumeFacts, overview: Option<&Overview>) -> Framed {
        let whole = preset::domain(facts);
        let kept = self.clip.index_box.map_or(whole, |[low, high]| {
            [std::array::from_fn(|a| low[a].max(whole[0][a])), std::array::from_fn(|a| high[a].min(whole[1][a]))]
        });
        let kept = if (0..3).all(|a| kept[0][a] < kept[1][a]) { kept } else { whole };
        // Slices extend through the whole volume.
        let seen = overview.filter(|_| self.slices.is_empty()).and_then(|overview| match self.effective_mode() {
            Mode::Dvr => {
                let seen = self
                    .classification(facts)
                    .ok()
                    .and_then(|shown| overview.visible(facts, (kept, &self.clip.planes), &shown));
                seen.or_else(|| {
                    self.iso.first().and_then(|iso| overview.beyond(facts, (kept, &self.clip.planes), iso.value))
                })
            }
            Mode::Iso => self.iso.first().and_then(|iso| overview.beyond(facts, (kept, &self.clip.planes), iso.value)),
            _ => None,
        });
        seen.unwrap_or_else(|| Framed::whole(facts, kept))
    }

    fn classification(&self, facts: &VolumeFacts) -> Result<TransferFunction, SceneError> {
        match &self.transfer_function {
            Some(TransferFunctionSpec::Points(spec)) => spec.transfer_function(facts.geometry.smallest_spacing()),
            Some(TransferFunctionSpec::Preset(name)) => Ok(preset::transfer_function(name, facts)?),
            None => Ok(preset::transfer_function(facts.kind.name(), facts)?),
        }
    }

    /// Fills in all defaults for this volume and converts the scene into units.
    ///
    /// # Errors
    /// If the scene is not valid; see [`Scene::validate`].
    pub fn resolve(&self, facts: &VolumeFacts) -> Result<ResolvedScene, SceneError> {
        self.validate()?;
        check_edges(facts)?;
        let scene = self.with_look(facts, None);
        scene.validate()?;
        scene.validate_cuts()?;
        let image_size = [scene.image.width, scene.image.height];
        let units = Units::of(facts);
        let camera = match &scene.camera {
            Some(spec) => {
                spec.check_distance(facts, &units)?;
                spec.camera(&units, image_size)?
            }
            // A camera beside a volume with extreme numbers may not be representable in world coordinates.
            None => scene.default_camera(&units.facts(facts), None).camera(&Units::WORLD, image_size)?,
        };
        let transfer_function = scene.classification(facts)?;
        check_unit_distance(&transfer_function, facts)?;
        let mode = scene.effective_mode();
        let of_surfaces = scene.iso.iter().filter(|_| mode == Mode::Dvr);
        let inner = of_surfaces.filter(|surface| surface.alpha > 0.0).map(|surface| surface.value).collect();
        let subgrid = match self.samples_per_pixel {
            Some(samples) => samples.isqrt(),
            None => scene.subgrid_of_thin(&camera, &scene.framed(&units.facts(facts), None)),
        };
        let clip = scene.clip.resolve(&units)?;
        let cuts = || CutNormals::new(&clip, facts.dims, &units.facts(facts).geometry);
        Ok(ResolvedScene {
            camera: camera.supersampled(subgrid),
            image_size,
            subgrid,
            background: scene.image.background,
            mode,
            transfer_function: transfer_function.with_surfaces(inner).in_units(&units),
            shading: scene.shading.as_ref().and_then(Option::as_ref).map(|s| s.resolve(&camera)),
            gradient_opacity: scene.gradient_opacity.map(|ends| GradientOpacity::resolve(ends, &units)).transpose()?,
            iso: scene.iso.iter().map(|iso| IsoSpec { value: units.value(iso.value), ..*iso }).collect(),
            slices: scene.slices.iter().map(|slice| slice.resolve(&units, &facts.labels)).collect::<Result<_, _>>()?,
            cut_normals: scene.cut_normals.then(cuts),
            clip,
        })
    }

    /// Makes the relative paths in the scene relative to this folder.
    pub fn make_paths_relative_to(&mut self, folder: &Path) {
        for mesh in self.clip.solids.iter_mut().filter_map(|solid| solid.mesh.as_mut()) {
            *mesh = folder.join(&*mesh);
        }
    }

    /// Files that the scene refers to. They are read when the scene is drawn.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        self.clip.solids.iter().filter_map(|solid| solid.mesh.as_deref())
    }
}

/// The samples per pixel, or 1 if the picture would have too many rays.
fn limited_samples(image: &ImageSpec, samples: u32) -> u32 {
    let rays = u64::from(image.width).saturating_mul(u64::from(image.height)).saturating_mul(u64::from(samples));
    if rays <= RAY_LIMIT { samples } else { 1 }
}

/// Refuses volumes whose voxels are too elongated.
fn check_edges(facts: &VolumeFacts) -> Result<(), SceneError> {
    let edges = edges(&facts.geometry);
    let [shortest, longest] = [edges.into_iter().fold(f64::INFINITY, f64::min), edges.into_iter().fold(0.0, f64::max)];
    let expected = || format!("voxels at most {EDGE_RATIO_LIMIT:e} times as long as wide");
    check(longest <= EDGE_RATIO_LIMIT * shortest, "(the volume's spacing)", expected, format!("edges of {edges:?}"))
}

fn check_unit_distance(function: &TransferFunction, facts: &VolumeFacts) -> Result<(), SceneError> {
    let shortest = edges(&facts.geometry).into_iter().fold(f64::INFINITY, f64::min);
    let [low, high] = UNIT_DISTANCE_LIMITS.map(|limit| limit * shortest);
    let (key, found) = ("transfer_function.unit_distance", function.unit_distance());
    let expected = || format!("a world length between {low:e} and {high:e} for this volume");
    check((low..=high).contains(&found), key, expected, format!("{found:e}"))
}
