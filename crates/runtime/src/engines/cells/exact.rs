//! One trilinear cell in `f64`, for what packets do not settle in `f32`: where a ray grazes a step of the transfer function, where
//! rounding decides on which side of a step an even field lies, where a normal turns over.
//!
//! The transfer function is that of the scene, over data values. The chord is cut at the values at which it bends or steps.
//! Each part is integrated by one pair of Gauss points and by two, and halved until both agree, the normal certainly turns
//! little, and colours are certainly cut off at 1 in all of it or in none, or the part hardly shows. What is left is far below any error
//! that can be asked for, but has no proven bound.

use glam::{DMat3, DVec3};
use supervol_format::BrickKey;
use supervol_format::cast::single;
use supervol_scene::transfer_function::TransferFunction;

use super::cell::{
    Parameters, Real, cubic_at, cubic_extremes, cubic_of_cell, monotone_intervals, monotone_root, replace_unreached,
};
use super::quadrature::GAUSS_OFFSET;
use super::shade::Lighting;
use super::visit::{BrickVisit, LevelVisit, StoredVoxel};
use crate::stream::residency::{DecodedBrick, Voxels};

/// Difference of one pair and two pairs that counts as agreement: a fifteenth of it is left.
const AGREEMENT: f64 = 1e-6;
/// Most halvings of a part.
const HALVINGS: u32 = 30;
/// Greatest turn of the normal over a part, as a length, for wide highlights. For narrow ones the shininess reduces it.
const NORMAL_CHANGE: f64 = 0.5;
/// Shininess of such wide highlights.
const WIDE_SHININESS: f64 = 4.0;
/// `1/sqrt(3)`: distance of the two points of a pair, in parts of theirs.
const GAUSS_DISTANCE: f64 = 0.577_350_269_189_625_8;

/// Premultiplied colour and transmittance of a part.
type Seen = (DVec3, f64);

/// A chord, and everything that its light depends on.
struct ExactChord<'a> {
    transfer_function: &'a TransferFunction,
    lighting: Option<&'a Lighting>,
    /// Unit vectors to each light and half way from it to the eye, and its intensity.
    lights: Vec<(DVec3, DVec3, f64)>,
    /// World gradient from the gradient along the chord.
    world_from_index: DMat3,
    /// Data values.
    cubic: [Real; 4],
    /// Ends of the intervals in which it rises or falls.
    turns: Parameters<4>,
    /// Least and greatest value.
    range: [f64; 2],
    /// One cubic for each index axis; `None`: unshaded.
    gradient: Option<[[Real; 4]; 3]>,
    /// World length.
    length: f64,
}

/// Premultiplied colour and transmittance of the part of a ray in one trilinear cell of a brick. The cell's first corner lies `base`
/// voxels from the brick's first; `t` is the ray's interval in the brick.
pub(crate) fn exact_cell(
    level: LevelVisit<'_>,
    brick: &DecodedBrick,
    key: BrickKey,
    base: usize,
    t: [f64; 2],
) -> [f32; 4] {
    let visit = BrickVisit::new(level, brick, key);
    let (index, t) = visit.chord_at_base(base, t);
    let chord = match visit.voxels() {
        _ if t[0] >= t[1] => None,
        Voxels::U8(voxels) => ExactChord::new(&visit, voxels, (index, t)),
        Voxels::U16(voxels) => ExactChord::new(&visit, voxels, (index, t)),
        Voxels::F32(voxels) => ExactChord::new(&visit, voxels, (index, t)),
    };
    let (color, transmittance) = chord.map_or((DVec3::ZERO, 1.0), |chord| chord.seen());
    [color.x, color.y, color.z, transmittance].map(single)
}

