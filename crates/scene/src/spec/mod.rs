//! Parts of a scene as JSON: camera, image, mode, transfer function, shading, surfaces, clipping.
//!
//! These types hold what a user writes or a preset chooses. Ranges of numbers are checked, and numbers are converted
//! into units, where a [`Scene`](crate::scene::Scene) is resolved. Slices have their own form in [`crate::slices`].

mod solids;

use schemars::JsonSchema;
use serde::de::value::MapAccessDeserializer;
use serde::de::{MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

pub use self::solids::{BoxSpec, CylinderSpec, SolidSpec, SphereSpec};
use crate::transfer_function::ControlPoint;

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
}
