//! What the table of contents alone says about a brick: absent, invisible, uniform, or to be read.
//!
//! The range in the TOC bounds everything that interpolation reaches. In `dvr`, a brick on whose range the transfer
//! function is transparent is *invisible*: its macro cells are so too, and leaving it out changes no picture. In `iso`, a
//! ray must know on which side of the iso values it is: a brick without holes whose range holds no iso value is answered
//! as uniform, with a value on its side. `mip`, `minip` and `mean` must see every present value.
//!
//! A coarser level holds averages: what is visible in level 0 may have no visible value left there. Where the level is
//! chosen brick by brick, such a brick has *vanished*, and is refused: its children are drawn instead.

use supervol_format::container::toc::BrickEntry;
use supervol_format::{ValueRange, VoxelType};

use super::state::Emptiness;
use crate::lod::LodChoice;
use crate::raycast::cpu::Skipping;
use crate::raycast::volume::ValueMap;
use crate::scene::{Mode, ResolvedScene};
use crate::transfer_function::RenderTransferFunction;

/// What must be done for a brick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Class {
    /// Nothing of it can be seen.
    Nothing(Emptiness),
    /// It has this render value everywhere.
    Uniform(f32),
    /// It must be read and decoded.
    Load,
}

/// Classification of bricks for one scene.
#[derive(Debug)]
pub struct Classifier {
    voxel_type: VoxelType,
    map: ValueMap,
    visibility: Visibility,
    skipping: Skipping,
    /// Whether bricks whose visible values have vanished are refused.
    refuses_vanished: bool,
}

#[derive(Debug)]
enum Visibility {
    /// Every present value is seen.
    All,
    /// What has positive opacity is seen.
    Classified(Box<RenderTransferFunction>),
    /// Ranges that hold one of these render values are seen.
    Iso(Vec<f32>),
}

impl Classifier {
    /// Classification for a scene over a container with this voxel type and value map.
    #[must_use]
    pub fn new(
        scene: &ResolvedScene,
        voxel_type: VoxelType,
        map: ValueMap,
        skipping: Skipping,
        lod: LodChoice,
    ) -> Self {
        let visibility = match scene.mode {
            Mode::Dvr => {
                Visibility::Classified(Box::new(RenderTransferFunction::new(&scene.transfer_function, map.shift)))
            }
            Mode::Iso => Visibility::Iso(scene.iso.iter().map(|i| map.from_data(i.value)).collect()),
            Mode::Mip | Mode::Minip | Mode::Mean | Mode::Slice => Visibility::All,
        };
        // Who asks for a level gets it.
        let refuses_vanished = matches!(lod, LodChoice::Auto { .. });
        Self { voxel_type, map, visibility, skipping, refuses_vanished }
    }

    /// What must be done for the brick of this entry.
    #[must_use]
    pub fn classify(&self, entry: &BrickEntry) -> Class {
        if entry.absent {
            return Class::Nothing(Emptiness::Absent);
        }
        let (low, high) = self.render_range(entry.range);
        let is_invisible = !self.is_visible((low, high));
        // Whether macro cells are skipped or not: the picture is the same.
        if self.refuses_vanished && is_invisible && self.is_visible(self.render_range(entry.range_beneath)) {
            return Class::Nothing(Emptiness::Vanished);
        }
        let is_left_out = is_invisible && self.skipping == Skipping::On;
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
    use super::*;
    use crate::scene::{DataKind, Scene, VolumeFacts};
    use supervol_format::codec::Codec;
    use supervol_format::{Dims, Geometry};

    fn classifier(json: &str, skipping: Skipping) -> Classifier {
        let value_range = ValueRange { min: 0.0, max: 255.0 };
        let facts = VolumeFacts {
            dims: Dims([16; 3]),
            geometry: Geometry::IDENTITY,
            value_range,
            percentiles: vec![],
            kind: DataKind::Generic,
            has_zero_centre: false,
        };
        let scene = Scene::from_json(json).unwrap().resolve(&facts).unwrap();
        let map = ValueMap::for_container(VoxelType::U8, -1.0, 255.0, None, value_range);
        Classifier::new(&scene, VoxelType::U8, map, skipping, LodChoice::Auto { voxel_pixels: 1.0 })
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
        assert_eq!(dvr.classify(&entry(60.0, 250.0)), invisible);
        assert_eq!(dvr.classify(&entry(50.0, 250.0)), Class::Load);
        assert_eq!(dvr.classify(&entry(60.0, 60.0)), invisible);
        assert_eq!(dvr.classify(&entry(5.0, 5.0)), Class::Uniform(250.0));
        assert_eq!(classifier(&format!("{{{points}}}"), Skipping::Off).classify(&entry(60.0, 250.0)), Class::Load);
        let iso = classifier(r#"{"mode": "iso", "iso": [{"value": 100, "color": [1,1,1]}]}"#, Skipping::On);
        assert_eq!(iso.classify(&entry(156.0, 250.0)), Class::Uniform(5.0));
        assert_eq!(iso.classify(&entry(155.0, 250.0)), Class::Load);
        assert_eq!(iso.classify(&BrickEntry { has_holes: true, ..entry(156.0, 250.0) }), Class::Load);
        for mode in ["mip", "minip", "mean"] {
            let all = classifier(&format!("{{\"mode\": \"{mode}\", {points}}}"), Skipping::On);
            assert_eq!(all.classify(&entry(60.0, 250.0)), Class::Load, "{mode}");
            let absent = entry(f64::INFINITY, f64::NEG_INFINITY);
            assert_eq!(all.classify(&absent), Class::Nothing(Emptiness::Absent), "{mode}");
        }
    }

    /// S16, S18: averaging left nothing visible of what is visible beneath.
    #[test]
    fn bricks_whose_visible_values_have_vanished_are_refused_where_the_level_is_free() {
        let points = r#"{"transfer_function": {"points": [{"value": 200, "color": [1,1,1], "alpha": 0},
            {"value": 255, "color": [1,1,1], "alpha": 1}]}}"#;
        let vanished = BrickEntry { range_beneath: ValueRange { min: 0.0, max: 255.0 }, ..entry(60.0, 250.0) };
        for skipping in [Skipping::On, Skipping::Off] {
            let free = classifier(points, skipping);
            assert_eq!(free.classify(&vanished), Class::Nothing(Emptiness::Vanished));
            let uniform = BrickEntry { uniform: true, ..vanished };
            assert_eq!(free.classify(&uniform), Class::Nothing(Emptiness::Vanished));
            let visible = BrickEntry { range: ValueRange { min: 50.0, max: 250.0 }, ..vanished };
            assert_eq!(free.classify(&visible), Class::Load);
            let fixed = Classifier { refuses_vanished: false, ..free };
            assert_ne!(fixed.classify(&vanished), Class::Nothing(Emptiness::Vanished));
        }
        let iso = classifier(r#"{"mode": "iso", "iso": [{"value": 100, "color": [1,1,1]}]}"#, Skipping::On);
        let vanished = BrickEntry { range_beneath: ValueRange { min: 0.0, max: 255.0 }, ..entry(156.0, 250.0) };
        assert_eq!(iso.classify(&vanished), Class::Nothing(Emptiness::Vanished));
    }
}
