//! Cameras: pixels to rays (RENDERING-MODEL, section 8).
//!
//! World space, right-handed: `f = normalize(target - eye)`, `r = normalize(cross(f, up))`, `u = cross(r, f)`. Pixel
//! row 0 is on top; a pixel's ray runs through its centre. A ray's direction is a unit vector, so that its parameter t
//! is a world length. Perspective rays begin at the eye; orthographic rays extend both ways.

use glam::{DMat3, DVec3};

/// Projection from pixels to rays.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Projection {
    /// All rays begin at the eye.
    Perspective {
        /// Full vertical angle of view, degrees, in (0, 180).
        fov_y: f64,
    },
    /// All rays are parallel to the forward axis.
    Orthographic {
        /// World length that the full height of the picture covers.
        height: f64,
    },
}

/// A half-line or line in world space: the points `origin + t * direction` with `t >= t_min`. t is a world length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// World point at t = 0.
    pub origin: DVec3,
    /// Unit vector.
    pub direction: DVec3,
    /// Least t: 0 for perspective cameras, minus infinity for orthographic ones.
    pub t_min: f64,
}

/// Reason why eye, target and up vector define no camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum CameraError {
    #[error("eye and target must be two different points, at a finite distance")]
    EyeIsTarget,
    #[error("up must not be zero nor parallel to the line from eye to target")]
    UpIsForward,
}

/// A camera with a grid of pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// World position of the eye.
    pub eye: DVec3,
    /// Unit vector from the eye to the target.
    pub forward: DVec3,
    /// Unit vector to the picture's right.
    pub right: DVec3,
    /// Unit vector to the picture's top.
    pub up: DVec3,
    /// Perspective or orthographic.
    pub projection: Projection,
    /// Pixels along x; at least 1.
    pub width: u32,
    /// Pixels along y; at least 1.
    pub height: u32,
    /// Width and height of the view in pixels. Smaller than `width` and `height` by less than one pixel if the last
    /// pixels reach beyond the view.
    pub extent: [f64; 2],
}

/// The rays of a camera, one per pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelRays {
    camera: Camera,
    /// Half the picture's width and height as a world length; for perspective cameras at distance 1.
    half_size: [f64; 2],
}

impl PixelRays {
    /// The ray through the centre of pixel (x, y); row 0 is on top.
    #[inline]
    #[must_use]
    pub fn ray(&self, x: u32, y: u32) -> Ray {
        self.ray_at([f64::from(x), f64::from(y)])
    }

    /// As [`PixelRays::ray`], for pixel coordinates that are already floating point.
    #[inline(always)]
    #[must_use]
    pub fn ray_at(&self, pixel: [f64; 2]) -> Ray {
        let camera = &self.camera;
        let offset = self.offset(pixel);
        match camera.projection {
            Projection::Perspective { .. } => {
                Ray { origin: camera.eye, direction: (camera.forward + offset).normalize(), t_min: 0.0 }
            }
            Projection::Orthographic { .. } => {
                Ray { origin: camera.eye + offset, direction: camera.forward, t_min: f64::NEG_INFINITY }
            }
        }
    }

    /// Offset of a pixel's centre from the middle of the view: world length, for perspective cameras at distance 1.
    #[inline(always)]
    #[must_use]
    pub fn offset(&self, [x, y]: [f64; 2]) -> DVec3 {
        let camera = &self.camera;
        let [nx, ny] = camera.ndc([x, y]);
        nx * self.half_size[0] * camera.right + ny * self.half_size[1] * camera.up
    }

    /// The reverse of [`PixelRays::offset`]: the pixel whose centre lies `right` and `above` of the middle of the view.
    /// Positions between pixels and outside the picture are allowed.
    #[inline(always)]
    #[must_use]
    pub fn pixel_at(&self, [right, above]: [f64; 2]) -> [f64; 2] {
        let ndc = [right / self.half_size[0], -above / self.half_size[1]];
        [0, 1].map(|a| (ndc[a] + 1.0) * 0.5 * self.camera.extent[a] - 0.5)
    }
}

/// The unit vector along `v`, even if the square of `v` overflows or underflows. `None` if `v` is zero or not finite.
#[must_use]
pub fn unit_vector(v: DVec3) -> Option<DVec3> {
    let greatest = v.abs().max_element();
    // Scaling by a power of two rounds nothing.
    let scaled = v / greatest.log2().floor().exp2();
    if greatest > 0.0 && v.is_finite() { scaled.try_normalize() } else { None }
}

/// Least sine of the angle between the forward axis and `up` for which left and right are defined.
const MIN_UP_SINE: f64 = 1e-9;

