//! What is drawn: four volumes, from dense to sparse, each unshaded and shaded.
//!
//! Voxels are u8, written as a raw file that both programs read. World = index * spacing: no rotation, origin 0.

use std::path::PathBuf;

use glam::DVec3;
use serde_json::{Value, json};
use supervol_format::container::manifest::Source;
use supervol_format::{Dims, Geometry, VoxelType};
use supervol_preprocess::build;
use supervol_preprocess::source::VolumeSource;
use supervol_preprocess::source::nifti::NiftiSource;
use supervol_preprocess::source::raw::{RawOptions, RawSource};
use supervol_preprocess::source::spool::SpoolFolder;
use supervol_preprocess::source::synthetic::Synthetic;
use supervol_preprocess::source::{Endian, SourceError};
use supervol_runtime::frame::Backend;
use supervol_runtime::image::Image;
use supervol_runtime::scene::ResolvedScene;

use crate::context::{ChartError, Context, Scale};
use crate::volume::{Point, Volume, build_options};

/// Vertical angle of view of every case, degrees.
const FOV_Y: f64 = 30.0;
/// Core of the bricks: what `supervol build` makes.
const CORE: u32 = 64;
/// Seed of the synthetic volumes.
const SEED: u64 = 1;

/// A volume and how it is looked at.
#[derive(Debug, Clone)]
pub struct Recipe {
    /// Name of the case.
    pub name: &'static str,
    voxels: Voxels,
    /// World lengths between voxels.
    spacing: [f64; 3],
    /// From the middle to the eye; any length.
    direction: [f64; 3],
    /// Distance of the eye, in half diagonals of the volume.
    radii: f64,
    /// Up in the picture.
    up: [f64; 3],
    points: &'static [Point],
}

#[derive(Debug, Clone, Copy)]
enum Voxels {
    Synthetic(&'static str, u64),
    Carp,
}

/// A smooth tent around the middle of the range: a veil with ripples, hardly anything opaque.
const VEIL: &[Point] = &[
    (90.0, [0.1, 0.3, 0.9], 0.0),
    (128.0, [0.2, 0.9, 0.6], 0.05),
    (165.0, [1.0, 0.7, 0.2], 0.02),
    (200.0, [1.0, 0.2, 0.1], 0.0),
];
/// Both ends of the range, zero (128) transparent, on blue and red: how amplitudes are looked at.
const WINGS: &[Point] = &[
    (40.0, [0.1, 0.2, 0.9], 0.3),
    (95.0, [0.5, 0.6, 1.0], 0.0),
    (161.0, [1.0, 0.6, 0.5], 0.0),
    (216.0, [0.9, 0.1, 0.1], 0.3),
];
/// Bright tubes, nothing else.
const TUBES: &[Point] = &[(30.0, [0.6, 0.1, 0.1], 0.0), (120.0, [0.9, 0.4, 0.3], 0.15), (250.0, [1.0, 0.9, 0.8], 0.6)];
/// Flesh as a veil, bones nearly opaque.
const FLESH_AND_BONES: &[Point] = &[
    (40.0, [0.55, 0.25, 0.15], 0.0),
    (70.0, [0.75, 0.35, 0.22], 0.004),
    (100.0, [0.88, 0.50, 0.38], 0.006),
    (118.0, [0.95, 0.75, 0.60], 0.02),
    (140.0, [0.98, 0.95, 0.88], 0.30),
    (220.0, [1.0, 1.0, 1.0], 0.8),
];

/// What a run draws: all volumes at full scale, two small ones otherwise.
///
/// # Errors
/// If a name of `only` is none.
pub fn recipes(context: &Context<'_>, only: &[String]) -> Result<Vec<Recipe>, ChartError> {
    let synthetic = |name, edge, spacing, up, points| Recipe {
        name,
        voxels: Voxels::Synthetic(name, edge),
        spacing,
        direction: [0.57, -0.71, 0.41],
        radii: 3.3,
        up,
        points,
    };
    let mut all = vec![
        synthetic("marschner-lobb", context.pick(128, 32), [1.0; 3], [0.0, 0.0, 1.0], VEIL),
        synthetic("vessels", context.pick(256, 48), [1.0; 3], [0.0, 0.0, 1.0], TUBES),
    ];
    if context.scale == Scale::Full {
        // Samples of a survey are closer than its traces.
        all.push(synthetic("seismic", 192, [25.0, 25.0, 10.0], [0.0, 0.0, -1.0], WINGS));
        let carp = synthetic("carp", 0, [1.0; 3], [0.0, 0.0, 1.0], FLESH_AND_BONES);
        all.push(Recipe { voxels: Voxels::Carp, direction: [0.8, -0.35, 0.35], radii: 3.0, ..carp });
    }
    if let Some(unknown) = only.iter().find(|name| all.iter().all(|recipe| recipe.name != name.as_str())) {
        let names: Vec<&str> = all.iter().map(|recipe| recipe.name).collect();
        return Err(ChartError::Command(format!("no scene '{unknown}'; scenes are: {}", names.join(", "))));
    }
    all.retain(|recipe| only.is_empty() || only.iter().any(|name| name == recipe.name));
    Ok(all)
}

/// A volume as both programs get it.
pub struct Built {
    /// The container.
    pub volume: Volume,
    /// The raw file: u8, x fastest.
    pub raw: PathBuf,
}

impl Recipe {
    /// Writes the raw file, and builds the container of it.
    ///
    /// # Errors
    /// If either cannot be written.
    pub fn build(&self, context: &Context<'_>, carp_nifti_gz: &[u8]) -> Result<Built, ChartError> {
        (context.say)(&format!("making the volume {}", self.name));
        let source = self.source(context, carp_nifti_gz)?;
        let dims = source.info().dims;
        let mut voxels = vec![0; dims.0.iter().product::<u64>() as usize];
        source.read_box(dims.full_box(), &mut voxels)?;
        let raw = context.folder.join(format!("{}.raw", self.name));
        write(&raw, &voxels)?;
        drop(voxels);

        let geometry = Geometry { spacing: self.spacing, ..Geometry::IDENTITY };
        let options = RawOptions {
            dims,
            voxel_type: VoxelType::U8,
            endian: Endian::Little,
            header_bytes: 0,
            geometry,
            nodata: None,
        };
        let same = RawSource::open(&raw, &options)?;
        let path = context.folder.join(format!("{}.svol", self.name));
        build(&same, Source::computed(self.name), &path, &build_options(CORE), &|_| ())?;
        Ok(Built { volume: Volume::open(self.name, &path)?, raw })
    }

