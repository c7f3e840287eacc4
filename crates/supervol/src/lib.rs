//! Supervol draws volumes larger than memory, and states how far each picture is from the exact one.
//!
//! This crate is the way in for programs. A volume file is built once into a *container*: bricks of voxels at several levels of
//! detail, with error bounds. A [`Volume`] opens a container, a [`Scene`] says what picture is wanted, and a [`Picture`] is what
//! comes of both.
//!
//! ```
//! # let folder = tempfile::tempdir()?;
//! # supervol::doc_container(&folder.path().join("ball.svol"))?;
//! # std::env::set_current_dir(folder.path())?;
//! use supervol::{Options, Scene, Volume};
//!
//! let volume = Volume::open("ball.svol")?;
//! let picture = volume.draw(&Scene::default(), &Options::default())?;
//! picture.save("ball.png")?;
//! assert!(picture.is_converged() && picture.failures().is_empty());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! That is the picture of `supervol render ball.svol -o ball.png`, bit for bit.
//!
//! # Overview
//!
//! | task | begin at |
//! |---|---|
//! | build a container | [`build_file`], [`build_source`], [`ArraySource`] |
//! | open a volume | [`Volume::open`] |
//! | read voxels as an array | [`Volume::read`] |
//! | say what a picture shows | [`Scene`]; `{}` is the default picture |
//! | draw one picture | [`Volume::draw`] |
//! | draw pictures while a camera moves | [`Volume::renderer`], [`Renderer::advance`] |
//! | show pictures on a screen | [`Renderer::image`], [`Renderer::stats`], [`Renderer::look_ahead`] |
//! | see which bricks failed, or are in memory | [`Renderer::bricks_failed`], [`Renderer::bricks_in_memory`] |
//! | know how exact a picture is | [`Picture::error_stated`], [`Picture::error_map`], [`Picture::check`] |
//! | say what is reduced, and why | [`Picture::fidelity`] |
//! | prove the picture of a file | [`Picture::record`], [`Volume::prove`] |
//! | find the voxel under a pixel | [`Renderer::pick`] |
//! | draw by an engine of one's own | [`Engine`], [`Volume::draw_by`], [`Volume::renderer_by`] |
//!
//! # Conventions
//!
//! - Arrays of three are `[x, y, z]`, and x is contiguous in memory. Voxel (i, j, k) is a sample at the index point (i, j, k).
//! - World coordinates are the file's own: millimetres of a patient, metres of a survey. Angles are degrees.
//! - Values are in data units: stored value times scale plus offset. Absent voxels are NaN.
//! - Errors of pictures are shares of full scale (1 is white) or grey levels (1/255 of it), as each name says.
//! - Memory is a number of bytes that the caller gives ([`Options::host_memory_bytes`]).
//!
//! # Features
//!
//! `sources` (default) reads volume files and builds containers; `images` (default) writes PNG, OpenEXR and NumPy files;
//! `gpu` (default) also draws on graphics devices. Without `gpu` no wgpu is compiled.
//!
//! # Lower layers
//!
//! The crates below are re-exported for what the entries above do not cover: [`format`](mod@format), [`scene`], [`runtime`], and with the feature
//! `sources` also `sources` and `preprocess`.

mod array;
#[cfg(feature = "sources")]
mod build;
mod error;
mod picture;
mod renderer;
mod volume;

pub use array::Array;
#[cfg(feature = "sources")]
pub use build::{ArraySource, build_file, build_source};
pub use error::Error;
pub use picture::Picture;
pub use renderer::Renderer;
pub use volume::Volume;

pub use supervol_format::canceller::Canceller;
pub use supervol_format::{BrickKey, Container, Dims, Geometry, Lod, ValueRange, VoxelBox, VoxelType};
pub use supervol_runtime::engines::engine::Engine;
pub use supervol_runtime::engines::error::EngineError;
pub use supervol_runtime::engines::gpu::error::GpuError;
pub use supervol_runtime::engines::maps::work_in_colors;
pub use supervol_runtime::engines::rules::MAX_ERROR_LIMITS;
pub use supervol_runtime::lod::by_error::ANY_ERROR;
pub use supervol_runtime::render::accuracy::check::{CheckProgress, ErrorMeasured, SEED as CHECK_SEED};
pub use supervol_runtime::render::accuracy::proof::{
    Claim, ClaimKind, ClaimResult, Proof, ProofError, ProofOptions, WrongPixel,
};
pub use supervol_runtime::render::accuracy::stated::{ErrorStated, in_colors as errors_in_colors};
pub use supervol_runtime::render::error::{ErrorKind, RenderError};
pub use supervol_runtime::render::fidelity::{Dimension, Fidelity, Lossiness, Outlook, grey_levels, missing_in_words};
pub use supervol_runtime::render::options::{
    Backend, LevelChoice, OnProgress, Progress as DrawingProgress, Refining, RenderOptions as Options,
};
pub use supervol_runtime::render::record::PictureRecord;
pub use supervol_runtime::render::renderer::{Ahead, MakeEngine, NO_DEVICE, Picked, PickedOn, Step};
pub use supervol_runtime::render::stats::FrameStats;
pub use supervol_runtime::render::volume::PlacedVolume;
pub use supervol_scene::facts::{DataKind, VolumeFacts};
pub use supervol_scene::image::ImageFormat;
pub use supervol_scene::scene::{CameraSpec, Scene};

/// Values of options that change the work and not the picture. They are for tests and measurements.
pub mod tuning {
    pub use supervol_runtime::engines::cpu::Caster;
    pub use supervol_runtime::engines::packets::PacketRule;
    pub use supervol_runtime::engines::packets::simd::InstructionSet;
    pub use supervol_runtime::stream::classify::Skipping;
    pub use supervol_runtime::stream::held::BrickForm;
}

#[cfg(feature = "sources")]
pub use supervol_files::Existing;
#[cfg(feature = "sources")]
pub use supervol_preprocess::{BuildOptions, MaxError, report::BuildReport, report::Progress};
#[cfg(feature = "sources")]
pub use supervol_sources::{SourceError, SourceInfo, VolumeSource};

pub use supervol_format as format;
#[cfg(feature = "sources")]
pub use supervol_preprocess as preprocess;
pub use supervol_runtime as runtime;
pub use supervol_scene as scene;
#[cfg(feature = "sources")]
pub use supervol_sources as sources;

/// Writes the container that the examples of this documentation open: a ball of 48^3 bytes, bright inside.
///
/// # Errors
/// If the file exists or cannot be written.
#[doc(hidden)]
#[cfg(feature = "sources")]
pub fn doc_container(path: &std::path::Path) -> Result<(), Error> {
    const SIDE: u64 = 48;
    let ball = supervol_sources::computed::Computed::new([SIDE; 3], VoxelType::U8, |place| {
        let from_middle = place.map(|v| v as f64 - 0.5 * (SIDE - 1) as f64);
        let distance = from_middle.map(|v| v * v).iter().sum::<f64>().sqrt();
        (250.0 - 12.0 * (distance - 12.0)).clamp(0.0, 250.0)
    });
    build_source(&ball, "ball", path, &BuildOptions::default(), &|_| {}).map(drop)
}