impl Camera {
    /// A camera at `eye` that looks at `target`.
    ///
    /// # Errors
    /// If eye and target coincide, or if `up` is zero or parallel to the line from eye to target.
    pub fn look_at(
        eye: DVec3,
        target: DVec3,
        up: DVec3,
        projection: Projection,
        size: [u32; 2],
    ) -> Result<Self, CameraError> {
        let forward = unit_vector(target - eye).ok_or(CameraError::EyeIsTarget)?;
        let up = unit_vector(up).ok_or(CameraError::UpIsForward)?;
        let across = forward.cross(up);
        if across.length() < MIN_UP_SINE {
            return Err(CameraError::UpIsForward);
        }
        let right = across.normalize();
        let ([width, height], extent) = (size, size.map(f64::from));
        Ok(Self { eye, forward, right, up: right.cross(forward), projection, width, height, extent })
    }

    /// The same view with `factor` times as many pixels along each axis.
    #[must_use]
    pub fn supersampled(self, factor: u32) -> Self {
        let extent = self.extent.map(|pixels| pixels * f64::from(factor));
        Self { width: self.width * factor, height: self.height * factor, extent, ..self }
    }

    /// The same view with pixels `factor` times as large along each axis. The upper left corner stays; the last pixels
    /// may reach beyond the view.
    #[must_use]
    pub fn coarser(self, factor: u32) -> Self {
        let extent = self.extent.map(|pixels| pixels / f64::from(factor));
        Self { width: self.width.div_ceil(factor), height: self.height.div_ceil(factor), extent, ..self }
    }

    /// The camera after the motion from `before` to `self` is repeated once: the same rigid rotation and translation.
    /// Projection and pixels are those of `self`.
    #[must_use]
    pub fn moved_on_from(&self, before: &Self) -> Self {
        let axes = |camera: &Self| DMat3::from_cols(camera.right, camera.up, camera.forward);
        let turn = axes(self) * axes(before).transpose();
        let [forward, right] = [self.forward, self.right].map(|axis| turn * axis);
        let (forward, across) = (forward.normalize(), right - right.project_onto(forward));
        let right = across.normalize();
        Self { eye: self.eye + turn * (self.eye - before.eye), forward, right, up: right.cross(forward), ..*self }
    }

    /// Normalised device coordinates of a pixel's centre: x to the right, y up, both in (-1, 1) inside the view.
    #[inline(always)]
    #[must_use]
    pub fn ndc(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [(x + 0.5) * 2.0 / self.extent[0] - 1.0, 1.0 - (y + 0.5) * 2.0 / self.extent[1]]
    }

    /// The ray through the centre of pixel (x, y); row 0 is on top.
    #[must_use]
    pub fn ray(&self, x: u32, y: u32) -> Ray {
        self.rays().ray(x, y)
    }

    /// The rays of all pixels, with their common quantities computed once.
    #[must_use]
    pub fn rays(&self) -> PixelRays {
        let half_height = match self.projection {
            Projection::Perspective { fov_y } => (fov_y.to_radians() / 2.0).tan(),
            Projection::Orthographic { height } => height / 2.0,
        };
        let aspect = self.extent[0] / self.extent[1];
        PixelRays { camera: *self, half_size: [half_height * aspect, half_height] }
    }

    /// World height of one pixel at a world point.
    #[must_use]
    pub fn pixel_size_at(&self, point: DVec3) -> f64 {
        match self.projection {
            Projection::Perspective { .. } => self.pixel_height() * (point - self.eye).length(),
            Projection::Orthographic { .. } => self.pixel_height(),
        }
    }

