//! The scene file: a description of the wanted picture (RENDERING-MODEL, section 9).
//!
//! The format is JSON. Unknown keys, wrong types and numbers out of range are errors that name the key, the expectation
//! and the value found. Every key is optional: [`Scene::complete`] fills in the rest for a given volume, so that `{}`
//! is the default picture. Features of the model that this version does not draw are refused by name.

use glam::DVec3;
use schemars::JsonSchema;
use serde::de::value::MapAccessDeserializer;
use serde::de::{MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use supervol_format::readable::Number;

use crate::camera::{Camera, CameraError, Projection, unit_vector};
use crate::clip::mesh_file::MeshFileError;
use crate::clip::{Clip, ClipPlane};
use crate::facts::VolumeFacts;
use crate::preset::overview::Overview;
use crate::preset::view::{Framed, View};
use crate::preset::{self, Look, looks};
use crate::slices::{ColorSpec, SlicePlane, SliceSpec};
use crate::transfer_function::{ControlPoint, TransferFunction, TransferFunctionError};
use crate::units::{Units, edges};
pub use solids::{BoxSpec, CylinderSpec, SolidSpec, SphereSpec};
use validate::check;

/// Most rays of one picture: width times height times samples per pixel.
pub const RAY_LIMIT: u64 = 64 << 20;
/// Most iso surfaces of one scene; a ray keeps one bit for each.
pub const ISO_LIMIT: usize = 32;
/// Most surfaces inside the volume, in mode `dvr`.
pub const INNER_SURFACE_LIMIT: usize = 8;
/// Most lights of one scene.
pub const LIGHT_LIMIT: usize = 16;
/// Most clip planes of one scene.
pub const PLANE_LIMIT: usize = 64;
/// Greatest coefficient of shading, intensity of a light and exponent of highlights: beyond, `f32` overflows.
pub const SHADING_LIMIT: f64 = 1e6;
/// Greatest distance of the eye from the volume's middle, and greatest height of an orthographic picture, in diagonals
/// of the volume. The least height is the inverse. Farther away, `f64` does not resolve voxels.
pub const DISTANCE_LIMIT: f64 = 1e9;
/// Least and greatest unit distance, in shortest edges of a voxel: beyond, extinction overflows.
pub const UNIT_DISTANCE_LIMITS: [f64; 2] = [1e-12, 1e24];
/// Least and greatest factor of vertical exaggeration.
pub const EXAGGERATION_LIMITS: [f64; 2] = [1e-6, 1e6];
/// Greatest ratio of the longest to the shortest edge of a voxel.
pub const EDGE_RATIO_LIMIT: f64 = 1e6;

/// Reason why a text is no scene, or why a scene cannot be drawn.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum SceneError {
    #[error("the scene is not valid: {0}")]
    Json(#[from] serde_json::Error),
    #[error("scene key `{key}`: expected {expected}, found {found}")]
    Value { key: String, expected: String, found: String },
    #[error("scene key `camera`: {0}")]
    Camera(#[from] CameraError),
    #[error("scene key `transfer_function`: {0}")]
    TransferFunction(#[from] TransferFunctionError),
    #[error("scene key `{key}`: {reason}")]
    Mesh { key: String, reason: Box<MeshFileError> },
}

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
    /// default shading if `iso` has surfaces, else none.
    #[serde(skip_serializing_if = "Option::is_none", deserialize_with = "said")]
    #[schemars(with = "Option<ShadingSpec>")]
    pub shading: Option<Option<ShadingSpec>>,
    /// Iso surfaces. Mode `iso` draws only them; mode `dvr` draws them inside the semi-transparent volume.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub iso: Vec<IsoSpec>,
    /// Slices: planes inside the picture in modes `dvr` and `iso`. Mode `slice` draws only them.
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
fn said<'de, D: Deserializer<'de>, T: Deserialize<'de>>(deserializer: D) -> Result<Option<T>, D::Error> {
    T::deserialize(deserializer).map(Some)
}

/// Camera with exactly one of `fov_y` and `height`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CameraSpec {
    /// World position of the camera.
    pub eye: [f64; 3],
    /// World position in the middle of the picture.
    pub target: [f64; 3],
    /// World direction that points up in the picture.
    pub up: [f64; 3],
    /// Perspective: vertical angle of view, degrees, between 0 and 180.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fov_y: Option<f64>,
    /// Orthographic: world height of the picture.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height: Option<f64>,
}

/// Size of the picture, and background.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ImageSpec {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// Colour behind the volume, each channel in [0, 1].
    pub background: [f64; 3],
}

