//! Parsers of positions in a volume: voxels, line numbers, times, depths, world coordinates, planes of a patient. Their
//! meaning is that of [`Coordinates`].

use clap::ValueEnum;
use glam::DVec3;
use supervol_arguments::failure::Failure;
use supervol_arguments::quantity::{self, WrittenBox};
use supervol_format::cast::whole;
use supervol_format::coordinates::{AxisScale, Coordinates, ScaleKind};
use supervol_format::readable::{Number, Shortened};
use supervol_format::{Container, Dims, Level, VoxelBox};
use supervol_scene::facts::VolumeFacts;
use supervol_scene::preset;

/// Position along a named axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Place {
    axis: String,
    /// Position in units of the axis; `None`: the middle voxel.
    at: Option<f64>,
}

/// Greatest distance from a voxel's centre, in voxels, that counts as rounding.
const ROUNDED_INDEX: f64 = 1e-6;
/// Word for the middle voxel of an axis.
const MIDDLE: &str = "middle";

impl std::fmt::Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.at {
            Some(at) => write!(f, "{}={at}", self.axis),
            None => write!(f, "{}={MIDDLE}", self.axis),
        }
    }
}

/// Plane of a slice.
#[derive(Debug, Clone, PartialEq)]
pub enum Cut {
    /// Across an axis.
    Across(Place),
    /// Any plane, in world coordinates.
    Plane {
        normal: [f64; 3],
        /// Point on the plane; `None`: the middle of the volume.
        through: Option<[f64; 3]>,
    },
}

impl std::fmt::Display for Cut {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let list = |numbers: &[f64; 3]| numbers.map(|n| n.to_string()).join(",");
        match self {
            Self::Across(place) => place.fmt(f),
            Self::Plane { normal, through: None } => write!(f, "normal={}", list(normal)),
            Self::Plane { normal, through: Some(point) } => write!(f, "normal={}@{}", list(normal), list(point)),
        }
    }
}

/// Coordinates in which planes are given.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PlaneCoordinates {
    /// The map of a survey, the millimetres of a patient, else the world: as --pick prints them
    Place,
    /// The volume's own world, in which pictures are drawn
    Local,
}

impl PlaneCoordinates {
    /// The plane `normal . p = offset` of these coordinates in the drawn world: normal and offset.
    ///
    /// Let P map index points to the place, and W to the drawn world. A point x of the world is at `P W^-1 x = M x + t`,
    /// so the plane is `(M^T n) . x = offset - n . t`. Volumes whose place is the drawn world keep their numbers.
    pub fn plane_in_world(
        self,
        normal: [f64; 3],
        offset: f64,
        container: &Container,
        facts: &VolumeFacts,
    ) -> ([f64; 3], f64) {
        let coordinates = Coordinates::of(container);
        let place = coordinates.map().unwrap_or_else(|| container.stored_geometry());
        if self == Self::Local || place == facts.geometry {
            return (normal, offset);
        }
        let world = facts.geometry.world_from_index().inverse();
        let place_from_world = place.world_from_index() * world;
        let given = DVec3::from_array(normal);
        let normal = place_from_world.matrix3.transpose() * given;
        (normal.to_array(), offset - given.dot(place_from_world.translation))
    }
}

/// A box: voxels, or ranges of named axes.
#[derive(Debug, Clone, PartialEq)]
pub enum Crop {
    /// Box as on the command line.
    Voxels(WrittenBox),
    /// Name, from, to.
    Named(Vec<(String, f64, f64)>),
}

/// `AXIS=PLACE`, or `AXIS=middle`; a space may stand for the equals sign.
pub fn place(text: &str) -> Result<Place, String> {
    let parts = text.split_once('=').or_else(|| text.trim().split_once(char::is_whitespace));
    let parsed = parts.and_then(|(axis, at)| {
        let is_middle = at.trim().eq_ignore_ascii_case(MIDDLE);
        Some((axis.trim(), if is_middle { None } else { Some(finite(at)?) }))
    });
    let (axis, at) = parsed.ok_or_else(|| {
        format!("'{text}': expected AXIS=PLACE, such as inline=1200, axial=-40, k=17 or coronal={MIDDLE}")
    })?;
    Ok(Place { axis: axis.to_lowercase(), at })
}

