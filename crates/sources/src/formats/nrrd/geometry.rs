//! Geometry of a NRRD: spacing, origin and direction from the header's per-axis fields and space fields.
//!
//! The header's own world space is kept, and a note names it. The world of a picture is right-handed, so in a
//! left-handed space one coordinate is reversed: x in a patient space, else z.
//! Space direction vectors have precedence over `spacings`. Their lengths are the spacings, their unit vectors the
//! columns of the direction matrix. An axis without a vector gets one perpendicular to the others. Values that would
//! make the transform singular are replaced by an axis-aligned grid, with a note.

use std::path::Path;

use glam::{DMat3, DVec3};
use supervol_format::Geometry;
use supervol_format::space::WorldSpace;

use super::header::Header;
use crate::grid::dense::shape::ChosenAxes;
use crate::input::text::shortened;
use crate::{Axis, Message, SourceError};

/// Geometry and axes, and notes for the user.
pub(super) struct Placement {
    pub(super) geometry: Geometry,
    pub(super) space: WorldSpace,
    pub(super) axes: [Axis; 3],
    pub(super) notes: Vec<Message>,
}

/// Reads all geometry fields; `chosen` are the header's axes that became x, y, z.
pub(super) fn placement(
    path: &Path,
    header: &Header,
    chosen: &ChosenAxes,
    axes: usize,
) -> Result<Placement, SourceError> {
    let mut notes = Vec::new();
    let (space, turned) = world_space(header.field("space"), &mut notes);
    let directions = space_directions(path, header, axes)?;
    let vectors: [Option<DVec3>; 3] = std::array::from_fn(|i| {
        let axis = *chosen.axes.get(i)?;
        directions.as_ref()?.get(axis).copied()?
    });
    let mut geometry = if vectors.iter().any(Option::is_some) {
        from_vectors(vectors, per_axis_spacing(path, header, chosen, axes, &mut notes)?.0, &mut notes)
    } else {
        let (spacing, signs) = per_axis_spacing(path, header, chosen, axes, &mut notes)?;
        let direction = DMat3::from_diagonal(DVec3::from_array(signs)).transpose().to_cols_array();
        Geometry { spacing, origin: [0.0; 3], direction }
    };
    geometry.origin = origin(path, header, chosen, axes, &geometry, &mut notes)?;
    if let Some(defect) = geometry.defect() {
        notes.push(format!("{defect}: replaced by spacing 1 along the world's axes").into());
        geometry = Geometry::IDENTITY;
    }
    let axes = axes_of(header, chosen, &geometry);
    if let Some(row) = turned {
        geometry.origin[row] = 0.0 - geometry.origin[row];
        geometry.direction[3 * row..3 * row + 3].iter_mut().for_each(|v| *v = 0.0 - *v);
    }
    Ok(Placement { geometry, space, axes, notes })
}

/// World space of the field `space` (NRRD format definition, section 5.3), with or without a time axis. The second
/// value is the coordinate that is reversed if the space is left-handed.
fn world_space(field: Option<&str>, notes: &mut Vec<Message>) -> (WorldSpace, Option<usize>) {
    let Some(name) = field else { return (WorldSpace::Unknown, None) };
    let lower = name.to_lowercase();
    let (space, turned) = match lower.trim_end_matches("-time") {
        "right-anterior-superior" | "ras" | "rast" => (WorldSpace::RightAnteriorSuperior, None),
        "left-posterior-superior" | "lps" | "lpst" => (WorldSpace::LeftPosteriorSuperior, None),
        "left-anterior-superior" | "las" | "last" => (WorldSpace::RightAnteriorSuperior, Some(0)),
        "3d-left-handed" => (WorldSpace::Unknown, Some(2)),
        _ => (WorldSpace::Unknown, None),
    };
    let how = turned
        .map_or(String::new(), |row| format!(", {} turned round to make a right-handed space", ["x", "y", "z"][row]));
    notes.push(format!("world coordinates are the header's own: {}{how}", shortened(name)).into());
    (space, turned)
}

/// Dimension of the header's world space.
fn space_dimension(path: &Path, header: &Header) -> Result<Option<usize>, SourceError> {
    if let Some(text) = header.field("spacedimension") {
        let wrong = || SourceError::invalid(path, "space dimension", "1 to 8", format!("`{}`", shortened(text)));
        return text.parse().ok().filter(|n| (1..=8).contains(n)).map(Some).ok_or_else(wrong);
    }
    let Some(space) = header.field("space") else { return Ok(None) };
    let space = space.to_lowercase();
    let with_time = space.ends_with("-time") || (space.len() == 4 && space.ends_with('t'));
    Ok(Some(if with_time { 4 } else { 3 }))
}

