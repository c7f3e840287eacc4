//! Selection of the slices of one volume from the headers of many files. It chooses the series and one of several
//! volumes at the same place, sorts the slices, and checks that none is missing.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};
use supervol_format::Geometry;

use super::header::{FRAMES_LIMIT, Header, Place, normal};
use crate::cast::{self, index};
use crate::error::{Part, PartName};
use crate::input::selection::Selection;
use crate::{Message, ReadOption, SourceError};

/// Largest difference per component of two orientations that count as equal.
const SAME_DIRECTION: f64 = 1e-3;
/// Slices closer together than this, in mm, are at the same place.
const SAME_PLACE_MM: f64 = 1e-3;
/// A gap larger than the usual one by this factor means that a slice is missing.
const GAP_LIMIT: f64 = 1.5;
/// Largest distance of a slice from its place in an even stack, in slice distances; and the distance from which on it
/// is noted.
const UNEVEN_LIMIT: f64 = 0.25;
const UNEVEN_NOTED: f64 = 0.005;
/// Modality of segmentations.
pub(super) const SEGMENTATION: &str = "SEG";
/// Largest number of series that are listed.
const LISTED_LIMIT: usize = 20;

/// One file with its header.
pub(super) struct Member {
    pub(super) path: PathBuf,
    pub(super) header: Header,
}

/// A frame of a file, as a slice of the volume.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Slice {
    /// Index of the file.
    pub(super) file: usize,
    /// Number of the frame in the file.
    pub(super) frame: u64,
    pub(super) place: Place,
    instance: i64,
    /// Position along the normal in mm; 0 if unknown.
    along: f64,
    /// Whether the file lacks the frame: a segmentation leaves out frames in which nothing is marked.
    pub(super) is_empty: bool,
}

/// The members of the chosen series, or of the only one, and whether it is the only one.
pub(super) fn choose_series(
    path: &Path,
    members: Vec<Member>,
    selection: &Selection,
) -> Result<(Vec<Member>, bool), SourceError> {
    let mut by_uid: BTreeMap<String, Vec<Member>> = BTreeMap::new();
    for member in members {
        by_uid.entry(member.header.series_uid.clone()).or_default().push(member);
    }
    let is_wanted = |uid: &str, members: &[Member]| match &selection.series {
        None => true,
        Some(wanted) => wanted == uid || members[0].header.series_number.is_some_and(|n| n.to_string() == *wanted),
    };
    let fitting: Vec<String> =
        by_uid.iter().filter(|(uid, members)| is_wanted(uid, members)).map(|(uid, _)| uid.clone()).collect();
    if let [uid] = &fitting[..] {
        let is_only = by_uid.len() == 1;
        return Ok((by_uid.remove(uid).unwrap_or_default(), is_only));
    }
    let listed: Vec<String> = by_uid
        .iter()
        .take(LISTED_LIMIT)
        .map(|(uid, members)| {
            let Header { modality, description, series_number, image, .. } = &members[0].header;
            let number = series_number.map_or("no number".into(), |n| format!("number {n}"));
            let (count, columns, rows) = (members.len(), image.columns, image.rows);
            format!("{number}, {modality} {description}, {count} files of {columns} x {rows}, UID {uid}")
        })
        .collect();
    let choices = by_uid.iter().take(LISTED_LIMIT).map(|(uid, members)| {
        let Header { modality, description, .. } = &members[0].header;
        let words = format!("{modality} {description}, {} files", members.len());
        Part { by: PartName::Series(uid.clone()), words }
    });
    let rest = by_uid.len().saturating_sub(LISTED_LIMIT);
    let more = if rest == 0 { String::new() } else { format!("\n  and {rest} more") };
    let list = format!("\n  {}{more}", listed.join("\n  "));
    let count = by_uid.len();
    Err(match &selection.series {
        None => SourceError::unsupported(
            path,
            format!("{count} series, of which a volume is one"),
            Message::from("choose one by its number or UID with ")
                .option(ReadOption::Series)
                .text(format_args!(":{list}")),
        )
        .with_choices(choices),
        Some(wanted) => SourceError::options(Message::from(ReadOption::Series).text(format_args!(
            " {wanted}: {} of the {count} series of {} have this number or UID:{list}",
            fitting.len(),
            path.display()
        ))),
    })
}