/// `AXIS=PLACE`, or `normal=NX,NY,NZ`, optionally with `@X,Y,Z` for a point on the plane.
pub fn slice(text: &str) -> Result<Cut, String> {
    let Some(rest) = text.trim().strip_prefix("normal=") else { return place(text).map(Cut::Across) };
    let expected = || {
        format!(
            "'{text}': expected normal=NX,NY,NZ or normal=NX,NY,NZ@X,Y,Z: a normal (not all zero) and a point in world units"
        )
    };
    let triple = |text: &str| -> Option<[f64; 3]> {
        let numbers: Option<Vec<f64>> = text.split(',').map(finite).collect();
        numbers?.try_into().ok()
    };
    let (normal, through) = match rest.split_once('@') {
        Some((normal, through)) => (normal, Some(triple(through).ok_or_else(expected)?)),
        None => (rest, None),
    };
    let normal = triple(normal).filter(|normal| *normal != [0.0; 3]).ok_or_else(expected)?;
    Ok(Cut::Plane { normal, through })
}

/// `I0:I1,J0:J1,K0:K1`, or `AXIS=FROM:TO,...`.
pub fn crop(text: &str) -> Result<Crop, String> {
    if !text.contains('=') {
        return quantity::voxel_box(text).map(Crop::Voxels);
    }
    let range = |part: &str| {
        let parsed = part.split_once('=').and_then(|(axis, range)| {
            let (from, to) = range.split_once(':')?;
            Some((axis.trim().to_lowercase(), finite(from)?, finite(to)?))
        });
        let parsed = parsed.filter(|(_, from, to)| from < to);
        parsed.ok_or_else(|| format!("'{part}': expected AXIS=FROM:TO with FROM < TO, such as inline=100:200"))
    };
    text.split(',').map(range).collect::<Result<_, _>>().map(Crop::Named)
}

fn finite(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|v: &f64| v.is_finite())
}

impl Place {
    /// Axis of the grid, and index coordinate along it.
    pub fn on_grid(&self, container: &Container, facts: &VolumeFacts) -> Result<(usize, f64), Failure> {
        let scale = scale_of(&self.axis, container)?;
        let axis = scale.axis;
        // The middle is a voxel: of two middle voxels, the first.
        let middle = ((facts.dims.0[axis] - 1) / 2) as f64;
        let at = self.at.map_or(middle, |at| scale.index(at));
        let [low, high] = preset::domain(facts);
        if (low[axis]..=high[axis]).contains(&at) {
            return Ok((axis, at));
        }
        Err(Failure::Command(format!("{self} lies outside the volume: {}", extent(&scale))))
    }

    /// Note for a place between two lines; `None` on a line, and for times and lengths.
    fn note(&self, container: &Container) -> Option<String> {
        let scale = Coordinates::of(container).scale(&self.axis)?;
        let [before, after] = scale.between(self.at?)?.map(|at| Shortened::along(at, scale.step));
        let name = &self.axis;
        Some(format!("{self} lies between {name} {before} and {name} {after}: its values are interpolated"))
    }
}

impl Crop {
    /// Corners of the box in index coordinates, including the faces of its voxels.
    pub fn in_voxels(&self, container: &Container, facts: &VolumeFacts) -> Result<[[f64; 3]; 2], Failure> {
        let [mut low, mut high] = preset::domain(facts);
        match self {
            Self::Voxels(written) => {
                let voxels = written.within(facts.dims);
                // From face to face of the voxels.
                let corners = [voxels.start, voxels.end].map(|corner| corner.map(|v| v as f64 - 0.5));
                let outside =
                    (0..3).any(|a| corners[0][a] < low[a] || corners[1][a] > high[a] || corners[0][a] >= corners[1][a]);
                if outside {
                    return Err(Failure::Command(format!(
                        "--crop: expected a box inside the volume, which has {} voxels",
                        facts.dims
                    )));
                }
                return Ok(corners);
            }
            Self::Named(ranges) => {
                for (name, from, to) in ranges {
                    let scale = scale_of(name, container)?;
                    let ends = [scale.index(*from), scale.index(*to)];
                    let axis = scale.axis;
                    low[axis] = low[axis].max(ends[0].min(ends[1]));
                    high[axis] = high[axis].min(ends[0].max(ends[1]));
                    if low[axis] >= high[axis] {
                        return Err(Failure::Command(format!(
                            "--crop {name}={from}:{to} leaves nothing: {}",
                            extent(&scale)
                        )));
                    }
                }
            }
        }
        Ok([low, high])
    }

