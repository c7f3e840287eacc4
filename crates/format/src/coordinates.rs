//! Coordinates of a volume: the numbers by which a user names its places. Axes of pictures, read-outs, options, the
//! controls of the viewer and exported meshes all take them from here.
//!
//! - *Along an axis of the grid*: crossline and inline numbers, time or depth of a survey; for other volumes the
//!   coordinate of the nearest world axis, such as patient millimetres, on the line through the volume's middle.
//! - *Of a point*: easting, northing, and time or depth of a survey whose lines have positions on the map; for other
//!   volumes the world position.
//!
//! Indices are those of level 0. Numbers are those of the stored geometry: vertical exaggeration changes none of them.

use glam::DVec3;

use crate::container::manifest::Manifest;
use crate::container::reader::Container;
use crate::space::{Dims, Geometry, WorldSpace};
use crate::survey::{LineNumbers, Survey};

/// Names of the axes of the grid in voxels.
const VOXEL_NAMES: [&str; 3] = ["i", "j", "k"];
/// Names of the world axes.
const WORLD_NAMES: [&str; 3] = ["x", "y", "z"];
/// Names of the sections across the world axes of a patient.
const SECTION_NAMES: [&str; 3] = ["sagittal", "coronal", "axial"];
/// Greatest distance of the fourth corner of a survey from that of a parallelogram, as a share of the diagonal.
const CORNER_SHARE: f64 = 0.01;
/// Greatest distance from a whole index, in voxels, that counts as rounding.
const ROUNDED_INDEX: f64 = 1e-6;

/// Scale of an axis of the grid: the coordinate of index `i` is `first + i * step`.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisScale {
    /// The axis of the grid: 0, 1 or 2.
    pub axis: usize,
    /// Name, such as `inline`, `time` or `x`.
    pub name: String,
    /// Unit of the coordinate; empty if it has none.
    pub unit: String,
    /// Coordinate of voxel 0.
    pub first: f64,
    /// Coordinate difference of neighbouring voxels; not zero.
    pub step: f64,
    /// Number of voxels.
    pub count: u64,
    /// Meaning of coordinates between voxels.
    pub kind: ScaleKind,
}

/// Meaning of coordinates between voxels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ScaleKind {
    /// Numbers of lines or voxels: numbers in between are interpolated.
    Counted,
    /// Lengths or times.
    Measured,
}

impl AxisScale {
    /// Coordinate of an index.
    #[must_use]
    pub fn place(&self, index: f64) -> f64 {
        self.first + index * self.step
    }

    /// Index of a coordinate.
    #[must_use]
    pub fn index(&self, place: f64) -> f64 {
        (place - self.first) / self.step
    }

    /// Least and greatest coordinate of voxels.
    #[must_use]
    pub fn ends(&self) -> [f64; 2] {
        let [first, last] = [0.0, self.count.saturating_sub(1) as f64].map(|index| self.place(index));
        [first.min(last), first.max(last)]
    }

    /// The neighbouring lines between which a coordinate lies; `None` on a line, between times or lengths, and outside.
    #[must_use]
    pub fn between(&self, place: f64) -> Option<[f64; 2]> {
        let index = self.index(place);
        let is_between = (index - index.round()).abs() > ROUNDED_INDEX;
        let is_inside = (0.0..=self.count.saturating_sub(1) as f64).contains(&index);
        let lines = [index.floor(), index.ceil()].map(|index| self.place(index));
        (self.kind == ScaleKind::Counted && is_between && is_inside)
            .then(|| [lines[0].min(lines[1]), lines[0].max(lines[1])])
    }
}

/// Coordinates of one volume; see the module.
#[derive(Debug, Clone, PartialEq)]
pub struct Coordinates {
    dims: Dims,
    geometry: Geometry,
    axes: [AxisScale; 3],
    /// World axis nearest to each axis of the grid; each occurs once.
    world_axes: [usize; 3],
    is_survey: bool,
    is_patient: bool,
    map: Option<Geometry>,
    /// Whether the map has a unit of length.
    has_lengths: bool,
}

impl Coordinates {
    /// The coordinates of a container.
    #[must_use]
    pub fn of(container: &Container) -> Self {
        Self::new(container.descriptor().dims(), container.stored_geometry(), container.manifest())
    }

