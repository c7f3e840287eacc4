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
pub mod vessels;

use supervol_format::voxel_type::Voxel;
use supervol_format::{Dims, Geometry, VoxelBox, VoxelType, with_voxel};

use super::{Axis, SourceError, SourceInfo, VolumeSource};
use closed_form::ClosedForm;
use seismic::Seismic;
use vessels::Vessels;

/// All names that [`Synthetic::new`] knows.
pub const NAMES: [&str; 6] = ["marschner-lobb", "seismic", "vessels", "sphere", "ramp", "constant"];

/// World distance between the voxels of `seismic` in metres: 25 m between lines and traces, 10 m between samples.
const SEISMIC_SPACING_M: [f64; 3] = [25.0, 25.0, 10.0];

/// Voxels along x that are computed together: columns share their tables, and the tables stay in the cache.
const CHUNK_VOXELS: usize = 1024;

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
            return Err(SourceError::Options(format!("--dims: expected {expected}, found {dims}")));
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
                return Err(SourceError::Options(format!("no synthetic volume is called `{name}`; there are {names}")));
            }
        };
        info.notes.push(format!("computed: {name}, seed {seed}"));
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

/// Buffer of a read, and its box.
struct Target<'a> {
    voxels: VoxelBox,
    voxel_type: VoxelType,
    out: &'a mut [u8],
}

impl Target<'_> {
    /// The bytes of `length` voxels along x from `start` on; all must lie in the box.
    fn row(&mut self, start: [u64; 3], length: usize) -> &mut [u8] {
        let [nx, ny, _] = self.voxels.extent();
        // Inside the box, whose extent fits the address space.
        let [x, y, z] = std::array::from_fn(|a| (start[a] - self.voxels.start[a]) as usize);
        let bytes = self.voxel_type.bytes();
        let first = (x + nx * (y + ny * z)) * bytes;
        &mut self.out[first..first + length * bytes]
    }

    /// Starts and lengths of the pieces along x that are computed together.
    fn chunks(&self) -> impl Iterator<Item = (u64, usize)> + use<> {
        let (start, end) = (self.voxels.start[0], self.voxels.end[0]);
        (start..end).step_by(CHUNK_VOXELS).map(move |x| (x, CHUNK_VOXELS.min((end - x) as usize)))
    }
}

/// Conversion of field values to stored values: `stored = value * gain + bias`, rounded for integer types.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Scale {
    gain: f64,
    bias: f64,
}

impl Scale {
    /// Scale for values from 0 to 1.
    fn unit(voxel_type: VoxelType) -> Self {
        let gain = if voxel_type.is_float() { 1.0 } else { voxel_type.limits().1.min(65535.0) };
        Self { gain, bias: 0.0 }
    }

    /// Scale for values from -1 to 1.
    fn amplitude(voxel_type: VoxelType) -> Self {
        match voxel_type {
            VoxelType::U8 => Self { gain: 127.0, bias: 128.0 },
            VoxelType::I8 => Self { gain: 127.0, bias: 0.0 },
            VoxelType::U16 | VoxelType::U32 => Self { gain: 30000.0, bias: 32768.0 },
            VoxelType::I16 | VoxelType::I32 | VoxelType::F32 | VoxelType::F64 => Self { gain: 30000.0, bias: 0.0 },
        }
    }

    /// Writes doubles as voxels, rounded to nearest.
    fn write(self, values: &[f64], voxel_type: VoxelType, out: &mut [u8]) {
        with_voxel!(voxel_type, V => {
            for (value, voxel) in values.iter().zip(out.chunks_exact_mut(size_of::<V>())) {
                V::from_f64(value * self.gain + self.bias).write_le(voxel);
            }
        });
    }

    /// Writes f32 values as voxels. Integers are rounded half up, which compiles to a few vector instructions.
    fn write_fast(self, values: &[f32], voxel_type: VoxelType, out: &mut [u8]) {
        match voxel_type {
            VoxelType::U8 => {
                let (gain, bias) = (self.gain as f32, self.bias as f32 + 0.5);
                for (value, voxel) in values.iter().zip(out) {
                    *voxel = (value * gain + bias) as i32 as u8;
                }
            }
            VoxelType::I8 => self.write_integers::<1>(values, out),
            VoxelType::U16 | VoxelType::I16 => self.write_integers::<2>(values, out),
            VoxelType::U32 | VoxelType::I32 => self.write_integers::<4>(values, out),
            VoxelType::F32 | VoxelType::F64 => with_voxel!(voxel_type, V => {
                for (value, voxel) in values.iter().zip(out.chunks_exact_mut(size_of::<V>())) {
                    V::from_f64(f64::from(*value) * self.gain + self.bias).write_le(voxel);
                }
            }),
        }
    }

    /// Writes integers: the low bytes of a two's complement number are the voxel, signed or not.
    fn write_integers<const BYTES: usize>(self, values: &[f32], out: &mut [u8]) {
        // Shifted to be positive, so that truncation rounds down.
        const SHIFT: i32 = 1 << 17;
        let bias = self.bias + 0.5 + f64::from(SHIFT);
        for (value, voxel) in values.iter().zip(out.as_chunks_mut::<BYTES>().0) {
            let stored = (f64::from(*value) * self.gain + bias) as i32 - SHIFT;
            let bytes = stored.to_le_bytes();
            *voxel = std::array::from_fn(|i| bytes[i]);
        }
    }
}
