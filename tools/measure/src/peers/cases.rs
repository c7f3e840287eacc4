//! Cases of the comparison: volumes of several densities, each unshaded and shaded, or the user's own volume.
//!
//! Both programs get the same voxels: Supervol a container, the peer the voxels of this container in a file that NumPy
//! reads. The drawn domain ends at the centres of the outermost voxels, as the peer's domain does.
//!
//! | scene | volume | transfer function: no opacity up to, rising to |
//! |---|---|---|
//! | `marschner-lobb` | the test signal, 256^3, values everywhere | 0.3 of the range, 0.1 a voxel at its top |
//! | `seismic` | a synthetic survey, 512^3, half of it visible: dense | 0.55, 0.3 a voxel at its top |
//! | `vessels` | branching tubes, 512^3, nearly all of it empty: sparse | 0.2, 0.3 a voxel at 0.9 |
//! | `carp` | computed tomography, 256 x 512 x 256 | flesh as a veil, bones nearly opaque |
//!
//! Published times refer to the first three scenes: spacing 1, angle of view 30 degrees, one ramp from blue to yellow.
//! The eye is 2.6 edges from the centre at azimuth 30 and elevation 20 degrees. The volume fills the picture's height;
//! its lowest corner lies just outside.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use glam::DVec3;
use serde_json::json;
use supervol_export::extract::{Extraction, extract};
use supervol_format::container::manifest::Source;
use supervol_format::{Dims, Geometry, Lod, VoxelBox, VoxelType};
use supervol_preprocess::{Existing, build};
use supervol_runtime::engines::reference::ReferenceVolume;
use supervol_runtime::render::accuracy::reference::load_level;
use supervol_runtime::render::error::RenderError;
use supervol_scene::scene::{CameraSpec, ClipSpec, ImageSpec, ResolvedScene, Scene};
use supervol_sources::formats::nifti::NiftiSource;
use supervol_sources::input::spool::SpoolFolder;
use supervol_sources::synthetic::Synthetic;
use supervol_sources::{SourceError, SourceInfo, VolumeSource};

use crate::context::{ChartError, Context, Pace, Scale};
use crate::stability::streaming::session::translucent;
use crate::virtual_volume::{Field, VirtualVolume};
use crate::volume::{Point, Volume, build_options, transfer_function};

/// Vertical angle of view of every scene, degrees.
const FOV_Y: f64 = 30.0;
/// Core of the bricks, voxels: the default of `supervol build`.
const CORE: u32 = 64;
/// Seed of the synthetic volumes.
const SEED: u64 = 1;
/// Distance of the eye from the centre of a synthetic volume, in edges of the volume.
const EDGES_AWAY: f64 = 2.6;
/// Direction from the centre of a synthetic volume to the eye: azimuth around z from x, and elevation, degrees.
const AZIMUTH_ELEVATION: [f64; 2] = [30.0, 20.0];
/// Largest memory for the reference's copy of a volume, bytes: 1024^3 voxels in `f64` fit.
const REFERENCE_MEMORY_BYTES: u64 = 9 << 30;
/// Memory for writing the peer's copy of the voxels, bytes.
const EXTRACTION_MEMORY_BYTES: u64 = 256 << 20;

/// Volumes to draw.
#[derive(Debug, Clone)]
pub enum Subject {
    /// Scenes of these names; if empty, all scenes of the scale.
    Scenes(Vec<String>),
    /// The user's own volume.
    Own {
        /// A container.
        container: PathBuf,
        /// Its scene; the comparison sets image size and clip box.
        scene: Box<Scene>,
    },
    /// Virtual cube with this many voxels along an edge ([`crate::virtual_volume`]).
    Virtual(Field, u64),
}

/// Looks of a scene to draw.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Looks {
    /// Unshaded and shaded.
    #[default]
    Both,
    /// Unshaded only.
    Unshaded,
    /// Shaded only.
    Shaded,
}

/// A volume that is not built yet, and its looks.
#[derive(Debug, Clone)]
pub enum Planned {
    /// A built-in scene.
    Scene(Recipe),
    /// See [`Subject::Own`].
    Own(PathBuf, Box<Scene>),
    /// See [`Subject::Virtual`].
    Virtual(Field, u64),
}