/// Keeps the largest group of files whose images agree in size, number format and orientation, and notes the others.
pub(super) fn keep_alike(members: Vec<Member>, notes: &mut Vec<Message>) -> Vec<Member> {
    let is_alike = |a: &Header, b: &Header| {
        let turned = |(a, b): (&f64, &f64)| (a - b).abs() > SAME_DIRECTION;
        let same_way = match (a.frame(0).orientation, b.frame(0).orientation) {
            (Some(a), Some(b)) => !a.iter().zip(&b).any(turned),
            (a, b) => a.is_none() && b.is_none(),
        };
        let pixels = |header: &Header| header.pixels.map(|pixels| pixels.tag);
        a.image == b.image && pixels(a) == pixels(b) && same_way
    };
    let mut groups: Vec<Vec<Member>> = Vec::new();
    for member in members {
        match groups.iter_mut().find(|group| is_alike(&group[0].header, &member.header)) {
            Some(group) => group.push(member),
            None => groups.push(vec![member]),
        }
    }
    groups.sort_by_key(|group| std::cmp::Reverse(group.len()));
    let left_out: usize = groups.iter().skip(1).map(Vec::len).sum();
    if left_out > 0 {
        notes.push(format!("{left_out} images of another size, type or orientation (localisers?) are left out").into());
    }
    groups.into_iter().next().unwrap_or_default()
}

/// The slices of one volume, in order.
pub(super) fn slices(
    path: &Path,
    members: &[Member],
    selection: &Selection,
    notes: &mut Vec<Message>,
) -> Result<Vec<Slice>, SourceError> {
    let mut all = Vec::new();
    for (file, Member { header, .. }) in members.iter().enumerate() {
        for frame in 0..header.frame_count {
            let place = header.frame(frame);
            let along = place.position.zip(normal(&place)).map(|(p, n)| DVec3::from(p).dot(DVec3::from(n)));
            let along = along.unwrap_or(0.0);
            all.push(Slice { file, frame, place, instance: header.instance, along, is_empty: false });
        }
    }
    let placed = all.iter().filter(|slice| slice.place.position.is_some()).count();
    if placed != all.len() || members[0].header.frame(0).orientation.is_none() {
        if placed > 0 && all.len() > 1 {
            notes.push(format!("{} of {} slices have no position", all.len() - placed, all.len()).into());
        }
        if all.len() > 1 {
            notes.push("no position of each slice: they follow one another by their numbers".into());
        }
        all.sort_by_key(|slice| (slice.instance, slice.file, slice.frame));
        selection.frame_of(path, 1)?;
        all.iter_mut().for_each(|slice| slice.along = 0.0);
        return Ok(all);
    }
    all.sort_by(|a, b| a.along.total_cmp(&b.along));
    if members[0].header.modality != SEGMENTATION {
        return one_volume(path, all, selection, notes);
    }
    keep_segment(path, &members[0].header, &mut all, (selection, notes))?;
    let present = one_volume(path, all, selection, notes)?;
    Ok(with_empty_slices(present, notes))
}

/// Keeps the frames of the selected segment, by default the first that has any.
fn keep_segment(
    path: &Path,
    header: &Header,
    all: &mut Vec<Slice>,
    (selection, notes): (&Selection, &mut Vec<Message>),
) -> Result<(), SourceError> {
    let mut numbers: Vec<f64> = all.iter().filter_map(|slice| slice.place.segment).collect();
    numbers.sort_by(f64::total_cmp);
    numbers.dedup();
    if numbers.is_empty() {
        // A label map: its values are the segments.
        selection.channel_of(path, 1)?;
        return Ok(());
    }
    let label =
        |number: &f64| header.segments.iter().find(|(known, _)| known == number).map(|(_, label)| label.clone());
    let labels: Vec<String> = numbers.iter().map(|number| label(number).unwrap_or_default()).collect();
    let wanted = selection.noted_channel(path, numbers.len() as u64, &labels, notes)?;
    all.retain(|slice| slice.place.segment.is_none_or(|segment| segment == numbers[index(wanted)]));
    Ok(())
}

