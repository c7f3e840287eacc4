//! Use of the attributes by which a file explains its numbers: fill values, valid ranges, scale, offset, unit.

use supervol_format::VoxelType;

use crate::cast::single;

/// Rule for attributes that explain stored numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Values {
    /// Absent values, scale, offset and unit are those that the file states.
    #[default]
    Explained,
    /// Numbers are read as they are stored: no scale, offset, unit or fill value of the file.
    Stored,
}

/// Text of a scale and an offset, such as `value = stored * 0.01 + 280`; `None` if they change nothing.
pub(crate) fn line(scale: f64, offset: f64) -> Option<String> {
    let times = if scale == 1.0 { String::new() } else { format!(" * {scale}") };
    let plus = match offset {
        0.0 => String::new(),
        _ if offset < 0.0 => format!(" - {}", -offset),
        _ => format!(" + {offset}"),
    };
    (scale != 1.0 || offset != 0.0).then(|| format!("value = stored{times}{plus}"))
}

/// A number of a type in few digits.
pub(crate) fn in_few_digits(value: f64, voxel_type: VoxelType) -> String {
    let is_long = value != 0.0 && !(1e-4..1e7).contains(&value.abs());
    match voxel_type {
        VoxelType::F32 if is_long => format!("{:e}", single(value)),
        VoxelType::F32 => single(value).to_string(),
        _ if is_long && voxel_type.is_float() => format!("{value:e}"),
        _ => value.to_string(),
    }
}
