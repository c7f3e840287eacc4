//! Solids of a scene: range checks, and conversion into the units of a picture.

use std::path::Path;

use glam::DVec3;
use supervol_format::readable::Number;

use super::checks::{check, check_direction};
use super::error::SceneError;
use crate::camera::unit_vector;
use crate::clip::mesh_file;
use crate::clip::solids::{PlacedMesh, SOLID_LIMIT, Shape, Solid};
use crate::spec::{BoxSpec, ClipSpec, CylinderSpec, SolidSpec, SphereSpec};
use crate::units::Units;

/// Greatest magnitude of the cosine of an angle that counts as a right angle, between two axes of a box.
const RIGHT_ANGLE: f64 = 1e-6;

/// The shape of a solid.
enum ShapeSpec<'a> {
    Sphere(&'a SphereSpec),
    Cuboid(&'a BoxSpec),
    Cylinder(&'a CylinderSpec),
    Mesh(&'a Path),
}

impl SolidSpec {
    fn shape_spec(&self, key: &str) -> Result<ShapeSpec<'_>, SceneError> {
        let shapes = [
            self.sphere.as_ref().map(ShapeSpec::Sphere),
            self.cuboid.as_ref().map(ShapeSpec::Cuboid),
            self.cylinder.as_ref().map(ShapeSpec::Cylinder),
            self.mesh.as_deref().map(ShapeSpec::Mesh),
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
        match self.shape_spec(key)? {
            ShapeSpec::Sphere(SphereSpec { center, radius }) => {
                check_point(&format!("{key}.sphere.center"), *center)?;
                check_length(&format!("{key}.sphere.radius"), *radius)
            }
            ShapeSpec::Cuboid(BoxSpec { center, edges, axes }) => {
                check_point(&format!("{key}.box.center"), *center)?;
                edges.iter().try_for_each(|edge| check_length(&format!("{key}.box.edges"), *edge))?;
                let key = format!("{key}.box.axes");
                axes.iter().try_for_each(|axis| check_direction(&key, *axis))?;
                let [a, b, c] = unit_axes(axes);
                let good = [a.dot(b), b.dot(c), c.dot(a)].iter().all(|cosine| cosine.abs() <= RIGHT_ANGLE);
                check(good, &key, || "three directions at right angles to each other".into(), format!("{axes:?}"))
            }
            ShapeSpec::Cylinder(CylinderSpec { from, to, radius }) => {
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
            ShapeSpec::Mesh(_) => Ok(()),
        }
    }

    /// The solid in the units of a picture. Reads the file of a mesh.
    fn resolve(&self, key: &str, units: &Units) -> Result<Solid, SceneError> {
        let point = |world: &[f64; 3]| units.point((*world).into());
        let shape = match self.shape_spec(key)? {
            ShapeSpec::Sphere(SphereSpec { center, radius }) => {
                Shape::Sphere { center: point(center), radius: radius / units.length }
            }
            ShapeSpec::Cuboid(BoxSpec { center, edges, axes }) => Shape::Cuboid {
                center: point(center),
                axes: unit_axes(axes),
                half_edges: edges.map(|edge| 0.5 * edge / units.length),
            },
            ShapeSpec::Cylinder(CylinderSpec { from, to, radius }) => {
                let (from, line) = (point(from), point(to) - point(from));
                let (length, radius) = (line.length(), radius / units.length);
                Shape::Cylinder { from, axis: line / length, length, radius }
            }
            ShapeSpec::Mesh(path) => {
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
