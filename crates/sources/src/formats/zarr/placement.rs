//! Reduction of an array's axes to three spatial axes, a time and a channel.

use std::path::Path;

use super::ome::{ArrayAxis, Role};
use crate::formats::array_survey::survey_axes;
use crate::grid::chunked::Placement;
use crate::input::selection::Selection;
use crate::{Message, SourceError};

/// Gives axes the names that the user states, slowest first. Spacings and units stay.
///
/// # Errors
/// If the number of names is not that of the axes.
pub(crate) fn rename(path: &Path, axes: &mut [ArrayAxis], selection: &Selection) -> Result<(), SourceError> {
    let names = &selection.axes;
    if names.is_empty() {
        return Ok(());
    }
    selection.check_axes(path, axes.len())?;
    for (axis, name) in axes.iter_mut().zip(names) {
        let named = ArrayAxis::named(name);
        (axis.name, axis.role) = (named.name, named.role);
    }
    Ok(())
}

/// Chooses the axes that are x, y, z, and the positions on the others. `names` are the file's names of the channels, as
/// far as known.
pub(crate) fn place(
    path: &Path,
    (shape, axes, names): (&[u64], &[ArrayAxis], &[String]),
    selection: &Selection,
    notes: &mut Vec<Message>,
) -> Result<Placement, SourceError> {
    let of = |role: Role| (0..shape.len()).filter(|i| axes[*i].role == role).collect::<Vec<_>>();
    let (mut space, mut times, mut channels) = (of(Role::Space), of(Role::Time), of(Role::Channel));
    let survey = survey_axes(axes);
    if let Some(survey) = survey {
        times.retain(|axis| !survey.contains(axis));
        channels.retain(|axis| !survey.contains(axis));
        space.retain(|axis| !survey.contains(axis) && shape[*axis] > 1);
        for axis in space {
            // Offsets, angles and the like.
            if times.is_empty() { times.push(axis) } else { channels.push(axis) }
        }
        space = survey.to_vec();
    }
    // Beyond three spatial axes, the slowest ones have other, unnamed meanings.
    while space.len() > 3 {
        let axis = space.iter().position(|i| shape[*i] == 1).unwrap_or(0);
        let axis = space.remove(axis);
        if shape[axis] > 1 {
            if times.is_empty() { times.push(axis) } else { channels.push(axis) }
        }
    }
    if space.is_empty() {
        // Only times or channels: they become a line of voxels.
        space.extend(times.pop().or_else(|| channels.pop()));
    }
    if times.len() > 1 || channels.len() > 1 {
        let what = format!("{} axes: a volume has three, a time and a channel", shape.len());
        return Err(SourceError::unsupported(path, what, "write the volume that is meant as an array of its own"));
    }
    let mut fixed = vec![0; shape.len()];
    let times_count = times.first().map_or(1, |axis| shape[*axis]);
    let frame = selection.noted_frame(path, times_count, "time points", notes)?;
    times.iter().for_each(|axis| fixed[*axis] = frame);
    let channel_count = channels.first().map_or(1, |axis| shape[*axis]);
    let channel = selection.noted_channel(path, channel_count, names, notes)?;
    channels.iter().for_each(|axis| fixed[*axis] = channel);
    let axes = survey.map_or_else(|| named_xyz(&space, axes), |survey| survey.map(Some));
    Ok(Placement { axes, fixed })
}

/// The axes x, y and z: by name if all axes have one of these names, else the fastest is x.
fn named_xyz(space: &[usize], axes: &[ArrayAxis]) -> [Option<usize>; 3] {
    let called = |name: &str| {
        let mut found = space.iter().filter(|i| axes[**i].name.eq_ignore_ascii_case(name));
        (found.next().copied(), found.next())
    };
    let named = ["x", "y", "z"].map(called);
    let is_clear = named.iter().all(|(_, second)| second.is_none());
    if is_clear && named.iter().flat_map(|(first, _)| first).count() == space.len() {
        return named.map(|(first, _)| first);
    }
    std::array::from_fn(|i| space.len().checked_sub(i + 1).map(|at| space[at]))
}
