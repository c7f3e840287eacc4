//! Solids that clip the volume, as JSON.

use std::path::PathBuf;

use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::clip::solids::Keep;

/// Solid: exactly one of `sphere`, `box`, `cylinder` and `mesh`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Default, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SolidSpec {
    /// Part of the volume to keep: inside or outside of the solid.
    pub keep: Keep,
    /// Sphere.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sphere: Option<SphereSpec>,
    /// Box in any orientation.
    #[serde(rename = "box", skip_serializing_if = "Option::is_none")]
    pub cuboid: Option<BoxSpec>,
    /// Cylinder with flat ends.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cylinder: Option<CylinderSpec>,
    /// File of a closed triangle mesh in world coordinates (.ply, .stl, .obj); relative to the folder of the scene.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mesh: Option<PathBuf>,
}

/// Sphere: all points nearer to `center` than `radius`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SphereSpec {
    /// World position of the centre.
    pub center: [f64; 3],
    /// Radius, world length.
    pub radius: f64,
}

/// Box: all points within half an edge of `center` along each axis.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BoxSpec {
    /// World position of the centre.
    pub center: [f64; 3],
    /// World lengths of the edges.
    pub edges: [f64; 3],
    /// World directions of the edges, at right angles to each other.
    #[serde(default = "world_axes")]
    pub axes: [[f64; 3]; 3],
}

fn world_axes() -> [[f64; 3]; 3] {
    DVec3::AXES.map(|axis| axis.to_array())
}

/// Cylinder: all points nearer than `radius` to the line from `from` to `to`, between the planes across its ends.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CylinderSpec {
    /// World position of the middle of one end.
    pub from: [f64; 3],
    /// World position of the middle of the other end.
    pub to: [f64; 3],
    /// Radius, world length.
    pub radius: f64,
}
