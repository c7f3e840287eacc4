//! Classification of bricks by their TOC entries alone: absent, invisible, uniform, or to be read.
//!
//! The value range in the TOC bounds every interpolated value. In `dvr`, a brick is *invisible* if the transfer
//! function is transparent on its whole range. Its macro cells are then invisible too, and leaving it out changes no
//! picture. In `iso`, a ray must know on which side of the iso values it is. So a brick without holes whose range holds
//! no iso value is answered as uniform, with a value on its side. `mip`, `minip` and `mean` must see every present
//! value.
//!
//! A coarser level holds averages, which may hide values of level 0. If levels are chosen brick by brick, a brick that
//! would change the picture too much is *too coarse* ([`crate::lod::by_error`]): its children are drawn instead.

use supervol_format::container::toc::BrickEntry;
use supervol_format::{BrickKey, Container, Lod, ValueRange, VoxelType};
use supervol_scene::scene::{Mode, ResolvedScene};
use supervol_scene::transfer_function::RenderTransferFunction;
use supervol_scene::value_map::ValueMap;

use super::state::Emptiness;
use crate::lod::by_error::{LevelsByError, Verdict};
use crate::lod::deviation::Holes;

/// Most TOC entries searched for holes beneath a brick. If there are more, holes are assumed.
const HOLE_SEARCH_LIMIT: usize = 1024;

/// Whether interpolation in this brick, or in a brick beneath it, may reach an absent voxel. Decided by TOC entries.
#[must_use]
pub fn holes_in(container: &Container, key: BrickKey, entry: &BrickEntry) -> Holes {
    let voxels = container.descriptor().dims().0.iter().fold(1, |product: u64, &n| product.saturating_mul(n));
    if container.manifest().present_voxels == voxels {
        return Holes::None;
    }
    let mut left = vec![(key, Ok(*entry))];
    for _ in 0..HOLE_SEARCH_LIMIT {
        match left.pop() {
            None => return Holes::None,
            Some((key, Ok(entry))) if !entry.has_holes && !entry.absent => {
                left.extend(container.pyramid().children(key).map(|k| (k, container.entry(k))));
            }
            Some(_) => return Holes::Possible,
        }
    }
    Holes::Possible
}

/// Whether macro cells that cannot change the picture are skipped. The picture is the same to the last bit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Skipping {
    /// They are skipped.
    #[default]
    On,
    /// They are walked cell by cell: for tests.
    Off,
}

/// Treatment of a brick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Class {
    /// Nothing in it can be seen.
    Nothing(Emptiness),
    /// It has this render value everywhere.
    Uniform(f32),
    /// It must be read and decoded.
    Load,
    /// It must not be drawn while its children can be.
    TooCoarse,
}

/// Classification of bricks for one scene.
#[derive(Debug)]
pub struct Classifier {
    voxel_type: VoxelType,
    map: ValueMap,
    visibility: Visibility,
    skipping: Skipping,
    /// Rules for bricks that are too coarse; `None` if a fixed level was requested.
    levels: Option<LevelsByError>,
}

#[derive(Debug)]
enum Visibility {
    /// Every present value is seen.
    All,
    /// Values of positive opacity are seen.
    Classified(Box<RenderTransferFunction>),
    /// Ranges that hold one of these render values are seen.
    Iso(Vec<f32>),
}

impl Classifier {
    /// Classification for a scene over a container with this voxel type and value map. No brick is too coarse.
    #[must_use]
    pub fn new(scene: &ResolvedScene, voxel_type: VoxelType, map: ValueMap, skipping: Skipping) -> Self {
        let visibility = match scene.mode {
            Mode::Dvr => {
                Visibility::Classified(Box::new(RenderTransferFunction::new(&scene.transfer_function, map.shift)))
            }
            Mode::Iso => Visibility::Iso(scene.iso.iter().map(|i| map.from_data(i.value)).collect()),
            Mode::Mip | Mode::Minip | Mode::Mean | Mode::Slice => Visibility::All,
        };
        Self { voxel_type, map, visibility, skipping, levels: None }
    }

    /// The same classification, which also refuses bricks that these rules call too coarse.
    #[must_use]
    pub fn with_levels(self, levels: LevelsByError) -> Self {
        Self { levels: Some(levels), ..self }
    }

