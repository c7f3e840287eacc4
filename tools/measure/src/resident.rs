//! All bricks of a container, decoded in memory, and brick views that the streamer never hands out.
//!
//! In a frame, the streamer selects the level of each brick and skips bricks. Here the measurement does:
//! - [`Mixed`] forces two levels into one picture;
//! - [`Classified`] skips the bricks that a transfer function makes invisible, without reading anything, so that
//!   thousands of pictures take seconds.
//!
//! Casting and compositing are those of the CPU ray caster.

use std::collections::HashMap;
use std::sync::Arc;

use supervol_format::cast::index;
use supervol_format::{BrickKey, Container, Lod};
use supervol_runtime::engines::cpu::{CpuFrame, CpuQuality, CpuRays};
use supervol_runtime::engines::ray_scene::DrawnVolume;
use supervol_runtime::lod::LodChoice;
use supervol_runtime::stream::classify::{Class, Classifier, Skipping};
use supervol_runtime::stream::residency::{BrickView, DecodedBrick, Resident};
use supervol_scene::image::Image;
use supervol_scene::scene::ResolvedScene;
use supervol_scene::units::InUnits;
use supervol_scene::value_map::ValueMap;
use supervol_scene::value_map::value_map;

use crate::context::ChartError;

/// All bricks of all levels, decoded.
#[derive(Debug)]
pub struct ResidentBricks {
    container: Arc<Container>,
    map: ValueMap,
    bricks: HashMap<BrickKey, DecodedBrick>,
}

impl ResidentBricks {
    /// Reads and decodes every brick.
    ///
    /// # Errors
    /// If a brick cannot be read.
    pub fn load(container: &Arc<Container>) -> Result<Self, ChartError> {
        let map = value_map(container);
        let mut bricks = HashMap::new();
        for lod in container.pyramid().lods() {
            for key in container.pyramid().keys_of(lod) {
                bricks.insert(key, decode(container, key, &map)?);
            }
        }
        Ok(Self { container: container.clone(), map, bricks })
    }

    /// The picture of a view of these bricks.
    ///
    /// # Errors
    /// If a ray waits: the view has answered [`Resident::Missing`].
    pub fn picture<V: BrickView + ?Sized>(
        &self,
        view: &V,
        scene: &ResolvedScene,
        quality: CpuQuality,
    ) -> Result<Image, ChartError> {
        let frame = self.frame(scene, quality);
        let states = cast(view, &frame)?;
        let image = states.image();
        if !image.is_finite() {
            return Err(ChartError::Broken("a pixel is no number".into()));
        }
        Ok(image)
    }

    /// The frame of a scene over these bricks.
    #[must_use]
    pub fn frame(&self, scene: &ResolvedScene, quality: CpuQuality) -> CpuFrame {
        let InUnits { geometry, value_range, .. } = InUnits::of(&self.container);
        let volume = DrawnVolume { pyramid: self.container.pyramid(), geometry: &geometry, map: self.map, value_range };
        CpuFrame::new(scene, &volume, quality)
    }

    /// The picture of one fixed level.
    ///
    /// # Errors
    /// Never: all bricks are in memory.
    pub fn level(&self, scene: &ResolvedScene, lod: Lod) -> Result<Image, ChartError> {
        self.picture(self, scene, at_level(lod))
    }
}

/// Casts all rays of a frame; they must finish in one pass.
///
/// # Errors
/// If a ray waits.
pub fn cast<V: BrickView + ?Sized>(view: &V, frame: &CpuFrame) -> Result<CpuRays, ChartError> {
    let mut states = frame.begin();
    let feedback = states.cast_pass(view);
    match feedback.misses.first() {
        None => Ok(states),
        Some(miss) => Err(ChartError::Broken(format!("a ray waits for {}, but every brick is in memory", miss.key))),
    }
}

/// One fixed level everywhere; default settings otherwise.
#[must_use]
pub fn at_level(lod: Lod) -> CpuQuality {
    CpuQuality { lod: LodChoice::Fixed(lod), ..CpuQuality::default() }
}

impl BrickView for ResidentBricks {
    fn lookup(&self, key: BrickKey) -> Resident<'_> {
        self.bricks.get(&key).map_or(Resident::Missing, Resident::from)
    }
}

/// Mixed levels: `coarse` for bricks that `is_coarse` selects, as if their finer bricks had failed, else level 0.
pub struct Mixed<'a> {
    /// All bricks of the container.
    pub all: &'a ResidentBricks,
    /// The coarser of the two levels.
    pub coarse: Lod,
    /// Selector, called with brick keys of level 0.
    pub is_coarse: &'a (dyn Fn(BrickKey) -> bool + Sync),
}

impl std::fmt::Debug for Mixed<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Mixed").field("all", &self.all).field("coarse", &self.coarse).finish_non_exhaustive()
    }
}

impl BrickView for Mixed<'_> {
    fn lookup(&self, key: BrickKey) -> Resident<'_> {
        let too_fine = if key.lod() == Lod::FINEST { (self.is_coarse)(key) } else { key.lod() < self.coarse };
        if too_fine { Resident::UseParent } else { self.all.lookup(key) }
    }
}

/// Bricks as the streamer hands them out for one scene: invisible bricks are skipped.
#[derive(Debug)]
pub struct Classified<'a> {
    all: &'a ResidentBricks,
    classes: HashMap<BrickKey, Class>,
}

impl<'a> Classified<'a> {
    /// Classifies every brick with the streamer's classifier.
    ///
    /// # Errors
    /// If the table of contents cannot be read.
    pub fn new(all: &'a ResidentBricks, scene: &ResolvedScene, skipping: Skipping) -> Result<Self, ChartError> {
        let container = &all.container;
        let classifier = Classifier::new(scene, container.descriptor().voxel_type, all.map, skipping);
        // These views draw one fixed level, even where it is invisible.
        let class = |&key: &BrickKey| Ok((key, classifier.classify_drawn(&container.entry(key)?)));
        Ok(Self { all, classes: all.bricks.keys().map(class).collect::<Result<_, ChartError>>()? })
    }
}

impl BrickView for Classified<'_> {
    fn lookup(&self, key: BrickKey) -> Resident<'_> {
        match self.classes.get(&key) {
            None => Resident::Missing,
            Some(Class::Nothing(_)) => Resident::Nothing,
            Some(&Class::Uniform(value)) => Resident::Uniform(value),
            Some(Class::Load | Class::TooCoarse) => self.all.lookup(key),
        }
    }
}

fn decode(container: &Container, key: BrickKey, map: &ValueMap) -> Result<DecodedBrick, ChartError> {
    let descriptor = container.descriptor();
    let entry = container.entry(key)?;
    let mut record = vec![0; index(entry.record_bytes())];
    if !record.is_empty() {
        container.read_at(entry.offset, &mut record)?;
    }
    let mut voxels = vec![0; container.shape(key).bytes()];
    container.decode_brick(key, &entry, &record, &mut voxels)?;
    let ranges = container.macro_cells(key, &entry, &record).into_iter().map(|range| [range.min, range.max]);
    let decoded = DecodedBrick::from_stored(key, container.shape(key), &voxels, ranges, map, descriptor.absence, None);
    Ok(decoded.with_macro_errors(container.cell_errors(key, &entry, &record)))
}
