//! Limits of the numbers in scenes.

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
/// Least width of the ramp of `gradient_opacity`, as a share of its end: a narrower one is a step. A step would make pictures
/// depend on the rounding of gradients.
pub const LEAST_GRADIENT_RAMP: f64 = 1e-6;
/// Least and greatest end of that ramp in the units of a picture: beyond, squares of gradients lose all digits.
pub const GRADIENT_LIMITS: [f64; 2] = [1e-60, 1e60];
