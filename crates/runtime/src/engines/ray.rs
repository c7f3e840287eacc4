//! One ray between passes: its position and its result so far.

use supervol_format::BrickKey;
use supervol_format::cast::single;
use supervol_scene::clip::Segment;

/// One ray between passes.
#[derive(Debug, Clone, PartialEq)]
pub struct RayState {
    /// World length at which the ray continues; always at a brick's entry.
    pub t: f64,
    /// World length at the end of its segment.
    pub t_end: f64,
    /// Premultiplied colour gathered so far (`dvr`, `iso`).
    pub color: [f64; 3],
    /// Share of the light from behind that passes, from 1 to 0.
    pub transmittance: f64,
    /// `mip`, `minip`: the extreme so far; `mean`: the integral so far; NaN before the first present value.
    pub value: f64,
    /// `mean`: present world length so far.
    pub length: f64,
    /// `iso`: sides and hits.
    pub iso: IsoSides,
    /// Crossings with surfaces in order, in frames that list them. There, `t` is the begin of the present cell.
    pub crossings: Vec<SurfaceCrossing>,
    /// The brick that the ray waits for.
    pub waiting: Option<BrickKey>,
    /// The ray is finished.
    pub finished: bool,
}

impl RayState {
    /// A ray before its first pass; finished where there is no segment.
    #[must_use]
    pub fn new(segment: Option<Segment>) -> Self {
        Self {
            t: segment.map_or(0.0, |s| s.t0),
            t_end: segment.map_or(0.0, |s| s.t1),
            color: [0.0; 3],
            transmittance: 1.0,
            value: f64::NAN,
            length: 0.0,
            iso: IsoSides::default(),
            crossings: Vec::new(),
            waiting: None,
            finished: segment.is_none(),
        }
    }
}

/// Crossing of a ray with a surface, with the colour there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceCrossing {
    /// World length along the ray.
    pub t: f64,
    /// Colour after shading, premultiplied.
    pub color: [f32; 3],
    /// Opacity.
    pub alpha: f32,
}

/// Which side of each iso value the ray is on, one bit per surface.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct IsoSides {
    /// The side is known: the ray comes out of a present cell.
    pub known: u32,
    /// The value was not less than the iso value.
    pub above: u32,
    /// The surface has been met.
    pub hit: u32,
}

impl IsoSides {
    /// Moves the ray past values from `low` to `high`; an empty range means that no value is present. Returns false and
    /// changes nothing if the ray meets a new surface there, or has jumped across one.
    #[inline]
    pub(crate) fn pass(&mut self, [low, high]: [f32; 2], surfaces: impl Iterator<Item = f32>) -> bool {
        if low > high {
            self.known = 0;
            return true;
        }
        let mut above = 0;
        for (i, surface) in surfaces.enumerate() {
            if low < surface && surface <= high && self.hit >> i & 1 == 0 {
                return false;
            }
            above |= u32::from(low >= surface) << i;
        }
        if self.known & !self.hit & (self.above ^ above) != 0 {
            return false;
        }
        (self.above, self.known) = (above, u32::MAX);
        true
    }
}

/// The pixel of a ray that has gathered light: premultiplied colour and opacity.
#[inline]
pub(crate) fn pixel_of_light([r, g, b]: [f64; 3], transmittance: f64) -> [f32; 4] {
    [r, g, b, 1.0 - transmittance].map(single)
}