impl<'a> ExactChord<'a> {
    /// The chord of a ray through a cell; `None` beside a hole.
    fn new<T: StoredVoxel>(
        visit: &'a BrickVisit<'_>,
        voxels: &[T],
        (index, [t0, t1]): ([i64; 3], [f64; 2]),
    ) -> Option<Self> {
        let level = &visit.level;
        let [a, b] = [t0, t1].map(|t| visit.cell_planes.fractions(level.axis_ray, t, index));
        let base = visit.base(index);
        let corners_at = |base: usize| visit.data_corners(voxels, base);
        let corners = present(corners_at(base), a, b)?;
        let cubic = cubic_of_cell(&corners, a, b);
        let lighting = level.setup.lighting;
        let gradient = lighting.and_then(|_| {
            let [x, y, z] = visit.steps().map(|step| {
                let [after, before] = [base + step, base - step].map(corners_at);
                let differences = std::array::from_fn(|i| 0.5 * (after[i] - before[i]));
                Some(cubic_of_cell(&present(differences, a, b)?, a, b))
            });
            Some([x?, y?, z?])
        });
        let to_eye = level.setup.to_eye.as_dvec3();
        let lights = lighting.iter().flat_map(|lighting| &lighting.lights).map(|&(to_light, intensity)| {
            let to_light = to_light.as_dvec3();
            (to_light, (to_light + to_eye).normalize_or_zero(), f64::from(intensity))
        });
        let turns = monotone_intervals(&cubic);
        let (low, high) = cubic_extremes(&cubic, turns.as_slice());
        Some(Self {
            transfer_function: &level.scene.data_transfer_function,
            lighting,
            lights: lights.collect(),
            world_from_index: level.setup.world_from_level_gradient.as_dmat3(),
            cubic,
            turns,
            range: [low, high],
            gradient,
            length: t1 - t0,
        })
    }

    /// Premultiplied colour and transmittance of the whole chord.
    fn seen(&self) -> Seen {
        let cuts = self.cuts();
        let parts = cuts.windows(2).filter(|part| part[0] < part[1]);
        parts.fold((DVec3::ZERO, 1.0), |seen, part| behind(seen, self.refined([part[0], part[1]], HALVINGS)))
    }

    /// Both ends, the crossings of the field with control points, and the places at which the light has a kink, because the normal is
    /// at right angles to a light or to a highlight; ascending.
    fn cuts(&self) -> Vec<f64> {
        let points = self.transfer_function.points();
        let first = points.partition_point(|point| point.value < self.range[0]);
        let inside = points[first..].iter().take_while(|point| point.value <= self.range[1]);
        let mut cuts = vec![0.0, 1.0];
        for value in inside.map(|point| point.value) {
            add_crossings(&mut cuts, &self.cubic, self.turns.as_slice(), value);
        }
        if let Some(gradient) = &self.gradient {
            for direction in self.lights.iter().flat_map(|&(to_light, half, _)| [to_light, half]) {
                let weights = self.world_from_index.transpose() * direction;
                let along = std::array::from_fn(|k| (0..3).map(|axis| weights[axis] * gradient[axis][k]).sum());
                add_crossings(&mut cuts, &along, monotone_intervals(&along).as_slice(), 0.0);
            }
        }
        cuts.sort_by(f64::total_cmp);
        cuts
    }

    /// A part, halved until halving it twice changes nothing: once may be by chance, beside a kink.
    fn refined(&self, part: [f64; 2], halvings: u32) -> Seen {
        self.refined_from(part, self.pair(part), None, halvings)
    }

    /// The same, with what one pair finds, and how much that differs from what was found for a part twice as long.
    fn refined_from(&self, [begin, end]: [f64; 2], whole: Seen, before: Option<f64>, halvings: u32) -> Seen {
        let middle = 0.5 * (begin + end);
        let [first, second] = [[begin, middle], [middle, end]];
        let (front, back) = (self.pair(first), self.pair(second));
        let halves = behind(front, back);
        let change = (halves.0 - whole.0).abs().max_element().max((halves.1 - whole.1).abs());
        let agrees = change < AGREEMENT && before.is_some_and(|before| before < AGREEMENT);
        let opacity = 1.0 - halves.1;
        let is_settled = agrees && (opacity < AGREEMENT || self.is_evenly_lit([begin, end], opacity));
        if is_settled || halvings == 0 {
            return halves;
        }
        let refined = |part, whole| self.refined_from(part, whole, Some(change), halvings - 1);
        behind(refined(first, front), refined(second, back))
    }