/// One vector per axis of the file; `None` where the header says `none`. Vectors without exactly two or three
/// components are ignored.
fn space_directions(path: &Path, header: &Header, axes: usize) -> Result<Option<Vec<Option<DVec3>>>, SourceError> {
    let Some(text) = header.field("spacedirections") else { return Ok(None) };
    let expected = || match space_dimension(path, header) {
        Ok(Some(n)) => format!("{axes} vectors of {n} numbers, or `none`"),
        _ => format!("{axes} vectors `(x,y,z)` or `none`"),
    };
    let wrong = || SourceError::invalid(path, "space directions", expected(), format!("`{}`", shortened(text)));
    let dimension = space_dimension(path, header)?;
    let mut vectors = Vec::new();
    let mut rest = text;
    while let Some((vector, behind)) = next_vector(rest).ok_or_else(wrong)? {
        let components = vector.as_ref().map(Vec::len);
        if components.is_some_and(|n| dimension.is_some_and(|d| d != n)) || vectors.len() == axes {
            return Err(wrong());
        }
        vectors.push(vector.and_then(|v| to_three(&v)));
        rest = behind;
    }
    if vectors.len() == axes { Ok(Some(vectors)) } else { Err(wrong()) }
}

/// Numbers of one vector; `None` if the header says `none`.
type Components = Option<Vec<f64>>;

/// The next vector and the text behind it; `Some(None)` at the end, `None` if the text is not a vector.
fn next_vector(text: &str) -> Option<Option<(Components, &str)>> {
    let text = text.trim_start();
    if text.is_empty() {
        return Some(None);
    }
    if let Some(behind) = text.strip_prefix("none") {
        return Some(Some((None, behind)));
    }
    let (inside, behind) = text.strip_prefix('(')?.split_once(')')?;
    let components: Option<Vec<f64>> = inside.split(',').map(|c| c.trim().parse().ok()).collect();
    Some(Some((Some(components?), behind)))
}

/// A vector in our world; NaN means "none", as the format says.
fn to_three(components: &[f64]) -> Option<DVec3> {
    let vector = match *components {
        [x, y] => DVec3::new(x, y, 0.0),
        [x, y, z] => DVec3::new(x, y, z),
        _ => return None,
    };
    (!vector.is_nan()).then_some(vector)
}

/// Spacings and signs of the chosen axes from `spacings`, else from `axis mins` and `axis maxs`, else 1.
fn per_axis_spacing(
    path: &Path,
    header: &Header,
    chosen: &ChosenAxes,
    axes: usize,
    notes: &mut Vec<Message>,
) -> Result<([f64; 3], [f64; 3]), SourceError> {
    let spacings = header.per_axis(path, "spacings", axes)?;
    let mins = header.per_axis(path, "axismins", axes)?;
    let maxs = header.per_axis(path, "axismaxs", axes)?;
    let mut spacing = [1.0; 3];
    let mut signs = [1.0; 3];
    for (i, axis) in chosen.axes.iter().copied().enumerate() {
        let cells = chosen.dims.0[i] as f64 - if is_cell_centred(header, axis) { 0.0 } else { 1.0 };
        let by_limits = || Some((maxs.as_ref()?[axis] - mins.as_ref()?[axis]) / cells);
        let stated = spacings.as_ref().map(|s| s[axis]).filter(|s| !s.is_nan());
        let Some(value) = stated.or_else(by_limits).filter(|s| !s.is_nan()) else { continue };
        if value == 0.0 || !value.is_finite() {
            notes.push(format!("spacing {value} of axis {axis} is impossible: replaced by 1").into());
            continue;
        }
        (spacing[i], signs[i]) = (value.abs(), value.signum());
    }
    Ok((spacing, signs))
}

/// Whether `axis mins` is the edge of the first voxel rather than its centre.
fn is_cell_centred(header: &Header, axis: usize) -> bool {
    let centers = header.field("centers").or_else(|| header.field("centerings"));
    centers.and_then(|text| text.split_whitespace().nth(axis)).is_some_and(|word| word == "cell")
}

