//! A scene with all defaults filled in for one volume, as engines draw it.

use glam::DVec3;

use crate::camera::Camera;
use crate::clip::Clip;
use crate::clip::faces::CutNormals;
use crate::slices::SlicePlane;
use crate::spec::{IsoSpec, Mode};
use crate::transfer_function::TransferFunction;

/// A scene with all defaults filled in for one volume. Lengths and values are in the units of the picture
/// ([`Units`](crate::units::Units)).
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
    /// Opacity by the length of the gradient, if any; only in mode `dvr`.
    pub gradient_opacity: Option<GradientOpacity>,
    /// Cuts whose faces are lit by their own normals, if any; only in mode `dvr` with shading.
    pub cut_normals: Option<CutNormals>,
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
            && self.gradient_opacity == other.gradient_opacity
            && self.cut_normals == other.cut_normals
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
    /// Lights, at most [`LIGHT_LIMIT`](super::LIGHT_LIMIT).
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

/// Opacity by the length of the gradient (RENDERING-MODEL, section 5): extinction is multiplied by
/// `clamp((|g| - from) / (to - from), 0, 1)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GradientOpacity {
    /// Length of the gradient up to which nothing shows, values per length.
    pub from: f64,
    /// Length from which on the whole extinction counts; greater than `from`.
    pub to: f64,
}

impl GradientOpacity {
    /// The factor of extinction for a gradient of this length.
    #[inline]
    #[must_use]
    pub fn factor(&self, length: f64) -> f64 {
        ((length - self.from) / (self.to - self.from)).clamp(0.0, 1.0)
    }
}