    /// One pair of Gauss points. See [`super::quadrature::integrate_pair`].
    fn pair(&self, [begin, end]: [f64; 2]) -> Seen {
        let at = |offset: f64| self.light(begin + offset * (end - begin));
        let [(near, near_color), (far, far_color)] = [at(GAUSS_OFFSET), at(1.0 - GAUSS_OFFSET)];
        let tau = 0.5 * (near + far) * self.length * (end - begin);
        if tau <= 0.0 {
            return (DVec3::ZERO, 1.0);
        }
        let far = far * (-tau * GAUSS_DISTANCE).exp().max(f64::MIN_POSITIVE);
        let opacity = -(-tau).exp_m1();
        ((near * near_color + far * far_color) * (opacity / (near + far)), 1.0 - opacity)
    }

    /// Extinction and colour at a place.
    fn light(&self, u: f64) -> (f64, DVec3) {
        let value = cubic_at(&self.cubic, u).clamp(self.range[0], self.range[1]);
        let (color, alpha) = self.transfer_function.classify(value);
        let color = match self.lighting {
            Some(lighting) if alpha > 0.0 => match self.gradient_at(u) {
                Some(gradient) => self.lit(lighting, color.into(), gradient),
                None => color.into(),
            },
            _ => color.into(),
        };
        (self.transfer_function.kappa(alpha), color)
    }

    fn gradient_at(&self, u: f64) -> Option<DVec3> {
        let gradient = self.gradient.as_ref()?;
        Some(self.world_from_index * DVec3::from_array(gradient.map(|cubic| cubic_at(&cubic, u))))
    }

    /// The colour after shading. See [`super::shade::shade`].
    fn lit(&self, lighting: &Lighting, color: DVec3, gradient: DVec3) -> DVec3 {
        let length = gradient.length();
        if length == 0.0 || length < f64::from(lighting.gradient_floor) {
            return color;
        }
        let [diffuse, specular] = self.light_of(lighting, gradient / -length);
        (color * diffuse + specular).clamp(DVec3::ZERO, DVec3::ONE)
    }

    /// Diffuse light with the ambient one, and specular light, on a surface with this normal.
    fn light_of(&self, lighting: &Lighting, normal: DVec3) -> [f64; 2] {
        let (mut diffuse, mut specular) = (f64::from(lighting.ambient), 0.0);
        for &(to_light, half, intensity) in &self.lights {
            diffuse += f64::from(lighting.diffuse) * normal.dot(to_light).abs() * intensity;
            let shine = normal.dot(half).abs().powf(f64::from(lighting.shininess));
            specular += f64::from(lighting.specular) * shine * intensity;
        }
        [diffuse, specular]
    }

    /// Whether all of a part with this opacity has a normal that turns little, and colours that are cut off or are not; or none of it has
    /// a normal.
    fn is_evenly_lit(&self, part: [f64; 2], opacity: f64) -> bool {
        let (Some(lighting), Some(cubics)) = (self.lighting, &self.gradient) else { return true };
        match self.turn(lighting, cubics, part) {
            Turn::Dark => true,
            Turn::Unknown => false,
            Turn::Within(angle) => {
                let shininess = f64::from(lighting.shininess);
                let most = NORMAL_CHANGE / (shininess / WIDE_SHININESS).max(1.0).sqrt();
                2.0 * angle <= most && opacity * self.cut_in_part(lighting, part, angle) < AGREEMENT
            }
        }
    }

