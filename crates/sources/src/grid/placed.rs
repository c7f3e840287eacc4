//! A source whose placement in the world the user overrides.

use supervol_format::{Geometry, VoxelBox};

use crate::{Message, ReadOption, SourceError, SourceInfo, VolumeSource};

/// Meaning of a survey's third axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Domain {
    /// Two-way time.
    Time,
    /// Depth.
    Depth,
}

/// Units of time; all other known units are units of length.
pub const TIMES: [&str; 3] = ["s", "ms", "us"];

/// Overridden placement; `None` keeps the value of the file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Placing {
    /// World distance between neighbouring voxels along x, y, z.
    pub spacing: Option<[f64; 3]>,
    /// Unit of the spacing, for all three axes.
    pub unit: Option<String>,
    /// Unit of the third axis of a survey, otherwise of all three axes. The numbers stay the same.
    pub axis_unit: Option<String>,
    /// Meaning of the third axis.
    pub domain: Option<Domain>,
    /// World position of voxel (0, 0, 0).
    pub origin: Option<[f64; 3]>,
    /// Directions of the axes: 3x3 matrix, row-major.
    pub direction: Option<[f64; 9]>,
}

/// A source with an overridden placement.
pub struct PlacedSource {
    source: Box<dyn VolumeSource>,
    info: SourceInfo,
}

impl std::fmt::Debug for PlacedSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("PlacedSource").field("info", &self.info).finish_non_exhaustive()
    }
}

impl PlacedSource {
    /// Places a source and notes each change.
    ///
    /// # Errors
    /// If a spacing is not positive, or the directions are linearly dependent.
    pub fn new(source: Box<dyn VolumeSource>, placing: &Placing) -> Result<Self, SourceError> {
        let mut info = source.info().clone();
        let file = info.geometry;
        let geometry = Geometry {
            spacing: placing.spacing.unwrap_or(file.spacing),
            origin: placing.origin.unwrap_or(file.origin),
            direction: placing.direction.unwrap_or(file.direction),
        };
        if let Some(defect) = geometry.defect() {
            return Err(SourceError::options(defect));
        }
        let changed = [
            ("spacing", geometry.spacing != file.spacing),
            ("origin", geometry.origin != file.origin),
            ("direction", geometry.direction != file.direction),
        ];
        // A raw file has no placement of its own to override.
        if info.format != "raw" {
            for (what, _) in changed.iter().filter(|(_, changed)| *changed) {
                info.notes.push(format!("the {what} was given by hand and is not the file's").into());
            }
        }
        info.geometry = geometry;
        name_axes(&mut info, placing)?;
        Ok(Self { source, info })
    }
}

/// Sets names and units of the axes.
fn name_axes(info: &mut SourceInfo, placing: &Placing) -> Result<(), SourceError> {
    if let Some(unit) = &placing.unit {
        info.axes.iter_mut().for_each(|axis| axis.unit.clone_from(unit));
    }
    let unit = placing.axis_unit.as_deref();
    if info.survey.is_none() && placing.domain.is_none() {
        if let Some(unit) = unit {
            info.axes.iter_mut().for_each(|axis| axis.unit = unit.into());
        }
        return Ok(());
    }
    let is_time = |unit: &str| TIMES.contains(&unit);
    let by_unit = unit.map(|unit| if is_time(unit) { Domain::Time } else { Domain::Depth });
    let Some(domain) = placing.domain.or(by_unit) else { return Ok(()) };
    if by_unit.is_some_and(|of_unit| of_unit != domain) {
        let (name, expected) = match domain {
            Domain::Time => ("time", "one of s, ms, us"),
            Domain::Depth => ("depth", "a unit of length"),
        };
        let found = unit.unwrap_or_default();
        let message = Message::from(ReadOption::Domain).text(format_args!(" {name}: expected {expected} as "));
        let message = message.option(ReadOption::AxisUnit).text(format_args!(", found {found}"));
        return Err(SourceError::options(message));
    }
    let feet = info.axes[0].unit == "ft";
    let (name, usual) = match domain {
        Domain::Time => ("time", "ms"),
        Domain::Depth if feet => ("depth", "ft"),
        Domain::Depth => ("depth", "m"),
    };
    let axis = &mut info.axes[2];
    let before = (axis.name.clone(), axis.unit.clone());
    (axis.name, axis.unit) = (name.into(), unit.unwrap_or(usual).into());
    if info.survey.is_some() && before != (axis.name.clone(), axis.unit.clone()) {
        let file = format!("{} {}", before.0, before.1);
        info.notes.push(
            format!(
                "the third axis is {name} in {}, which was given by hand; the file says {}",
                axis.unit,
                file.trim()
            )
            .into(),
        );
    }
    Ok(())
}

impl VolumeSource for PlacedSource {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        self.source.read_box(voxels, out)
    }
}