    /// The voxels of a level whose centres lie in the box, both ends of named ranges included.
    pub fn of_level(&self, container: &Container, level: &Level) -> Result<VoxelBox, Failure> {
        let Dims(dims) = level.dims;
        let ranges = match self {
            Self::Voxels(written) => return Ok(written.within(level.dims)),
            Self::Named(ranges) => ranges,
        };
        let (mut start, mut end) = ([0; 3], dims);
        for (name, from, to) in ranges {
            let scale = scale_of(name, container)?;
            let axis = scale.axis;
            let ends = [scale.index(*from), scale.index(*to)];
            // Index coordinate of a level-0 point on the level's axis.
            let [low, high] = [ends[0].min(ends[1]), ends[0].max(ends[1])].map(|at| {
                let mut point = [0.0; 3];
                point[axis] = at;
                level.from_level_0(point)[axis]
            });
            let low = (low - ROUNDED_INDEX).ceil().max(0.0);
            let high = (high + ROUNDED_INDEX).floor().min(dims[axis] as f64 - 1.0);
            if low > high {
                let message = format!("--box {name}={from}:{to} holds no voxel of this level: {}", extent(&scale));
                return Err(Failure::Command(message));
            }
            start[axis] = start[axis].max(whole(low));
            end[axis] = end[axis].min(whole::<u64>(high) + 1);
        }
        if (0..3).any(|axis| start[axis] >= end[axis]) {
            return Err(Failure::Command("--box: the ranges leave no voxel".into()));
        }
        Ok(VoxelBox { start, end })
    }
}

impl Cut {
    /// Note for the user about the position; `None` if there is nothing to say.
    pub fn note(&self, container: &Container) -> Option<String> {
        match self {
            Self::Across(place) => place.note(container),
            Self::Plane { .. } => None,
        }
    }
}

/// The scale of a named axis.
fn scale_of(name: &str, container: &Container) -> Result<AxisScale, Failure> {
    let coordinates = Coordinates::of(container);
    let expected = || {
        let names = coordinates.names();
        Failure::Command(format!("'{name}' is no axis of this volume: expected {names}"))
    };
    coordinates.scale(name).ok_or_else(expected)
}

/// First and last coordinate of an axis, in words.
fn extent(scale: &AxisScale) -> String {
    let [least, greatest] = scale.ends().map(|at| Shortened::along(at, scale.step));
    let step = match scale.kind {
        ScaleKind::Counted if scale.step.abs() != 1.0 => format!(" in steps of {}", Number(scale.step.abs())),
        _ => String::new(),
    };
    format!("{} runs from {least} to {greatest} {}", scale.name, scale.unit).trim_end().to_owned() + &step
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_and_boxes_are_read() {
        assert_eq!(place("Inline = 1200"), Ok(Place { axis: "inline".into(), at: Some(1200.0) }));
        assert_eq!(place("axial= Middle"), Ok(Place { axis: "axial".into(), at: None }));
        assert_eq!(place("axial=middle").map(|place| place.to_string()).as_deref(), Ok("axial=middle"));
        assert_eq!(place(" inline  1200 "), place("inline=1200"));
        assert!(place("inline").is_err() && place("k=x").is_err() && place("k=middles").is_err());
        let plane = Cut::Plane { normal: [1.0, 0.0, -1.5], through: Some([3.0, 4.0, 5.0]) };
        assert_eq!(slice("normal=1,0,-1.5@3,4,5").as_ref(), Ok(&plane));
        assert_eq!(plane.to_string(), "normal=1,0,-1.5@3,4,5");
        assert!(
            matches!(slice("k=3"), Ok(Cut::Across(_)))
                && slice("normal=0,0,0").is_err()
                && slice("normal=1,2").is_err()
        );
        assert!(matches!(crop("0:2,1:3,4:9"), Ok(Crop::Voxels(_))) && matches!(crop(":,:,4"), Ok(Crop::Voxels(_))));
        assert_eq!(crop("inline=1:2,z=-3:4").map(|c| matches!(c, Crop::Named(r) if r.len() == 2)), Ok(true));
        assert!(crop("inline=2:1").is_err() && crop("0:2").is_err());
    }
}