impl Default for ImageSpec {
    fn default() -> Self {
        Self { width: 800, height: 600, background: [0.0; 3] }
    }
}

/// Rendering mode: quantity that a ray computes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Default, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Mode {
    /// Direct volume rendering: emission and absorption.
    #[default]
    Dvr,
    /// Maximum value along the ray.
    Mip,
    /// Minimum value along the ray.
    Minip,
    /// Mean value over the present length of the ray.
    Mean,
    /// Iso surfaces: crossings of the values in `iso`.
    Iso,
    /// Slices only.
    Slice,
}

/// Transfer function: name of a preset, or control points.
#[derive(Debug, Clone, PartialEq, JsonSchema)]
#[schemars(untagged)]
pub enum TransferFunctionSpec {
    /// Name of a preset, for example `ct` or `seismic`.
    Preset(String),
    /// Control points.
    Points(PointsSpec),
}

/// Transfer function given by control points.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PointsSpec {
    /// World length over which `alpha` holds; if missing, the smallest spacing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit_distance: Option<f64>,
    /// Control points in ascending order of value; two at one value make a step.
    pub points: Vec<PointSpec>,
}

/// Control point of a transfer function.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PointSpec {
    /// Data value.
    pub value: f64,
    /// Colour, each channel in [0, 1].
    pub color: [f64; 3],
    /// Opacity over the unit distance, in [0, 1].
    pub alpha: f64,
}

impl Serialize for TransferFunctionSpec {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Preset(name) => serializer.serialize_str(name),
            Self::Points(points) => points.serialize(serializer),
        }
    }
}

// A derived untagged enum would report every mistake inside the object as "did not match any variant". This visitor
// keeps the message and the position of the mistake.
impl<'de> Deserialize<'de> for TransferFunctionSpec {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct SpecVisitor;
        impl<'de> Visitor<'de> for SpecVisitor {
            type Value = TransferFunctionSpec;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("the name of a preset, or an object with `points`")
            }

            fn visit_str<E: serde::de::Error>(self, name: &str) -> Result<Self::Value, E> {
                Ok(TransferFunctionSpec::Preset(name.to_owned()))
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Self::Value, A::Error> {
                PointsSpec::deserialize(MapAccessDeserializer::new(map)).map(TransferFunctionSpec::Points)
            }
        }
        deserializer.deserialize_any(SpecVisitor)
    }
}

/// Two-sided Blinn-Phong shading (RENDERING-MODEL, section 5).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ShadingSpec {
    /// Ambient coefficient ka.
    pub ambient: f64,
    /// Diffuse coefficient kd.
    pub diffuse: f64,
    /// Specular coefficient ks.
    pub specular: f64,
    /// Exponent of the specular highlight.
    pub shininess: f64,
    /// Directional lights; if missing, one along the camera's view direction.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lights: Option<Vec<LightSpec>>,
}

impl Default for ShadingSpec {
    fn default() -> Self {
        Self { ambient: 0.3, diffuse: 0.7, specular: 0.2, shininess: 32.0, lights: None }
    }
}

/// Directional light.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LightSpec {
    /// World direction in which the light travels.
    pub direction: [f64; 3],
    /// Factor of the diffuse and specular light.
    #[serde(default = "one")]
    pub intensity: f64,
}

/// Iso surface.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct IsoSpec {
    /// Data value of the surface.
    pub value: f64,
    /// Colour, each channel in [0, 1].
    pub color: [f64; 3],
    /// Opacity in [0, 1].
    #[serde(default = "one")]
    pub alpha: f64,
}

fn one() -> f64 {
    1.0
}

/// Clipping: the picture shows the part of the volume that box, planes and solids all keep.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Default, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ClipSpec {
    /// Least and greatest corner in voxels of level 0; faces of voxels are at halves.
    #[serde(rename = "box", skip_serializing_if = "Option::is_none")]
    pub index_box: Option<[[f64; 3]; 2]>,
    /// Half-spaces to keep.
    pub planes: Vec<PlaneSpec>,
    /// Solids, each of which keeps its inside or its outside.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub solids: Vec<SolidSpec>,
}

