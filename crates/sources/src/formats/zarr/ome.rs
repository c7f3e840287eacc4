//! OME-Zarr metadata of an image (0.1 to 0.5, and scales and translations of the drafts of 0.6): levels, axes,
//! placement. <https://ngff.openmicroscopy.org>

use serde::Deserialize;
use serde::de::IgnoredAny;
use supervol_format::Geometry;

use crate::Message;

/// Attributes of a group or an array.
#[derive(Debug, Default, Deserialize)]
pub(crate) struct Attributes {
    /// Version 0.5 stores here what 0.4 stores at the top level.
    pub(crate) ome: Option<Box<Self>>,
    multiscales: Option<Vec<Multiscale>>,
    /// Display settings. Errors in them are no reason to refuse the image.
    omero: Option<serde_json::Value>,
    /// Colours and properties of labels: the image is one of labels.
    #[serde(rename = "image-label")]
    image_label: Option<IgnoredAny>,
    pub(crate) plate: Option<IgnoredAny>,
    pub(crate) well: Option<IgnoredAny>,
    #[serde(rename = "bioformats2raw.layout")]
    pub(crate) series: Option<IgnoredAny>,
    /// Names of the axes, as written by xarray.
    #[serde(rename = "_ARRAY_DIMENSIONS")]
    pub(crate) dimensions: Option<Vec<Option<String>>>,
}

impl Attributes {
    /// The images, each with its levels.
    pub(crate) fn images(&self) -> &[Multiscale] {
        let nested = || self.ome.as_ref().and_then(|ome| ome.multiscales.as_deref());
        self.multiscales.as_deref().or_else(nested).unwrap_or_default()
    }

    /// Names of the channels; empty for a channel without a name.
    pub(crate) fn channels(&self) -> Vec<String> {
        let nested = || self.ome.as_ref().and_then(|ome| ome.omero.as_ref());
        let listed = self.omero.as_ref().or_else(nested).and_then(|omero| omero["channels"].as_array());
        let name = |channel: &serde_json::Value| channel["label"].as_str().unwrap_or_default().to_owned();
        listed.map_or_else(Vec::new, |channels| channels.iter().map(name).collect())
    }

    /// Whether the image is one of labels.
    pub(crate) fn is_labels(&self) -> bool {
        self.image_label.is_some() || self.ome.as_ref().is_some_and(|ome| ome.image_label.is_some())
    }

    /// Kind of a collection of several images below this group, if it is one.
    pub(crate) fn collection(&self) -> Option<&'static str> {
        let ome = self.ome.as_deref();
        let any = |has: fn(&Self) -> bool| has(self) || ome.is_some_and(has);
        match () {
            () if any(|a| a.plate.is_some()) => Some("plate of wells"),
            () if any(|a| a.well.is_some()) => Some("well with fields"),
            () if any(|a| a.series.is_some()) => Some("series of images"),
            () => None,
        }
    }
}

/// An image and its levels.
#[derive(Debug, Deserialize)]
pub(crate) struct Multiscale {
    #[serde(default)]
    axes: Vec<OmeAxis>,
    /// Version 0.6.
    #[serde(rename = "coordinateSystems", default)]
    systems: Vec<System>,
    pub(crate) datasets: Vec<Dataset>,
    #[serde(rename = "coordinateTransformations", default)]
    transforms: Vec<Transform>,
}

#[derive(Debug, Deserialize)]
struct System {
    #[serde(default)]
    axes: Vec<OmeAxis>,
}

/// An axis; in 0.3 only its name.
#[derive(Debug, Clone, Deserialize)]
#[serde(untagged)]
enum OmeAxis {
    Name(String),
    Full {
        name: String,
        #[serde(rename = "type", default)]
        kind: Option<String>,
        #[serde(default)]
        unit: Option<String>,
        /// Anatomical orientation: `{"type": "anatomical", "value": "left-to-right"}`, or only the value.
        #[serde(default)]
        orientation: serde_json::Value,
    },
}

/// A level of an image.
#[derive(Debug, Deserialize)]
pub(crate) struct Dataset {
    pub(crate) path: String,
    #[serde(rename = "coordinateTransformations", default)]
    transforms: Vec<Transform>,
}

