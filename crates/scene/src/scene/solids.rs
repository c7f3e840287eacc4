//! Solids that a scene's volume is clipped with: JSON form, range checks, and conversion into the units of a picture.

use std::path::{Path, PathBuf};

use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use supervol_format::readable::Number;

use super::validate::{check, check_direction};
use super::{ClipSpec, Scene, SceneError};
use crate::camera::unit_vector;
use crate::clip::mesh_file;
use crate::clip::solids::{Keep, PlacedMesh, SOLID_LIMIT, Shape, Solid};
use crate::units::Units;

/// Greatest magnitude of the cosine of an angle that counts as a right angle, between two axes of a box.
const RIGHT_ANGLE: f64 = 1e-6;

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

/// The shape of a solid.
enum Given<'a> {
    Sphere(&'a SphereSpec),
    Cuboid(&'a BoxSpec),
    Cylinder(&'a CylinderSpec),
    Mesh(&'a Path),
}

impl SolidSpec {
    fn given(&self, key: &str) -> Result<Given<'_>, SceneError> {
        let shapes = [
            self.sphere.as_ref().map(Given::Sphere),
            self.cuboid.as_ref().map(Given::Cuboid),
            self.cylinder.as_ref().map(Given::Cylinder),
            self.mesh.as_deref().map(Given::Mesh),
        ];
        let mut shapes = shapes.into_iter().flatten();
        match (shapes.next(), shapes.count()) {
            (Some(shape), 0) => Ok(shape),
            (shape, _) => Err(SceneError::Value {
                key: key.into(),
                expected: "exactly one of `sphere`, `box`, `cylinder` and `mesh`".into(),
                found: if shape.is_some() { "several" } else { "none" }.into(),
            }),
        }
    }

    /// Checks the numbers; `key` is the path of the solid in the scene, for messages.
    fn validate(&self, key: &str) -> Result<(), SceneError> {
        match self.given(key)? {
            Given::Sphere(SphereSpec { center, radius }) => {
                check_point(&format!("{key}.sphere.center"), *center)?;
                check_length(&format!("{key}.sphere.radius"), *radius)
            }
            Given::Cuboid(BoxSpec { center, edges, axes }) => {
                check_point(&format!("{key}.box.center"), *center)?;
                edges.iter().try_for_each(|edge| check_length(&format!("{key}.box.edges"), *edge))?;
                let key = format!("{key}.box.axes");
                axes.iter().try_for_each(|axis| check_direction(&key, *axis))?;
                let [a, b, c] = unit_axes(axes);
                let good = [a.dot(b), b.dot(c), c.dot(a)].iter().all(|cosine| cosine.abs() <= RIGHT_ANGLE);
                check(good, &key, || "three directions at right angles to each other".into(), format!("{axes:?}"))
            }
            Given::Cylinder(CylinderSpec { from, to, radius }) => {
                check_point(&format!("{key}.cylinder.from"), *from)?;
                check_point(&format!("{key}.cylinder.to"), *to)?;
                let differ = (DVec3::from(*to) - DVec3::from(*from)).length();
                let good = differ.is_finite() && differ > 0.0;
                check(
                    good,
                    &format!("{key}.cylinder"),
                    || "two different ends".into(),
                    format!("{from:?} and {to:?}"),
                )?;
                check_length(&format!("{key}.cylinder.radius"), *radius)
            }
            Given::Mesh(_) => Ok(()),
        }
    }

    /// The solid in the units of a picture. Reads the file of a mesh.
    fn resolve(&self, key: &str, units: &Units) -> Result<Solid, SceneError> {
        let point = |world: &[f64; 3]| units.point((*world).into());
        let shape = match self.given(key)? {
            Given::Sphere(SphereSpec { center, radius }) => {
                Shape::Sphere { center: point(center), radius: radius / units.length }
            }
            Given::Cuboid(BoxSpec { center, edges, axes }) => Shape::Cuboid {
                center: point(center),
                axes: unit_axes(axes),
                half_edges: edges.map(|edge| 0.5 * edge / units.length),
            },
            Given::Cylinder(CylinderSpec { from, to, radius }) => {
                let (from, line) = (point(from), point(to) - point(from));
                let (length, radius) = (line.length(), radius / units.length);
                Shape::Cylinder { from, axis: line / length, length, radius }
            }
            Given::Mesh(path) => {
                let mesh = mesh_file::read(path)
                    .map_err(|reason| SceneError::Mesh { key: format!("{key}.mesh"), reason: Box::new(reason) })?;
                Shape::Mesh(PlacedMesh { mesh, anchor: units.anchor, length: units.length })
            }
        };
        Ok(Solid { shape, keep: self.keep })
    }
}

impl ClipSpec {
    pub(super) fn validate_solids(&self) -> Result<(), SceneError> {
        let few = self.solids.len() <= SOLID_LIMIT;
        check(few, "clip.solids", || format!("at most {SOLID_LIMIT} solids"), self.solids.len())?;
        self.solids.iter().enumerate().try_for_each(|(i, solid)| solid.validate(&key_of(i)))
    }

    pub(super) fn resolve_solids(&self, units: &Units) -> Result<Vec<Solid>, SceneError> {
        self.solids.iter().enumerate().map(|(i, solid)| solid.resolve(&key_of(i), units)).collect()
    }
}

impl Scene {
    /// Makes the relative paths in the scene relative to this folder.
    pub fn begin_paths_at(&mut self, folder: &Path) {
        for mesh in self.clip.solids.iter_mut().filter_map(|solid| solid.mesh.as_mut()) {
            *mesh = folder.join(&*mesh);
        }
    }

    /// Files that the scene refers to. They are read when the scene is drawn.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        self.clip.solids.iter().filter_map(|solid| solid.mesh.as_deref())
    }
}

fn key_of(number: usize) -> String {
    format!("clip.solids[{number}]")
}

fn unit_axes(axes: &[[f64; 3]; 3]) -> [DVec3; 3] {
    axes.map(|axis| unit_vector(axis.into()).expect("validated: not zero, and finite"))
}

fn check_point(key: &str, point: [f64; 3]) -> Result<(), SceneError> {
    let finite = point.iter().all(|v| v.is_finite());
    check(finite, key, || "three finite numbers".into(), format!("{point:?}"))
}

fn check_length(key: &str, length: f64) -> Result<(), SceneError> {
    let good = length.is_finite() && length > 0.0;
    check(good, key, || "a positive finite world length".into(), Number(length))
}
