//! Volumes computed from coordinates: test fields with known values, and substitutes for data sets of any size.
//!
//! Every voxel depends only on its coordinates, the dims and the seed. Boxes can therefore be read in any order, by any
//! number of threads, with equal results. Only tables of bounded size are stored.
//!
//! | name | description | values |
//! |---|---|---|
//! | `marschner-lobb` | the test signal of Marschner and Lobb (1994), f_M = 6, alpha = 0.25, on [-1, 1]^3 | unit |
//! | `seismic` | folded, faulted, channelled reflectors under noise ([`seismic`]) | amplitude |
//! | `vessels` | a sparse tree of bright tubes, more than 95 % exactly zero ([`vessels`]) | unit |
//! | `sphere` | a linear distance field: 1 at the centre, 0.5 on the sphere, 0 from twice its radius on | unit |
//! | `ramp` | the index x; scaled down to the type's greatest value if it would not fit | index |
//! | `constant` | 100 everywhere | stored |
//!
//! *Unit* values run from 0 to 1 in float types and from 0 to the greatest value (at most 65,535) in integer types.
//! *Amplitudes* are symmetric about zero: +-127 around 128 in u8, +-127 in i8, +-30,000 around 32,768 in u16 and u32,
//! +-30,000 in all others.
//! Voxels have the same bits on every machine, as far as the platform's `sin`, `cos`, `exp` and `sqrt` of doubles
//! agree.

mod closed_form;
mod noise;
pub mod seismic;
mod target;
pub mod vessels;

use supervol_format::{Dims, Geometry, VoxelBox, VoxelType};

use super::{Axis, SourceError, SourceInfo, VolumeSource};
use crate::{Message, ReadOption};
use closed_form::ClosedForm;
use seismic::Seismic;
use target::Target;
use vessels::Vessels;

/// All names that [`Synthetic::new`] knows.
pub const NAMES: [&str; 6] = ["marschner-lobb", "seismic", "vessels", "sphere", "ramp", "constant"];

/// World distance between the voxels of `seismic` in metres: 25 m between lines and traces, 10 m between samples.
const SEISMIC_SPACING_M: [f64; 3] = [25.0, 25.0, 10.0];

/// A volume computed on read.
#[derive(Debug)]
pub struct Synthetic {
    info: SourceInfo,
    field: Field,
}

#[derive(Debug)]
enum Field {
    ClosedForm(ClosedForm),
    Seismic(Box<Seismic>),
    Vessels(Vessels),
}

impl Synthetic {
    /// The volume with this name. The default voxel type is u8. The seed changes `seismic` and `vessels`.
    ///
    /// # Errors
    /// If the name is unknown, or the dims are not allowed.
    pub fn new(name: &str, dims: Dims, voxel_type: Option<VoxelType>, seed: u64) -> Result<Self, SourceError> {
        let voxel_type = voxel_type.unwrap_or(VoxelType::U8);
        if !dims.is_valid() || dims.bytes(voxel_type).is_none() {
            let expected = format!("1 to {} voxels on each axis and less than 2^64 bytes in all", Dims::LIMIT);
            let message = Message::from(ReadOption::Dims).text(format_args!(": expected {expected}, found {dims}"));
            return Err(SourceError::options(message));
        }
        let mut info = SourceInfo::plain("synth", dims, voxel_type);
        let field = match name {
            "marschner-lobb" => Field::ClosedForm(ClosedForm::marschner_lobb(dims)),
            "sphere" => Field::ClosedForm(ClosedForm::sphere(dims)),
            "ramp" => Field::ClosedForm(ClosedForm::ramp(dims, voxel_type)),
            "constant" => Field::ClosedForm(ClosedForm::Constant),
            "vessels" => Field::Vessels(Vessels::new(dims, seed)),
            "seismic" => {
                info.geometry = Geometry { spacing: SEISMIC_SPACING_M, ..Geometry::IDENTITY };
                info.axes = ["crossline", "inline", "depth"].map(|name| Axis { name: name.into(), unit: "m".into() });
                Field::Seismic(Box::new(Seismic::new(dims, seed)))
            }
            _ => {
                let names = NAMES.join(", ");
                return Err(SourceError::options(format!("no synthetic volume is called `{name}`; there are {names}")));
            }
        };
        info.notes.push(format!("computed: {name}, seed {seed}").into());
        Ok(Self { info, field })
    }
}

impl VolumeSource for Synthetic {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        let SourceInfo { dims, voxel_type, .. } = self.info;
        assert!((0..3).all(|a| voxels.end[a] <= dims.0[a]), "box {voxels:?} leaves the grid {dims}");
        let expected = voxels.voxels() * voxel_type.bytes();
        assert_eq!(out.len(), expected, "buffer of {} bytes for a box of {expected}", out.len());
        let mut target = Target { voxels, voxel_type, out };
        match &self.field {
            Field::ClosedForm(field) => field.fill(&mut target),
            Field::Seismic(field) => field.fill(&mut target),
            Field::Vessels(field) => field.fill(&mut target),
        }
        Ok(())
    }
}
