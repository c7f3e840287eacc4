//! Parsers of positions in a volume: voxels, line numbers, times, depths, world coordinates, planes of a patient.

use glam::DVec3;
use supervol_arguments::failure::Failure;
use supervol_arguments::quantity::{self, WrittenBox};
use supervol_format::Container;
use supervol_scene::facts::{Frame, VolumeFacts};
use supervol_scene::preset;
use supervol_scene::preset::placing::axis_along;
use supervol_sources::Survey;

/// Position along a named axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Place {
    axis: String,
    /// Position in units of the axis; `None`: the middle voxel.
    at: Option<f64>,
}

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

/// A box: voxels, or ranges of named axes.
#[derive(Debug, Clone, PartialEq)]
pub enum Crop {
    /// Box as on the command line.
    Voxels(WrittenBox),
    /// Name, from, to.
    Named(Vec<(String, f64, f64)>),
}

/// `AXIS=PLACE`, or `AXIS=middle`.
pub fn place(text: &str) -> Result<Place, String> {
    let parsed = text.split_once('=').and_then(|(axis, at)| {
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
        let scale = Scale::of(&self.axis, container, facts)?;
        let axis = scale.axis;
        // The middle is a voxel: of two middle voxels, the first.
        let middle = ((facts.dims.0[axis] - 1) / 2) as f64;
        let at = self.at.map_or(middle, |at| scale.index(at));
        let [low, high] = preset::domain(facts);
        if (low[axis]..=high[axis]).contains(&at) {
            return Ok((axis, at));
        }
        let ends = [low[axis] + 0.5, high[axis] - 0.5].map(|index| scale.place(index));
        Err(Failure::Command(format!(
            "{self} lies outside the volume: {} runs from {} to {}",
            self.axis,
            ends[0].min(ends[1]),
            ends[0].max(ends[1])
        )))
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
                    let scale = Scale::of(name, container, facts)?;
                    let ends = [scale.index(*from), scale.index(*to)];
                    let axis = scale.axis;
                    low[axis] = low[axis].max(ends[0].min(ends[1]));
                    high[axis] = high[axis].min(ends[0].max(ends[1]));
                    if low[axis] >= high[axis] {
                        let first = scale.place(0.0);
                        let last = scale.place(facts.dims.0[axis] as f64 - 1.0);
                        return Err(Failure::Command(format!(
                            "--crop {name}={from}:{to} leaves nothing: {name} runs from {} to {}",
                            first.min(last),
                            first.max(last)
                        )));
                    }
                }
            }
        }
        Ok([low, high])
    }
}

/// Names and values of line numbers and time or depth at an index point; empty if the volume is no survey.
pub fn lines(index: [f64; 3], container: &Container, facts: &VolumeFacts) -> Result<Vec<(String, f64)>, Failure> {
    if Survey::of(container.manifest()).is_none() {
        return Ok(Vec::new());
    }
    let third = container.manifest().axes[2].name.as_str().to_owned();
    let place = |name: String| {
        let scale = Scale::of(&name, container, facts)?;
        Ok((name, scale.place(index[scale.axis])))
    };
    ["inline".into(), "crossline".into(), third].into_iter().map(place).collect()
}

/// Scale of a grid axis under one of its names: place = first + index * step.
struct Scale {
    axis: usize,
    first: f64,
    step: f64,
}

impl Scale {
    fn of(name: &str, container: &Container, facts: &VolumeFacts) -> Result<Self, Failure> {
        if let Some(axis) = ["i", "j", "k"].iter().position(|n| *n == name) {
            return Ok(Self { axis, first: 0.0, step: 1.0 });
        }
        let manifest = container.manifest();
        let survey = Survey::of(manifest);
        if let Some(survey) = &survey {
            let names = ["crossline", "inline", manifest.axes[2].name.as_str()];
            if let Some(axis) = names.iter().position(|known| *known == name) {
                let [first, step] = survey.scales()[axis];
                return Ok(Self { axis, first, step });
            }
        }
        if let Some(world) = world_axis(name, facts.frame) {
            return Ok(Self::world(world, facts));
        }
        Err(Failure::Command(format!("'{name}' is no axis of this volume: expected {}", names(container, facts))))
    }

    /// Scale of the grid axis nearest to a world axis: its world coordinate on the line through the middle.
    fn world(world: usize, facts: &VolumeFacts) -> Self {
        let linear = facts.geometry.linear();
        let axis = axis_along(world, facts);
        let mut middle = DVec3::from_array(facts.dims.0.map(|n| 0.5 * (n as f64 - 1.0)));
        middle[axis] = 0.0;
        let first = facts.geometry.world_from_index().transform_point3(middle)[world];
        Self { axis, first, step: linear.col(axis)[world] }
    }

    fn index(&self, place: f64) -> f64 {
        (place - self.first) / self.step
    }

    fn place(&self, index: f64) -> f64 {
        self.first + index * self.step
    }
}

/// World axis of a name.
fn world_axis(name: &str, frame: Frame) -> Option<usize> {
    if let Some(axis) = ["x", "y", "z"].iter().position(|n| *n == name) {
        return Some(axis);
    }
    ["sagittal", "coronal", "axial"].iter().position(|n| *n == name).filter(|_| frame.is_patient())
}

fn names(container: &Container, facts: &VolumeFacts) -> String {
    let third = container.manifest().axes[2].name.as_str();
    match facts.frame {
        Frame::Survey if container.manifest().survey.is_some() => {
            format!("inline, crossline, {third}, i, j, k, x, y or z")
        }
        frame if frame.is_patient() => "sagittal, coronal, axial, i, j, k, x, y or z".into(),
        _ => "i, j, k, x, y or z".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_and_boxes_are_read() {
        assert_eq!(place("Inline = 1200"), Ok(Place { axis: "inline".into(), at: Some(1200.0) }));
        assert_eq!(place("axial= Middle"), Ok(Place { axis: "axial".into(), at: None }));
        assert_eq!(place("axial=middle").map(|place| place.to_string()).as_deref(), Ok("axial=middle"));
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