    /// World height of one pixel: at distance 1 for perspective cameras, anywhere for orthographic ones.
    #[must_use]
    pub fn pixel_height(&self) -> f64 {
        match self.projection {
            Projection::Perspective { fov_y } => 2.0 * (fov_y.to_radians() / 2.0).tan() / self.extent[1],
            Projection::Orthographic { height } => height / self.extent[1],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn perspective_rays_follow_the_model() {
        let fov_y = 40.0;
        let camera = Camera::look_at(
            DVec3::new(1.0, 2.0, 3.0),
            DVec3::new(1.0, 2.0, -7.0),
            DVec3::Y,
            Projection::Perspective { fov_y },
            [6, 4],
        )
        .unwrap();
        assert_eq!((camera.forward, camera.right, camera.up), (DVec3::NEG_Z, DVec3::X, DVec3::Y));
        let slope = 20f64.to_radians().tan();
        for (x, y) in [(0, 0), (5, 3), (2, 1)] {
            let ray = camera.ray(x, y);
            let expected = DVec3::new(
                ((f64::from(x) + 0.5) / 3.0 - 1.0) * slope * 1.5,
                (1.0 - (f64::from(y) + 0.5) / 2.0) * slope,
                -1.0,
            );
            assert!((ray.direction - expected.normalize()).length() < 1e-12);
            assert!((ray.direction.length() - 1.0).abs() < 1e-15);
            assert_eq!((ray.origin, ray.t_min), (camera.eye, 0.0));
        }
    }

    /// The ray of a coarse pixel runs through the middle of the fine pixels that it covers.
    #[test]
    fn coarser_pixels_cover_those_of_the_picture() {
        let projection = Projection::Orthographic { height: 7.0 };
        let camera = Camera::look_at(DVec3::ZERO, DVec3::X, DVec3::Z, projection, [10, 7]).unwrap();
        let coarser = camera.coarser(4);
        assert_eq!((coarser.width, coarser.height, coarser.pixel_height()), (3, 2, 4.0));
        for (x, y) in [(0, 0), (1, 1), (2, 1)] {
            let corners = [[0, 0], [3, 3]].map(|[i, j]| camera.ray(4 * x + i, 4 * y + j).origin);
            assert!((coarser.ray(x, y).origin - 0.5 * (corners[0] + corners[1])).length() < 1e-12);
        }
    }

    #[test]
    fn orthographic_rays_are_parallel_and_extend_both_ways() {
        let camera =
            Camera::look_at(DVec3::ZERO, DVec3::X, DVec3::Z, Projection::Orthographic { height: 8.0 }, [4, 2]).unwrap();
        let ray = camera.ray(0, 0);
        assert_eq!((ray.direction, ray.t_min), (DVec3::X, f64::NEG_INFINITY));
        // Right is cross(x, z) = -y: the left pixel lies at +y, the top pixel at +z.
        assert!((ray.origin - DVec3::new(0.0, 6.0, 2.0)).length() < 1e-12);
        assert!((camera.ray(3, 1).origin - DVec3::new(0.0, -6.0, -2.0)).length() < 1e-12);
        assert_eq!(camera.pixel_height(), 4.0);
    }

    /// Motions around the volume and through it, and a change of the projection.
    #[test]
    fn cameras_that_go_on_stay_on_their_path() {
        let projection = Projection::Perspective { fov_y: 30.0 };
        let look = |eye, target| Camera::look_at(eye, target, DVec3::Z, projection, [40, 30]).unwrap();
        let around = |degrees: f64| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            look(DVec3::new(5.0 + 3.0 * cos, 3.0 * sin, 1.0), DVec3::new(5.0, 0.0, 0.0))
        };
        let through = |t: f64| look(DVec3::new(t, 0.3 * t, 0.1), DVec3::new(t + 1.0, 0.3 * t + 0.2, 0.1));
        for [before, now, next] in [[10.0, 16.0, 22.0].map(around), [0.0, 0.5, 1.0].map(through)] {
            let found = now.moved_on_from(&before);
            let pairs =
                [(found.eye, next.eye), (found.forward, next.forward), (found.right, next.right), (found.up, next.up)];
            assert!(pairs.iter().all(|(a, b)| (*a - *b).length() < 1e-12), "{found:?} instead of {next:?}");
        }
        let zoomed = Camera { projection: Projection::Perspective { fov_y: 20.0 }, ..around(0.0) };
        let found = zoomed.moved_on_from(&around(0.0));
        assert_eq!((found.eye, found.projection), (zoomed.eye, zoomed.projection), "nothing but the lens has changed");
        assert!((found.forward - zoomed.forward).length() < 1e-15);
    }

    #[test]
    fn pixels_are_found_again_by_where_they_lie() {
        for projection in [Projection::Perspective { fov_y: 50.0 }, Projection::Orthographic { height: 3.0 }] {
            let camera = Camera::look_at(DVec3::ZERO, DVec3::X, DVec3::Z, projection, [31, 17]).unwrap().coarser(3);
            for pixel in [[0.0, 0.0], [10.0, 5.0], [-4.0, 7.25]] {
                let offset = camera.rays().offset(pixel);
                let found = camera.rays().pixel_at([offset.dot(camera.right), offset.dot(camera.up)]);
                assert!((0..2).all(|a| (found[a] - pixel[a]).abs() < 1e-12), "{found:?} for {pixel:?}");
            }
        }
    }

    #[test]
    fn degenerate_cameras_are_refused() {
        let projection = Projection::Perspective { fov_y: 30.0 };
        let look = |eye, target, up| Camera::look_at(eye, target, up, projection, [1, 1]);
        assert_eq!(look(DVec3::ONE, DVec3::ONE, DVec3::Y), Err(CameraError::EyeIsTarget));
        assert_eq!(look(DVec3::ZERO, DVec3::Y, DVec3::Y), Err(CameraError::UpIsForward));
        assert_eq!(look(DVec3::ZERO, DVec3::Y, DVec3::ZERO), Err(CameraError::UpIsForward));
    }
}