    /// Angle between the normal in the middle of a part and that anywhere in it, at most: the way of the gradient over its least length.
    fn turn(&self, lighting: &Lighting, cubics: &[[Real; 4]; 3], [begin, end]: [f64; 2]) -> Turn {
        let (u, half) = (0.5 * (begin + end), 0.5 * (end - begin));
        let length = |of: fn(&[f64; 4], f64) -> f64| {
            (self.world_from_index * DVec3::from_array(cubics.map(|cubic| of(&cubic, u)))).length()
        };
        let long = length(cubic_at);
        let slope = length(|k, u| k[1] + u * (2.0 * k[2] + u * 3.0 * k[3]));
        let bow = length(|k, u| 2.0 * k[2] + u * 6.0 * k[3]);
        let third = length(|k, _| 6.0 * k[3]);
        let away = half * (slope + half * (bow + half * third));
        let floor = f64::from(lighting.gradient_floor);
        if long + away < floor {
            Turn::Dark
        } else if long - away < floor || away >= long {
            Turn::Unknown
        } else {
            Turn::Within(away / (long - away))
        }
    }

    /// Greatest effect on a colour if a part is cut off at 1 in some of it only: 0 if all of it is, or none.
    fn cut_in_part(&self, lighting: &Lighting, [begin, end]: [f64; 2], angle: f64) -> f64 {
        let middle = 0.5 * (begin + end);
        let Some(gradient) = self.gradient_at(middle) else { return 0.0 };
        let [diffuse, specular] = self.light_of(lighting, gradient.normalize_or_zero());
        let light: f64 = self.lights.iter().map(|&(.., intensity)| intensity).sum();
        // The steepest slope of a power of a cosine is at most the root of the exponent; of exponents below 1 it has no limit.
        let shininess = f64::from(lighting.shininess);
        let steepest = if shininess < 1.0 { f64::INFINITY } else { shininess.sqrt() };
        let dimmer = angle * light * f64::from(lighting.diffuse);
        let duller = light * f64::from(lighting.specular) * (angle * steepest).min(1.0);
        let [least, most] = self.colors([begin, end]);
        let low = least * (diffuse - dimmer).max(0.0) + (specular - duller).max(0.0);
        let high = most * (diffuse + dimmer) + specular + duller;
        (high - 1.0).min(1.0 - low).max_element().max(0.0)
    }

    /// Least and greatest colour of a part between two control points, channel by channel: colours are linear in the value there.
    fn colors(&self, [begin, end]: [f64; 2]) -> [DVec3; 2] {
        let value = |u: f64| cubic_at(&self.cubic, u).clamp(self.range[0], self.range[1]);
        let middle = value(0.5 * (begin + end));
        let points = self.transfer_function.points();
        let next = points.partition_point(|point| point.value <= middle);
        let color: DVec3 = self.transfer_function.classify(middle).0.into();
        let (Some(before), Some(after)) = (next.checked_sub(1).map(|i| points[i]), points.get(next)) else {
            return [color; 2];
        };
        let turns = self.turns.as_slice().iter().copied().filter(|&u| begin < u && u < end);
        let [a, b] = [before, *after].map(|point| DVec3::from(point.color));
        turns.chain([begin, end]).fold([color; 2], |[least, most], u| {
            let share = ((value(u) - before.value) / (after.value - before.value)).clamp(0.0, 1.0);
            let color = a.lerp(b, share);
            [least.min(color), most.max(color)]
        })
    }
}

/// Turn of the normal in a part.
enum Turn {
    /// None of it has a normal.
    Dark,
    /// Some of it may have none.
    Unknown,
    /// Angle from the normal in the middle, at most, in radians.
    Within(f64),
}

/// Adds the places at which a cubic has a value. `ends`: those of its monotone intervals.
pub(super) fn add_crossings(cuts: &mut Vec<f64>, cubic: &[Real; 4], ends: &[f64], value: f64) {
    cuts.extend(ends.windows(2).filter_map(|ends| monotone_root(cubic, ends[0], ends[1], value)));
}

/// Corners of which none is absent that has a weight on the chord from `a` to `b`.
pub(super) fn present(mut corners: [f64; 8], a: [Real; 3], b: [Real; 3]) -> Option<[f64; 8]> {
    if corners.iter().any(|c| c.is_nan()) {
        replace_unreached(&mut corners, a, b);
    }
    (!corners.iter().any(|c| c.is_nan())).then_some(corners)
}

fn behind((color, transmittance): Seen, (next, through): Seen) -> Seen {
    (color + transmittance * next, transmittance * through)
}