/// A built-in scene.
#[derive(Debug, Clone)]
pub struct Recipe {
    name: &'static str,
    voxels: Voxels,
    /// Direction from the centre to the eye, any length.
    direction: DVec3,
    distance: Distance,
    points: &'static [Point],
    /// Whether a quick run includes the scene by default.
    is_quick: bool,
}

/// Distance of the eye from the centre.
#[derive(Debug, Clone, Copy)]
enum Distance {
    /// In half diagonals of the volume.
    Radii(f64),
    /// In edges along x.
    Edges(f64),
}

#[derive(Debug, Clone, Copy)]
enum Voxels {
    Synthetic(&'static str, u64),
    Carp,
}

const DARK: [f64; 3] = [0.25, 0.45, 0.8];
const BRIGHT: [f64; 3] = [1.0, 0.85, 0.5];
/// Ramp from 0.3 of the byte range to its top.
const VEIL: &[Point] = &[(76.5, DARK, 0.0), (255.0, BRIGHT, 0.1)];
/// Ramp from 0.55 of the byte range to its top: positive amplitudes.
const AMPLITUDES: &[Point] = &[(140.25, DARK, 0.0), (255.0, BRIGHT, 0.3)];
/// Ramp from 0.2 to 0.9 of the byte range.
const TUBES: &[Point] = &[(51.0, DARK, 0.0), (229.5, BRIGHT, 0.3)];
/// Waves with different colours and almost equal opacities.
const MIST: &[Point] = &[(-30_000.0, DARK, 0.14), (30_000.0, BRIGHT, 0.16)];
/// Flesh as a veil, bones nearly opaque.
const FLESH_AND_BONES: &[Point] = &[
    (40.0, [0.55, 0.25, 0.15], 0.0),
    (70.0, [0.75, 0.35, 0.22], 0.004),
    (100.0, [0.88, 0.50, 0.38], 0.006),
    (118.0, [0.95, 0.75, 0.60], 0.02),
    (140.0, [0.98, 0.95, 0.88], 0.30),
    (220.0, [1.0, 1.0, 1.0], 0.8),
];

/// Volumes of a run, in order. `edge`: voxels along an edge of the synthetic volumes; `None`: each volume's default.
///
/// # Errors
/// If a scene name is unknown.
pub fn planned(context: &Context<'_>, subject: &Subject, edge: Option<u64>) -> Result<Vec<Planned>, ChartError> {
    let only = match subject {
        Subject::Own { container, scene } => return Ok(vec![Planned::Own(container.clone(), scene.clone())]),
        Subject::Virtual(field, edge) => return Ok(vec![Planned::Virtual(*field, *edge)]),
        Subject::Scenes(only) => only,
    };
    let [azimuth, elevation] = AZIMUTH_ELEVATION.map(f64::to_radians);
    let direction = DVec3::new(elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin());
    let synthetic = |name, [full, small]: [u64; 2], points| Recipe {
        name,
        voxels: Voxels::Synthetic(name, edge.unwrap_or(context.pick(full, small))),
        direction,
        distance: Distance::Edges(EDGES_AWAY),
        points,
        is_quick: true,
    };
    let carp = Recipe {
        name: "carp",
        voxels: Voxels::Carp,
        direction: DVec3::new(0.8, -0.35, 0.35),
        distance: Distance::Radii(3.0),
        points: FLESH_AND_BONES,
        is_quick: false,
    };
    let mut all = vec![
        synthetic("marschner-lobb", [256, 32], VEIL),
        Recipe { is_quick: false, ..synthetic("seismic", [512, 48], AMPLITUDES) },
        synthetic("vessels", [512, 48], TUBES),
        carp,
    ];
    if let Some(unknown) = only.iter().find(|name| all.iter().all(|recipe| recipe.name != name.as_str())) {
        let names: Vec<&str> = all.iter().map(|recipe| recipe.name).collect();
        return Err(ChartError::Command(format!("no scene '{unknown}'; scenes are: {}", names.join(", "))));
    }
    let is_wanted = |recipe: &Recipe| match only.is_empty() {
        true => recipe.is_quick || context.scale == Scale::Full,
        false => only.iter().any(|name| name == recipe.name),
    };
    all.retain(is_wanted);
    Ok(all.into_iter().map(Planned::Scene).collect())
}

/// A built volume, in the form for each program.
#[derive(Debug)]
pub struct Built {
    /// Name of the scene or of the file.
    pub name: String,
    /// The container.
    pub volume: Volume,
    /// Look names and scenes, still without image size and clip box.
    pictures: Vec<(&'static str, Scene)>,
    grid_file: OnceLock<PathBuf>,
    exact: OnceLock<Option<ReferenceVolume>>,
}

impl Planned {
    /// Builds the container or opens it.
    ///
    /// # Errors
    /// If the container cannot be built, or is too thin for the comparison.
    pub fn build(&self, context: &Context<'_>, looks: Looks, carp_nifti_gz: &[u8]) -> Result<Built, ChartError> {
        let (volume, pictures) = match self {
            Self::Scene(recipe) => {
                let volume = recipe.build(context, carp_nifti_gz)?;
                let pictures = recipe.pictures(&volume, looks)?;
                (volume, pictures)
            }
            Self::Own(path, scene) => {
                let name = path.file_stem().map_or("volume".into(), |name| name.to_string_lossy());
                let name = name.trim_end_matches(".nii");
                (Volume::open(name, path)?, vec![("default", scene.as_ref().clone())])
            }
            Self::Virtual(field, edge) => {
                let (volume, _) = VirtualVolume::open(*field, [*edge; 3], CORE)?;
                let look = match field {
                    Field::BrickId => translucent(volume.radius()),
                    Field::Waves => transfer_function(0.5 * volume.radius(), MIST),
                };
                let scene = Scene::from_json(&format!("{{{look}}}"))?;
                (volume, vec![("unshaded", scene)])
            }
        };
        if volume.facts.dims.0.contains(&1) {
            let message = format!("{}: {} voxels; a comparison needs two on each axis", volume.name, volume.facts.dims);
            return Err(ChartError::Command(message));
        }
        let name = volume.name.clone();
        Ok(Built { name, volume, pictures, grid_file: OnceLock::new(), exact: OnceLock::new() })
    }
}

impl Recipe {
    fn build(&self, context: &Context<'_>, carp_nifti_gz: &[u8]) -> Result<Volume, ChartError> {
        let source: Box<dyn VolumeSource> = match self.voxels {
            Voxels::Synthetic(name, edge) => {
                Box::new(Synthetic::new(name, Dims([edge; 3]), Some(VoxelType::U8), SEED)?)
            }
            Voxels::Carp => {
                let path = context.folder.join("carp.nii.gz");
                std::fs::write(&path, carp_nifti_gz)
                    .map_err(|source| ChartError::Write { path: path.clone(), source })?;
                Box::new(NiftiSource::open(&path, &SpoolFolder::at(context.folder))?)
            }
        };
        let source = InIndexSpace::new(source);
        (context.say)(&format!("making the volume {}, {}", self.name, source.info().dims));
        let path = context.folder.join(format!("{}.svol", self.name));
        let pace = Pace::new(context.say);
        let origin = Source { format: source.info().format.into(), ..Source::computed(self.name) };
        build(&source, origin, &path, &build_options(CORE), &|progress| {
            pace.tell(|| format!("  {} of {} bricks", progress.bricks_done, progress.bricks_total));
        })?;
        Volume::open(self.name, &path)
    }