    /// Class of the brick with this entry. `holes` is called at most once. It tells whether a voxel of this
    /// brick, or of a brick beneath it, may be absent.
    #[must_use]
    pub fn classify(&self, key: BrickKey, entry: &BrickEntry, holes: impl FnOnce() -> Holes) -> Class {
        let verdict = self.levels.as_ref().map_or(Verdict::Fine, |levels| levels.verdict(key, entry));
        match verdict {
            Verdict::TooCoarse => Class::TooCoarse,
            Verdict::FineWithoutHoles if holes() == Holes::Possible => Class::TooCoarse,
            Verdict::Fine | Verdict::FineWithoutHoles => self.classify_drawn(entry),
        }
    }

    /// Whether a bound proves that drawing the brick keeps the picture within the requested error. True for level 0 if
    /// its voxels are the source's. False for a requested level, for a brick accepted by a heuristic, and for a brick
    /// that stands in for a child.
    #[must_use]
    pub fn has_bound(&self, key: BrickKey, entry: &BrickEntry, holes: impl FnOnce() -> Holes) -> bool {
        let verdict = self.levels.as_ref().map(|levels| levels.bounded_verdict(key, entry));
        match verdict {
            _ if key.lod() == Lod::FINEST => entry.error == 0.0,
            None | Some(Verdict::TooCoarse) => false,
            Some(Verdict::Fine) => true,
            Some(Verdict::FineWithoutHoles) => holes() == Holes::None,
        }
    }

    /// Class of the brick with this entry when it is drawn, however coarse it is.
    #[must_use]
    pub fn classify_drawn(&self, entry: &BrickEntry) -> Class {
        if entry.absent {
            return Class::Nothing(Emptiness::Absent);
        }
        let (low, high) = self.render_range(entry.range);
        // The answer is the same whether macro cells are skipped or not: so is the picture.
        let is_left_out = self.skipping == Skipping::On && !self.is_visible((low, high));
        match &self.visibility {
            Visibility::Classified(_) if is_left_out => Class::Nothing(Emptiness::Invisible),
            Visibility::Iso(_) if is_left_out && !entry.has_holes => Class::Uniform(low),
            _ if entry.uniform => Class::Uniform(low),
            _ => Class::Load,
        }
    }

    /// Least and greatest render value of a range of container values.
    fn render_range(&self, range: ValueRange) -> (f32, f32) {
        let ends = [range.min, range.max].map(|v| self.map.from_container(self.voxel_type, v));
        (ends[0].min(ends[1]), ends[0].max(ends[1]))
    }

    fn is_visible(&self, (low, high): (f32, f32)) -> bool {
        match &self.visibility {
            Visibility::All => true,
            Visibility::Classified(function) => function.is_visible(low, high),
            Visibility::Iso(values) => values.iter().any(|v| (low..=high).contains(v)),
        }
    }
}

#[cfg(test)]
mod tests {
    use supervol_format::codec::Codec;
    use supervol_format::{BrickIndex, BrickLayout, Dims, Geometry, Pyramid};
    use supervol_scene::facts::VolumeFacts;
    use supervol_scene::scene::Scene;

    use super::*;
    use crate::lod::by_error::DataScale;
    use crate::lod::{LodChoice, LodRule};

    const VALUES: ValueRange = ValueRange { min: 0.0, max: 255.0 };

    fn scene(json: &str) -> ResolvedScene {
        let facts = VolumeFacts::plain(Dims([16; 3]), Geometry::IDENTITY, VALUES);
        Scene::from_json(json).unwrap().resolve(&facts).unwrap()
    }

    fn classifier(json: &str, skipping: Skipping) -> Classifier {
        let map = ValueMap::for_container(VoxelType::U8, -1.0, 255.0, None, VALUES);
        Classifier::new(&scene(json), VoxelType::U8, map, skipping)
    }

    fn entry(min: f64, max: f64) -> BrickEntry {
        let range = ValueRange { min, max };
        BrickEntry {
            offset: 4096,
            payload_bytes: 1,
            macro_cell_bytes: 2,
            codec: Codec::Raw,
            absent: range.is_empty(),
            uniform: min == max,
            has_holes: false,
            checksum: 0,
            fill: 0,
            range,
            range_beneath: range,
            error: 0.0,
        }
    }