#[derive(Debug, Deserialize)]
struct Transform {
    #[serde(rename = "type", default)]
    kind: String,
    #[serde(default)]
    scale: Option<Vec<f64>>,
    #[serde(default)]
    translation: Option<Vec<f64>>,
    #[serde(default)]
    transformations: Vec<Transform>,
}

/// Meaning of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Role {
    Space,
    Time,
    Channel,
}

/// An axis of an array.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ArrayAxis {
    pub(crate) name: String,
    pub(crate) role: Role,
    pub(crate) unit: String,
    /// Distance between neighbours, and position of the first element.
    pub(crate) spacing: f64,
    pub(crate) origin: f64,
    /// Direction of the axis in a patient, left-posterior-superior.
    pub(crate) direction: Option<[f64; 3]>,
}

impl ArrayAxis {
    /// An axis about which only its name may be known.
    pub(crate) fn named(name: &str) -> Self {
        let role = match name.to_lowercase().as_str() {
            "t" | "time" => Role::Time,
            "c" | "ch" | "channel" | "channels" | "rgb" => Role::Channel,
            _ => Role::Space,
        };
        Self { name: name.into(), role, unit: String::new(), spacing: 1.0, origin: 0.0, direction: None }
    }
}

impl Multiscale {
    /// The axes of a level with `rank` axes; notes go to `notes`.
    pub(crate) fn axes(&self, level: &Dataset, rank: usize, notes: &mut Vec<Message>) -> Vec<ArrayAxis> {
        let stated = if self.axes.is_empty() { self.systems.last().map_or(&[][..], |s| &s.axes) } else { &self.axes };
        // Before version 0.3 images had these five axes.
        let usual =
            || ["t", "c", "z", "y", "x"][5 - rank.min(5)..].iter().map(|n| OmeAxis::Name((*n).into())).collect();
        let stated: Vec<OmeAxis> = if stated.is_empty() { usual() } else { stated.to_vec() };
        if stated.len() != rank {
            notes.push(format!("{} axes are named, where the array has {rank}: not used", stated.len()).into());
            return vec![ArrayAxis::named(""); rank];
        }
        let mut axes: Vec<ArrayAxis> = stated.iter().map(OmeAxis::plain).collect();
        for transform in level.transforms.iter().chain(&self.transforms) {
            transform.apply(&mut axes, notes);
        }
        axes
    }
}

impl OmeAxis {
    fn plain(&self) -> ArrayAxis {
        let (name, kind, unit, orientation) = match self {
            Self::Name(name) => (name, None, None, &serde_json::Value::Null),
            Self::Full { name, kind, unit, orientation } => (name, kind.as_deref(), unit.as_deref(), orientation),
        };
        let direction = orientation["value"].as_str().or(orientation.as_str()).and_then(direction_of);
        let axis = ArrayAxis::named(name);
        let role = match kind {
            Some("space") => Role::Space,
            Some("time") => Role::Time,
            Some("channel") => Role::Channel,
            _ => axis.role,
        };
        ArrayAxis { role, unit: unit_of(unit.unwrap_or_default()), direction, ..axis }
    }
}

impl Transform {
    fn apply(&self, axes: &mut [ArrayAxis], notes: &mut Vec<Message>) {
        let numbers = |values: &Option<Vec<f64>>| values.clone().filter(|v| v.len() == axes.len());
        match (self.kind.as_str(), numbers(&self.scale), numbers(&self.translation)) {
            ("scale", Some(factors), _) => axes.iter_mut().zip(factors).for_each(|(axis, factor)| {
                axis.spacing *= factor;
                axis.origin *= factor;
            }),
            ("translation", _, Some(ways)) => axes.iter_mut().zip(ways).for_each(|(axis, way)| axis.origin += way),
            ("identity", ..) => {}
            ("sequence", ..) => self.transformations.iter().for_each(|t| t.apply(axes, notes)),
            (other, ..) => {
                notes.push(
                    format!("the transform `{}` is not understood and not used", crate::input::text::shortened(other))
                        .into(),
                );
            }
        }
    }
}

/// Direction of an anatomical orientation, left-posterior-superior.
fn direction_of(orientation: &str) -> Option<[f64; 3]> {
    Some(match orientation {
        "right-to-left" => [1.0, 0.0, 0.0],
        "left-to-right" => [-1.0, 0.0, 0.0],
        "anterior-to-posterior" => [0.0, 1.0, 0.0],
        "posterior-to-anterior" => [0.0, -1.0, 0.0],
        "inferior-to-superior" => [0.0, 0.0, 1.0],
        "superior-to-inferior" => [0.0, 0.0, -1.0],
        _ => return None,
    })
}