    /// The coordinates of a volume with this grid.
    #[must_use]
    pub fn new(dims: Dims, geometry: Geometry, manifest: &Manifest) -> Self {
        let survey = Survey::of(manifest);
        let world_axes = world_axes(&geometry);
        let scale = |axis: usize| match &survey {
            Some(survey) => {
                let [first, step] = survey.scales()[axis];
                let (kind, unit) = match axis {
                    2 => (ScaleKind::Measured, manifest.axes[2].unit.clone()),
                    _ => (ScaleKind::Counted, String::new()),
                };
                let name = manifest.axes[axis].name.clone();
                AxisScale { axis, name, unit, first, step, count: dims.0[axis], kind }
            }
            None => {
                let world = world_axes[axis];
                let named = &manifest.axes[axis];
                let is_plain = named.name.is_empty() || WORLD_NAMES.contains(&&*named.name);
                let name = if is_plain { WORLD_NAMES[world].into() } else { named.name.clone() };
                AxisScale { name, unit: named.unit.clone(), ..world_scale(axis, world, dims, &geometry) }
            }
        };
        let map = survey.as_ref().and_then(|survey| map_geometry(survey, &geometry));
        Self {
            dims,
            geometry,
            axes: [0, 1, 2].map(scale),
            world_axes,
            is_survey: survey.is_some(),
            is_patient: WorldSpace::from_name(&manifest.space) != WorldSpace::Unknown,
            map,
            has_lengths: manifest.axes[..2].iter().any(|axis| !axis.unit.is_empty()),
        }
    }

    /// Scales of the axes of the grid.
    #[must_use]
    pub fn axes(&self) -> &[AxisScale; 3] {
        &self.axes
    }

    /// Whether the axes are the lines and samples of a survey.
    #[must_use]
    pub fn are_lines(&self) -> bool {
        self.is_survey
    }

    /// Name of the section across an axis of the grid: for a patient, such as `axial (z)`; else the name of the axis.
    #[must_use]
    pub fn section_name(&self, axis: usize) -> String {
        let name = &self.axes[axis].name;
        if self.is_patient { format!("{} ({name})", SECTION_NAMES[self.world_axes[axis]]) } else { name.clone() }
    }

    /// The scale with this name in lower case; `None` if the volume has no such axis.
    ///
    /// Names: i, j, k (voxels), those of the axes, x, y, z (world), and the sections of a patient.
    #[must_use]
    pub fn scale(&self, name: &str) -> Option<AxisScale> {
        if let Some(axis) = VOXEL_NAMES.iter().position(|known| *known == name) {
            let (count, kind) = (self.dims.0[axis], ScaleKind::Counted);
            return Some(AxisScale {
                axis,
                name: name.into(),
                unit: String::new(),
                first: 0.0,
                step: 1.0,
                count,
                kind,
            });
        }
        if let Some(scale) = self.axes.iter().find(|scale| scale.name.to_lowercase() == name) {
            return Some(scale.clone());
        }
        let sections = SECTION_NAMES.iter().position(|known| *known == name).filter(|_| self.is_patient);
        let world = WORLD_NAMES.iter().position(|known| *known == name).or(sections)?;
        let axis = self.world_axes.iter().position(|known| *known == world)?;
        let unit = if self.is_survey { String::new() } else { self.axes[axis].unit.clone() };
        Some(AxisScale { name: name.into(), unit, ..world_scale(axis, world, self.dims, &self.geometry) })
    }

    /// Names that [`Self::scale`] knows, for messages.
    #[must_use]
    pub fn names(&self) -> String {
        let mut names: Vec<&str> = Vec::new();
        if self.is_survey {
            names.extend([1, 0, 2].map(|axis: usize| &*self.axes[axis].name));
        } else {
            names.extend(self.axes.iter().map(|scale| &*scale.name).filter(|name| !WORLD_NAMES.contains(name)));
        }
        if self.is_patient {
            names.extend(SECTION_NAMES);
        }
        names.extend(VOXEL_NAMES);
        names.extend(WORLD_NAMES);
        let last = names.pop().unwrap_or_default();
        format!("{} or {last}", names.join(", "))
    }

    /// The grid on the map, if the survey has positions there in a unit of length: x is easting, y northing, z time or depth downwards.
    #[must_use]
    pub fn map(&self) -> Option<Geometry> {
        self.map.filter(|_| self.has_lengths)
    }

    /// Names and coordinates of a point by its index: see the module.
    #[must_use]
    pub fn point(&self, index: [f64; 3]) -> [(&str, f64); 3] {
        let (geometry, names) = match self.map() {
            Some(map) => (map, ["easting", "northing", &self.axes[2].name]),
            None => (self.geometry, WORLD_NAMES),
        };
        let place = geometry.world_from_index().transform_point3(DVec3::from_array(index)).to_array();
        [0, 1, 2].map(|a| (names[a], place[a]))
    }

    /// World position of an index in the stored geometry.
    #[must_use]
    pub fn world(&self, index: [f64; 3]) -> [f64; 3] {
        self.geometry.world_from_index().transform_point3(DVec3::from_array(index)).to_array()
    }

    /// Index offsets of a step of length 1 to the east and to the north, for a survey with positions on the map.
    #[must_use]
    pub fn compass(&self) -> Option<[DVec3; 2]> {
        let inverse = self.map?.linear().inverse();
        Some([inverse * DVec3::X, inverse * DVec3::Y])
    }
}