    #[test]
    fn only_modes_that_cannot_see_a_value_leave_it_out() {
        // Data value = 255 - stored value; visible above 200, which are stored values below 55.
        let points = r#""transfer_function": {"points": [{"value": 200, "color": [1,1,1], "alpha": 0},
            {"value": 255, "color": [1,1,1], "alpha": 1}]}"#;
        let invisible = Class::Nothing(Emptiness::Invisible);
        let dvr = classifier(&format!("{{{points}}}"), Skipping::On);
        assert_eq!(dvr.classify_drawn(&entry(60.0, 250.0)), invisible);
        assert_eq!(dvr.classify_drawn(&entry(50.0, 250.0)), Class::Load);
        assert_eq!(dvr.classify_drawn(&entry(60.0, 60.0)), invisible);
        assert_eq!(dvr.classify_drawn(&entry(5.0, 5.0)), Class::Uniform(250.0));
        assert_eq!(
            classifier(&format!("{{{points}}}"), Skipping::Off).classify_drawn(&entry(60.0, 250.0)),
            Class::Load
        );
        let iso = classifier(r#"{"mode": "iso", "iso": [{"value": 100, "color": [1,1,1]}]}"#, Skipping::On);
        assert_eq!(iso.classify_drawn(&entry(156.0, 250.0)), Class::Uniform(5.0));
        assert_eq!(iso.classify_drawn(&entry(155.0, 250.0)), Class::Load);
        assert_eq!(iso.classify_drawn(&BrickEntry { has_holes: true, ..entry(156.0, 250.0) }), Class::Load);
        for mode in ["mip", "minip", "mean"] {
            let all = classifier(&format!("{{\"mode\": \"{mode}\", {points}}}"), Skipping::On);
            assert_eq!(all.classify_drawn(&entry(60.0, 250.0)), Class::Load, "{mode}");
            let absent = entry(f64::INFINITY, f64::NEG_INFINITY);
            assert_eq!(all.classify_drawn(&absent), Class::Nothing(Emptiness::Absent), "{mode}");
        }
    }

    /// Rules that are never asked about level 0, and refuse every other brick whose error may be seen.
    #[test]
    fn bricks_that_are_too_coarse_are_refused_whatever_else_they_are() {
        let points = r#""transfer_function": {"points": [{"value": 200, "color": [1,1,1], "alpha": 0},
            {"value": 255, "color": [1,1,1], "alpha": 1}]}"#;
        let pyramid = Pyramid::new(Dims([32; 3]), BrickLayout::new(16).unwrap(), &[[2, 2, 2]]).unwrap();
        let (fine, coarse) = (0, 1);
        let key = |lod| BrickKey::new(Lod(lod), BrickIndex([0; 3]));
        for skipping in [Skipping::On, Skipping::Off] {
            let scene = scene(&format!("{{{points}}}"));
            let data = DataScale {
                pyramid: &pyramid,
                geometry: &Geometry::IDENTITY,
                scale: -1.0,
                offset: 255.0,
                value_range: VALUES,
                voxel_error: 0.0,
            };
            let lod = LodRule::new(LodChoice::Auto { voxel_pixels: 1.0 }, &scene.camera, &Geometry::IDENTITY);
            let levels = LevelsByError::new(&scene, &data, lod, 0.5 / 255.0);
            let automatic = classifier(&format!("{{{points}}}"), skipping).with_levels(levels);
            let wrong = BrickEntry { error: 40.0, ..entry(0.0, 250.0) };
            let class = |lod, entry: &BrickEntry, holes: Holes| automatic.classify(key(lod), entry, || holes);
            assert_eq!(class(coarse, &wrong, Holes::None), Class::TooCoarse);
            assert_eq!(class(coarse, &BrickEntry { uniform: true, ..wrong }, Holes::None), Class::TooCoarse);
            assert_eq!(class(fine, &wrong, Holes::Possible), Class::Load, "nothing is finer than level 0");
            assert_eq!(automatic.classify_drawn(&wrong), Class::Load, "where it stands in for a child");
            let exact = BrickEntry { error: 0.0, ..wrong };
            let has_bound = |lod, entry: &BrickEntry| automatic.has_bound(key(lod), entry, || Holes::None);
            assert!(has_bound(fine, &exact) && has_bound(coarse, &exact) && !has_bound(coarse, &wrong));
            assert!(!has_bound(fine, &wrong), "its voxels were moved");
            assert_eq!(
                [Holes::Possible, Holes::None].map(|holes| class(coarse, &exact, holes)),
                [Class::TooCoarse, Class::Load]
            );
            // Stored values above 55 are invisible, here and in all bricks beneath: neither errors nor holes matter.
            let clear = BrickEntry { error: 190.0, ..entry(60.0, 250.0) };
            assert_eq!(class(coarse, &clear, Holes::Possible), automatic.classify_drawn(&clear));
        }
    }
}
