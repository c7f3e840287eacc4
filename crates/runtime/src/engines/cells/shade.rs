//! Shading: gradients of a cell, and two-sided Blinn-Phong (RENDERING-MODEL, section 5).
//!
//! The gradient is interpolated from central differences at the eight corners, of the 32 voxels around the cell. It
//! equals the differences of the interpolant over one voxel to each side. Vectors are in world space.

use glam::{DMat3, Mat3, Vec3};
use supervol_format::cast::single;
use supervol_scene::scene::Shading;

use super::cell::{Real, cubic_at, cubic_of_cell, replace_unreached};

/// Gradients below this share of the data range per smallest spacing are noise and not shaded.
const GRADIENT_FLOOR: f64 = 1e-6;

/// The lighting of a frame.
#[derive(Debug, Clone)]
pub struct Lighting {
    /// ka.
    pub ambient: f32,
    /// kd.
    pub diffuse: f32,
    /// ks.
    pub specular: f32,
    /// Exponent of the highlight.
    pub shininess: f32,
    /// Unit vectors to the lights, and their intensities.
    pub lights: Vec<(Vec3, f32)>,
    /// Gradients shorter than this, data units per world length, leave a sample unshaded.
    pub gradient_floor: f32,
    /// World gradient from the index gradient of level 0.
    pub world_from_index_gradient: DMat3,
}

impl Lighting {
    /// Lighting from a scene's shading; `range_width` is that of the whole volume's values.
    #[must_use]
    pub fn new(shading: &Shading, geometry: &supervol_format::Geometry, range_width: f64) -> Self {
        Self {
            ambient: single(shading.ambient),
            diffuse: single(shading.diffuse),
            specular: single(shading.specular),
            shininess: single(shading.shininess),
            lights: shading.lights.iter().map(|l| (l.to_light.as_vec3(), single(l.intensity))).collect(),
            gradient_floor: single(GRADIENT_FLOOR * range_width / geometry.smallest_spacing()),
            world_from_index_gradient: geometry.world_from_index_gradient(),
        }
    }

    /// World gradient from the index gradient of a level with this scale.
    #[must_use]
    pub fn world_from_level_gradient(&self, scale: [u64; 3]) -> Mat3 {
        let per_level = glam::DVec3::from_array(scale.map(|s| 1.0 / s as f64));
        (self.world_from_index_gradient * DMat3::from_diagonal(per_level)).as_mat3()
    }
}

/// The gradient along a chord: one cubic per index axis.
#[derive(Debug, Clone, Copy)]
pub struct ChordGradient {
    cubics: [[Real; 4]; 3],
}

impl ChordGradient {
    /// The gradient from its components at the eight corners (`[axis][corner]`, NaN if a tap is absent). `None` if an
    /// absent tap has a weight other than zero on the chord from `a` to `b`.
    #[inline]
    #[must_use]
    pub fn new(mut corners: [[f32; 8]; 3], a: [Real; 3], b: [Real; 3]) -> Option<Self> {
        if corners.iter().flatten().any(|g| g.is_nan()) {
            corners.iter_mut().for_each(|component| replace_unreached(component, a, b));
            if corners.iter().flatten().any(|g| g.is_nan()) {
                return None;
            }
        }
        Some(Self { cubics: corners.map(|component| cubic_of_cell(&component, a, b)) })
    }

    /// Index-space gradient at u.
    #[inline]
    #[must_use]
    pub fn at(&self, u: Real) -> Vec3 {
        Vec3::from_array(self.cubics.map(|c| single(cubic_at(&c, u))))
    }
}

/// The colour after shading; `gradient` in world space, `to_eye` a unit vector.
#[inline]
#[must_use]
pub fn shade(lighting: &Lighting, color: [f32; 3], gradient: Vec3, to_eye: Vec3) -> [f32; 3] {
    let length = gradient.length();
    if length == 0.0 || length < lighting.gradient_floor {
        return color;
    }
    let normal = gradient * (-1.0 / length);
    let mut diffuse = lighting.ambient;
    let mut specular = 0.0;
    for &(to_light, intensity) in &lighting.lights {
        let half = (to_light + to_eye).normalize_or_zero();
        diffuse += lighting.diffuse * normal.dot(to_light).abs() * intensity;
        specular += lighting.specular * normal.dot(half).abs().powf(lighting.shininess) * intensity;
    }
    color.map(|c| (c * diffuse + specular).clamp(0.0, 1.0))
}
