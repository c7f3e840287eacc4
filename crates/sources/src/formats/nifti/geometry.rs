//! Geometry of a NIfTI volume: sform, else qform, else the spacings alone.
//!
//! World coordinates are the file's own, right-anterior-superior. The lengths of the affine's columns become the
//! spacing, their unit vectors the direction, so that a sheared sform is kept exactly. A matrix without an inverse is
//! replaced by the next of the three, with a note.

use glam::{DMat3, DQuat, DVec3};
use supervol_format::Geometry;

use super::header::Header;
use crate::Message;
use crate::cast::signed;

/// The geometry, and notes for the user.
pub(super) fn placement(header: &Header) -> (Geometry, Vec<Message>) {
    let mut notes = Vec::new();
    if header.sform_code > 0 {
        let origin = header.affine_rows.map(|row| row[3]);
        let columns: [DVec3; 3] =
            std::array::from_fn(|axis| DVec3::from_array(header.affine_rows.map(|row| row[axis])));
        match from_columns(columns, origin) {
            Ok(geometry) => {
                notes.push(world_note("sform", header.sform_code));
                return (geometry, notes);
            }
            Err(defect) => notes.push(format!("the sform is not used: {defect}").into()),
        }
    }
    let spacing = spacings(header, &mut notes);
    if header.qform_code > 0 {
        let columns = qform_columns(header, spacing);
        match from_columns(columns, header.quaternion_offset) {
            Ok(geometry) => {
                notes.push(world_note("qform", header.qform_code));
                return (geometry, notes);
            }
            Err(defect) => notes.push(format!("the qform is not used: {defect}").into()),
        }
    }
    notes.push("the header gives no orientation: the axes are the world's and the first voxel is the origin".into());
    (Geometry { spacing, ..Geometry::IDENTITY }, notes)
}

fn world_note(form: &str, code: i32) -> Message {
    let space = match code {
        1 => "scanner",
        2 => "aligned to another file",
        3 => "Talairach",
        4 => "MNI 152",
        5 => "a template",
        _ => "an unknown code",
    };
    format!("world coordinates are right-anterior-superior by the {form} ({space})").into()
}

/// Positive spacings along the three axes.
fn spacings(header: &Header, notes: &mut Vec<Message>) -> [f64; 3] {
    std::array::from_fn(|axis| {
        let stated = header.pixdim[axis + 1].abs();
        // Axes that the file does not have need no spacing.
        let needed = signed(axis as u64) < header.dim[0];
        if stated.is_finite() && stated > 0.0 {
            return stated;
        }
        if needed {
            notes.push(format!("spacing {stated} of axis {axis} is impossible: replaced by 1").into());
        }
        1.0
    })
}

/// Columns of R * diag(spacing). The third is reversed if `pixdim[0]` is negative (NIfTI-1 specification, method 2: a =
/// sqrt(1 - b^2 - c^2 - d^2)).
fn qform_columns(header: &Header, spacing: [f64; 3]) -> [DVec3; 3] {
    let vector = DVec3::from_array(header.quaternion);
    let scalar = (1.0 - vector.length_squared()).max(0.0).sqrt();
    let quaternion = DQuat::from_xyzw(vector.x, vector.y, vector.z, scalar);
    // Rounding to 32 bits makes the quaternions of half turns slightly too long. NaN stays NaN, and the caller finds
    // it.
    let length = quaternion.length();
    let rotation = if length > 0.0 { DMat3::from_quat(quaternion / length) } else { DMat3::NAN };
    let handedness = if header.pixdim[0] < 0.0 { -1.0 } else { 1.0 };
    [rotation.x_axis * spacing[0], rotation.y_axis * spacing[1], rotation.z_axis * spacing[2] * handedness]
}

/// Lengths and directions of the columns, or a description of their defect.
fn from_columns(columns: [DVec3; 3], origin: [f64; 3]) -> Result<Geometry, String> {
    let spacing = columns.map(DVec3::length);
    let [x, y, z] = [0, 1, 2].map(|axis| columns[axis] / spacing[axis]);
    // Adding 0 turns -0 into 0.
    let direction = DMat3::from_cols(x, y, z).transpose().to_cols_array().map(|v| v + 0.0);
    let geometry = Geometry { spacing, origin: origin.map(|v| v + 0.0), direction };
    match geometry.defect() {
        None => Ok(geometry),
        Some(defect) => Err(defect),
    }
}
