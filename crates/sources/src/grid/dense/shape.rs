//! Reduction of a file's axes (one or more) to the three axes of a volume.
//!
//! Missing axes get one voxel. If there are more than three, axes with a single voxel are dropped. Axes that the header
//! calls non-spatial go first, then the slowest before the fastest. If more than three are left, the caller refuses the
//! file.

use std::fmt::Display;

use supervol_format::Dims;

use crate::Message;
use crate::input::selection::Selection;

/// The file's axes that became x, y and z.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ChosenAxes {
    /// Indices of the file's axes (fastest first) that are x, y, z; at most three.
    pub axes: Vec<usize>,
    /// Number of voxels along x, y, z.
    pub dims: Dims,
    /// Notes for the user.
    pub notes: Vec<Message>,
}

/// Chooses three axes. `sizes` has the fastest axis first; `spatial` tells which axes may be spatial.
///
/// # Errors
/// The indices of the axes that would have to be dropped but have more than one voxel.
pub fn choose_axes(sizes: &[u64], spatial: &[bool]) -> Result<ChosenAxes, Vec<usize>> {
    let mut axes: Vec<usize> = (0..sizes.len()).collect();
    let mut notes = Vec::new();
    for wanted_spatial in [false, true] {
        for axis in (0..sizes.len()).rev() {
            if axes.len() > 3 && sizes[axis] == 1 && spatial[axis] == wanted_spatial {
                axes.retain(|a| *a != axis);
                notes.push(format!("axis {axis} has one voxel and is dropped").into());
            }
        }
    }
    let not_space: Vec<usize> = axes.iter().copied().filter(|a| !spatial[*a] && sizes[*a] != 1).collect();
    let in_the_way = if not_space.is_empty() { axes.iter().copied().skip(3).collect() } else { not_space };
    if !in_the_way.is_empty() {
        return Err(in_the_way);
    }
    let dims = Dims(std::array::from_fn(|i| axes.get(i).map_or(1, |a| sizes[*a])));
    if axes.len() < 3 {
        notes.push(format!("the file has {}: read as {dims} voxels", count(axes.len(), "axis", "axes")).into());
    }
    Ok(ChosenAxes { axes, dims, notes })
}

/// Axes of a file besides those of the volume: the channels of a voxel (fastest) and a sequence of volumes (slowest).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SplitAxes {
    /// Number of channels per voxel.
    pub channels: u64,
    /// Number of volumes.
    pub frames: u64,
    /// Axes of one volume.
    pub chosen: ChosenAxes,
}

/// Meaning of the fastest axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FastestAxis {
    /// Channels only if it is not spatial.
    AsStated,
    /// Channels, because the user selects one.
    Channels,
}

impl FastestAxis {
    /// The meaning for a selection: channels if a channel is selected.
    #[must_use]
    pub fn of(selection: &Selection) -> Self {
        if selection.channel.is_some() { Self::Channels } else { Self::AsStated }
    }
}

/// As [`choose_axes`], but the slowest axis may count volumes, and the fastest may count channels.
///
/// # Errors
/// As [`choose_axes`].
pub fn split_axes(sizes: &[u64], spatial: &[bool], fastest: FastestAxis) -> Result<SplitAxes, Vec<usize>> {
    let wants_channel = fastest == FastestAxis::Channels;
    let in_the_way = match choose_axes(sizes, spatial) {
        Ok(chosen) if !wants_channel || sizes.len() < 3 => return Ok(SplitAxes { channels: 1, frames: 1, chosen }),
        Ok(_) => Vec::new(),
        Err(in_the_way) => in_the_way,
    };
    let may_be_channels = wants_channel || !spatial[0];
    let ways = [(1, 0), (0, 1), (1, 1)].into_iter().filter(|(first, _)| *first == 0 || may_be_channels);
    for (first, last) in ways.filter(|(first, _)| *first == 1 || !wants_channel) {
        let Some(inside) = sizes.len().checked_sub(last).filter(|end| *end > first).map(|end| first..end) else {
            continue;
        };
        let Ok(mut chosen) = choose_axes(&sizes[inside.clone()], &spatial[inside]) else { continue };
        chosen.axes.iter_mut().for_each(|axis| *axis += first);
        let size = |is_taken: usize, axis: usize| if is_taken == 1 { sizes[axis] } else { 1 };
        return Ok(SplitAxes { channels: size(first, 0), frames: size(last, sizes.len() - 1), chosen });
    }
    Err(in_the_way)
}

fn count(n: usize, one: impl Display, many: impl Display) -> String {
    if n == 1 { format!("{n} {one}") } else { format!("{n} {many}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn channels_are_fastest_and_volumes_slowest() {
        let split = |sizes: &[u64], spatial: &[bool], wants_channel: bool| {
            let fastest = if wants_channel { FastestAxis::Channels } else { FastestAxis::AsStated };
            split_axes(sizes, spatial, fastest).map(|s| (s.channels, s.frames, s.chosen.dims.0, s.chosen.axes))
        };
        assert_eq!(split(&[7, 5, 3], &[true; 3], false), Ok((1, 1, [7, 5, 3], vec![0, 1, 2])));
        assert_eq!(split(&[7, 5, 3, 2], &[true; 4], false), Ok((1, 2, [7, 5, 3], vec![0, 1, 2])));
        assert_eq!(split(&[2, 7, 5, 3], &[true; 4], true), Ok((2, 1, [7, 5, 3], vec![1, 2, 3])));
        assert_eq!(split(&[2, 7, 5, 3], &[false, true, true, true], false), Ok((2, 1, [7, 5, 3], vec![1, 2, 3])));
        assert_eq!(
            split(&[2, 7, 5, 3, 4], &[false, true, true, true, true], false),
            Ok((2, 4, [7, 5, 3], vec![1, 2, 3]))
        );
        assert_eq!(split(&[2, 7, 5], &[false, true, true], false), Ok((2, 1, [7, 5, 1], vec![1, 2])));
        assert_eq!(split(&[7, 5, 3, 2, 2], &[true; 5], false), Err(vec![3, 4]));
    }

    #[test]
    fn drops_single_voxels_and_nothing_else() {
        let chosen = |sizes: &[u64], spatial: &[bool]| choose_axes(sizes, spatial).map(|c| (c.axes, c.dims.0));
        assert_eq!(chosen(&[7], &[true]), Ok((vec![0], [7, 1, 1])));
        assert_eq!(chosen(&[7, 5], &[true; 2]), Ok((vec![0, 1], [7, 5, 1])));
        assert_eq!(chosen(&[1, 7, 5], &[true; 3]), Ok((vec![0, 1, 2], [1, 7, 5])));
        assert_eq!(chosen(&[1, 7, 5, 3], &[true; 4]), Ok((vec![1, 2, 3], [7, 5, 3])));
        assert_eq!(chosen(&[1, 1, 1, 1], &[false, true, true, true]), Ok((vec![1, 2, 3], [1, 1, 1])));
        assert_eq!(chosen(&[7, 5, 3, 1, 1], &[true; 5]), Ok((vec![0, 1, 2], [7, 5, 3])));
        assert_eq!(chosen(&[7, 5, 3, 2], &[true; 4]), Err(vec![3]));
        assert_eq!(chosen(&[3, 7, 5], &[false, true, true]), Err(vec![0]));
        assert_eq!(chosen(&[3, 7, 5, 9], &[false, true, true, true]), Err(vec![0]));
    }
}