    fn source(&self, context: &Context<'_>, carp_nifti_gz: &[u8]) -> Result<Box<dyn VolumeSource>, ChartError> {
        let source: Box<dyn VolumeSource> = match self.voxels {
            Voxels::Synthetic(name, edge) => {
                Box::new(Synthetic::new(name, Dims([edge; 3]), Some(VoxelType::U8), SEED)?)
            }
            Voxels::Carp => {
                let path = context.folder.join("carp.nii.gz");
                write(&path, carp_nifti_gz)?;
                Box::new(NiftiSource::open(&path, &SpoolFolder::at(context.folder))?)
            }
        };
        let found = source.info().voxel_type;
        if found != VoxelType::U8 {
            return Err(SourceError::Options(format!("{}: voxels are {found}, not u8", self.name)).into());
        }
        Ok(source)
    }

    /// Unshaded and shaded.
    #[must_use]
    pub fn cases<'a>(&'a self, built: &'a Built) -> [Case<'a>; 2] {
        [false, true].map(|is_shaded| Case { name: self.name, recipe: self, built, is_shaded })
    }
}

/// One picture that both programs draw.
#[derive(Clone, Copy)]
pub struct Case<'a> {
    /// Name of the volume.
    pub name: &'static str,
    recipe: &'a Recipe,
    /// The volume.
    pub built: &'a Built,
    is_shaded: bool,
}

impl Case<'_> {
    /// `unshaded` or `shaded`.
    #[must_use]
    pub fn shading_name(&self) -> &'static str {
        if self.is_shaded { "shaded" } else { "unshaded" }
    }

    /// The smallest spacing: the unit of steps and of the transfer function's opacities.
    #[must_use]
    pub fn unit_distance(&self) -> f64 {
        self.recipe.spacing.into_iter().fold(f64::INFINITY, f64::min)
    }

    /// Everything about the picture but its size, as the scene file has it.
    #[must_use]
    pub fn members(&self) -> Value {
        let volume = &self.built.volume;
        let target = volume.world(volume.middle());
        let direction = DVec3::from_array(self.recipe.direction).normalize();
        let eye = target + direction * volume.radius() * self.recipe.radii;
        let points = self
            .recipe
            .points
            .iter()
            .map(|&(value, color, alpha)| json!({"value": value, "color": color, "alpha": alpha}));
        let last = volume.facts.dims.0.map(|n| n - 1);
        let mut members = json!({
            "camera": {"eye": eye.to_array(), "target": target.to_array(), "up": self.recipe.up, "fov_y": FOV_Y},
            "transfer_function": {"unit_distance": self.unit_distance(), "points": points.collect::<Vec<_>>()},
            "clip": {"box": [[0, 0, 0], last]},
        });
        if self.is_shaded {
            members["shading"] = json!({"ambient": 0.3, "diffuse": 0.7, "specular": 0.2, "shininess": 32.0});
        }
        members
    }

    /// The scene at this many pixels.
    ///
    /// # Errors
    /// If it is none: a mistake in the recipe.
    pub fn scene(&self, size: [u32; 2]) -> Result<ResolvedScene, ChartError> {
        let mut members = self.members();
        members["image"] = json!({"width": size[0], "height": size[1]});
        let scene = supervol_runtime::scene::Scene::from_json(&members.to_string())?;
        Ok(scene.resolve(&self.built.volume.facts)?)
    }

    /// The picture by the reference integrator.
    ///
    /// # Errors
    /// If it cannot be made.
    pub fn reference(&self, size: [u32; 2]) -> Result<Image, ChartError> {
        self.built.volume.finest(&self.scene(size)?, Backend::Reference)
    }

    /// Voxels along x, y, z; world lengths between them.
    #[must_use]
    pub fn grid(&self) -> ([u64; 3], [f64; 3]) {
        (self.built.volume.facts.dims.0, self.recipe.spacing)
    }
}

fn write(path: &std::path::Path, bytes: &[u8]) -> Result<(), ChartError> {
    std::fs::write(path, bytes).map_err(|source| ChartError::Write { path: path.into(), source })
}