/// World axis nearest to each axis of the grid. The most parallel pair is matched first, so that each occurs once.
fn world_axes(geometry: &Geometry) -> [usize; 3] {
    let linear = geometry.linear();
    let along: [[f64; 3]; 3] = [0, 1, 2].map(|axis| linear.col(axis).normalize_or_zero().abs().to_array());
    let mut pairs: Vec<(usize, usize)> = (0..9).map(|pair| (pair / 3, pair % 3)).collect();
    pairs.sort_by(|a, b| along[b.0][b.1].total_cmp(&along[a.0][a.1]));
    let mut found: [Option<usize>; 3] = [None; 3];
    for (axis, world) in pairs {
        if found[axis].is_none() && !found.contains(&Some(world)) {
            found[axis] = Some(world);
        }
    }
    [0, 1, 2].map(|axis| found[axis].unwrap_or(axis))
}

/// Scale of a world axis along an axis of the grid, on the line through the volume's middle.
fn world_scale(axis: usize, world: usize, dims: Dims, geometry: &Geometry) -> AxisScale {
    let mut middle = DVec3::from_array(dims.0.map(|n| 0.5 * (n as f64 - 1.0)));
    middle[axis] = 0.0;
    let first = geometry.world_from_index().transform_point3(middle)[world];
    let step = geometry.linear().col(axis)[world];
    let (count, kind) = (dims.0[axis], ScaleKind::Measured);
    AxisScale { axis, name: WORLD_NAMES[world].into(), unit: String::new(), first, step, count, kind }
}