/// Spacing and direction from direction vectors. Axes without one get the spacing `fallback` and a perpendicular
/// direction.
fn from_vectors(vectors: [Option<DVec3>; 3], fallback: [f64; 3], notes: &mut Vec<Message>) -> Geometry {
    let lengths: [f64; 3] = std::array::from_fn(|i| vectors[i].map_or(fallback[i], DVec3::length));
    let units: [Option<DVec3>; 3] = std::array::from_fn(|i| vectors[i].and_then(DVec3::try_normalize));
    let aligned = |notes: &mut Vec<Message>| {
        notes.push(
            format!("space directions {vectors:?} span no volume: the grid is placed along the world's axes").into(),
        );
        let spacing = lengths.map(|length| if length.is_finite() && length > 0.0 { length } else { 1.0 });
        Geometry { spacing, ..Geometry::IDENTITY }
    };
    if (0..3).any(|i| vectors[i].is_some() && units[i].is_none()) {
        return aligned(notes);
    }
    let columns = complete(units);
    let geometry = Geometry {
        spacing: lengths,
        origin: [0.0; 3],
        direction: columns.transpose().to_cols_array().map(|v| v + 0.0),
    };
    if geometry.defect().is_some() { aligned(notes) } else { geometry }
}

/// Fills missing columns so that the frame is right-handed and as perpendicular as the given columns allow.
fn complete(units: [Option<DVec3>; 3]) -> DMat3 {
    let cross = |a: DVec3, b: DVec3| a.cross(b).try_normalize().unwrap_or(DVec3::ZERO);
    let [x, y, z] = match units {
        [Some(x), Some(y), z] => [x, y, z.unwrap_or_else(|| cross(x, y))],
        [Some(x), None, Some(z)] => [x, cross(z, x), z],
        [None, Some(y), Some(z)] => [cross(y, z), y, z],
        [Some(x), None, None] => {
            let (y, z) = right_handed(x);
            [x, y, z]
        }
        [None, Some(y), None] => {
            let (z, x) = right_handed(y);
            [x, y, z]
        }
        [None, None, Some(z)] => {
            let (x, y) = right_handed(z);
            [x, y, z]
        }
        [None, None, None] => DVec3::AXES,
    };
    DMat3::from_cols(x, y, z)
}

/// Two vectors that form a right-handed frame with `first`, near the world's axes.
fn right_handed(first: DVec3) -> (DVec3, DVec3) {
    let helper = if first.y.abs() < 0.9 { DVec3::Y } else { DVec3::Z };
    let third = first.cross(helper).normalize();
    (third.cross(first), third)
}

/// World position of the first voxel: `space origin`, else `axis mins`.
fn origin(
    path: &Path,
    header: &Header,
    chosen: &ChosenAxes,
    axes: usize,
    geometry: &Geometry,
    notes: &mut Vec<Message>,
) -> Result<[f64; 3], SourceError> {
    if let Some(text) = header.field("spaceorigin") {
        let wrong = || SourceError::invalid(path, "space origin", "`(x,y,z)`", format!("`{}`", shortened(text)));
        let vector = next_vector(text).flatten().filter(|(_, behind)| behind.trim().is_empty()).ok_or_else(wrong)?;
        let point = vector.0.as_deref().and_then(to_three).filter(|p| p.is_finite());
        if point.is_none() {
            notes.push(format!("space origin {} is no point in space: replaced by 0", shortened(text)).into());
        }
        return Ok(point.unwrap_or(DVec3::ZERO).to_array());
    }
    let Some(mins) = header.per_axis(path, "axismins", axes)? else { return Ok([0.0; 3]) };
    let along: [f64; 3] = std::array::from_fn(|i| {
        let Some(axis) = chosen.axes.get(i).copied() else { return 0.0 };
        let sign = geometry.direction[4 * i].signum();
        let half_voxel = if is_cell_centred(header, axis) { 0.5 * geometry.spacing[i] * sign } else { 0.0 };
        if mins[axis].is_finite() { mins[axis] + half_voxel } else { 0.0 }
    });
    Ok(along)
}

/// Names from `labels`. Units from `units`, else the unit of the world axis that is closest to each axis.
fn axes_of(header: &Header, chosen: &ChosenAxes, geometry: &Geometry) -> [Axis; 3] {
    let labels = header.quoted("labels").unwrap_or_default();
    let units = header.quoted("units").unwrap_or_default();
    let space_units = header.quoted("spaceunits").unwrap_or_default();
    let given =
        |list: &[String], index: Option<usize>| index.and_then(|i| list.get(i)).filter(|s| !s.is_empty()).cloned();
    std::array::from_fn(|i| {
        let axis = chosen.axes.get(i).copied();
        let column = [0, 1, 2].map(|row| geometry.direction[3 * row + i].abs());
        let follows = (0..3).max_by(|a, b| column[*a].total_cmp(&column[*b]));
        Axis {
            name: given(&labels, axis).unwrap_or_else(|| ["x", "y", "z"][i].into()),
            unit: given(&units, axis).or_else(|| given(&space_units, follows)).unwrap_or_default(),
        }
    })
}
