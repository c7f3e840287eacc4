//! Axes of an array that the user names. Axes that are slower in memory than those of the volume are fixed; one channel
//! axis may be faster.

use std::path::Path;

use supervol_format::Dims;

use super::NpyHeader;
use crate::formats::array_survey::survey_axes;
use crate::formats::zarr::ome::{ArrayAxis, Role};
use crate::formats::zarr::placement::place;
use crate::grid::elements::Channels;
use crate::input::selection::Selection;
use crate::{Message, SourceError};

/// The volume in an array with named axes.
pub(super) struct Arranged {
    pub(super) dims: Dims,
    /// Axes of the volume, fastest first.
    pub(super) fastest_first: [usize; 3],
    pub(super) channels: Channels,
    /// Elements before the first one of the volume.
    pub(super) skipped: u64,
    /// Axes x, y and z of a survey.
    pub(super) survey: Option<[ArrayAxis; 3]>,
}

/// Arranges an array by the names in `selection`, slowest first.
pub(super) fn arrange(
    path: &Path,
    header: &NpyHeader,
    selection: &Selection,
    notes: &mut Vec<Message>,
) -> Result<Arranged, SourceError> {
    let shape = &header.shape;
    selection.check_axes(path, shape.len())?;
    let axes: Vec<ArrayAxis> = selection.axes.iter().map(|name| ArrayAxis::named(name)).collect();
    let placement = place(path, (shape, &axes, &[]), selection, notes)?;
    let xyz = placement.axes;
    let mut in_memory: Vec<usize> = (0..shape.len()).collect();
    if !header.fortran_order {
        in_memory.reverse();
    }
    // Axes of the volume in the order of the memory, then those that the array does not have.
    let order = in_memory.iter().filter_map(|axis| xyz.iter().position(|of_volume| *of_volume == Some(*axis)));
    let missing = (0..3).filter(|i| xyz[*i].is_none());
    let order: Vec<usize> = order.chain(missing).collect();
    let refused = || {
        let what = "axes that are no axes of the volume lie between these or behind them";
        SourceError::unsupported(path, what, "move them to the front first, with `numpy.moveaxis`")
    };
    let fastest_first: [usize; 3] = order.try_into().map_err(|_| refused())?;
    let (mut stride, mut skipped, mut channels) = (1u64, 0u64, Channels::ONE);
    for (number, axis) in in_memory.iter().enumerate() {
        if !xyz.contains(&Some(*axis)) && shape[*axis] > 1 {
            let is_slower = in_memory[number..].iter().all(|axis| !xyz.contains(&Some(*axis)));
            let is_channel = number == 0 && axes[*axis].role == Role::Channel && fastest_first[0] == 0;
            match (is_slower, is_channel) {
                (true, _) => skipped = skipped.saturating_add(stride.saturating_mul(placement.fixed[*axis])),
                (false, true) => channels = Channels { count: shape[*axis], wanted: Some(placement.fixed[*axis]) },
                (false, false) => return Err(refused()),
            }
        }
        stride = stride.saturating_mul(shape[*axis]);
    }
    let survey = survey_axes(&axes).map(|xyz| xyz.map(|axis| axes[axis].clone()));
    let dims = Dims(xyz.map(|axis| axis.map_or(1, |axis| shape[axis])));
    Ok(Arranged { dims, fastest_first, channels, skipped, survey })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_in_any_order() {
        let arranged = |shape: &[u64], names: &str, fortran_order: bool| {
            let header = NpyHeader { descr: "<f4".into(), fortran_order, shape: shape.into() };
            let axes = names.split(',').map(str::to_owned).collect();
            let selection = Selection { axes, ..Selection::default() };
            arrange("a.npy".as_ref(), &header, &selection, &mut Vec::new())
        };
        let found = arranged(&[4, 5, 6], "x,y,z", false).expect("a volume");
        assert_eq!((found.dims, found.fastest_first), (Dims([4, 5, 6]), [2, 1, 0]));
        let found = arranged(&[4, 5, 6], "inline,crossline,time", false).expect("a survey");
        assert_eq!((found.dims, found.fastest_first), (Dims([5, 4, 6]), [2, 0, 1]));
        assert!(found.survey.is_some());
        let found = arranged(&[2, 4, 5, 6, 3], "t,z,y,x,c", false).expect("frames and channels");
        assert_eq!((found.dims, found.channels.count), (Dims([6, 5, 4]), 3));
        assert!(arranged(&[4, 2, 5, 6], "z,t,y,x", false).is_err());
        assert!(arranged(&[4, 5, 6], "z,y", false).is_err() && arranged(&[4, 5, 6], "z,y,y", false).is_err());
        let found = arranged(&[4, 5, 6], "z,y,x", true).expect("Fortran order");
        assert_eq!((found.dims, found.fastest_first), (Dims([6, 5, 4]), [2, 1, 0]));
    }
}