/// The grid of a survey on the map; `None` without corners, or if they form no parallelogram.
fn map_geometry(survey: &Survey, local: &Geometry) -> Option<Geometry> {
    let [first, along_x, along_y, last] = survey.corners?.map(|[x, y]| DVec3::new(x, y, 0.0));
    let (x, y) = (along_x - first, along_y - first);
    let is_askew = (first + x + y - last).length() > CORNER_SHARE * (x + y).length().max((x - y).length());
    if is_askew {
        return None;
    }
    let step = |edge: DVec3, lines: LineNumbers| edge / (lines.count.max(2) - 1) as f64;
    let (mut x, mut y) = (step(x, survey.crossline), step(y, survey.inline));
    // The direction of a single line is perpendicular to the other one. On the map, x, y and depth of the local world
    // are left-handed.
    let turn = if local.is_left_handed() { 1.0 } else { -1.0 };
    let quarter = |v: DVec3, sign: f64| sign * DVec3::new(-v.y, v.x, 0.0).normalize_or_zero();
    match [x.length() > 0.0, y.length() > 0.0] {
        [true, true] => {}
        [true, false] => y = local.spacing[1] * quarter(x, turn),
        [false, true] => x = local.spacing[0] * quarter(y, -turn),
        [false, false] => return None,
    }
    let [dx, dy] = [x, y].map(DVec3::normalize_or_zero);
    let geometry = Geometry {
        spacing: [x.length(), y.length(), survey.sample_interval],
        origin: [first.x, first.y, survey.first_sample],
        direction: [dx.x, dy.x, 0.0, dx.y, dy.y, 0.0, 0.0, 0.0, 1.0],
    };
    geometry.defect().is_none().then_some(geometry)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named(names: [[&str; 2]; 3], space: WorldSpace, survey: Option<Survey>) -> Manifest {
        let axes = names.map(|[name, unit]| serde_json::json!({ "name": name, "unit": unit }));
        let manifest = serde_json::json!({
            "tool": "", "source": { "name": "", "format": "", "bytes": 0, "xxh3_64": "" },
            "parameters": {}, "space": space.name(), "axes": axes, "unit": "", "value_range": null,
            "present_voxels": 0, "histogram": [], "percentiles": [], "level_errors": [], "survey": survey, "notes": []
        });
        serde_json::from_str(&manifest.to_string()).expect("a manifest")
    }

    #[test]
    fn a_patient_is_told_in_millimetres_of_its_space() {
        // A sagittal stack: the grid's axes run to the back, to the feet and to the right.
        let geometry = Geometry {
            spacing: [0.5, 0.75, 3.0],
            origin: [90.0, -120.0, 40.0],
            direction: [0.0, 0.0, -1.0, 1.0, 0.0, 0.0, 0.0, -1.0, 0.0],
        };
        let manifest = named([["x", "mm"], ["y", "mm"], ["z", "mm"]], WorldSpace::LeftPosteriorSuperior, None);
        let coordinates = Coordinates::new(Dims([200, 100, 11]), geometry, &manifest);
        assert_eq!([0, 1, 2].map(|a| coordinates.section_name(a)), ["coronal (y)", "axial (z)", "sagittal (x)"]);
        assert_eq!([0, 1, 2].map(|a| coordinates.axes()[a].ends()), [[-120.0, -20.5], [-34.25, 40.0], [60.0, 90.0]]);
        let axial = coordinates.scale("axial").expect("a patient has axial sections");
        assert_eq!((axial.axis, axial.index(37.0), axial.place(100.0)), (1, 4.0, -35.0));
        assert_eq!(coordinates.scale("z").map(|scale| (scale.axis, scale.index(37.0))), Some((1, 4.0)));
        assert_eq!(coordinates.scale("k").map(|scale| (scale.axis, scale.index(7.0))), Some((2, 7.0)));
        assert_eq!(coordinates.point([2.0, 4.0, 10.0]), [("x", 60.0), ("y", -119.0), ("z", 37.0)]);
        assert_eq!(coordinates.names(), "sagittal, coronal, axial, i, j, k, x, y or z");
        assert!(coordinates.scale("inline").is_none() && coordinates.map().is_none());
    }

    #[test]
    fn axes_with_names_of_their_own_keep_them() {
        let manifest = named([["lon", "degrees"], ["lat", "degrees"], ["depth", "m"]], WorldSpace::Unknown, None);
        let geometry = Geometry { spacing: [0.5, 0.25, 10.0], origin: [4.0, 52.0, 5.0], ..Geometry::IDENTITY };
        let coordinates = Coordinates::new(Dims([9, 8, 7]), geometry, &manifest);
        assert_eq!(coordinates.scale("depth").map(|scale| (scale.axis, scale.index(25.0))), Some((2, 2.0)));
        assert_eq!(coordinates.scale("z").map(|scale| (scale.axis, scale.index(25.0))), Some((2, 2.0)));
        assert_eq!(coordinates.names(), "lon, lat, depth, i, j, k, x, y or z");
    }

    /// Crosslines 300, 302, ... run to the north, inlines 10, 14, ... to the east, both from (5000, 7000).
    fn survey(corners: Option<[[f64; 2]; 4]>) -> Coordinates {
        let lines = |first, step, count| LineNumbers { first, step, count };
        let survey = Survey {
            inline: lines(10, 4, 6),
            crossline: lines(300, 2, 5),
            corners,
            sample_interval: 4.0,
            first_sample: 100.0,
            ..Survey::plain([5, 6], 4.0)
        };
        let names = [["crossline", "m"], ["inline", "m"], ["time", "ms"]];
        let manifest = named(names, WorldSpace::Unknown, Some(survey));
        let geometry = Geometry { spacing: [25.0, 12.5, 4.0], origin: [0.0, 0.0, 100.0], ..Geometry::IDENTITY };
        Coordinates::new(Dims([5, 6, 50]), geometry, &manifest)
    }

    #[test]
    fn a_survey_is_told_in_lines_and_on_the_map() {
        let corners = [[5000.0, 7000.0], [5000.0, 7100.0], [5062.5, 7000.0], [5062.5, 7100.0]];
        let coordinates = survey(Some(corners));
        let inline = coordinates.scale("inline").expect("inlines");
        assert_eq!((inline.axis, inline.index(22.0), inline.ends()), (1, 3.0, [10.0, 30.0]));
        assert_eq!((inline.between(22.0), inline.between(23.0)), (None, Some([22.0, 26.0])));
        assert_eq!((inline.between(9.0), inline.between(31.0)), (None, None));
        assert_eq!(coordinates.axes()[2].place(3.0), 112.0);
        assert_eq!(coordinates.point([4.0, 2.0, 3.0]), [("easting", 5025.0), ("northing", 7100.0), ("time", 112.0)]);
        assert_eq!(coordinates.world([4.0, 2.0, 3.0]), [100.0, 25.0, 112.0]);
        let [east, north] = coordinates.compass().expect("a map");
        assert!((east - DVec3::new(0.0, 0.08, 0.0)).length() < 1e-12 && (north - 0.04 * DVec3::X).length() < 1e-12);
        assert_eq!(coordinates.names(), "inline, crossline, time, i, j, k, x, y or z");
    }

    #[test]
    fn a_map_needs_corners_that_form_a_grid() {
        assert!(survey(None).map().is_none());
        assert!(survey(Some([[0.0, 0.0], [0.0, 100.0], [62.5, 0.0], [70.0, 160.0]])).map().is_none());
        assert_eq!(survey(None).point([1.0, 1.0, 1.0]), [("x", 25.0), ("y", 12.5), ("z", 104.0)]);
        // A single line along the crosslines: the grid is right-handed with depth, so y is to the right of x.
        let line = survey(Some([[0.0, 0.0], [0.0, 100.0], [0.0, 0.0], [0.0, 100.0]]));
        assert_eq!(line.map().map(|map| map.linear().y_axis), Some(DVec3::new(12.5, 0.0, 0.0)));
    }
}