    fn pictures(&self, volume: &Volume, looks: Looks) -> Result<Vec<(&'static str, Scene)>, ChartError> {
        let target = volume.world(volume.middle());
        let distance = match self.distance {
            Distance::Radii(radii) => radii * volume.radius(),
            Distance::Edges(edges) => edges * volume.facts.dims.0[0] as f64 * volume.facts.geometry.spacing[0],
        };
        let eye = target + self.direction.normalize() * distance;
        let point = |&(value, color, alpha): &Point| json!({"value": value, "color": color, "alpha": alpha});
        let mut members = json!({
            "camera": {"eye": eye.to_array(), "target": target.to_array(), "up": [0.0, 0.0, 1.0], "fov_y": FOV_Y},
            "transfer_function": {"unit_distance": 1.0, "points": self.points.iter().map(point).collect::<Vec<_>>()},
        });
        let mut pictures = Vec::new();
        if looks != Looks::Shaded {
            pictures.push(("unshaded", Scene::from_json(&members.to_string())?));
        }
        if looks != Looks::Unshaded {
            members["shading"] = json!({"ambient": 0.3, "diffuse": 0.7, "specular": 0.2, "shininess": 32.0});
            pictures.push(("shaded", Scene::from_json(&members.to_string())?));
        }
        Ok(pictures)
    }
}

impl Built {
    /// Pictures of the volume.
    #[must_use]
    pub fn cases(&self) -> Vec<Case<'_>> {
        self.pictures.iter().map(|(look, scene)| Case { built: self, look, scene }).collect()
    }