/// Clip plane: keeps the points p with normal . p >= offset.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlaneSpec {
    /// World direction of any length.
    pub normal: [f64; 3],
    /// World length times the normal's length.
    pub offset: f64,
}

/// A scene with all defaults filled in for one volume. Lengths and values are in the units of the picture ([`Units`]).
#[derive(Debug, Clone, PartialEq)]
pub struct ResolvedScene {
    /// The camera, with one pixel per ray: `subgrid` times the picture's pixels along each axis.
    pub camera: Camera,
    /// Pixels of the finished picture along x and y.
    pub image_size: [u32; 2],
    /// Rays along one edge of a pixel: the square root of the samples per pixel.
    pub subgrid: u32,
    /// Colour behind the volume, each channel in [0, 1].
    pub background: [f64; 3],
    /// Quantity that a ray computes.
    pub mode: Mode,
    /// Transfer function.
    pub transfer_function: TransferFunction,
    /// Shading, if any.
    pub shading: Option<Shading>,
    /// Iso surfaces: at least one in mode `iso`, optional in `dvr`, none in other modes.
    pub iso: Vec<IsoSpec>,
    /// Slices: at least one in mode `slice`, none in `mip`, `minip` and `mean`.
    pub slices: Vec<SlicePlane>,
    /// Clipping.
    pub clip: Clip,
}

impl ResolvedScene {
    /// Pixels of the finished picture.
    #[must_use]
    pub fn pixels(&self) -> u64 {
        self.image_size.map(u64::from).iter().product()
    }

    /// Rays of the picture, all rays of a pixel's sub-grid included.
    #[must_use]
    pub fn rays(&self) -> u64 {
        u64::from(self.camera.width) * u64::from(self.camera.height)
    }

    /// Whether the scene has iso surfaces inside the semi-transparent volume.
    #[must_use]
    pub fn has_inner_surfaces(&self) -> bool {
        self.mode == Mode::Dvr && !self.iso.is_empty()
    }

    /// Whether two scenes differ only in camera, image size, sub-grid and background.
    #[must_use]
    pub fn has_look_of(&self, other: &Self) -> bool {
        self.mode == other.mode
            && self.transfer_function == other.transfer_function
            && self.shading == other.shading
            && self.iso == other.iso
            && self.slices == other.slices
            && self.clip == other.clip
    }
}

/// Shading with its lights resolved.
#[derive(Debug, Clone, PartialEq)]
pub struct Shading {
    /// Ambient coefficient ka.
    pub ambient: f64,
    /// Diffuse coefficient kd.
    pub diffuse: f64,
    /// Specular coefficient ks.
    pub specular: f64,
    /// Exponent of the specular highlight.
    pub shininess: f64,
    /// Lights, at most [`LIGHT_LIMIT`].
    pub lights: Vec<Light>,
}