/// Fills the gaps of a segmentation with empty slices, if its slices stand on an even grid.
fn with_empty_slices(present: Vec<Slice>, notes: &mut Vec<Message>) -> Vec<Slice> {
    let gaps = || present.windows(2).map(|pair| pair[1].along - pair[0].along);
    let stated = present[0].place.between;
    let Some(step) = stated.into_iter().chain([gaps().fold(f64::INFINITY, f64::min)]).find(|step| step.is_finite())
    else {
        return present;
    };
    let steps = |gap: f64| (gap / step).round();
    let is_even = step > SAME_PLACE_MM && gaps().all(|gap| (gap - steps(gap) * step).abs() <= UNEVEN_LIMIT * step);
    let total: f64 = gaps().map(steps).sum();
    if !is_even || total + 1.0 > FRAMES_LIMIT as f64 || total + 1.0 == present.len() as f64 {
        return present;
    }
    let mut all: Vec<Slice> = Vec::new();
    for slice in present {
        if let Some(before) = all.last().copied() {
            let (from, to) = (before.place.position.map(DVec3::from), slice.place.position.map(DVec3::from));
            let count = cast::whole::<u64>(steps(slice.along - before.along));
            for number in 1..count {
                let share = number as f64 / count as f64;
                let mut empty =
                    Slice { is_empty: true, along: before.along + share * (slice.along - before.along), ..before };
                empty.place.position = from.zip(to).map(|(from, to)| from.lerp(to, share).to_array());
                all.push(empty);
            }
        }
        all.push(slice);
    }
    let missing = all.iter().filter(|slice| slice.is_empty).count();
    notes.push(format!("{missing} slices of the segmentation are left out in the file: they are empty").into());
    all
}

/// The slices of the chosen volume. `all` is sorted by position, and each position must have equally many slices.
fn one_volume(
    path: &Path,
    all: Vec<Slice>,
    selection: &Selection,
    notes: &mut Vec<Message>,
) -> Result<Vec<Slice>, SourceError> {
    let mut places: Vec<Vec<Slice>> = Vec::new();
    for slice in all {
        match places.last_mut() {
            Some(place) if slice.along - place[0].along < SAME_PLACE_MM => place.push(slice),
            _ => places.push(vec![slice]),
        }
    }
    let volumes = places[0].len();
    if let Some(other) = places.iter().find(|place| place.len() != volumes) {
        let found = format!(
            "{} at {:.3} mm along the normal, {volumes} at {:.3} mm: a slice is missing, or several series are mixed",
            other.len(),
            other[0].along,
            places[0][0].along
        );
        return Err(SourceError::invalid(path, "slices", "as many at each place", found));
    }
    let what = "volumes at the same place (time points, echoes)";
    let wanted = selection.noted_frame(path, volumes as u64, what, notes)?;
    let order = |slice: &Slice| slice.place.times.map(|time| time.unwrap_or(0.0));
    for place in &mut places {
        place.sort_by(|a, b| {
            let by_time = order(a).iter().zip(order(b)).map(|(a, b)| a.total_cmp(&b)).find(|o| o.is_ne());
            let by_number = (a.instance, a.file, a.frame).cmp(&(b.instance, b.file, b.frame));
            by_time.unwrap_or(by_number)
        });
    }
    // The index is below the count, so it fits the address space.
    Ok(places.into_iter().map(|place| place[index(wanted)]).collect())
}