/// Geometry in a patient, left-posterior-superior, of three axes that state their anatomical orientation. Origins are
/// distances along the axes.
pub(crate) fn geometry_of_patient(axes: [Option<&ArrayAxis>; 3]) -> Option<Geometry> {
    let directions = axes.map(|axis| axis.and_then(|axis| axis.direction));
    let [Some(x), Some(y), Some(z)] = directions else { return None };
    let Geometry { spacing, origin, direction } = geometry_of(axes);
    let columns = [x, y, z];
    let along = |row: usize| (0..3).map(|axis| columns[axis][row] * origin[axis]).sum::<f64>() + 0.0;
    let turned = |at: usize| columns[at % 3][at / 3] * direction[4 * (at % 3)] + 0.0;
    let geometry = Geometry { spacing, origin: std::array::from_fn(along), direction: std::array::from_fn(turned) };
    geometry.defect().is_none().then_some(geometry)
}

/// Unit in our spelling.
pub(crate) fn unit_of(text: &str) -> String {
    match text {
        "angstrom" => "A",
        "picometer" => "pm",
        "nanometer" => "nm",
        "micrometer" | "micron" | "µm" | "μm" => "um",
        "millimeter" | "millimeters" => "mm",
        "centimeter" | "centimeters" => "cm",
        "meter" | "meters" | "metre" | "metres" => "m",
        "kilometer" | "kilometers" => "km",
        "inch" => "in",
        "foot" | "feet" => "ft",
        "second" | "seconds" => "s",
        "millisecond" | "milliseconds" => "ms",
        "microsecond" => "us",
        "pixel" | "pixels" => "",
        other => other,
    }
    .into()
}

/// Geometry of three axes, each along one world axis. A negative spacing turns the axis round. Others than 0 are
/// required; the check of the geometry refuses 0.
pub(crate) fn geometry_of(axes: [Option<&ArrayAxis>; 3]) -> Geometry {
    let spacing = axes.map(|axis| axis.map_or(1.0, |axis| axis.spacing));
    let origin = axes.map(|axis| axis.map_or(0.0, |axis| axis.origin));
    let mut direction = Geometry::IDENTITY.direction;
    for (axis, spacing) in spacing.iter().enumerate().filter(|(_, spacing)| **spacing < 0.0) {
        direction[4 * axis] = spacing.signum();
    }
    Geometry { spacing: spacing.map(f64::abs), origin, direction }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn anatomical_orientations() {
        let axis = |value: &str| ArrayAxis { direction: direction_of(value), origin: 5.0, ..ArrayAxis::named("") };
        let axes = ["left-to-right", "inferior-to-superior", "anterior-to-posterior"].map(axis);
        let geometry = geometry_of_patient(axes.each_ref().map(Some)).expect("three directions");
        assert_eq!(geometry.direction, [-1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0]);
        assert_eq!(geometry.origin, [-5.0, 5.0, 5.0]);
        // Two axes along one direction span no volume.
        let axes = ["left-to-right", "right-to-left", "anterior-to-posterior"].map(axis);
        assert_eq!(geometry_of_patient(axes.each_ref().map(Some)), None);
        let text = r#"{"name": "x", "type": "space", "orientation": {"type": "anatomical", "value": "left-to-right"}}"#;
        let axis = serde_json::from_str::<OmeAxis>(text).expect("an axis").plain();
        assert_eq!(axis.direction, Some([-1.0, 0.0, 0.0]));
    }

    #[test]
    fn channels_are_called_what_the_image_says() {
        let of = |text: &str| serde_json::from_str::<Attributes>(text).expect("attributes").channels();
        let omero = r#"{"omero": {"channels": [{"label": "DAPI", "color": "0000FF"}, {"active": true}, 7]}}"#;
        assert_eq!(of(omero), ["DAPI", "", ""]);
        assert_eq!(of(&format!(r#"{{"ome": {omero}}}"#)), ["DAPI", "", ""]);
        for wrong in [r#"{}"#, r#"{"omero": 3}"#, r#"{"omero": {"channels": "two"}}"#] {
            assert!(of(wrong).is_empty(), "{wrong}");
        }
    }
}