    /// Voxels along x, y, z.
    #[must_use]
    pub fn dims(&self) -> Dims {
        self.volume.facts.dims
    }

    /// Whether the volume has absent voxels.
    #[must_use]
    pub fn has_holes(&self) -> bool {
        let container = &self.volume.container;
        container.descriptor().dims().voxels() != Some(container.manifest().present_voxels)
    }

    /// NumPy file with the voxels of level 0 in data units, for `numpy.load`; written at the first call.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn grid_file(&self, context: &Context<'_>) -> Result<&Path, ChartError> {
        if let Some(path) = self.grid_file.get() {
            return Ok(path);
        }
        (context.say)(&format!("writing the voxels of {} for other programs", self.name));
        let path = context.folder.join(format!("{}-voxels.npy", self.name));
        let all = Extraction {
            lod: Lod::FINEST,
            voxels: None,
            existing: Existing::Replace,
            memory_bytes: EXTRACTION_MEMORY_BYTES,
        };
        extract(&self.volume.container, &path, &all)?;
        Ok(self.grid_file.get_or_init(|| path))
    }

    /// The volume for the reference integrator, loaded at the first call; `None` if it needs too much memory.
    ///
    /// # Errors
    /// If a brick cannot be read.
    pub fn exact(&self, scene: &ResolvedScene) -> Result<Option<&ReferenceVolume>, ChartError> {
        if let Some(known) = self.exact.get() {
            return Ok(known.as_ref());
        }
        let loaded = match load_level(&self.volume.container, Lod::FINEST, scene, REFERENCE_MEMORY_BYTES) {
            Ok(volume) => Some(volume),
            Err(RenderError::ReferenceTooLarge { .. }) => None,
            Err(error) => return Err(error.into()),
        };
        Ok(self.exact.get_or_init(|| loaded).as_ref())
    }
}

/// One picture, drawn by both programs.
#[derive(Debug, Clone, Copy)]
pub struct Case<'a> {
    /// The volume.
    pub built: &'a Built,
    /// `unshaded`, `shaded`, or `default` for the user's own volume.
    pub look: &'static str,
    scene: &'a Scene,
}

impl Case<'_> {
    /// Volume and look, for messages and file names.
    #[must_use]
    pub fn name(&self) -> String {
        format!("{}-{}", self.built.name, self.look)
    }

    /// Smallest voxel spacing, world length: the unit of steps.
    #[must_use]
    pub fn smallest_spacing(&self) -> f64 {
        self.built.volume.facts.geometry.smallest_spacing()
    }

    /// The scene with this image size, clipped to the centres of the outermost voxels.
    ///
    /// # Errors
    /// If the scene is invalid: an error in the recipe.
    pub fn scene(&self, size: [u32; 2]) -> Result<ResolvedScene, ChartError> {
        self.resolved(self.scene.clone(), size)
    }

    /// The same scene from another camera, in world coordinates; `fov_y` in degrees.
    ///
    /// # Errors
    /// If the camera is invalid.
    pub fn seen_from(
        &self,
        eye: DVec3,
        target: DVec3,
        up: [f64; 3],
        fov_y: f64,
        size: [u32; 2],
    ) -> Result<ResolvedScene, ChartError> {
        let camera =
            CameraSpec { eye: eye.to_array(), target: target.to_array(), up, fov_y: Some(fov_y), height: None };
        self.resolved(Scene { camera: Some(camera), ..self.scene.clone() }, size)
    }

    fn resolved(&self, scene: Scene, [width, height]: [u32; 2]) -> Result<ResolvedScene, ChartError> {
        let facts = &self.built.volume.facts;
        let last = facts.dims.0.map(|n| n as f64 - 1.0);
        let image = ImageSpec { width, height, ..scene.image };
        let clip = ClipSpec { index_box: Some([[0.0; 3], last]), ..scene.clip };
        Ok(Scene { image, clip, ..scene }.resolve(facts)?)
    }
}