/// Geometry of the volume: x along columns, y along rows, z from slice to slice, sheared if the gantry was tilted.
pub(super) fn geometry(path: &Path, slices: &[Slice], notes: &mut Vec<Message>) -> Result<Geometry, SourceError> {
    let first = &slices[0].place;
    let [spacing_y, spacing_x] = first.pixel_spacing.unwrap_or_else(|| {
        notes.push("the files give no pixel spacing: replaced by 1".into());
        [1.0; 2]
    });
    let along = first.position.zip(slices[slices.len() - 1].place.position).filter(|_| slices.len() > 1);
    let columns = first.orientation.zip(normal(first)).map(|(o, n)| {
        let x = DVec3::new(o[0], o[1], o[2]).normalize_or_zero();
        [x, DVec3::new(o[3], o[4], o[5]).normalize_or_zero(), DVec3::from(n)]
    });
    let [x, y, normal] = columns.unwrap_or([DVec3::X, DVec3::Y, DVec3::Z]);
    let (mut z, mut spacing_z) = (normal, first.between.or(first.thickness).unwrap_or(1.0));
    if let (Some((from, to)), Some(_)) = (along, columns) {
        let step = (DVec3::from(to) - DVec3::from(from)) / (slices.len() - 1) as f64;
        check_even(path, slices, step, notes)?;
        (z, spacing_z) = (step.normalize_or_zero(), step.length());
        let tilt = z.dot(normal).clamp(-1.0, 1.0).acos().to_degrees();
        if tilt > 0.05 {
            notes.push(
                format!("slices are tilted by {tilt:.2} degrees against their normal (gantry tilt): kept so").into(),
            );
        }
    } else if first.between.or(first.thickness).is_none() {
        notes.push("the distance of slices is unknown: replaced by 1".into());
    } else if slices.len() > 1 {
        let what = if first.between.is_some() { "stated distance" } else { "stated thickness" };
        notes.push(format!("slices are {spacing_z} mm apart by their {what}").into());
    }
    let direction = DMat3::from_cols(x, y, z).transpose().to_cols_array().map(|v| v + 0.0);
    let origin = first.position.unwrap_or([0.0; 3]).map(|v| v + 0.0);
    let geometry = Geometry { spacing: [spacing_x, spacing_y, spacing_z], origin, direction };
    let Some(defect) = geometry.defect() else { return Ok(geometry) };
    notes.push(format!("{defect}: replaced by the world's axes").into());
    Ok(Geometry { direction: Geometry::IDENTITY.direction, ..geometry })
}

/// Refuses a stack with a missing slice, or one so uneven that slices would be drawn at wrong places.
fn check_even(path: &Path, slices: &[Slice], step: DVec3, notes: &mut Vec<Message>) -> Result<(), SourceError> {
    let mut gaps: Vec<f64> = slices.windows(2).map(|pair| pair[1].along - pair[0].along).collect();
    let ordered = gaps.clone();
    gaps.sort_by(f64::total_cmp);
    let usual = gaps[gaps.len() / 2];
    let wide = ordered.iter().position(|gap| *gap > GAP_LIMIT * usual);
    if let Some(number) = wide {
        let count = ordered.iter().filter(|gap| **gap > GAP_LIMIT * usual).count();
        let found = format!(
            "{:.3} mm between slices {number} and {} (at {:.3} mm along the normal), and {} more such gaps",
            ordered[number],
            number + 1,
            slices[number].along,
            count - 1
        );
        let expected = format!("slices {usual:.3} mm apart, none missing");
        return Err(SourceError::invalid(path, "positions of slices", expected, found));
    }
    let first = slices[0].place.position.map(DVec3::from).unwrap_or_default();
    let mut worst = 0.0f64;
    for (number, slice) in slices.iter().enumerate() {
        let position = slice.place.position.map(DVec3::from).unwrap_or_default();
        worst = worst.max((position - (first + step * number as f64)).length());
    }
    let share = worst / step.length();
    if share > UNEVEN_LIMIT {
        let expected = format!("slices in one row, {usual:.3} mm apart");
        let found = format!("one that is {worst:.3} mm from its place");
        return Err(SourceError::invalid(path, "positions of slices", expected, found));
    }
    if share > UNEVEN_NOTED {
        notes.push(
            format!("slices are not quite evenly spaced: at most {worst:.3} mm from where they are shown").into(),
        );
    }
    Ok(())
}