/// Directional light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Light {
    /// Unit world vector l from the sample to the light.
    pub to_light: DVec3,
    /// Factor of the light's diffuse and specular terms.
    pub intensity: f64,
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
    fn gathers(&self) -> Mode {
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
        scene
    }

    /// As [`Self::complete`], without the camera.
    fn with_look(&self, facts: &VolumeFacts, overview: Option<&Overview>) -> Self {
        let mut scene = self.clone();
        let left_open = self.mode.is_none() && self.transfer_function.is_none() && self.iso.is_empty();
        let look = Look::of(facts);
        if left_open {
            scene.mode = Some(look.mode);
            scene.shading.get_or_insert(look.shading);
            scene.iso = look.iso;
        }
        let mode = scene.gathers();
        scene.mode = Some(mode);
        scene.shading.get_or_insert_with(|| (mode == Mode::Iso || !scene.iso.is_empty()).then(ShadingSpec::default));
        let samples = if left_open { look.samples_per_pixel } else { 1 };
        scene.samples_per_pixel =
            Some(self.samples_per_pixel.unwrap_or_else(|| samples_that_fit(&self.image, samples)));
        scene.transfer_function = self.transfer_function.clone().or_else(|| {
            let points = match mode {
                Mode::Mip | Mode::Minip | Mode::Mean => looks::projection(mode, facts, overview),
                Mode::Dvr if look.mode == Mode::Mip => looks::body(facts),
                _ => look.transfer_function,
            };
            Some(TransferFunctionSpec::Points(points))
        });
        let plain = preset::ramps::plain_slice(facts);
        let colors = || plain.iter().map(|p| ColorSpec { value: p.value, color: p.color }).collect();
        let suits = |slice: &&mut SliceSpec| slice.filter.is_none_or(|filter| filter.kind.keeps_values());
        for slice in scene.slices.iter_mut().filter(|slice| slice.colors.is_empty()).filter(suits) {
            slice.colors = colors();
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
        let seen = overview.filter(|_| self.slices.is_empty()).and_then(|overview| match self.gathers() {
            Mode::Dvr => {
                let seen = self.classification(facts).ok().and_then(|shown| overview.visible(facts, kept, &shown));
                seen.or_else(|| self.iso.first().and_then(|iso| overview.beyond(facts, kept, iso.value)))
            }
            Mode::Iso => self.iso.first().and_then(|iso| overview.beyond(facts, kept, iso.value)),
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
        let mode = scene.gathers();
        let of_surfaces = scene.iso.iter().filter(|_| mode == Mode::Dvr);
        let inner = of_surfaces.filter(|surface| surface.alpha > 0.0).map(|surface| surface.value).collect();
        let subgrid = scene.samples_per_pixel.unwrap_or(1).isqrt();
        Ok(ResolvedScene {
            camera: camera.supersampled(subgrid),
            image_size,
            subgrid,
            background: scene.image.background,
            mode,
            transfer_function: transfer_function.with_surfaces(inner).in_units(&units),
            shading: scene.shading.as_ref().and_then(Option::as_ref).map(|s| s.resolve(&camera)),
            iso: scene.iso.iter().map(|iso| IsoSpec { value: units.value(iso.value), ..*iso }).collect(),
            slices: scene.slices.iter().map(|slice| slice.resolve(&units)).collect::<Result<_, _>>()?,
            clip: scene.clip.resolve(&units)?,
        })
    }
}

/// The samples per pixel, or 1 if the picture would have too many rays.
fn samples_that_fit(image: &ImageSpec, samples: u32) -> u32 {
    let rays = u64::from(image.width).saturating_mul(u64::from(image.height)).saturating_mul(u64::from(samples));
    if rays <= RAY_LIMIT { samples } else { 1 }
}

impl CameraSpec {
    fn projection(&self) -> Result<Projection, SceneError> {
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
    /// If the camera is invalid; see [`CameraError`].
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
    fn check_distance(&self, facts: &VolumeFacts, units: &Units) -> Result<(), SceneError> {
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
    /// Control points with a unit distance, which is a world length.
    #[must_use]
    pub fn of(points: &[ControlPoint], unit_distance: f64) -> Self {
        let points = points.iter().map(|p| PointSpec { value: p.value, color: p.color, alpha: p.alpha }).collect();
        Self { unit_distance: Some(unit_distance), points }
    }

    /// The control points.
    #[must_use]
    pub fn control_points(&self) -> Vec<ControlPoint> {
        self.points.iter().map(|p| ControlPoint { value: p.value, color: p.color, alpha: p.alpha }).collect()
    }

    fn transfer_function(&self, default_unit_distance: f64) -> Result<TransferFunction, SceneError> {
        Ok(TransferFunction::new(self.control_points(), self.unit_distance.unwrap_or(default_unit_distance))?)
    }
}

impl ShadingSpec {
    /// Shading for this camera. Without lights in the scene, one light shines along the camera's forward axis.
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

impl ClipSpec {
    fn resolve(&self, units: &Units) -> Result<Clip, SceneError> {
        let planes = self.planes.iter().map(|p| {
            let (normal, offset) = plane_in_units(p.normal, p.offset, units);
            ClipPlane { normal, offset }
        });
        Ok(Clip { index_box: self.index_box, planes: planes.collect(), solids: self.resolve_solids(units)? })
    }
}

/// The plane of all points p with normal . p = offset, in units. The normal is scaled by a power of two, so that
/// nothing is rounded.
fn plane_in_units(normal: [f64; 3], offset: f64, units: &Units) -> (DVec3, f64) {
    let scale = DVec3::from_array(normal).abs().max_element().log2().floor().exp2();
    let normal = DVec3::from_array(normal) / scale;
    (normal, (offset / scale - normal.dot(units.anchor)) / units.length)
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

mod slices;
mod solids;
#[cfg(test)]
mod tests;
mod validate;