/// A source in index space: spacing 1, origin 0, no rotation.
struct InIndexSpace {
    source: Box<dyn VolumeSource>,
    info: SourceInfo,
}

impl InIndexSpace {
    fn new(source: Box<dyn VolumeSource>) -> Self {
        let mut info = source.info().clone();
        info.geometry = Geometry::IDENTITY;
        Self { source, info }
    }
}

impl VolumeSource for InIndexSpace {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        self.source.read_box(voxels, out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn built(context: &Context<'_>, name: &str, edge: u64) -> Built {
        let plan = planned(context, &Subject::Scenes(vec![name.into()]), Some(edge)).expect("a scene");
        plan[0].build(context, Looks::Both, &[]).expect("a small volume")
    }

    /// Published times refer to these pictures: a change makes old records worthless.
    #[test]
    fn quoted_scenes_have_one_camera_and_their_own_ramp() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let context = Context { scale: Scale::Full, folder: folder.path(), say: &|_| () };
        for (name, ramp) in [
            ("marschner-lobb", [(0.3, 0.0), (1.0, 0.1)]),
            ("seismic", [(0.55, 0.0), (1.0, 0.3)]),
            ("vessels", [(0.2, 0.0), (0.9, 0.3)]),
        ] {
            let built = built(&context, name, 20);
            let looks: Vec<&str> = built.cases().iter().map(|case| case.look).collect();
            assert_eq!(looks, ["unshaded", "shaded"]);
            let scene = built.cases()[0].scene([1024, 768]).expect("a scene");
            let from_middle = scene.camera.eye - DVec3::splat(9.5);
            assert!((from_middle.length() - 2.6 * 20.0).abs() < 1e-9);
            assert!((from_middle.y.atan2(from_middle.x).to_degrees() - 30.0).abs() < 1e-9);
            assert!((from_middle.z / from_middle.length() - 20f64.to_radians().sin()).abs() < 1e-9);
            assert_eq!(scene.transfer_function.unit_distance(), 1.0);
            let points: Vec<_> = scene.transfer_function.points().iter().map(|p| (p.value, p.alpha)).collect();
            assert_eq!(points, ramp.map(|(share, alpha): (f64, f64)| (255.0 * share, alpha)), "{name}");
            assert_eq!(scene.clip.index_box, Some([[0.0; 3], [19.0; 3]]));
        }
    }

    #[test]
    fn other_programs_get_the_voxels_of_the_container() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let context = Context { scale: Scale::Small, folder: folder.path(), say: &|_| () };
        let built = built(&context, "marschner-lobb", 12);
        assert!(!built.has_holes());
        let bytes = std::fs::read(built.grid_file(&context).expect("room")).expect("it was written");
        let header = String::from_utf8_lossy(&bytes[..128]).into_owned();
        assert!(header.contains("'|u1'") && header.contains("(12, 12, 12)"), "{header}");
        let scene = built.cases()[0].scene([4, 3]).expect("a scene");
        let exact = built.exact(&scene).expect("it is read").expect("it is small");
        let voxels: Vec<f64> = bytes[bytes.len() - 12 * 12 * 12..].iter().map(|&v| f64::from(v)).collect();
        assert_eq!(voxels, exact.values);
    }
}
